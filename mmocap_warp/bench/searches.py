"""The optimizers alone, a generation from ask to tell, and the search of a whole frame."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from operator import attrgetter
from typing import Any

import numpy as np
import warp as wp

from mmocap_warp.bench.workload import Workload
from mmocap_warp.kernels.benchmarks.timing import Case, Check, Measurement, Timing, time_together
from mmocap_warp.kernels.optimizers.populations import make_space
from mmocap_warp.optimizers.search import Optimizer, Search
from mmocap_warp.silhouettes import RENDERERS
from mmocap_warp.tracking.algorithms import ALGORITHMS
from mmocap_warp.tracking.pose_search import Part, hierarchical, holistic
from mmocap_warp.tracking.track_config import TrackConfig
from mmocap_warp.tracking.tracker import Tracker, TrackState

OPTIMIZER, GENERATION, FRAME = "ask and tell", "a generation", "a frame"
COST_APART = 1e-5
"""How far the cost of an answer may be from that of the same pose on the CPU."""

_BUDGET = 500
_LONGER_BY = 5  # by which the longer of two searches exceeds the shorter
_SPHERE_GENERATIONS = 40  # after these an optimizer must be nearer to the minimum of a sphere


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


def _optimizer(name: str, part: Part, radius: float, runs: int, evaluations: int, device: str) -> Optimizer:
    seed = wp.array(np.arange(runs), dtype=wp.int32, device=device)
    counter = wp.zeros(runs, dtype=wp.int32, device=device)
    space = make_space(part.index, np.full(len(part.index), radius), seed, counter)
    return ALGORITHMS[name].optimizer(space, evaluations)


def _ask_and_tell(load: Workload, name: str, part: Part, runs: int, device: str) -> Case:
    optimizer = _optimizer(name, part, 0.5, runs, _BUDGET, device)
    particles = optimizer.particles
    start = wp.array(np.ones((runs, load.body.skeleton.coordinates)), dtype=wp.float32, device=device)
    made_up = np.random.default_rng(0).uniform(0.1, 0.9, runs * particles)
    cost = wp.array(made_up, dtype=wp.float32, device=device)
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
    skeleton = load.body.skeleton
    sizes = load.sizes_on(device, threads)
    for renderer in RENDERERS:
        parts = [_generation(load, part, renderer, sizes, device, threads, seconds) for part in hierarchical(skeleton)]
        mean = _mean(parts, "h-cmaes: mean of the parts")
        yield [*parts, mean, _generation(load, holistic(skeleton)[0], renderer, sizes, device, threads, seconds)]


def _generation(
    load: Workload, part: Part, renderer: str, sizes: dict[str, Any], device: str, threads: int, seconds: float | None
) -> Measurement:
    name = "cmaes" if len(part.index) == len(load.body.skeleton.searched()) else "h-cmaes"
    short, long = (_search(load, name, part, n, renderer, device, threads) for n in (1, 1 + _LONGER_BY))
    particles = (long.evaluations - short.evaluations) // _LONGER_BY
    one, many = time_together([short.run, long.run], device, seconds=seconds)
    samples = tuple((b - a) / _LONGER_BY for a, b in zip(one.samples, many.samples, strict=True))
    launched = None if many.launched is None or one.launched is None else (many.launched - one.launched) / _LONGER_BY
    compiling = one.compiling + many.compiling
    timing = Timing(samples, (many.processor - one.processor) / _LONGER_BY, compiling, launched)
    sizes = {"renderer": renderer, "dof": len(part.index), "candidates": particles, "runs": 1} | sizes

    def check() -> Check:
        return _cost_is_right(load, long.best_pose.numpy(), long.best_cost.numpy())

    case = Case(GENERATION, f"{name}: {part.name}", sizes, long.run, check, particles)
    return replace(Measurement.of(case, timing), lowest=(many.lowest - one.lowest) / _LONGER_BY)


def _search(
    load: Workload, name: str, part: Part, generations: int, renderer: str, device: str, threads: int
) -> Search:
    radius, _translation = TrackConfig(algorithm=name).radii(load.fps)
    optimizer = _optimizer(name, part, radius, 1, _BUDGET, device)
    objective = load.objective(optimizer.particles, renderer, device, threads)
    search = Search(objective, [optimizer], 1 + generations * optimizer.particles, load.body.skeleton.coordinate_limits)
    search.best_pose.assign(load.subject.pose[None].astype(np.float32))
    return search


def _mean(parts: list[Measurement], name: str) -> Measurement:
    """The mean of measurements that are steps of one thing."""

    def mean(of: Callable[[Measurement], float]) -> float:
        return sum(map(of, parts)) / len(parts)

    times: dict[str, Any] = {name: mean(attrgetter(name)) for name in ("median", "lowest", "processor")}
    return replace(
        parts[0],
        name=name,
        sizes={key: value for key, value in parts[0].sizes.items() if key not in ("dof", "candidates")},
        evaluations=round(mean(lambda part: part.evaluations)),
        quartiles=(mean(lambda part: part.quartiles[0]), mean(lambda part: part.quartiles[1])),
        launched=None if parts[0].launched is None else mean(lambda part: part.launched or 0.0),
        compiling=sum(part.compiling for part in parts),
        check="those of the parts",
        ok=all(part.ok for part in parts),
        **times,
    )


def _cost_is_right(load: Workload, pose: np.ndarray, cost: np.ndarray) -> Check:
    """Whether answers cost what they should, as the CPU's raster says, and no more than the start."""
    objective = load.objective(len(pose) + 1, "raster", "cpu")
    objective.pose.assign(np.concatenate([pose, load.subject.pose[None].astype(np.float32)]))
    expected = objective.evaluate(len(pose) + 1).numpy()
    apart = float(np.abs(expected[:-1] - cost).max())
    better = bool(np.all(cost <= expected[-1] + COST_APART))
    words = f"cost {expected[-1]:.3f} to {cost.max():.3f}, {apart:.1g} off the CPU's raster"
    return Check(words, apart <= COST_APART and better)


