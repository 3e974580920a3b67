"""What a step of the search moves, optimizers alone, a generation from ask to tell, and the search of a whole frame."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from operator import attrgetter
from typing import Any

import numpy as np
import warp as wp
from body_parts import Part, hierarchical, holistic

from mmocap_warp.bench.evaluations import all_alike
from mmocap_warp.bench.report_file import FRAME
from mmocap_warp.bench.workload import Workload
from mmocap_warp.body.model import Subject
from mmocap_warp.kernels.benchmarks.timing import Case, Check, Measurement, Timing, time_together
from mmocap_warp.kernels.optimizers.populations import make_space
from mmocap_warp.optimizers.search import Optimizer, Search
from mmocap_warp.silhouettes import RENDERERS
from mmocap_warp.tracking.algorithms import ALGORITHMS
from mmocap_warp.tracking.track_config import TrackConfig
from mmocap_warp.tracking.tracker import Tracker, TrackState

MOVING, OPTIMIZER, GENERATION = "moving part", "ask and tell", "a generation"
COST_APART = 1e-5
"""How far the cost of an answer may be from that of the same pose on the CPU."""
FPS = 60.0
"""The frame rate that a tracker takes its search radius from."""

_BUDGET = 500
_PART_CANDIDATES = 9  # of CMA-ES in 6 dimensions
_LONGER_BY = 5  # by which the longer of two searches exceeds the shorter
_SPHERE_GENERATIONS = 40  # after these an optimizer must be nearer to the minimum of a sphere


def start_of(load: Workload) -> Subject:
    """Where a search starts: beside what is seen."""
    return Subject(load.body, np.eye(3), load.poses(1, seed=2)[0].astype(float), {})


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
        same = all_alike(moved, objective.count.numpy(), words="from the whole body's")
        hold_poses()
        return same

    hold_poses()
    sizes = {"renderer": renderer, "candidates": candidates} | load.sizes_on(device, 1)
    evaluate = Case(MOVING, part.name, sizes, partial(objective.evaluate, candidates), check, candidates)
    if renderer != RENDERERS[-1] or load.body.skeleton.moved_by(part.index).all():
        return [evaluate]
    held = load.objective(candidates, renderer, device)  # one of its own: holding overwrites poses
    return [evaluate, Case(MOVING, f"{part.name}: hold", sizes, partial(held.hold, base, part.index), check)]


def minimises_sphere(
    ask: Callable[[], np.ndarray],
    tell: Callable[[np.ndarray], None],
    cost_of: Callable[[np.ndarray], np.ndarray],
    generations: int,
    allowed: float,
) -> Check:
    """Whether an optimizer leaves less than the share ``allowed`` of its first generation's mean cost."""
    means = []
    for _ in range(generations):
        cost = cost_of(ask())
        means.append(cost.mean(axis=1))
        tell(cost)
    share = float(np.max(means[-1] / means[0]))
    return Check(f"a sphere's cost falls to {share:.2g} in {generations} generations", share < allowed)


def ask_and_tell(load: Workload, runs: Sequence[int], device: str) -> Iterator[list[Case]]:
    """Each family of optimizers without an objective, for all degrees of freedom and for a part's."""
    for name in ("cmaes", "de", "pso", "apf"):
        for part in (*holistic(load.body.skeleton), hierarchical(load.body.skeleton)[-1]):
            yield [_ask_and_tell(load, name, part, number, device) for number in runs]


def _optimizer(name: str, part: Part, radius: float, runs: int, device: str) -> Optimizer:
    seed, counter = (wp.array(of, dtype=wp.int32, device=device) for of in (np.arange(runs), np.zeros(runs, int)))
    space = make_space(part.index, np.full(len(part.index), radius), seed, counter)
    return ALGORITHMS[name].optimizer(space, _BUDGET)


