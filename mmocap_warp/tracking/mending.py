"""A few frames of a result solved anew, from joints that were clicked or by a longer search; all others stay.

A frame with clicked joints is an anchor: its pose is fitted to the clicks, then to clicks and contours. Without clicks
each of some frames is one, and many poses around it are tried. From an anchor the frames are followed in both
directions of time until the pose is the known one again. Each frame takes the better of what is known and of both ways,
and the span is smoothed as a clip of its own, in which the frames around it are held.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import islice
from math import ceil
from typing import Any

import numpy as np

from mmocap_warp.contour.clip.backward_pass import STARTS, least_costly, next_starts, places_by_acceleration
from mmocap_warp.contour.clip.motion_points import MotionPoints
from mmocap_warp.contour.frame.descent import LARGEST_STEP, RAISE, Trust
from mmocap_warp.contour.frame.normal_equations import NormalEquations
from mmocap_warp.contour.frame.rooted import Neighbours, RootedPoses, Rooting
from mmocap_warp.masks.observation import Observation
from mmocap_warp.result.pose_errors import nanmean
from mmocap_warp.result.result import STATUS, Result
from mmocap_warp.result.verdict import frames_marked
from mmocap_warp.scene.recording import Scene
from mmocap_warp.tracking.body_masks import tracked_observations
from mmocap_warp.tracking.from_settings import make_fitter, make_objective, search_limits
from mmocap_warp.tracking.holes import HOLE_SECONDS
from mmocap_warp.tracking.loose_clothes import with_hidden
from mmocap_warp.tracking.pins import Pins
from mmocap_warp.tracking.recovery_starts import SCATTERED_POSES, RecoveryStarts
from mmocap_warp.tracking.smoothing import Mending, smoothed
from mmocap_warp.tracking.track_config import TrackConfig

REACH = 2.0  # seconds that frames are followed from an anchor at most
_CONTEXT = 0.5  # seconds before and after a span whose frames are held
_MARGIN = 0.1  # seconds beside what changed that are smoothed with it
_CHANGED = 0.005  # a frame near clicks changed if a joint moved farther [m]
_ANOTHER_PLACE = 0.04  # a longer search found another answer if a joint is this far away [m]
_SEARCH_INTERVAL = 0.25  # seconds between the anchors where nothing is clicked
_AGREES, _AGREEING = 0.02, 3  # joints this near to the known ones [m], in so many frames in a row, end a way
_PIN_STEPS, _STEPS, _WAY_STEPS = 30, 10, 5  # descent steps: to clicks alone, to clicks and contours, along a way
_PRIOR = 0.5  # standard deviation of a pose around the known one while it is fitted to clicks alone [m, rad]
_LOST_OVERLAP = 0.06  # overlap below the usual at which a frame is lost
_FORBIDDEN = 1e9  # cost of an answer that is none


def mended(scene: Scene, result: Result, config: TrackConfig, pins: Pins, span: range | None) -> Result:
    """The result with the frames around pins, or those at a span's positions, solved anew.

    The scene is the whole recording, and the result that of a run with ``config``.
    """
    reach, anchors = max(1, round(REACH * result.rate)), np.unique(pins.frame)
    spans = [] if span is None else [span]
    # Pins that lie near each other belong to one span.
    for group in np.split(anchors, np.flatnonzero(np.diff(anchors) > 2 * reach) + 1):
        if len(group):
            spans.append(range(max(0, group[0] - reach), min(len(result.frame_numbers), group[-1] + reach + 1)))
    for each in spans:
        result = _with_span(scene, result, config, pins, each)
    return result


def _with_span(scene: Scene, result: Result, config: TrackConfig, pins: Pins, span: range) -> Result:
    """The result with one span of frames by their positions solved anew, as far as they change."""
    # The span and the frames around it are a result of their own.
    context = max(3, round(_CONTEXT * result.rate))
    first, last = max(0, span.start - context), min(len(result.frame_numbers), span.stop + context)
    whole, unit = list(range(first, last)), result.subject.body.unit
    part, seen = result.at(whole).in_unit(unit), _observations(scene, result, first, last)
    own = range(span.start - first, span.stop - first)
    config, within = config.in_unit(unit), pins.moved(first, unit)
    at = [frame for frame in np.unique(within.frame).tolist() if frame in own]

    # Follow the frames from the anchors.
    search = _SpanSearch(part, config, seen, within)
    pose, changed = part.pose.copy(), np.zeros(len(whole), bool)
    for run in range(len(pose)):
        pose[run], moved = search.solved(part.pose[run], own, at)
        changed |= moved
    if not changed.any():
        return result

    # Smooth what changed, and judge it as any track.
    free = np.zeros(len(whole), bool)
    ends = np.flatnonzero(changed)[[0, -1]]
    margin = round(_MARGIN * result.rate)
    free[max(own.start, ends[0] - margin) : min(own.stop, ends[1] + 1 + margin)] = True
    repeated = part.status == STATUS.index("repeated")
    shown = np.array([each.foreground > 0 for each in seen])
    tracked, partial, lost = (STATUS.index(name) for name in ("tracked", "partial", "lost"))
    as_shown = np.select([shown.all(axis=1), shown.any(axis=1)], [tracked, partial], lost)
    status = np.where(free & ~repeated, as_shown, part.status).astype(np.int8)
    done = smoothed(replace(part, pose=pose, status=status), config, seen, mending=Mending(~free, within))
    usual = nanmean(result.iou, axis=2)
    low = nanmean(done.iou, axis=2) < np.nanmedian(usual, axis=1, keepdims=True) - _LOST_OVERLAP
    done = replace(done, status=np.where(low & ~repeated, lost, done.status).astype(np.int8))
    done = done.in_unit(1 / unit)

    # All other frames keep their bits.
    arrays = {name: array.copy() for name, array in result.arrays.items()}
    for name, array in arrays.items():
        if name != "evaluations":
            array[:, first:last][:, free] = getattr(done, name)[:, free]
    numbers = part.frame_numbers[free]
    note: dict[str, list[Any]] = {"frames": [int(numbers[0]), int(numbers[-1])]}
    if pins.listed:
        note["pins"] = [each for each in pins.listed if each["frame"] in numbers]
    history = [*result.config.get("mended", []), note]
    return replace(result, config=result.config | {"mended": history}, **arrays)


def _observations(scene: Scene, result: Result, first: int, last: int) -> list[Observation]:
    """The masks of frames as the track saw them: without the views that were frozen, or of cameras moved."""
    begin = max(0, first - ceil(HOLE_SECONDS * result.rate))  # a hole may be open at the first
    seen = tracked_observations(scene, result, range(begin, last))
    seen = with_hidden(seen, result.subject, result.cameras, result.rate, lambda i: result.pose[:, begin + i - 1])
    left_out = frames_marked(result, "frozen_views") | frames_marked(result, "moved_views")
    shown = zip(islice(seen, first - begin, None), left_out[first:last], strict=True)
    return [each.without(views) for each, views in shown]


class _SpanSearch:
    """Finds poses of a span's frames; ``part`` is the span with frames around it, whose masks are all held."""

    def __init__(self, part: Result, config: TrackConfig, observations: Sequence[Observation], pins: Pins) -> None:
        subject = part.subject
        skeleton, searched = subject.body.skeleton, subject.body.skeleton.searched(config.dof)
        limits = search_limits(subject, config)
        self._rate, self._size, self._pins = part.rate, subject.body.relative_size, pins
        self._rooting = Rooting(skeleton, subject.root_base, searched, limits)
        self._points = MotionPoints(skeleton, subject.body.joint_rest, searched)
        self._starts, self._trust = RecoveryStarts(subject, part.cameras, config), Trust(self._rooting.is_length)
        self._fitter = make_fitter(subject, part.cameras, config, SCATTERED_POSES + 1, frames=len(observations))
        self._fitter.observe_all(observations)
        self._objective = make_objective(subject, part.cameras, config, SCATTERED_POSES + 1)
        self._seen, self._known = observations, self._rooting.none

    def solved(self, pose: np.ndarray, own: range, anchors: list[int]) -> tuple[np.ndarray, np.ndarray]:
        """Poses (frame, coordinate) with those of the frames that are ``own`` solved anew, and which (frame,) changed.

        ``anchors`` are the frames with pins; without any, frames here and there are.
        """
        known = self._known = self._rooting.refold(self._rooting.enter(pose))
        pinned = bool(anchors)
        if not anchors:
            anchors = list(own)[:: max(1, round(_SEARCH_INTERVAL * self._rate))]
        at_anchors = {f: self._anchor(f, pose[f], pinned) for f in anchors}

        # Follow the frames from each anchor in both directions, up to the next one.
        answers = [known, known, known]
        there = np.zeros((3, len(pose)), bool)
        there[0] = True
        for number, step in ((1, 1), (2, -1)):
            for f in anchors:
                beyond = [abs(g - f) for g in anchors if (g - f) * step > 0]
                stop = f + step * min(beyond) if beyond else (own.stop if step > 0 else own.start - 1)
                further = range(f + step, stop, step)
                answers[number] = self._followed(answers[number], there[number], f, at_anchors[f], further)

        # Each frame takes the answer with which all frames together cost least.
        costs = np.stack([self._costs(np.arange(len(pose)), poses) for poses in answers])
        scale = costs[0, :, 0].sum() / max(costs[0, :, 1].sum(), 1e-6)
        cost = costs[..., 0] + scale * costs[..., 1]
        if pinned:  # what was known is not asked from the first click to the last
            there[0, anchors[0] : anchors[-1] + 1] = False
        cost[~there] += _FORBIDDEN
        place = np.stack([places_by_acceleration(self._points, poses, self._rate) for poses in answers])
        chosen = least_costly(cost, place)
        for number in (1, 2):
            known = answers[number].where(chosen == number, known)
        least = (_CHANGED if pinned else _ANOTHER_PLACE) * self._size
        changed = (chosen > 0) & (self._points.apart(known, self._known) > least)
        return np.where(changed[:, None], self._rooting.leave(known, pose[0, 3:6]), pose), changed

    def _anchor(self, frame: int, pose: np.ndarray, pinned: bool) -> RootedPoses:
        """The best pose (1,) of a frame from many starts."""
        counter = np.array([frame])
        starts = np.concatenate([pose[None], self._starts.scattered(pose[None].astype(np.float32), counter)[0]])
        rooted = self._rooting.refold(self._rooting.enter(starts))
        at = np.full(len(rooted), frame)
        if pinned:
            rooted = self._descended(at, rooted, _PIN_STEPS, contours=False)
        rooted = self._descended(at, rooted, _STEPS)
        cost = self._costs(at, rooted)
        # Contours and areas of the first pose weigh the same; pins count as they are.
        total = cost[:, 0] + cost[:, 1] * cost[0, 0] / max(cost[0, 1], 1e-6)
        best = int(np.argmin(total))
        return rooted[best : best + 1]

    def _descended(self, frames: np.ndarray, rooted: RootedPoses, steps: int, contours: bool = True) -> RootedPoses:
        """Poses of frames after damped steps towards pins, and towards contours, or else near to where they were."""

        def linearised(poses: RootedPoses) -> NormalEquations:
            clicks = self._pins.of(frames, poses, self._points)
            if contours:
                neighbours = Neighbours.of(self._known, frames, self._rate)
                return self._fitter.linearise(frames, poses, neighbours).plus(clicks)
            return clicks.plus(self._prior(poses, rooted))

        damping, equations, poses = np.ones(len(rooted)), linearised(rooted), rooted
        for _ in range(steps):
            matrix = equations.matrix + self._trust.matrix(equations, damping)
            matrix += 1e-9 * np.eye(matrix.shape[1])
            step = np.linalg.solve(matrix, equations.gradient[..., None])[..., 0]
            moved = self._rooting.stepped(poses, np.clip(step, -LARGEST_STEP, LARGEST_STEP))
            there = linearised(moved)
            taken = there.cost <= equations.cost
            poses, equations = moved.where(taken, poses), there.where(taken, equations)
            damping = np.where(taken, np.maximum(damping / RAISE, 1.0), damping * RAISE)
        return poses

    def _prior(self, poses: RootedPoses, around: RootedPoses) -> NormalEquations:
        """That poses are about as they were; the root may turn freely."""
        searched, count = self._rooting.searched, len(poses)
        off = (poses.pose - around.pose)[:, searched] / _PRIOR**2
        matrix = np.tile(np.eye(len(searched)) / _PRIOR**2, (count, 1, 1))
        return NormalEquations(matrix, -off, 0.5 * _PRIOR**2 * (off**2).sum(axis=1))

    def _followed(
        self, way: RootedPoses, there: np.ndarray, anchor: int, pose: RootedPoses, frames: range
    ) -> RootedPoses:
        """The way with poses from an anchor's through further frames, until they are the known ones again.

        They are marked in ``there`` (frame,) bool.
        """
        way, there[anchor] = way.with_frames(np.array([anchor]), pose), True
        last = before = self._rooting.leave(pose, np.zeros(3))[0]
        agreeing = 0
        for f in frames[: round(REACH * self._rate)]:
            if not self._seen[f].foreground.any():
                break
            starts, at = next_starts(self._rooting, last, before), np.full(STARTS, f)
            fitted, cost = self._fitter.descended(at, starts, Neighbours.of(self._known, at, self._rate), _WAY_STEPS)
            best = int(np.argmin(cost))
            found = fitted[best : best + 1]
            before, last = last, self._rooting.leave(found, last[3:6])[0]
            way, there[f] = way.with_frames(np.array([f]), self._rooting.refold(found)), True
            near = self._points.apart(way[f : f + 1], self._known[f : f + 1])[0] < _AGREES * self._size
            agreeing = agreeing + 1 if near else 0
            if agreeing == _AGREEING:
                break
        return way

    def _costs(self, frames: np.ndarray, rooted: RootedPoses) -> np.ndarray:
        """(pose, 2) what contours and pins, and what areas cost."""
        neighbours = Neighbours.of(self._known, frames, self._rate)
        clicks = self._pins.of(frames, rooted, self._points).cost
        contours = self._fitter.linearise(frames, rooted, neighbours).cost + clicks
        poses, areas = self._rooting.leave(rooted, np.zeros(3)), np.zeros(len(frames))
        for same in np.split(np.arange(len(frames)), np.flatnonzero(np.diff(frames)) + 1):
            self._objective.observe(self._seen[frames[same[0]]])
            areas[same] = self._objective.costs(poses[same])
        return np.stack([contours, np.nan_to_num(areas)], axis=1)
