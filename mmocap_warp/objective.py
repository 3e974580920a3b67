"""The objective: full pose vectors to costs, on the device."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import warp as wp

from mmocap_warp.body import FULL_DOF, BodyModel
from mmocap_warp.bvh import build_bvh
from mmocap_warp.cameras import CameraRig
from mmocap_warp.kernels import cost as cost_kernels
from mmocap_warp.kernels import kinematics, projection, raycast, shaping, skinning
from mmocap_warp.kernels.cost import cost_of_counts
from mmocap_warp.kernels.kinematics import Affine, pose_joints
from mmocap_warp.kernels.projection import project
from mmocap_warp.kernels.raycast import cast, refit
from mmocap_warp.kernels.shaping import shape, turn
from mmocap_warp.kernels.skinning import skin
from mmocap_warp.observation import Observation, words_per_row
from mmocap_warp.posing import BodyArrays
from mmocap_warp.shape_space import ShapeSpace, upright_base

COSTS: dict[str, int] = {"paper": cost_kernels.PAPER, "xor": cost_kernels.XOR, "iou": cost_kernels.IOU}
"""The named costs; ``paper`` is Eq. 4-5."""

_SMALLEST_SLICE = 4  # candidates; for fewer, starting a thread costs more than it saves
_MODULES = (shaping, kinematics, skinning, projection, raycast, cost_kernels)


class CameraArrays:
    """A rig as Warp arrays."""

    def __init__(self, rig: CameraRig, device: str) -> None:
        lens = np.stack([rig.K[:, 0, 0], rig.K[:, 1, 1], rig.K[:, 0, 2], rig.K[:, 1, 2]], axis=1)
        self.rotation = wp.array(rig.R, dtype=wp.mat33, device=device)
        self.translation = wp.array(rig.t, dtype=wp.vec3, device=device)
        self.intrinsics = wp.array(lens, dtype=wp.vec4, device=device)
        self.size = wp.array(rig.size.astype(np.int32), dtype=wp.vec2i, device=device)


class ShapeArrays:
    """A shape space as Warp arrays."""

    def __init__(self, space: ShapeSpace, device: str) -> None:
        body = space.body
        self._rest = wp.array(body.tracking.rest, dtype=wp.vec3, device=device)
        self._joint_rest = wp.array(body.joint_rest, dtype=wp.vec3, device=device)
        vertex = space.displacements(body.shape_vertex[:, body.tracking_vertex])
        joint = space.displacements(body.shape_joint)
        self._vertex = [wp.array(side, dtype=wp.vec3, device=device) for side in vertex]
        self._joint = [wp.array(side, dtype=wp.vec3, device=device) for side in joint]
        self._upright = wp.mat33(upright_base(space.up).astype(np.float32))
        self._heading = space.heading_index

    def apply(self, coordinate: wp.array, rest: wp.array, joint_rest: wp.array, root_base: wp.array) -> None:
        """Write every candidate's rest vertices, joints and base from its coordinates."""
        shape(coordinate, FULL_DOF, self._rest, *self._vertex, rest)
        shape(coordinate, FULL_DOF, self._joint_rest, *self._joint, joint_rest)
        turn(coordinate, self._heading, self._upright, root_base)


@dataclass(frozen=True)
class _Slice:
    """The arrays of a run of candidates, as views."""

    pose: wp.array
    joint_rest: wp.array
    root_base: wp.array
    rest: wp.array
    joint_transform: wp.array
    skin_matrix: wp.array
    posed: wp.array
    image: wp.array
    box: wp.array
    count: wp.array
    cost: wp.array