def _ask_and_tell(load: Workload, name: str, part: Part, runs: int, device: str) -> Case:
    optimizer = _optimizer(name, part, 0.5, runs, device)
    particles = optimizer.particles
    start = wp.array(np.ones((runs, load.body.skeleton.coordinates)), dtype=wp.float32, device=device)
    cost = wp.array(np.random.default_rng(0).uniform(0.1, 0.9, runs * particles), dtype=wp.float32, device=device)
    optimizer.start(start)

    def work() -> None:
        optimizer.ask(particles)
        optimizer.tell(cost)

    def check() -> Check:
        for array in optimizer.memory:
            array.zero_()
        optimizer.start(start)
        return minimises_sphere(
            lambda: optimizer.ask(particles).numpy(),
            lambda squares: optimizer.tell(wp.array(squares.ravel(), dtype=wp.float32, device=device)),
            lambda x: (x**2).mean(axis=2),
            _SPHERE_GENERATIONS,
            1.0,
        )

    return Case(OPTIMIZER, name, {"dof": len(part.index), "particles": particles, "runs": runs}, work, check)


def measure_generations(
    load: Workload, device: str, threads: int, seconds: float | None = None
) -> Iterator[list[Measurement]]:
    """A generation of one run from ask to tell: of the whole body, of each part, and on average over the parts.

    It is what a search of six generations takes over a search of one, divided by five.
    """
    for renderer in RENDERERS:
        *parts, whole = (
            _generation(load, name, part, renderer, device, threads, seconds)
            for name, split in (("h-cmaes", hierarchical), ("cmaes", holistic))
            for part in split(load.body.skeleton)
        )
        yield [*parts, _mean(parts, "h-cmaes: mean of the parts"), whole]


def _generation(
    load: Workload, name: str, part: Part, renderer: str, device: str, threads: int, seconds: float | None
) -> Measurement:
    radius, _translation = TrackConfig(algorithm=name).radii(FPS)

    def search(generations: int) -> Search:
        optimizer = _optimizer(name, part, radius, 1, device)
        objective = load.objective(optimizer.particles, renderer, device, threads)
        evaluations = 1 + generations * optimizer.particles
        search = Search(objective, [optimizer], evaluations, load.body.skeleton.coordinate_limits)
        search.best_pose.assign(start_of(load).pose[None].astype(np.float32))
        return search

    short, long = search(1), search(1 + _LONGER_BY)
    particles = (long.evaluations - short.evaluations) // _LONGER_BY
    one, many = time_together([short.run, long.run], device, seconds=seconds)
    samples = tuple((b - a) / _LONGER_BY for a, b in zip(one.samples, many.samples, strict=True))
    launched = None if many.launched is None or one.launched is None else (many.launched - one.launched) / _LONGER_BY
    timing = Timing(samples, (many.processor - one.processor) / _LONGER_BY, one.compiling + many.compiling, launched)
    sizes = {"renderer": renderer, "dof": len(part.index), "candidates": particles, "runs": 1}
    sizes |= load.sizes_on(device, threads)

    def check() -> Check:
        return _cost_is_right(load, long.best_pose.numpy(), long.best_cost.numpy())

    case = Case(GENERATION, f"{name}: {part.name}", sizes, long.run, check, particles)
    return replace(Measurement.of(case, timing), lowest=(many.lowest - one.lowest) / _LONGER_BY)


def _mean(parts: list[Measurement], name: str) -> Measurement:
    """The mean of measurements that are steps of one thing."""

    def mean(of: Callable[[Measurement], float]) -> float:
        return sum(map(of, parts)) / len(parts)

    times: dict[str, Any] = {key: mean(attrgetter(key)) for key in ("median", "lowest", "processor")}
    times["quartiles"] = tuple(mean(lambda part, end=end: part.quartiles[end]) for end in range(2))  # type: ignore[misc]
    times["launched"] = None if parts[0].launched is None else mean(lambda part: part.launched or 0.0)
    times["compiling"] = sum(part.compiling for part in parts)
    sizes = {key: value for key, value in parts[0].sizes.items() if key not in ("dof", "candidates")}
    spent = round(mean(attrgetter("evaluations")))
    checked: dict[str, Any] = {"check": "those of the parts", "ok": all(part.ok for part in parts)}
    return replace(parts[0], name=name, sizes=sizes, evaluations=spent, **times, **checked)


