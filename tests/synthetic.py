"""A small made-up body and rig that tests share: quick to pose, and with no symmetry to hide behind."""

from __future__ import annotations

import copy
import itertools
from functools import cache

import numpy as np
from person_skeleton import JOINTS, PARENT, human_skeleton

from mmocap_warp.body.model import BodyModel, SkinMesh, Subject
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.result.result import Result

_DROOP = np.deg2rad(30.0)  # the arms are bound in an A-pose, so that joint frames matter


def _turn_z(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])


_LEFT_ARM, _RIGHT_ARM = _turn_z(-_DROOP), _turn_z(_DROOP)
_JOINT = {
    "Root": (0.0, 0.95, 0.0),
    "BottomSpine": (0.0, 1.06, -0.01),
    "UpperSpine": (0.0, 1.26, -0.02),
    "LShoulder": (0.18, 1.42, 0.0),
    "RShoulder": (-0.18, 1.42, 0.0),
    "Neck": (0.0, 1.48, 0.0),
    "LHip": (0.10, 0.90, 0.0),
    "LKnee": (0.11, 0.49, 0.02),
    "LAnkle": (0.11, 0.09, 0.0),
    "RHip": (-0.10, 0.90, 0.0),
    "RKnee": (-0.11, 0.49, 0.02),
    "RAnkle": (-0.11, 0.09, 0.0),
}
for _side, _sign, _frame in (("L", 1.0, _LEFT_ARM), ("R", -1.0, _RIGHT_ARM)):
    _elbow = np.array(_JOINT[f"{_side}Shoulder"]) + _frame @ (_sign * 0.28, 0.0, 0.0)
    _JOINT[f"{_side}Elbow"] = tuple(_elbow)
    _JOINT[f"{_side}Wrist"] = tuple(_elbow + _frame @ (_sign * 0.25, 0.0, 0.0))

# One box a bone: the joint that moves it, where it ends (a joint, or an offset in body axes), half width, half depth.
_BONES: tuple[tuple[str, str | tuple[float, float, float], float, float], ...] = (
    ("Root", "BottomSpine", 0.15, 0.10),
    ("BottomSpine", "UpperSpine", 0.14, 0.09),
    ("UpperSpine", "Neck", 0.17, 0.10),
    ("Neck", (0.0, 0.28, 0.02), 0.08, 0.09),
    *(
        bone
        for side, sign, frame in (("L", 1.0, _LEFT_ARM), ("R", -1.0, _RIGHT_ARM))
        for bone in (
            (f"{side}Shoulder", f"{side}Elbow", 0.045, 0.045),
            (f"{side}Elbow", f"{side}Wrist", 0.035, 0.035),
            (f"{side}Wrist", tuple(frame @ (sign * 0.16, 0.0, 0.0)), 0.04, 0.02),
            (f"{side}Hip", f"{side}Knee", 0.07, 0.08),
            (f"{side}Knee", f"{side}Ankle", 0.05, 0.05),
            (f"{side}Ankle", (0.0, -0.05, 0.18), 0.045, 0.04),
        )
    ),
    ("Root", (0.0, -0.08, 0.0), 0.15, 0.10),
)
_RINGS = 5  # rings of four vertices along a box; the tracking mesh keeps every other one
_MARKER_BONES = {"HEAD": 3, "CHEST": 2, "LWRI": 5, "RWRI": 11, "LANK": 8, "RANK": 14}


def synthetic_body() -> BodyModel:
    """A closed figure of boxes, 1.76 m tall, in an A-pose: 16 joints, 2 shape targets, 6 markers.

    Each box has its rings blended with the joints at its two ends, as real skin has.
    """
    return copy.deepcopy(_built_body())  # a test may change its own