def frames(load: Workload, device: str, threads: int) -> Iterator[list[Case]]:
    """Frames from memory, from masks to the answer, of one run."""
    for algorithm in ("h-cmaes", "cmaes"):
        yield [_frame(load, algorithm, renderer, device, threads) for renderer in RENDERERS]


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
    return Tracker(load.subject, load.rig, config, load.fps)


def _frame(load: Workload, algorithm: str, renderer: str, device: str, threads: int) -> Case:
    tracker = _tracker(load, algorithm, renderer, 1, _BUDGET, device, threads)

    def check() -> Check:
        answer = tracker.step(load.observation)
        return _cost_is_right(load, answer.pose, answer.cost)

    return _frame_case(FRAME, load, tracker, check)


def _frame_case(group: str, load: Workload, tracker: Tracker, check: Callable[[], Check]) -> Case:
    config, dof = tracker.config, len(load.body.skeleton.searched(tracker.config.dof))
    sizes: dict[str, Any] = {"renderer": config.renderer, "dof": dof, "budget": config.budget, "runs": config.runs}
    threads = {"threads": config.threads} if tracker.device == "cpu" else {}
    work, evaluations = partial(tracker.step, load.observation), config.budget * config.runs
    return Case(group, config.algorithm, sizes | threads | load.sizes, work, check, evaluations, captured=False)


def _same_run(load: Workload, one: Tracker, many: Tracker) -> Check:
    """Whether the first of many runs has the same bits as that run alone."""
    for tracker in (one, many):
        runs = tracker.config.runs
        pose = np.repeat(load.subject.pose[None].astype(np.float32), runs, axis=0)
        tracker.state = TrackState(pose, np.zeros(runs, np.int32))
    alone, first = one.step(load.observation).pose[0], many.step(load.observation).pose[0]
    same = bool(np.array_equal(alone, first))
    return Check("run 0 has the same bits alone" if same else "run 0 differs when alone", same)
