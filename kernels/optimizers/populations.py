"""What all optimizers share: what is searched, random numbers, and the way from candidates to full vectors."""

from typing import Any

import numpy as np
import warp as wp

from mmocap_warp.kernels.block import lanes_of, sync
from mmocap_warp.kernels.structs import allocated

wp.set_module_options({"enable_backward": False})


@wp.struct
class SearchSpace:
    """The coordinates that a batch of independent runs searches, and where each run's random numbers come from."""

    index: wp.array[wp.int32]  # (dof,) coordinates of a full vector that are searched
    radius: wp.array[wp.float32]  # (dof,) how far the search reaches in each of them
    seed: wp.array[wp.int32]  # (run,)
    counter: wp.array[wp.int32]  # (run,) random streams used so far; the parts of one search share it


def make_space(index: np.ndarray, radius: np.ndarray, seed: wp.array[wp.int32], counter: wp.array[wp.int32]) -> Any:
    """A search of coordinates ``index`` (dof,) within ``radius`` (dof,), on the device of its seeds."""
    return allocated(SearchSpace, seed.device, index=index, radius=radius, seed=seed, counter=counter)


def make_population(space: SearchSpace, particles: int) -> wp.array[wp.float32]:
    """Candidates (run, particle, dof), zeros."""
    shape = (space.seed.shape[0], particles, space.index.shape[0])
    return wp.zeros(shape, dtype=wp.float32, device=space.seed.device)


@wp.func
def random_stream(space: SearchSpace, run: int, k: int) -> wp.uint32:
    """The random numbers of a run's ``k``-th candidate from now on, for ``wp.randf`` and ``wp.randn``."""
    return wp.rand_init(space.seed[run], space.counter[run] + k)


@wp.kernel
def _advance(
    streams: int,
    # in and out
    counter: wp.array[wp.int32],  # (run,)
) -> None:
    run = wp.tid()
    counter[run] = counter[run] + streams


def advance(counter: wp.array[wp.int32], streams: int) -> None:
    """Count random streams that were used, so that none is used again: ``counter[run] += streams``."""
    wp.launch(_advance, counter.shape, [streams], [counter], device=counter.device)


@wp.struct
class Limits:
    """The lowest and the highest value of every coordinate of a full vector; infinite where free."""

    lower: wp.array[wp.float32]  # (coordinate,)
    upper: wp.array[wp.float32]  # (coordinate,)


def make_limits(limits: np.ndarray, device: wp.DeviceLike) -> Any:
    """From (coordinate, 2)."""
    return allocated(Limits, device, lower=limits[:, 0], upper=limits[:, 1])


@wp.kernel
def _place(
    population: wp.array3d[wp.float32],  # (run, particle, dof)
    index: wp.array[wp.int32],  # (dof,)
    base: wp.array2d[wp.float32],  # (run, coordinate)
    limits: Limits,
    particles: int,
    lanes: int,
    # out
    pose: wp.array2d[wp.float32],  # (candidate, coordinate)
) -> None:
    c, lane = wp.tid()
    run = c // particles
    for d in range(lane, base.shape[1], lanes):
        pose[c, d] = base[run, d]
    sync()
    for i in range(lane, index.shape[0], lanes):
        d = index[i]
        pose[c, d] = wp.clamp(population[run, c - run * particles, i], limits.lower[d], limits.upper[d])


def place(
    population: wp.array[wp.float32],
    index: wp.array[wp.int32],
    base: wp.array[wp.float32],
    limits: Limits,
    particles: int,
    pose: wp.array[wp.float32],
) -> None:
    """Write ``particles`` candidates a run into full poses: searched ones within limits, the rest from ``base``."""
    lanes = lanes_of(pose.device)
    dim = (base.shape[0] * particles, lanes)
    wp.launch(
        _place, dim, [population, index, base, limits, particles, lanes], [pose], block_dim=lanes, device=pose.device
    )


@wp.kernel
def _keep_best(
    cost: wp.array[wp.float32],  # (candidate,)
    pose: wp.array2d[wp.float32],  # (candidate, coordinate)
    particles: int,
    lanes: int,
    # in and out
    best_cost: wp.array[wp.float32],  # (run,)
    best_pose: wp.array2d[wp.float32],  # (run, coordinate)
) -> None:
    run, lane = wp.tid()
    lowest = float(best_cost[run])
    winner = int(-1)
    for c in range(run * particles, (run + 1) * particles):
        if cost[c] < lowest:
            lowest = cost[c]
            winner = c
    sync()
    if winner >= 0:
        for d in range(lane, pose.shape[1], lanes):
            best_pose[run, d] = pose[winner, d]
        if lane == 0:
            best_cost[run] = lowest


def keep_best(
    cost: wp.array[wp.float32],
    pose: wp.array[wp.float32],
    particles: int,
    best_cost: wp.array[wp.float32],
    best_pose: wp.array[wp.float32],
) -> None:
    """Let a run's best ever pose be replaced by a strictly better candidate; the first of equals wins."""
    lanes = lanes_of(cost.device)
    dim = (best_cost.shape[0], lanes)
    wp.launch(
        _keep_best, dim, [cost, pose, particles, lanes], [best_cost, best_pose], block_dim=lanes, device=cost.device
    )


@wp.kernel
def _scatter(
    value: wp.array2d[wp.float32],  # (run, dof)
    index: wp.array[wp.int32],  # (dof,)
    # out
    pose: wp.array2d[wp.float32],  # (run, coordinate)
) -> None:
    run, i = wp.tid()
    pose[run, index[i]] = value[run, i]


def scatter(value: wp.array[wp.float32], index: wp.array[wp.int32], pose: wp.array[wp.float32]) -> None:
    """Write searched coordinates back: ``pose[run, index[i]] = value[run, i]``."""
    wp.launch(_scatter, value.shape, [value, index], [pose], device=pose.device)


@wp.kernel
def _clamp(
    limits: Limits,
    # in and out
    pose: wp.array2d[wp.float32],  # (run, coordinate)
) -> None:
    run, d = wp.tid()
    pose[run, d] = wp.clamp(pose[run, d], limits.lower[d], limits.upper[d])


def clamp(limits: Limits, pose: wp.array[wp.float32]) -> None:
    """Keep every coordinate within its limits."""
    wp.launch(_clamp, pose.shape, [limits], [pose], device=pose.device)
