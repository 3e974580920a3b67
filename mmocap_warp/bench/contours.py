"""Frames fitted by their contours alone: from masks in memory to poses on the host."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from mmocap_warp.bench.workload import Workload
from mmocap_warp.contour.fitter import ContourFitter
from mmocap_warp.kernels.benchmarks.case import Case, Check

CONTOUR = "contour"
CAMERAS = 5
"""Of the measure's cameras; all where it has fewer."""

_STEPS = 4
_NEARER = 0.6  # of the distance at the start, at most, after that


def contour_frames(load: Workload, runs: Sequence[int], device: str) -> Iterator[list[Case]]:
    """Fields, steps and whole frames, an evaluation being a frame of a run; on the CPU with one thread."""
    few = Workload(load.body, load.rig.select(load.rig.names[:CAMERAS]))
    for number in runs:
        yield _cases(few, number, device)


def _cases(load: Workload, runs: int, device: str) -> list[Case]:
    skeleton = load.body.skeleton
    index = skeleton.searched()
    fitter = ContourFitter(
        load.body, load.rig, index, skeleton.coordinate_limits, candidates=runs, frames=runs, device=device
    )
    observations = [load.observation] * runs
    start = np.tile(load.seen, (runs, 1))
    start[:, index] = load.poses(runs, seed=2)[:, index]
    base, place = np.tile(np.eye(3), (runs, 1, 1)), np.arange(runs)

    def fields() -> None:
        fitter.observe_all(observations)

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

    sizes = {"dof": len(index), "runs": runs} | load.sizes
    works = {"fields": fields, f"{_STEPS} steps": steps, "frame": frames}
    return [Case(CONTOUR, name, sizes, work, check, runs, captured=False) for name, work in works.items()]