def _cost_is_right(load: Workload, pose: np.ndarray, cost: np.ndarray) -> Check:
    """Whether answers cost what they should, as the CPU's raster says, and no more than the start."""
    objective = load.objective(len(pose) + 1, "raster", "cpu")
    objective.pose.assign(np.concatenate([pose, start_of(load).pose[None].astype(np.float32)]))
    expected = objective.evaluate(len(pose) + 1).numpy()
    apart = float(np.abs(expected[:-1] - cost).max())
    better = bool(np.all(cost <= expected[-1] + COST_APART))
    words = f"cost {expected[-1]:.3f} to {cost.max():.3f}, {apart:.1g} off the CPU's raster"
    return Check(words, apart <= COST_APART and better)


def frames(load: Workload, device: str, threads: int) -> Iterator[list[Case]]:
    """Frames from memory, from masks to the answer, of one run."""
    for algorithm in ("h-cmaes", "cmaes"):
        trackers = [_tracker(load, algorithm, renderer, 1, _BUDGET, device, threads) for renderer in RENDERERS]
        yield [_frame_case(FRAME, load, tracker, partial(_frame_is_right, load, tracker)) for tracker in trackers]


def same_frames(
    load: Workload, runs: Sequence[int], budget: int, device: str, threads: int, group: str = FRAME
) -> Iterator[list[Case]]:
    """The same of H-CMA-ES for numbers of runs at once."""
    for renderer in RENDERERS:
        alone = _tracker(load, "h-cmaes", renderer, 1, budget, device, threads)
        trackers = [_tracker(load, "h-cmaes", renderer, number, budget, device, threads) for number in runs]
        yield [_frame_case(group, load, many, partial(_same_run, load, alone, many)) for many in trackers]


def _tracker(
    load: Workload, algorithm: str, renderer: str, runs: int, evaluations: int, device: str, threads: int
) -> Tracker:
    config = TrackConfig(
        algorithm=algorithm, renderer=renderer, runs=runs, evaluations=evaluations, device=device, threads=threads
    )
    return Tracker(start_of(load), load.rig, config, FPS)


def _frame_is_right(load: Workload, tracker: Tracker) -> Check:
    answer = tracker.step(load.observation)
    return _cost_is_right(load, answer.pose, answer.cost)


def _frame_case(group: str, load: Workload, tracker: Tracker, check: Callable[[], Check]) -> Case:
    config, dof = tracker.config, len(load.body.skeleton.searched(tracker.config.dof))
    sizes: dict[str, Any] = {"renderer": config.renderer, "dof": dof, "budget": config.budget, "runs": config.runs}
    sizes |= ({"threads": config.threads} if tracker.device == "cpu" else {}) | load.sizes
    work, evaluations = partial(tracker.step, load.observation), config.budget * config.runs
    return Case(group, config.algorithm, sizes, work, check, evaluations, captured=False)


def _same_run(load: Workload, one: Tracker, many: Tracker) -> Check:
    """Whether the first of many runs has the same bits as that run alone."""
    for tracker in (one, many):
        runs = tracker.config.runs
        pose = np.repeat(start_of(load).pose[None].astype(np.float32), runs, axis=0)
        tracker.state = TrackState(pose, np.zeros(runs, np.int32))
    alone, first = one.step(load.observation).pose[0], many.step(load.observation).pose[0]
    same = bool(np.array_equal(alone, first))
    return Check("run 0 has the same bits alone" if same else "run 0 differs when alone", same)