@cache
def _built_body() -> BodyModel:
    joints = np.array([_JOINT[name] for name in JOINTS])
    rest, quads, triangles, influence, outward, kept = [], [], [], [], [], []
    for name, end, half_width, half_depth in _BONES:
        first, joint = len(rest), JOINTS.index(name)
        start = joints[joint]
        child = JOINTS.index(end) if isinstance(end, str) else joint
        stop = joints[child] if isinstance(end, str) else start + np.array(end)
        along = (stop - start) / np.linalg.norm(stop - start)
        side = np.array([0, 0, 1.0]) if abs(along[2]) < 0.5 else np.array([0, 1.0, 0])
        wide = np.cross(along, side) / np.linalg.norm(np.cross(along, side))
        deep = np.cross(wide, along)
        for ring in range(_RINGS):
            s = ring / (_RINGS - 1)
            for u, v in ((1, 1), (1, -1), (-1, -1), (-1, 1)):
                push = u * half_width * wide + v * half_depth * deep
                rest.append(start + s * (stop - start) + push)
                outward.append(push)
                influence.append(_blend(joint, child, s))
        quads += _box_faces(first, _RINGS, 1)
        for a, b, c, d in _box_faces(first, _RINGS, 2):
            triangles += [(a, b, c), (a, c, d)]
        kept += [first + 4 * ring + corner for ring in range(0, _RINGS, 2) for corner in range(4)]

    vertex = np.array(rest)
    slot = np.array([[i for i, _ in pairs] for pairs in influence], np.int32)
    weight = np.array([[w for _, w in pairs] for pairs in influence], np.float32)
    taller, taller_joints = np.zeros_like(vertex), np.zeros_like(joints)
    taller[:, 1], taller_joints[:, 1] = 0.1 * vertex[:, 1], 0.1 * joints[:, 1]
    frame = np.tile(np.eye(3), (len(JOINTS), 1, 1))
    for j, name in enumerate(JOINTS):
        if name[1:] in ("Shoulder", "Elbow", "Wrist"):
            frame[j] = _LEFT_ARM if name[0] == "L" else _RIGHT_ARM
    position = {v: i for i, v in enumerate(kept)}
    return BodyModel(
        name="Boxes",
        skeleton=human_skeleton(frame, np.tile([-2.5, 2.5], (len(JOINTS), 3, 1))),
        joint_rest=joints.astype(np.float32),
        skin=SkinMesh(vertex.astype(np.float32), np.array(quads, np.int32), slot, weight),
        tracking_vertex=np.array(kept, np.int32),
        tracking_face=np.array([[position[v] for v in face] for face in triangles], np.int32),
        shape_names=("height_incr", "weight_incr"),
        shape_vertex=np.stack([taller, 0.2 * np.array(outward)]).astype(np.float32),
        shape_joint=np.stack([taller_joints, np.zeros_like(joints)]).astype(np.float32),
        marker_names=tuple(_MARKER_BONES),
        marker_vertex=np.array([4 * _RINGS * bone + 4 * (_RINGS - 2) for bone in _MARKER_BONES.values()], np.int32),
        attribution="Made up for tests.",
    )


def _blend(joint: int, child: int, s: float) -> list[tuple[int, float]]:
    """Influences at ``s`` along a bone: shared with the parent at its start and with the child at its end."""
    pairs = [(joint, 1.0)]
    if s == 0.0 and PARENT[joint] >= 0:
        pairs = [(joint, 0.5), (PARENT[joint], 0.5)]
    elif s == 1.0 and child != joint:
        pairs = [(joint, 0.6), (child, 0.4)]
    return pairs + [(0, 0.0)] * (4 - len(pairs))


def _box_faces(first: int, rings: int, step: int) -> list[tuple[int, int, int, int]]:
    """Quads of a box of ``rings`` rings of four vertices, counter-clockwise from outside, using every ``step``-th."""
    used = range(0, rings, step)
    faces = [(first + 3, first + 2, first + 1, first)]
    for lower, upper in itertools.pairwise(used):
        a, b = first + 4 * lower, first + 4 * upper
        faces += [(a + i, a + (i + 1) % 4, b + (i + 1) % 4, b + i) for i in range(4)]
    last = first + 4 * used[-1]
    return [*faces, (last, last + 1, last + 2, last + 3)]


SKELETON = synthetic_body().skeleton
COORDINATES, NAMES, MODELS = SKELETON.coordinates, SKELETON.coordinate_names, tuple(SKELETON.models)


