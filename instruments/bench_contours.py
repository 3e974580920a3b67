"""Frames fitted by their contours alone, and tracked: from masks in memory to poses on the host."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from bench_searches import FPS, start_of

from mmocap_warp.bench.workload import Workload
from mmocap_warp.contour.frame.fitter import ContourFitter
from mmocap_warp.kernels.benchmarks.timing import Case, Check
from mmocap_warp.tracking.contour_tracker import ContourTracker
from mmocap_warp.tracking.track_config import TrackConfig

CONTOUR = "contour"
CAMERAS = 5
"""Of the measure's cameras; all where it has fewer."""

_STEPS = 4
_FOLLOWED = "search-contour"
_MOVED = 0.3  # the share of the start's distance by which a followed body has moved since the last frame
_OVERLAP = 0.55  # least overlap with the masks, where a body has a few hundred pixels
_LEVEL = 0.5  # overlap of earlier frames, so low that no frame calls for a search
_NEARER = 0.6  # the share of the start's distance that may be left after the steps


def contour_frames(load: Workload, runs: Sequence[int], device: str) -> Iterator[list[Case]]:
    """Fields, steps and whole frames, an evaluation being a frame of a run; on the CPU with one thread.

    Frames that the default tracker follows in the ordinary way come with them.
    """
    few = Workload(load.body, load.rig.select(load.rig.names[:CAMERAS]))
    for number in runs:
        yield [*_cases(few, number, device), _followed(few, number, device)]


def _cases(load: Workload, runs: int, device: str) -> list[Case]:
    skeleton = load.body.skeleton
    sizes: dict[str, Any] = {"candidates": runs, "frames": runs, "device": device}
    fitter = ContourFitter(load.body, load.rig, skeleton.searched(), skeleton.coordinate_limits, **sizes)
    start = _start(load, runs)
    base, place = np.tile(np.eye(3), (runs, 1, 1)), np.arange(runs)
    fields = partial(fitter.observe_all, [load.observation] * runs)

    def steps() -> np.ndarray:
        fitter.start_at(start, base, place)
        fitter.descend(runs, _STEPS)
        poses: np.ndarray = fitter.descent.best.numpy()
        return poses

    def frames() -> np.ndarray:
        fields()
        return steps()

    def check() -> Check:
        """It comes nearer to what is seen."""
        (seen,) = load.vertices(load.seen[None])
        far, near = (np.linalg.norm(load.vertices(poses) - seen, axis=2).mean() * 1e3 for poses in (start, frames()))
        return Check(f"{far:.1f} to {near:.1f} mm from what is seen", bool(near <= _NEARER * far))

    works: dict[str, Callable[[], object]] = {"fields": fields, f"{_STEPS} steps": steps, "frame": frames}
    return [Case(CONTOUR, name, _sizes(load, runs), work, check, runs, captured=False) for name, work in works.items()]


def _followed(load: Workload, runs: int, device: str) -> Case:
    """Frame after frame of a body that stands still."""
    config = TrackConfig(_FOLLOWED, runs=runs, device=device, threads=1)
    tracker = ContourTracker(start_of(load), load.rig, config, FPS)
    start = load.seen + np.float32(_MOVED) * (_start(load, runs) - load.seen)

    follow = partial(tracker.step, load.observation)

    def begin() -> None:
        levels = np.full_like(tracker.state.overlap_levels, _LEVEL)
        tracker.state = replace(tracker.state, pose=start, previous_pose=start, overlap_levels=levels)

    def check() -> Check:
        """It explains the masks, and nothing was searched."""
        begin()
        answer = follow()
        worst = float(answer.iou.mean(axis=1).min())
        return Check(
            f"overlap {worst:.3f}, {answer.evaluations} evaluations", worst >= _OVERLAP and not answer.evaluations
        )

    begin()
    return Case(CONTOUR, _FOLLOWED, _sizes(load, runs), follow, check, runs, captured=False)


def _start(load: Workload, runs: int) -> np.ndarray:
    """Poses (run, coordinate) float32 that differ from what is seen in all that is searched."""
    index = load.body.skeleton.searched()
    start = np.tile(load.seen, (runs, 1))
    start[:, index] = load.poses(runs, seed=2)[:, index]
    return start


def _sizes(load: Workload, runs: int) -> dict[str, int]:
    return {"dof": len(load.body.skeleton.searched()), "runs": runs} | load.sizes
