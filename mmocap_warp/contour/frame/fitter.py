"""Fits poses to masks by their outlines: residuals, normal equations and damped steps, on the device."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any, Self

import numpy as np
import warp as wp

from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.posing import make_body_arrays, make_joint_arrays
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.contour.frame.fields import DistanceFields
from mmocap_warp.contour.frame.fitter_arrays import make_descent, make_edges, make_outline, make_tree
from mmocap_warp.contour.frame.normal_equations import NormalEquations, ViewEquations
from mmocap_warp.contour.frame.rooted import Neighbours, RootedPoses
from mmocap_warp.device.shared_work import SharedWork
from mmocap_warp.device.transfers import Download, Replays, Upload
from mmocap_warp.kernels.block import Batch
from mmocap_warp.kernels.body import skinning
from mmocap_warp.kernels.body.skinning import pose_vertices
from mmocap_warp.kernels.contour import descent as descent_kernels
from mmocap_warp.kernels.contour import jacobian, moving, normal_equations, outline, residuals
from mmocap_warp.kernels.contour.descent import MOST_SEARCHED, descend, pass_over
from mmocap_warp.kernels.contour.jacobian import OWN, Posed, RestChange, Rows, differentiate, move_origins, turn_axes
from mmocap_warp.kernels.contour.moving import Moving, bend_skin, follow_skin
from mmocap_warp.kernels.contour.normal_equations import Sums, sum_normal_equations, sum_tallies, triangle_words
from mmocap_warp.kernels.contour.outline import find_contours
from mmocap_warp.kernels.contour.residuals import Matching, Residuals, find_residuals
from mmocap_warp.kernels.launching import Recordings
from mmocap_warp.kernels.structs import allocated, filled
from mmocap_warp.masks.observation import Observation, lens_values, make_views


@dataclass(frozen=True)
class MatchingConfig:
    """How an outline is compared with the masks' contours; lengths are at a body as large as a person."""

    reach: float = 0.090  # how far along its normal a contour is looked for [m]
    huber: float = 0.012  # residuals above count linearly [m]
    sigma: float = 0.012  # standard deviation of a residual [m]
    apart: float = 4.0  # outline that errs as one [px]
    deep: float = 0.04  # outline that is farther outside of the mask is counted as exposed [m]


WIDE = MatchingConfig(reach=0.2, huber=0.03, sigma=0.03)  # for what is still far from the masks

_FIRST_DAMPING = 1.0e-3