def upright(up: str) -> np.ndarray:
    """(3, 3) proper rotation from a +Y-up frame to a world whose up axis is ``up``."""
    axis = "xyz".index(up[1])
    turn = np.roll(np.eye(3), axis - 1, axis=0)  # cyclic: takes +Y to the wanted axis
    if up[0] == "-":
        turn = turn @ np.diag([-1.0, -1.0, 1.0])
    return turn


def synthetic_subject(up: str = "+y") -> Subject:
    """The body standing at the world's origin, facing a little to its left."""
    body = synthetic_body()
    base = upright(up) @ np.array([[0.8, 0, 0.6], [0, 1, 0], [-0.6, 0, 0.8]])
    pose = np.zeros(COORDINATES)
    pose[:3] = upright(up) @ body.joint_rest[0].astype(float)
    return Subject(body, base, pose, {"source": "tests", "height": 1.76, "seed": 3})


def synthetic_poses(frames: int, up: str = "+y", seed: int = 0) -> np.ndarray:
    """(frame, 51) a smooth made-up motion that starts at the subject's pose; amplitudes up to 0.5 rad, 0.2 m."""
    rng = np.random.default_rng(seed)
    time = np.linspace(0.0, 2.0, frames)[:, None]
    amplitude = np.concatenate([np.full(3, 0.2), np.full(COORDINATES - 3, 0.5)]) * rng.uniform(-1, 1, COORDINATES)
    return synthetic_subject(up).pose + amplitude * np.sin(rng.uniform(1, 3, COORDINATES) * time)


def ring_rig(cameras: int = 4, size: tuple[int, int] = (640, 480), distance: float = 4.0, up: str = "+y") -> CameraRig:
    """Cameras on a ring around the origin, 1.4 m up, looking at 0.9 m; no two have the same intrinsics."""
    width, height = size
    world = upright(up)
    K, R, t = [], [], []
    for k in range(cameras):
        angle = 2.0 * np.pi * k / cameras + 0.3
        eye = np.array([distance * np.sin(angle), 1.4, distance * np.cos(angle)])
        forward = np.array([0.0, 0.9, 0.0]) - eye
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0.0, 1.0, 0.0])
        right /= np.linalg.norm(right)
        turn = np.stack([right, np.cross(forward, right), forward])
        focal = width * (1.0 + 0.01 * k)
        centre = ((width - 1) / 2 + 3.0 * k, (height - 1) / 2 - 2.0 * k)
        K.append([[focal, 0, centre[0]], [0, focal * 0.995, centre[1]], [0, 0, 1]])
        R.append(turn @ world.T)
        t.append(-turn @ eye)
    return CameraRig(
        names=tuple(f"cam{k:02d}" for k in range(1, cameras + 1)),
        K=np.array(K, float),
        R=np.array(R, float),
        t=np.array(t, float),
        size=np.tile([width, height], (cameras, 1)),
        distortion=np.zeros((cameras, 5)),
        up=up,
    )


def synthetic_result(frames: int = 6, runs: int = 2, up: str = "+y", cameras: int = 3) -> Result:
    """A made-up answer: run 1 is the better one, the second frame is partial and the last one lost."""
    rng = np.random.default_rng(5)
    pose = np.stack([synthetic_poses(frames, up, seed=run) for run in range(runs)])
    cost = 0.2 + 0.01 * rng.random((runs, frames)) - 0.1 * (np.arange(runs) == 1)[:, None]
    iou = 0.8 + 0.1 * rng.random((runs, frames, cameras))
    status = np.zeros((runs, frames), np.int8)
    if frames > 2:
        iou[:, 1, 0] = iou[:, -1] = cost[:, -1] = np.nan
        status[:, [1, -1]] = 1, 2
    return Result(
        subject=synthetic_subject(up),
        cameras=ring_rig(cameras, size=(320, 240), up=up),
        fps=59.94,
        frame_numbers=np.arange(10, 10 + frames),
        pose=pose,
        cost=cost,
        iou=iou,
        evaluations=np.full((runs, frames), 499),
        status=status,
        seconds=1.5,
        config={"algorithm": "h-cmaes", "seed": 7, "rotation_radius": 0.03, "threads": None},
        versions={"mmocap-warp": "0.1.0", "device": "cpu"},
    )
