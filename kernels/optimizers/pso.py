"""Particle swarm optimization on the device, a batch of runs at a time: the initial swarm, what it remembers, its move.

Equations are those of the paper's Section 4.2.3 as settled in ``docs/algorithms.md``.
"""

import warp as wp

from mmocap_warp.kernels.optimizers.populations import advance

wp.set_module_options({"enable_backward": False})


@wp.struct
class PsoConstants:
    """Settings of a search."""

    phi_1: float  # pull of a particle's own best position
    phi_2: float  # pull of the swarm's
    inertia_max: float  # of the first move
    log_inertia_fall: float  # ln(inertia_max / inertia_min)
    inertia_changes: float  # g_max of Eq. 19
    velocity_limit: float  # in units of the search's scale


@wp.kernel
def _start(
    settings: PsoConstants,
    seed: wp.array[wp.int32],  # (run,)
    draw: wp.array[wp.int32],  # (run,) random streams used so far
    pose: wp.array2d[wp.float32],  # (run, coordinate)
    index: wp.array[wp.int32],  # (dof,) coordinates that are searched
    scale: wp.array[wp.float32],  # (dof,)
    # out
    x: wp.array3d[wp.float32],  # (run, particle, dof)
    v: wp.array3d[wp.float32],  # (run, particle, dof)
    own_best: wp.array3d[wp.float32],  # (run, particle, dof)
    own_cost: wp.array2d[wp.float32],  # (run, particle)
    generation: wp.array[wp.int32],  # (run,)
    leader: wp.array[wp.int32],  # (run,)
):
    run, k = wp.tid()
    state = wp.rand_init(seed[run], draw[run] + k)
    for i in range(index.shape[0]):
        position = pose[run, index[i]] + scale[i] * wp.randn(state)
        x[run, k, i] = position
        own_best[run, k, i] = position
    for i in range(index.shape[0]):
        v[run, k, i] = settings.velocity_limit * scale[i] * (2.0 * wp.randf(state) - 1.0)
    own_cost[run, k] = wp.inf
    if k == 0:
        generation[run] = 0
        leader[run] = 0


def start(settings, seed, draw, pose, index, scale, x, v, own_best, own_cost, generation, leader):
    """Begin anew: ``x ~ N(pose[:, index], scale)``, ``v`` uniform within its limit, nothing remembered."""
    wp.launch(
        _start,
        dim=own_cost.shape,
        inputs=[settings, seed, draw, pose, index, scale],
        outputs=[x, v, own_best, own_cost, generation, leader],
        device=x.device,
    )
    advance(draw, x.shape[1])


@wp.kernel
def _remember_positions(
    cost: wp.array[wp.float32],  # (candidate,)
    x: wp.array3d[wp.float32],  # (run, particle, dof)
    own_cost: wp.array2d[wp.float32],  # (run, particle)
    # in and out
    own_best: wp.array3d[wp.float32],  # (run, particle, dof)
):
    run, k, i = wp.tid()
    if cost[run * x.shape[1] + k] < own_cost[run, k]:
        own_best[run, k, i] = x[run, k, i]


@wp.kernel
def _follow_leader(
    cost: wp.array[wp.float32],  # (candidate,)
    # in and out
    own_cost: wp.array2d[wp.float32],  # (run, particle)
    generation: wp.array[wp.int32],  # (run,) generations learnt from
    # out
    leader: wp.array[wp.int32],  # (run,)
):
    run = wp.tid()
    particles = own_cost.shape[1]
    first = int(0)
    for k in range(particles):
        own_cost[run, k] = wp.min(own_cost[run, k], cost[run * particles + k])
        if own_cost[run, k] < own_cost[run, first]:
            first = k
    leader[run] = first
    generation[run] = generation[run] + 1


