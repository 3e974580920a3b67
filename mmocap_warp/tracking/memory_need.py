"""What tracking would take of a device's memory, told before it is taken.

A machine that runs out of memory kills the program, or slows to a crawl; so what is too large is refused beforehand,
naming what fits. The need is not modelled but read from small ones of the same make. A search of no runs has arrays
without rows, which take next to nothing whatever the budget, but each knows how many bytes a row of it has. What fits
contours is made for one candidate and for two, which tells what each takes.
"""

from __future__ import annotations

import bisect
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import warp as wp

from mmocap_warp.body.mesh_pieces import is_closed
from mmocap_warp.body.model import Subject
from mmocap_warp.body.posing import Poser
from mmocap_warp.cameras.rig import CameraRig, project
from mmocap_warp.contour.clip.uncertainty import body_changes
from mmocap_warp.device.resolve import free_memory, resolve_device
from mmocap_warp.errors import InputError
from mmocap_warp.masks.observation import Observation
from mmocap_warp.tracking.algorithms import CONTOUR_TRACKERS
from mmocap_warp.tracking.contour_tracker import ContourTracker
from mmocap_warp.tracking.from_settings import make_fitter, make_objective
from mmocap_warp.tracking.limb_pairs import limb_pairs
from mmocap_warp.tracking.pose_search import PoseSearch
from mmocap_warp.tracking.smoothing import CANDIDATES, frames_held
from mmocap_warp.tracking.track_config import TrackConfig
from mmocap_warp.tracking.tracker import Tracker

_SHARE = 0.9  # of the free memory may be taken: kernels, graphs and everybody else want some too
_GB = 1e9


@dataclass(frozen=True)
class MemoryNeed:
    """Bytes of all Warp arrays of a piece of work.

    Attributes:
        fixed: of those that do not depend on the number of runs.
        per_run: of each run.
    """

    fixed: int = 0
    per_run: int = 0

    def of(self, runs: int) -> int:
        """Bytes that so many runs take."""
        return self.fixed + runs * self.per_run

    def __add__(self, other: MemoryNeed) -> MemoryNeed:
        return MemoryNeed(self.fixed + other.fixed, self.per_run + other.per_run)


def memory_need(subject: Subject, rig: CameraRig, config: TrackConfig, fps: float) -> list[MemoryNeed]:
    """What a tracker would take, and then smoothing, which comes after it; the arguments are the tracker's own."""
    empty = tracker_of(config)(subject, rig, config, fps, runs=0)
    tracking = MemoryNeed() if empty.search is None else _of_search(empty.search)
    if not (config.fits_contours or config.acceleration):
        return [tracking]
    fitter = _FitterNeed(subject, rig, config)
    one, two = (_bytes(make_objective(subject, rig, config, candidates)) for candidates in (1, 2))
    judge = MemoryNeed(2 * one - two, two - one)
    if isinstance(empty, ContourTracker):
        candidate = fitter.candidate + judge.per_run
        tracking += MemoryNeed(fitter.of(0, 1) + judge.fixed, empty.starts * candidate)
    return [tracking, *([judge + MemoryNeed(fitter.of_smoothing(fps))] if config.acceleration else [])]


def _of_search(search: PoseSearch) -> MemoryNeed:
    """Of a search that has no runs."""
    of_candidates = {id(array) for array in search.objective.candidate_arrays}
    fixed = per_run = 0
    for array in arrays_of(search):
        if array.size:
            fixed += array.capacity
        else:
            per_run += array.strides[0] * (search.particles if id(array) in of_candidates else 1)
    return MemoryNeed(fixed, per_run)


class _FitterNeed:
    """What fitters of contours take, each with the masks of someone who stands as the subject does.

    Attributes:
        candidate: bytes of each candidate.
    """

    def __init__(self, subject: Subject, rig: CameraRig, config: TrackConfig) -> None:
        seen = _boxes(subject, rig)

        def measured(candidates: int, frames: int, parameters: int = 0) -> int:
            fitter = make_fitter(subject, rig, config, candidates, frames, parameters)
            fitter.observe(0, seen)
            return _bytes(fitter)

        self._measured, self._parameters = measured, len(body_changes(subject.body).sigma)
        self._pairs = len(limb_pairs(subject.body.skeleton))
        self._one = measured(1, 1)
        self.candidate = measured(2, 1) - self._one

    def of(self, candidates: int, frames: int) -> int:
        """Bytes of a fitter."""
        frame = self._measured(1, 2) - self._one if frames > 1 else 0
        return self._one + (candidates - 1) * self.candidate + (frames - 1) * frame

    def of_smoothing(self, fps: float) -> int:
        """Bytes of the three that a window of a clip is smoothed with."""
        frames = frames_held(fps)
        anew = self.of(max(1, self._pairs), 1)
        return self.of(min(CANDIDATES, frames), frames) + self._measured(1, 1, self._parameters) + anew


