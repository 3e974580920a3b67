"""Pose a body: joint transforms and skinned vertices of poses.

Warp is imported by the first pose: it takes half a second, which most commands need not spend.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from mmocap_warp.body.model import BodyModel, SkinMesh, Subject

POSES_AT_ONCE = 4096  # poses whose joints are computed together; each takes 1.4 KB
_VERTICES_AT_ONCE = 1 << 20  # vertices that are posed together; they take 12 MB


def make_body_arrays(
    body: BodyModel, root_base: np.ndarray, mesh: SkinMesh, device: str, copies: int = 1, bases: int | None = None
) -> Any:
    """A body's joints and one of its meshes on a device, in the struct that kernels take.

    ``joint_rest`` and ``rest`` have a leading axis of ``copies``: 1, or a body for every candidate; ``root_base`` has
    one of ``bases``, or of copies if not given.
    Influences are sorted by falling weight, because the skinning kernel always adds the first and skips zeros.
    """
    from mmocap_warp.kernels.body.kinematics import Body
    from mmocap_warp.kernels.structs import allocated

    by_weight = np.argsort(-mesh.weight, axis=1, kind="stable")
    skeleton = body.skeleton
    return allocated(
        Body, device, parent=np.array(skeleton.parent), depth=skeleton.depth, slides=skeleton.slides,
        levels=int(skeleton.depth.max()) + 1, joint_frame=skeleton.frame, joint_rest=_repeat(body.joint_rest, copies),
        root_base=_repeat(root_base, copies if bases is None else bases), rest=_repeat(mesh.rest, copies),
        joint=np.take_along_axis(mesh.joint, by_weight, axis=1),
        weight=np.take_along_axis(mesh.weight, by_weight, axis=1),
    )  # fmt: skip


def make_joint_arrays(candidates: int, joints: int, device: str) -> Any:
    """Room for the joints of candidates, in the struct that kernels take."""
    from mmocap_warp.kernels.body.kinematics import Joints
    from mmocap_warp.kernels.structs import allocated

    return allocated(Joints, device, transform=(candidates, joints), skin_matrix=(candidates, joints))


def _repeat(values: np.ndarray, copies: int) -> np.ndarray:
    return np.repeat(np.asarray(values, np.float32)[None], copies, axis=0)


class Poser:
    """Poses a body; ``root_base`` (3, 3) is the world from body axes at zero root rotation."""

    def __init__(self, body: BodyModel, root_base: np.ndarray) -> None:
        self._full = make_body_arrays(body, root_base, body.skin, "cpu")
        self._tracking, self._coordinates = body.tracking_vertex, body.skeleton.coordinates

    def joint_transforms(self, pose: np.ndarray) -> np.ndarray:
        """World transforms of the joints for poses (n, coordinate): (n, joint, 4, 4) float32, for column vectors."""
        poses = np.atleast_2d(np.asarray(pose, np.float32))
        square = np.zeros((len(poses), len(self._full.parent), 4, 4), np.float32)
        for block in blocks(len(poses), POSES_AT_ONCE):
            square[block, :, :3] = self._pose(poses[block], np.zeros(0, np.int32))[0].transform.numpy()
        square[..., 3, 3] = 1.0
        return square

    def vertices(self, pose: np.ndarray) -> np.ndarray:
        """The full mesh's vertices in the world for poses (n, coordinate): (n, vertex, 3) float32 [m]."""
        return np.asarray(self._pose(pose, np.arange(self._full.rest.shape[1], dtype=np.int32))[1].numpy())

    def tracking_vertices(self, pose: np.ndarray) -> np.ndarray:
        """The tracking mesh's vertices in the world for poses (n, coordinate): (n, tracking vertex, 3) float32 [m]."""
        return self.vertices(pose)[:, self._tracking]

    def _pose(self, pose: np.ndarray, vertex: np.ndarray) -> tuple[Any, Any]:
        """The joints, and the full mesh's vertices, of which all or none are wanted."""
        import warp as wp

        from mmocap_warp.kernels.block import batch_of
        from mmocap_warp.kernels.body.skinning import pose_vertices

        poses = np.atleast_2d(np.asarray(pose, np.float32))
        if poses.shape[1] != self._coordinates:
            raise ValueError(f"pose must be (n, {self._coordinates}), got {poses.shape}")
        count = len(poses)
        joints = make_joint_arrays(count, len(self._full.parent), "cpu")
        posed = wp.empty((count, len(vertex)), dtype=wp.vec3, device="cpu")
        given, wanted = wp.array(poses, dtype=wp.float32, device="cpu"), wp.array(vertex, dtype=wp.int32, device="cpu")
        pose_vertices(self._full, given, wanted, batch_of(0, count, count, "cpu"), joints, posed)
        return joints, posed


def joint_positions(subject: Subject, pose: np.ndarray) -> np.ndarray:
    """Joint centres in the world for full poses (n, coordinate): (n, joint, 3) float64 [m]."""
    poser = Poser(subject.body, subject.root_base)
    centres = np.empty((len(pose), len(subject.body.joint_rest), 3))
    for block in blocks(len(pose), POSES_AT_ONCE):  # their transforms take three times as much
        centres[block] = poser.joint_transforms(pose[block])[:, :, :3, 3]
    return centres


def skin_positions(subject: Subject, pose: np.ndarray, vertex: np.ndarray) -> np.ndarray:
    """Some of the skin's vertices (m,) int in the world for full poses (n, coordinate): (n, m, 3) float32 [m]."""
    skin = subject.body.skin
    some = SkinMesh(skin.rest[vertex], skin.face[:0], skin.joint[vertex], skin.weight[vertex])
    poser = Poser(replace(subject.body, skin=some), subject.root_base)
    positions = np.empty((len(pose), len(vertex), 3), np.float32)
    for block in blocks(len(pose), max(_VERTICES_AT_ONCE // max(len(vertex), 1), 1)):
        positions[block] = poser.vertices(pose[block])
    return positions


def blocks(count: int, size: int) -> Iterator[slice]:
    """Slices of at most ``size`` that cover ``count`` things."""
    for start in range(0, count, size):
        yield slice(start, min(start + size, count))