class Objective:
    """Costs of candidate poses against one observation at a time.

    Write full poses to ``pose`` (candidate, 51), call ``evaluate``, read ``cost`` (candidate,) and ``count``
    (candidate, camera) of (|M|, |M and F|). ``prior`` (coordinate,) holds weights of a quadratic pull to zero, none at
    first. Every array is allocated here, once.

    Args:
        body: the body; its tracking mesh is rendered.
        root_base: (3, 3), see :class:`~mmocap_warp.body.Subject`.
        rig: undistorted cameras, at the masks' size.
        candidates: the most candidates in one evaluation.
        cost: a name in ``COSTS``.
        shapes: read a rest body and a heading for every candidate from columns 51 on of ``pose``; for fitting.
        device: a Warp device.
        threads: CPU threads; ignored on a GPU.
    """

    def __init__(
        self,
        body: BodyModel,
        root_base: np.ndarray,
        rig: CameraRig,
        candidates: int,
        *,
        cost: str = "paper",
        shapes: ShapeSpace | None = None,
        device: str = "cpu",
        threads: int = 1,
    ) -> None:
        if cost not in COSTS:
            raise ValueError(f"cost must be one of {list(COSTS)}, got {cost!r}")
        self.device, self.candidates, self.rig = device, candidates, rig
        self._kind = COSTS[cost]
        mesh = body.tracking
        cameras, vertices, joints = len(rig), len(mesh.rest), len(body.joint_rest)
        self.body = BodyArrays(body, root_base, mesh, device, copies=candidates if shapes else 1)
        self._cameras = CameraArrays(rig, device)
        bvh = build_bvh(mesh.rest, mesh.face)
        self._node = wp.array(bvh.node, dtype=wp.vec4i, device=device)
        self._levels = [wp.array(level, dtype=wp.int32, device=device) for level in bvh.levels]
        self._triangle = wp.array(bvh.triangle, dtype=wp.vec3i, device=device)
        rows, words = int(rig.size[:, 1].max()), words_per_row(int(rig.size[:, 0].max()))
        self._observed = wp.zeros((cameras, rows, words), dtype=wp.uint32, device=device)
        self._foreground = wp.zeros(cameras, dtype=wp.int32, device=device)
        coordinates = len(shapes) if shapes else FULL_DOF
        self._shapes = ShapeArrays(shapes, device) if shapes else None
        self.prior = wp.zeros(coordinates, dtype=wp.float32, device=device)

        self.pose = wp.zeros((candidates, coordinates), dtype=wp.float32, device=device)
        self.cost = wp.zeros(candidates, dtype=wp.float32, device=device)
        self.count = wp.zeros((candidates, cameras), dtype=wp.vec2i, device=device)
        self._joint_transform = wp.zeros((candidates, joints), dtype=Affine, device=device)
        self._skin_matrix = wp.zeros((candidates, joints), dtype=Affine, device=device)
        self._posed = wp.zeros((candidates, vertices), dtype=wp.vec3, device=device)
        self._image = wp.zeros((candidates, cameras, vertices), dtype=wp.vec2i, device=device)
        self._box = wp.zeros((candidates, cameras, len(bvh.node)), dtype=wp.vec4i, device=device)
        self._threads = threads if device == "cpu" else 1
        for module in _MODULES:  # before threads launch from them at the same time
            wp.load_module(module, device=device)
        self._slices: dict[int, list[_Slice]] = {}

    def observe(self, observation: Observation) -> None:
        """Judge against these masks from now on.

        Raises:
            ValueError: masks of another shape than the rig's.
        """
        if observation.words.shape != self._observed.shape:
            raise ValueError(f"masks are packed as {observation.words.shape}, the rig needs {self._observed.shape}")
        self._observed.assign(observation.words)
        self._foreground.assign(observation.foreground.astype(np.int32))

    def evaluate(self, candidates: int) -> wp.array:
        """Fill ``count`` and ``cost`` for the first ``candidates`` poses."""
        if candidates not in self._slices:
            self._slices[candidates] = self._split(candidates)
        slices = self._slices[candidates]
        if len(slices) == 1:
            self._evaluate(slices[0])
        else:
            list(self._pool.map(self._evaluate, slices))
        return self.cost

    @cached_property
    def _pool(self) -> ThreadPoolExecutor:
        return ThreadPoolExecutor(self._threads)

    def _split(self, candidates: int) -> list[_Slice]:
        """Candidates in one slice per thread: Warp runs a CPU launch on the calling thread and frees the others."""
        if not 0 < candidates <= self.candidates:
            raise ValueError(f"candidates must be in 1..{self.candidates}, got {candidates}")
        slices = min(self._threads, max(1, candidates // _SMALLEST_SLICE))
        bounds = np.linspace(0, candidates, slices + 1).round().astype(int)
        return [self._slice(int(a), int(b)) for a, b in pairwise(bounds)]

    def _slice(self, first: int, end: int) -> _Slice:
        body = self.body
        bodies = slice(first, end) if len(body.root_base) > 1 else slice(0, 1)
        return _Slice(
            self.pose[first:end],
            body.joint_rest[bodies],
            body.root_base[bodies],
            body.rest[bodies],
            self._joint_transform[first:end],
            self._skin_matrix[first:end],
            self._posed[first:end],
            self._image[first:end],
            self._box[first:end],
            self.count[first:end],
            self.cost[first:end],
        )

    def _evaluate(self, s: _Slice) -> None:
        body, cameras = self.body, self._cameras
        if self._shapes:
            self._shapes.apply(s.pose, s.rest, s.joint_rest, s.root_base)
        pose_joints(s.pose, body.parent, body.joint_frame, s.joint_rest, s.root_base, s.joint_transform, s.skin_matrix)
        skin(s.rest, body.joint, body.weight, s.skin_matrix, s.posed)
        project(s.posed, cameras.rotation, cameras.translation, cameras.intrinsics, s.image)
        refit(self._node, self._levels, self._triangle, s.image, s.box)
        cast(self._node, self._triangle, s.image, s.box, cameras.size, self._observed, s.count)
        cost_of_counts(self._kind, s.count, self._foreground, cameras.size, s.pose, self.prior, s.cost)