def _boxes(subject: Subject, rig: CameraRig) -> Observation:
    """Masks of the boxes that the subject's first pose fills: about as large as those of other frames will be."""
    outlines = project(rig, Poser(subject.body, subject.root_base).tracking_vertices(subject.pose)[0])
    masks = [np.zeros((height, width), bool) for width, height in rig.size]
    for mask, points in zip(masks, outlines, strict=True):
        seen = points[np.isfinite(points).all(axis=1)]
        if len(seen):
            (left, top), (right, bottom) = np.clip([seen.min(axis=0), seen.max(axis=0)], 0, None).astype(int)
            mask[top : bottom + 1, left : right + 1] = True
    return Observation.from_masks(masks)


def _bytes(owner: object) -> int:
    return sum(array.capacity for array in arrays_of(owner))


def arrays_of(owner: object) -> Iterator[wp.array[Any]]:
    """The Warp arrays that an object of this project holds, in itself and in its parts, each once."""
    seen: set[int] = set()
    unseen = [owner]
    while unseen:
        thing = unseen.pop()
        if id(thing) in seen:
            continue
        seen.add(id(thing))
        if isinstance(thing, wp.array):
            yield thing
        elif isinstance(thing, dict):
            unseen += thing.values()
        elif isinstance(thing, list | tuple):
            unseen += thing
        elif _is_ours(thing) and hasattr(thing, "__dict__"):
            unseen += vars(thing).values()


def _check_closed(subject: Subject, config: TrackConfig) -> None:
    """Contours wind around a body only where its mesh is closed."""
    if (config.fits_contours or config.acceleration) and not is_closed(subject.body.tracking_face):
        user = config.algorithm if config.algorithm in CONTOUR_TRACKERS else "polish" if config.polish else "smooth"
        raise InputError(
            subject.body.name,
            f"its tracking mesh is not closed, which {user} needs",
            "close the mesh, or use one of the paper's algorithms without polish and with smooth = 0",
        )


def _is_ours(thing: object) -> bool:
    """Whether a thing may hold arrays: an object of this project, or a Warp struct."""
    is_struct = hasattr(thing, "__ctype__")
    return is_struct or any(base.__module__.startswith("mmocap_warp") for base in type(thing).mro())


def tracker_of(config: TrackConfig) -> type[Tracker] | type[ContourTracker]:
    """The class that tracks by some settings."""
    return ContourTracker if config.fits_contours else Tracker


def fitting_tracker(subject: Subject, rig: CameraRig, config: TrackConfig, fps: float) -> Tracker | ContourTracker:
    """A tracker, or an error where it could not finish.

    Raises:
        InputError: too many runs, or too large a budget, for the device's memory; says how many runs, or what budget,
            would fit. Or contours, or a clip that is to be smoothed by them, of a tracking mesh that is not closed.
    """
    _check_closed(subject, config)
    device = resolve_device(config.device)
    free = free_memory(device)
    needs = memory_need(subject, rig, config, fps)
    most = max(need.of(config.runs) for need in needs)
    if free is None or most <= _SHARE * free:
        return tracker_of(config)(subject, rig, config, fps)

    def too_much(evaluations: int) -> bool:
        smaller = memory_need(subject, rig, replace(config, evaluations=evaluations), fps)
        return max(need.of(config.runs) for need in smaller) > _SHARE * free

    runs = min(int((_SHARE * free - need.fixed) // need.per_run) for need in needs)
    budgets = range(1, 1 if too_much(1) else config.budget)
    evaluations = bisect.bisect_left(budgets, True, key=too_much)
    fitting = [f"runs = {runs}"] * (runs > 0) + [f"evaluations = {evaluations}"] * (evaluations > 0)
    raise InputError(
        device,
        f"{config.algorithm} with runs = {config.runs} and evaluations = {config.budget} takes "
        f"{most / _GB:,.1f} GB of memory, {free / _GB:,.1f} GB are free",
        f"the most that fits is {' or '.join(fitting)}"
        if fitting
        else "choose fewer runs, a smaller budget and a smaller scale",
    )
