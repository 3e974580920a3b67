"""The whole evaluation, posed parameters to cost: for whole bodies, and for what a part of the hierarchy moves."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np
import warp as wp

from mmocap_warp.bench.workload import Workload
from mmocap_warp.kernels.benchmarks.case import Case, Check
from mmocap_warp.silhouettes import RENDERERS
from mmocap_warp.silhouettes.objective import Objective
from mmocap_warp.tracking.pose_search import Part, hierarchical

EVALUATION, MOVING = "whole evaluation", "moving part"
PIXELS_APART = 1e-4
"""Share of the pixels that a GPU may count differently from a CPU."""

_PART_CANDIDATES = 9  # of CMA-ES in 6 dimensions
_COMPARED = 64  # candidates with the CPU: one thread takes its time


def evaluations(
    load: Workload, batches: Sequence[int], threads: Sequence[int], device: str, group: str = EVALUATION
) -> Iterator[list[Case]]:
    """Whole bodies, by both renderers: batches of candidates, each by some numbers of threads."""
    for candidates in batches:
        expected = partial(_counts, load, min(candidates, _COMPARED))
        yield [
            _evaluation(group, load, load.objective(candidates, renderer, device, number), renderer, number, expected)
            for renderer in RENDERERS
            for number in threads
        ]


def _evaluation(
    group: str, load: Workload, objective: Objective, renderer: str, threads: int, expected: partial
) -> Case:
    candidates, device = objective.candidates, objective.device
    sizes = {"renderer": renderer, "candidates": candidates} | load.sizes_on(device, threads)

    def check() -> Check:
        objective.count.zero_()
        cost = objective.evaluate(candidates).numpy()
        reference = expected()
        count = objective.count.numpy()[: len(reference)].astype(int)
        apart, pixels = int(np.abs(count - reference).sum()), int(reference[..., 0].sum())
        allowed = 0 if device == "cpu" else PIXELS_APART * pixels
        return Check(f"{apart} of {pixels:,} pixels off the CPU's raster", apart <= allowed and bool((cost < 1).all()))

    return Case(group, renderer, sizes, partial(objective.evaluate, candidates), check, candidates)


def _counts(load: Workload, candidates: int) -> np.ndarray:
    """What the CPU's raster counts with one thread, (candidate, camera, 2) int."""
    objective = load.objective(candidates, "raster", "cpu")
    objective.evaluate(candidates)
    return objective.count.numpy().astype(int)


def moving_parts(load: Workload, device: str) -> Iterator[list[Case]]:
    """What each part of the hierarchy moves, by both renderers, and drawing what rests."""
    for part in hierarchical(load.body.skeleton):
        yield [case for renderer in RENDERERS for case in _moving(load, part, renderer, device)]


def _moving(load: Workload, part: Part, renderer: str, device: str) -> list[Case]:
    candidates = _PART_CANDIDATES
    objective = load.objective(candidates, renderer, device)
    poses = np.repeat(load.poses(1), candidates, axis=0)
    poses[:, part.index] = load.poses(candidates)[:, part.index]
    base = wp.array(poses[:1], dtype=wp.float32, device=device)

    def hold_poses() -> None:
        objective.hold(base, part.index)
        objective.pose.assign(poses)

    def check() -> Check:
        hold_poses()
        objective.evaluate(candidates)
        moved = objective.count.numpy().copy()
        objective.release()
        objective.evaluate(candidates)
        apart = int((moved != objective.count.numpy()).any(axis=-1).sum())
        hold_poses()
        return Check(f"{apart} of {moved.shape[0] * moved.shape[1]} counts differ from the whole body's", apart == 0)

    hold_poses()
    sizes = {"renderer": renderer, "candidates": candidates} | load.sizes_on(device, 1)
    evaluate = Case(MOVING, part.name, sizes, partial(objective.evaluate, candidates), check, candidates)
    if renderer != RENDERERS[-1] or load.body.skeleton.moved_by(part.index).all():
        return [evaluate]
    held = load.objective(candidates, renderer, device)  # one of its own: holding overwrites poses
    hold = Case(MOVING, f"{part.name}: hold", sizes, partial(held.hold, base, part.index), check)
    return [evaluate, hold]