def remember(cost, x, own_best, own_cost, generation, leader):
    """Keep each particle's best position, ``p``, and whose of them is the swarm's, ``b``; the first of equals."""
    device = x.device
    wp.launch(_remember_positions, dim=x.shape, inputs=[cost, x, own_cost], outputs=[own_best], device=device)
    wp.launch(
        _follow_leader, dim=leader.shape, inputs=[cost], outputs=[own_cost, generation, leader], device=device
    )  # fmt: skip


@wp.kernel
def _draw_uniform(
    seed: wp.array[wp.int32],  # (run,)
    draw: wp.array[wp.int32],  # (run,)
    # out
    r_1: wp.array3d[wp.float32],  # (run, particle, dof)
    r_2: wp.array3d[wp.float32],  # (run, particle, dof)
):
    run, k = wp.tid()
    state = wp.rand_init(seed[run], draw[run] + k)
    for i in range(r_1.shape[2]):
        r_1[run, k, i] = wp.randf(state)
        r_2[run, k, i] = wp.randf(state)


def draw_uniform(seed, draw, r_1, r_2):
    """Draw both random factors of Eq. 18 from [0, 1), one a dimension; ``draw`` advances by the particles."""
    runs, particles, _dofs = r_1.shape
    wp.launch(_draw_uniform, dim=(runs, particles), inputs=[seed, draw], outputs=[r_1, r_2], device=r_1.device)
    advance(draw, particles)


@wp.kernel
def _move(
    settings: PsoConstants,
    scale: wp.array[wp.float32],  # (dof,)
    generation: wp.array[wp.int32],  # (run,)
    own_best: wp.array3d[wp.float32],  # (run, particle, dof)
    leader: wp.array[wp.int32],  # (run,)
    r_1: wp.array3d[wp.float32],  # (run, particle, dof)
    r_2: wp.array3d[wp.float32],  # (run, particle, dof)
    # in and out
    x: wp.array3d[wp.float32],  # (run, particle, dof)
    v: wp.array3d[wp.float32],  # (run, particle, dof)
    # out
    inertia: wp.array[wp.float32],  # (run,)
):
    run, k, i = wp.tid()
    changes = wp.min(float(generation[run] - 1) / settings.inertia_changes, 1.0)
    w = settings.inertia_max * wp.exp(-settings.log_inertia_fall * changes)  # Eq. 19
    position = x[run, k, i]
    to_own = own_best[run, k, i] - position
    to_leader = own_best[run, leader[run], i] - position
    velocity = w * v[run, k, i] + settings.phi_1 * r_1[run, k, i] * to_own  # Eq. 18
    velocity += settings.phi_2 * r_2[run, k, i] * to_leader
    limit = settings.velocity_limit * scale[i]
    velocity = wp.clamp(velocity, -limit, limit)
    v[run, k, i] = velocity
    x[run, k, i] = position + velocity  # Eq. 17
    if k == 0 and i == 0:
        inertia[run] = w


def move(settings, scale, generation, own_best, leader, r_1, r_2, x, v, inertia):
    """Fly on: ``v = w v + phi_1 r_1 (p - x) + phi_2 r_2 (b - x)`` within its limit, ``x = x + v``."""
    wp.launch(
        _move,
        dim=x.shape,
        inputs=[settings, scale, generation, own_best, leader, r_1, r_2],
        outputs=[x, v, inertia],
        device=x.device,
    )


@wp.kernel
def _take_best(
    own_best: wp.array3d[wp.float32],  # (run, particle, dof)
    leader: wp.array[wp.int32],  # (run,)
    index: wp.array[wp.int32],  # (dof,)
    # out
    pose: wp.array2d[wp.float32],  # (run, coordinate)
):
    run, i = wp.tid()
    pose[run, index[i]] = own_best[run, leader[run], i]


def take_best(own_best, leader, index, pose):
    """Write the swarm's best position: ``pose[:, index] = b``."""
    wp.launch(
        _take_best,
        dim=(leader.shape[0], index.shape[0]),
        inputs=[own_best, leader, index],
        outputs=[pose],
        device=pose.device,
    )
