"""Other programs' rigs (``rigs.toml``): a person under their joints' names, in their rest pose, with its motion."""

import tomllib
from dataclasses import dataclass, replace
from importlib.resources import files

import numpy as np

from mmocap_warp.body.model import BodyModel, joint_transforms
from mmocap_warp.body.rotations import transposed
from mmocap_warp.body.skeleton import TRANSLATION
from mmocap_warp.errors import UsageError
from mmocap_warp.formats.exports.tables import steady_angles
from mmocap_warp.result.result import Result

_MAX_NAMED = 4  # joints that a message lists


@dataclass(frozen=True)
class Rig:
    """How another program knows a person."""

    names: dict[str, str]  # its name of each of the body's joints
    # By the joint at which a bone begins: the one at which it ends, and where it points in the rest pose, in body axes.
    # What hangs on a bone turns with it, except ``upright``.
    bones: dict[str, tuple[str, list[float]]]
    upright: list[str]  # joints that stay as they are in the body's bind pose


_SHIPPED = tomllib.loads(files(__package__).joinpath("rigs.toml").read_text(encoding="utf-8"))
RIGS = {name: Rig(rig["names"], **_SHIPPED["poses"][rig["pose"]]) for name, rig in _SHIPPED["rigs"].items()}


def with_rig(result: Result, rig: str) -> Result:
    """A result whose body is bound and named as a rig of ``RIGS``; its joints are where they were.

    The skin is bound anew as it is in the rest pose. Where a joint moves a part of it by weights, it then moves a
    little differently; elsewhere it is where it was. Shape targets, limits and standard deviations are dropped. What is
    attached stays so, under its own names. Raises a UsageError for no such rig, or a body without its joints.
    """
    subject, body = result.subject, result.subject.body
    # The body in the rig's rest pose, under the rig's names; joints' axes are the body's, and free.
    names, joints = rig_names(body, rig), body.skeleton.joints
    turn, rest = rest_pose(body, RIGS[rig])
    skin, shift = body.skin, rest - np.einsum("jab,jb->ja", turn, body.joint_rest)
    moved = np.einsum("vkab,vb->vka", turn[skin.joint], skin.rest) + shift[skin.joint]
    skeleton = replace(
        body.skeleton,
        joints=tuple(names[joint] for joint in joints),
        frame=np.tile(np.eye(3, dtype=np.float32), (len(joints), 1, 1)),
        limits=np.tile(np.array([-np.inf, np.inf], np.float32), (len(joints), 3, 1)),
        pairs=tuple((name, names[left], names[right]) for name, left, right in body.skeleton.pairs),
    )
    rig_body = replace(
        body,
        skeleton=skeleton,
        joint_rest=rest.astype(np.float32),
        skin=replace(skin, rest=np.einsum("vk,vka->va", skin.weight, moved).astype(np.float32)),
        shape_names=(),
        shape_vertex=body.shape_vertex[:0],
        shape_joint=body.shape_joint[:0],
    )

    def to_rig_poses(pose: np.ndarray) -> np.ndarray:
        """Poses (frame, coordinate) of the body as poses of the rig."""
        world = joint_transforms(subject, pose)[1][..., :3, :3] @ transposed(body.skeleton.frame.astype(float))
        world = world @ transposed(turn)
        own = world.copy()
        own[:, 0] = subject.root_base.T @ world[:, 0]
        for joint, parent in enumerate(skeleton.parent[1:], 1):
            own[:, joint] = transposed(world[:, parent]) @ world[:, joint]
        angles = steady_angles(own)
        for name in skeleton.sliding:  # along the body's axes now
            number = skeleton.index(name)
            along = turn[skeleton.parent[number]] @ body.skeleton.frame[number].astype(float)
            angles[:, number] = pose[:, body.skeleton.angles(name)] @ along.T
        return np.concatenate([pose[:, :TRANSLATION], angles.reshape(len(pose), -1)], axis=1)

    return replace(
        result,
        subject=replace(subject, body=rig_body, pose=to_rig_poses(subject.pose[None])[0]),
        pose=np.stack([to_rig_poses(run) for run in result.pose]),
        raw_pose=None,
        angle_sigma=None,
        joint_sigma=None,
    )


def rig_names(body: BodyModel, rig: str) -> dict[str, str]:
    """A rig's name of each joint, an attached one's own; a UsageError for no such rig, or a body without its joints."""
    if rig not in RIGS:
        raise UsageError(f"--rig must be one of {list(RIGS)}, got {rig!r}")
    names, attached = RIGS[rig].names, body.skeleton.attached
    missing = sorted(set(names) ^ (set(body.skeleton.joints) - set(attached)))
    if missing:
        more = f" and {len(missing) - _MAX_NAMED} more" if len(missing) > _MAX_NAMED else ""
        listed = f"{missing[:_MAX_NAMED]}{more}"
        raise UsageError(f"--rig = {rig} is a person's, whose joints differ from this body's by {listed}")
    return names | {name: name for name in attached}


def rest_pose(body: BodyModel, rig: Rig) -> tuple[np.ndarray, np.ndarray]:
    """How joints are turned from the bind pose to the rig's rest pose, (joint, 3, 3) in body axes; and where they are.

    The second is (joint, 3).
    """
    skeleton, bind = body.skeleton, body.joint_rest.astype(float)
    turn, rest = np.tile(np.eye(3), (len(skeleton.joints), 1, 1)), bind.copy()
    for joint, (name, parent) in enumerate(zip(skeleton.joints, skeleton.parent, strict=True)):
        if parent < 0:
            continue
        rest[joint] = rest[parent] + turn[parent] @ (bind[joint] - bind[parent])
        if name not in rig.upright:
            turn[joint] = turn[parent]
        if name in rig.bones:
            end, direction = rig.bones[name]
            bone = bind[skeleton.index(end)] - bind[joint]
            turn[joint] = _smallest_rotation(turn[joint] @ bone, np.array(direction)) @ turn[joint]
    return turn, rest


def _smallest_rotation(vector: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """(3, 3) the smallest rotation that takes a vector to a direction, which is not the opposite one."""
    unit = vector / np.linalg.norm(vector)
    axis, cosine = np.cross(unit, direction), float(unit @ direction)
    across = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + across + across @ across / (1 + cosine)
