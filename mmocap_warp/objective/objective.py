"""The objective: full pose vectors to costs, on the device."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp

from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.posing import BodyArrays
from mmocap_warp.body.shape_space import ShapeSpace, upright_base
from mmocap_warp.kernels.body import shaping, skinning
from mmocap_warp.kernels.body.kinematics import Affine
from mmocap_warp.kernels.body.shaping import shape, turn
from mmocap_warp.kernels.body.skinning import pose_vertices
from mmocap_warp.kernels.silhouettes import cost as cost_kernels
from mmocap_warp.kernels.silhouettes.cost import cost_of_counts
from mmocap_warp.objective.silhouettes import FrozenArrays, Part, Silhouettes, SilhouetteSlice
from mmocap_warp.views.observation import Observation
from mmocap_warp.views.rig import CameraRig

COSTS: dict[str, int] = {"paper": cost_kernels.PAPER, "xor": cost_kernels.XOR, "iou": cost_kernels.IOU}
"""The named costs; ``paper`` is Eq. 4-5."""

_SMALLEST_SLICE = 4  # candidates; for fewer, starting a thread costs more than it saves


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
        self._first = body.skeleton.coordinates  # of the sliders

    def apply(self, coordinate: wp.array, rest: wp.array, joint_rest: wp.array, root_base: wp.array) -> None:
        """Write every candidate's rest vertices, joints and base from its coordinates."""
        shape(coordinate, self._first, self._rest, *self._vertex, rest)
        shape(coordinate, self._first, self._joint_rest, *self._joint, joint_rest)
        turn(coordinate, self._heading, self._upright, root_base)


@dataclass(frozen=True)
class _Slice:
    """The arrays of a row of candidates, as views."""

    pose: wp.array
    joint_rest: wp.array
    root_base: wp.array
    rest: wp.array
    joint_transform: wp.array
    skin_matrix: wp.array
    posed: wp.array
    drawn: SilhouetteSlice
    cost: wp.array


@dataclass(frozen=True)
class _Held:
    """A part of the body that moves, and the silhouettes of the rest."""

    moving: Part
    staying: Part
    frozen: FrozenArrays


