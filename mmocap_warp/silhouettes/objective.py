"""The objective: full pose vectors to costs, on the device."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.posing import make_body_arrays, make_joint_arrays
from mmocap_warp.body.shape_space import ShapeSpace, upright_base
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.device.shared_work import SharedWork
from mmocap_warp.device.transfers import Download, Replays, Upload
from mmocap_warp.kernels.block import Batch
from mmocap_warp.kernels.body import shaping, skinning
from mmocap_warp.kernels.body.shaping import Sliders, shape, turn
from mmocap_warp.kernels.body.skinning import pose_vertices
from mmocap_warp.kernels.silhouettes import cost as cost_kernels
from mmocap_warp.kernels.silhouettes.cost import cost_of_counts
from mmocap_warp.kernels.silhouettes.raster import Outline
from mmocap_warp.kernels.structs import allocated
from mmocap_warp.masks.observation import Observation
from mmocap_warp.silhouettes.silhouettes import Silhouettes

_SMALLEST_BATCH = 4  # candidates of a batch: for fewer, starting a thread costs more than it saves


class ShapeArrays:
    """A shape space as Warp arrays."""

    def __init__(self, space: ShapeSpace, device: str) -> None:
        body = space.body

        def sliders(points: np.ndarray, targets: np.ndarray) -> Any:
            increase, decrease = space.displacements(targets)
            first = body.skeleton.coordinates
            return allocated(Sliders, device, first=first, base=points, increase=increase, decrease=decrease)

        self._vertices = sliders(body.tracking.rest, body.shape_vertex[:, body.tracking_vertex])
        self._joints = sliders(body.joint_rest, body.shape_joint)
        self._upright = wp.mat33(upright_base(space.up).astype(np.float32))
        self._heading = space.heading_index

    def apply(self, coordinate: wp.array[wp.float32], batch: Batch, body: Any) -> None:
        """Write the rest vertices, joints and base of a batch's candidates from their coordinates."""
        shape(self._vertices, coordinate, batch, body.rest)
        shape(self._joints, coordinate, batch, body.joint_rest)
        turn(coordinate, self._heading, self._upright, batch, body.root_base)


