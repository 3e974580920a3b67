"""Minimise any batched cost over Warp arrays with any of the optimizers; see docs/algorithms.md for an example."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import warp as wp

from mmocap_warp.kernels.optimizers.populations import SearchSpace, make_space
from mmocap_warp.optimizers.cma_es import CmaEs
from mmocap_warp.optimizers.search import BatchedCost, Optimizer, Search


@dataclass(frozen=True)
class Minimum:
    """The answers of a batch of runs."""

    x: np.ndarray  # (run, coordinate) float32
    cost: np.ndarray  # (run,) float32
    evaluations: int  # spent by each run, at most the budget


_Cost = Callable[[wp.array[wp.float32], wp.array[wp.float32]], None]


def minimize(
    cost: _Cost,
    start: np.ndarray,
    radius: np.ndarray | float,
    evaluations: int,
    *,
    optimizer: Callable[[SearchSpace, int], Optimizer] = CmaEs,
    runs: int = 1,
    seed: int = 0,
    bounds: np.ndarray | None = None,
    device: str = "cpu",
) -> Minimum:
    """Minimise ``cost`` from ``start``, over ``runs`` independent runs at once.

    Args:
        cost: called with ``(x, out)``: x is (candidate, coordinate) float32, out (candidate,) float32, both on the
            device; launch a kernel that fills ``out``. Infinite costs are allowed, NaN is not.
        start: (coordinate,) where every run starts.
        radius: of the search, one for all coordinates or (coordinate,): CMA-ES's first step size, half the width of
            DE's box, the spread of PSO's swarm and of the annealed filter's first layer. Where it is 0, nothing moves.
        evaluations: budget of each run, never exceeded. An answer that is an estimate, as the annealed filter's, is
            judged once more, so that its cost is known.
        optimizer: a class of this package, or another that follows its protocol; ``functools.partial(De, config=...)``
            for settings of its own.
        runs: independent runs; run r uses ``seed + r``.
        seed: of the first run.
        bounds: (coordinate, 2) lowest and highest value, or None; candidates are clamped before they are judged.
        device: a Warp device.

    Raises:
        ValueError: a budget or number of runs below 1, arrays that do not fit together, a start outside the bounds,
            a negative radius, or values that are not finite.
    """
    start = np.asarray(start, np.float32)
    if start.ndim != 1 or not len(start):
        raise ValueError(f"start must be (coordinate,), got shape {start.shape}")
    if evaluations < 1 or runs < 1:
        raise ValueError(f"evaluations and runs must be at least 1, got {evaluations} and {runs}")
    if not 0 <= seed <= 2**31 - runs:
        raise ValueError(f"seed must be in 0 .. 2^31 - runs, got {seed}")
    limits = np.tile([-np.inf, np.inf], (len(start), 1)) if bounds is None else np.asarray(bounds, float)
    if limits.shape != (len(start), 2):
        raise ValueError(f"bounds must be ({len(start)}, 2), got {limits.shape}")
    lower, upper = limits.T.astype(np.float32)
    if not (np.isfinite(start).all() and np.all((lower <= start) & (start <= upper))):
        raise ValueError(f"start must be finite and within its bounds, got {start.tolist()}")
    radii = np.broadcast_to(np.asarray(radius, float), start.shape)
    if not (np.isfinite(radii).all() and np.all(radii >= 0.0)):
        raise ValueError(f"radius must be finite and not negative, got {radius}")
    seeds = wp.array(seed + np.arange(runs), dtype=wp.int32, device=device)
    counter = wp.zeros(runs, dtype=wp.int32, device=device)
    engine = optimizer(make_space(np.arange(len(start)), radii, seeds, counter), evaluations)
    candidates = _Candidates(cost, runs * engine.particles, len(start), device)
    search = Search(candidates, [engine], evaluations, limits)
    search.best_pose.assign(np.repeat(start[None], runs, axis=0))
    search.run()
    if not engine.returns_best:
        wp.copy(candidates.pose, search.best_pose, count=search.best_pose.size)
        wp.copy(search.best_cost, candidates.evaluate(runs), count=runs)
    return Minimum(search.best_pose.numpy().copy(), search.best_cost.numpy().copy(), search.evaluations)


class _Candidates(BatchedCost):
    """A user's cost as the search wants it: candidates are judged whole."""

    def __init__(self, cost: _Cost, candidates: int, coordinates: int, device: str) -> None:
        self.device = device
        self.pose = wp.zeros((candidates, coordinates), dtype=wp.float32, device=device)
        self._cost = cost
        self._out = wp.zeros(candidates, dtype=wp.float32, device=device)

    def evaluate(self, candidates: int) -> wp.array[wp.float32]:
        self._cost(self.pose[:candidates], self._out[:candidates])
        return self._out