class Objective:
    """Costs of candidate poses against one observation at a time.

    Write full poses to ``pose`` (candidate, coordinate), call ``evaluate``, read ``cost`` (candidate,) and ``count``
    (candidate, camera) of (|M|, |M and F|). ``prior`` (coordinate,) holds weights of a quadratic pull to zero, none at
    first. Every array is allocated here or by ``prepare``, once.

    Args:
        body: the body; its tracking mesh is rendered.
        root_base: (3, 3), see :class:`~mmocap_warp.body.model.Subject`.
        rig: undistorted cameras, at the masks' size.
        candidates: the most candidates in one evaluation.
        cost: a name in ``COSTS``.
        renderer: a name in ``renderers.RENDERERS``.
        shapes: for fitting: ``pose`` has further columns, from which every candidate's rest body and heading are read.
        bases: root bases in ``body.root_base``, of as many candidates each; with ``shapes`` every candidate has one.
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
        renderer: str = "raycast",
        shapes: ShapeSpace | None = None,
        bases: int = 1,
        device: str = "cpu",
        threads: int = 1,
    ) -> None:
        if cost not in COSTS:
            raise ValueError(f"cost must be one of {list(COSTS)}, got {cost!r}")
        self.device, self.candidates, self.rig = device, candidates, rig
        self._skeleton = body.skeleton
        self._kind = COSTS[cost]
        mesh = body.tracking
        vertices, joints = len(mesh.rest), len(body.joint_rest)
        copies, bases = (candidates, candidates) if shapes else (1, bases)
        self.body = BodyArrays(body, root_base, mesh, device, copies, bases)
        self._bases = bases
        self._silhouettes = Silhouettes(mesh, rig, candidates, renderer, device)
        self._foreground = wp.zeros(len(rig), dtype=wp.int32, device=device)
        coordinates = len(shapes) if shapes else body.skeleton.coordinates
        self._shapes = ShapeArrays(shapes, device) if shapes else None
        self.prior = wp.zeros(coordinates, dtype=wp.float32, device=device)

        self.pose = wp.zeros((candidates, coordinates), dtype=wp.float32, device=device)
        self.cost = wp.zeros(candidates, dtype=wp.float32, device=device)
        self.count = self._silhouettes.count
        self._joint_transform = wp.zeros((candidates, joints), dtype=Affine, device=device)
        self._skin_matrix = wp.zeros((candidates, joints), dtype=Affine, device=device)
        self._posed = wp.zeros((candidates, vertices), dtype=wp.vec3, device=device)
        self._threads = threads if device == "cpu" else 1
        modules = [skinning, *self._silhouettes.modules, cost_kernels, *([shaping] if shapes else [])]
        for module in modules:  # before threads launch from them at the same time
            wp.load_module(module, device=device)
        self._slices: dict[tuple[int, int], list[_Slice]] = {}
        self._parts: dict[tuple[int, bytes], _Held | None] = {}
        self._held: _Held | None = None

    @property
    def candidate_arrays(self) -> list[wp.array[Any]]:
        """Those whose first axis is the candidates; without shapes."""
        posed = [self.pose, self.cost, self._joint_transform, self._skin_matrix, self._posed]
        return posed + self._silhouettes.candidate_arrays

    def observe(self, observation: Observation) -> None:
        """Judge against these masks from now on.

        Raises:
            ValueError: masks of another shape than the rig's.
        """
        self._held = None  # its counts are those of the last masks
        observed = self._silhouettes.cameras.observed
        if observation.words.shape != observed.shape:
            raise ValueError(f"masks are packed as {observation.words.shape}, the rig needs {observed.shape}")
        observed.assign(observation.words)
        self._foreground.assign(observation.foreground.astype(np.int32))

    def prepare(self, runs: int, index: np.ndarray) -> None:
        """Allocate what :meth:`hold` needs for so many runs and these coordinates."""
        key = (runs, np.asarray(index).tobytes())
        if key not in self._parts:
            self._parts[key] = self._part(runs, index)

    def hold(self, base: wp.array, index: np.ndarray) -> None:
        """From now on candidates differ from their run's ``base`` (run, coordinate) in coordinates ``index`` alone.

        What these do not move is posed, drawn and counted once, here. It overwrites the first poses.
        """
        self.release()
        self.prepare(base.shape[0], index)
        held = self._parts[base.shape[0], np.asarray(index).tobytes()]
        if held is None:
            return
        wp.copy(self.pose, base, count=base.size)
        for own in self._slices_of(base.shape[0], threads=1):
            self._pose(own, held.staying, base.shape[0])
            self._silhouettes.freeze(own.drawn, own.posed, held.staying, held.frozen)
        self._held = held

    def release(self) -> None:
        """Candidates may differ in everything again."""
        self._held = None

    def evaluate(self, candidates: int) -> wp.array:
        """Fill ``count`` and ``cost`` for the first ``candidates`` poses, which divide evenly over bases and runs."""
        slices = self._slices_of(candidates, self._threads)
        if len(slices) == 1:
            self._evaluate(slices[0], candidates)
        else:
            list(self._pool.map(lambda own: self._evaluate(own, candidates), slices))
        return self.cost

    @cached_property
    def _pool(self) -> ThreadPoolExecutor:
        return ThreadPoolExecutor(self._threads)

    def _part(self, runs: int, index: np.ndarray) -> _Held | None:
        parts = None if self._shapes else self._silhouettes.split(self._skeleton, index)
        return None if parts is None else _Held(*parts, FrozenArrays(runs, self._silhouettes.cameras, self.device))

    def _slices_of(self, candidates: int, threads: int) -> list[_Slice]:
        """Candidates in one slice per thread: Warp runs a CPU launch on the calling thread and frees the others."""
        if not 0 < candidates <= self.candidates:
            raise ValueError(f"candidates must be in 1..{self.candidates}, got {candidates}")
        count = min(threads, max(1, candidates // _SMALLEST_SLICE))
        if (candidates, count) not in self._slices:
            bounds = np.linspace(0, candidates, count + 1).round().astype(int)
            self._slices[candidates, count] = [self._slice(int(a), int(b)) for a, b in pairwise(bounds)]
        return self._slices[candidates, count]

    def _slice(self, first: int, end: int) -> _Slice:
        bodies = slice(first, end) if self._shapes else slice(0, 1)
        base = self.body.root_base[bodies] if self._shapes else self.body.root_base
        return _Slice(
            self.pose[first:end],
            self.body.joint_rest[bodies],
            base,
            self.body.rest[bodies],
            self._joint_transform[first:end],
            self._skin_matrix[first:end],
            self._posed[first:end],
            self._silhouettes.slice(first, end),
            self.cost[first:end],
        )

    def _pose(self, own: _Slice, part: Part, candidates: int) -> None:
        """Pose a slice of so many candidates."""
        body = self.body
        first, share = own.drawn.first, max(candidates // self._bases, 1)
        if self._shapes:
            self._shapes.apply(own.pose, own.rest, own.joint_rest, own.root_base)
            first, share = 0, 1
        pose_vertices(
            own.pose, body.parent, body.depth, body.joint_frame, own.joint_rest, own.root_base, own.rest, body.joint,
            body.weight, part.vertex, body.levels, first, share, own.joint_transform, own.skin_matrix, own.posed,
        )  # fmt: skip

    def _evaluate(self, own: _Slice, candidates: int) -> None:
        held, drawing = self._held, self._silhouettes
        part = held.moving if held else drawing.whole
        particles = candidates // held.frozen.runs if held else 0
        self._pose(own, part, candidates)
        drawing.draw(own.drawn, own.posed, part, held.frozen if held else None, particles)
        size = drawing.cameras.size
        cost_of_counts(self._kind, own.drawn.count, self._foreground, size, own.pose, self.prior, own.cost)
