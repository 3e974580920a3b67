"""Particle swarm optimization on the device, a batch of runs at a time: the initial swarm, what it remembers, its move.

Equations are those of the paper's Section 4.2.3 as settled in ``docs/algorithms.md``.
"""

from typing import Any

import warp as wp

from mmocap_warp.kernels.optimizers.populations import SearchSpace, advance, random_stream
from mmocap_warp.kernels.structs import allocated

wp.set_module_options({"enable_backward": False})


@wp.struct
class PsoParameters:
    """What does not change during a search."""

    phi_1: float  # pull of a particle's own best position
    phi_2: float  # pull of the swarm's
    inertia_max: float  # of the first move
    log_inertia_fall: float  # ln(inertia_max / inertia_min)
    inertia_changes: float  # g_max of Eq. 19
    velocity_limit: float  # in units of the search's radius


@wp.struct
class PsoState:
    """What a generation hands to the next, and the random numbers of its move."""

    x: wp.array3d[wp.float32]  # (run, particle, dof)
    v: wp.array3d[wp.float32]  # (run, particle, dof)
    own_best: wp.array3d[wp.float32]  # (run, particle, dof)
    own_cost: wp.array2d[wp.float32]  # (run, particle)
    leader: wp.array[wp.int32]  # (run,) the particle with the swarm's best position
    generation: wp.array[wp.int32]  # (run,) generations learnt from
    inertia: wp.array[wp.float32]  # (run,) of the last move
    r_1: wp.array3d[wp.float32]  # (run, particle, dof) in [0, 1)
    r_2: wp.array3d[wp.float32]  # (run, particle, dof) in [0, 1)


def make_state(population: wp.array[wp.float32]) -> Any:
    """Arrays for a search that writes its candidates to ``population`` (run, particle, dof)."""
    runs, particles, _ = population.shape
    by_run = dict.fromkeys(("leader", "generation", "inertia"), runs)
    by_dof = dict.fromkeys(("v", "own_best", "r_1", "r_2"), population.shape)
    return allocated(PsoState, population.device, x=population, own_cost=(runs, particles), **by_run, **by_dof)


@wp.kernel
def _start(
    space: SearchSpace,
    parameters: PsoParameters,
    pose: wp.array2d[wp.float32],  # (run, coordinate)
    # out
    state: PsoState,
) -> None:
    run, k = wp.tid()
    random = random_stream(space, run, k)
    for i in range(space.index.shape[0]):
        position = pose[run, space.index[i]] + space.radius[i] * wp.randn(random)
        state.x[run, k, i] = position
        state.own_best[run, k, i] = position
    for i in range(space.index.shape[0]):
        state.v[run, k, i] = parameters.velocity_limit * space.radius[i] * (2.0 * wp.randf(random) - 1.0)
    state.own_cost[run, k] = wp.inf
    if k == 0:
        state.generation[run] = 0
        state.leader[run] = 0


def start(space: SearchSpace, parameters: PsoParameters, pose: wp.array[wp.float32], state: PsoState) -> None:
    """Begin anew: ``x ~ N(pose[:, index], radius)``, ``v`` uniform within its limit, nothing remembered."""
    particles = state.own_cost.shape
    wp.launch(_start, particles, [space, parameters, pose], [state], device=pose.device)
    advance(space.counter, particles[1])


@wp.kernel
def _remember_positions(
    cost: wp.array[wp.float32],  # (candidate,)
    # in and out
    state: PsoState,
) -> None:
    run, k, i = wp.tid()
    if cost[run * state.x.shape[1] + k] < state.own_cost[run, k]:
        state.own_best[run, k, i] = state.x[run, k, i]


@wp.kernel
def _follow_leader(
    cost: wp.array[wp.float32],  # (candidate,)
    # in and out
    state: PsoState,
) -> None:
    run = wp.tid()
    particles = state.own_cost.shape[1]
    first = int(0)
    for k in range(particles):
        state.own_cost[run, k] = wp.min(state.own_cost[run, k], cost[run * particles + k])
        if state.own_cost[run, k] < state.own_cost[run, first]:
            first = k
    state.leader[run] = first
    state.generation[run] = state.generation[run] + 1


def remember(cost: wp.array[wp.float32], state: PsoState) -> None:
    """Keep each particle's best position, ``p``, and whose of them is the swarm's, ``b``; the first of equals."""
    device = cost.device
    wp.launch(_remember_positions, state.x.shape, [cost], [state], device=device)
    wp.launch(_follow_leader, state.leader.shape, [cost], [state], device=device)


@wp.kernel
def _sample_factors(
    space: SearchSpace,
    # out
    state: PsoState,
) -> None:
    run, k = wp.tid()
    random = random_stream(space, run, k)
    for i in range(state.r_1.shape[2]):
        state.r_1[run, k, i] = wp.randf(random)
        state.r_2[run, k, i] = wp.randf(random)


def sample_factors(space: SearchSpace, state: PsoState) -> None:
    """Sample both random factors of Eq. 18 from [0, 1), one a dimension."""
    particles = state.own_cost.shape
    wp.launch(_sample_factors, particles, [space], [state], device=space.seed.device)
    advance(space.counter, particles[1])


@wp.kernel
def _move(
    space: SearchSpace,
    parameters: PsoParameters,
    # in and out
    state: PsoState,
) -> None:
    run, k, i = wp.tid()
    changes = wp.min(float(state.generation[run] - 1) / parameters.inertia_changes, 1.0)
    w = parameters.inertia_max * wp.exp(-parameters.log_inertia_fall * changes)  # Eq. 19
    position = state.x[run, k, i]
    to_own = state.own_best[run, k, i] - position
    to_leader = state.own_best[run, state.leader[run], i] - position
    velocity = w * state.v[run, k, i] + parameters.phi_1 * state.r_1[run, k, i] * to_own  # Eq. 18
    velocity += parameters.phi_2 * state.r_2[run, k, i] * to_leader
    limit = parameters.velocity_limit * space.radius[i]
    velocity = wp.clamp(velocity, -limit, limit)
    state.v[run, k, i] = velocity
    state.x[run, k, i] = position + velocity  # Eq. 17
    if k == 0 and i == 0:
        state.inertia[run] = w


def move(space: SearchSpace, parameters: PsoParameters, state: PsoState) -> None:
    """Fly on: ``v = w v + phi_1 r_1 (p - x) + phi_2 r_2 (b - x)`` within its limit, ``x = x + v``."""
    wp.launch(_move, state.x.shape, [space, parameters], [state], device=space.seed.device)