class ContourFitter:
    """Outlines of posed bodies against the contours of masks.

    Args:
        body: the body; its tracking mesh must be closed.
        rig: undistorted cameras, at the masks' size.
        index: (dof,) searched coordinates of a pose.
        limits: (coordinate, 2) lowest and highest value of every coordinate; infinite where free.
        candidates: poses at a time.
        frames: places for frames' masks.
        like: another fitter whose places and masks are taken instead.
        parameters: of the rest body, at most; see :meth:`reshape`.
        lens: whether :meth:`linearise_views` has columns for a view's lens and the size of its masks.
        matching: settings.
        device: a Warp device.
        threads: CPU threads; ignored on a GPU.
    """

    def __init__(
        self,
        body: BodyModel,
        rig: CameraRig,
        index: np.ndarray,
        limits: np.ndarray,
        *,
        candidates: int,
        frames: int = 1,
        like: Self | None = None,
        parameters: int = 0,
        lens: bool = False,
        matching: MatchingConfig | None = None,
        device: str = "cpu",
        threads: int = 1,
    ) -> None:
        if len(index) > MOST_SEARCHED:
            raise ValueError(f"index must have at most {MOST_SEARCHED} coordinates, got {len(index)}")
        mesh, skeleton = body.tracking, body.skeleton
        vertices, joints, cameras = len(mesh.rest), len(skeleton.joints), len(rig)
        view = (candidates, cameras)
        self.index, self.candidates = np.asarray(index), candidates
        self._device, self._work = device, SharedWork(device, threads)

        # The body, posed, and how its rest changes with parameters: at first not at all.
        self.body = make_body_arrays(body, np.eye(3), mesh, device, bases=candidates)
        self._joints = make_joint_arrays(candidates, joints, device)
        self._vertex = wp.array(np.arange(vertices), dtype=wp.int32, device=device)
        posed = {"axes": self._joints.transform.shape, "vertex": (candidates, vertices)}
        self._posed = allocated(Posed, device, body=self.body, joints=self._joints, **posed)
        self._tree = make_tree(skeleton, self.index, device)
        origin = candidates if parameters else 0, parameters, joints
        changed = {"vertex": (parameters, vertices), "joint": (parameters, joints), "origin": origin}
        self._change = allocated(RestChange, device, **changed)

        # The masks of frames, the cameras, and how the body moves in the time by which a view is late. Each candidate's
        # frame, and which of its neighbours there are, is of this fitter alone.
        self.fields: DistanceFields = like.fields if like else DistanceFields(rig, frames, device)
        self._place, self._sides = (wp.zeros(candidates, dtype=wp.int32, device=device) for _ in range(2))
        self._late: np.ndarray = like._late if like else np.zeros((frames, cameras), np.float32)
        self._views = make_views(rig, device)
        skin = dict.fromkeys(("velocity", "bend"), (candidates, vertices))
        late = like._moving.late if like else self._late
        self._moving: Any = allocated(Moving, device, late=late, frame=self._place, own=0.0, **skin)

        # From outlines to residuals, rows of the Jacobian, and their sums.
        settings = asdict(matching or MatchingConfig())
        lengths = {name: body.relative_size * settings[name] for name in ("reach", "huber", "sigma", "deep")}
        self._matching = filled(Matching, **settings | lengths)
        self._edges = make_edges(mesh.face, device)
        self._outline = make_outline(view, mesh, len(self._edges.edge), device)
        edge = (*view, self._outline.size)
        self._residuals = allocated(Residuals, device, normal=edge, weighted=edge, tally=edge)
        columns = OWN if lens else 0
        self._width = width = len(self.index) + parameters + columns + 1
        self._row_and_column = np.tril_indices(width)
        self._rows = allocated(Rows, device, value=math.prod(edge) * width, width=width, own=columns)
        self._sums = allocated(Sums, device, triangle=math.prod(view) * triangle_words(width), tally=view)
        self.descent = make_descent(self.index, skeleton.is_length[self.index], limits, view, width, device)
        for module in (skinning, moving, outline, residuals, jacobian, normal_equations, descent_kernels):
            wp.load_module(module, device=device)  # before threads launch from them at the same time
        self._starts = [Upload(array) for array in (self.descent.pose, self.body.root_base, self._place)]
        self._replays, self._recordings = Replays(device), Recordings()
        self._answers = Download([self.descent.best, self.descent.tally])
        self._summed_up = Download([self._sums.triangle.reshape((*view, triangle_words(width))), self._sums.tally])

    def observe(self, place: int, observation: Observation) -> None:
        """Put a frame's masks into one of the places for frames."""
        self.observe_all([observation], place)

    def observe_all(self, observations: Sequence[Observation], first: int = 0) -> None:
        """Put frames' masks into as many places, from ``first`` on."""
        self.fields.observe(observations, first)
        places = slice(first, first + len(observations))
        on_time = np.zeros(self._late.shape[1])
        late = np.array([on_time if each.late is None else each.late for each in observations], np.float32)
        if late.any() or self._late[places].any():
            self._late[places] = late
            self._moving.late.assign(self._late)

    @property
    def late(self) -> bool:
        """Whether a view of the frames observed was taken at another time than its frame."""
        return bool(self._late.any())

    @property
    def follows(self) -> float:
        """Frames a second at which a body is followed; 0 where its motion is that of a clip."""
        return float(self._moving.own)

    def follow(self, pose: np.ndarray, base: np.ndarray, rate: float) -> None:
        """For late views, let the body move from poses (n, coordinate) to those that are tried a frame later.

        Poses and bases (n, 3, 3) are the first candidates'; ``rate`` is negative where frames are followed backwards.
        """
        self._moving.own = rate
        self.start_at(pose, base, np.zeros(len(pose), int))
        self._work.run(lambda batch: self._follow(batch, rate), len(pose))

    def _follow(self, batch: Batch, rate: float) -> None:
        self._skin(batch)
        follow_skin(self._posed.vertex, rate, batch, self._moving)

    def move(self, rooted: RootedPoses, neighbours: Neighbours) -> None:
        """For late views, let the body move through the first candidates' poses as their neighbours say."""
        self._moving.own, count = 0.0, len(rooted)
        for poses, skin in ((neighbours.before, self._moving.velocity), (neighbours.after, self._moving.bend)):
            self.start_at(poses.pose, poses.base, np.zeros(count, int))
            self._work.run(self._skin, count)
            wp.copy(skin, self._posed.vertex, count=count * self._posed.vertex.shape[1])
        self._sides.assign(np.resize(neighbours.sides, self.candidates).astype(np.int32))
        self.start_at(rooted.pose, rooted.base, np.zeros(count, int))
        self._work.run(lambda batch: self._bend(batch, neighbours), count)

    def _bend(self, batch: Batch, neighbours: Neighbours) -> None:
        self._skin(batch)
        bend_skin(self._posed.vertex, self._sides, neighbours.rate, neighbours.curved, batch, self._moving)

    def _skin(self, batch: Batch) -> None:
        """From the poses of a batch's candidates to their skin."""
        pose_vertices(self.body, self.descent.pose, self._vertex, batch, self._joints, self._posed.vertex)

    def reshape(self, rest: np.ndarray, joint_rest: np.ndarray) -> None:
        """Take another rest body: (vertex, 3) of the tracking mesh and (joint, 3) [m]."""
        self.body.rest.assign(np.asarray(rest, np.float32)[None])
        self.body.joint_rest.assign(np.asarray(joint_rest, np.float32)[None])

    def set_change(self, vertex: np.ndarray, joint: np.ndarray) -> None:
        """Set how rest (parameter, vertex, 3) and joints (parameter, joint, 3) change with each parameter [m]."""
        self._change.vertex.assign(vertex.astype(np.float32))
        self._change.joint.assign(joint.astype(np.float32))

    def set_cameras(self, rig: CameraRig) -> None:
        """Take other cameras, of the same sizes."""
        self._views.rotation.assign(rig.R)
        self._views.translation.assign(rig.t)
        self._views.lens.assign(lens_values(rig))

    def set_larger(self, larger: np.ndarray) -> None:
        """Set by how much each camera's masks reach beyond what they show (camera,) [px]; at first by nothing."""
        self.fields.struct.larger.assign(larger.astype(np.float32))

    def linearise(self, place: np.ndarray, poses: RootedPoses, neighbours: Neighbours | None = None) -> NormalEquations:
        """The normal equations of poses against the frames in places (pose,); there may be more than ``candidates``.

        Late views see where the ``neighbours`` lead; without these, the body stands still for them.
        """
        parts = [self._read_sums(count) for _, count in self._in_parts(place, poses, neighbours)]
        return NormalEquations(*(np.concatenate(column) for column in zip(*parts, strict=True)))

    def linearise_views(
        self, place: np.ndarray, rooted: RootedPoses, neighbours: Neighbours | None = None
    ) -> ViewEquations:
        """As :meth:`linearise`, each view apart, and with the view's own columns behind the body's parameters."""
        parts = [self._read_views(count) for _, count in self._in_parts(place, rooted, neighbours)]
        return ViewEquations(*(np.concatenate(column) for column in zip(*parts, strict=True)))

    def _in_parts(
        self, place: np.ndarray, rooted: RootedPoses, neighbours: Neighbours | None, steps: int | None = None
    ) -> Iterator[tuple[slice, int]]:
        """Sum up poses, or take ``steps`` from them, as many at a time as there is room for; gives which, how many."""
        for first in range(0, max(len(rooted), 1), self.candidates):
            part = slice(first, min(first + self.candidates, len(rooted)))
            if neighbours and self.late:
                self.move(rooted[part], neighbours[part])
            count = self.set_starts(rooted.pose[part], rooted.base[part], place[part])
            work = partial(self._sum_up, count) if steps is None else partial(self._answer, count, steps)
            self._replays.run(("part", count, steps, *self._baked), work)
            yield part, count

    def _sum_up(self, count: int) -> None:
        """Sum up the first candidates' poses, and have the sums on their way to the host."""
        self.send_starts(count)
        self._work.run(lambda batch: self._again(batch, 0, self._sum), count)
        self._summed_up.fetch(count)

    def start_at(self, pose: np.ndarray, base: np.ndarray, place: np.ndarray) -> None:
        """Set the first candidates' poses (n, coordinate), root bases (n, 3, 3), and the places of their frames."""
        self.send_starts(self.set_starts(pose, base, place))

    def set_starts(self, pose: np.ndarray, base: np.ndarray, place: np.ndarray) -> int:
        """As :meth:`start_at` on the host alone: they are still to be sent. Returns how many there are."""
        for upload, values in zip(self._starts, (pose, base, place), strict=True):
            upload.values[: len(values)] = values
        return len(pose)

    def send_starts(self, count: int) -> None:
        """Send what was set of the first candidates; a graph may hold this."""
        for upload in self._starts:
            upload.send(count)

    def descend(self, count: int, steps: int) -> None:
        """Take damped steps with the first ``count`` candidates, from ``descent.pose`` towards lower cost.

        Before: ``descent.pose``, ``body.root_base`` and the frames' places are set. After: ``descent.best`` has the
        poses, with their ``cost`` and ``tally``. On a GPU nothing waits for them, and the second descent of a kind is
        captured as a graph that later ones replay: arrays that are looked at must stay, their values may change.
        """
        self._replays.run((count, steps, *self._baked), lambda: self._run(count, steps))

    def descended(
        self, place: np.ndarray, starts: RootedPoses, neighbours: Neighbours, steps: int
    ) -> tuple[RootedPoses, np.ndarray]:
        """Poses that the contours of the frames in places (pose,) lead to from some, and what they cost (pose,)."""
        pose, cost = starts.pose.copy(), np.zeros(len(starts))
        for part, count in self._in_parts(place, starts, neighbours, steps):
            pose[part], tally = self._answers.read(count)
            cost[part] = 0.5 * tally[:, :, 0].astype(np.float64).sum(axis=1)
        return RootedPoses(starts.base, pose), cost

    def _answer(self, count: int, steps: int) -> None:
        """Descend from the starts, and have the answers on their way to the host."""
        self.send_starts(count)
        self._run(count, steps)
        self._answers.fetch(count)

    def _run(self, count: int, steps: int) -> None:
        descent = self.descent
        wp.copy(descent.start, descent.pose)
        descent.cost.fill_(wp.inf)
        descent.damping.fill_(_FIRST_DAMPING)
        self._work.run(partial(self._again, steps=steps, work=partial(self._descend, steps=steps)), count)

    @property
    def _baked(self) -> tuple[int | float | None, ...]:
        """What launches that are kept hold besides arrays: the fields' addresses change when more room is made."""
        return *self.fields.addresses, self.follows

    def _again(self, batch: Batch, steps: int, work: Callable[[Batch], None]) -> None:
        """Do work with a batch whose launches are the same each time."""
        self._recordings.run((batch.first, batch.size, steps, *self._baked), self._device, lambda: work(batch))

    def _descend(self, batch: Batch, steps: int) -> None:
        for step in range(steps + 1):
            self._match(batch)
            if step < steps:
                pass_over(self._sums, batch, self.descent, self._outline.count)
                self._differentiate(batch)
            descend(self._sums, batch, self.descent, steps=step < steps)

    def _sum(self, batch: Batch) -> None:
        """From the poses of a batch's candidates to their sums."""
        self._match(batch)
        self._differentiate(batch)

    def _match(self, batch: Batch) -> None:
        """From poses to what their outlines cost."""
        outline, residuals = self._outline, self._residuals
        self._skin(batch)
        find_contours(self._edges, self._posed.vertex, self._moving, self._views, batch, outline)
        find_residuals(outline, self.fields.judging(self._place), self._views, self._matching, batch, residuals)
        sum_tallies(outline, residuals, batch, self._sums)

    def _differentiate(self, batch: Batch) -> None:
        """From matched outlines to the sums of their derivatives."""
        posed, outline, residuals = self._posed, self._outline, self._residuals
        turn_axes(self.descent.pose, batch, posed)
        move_origins(posed, self._change, batch)
        differentiate(posed, self._tree, self._change, self._views, outline, residuals, batch, self._rows)
        sum_normal_equations(outline, residuals, self._rows, batch, self._sums)

    def _read_sums(self, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Matrix, gradient and cost, for half the squares."""
        views, cost = self._sums_of_views(count)
        return (*self._unpacked(views.sum(axis=1)), 0.5 * cost.sum(axis=1))

    def _read_views(self, count: int) -> tuple[np.ndarray, ...]:
        """Matrix, gradient and cost of each view, then the root's axes and origin."""
        views, cost = self._sums_of_views(count)
        axes = self._posed.axes.numpy()[:count, 0].astype(np.float64)
        origin = self._joints.transform.numpy()[:count, 0, :3, 3].astype(np.float64)
        of_root = (np.repeat(each[:, None], views.shape[1], axis=1) for each in (axes, origin))
        return (*self._unpacked(views), 0.5 * cost, *of_root)

    def _sums_of_views(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Triangles (candidate, camera, element) and costs (candidate, camera), float64."""
        triangle, tally = self._summed_up.read(count)
        return triangle.astype(np.float64), tally[:, :, 0].astype(np.float64)

    def _unpacked(self, triangle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Matrices (..., n, n) and gradients (..., n) of triangles (..., element)."""
        row, column = self._row_and_column
        full = np.zeros((*triangle.shape[:-1], self._width, self._width))
        full[..., row, column] = full[..., column, row] = triangle
        n = self._width - 1
        return full[..., :n, :n], full[..., n, :n]
