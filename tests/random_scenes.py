"""Random bodies in front of, around and behind random cameras."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import reference
import warp as wp
from drawn import draw_bits
from poisoned import poisoned, poisoned_joints
from synthetic import COORDINATES, ring_rig

from mmocap_warp.body.model import BodyModel, Subject
from mmocap_warp.body.posing import make_body_arrays
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.kernels.block import batch_of
from mmocap_warp.kernels.body.skinning import pose_vertices
from mmocap_warp.masks.observation import unpack_masks

_MIDDLE = np.array([0.0, 0.9, 0.0])  # of a standing person [m]
ODD_SIZES = ((97, 61), (64, 48), (33, 75), (129, 8), (31, 40))  # [px], hardly a multiple of a word or a packet


def random_poses(n: int, seed: int = 0, reach: float = 1.0, bend: float = 1.5) -> np.ndarray:
    """(n, 51) poses with the root within ``reach`` [m] of 0.9 m up, and angles within ``bend`` [rad]."""
    rng = np.random.default_rng(seed)
    poses = rng.uniform(-bend, bend, (n, COORDINATES))
    poses[:, :3] = rng.uniform(-reach, reach, (n, 3)) + _MIDDLE
    return poses


def indoor_rig(sizes: tuple[tuple[int, int], ...] = ODD_SIZES, seed: int = 0) -> CameraRig:
    """Cameras of different sizes up to 2 m from where people are, looking anywhere, some of them wide-angled."""
    rng = np.random.default_rng(seed)
    n = len(sizes)
    R = np.stack([reference.rotation(1, a) @ reference.rotation(0, b) for a, b in rng.uniform(-np.pi, np.pi, (n, 2))])
    centre = rng.uniform(-2.0, 2.0, (n, 3)) + _MIDDLE
    K = np.zeros((n, 3, 3))
    K[:, 0, 0], K[:, 1, 1], K[:, 2, 2] = np.array(sizes)[:, 0] * rng.uniform(0.5, 1.2, n), 70.0, 1.0
    K[:, :2, 2] = np.array(sizes) / 2 + rng.uniform(-9, 9, (n, 2))
    names = tuple(f"cam{k}" for k in range(n))
    return CameraRig(names, K, R, -np.einsum("kij,kj->ki", R, centre), np.array(sizes), np.zeros((n, 5)), "+y")


def any_rig(seed: int, inside: np.ndarray) -> CameraRig:
    """Six cameras of different sizes: one at ``inside`` (3,), four among people, one that sees them from outside."""
    rig = indoor_rig(seed=seed)
    t = rig.t.copy()
    t[0] = -rig.R[0] @ inside
    outside = ring_rig(cameras=1, size=(160, 120))
    joined = {
        name: np.concatenate([getattr(rig, name), getattr(outside, name)]) for name in ("K", "R", "size", "distortion")
    }
    return replace(rig, names=(*rig.names, "outside"), t=np.concatenate([t, outside.t]), **joined)


def random_masks(sizes: np.ndarray, seed: int = 0) -> list[np.ndarray]:
    """One boolean picture of noise a camera."""
    rng = np.random.default_rng(seed)
    return [rng.random((height, width)) < 0.5 for width, height in sizes]


def posed_vertices(body: BodyModel, root_base: np.ndarray, poses: np.ndarray, device: str) -> wp.array:
    """(candidate, tracking vertex) vec3 by the kernels [m]."""
    arrays = make_body_arrays(body, root_base, body.tracking, device)
    joints = poisoned_joints(len(poses), len(body.skeleton.parent), device)
    posed = poisoned((len(poses), len(body.tracking.rest)), wp.vec3, device)
    vertex = wp.array(np.arange(posed.shape[1]), dtype=wp.int32, device=device)
    batch = batch_of(0, len(poses), len(poses), device)
    pose_vertices(arrays, wp.array(poses, dtype=wp.float32, device=device), vertex, batch, joints, posed)
    return posed


def perfect_masks(subject: Subject, rig: CameraRig, pose: np.ndarray, device: str = "cpu") -> list[np.ndarray]:
    """One boolean picture a camera of a pose of the subject's body, as the kernels draw it."""
    posed = posed_vertices(subject.body, subject.root_base, np.atleast_2d(pose), device)
    return unpack_masks(draw_bits(subject.body.tracking, rig, posed)[0], rig.size)