@dataclass(frozen=True)
class _Split:
    """The piece of the mesh that moves while others rest, and the silhouettes of these."""

    moving: Any
    resting: Outline
    frozen: Any


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
        renderer: a name in ``RENDERERS``.
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
        self.device, self.candidates, self.rig = device, candidates, rig
        self._skeleton = body.skeleton
        self._kind: int = getattr(cost_kernels, cost.upper())
        mesh = body.tracking
        copies, bases = (candidates, candidates) if shapes else (1, bases)
        self.body = make_body_arrays(body, root_base, mesh, device, copies, bases)
        self._silhouettes = Silhouettes(mesh, rig, candidates, renderer, device)
        views = self._silhouettes.views
        self._observed, self._foreground = Upload(views.observed), Upload(views.foreground)
        coordinates = len(shapes) if shapes else body.skeleton.coordinates
        self._shapes = ShapeArrays(shapes, device) if shapes else None
        self.prior = wp.zeros(coordinates, dtype=wp.float32, device=device)
        self.pose = wp.zeros((candidates, coordinates), dtype=wp.float32, device=device)
        self.cost = wp.zeros(candidates, dtype=wp.float32, device=device)
        self.count = self._silhouettes.canvas.count
        self._joints = make_joint_arrays(candidates, len(body.joint_rest), device)
        self._posed = wp.zeros((candidates, len(mesh.rest)), dtype=wp.vec3, device=device)
        self._tried, self._judged, self._replays = Upload(self.pose), Download([self.cost, self.count]), Replays(device)
        self._work = SharedWork(device, threads, _SMALLEST_BATCH)
        modules = [skinning, *self._silhouettes.modules, cost_kernels, *([shaping] if shapes else [])]
        for module in modules:  # before threads launch from them at the same time
            wp.load_module(module, device=device)
        self._splits: dict[tuple[int, bytes], _Split | None] = {}
        self._split: _Split | None = None  # while coordinates are held

    def observe(self, observation: Observation) -> None:
        """Judge against these masks from now on; a ValueError if they have another shape than the rig's."""
        self._split = None  # its counts are those of the last masks
        views = self._silhouettes.views
        if observation.words.shape != views.observed.shape:
            raise ValueError(f"masks are packed as {observation.words.shape}, the rig needs {views.observed.shape}")
        self._observed.values[...], self._foreground.values[...] = observation.words, observation.foreground
        self._replays.run("observe", self._send_masks)
        self._observed.sent()
        self._foreground.sent()
        if observation.hidden is not None or views.hidden.size:
            if not views.hidden.size:
                views.hidden = wp.zeros_like(views.observed)
                self._hidden = Upload(views.hidden)
            self._hidden.values[...] = 0 if observation.hidden is None else observation.hidden
            self._hidden.send(len(self.rig))

    def _send_masks(self) -> None:
        self._observed.send(len(self.rig))
        self._foreground.send(len(self.rig))

    @property
    def addresses(self) -> tuple[int | None, ...]:
        """Of arrays that are made anew when more room is needed: a graph holds them."""
        return (self._silhouettes.views.hidden.ptr,)

    def prepare(self, runs: int, index: np.ndarray) -> None:
        """Allocate what :meth:`hold` needs for so many runs and these coordinates."""
        self._split_at(runs, index)

    def hold(self, base: wp.array[wp.float32], index: np.ndarray) -> None:
        """From now on candidates differ from their run's ``base`` (run, coordinate) in coordinates ``index`` alone.

        The piece of the mesh that rests is posed, drawn and counted once, here. It overwrites the first poses.
        """
        self.release()
        runs = base.shape[0]
        split = self._split_at(runs, index)
        if split is None:
            return
        self._check_room(runs)
        wp.copy(self.pose, base, count=base.size)
        for batch in self._work.batches(runs, threads=1):
            self._pose(split.resting.vertex, batch)
            self._silhouettes.freeze(self._posed, split.resting, batch, split.frozen)
        self._split = split

    def release(self) -> None:
        """Candidates may differ in everything again."""
        self._split = None

    def evaluate(self, candidates: int) -> wp.array[wp.float32]:
        """Fill ``count`` and ``cost`` for the first ``candidates`` poses, which divide evenly over bases and runs."""
        self._check_room(candidates)
        self._work.run(self._evaluate, candidates)
        return self.cost

    def costs(self, poses: np.ndarray) -> np.ndarray:
        """Costs (n,) float32 of poses (n, coordinate) from the host; ``count`` then has their pixels."""
        return self.judged(poses)[0]

    def judged(self, poses: np.ndarray, moving: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Costs, and ``count`` (n, camera, 2); quicker for poses that differ in the ``moving`` coordinates alone."""
        total = len(poses)
        self._check_room(total)
        self._tried.values[:total] = poses
        if moving is not None:
            self._tried.send(1)
            self.hold(self.pose[:1], moving)
        self._replays.run((total, id(self._split), *self.addresses), lambda: self._launch(total))
        cost, count = self._judged.read(total)
        if moving is not None:
            self.release()
        return cost, count

    def _launch(self, candidates: int) -> None:
        self._tried.send(candidates)
        self.evaluate(candidates)
        self._judged.fetch(candidates)

    def _check_room(self, candidates: int) -> None:
        if not 0 < candidates <= self.candidates:
            raise ValueError(f"candidates must be in 1..{self.candidates}, got {candidates}")

    def _split_at(self, runs: int, index: np.ndarray) -> _Split | None:
        """Made once for so many runs and these coordinates; None where nothing rests, or nothing moves."""
        key = (runs, np.asarray(index).tobytes())
        if key not in self._splits:
            pieces = None if self._shapes else self._silhouettes.split(self._skeleton, index)
            self._splits[key] = None if pieces is None else _Split(*pieces, self._silhouettes.make_frozen(runs))
        return self._splits[key]

    def _pose(self, vertex: wp.array[wp.int32], batch: Batch) -> None:
        """Pose the joints of a batch's candidates, and these vertices."""
        if self._shapes:
            self._shapes.apply(self.pose, batch, self.body)
        pose_vertices(self.body, self.pose, vertex, batch, self._joints, self._posed)

    def _evaluate(self, batch: Batch) -> None:
        silhouettes, split = self._silhouettes, self._split
        piece = split.moving if split else silhouettes.whole
        self._pose(piece.vertex, batch)
        silhouettes.draw(self._posed, piece, batch, split.frozen if split else None)
        cost_of_counts(self._kind, silhouettes.views, self.count, self.pose, self.prior, batch, self.cost)
