"""CMA-ES on the device, a batch of runs at a time: sampling, ranking, paths, covariance, eigenvectors.

Equations and misprints are those of the paper's Section 4 as settled in ``docs/algorithms.md``.
"""

import warp as wp

from mmocap_warp.kernels.eigen import decompose
from mmocap_warp.kernels.populations import advance

wp.set_module_options({"enable_backward": False})

_WIDEST = wp.constant(1.0e8)  # sigma; costs that stay flat would widen it until candidates overflow


@wp.struct
class CmaEsConstants:
    """Table 2, for a search in D dimensions."""

    mu: int  # parents
    mu_eff: float
    c_sigma: float
    d_sigma: float
    c_c: float
    c_cov: float
    mu_cov: float
    chi_n: float  # expected length of a standard normal vector
    flat_rank: int  # equal costs up to this rank mean a flat neighbourhood


@wp.kernel
def _start(
    pose: wp.array2d[wp.float32],  # (run, coordinate)
    index: wp.array[wp.int32],  # (dof,) coordinates that are searched
    sigma_start: float,
    # out
    mean: wp.array2d[wp.float32],  # (run, dof)
    sigma: wp.array[wp.float32],  # (run,)
    p_sigma: wp.array2d[wp.float32],  # (run, dof)
    p_c: wp.array2d[wp.float32],  # (run, dof)
    covariance: wp.array3d[wp.float32],  # (run, dof, dof)
    axes: wp.array3d[wp.float32],  # (run, dof, dof) eigenvectors, columns
    lengths: wp.array2d[wp.float32],  # (run, dof) square roots of the eigenvalues
    generation: wp.array[wp.int32],  # (run,)
):
    run, i = wp.tid()
    mean[run, i] = pose[run, index[i]]
    p_sigma[run, i] = 0.0
    p_c[run, i] = 0.0
    lengths[run, i] = 1.0
    for j in range(index.shape[0]):
        unit = wp.where(i == j, 1.0, 0.0)
        covariance[run, i, j] = unit
        axes[run, i, j] = unit
    if i == 0:
        sigma[run] = sigma_start
        generation[run] = 0


def start(pose, index, sigma_start, mean, sigma, p_sigma, p_c, covariance, axes, lengths, generation):
    """Begin anew at ``pose[:, index]``: ``C = I``, zero paths, ``sigma = sigma_start``."""
    wp.launch(
        _start,
        dim=mean.shape,
        inputs=[pose, index, sigma_start],
        outputs=[mean, sigma, p_sigma, p_c, covariance, axes, lengths, generation],
        device=mean.device,
    )


@wp.kernel
def _sample(
    seed: wp.array[wp.int32],  # (run,)
    draw: wp.array[wp.int32],  # (run,) candidates drawn so far, each from a random stream of its own
    mean: wp.array2d[wp.float32],  # (run, dof)
    sigma: wp.array[wp.float32],  # (run,)
    axes: wp.array3d[wp.float32],  # (run, dof, dof)
    lengths: wp.array2d[wp.float32],  # (run, dof)
    scale: wp.array[wp.float32],  # (dof,)
    # out
    z: wp.array3d[wp.float32],  # (run, particle, dof)
    y: wp.array3d[wp.float32],  # (run, particle, dof)
    x: wp.array3d[wp.float32],  # (run, particle, dof)
):
    run, k = wp.tid()
    dofs = mean.shape[1]
    state = wp.rand_init(seed[run], draw[run] + k)
    for i in range(dofs):
        z[run, k, i] = wp.randn(state)
    for i in range(dofs):
        step = float(0.0)
        for j in range(dofs):
            step += axes[run, i, j] * lengths[run, j] * z[run, k, j]
        y[run, k, i] = step
        x[run, k, i] = mean[run, i] + sigma[run] * scale[i] * step


def sample(seed, draw, mean, sigma, axes, lengths, scale, particles, z, y, x):
    """Draw ``x = mean + sigma * scale * y`` with ``y = B D z ~ N(0, C)``; ``draw`` advances by ``particles``."""
    wp.launch(
        _sample,
        dim=(mean.shape[0], particles),
        inputs=[seed, draw, mean, sigma, axes, lengths, scale],
        outputs=[z, y, x],
        device=mean.device,
    )
    advance(draw, particles)


@wp.kernel
def _rank(
    cost: wp.array[wp.float32],  # (candidate,)
    # out
    order: wp.array2d[wp.int32],  # (run, rank) particles, the best first
):
    run, k = wp.tid()
    particles = order.shape[1]
    mine = cost[run * particles + k]
    rank = int(0)
    for other in range(particles):
        theirs = cost[run * particles + other]
        if theirs < mine or (theirs == mine and other < k):
            rank += 1
    order[run, rank] = k


@wp.kernel
def _update_paths(
    table: CmaEsConstants,
    weight: wp.array[wp.float32],  # (parent,)
    cost: wp.array[wp.float32],  # (candidate,)
    order: wp.array2d[wp.int32],  # (run, rank)
    z: wp.array3d[wp.float32],  # (run, particle, dof)
    y: wp.array3d[wp.float32],  # (run, particle, dof)
    axes: wp.array3d[wp.float32],  # (run, dof, dof)
    scale: wp.array[wp.float32],  # (dof,)
    # in and out
    mean: wp.array2d[wp.float32],  # (run, dof)
    sigma: wp.array[wp.float32],  # (run,)
    p_sigma: wp.array2d[wp.float32],  # (run, dof)
    p_c: wp.array2d[wp.float32],  # (run, dof)
    generation: wp.array[wp.int32],  # (run,)
    # out
    stalled: wp.array[wp.float32],  # (run,) 1 - h_sigma
):
    run = wp.tid()
    dofs = mean.shape[1]
    particles = order.shape[1]
    generation[run] = generation[run] + 1
    to_sigma = wp.sqrt(table.c_sigma * (2.0 - table.c_sigma) * table.mu_eff)
    length_sq = float(0.0)
    for i in range(dofs):
        whitened = float(0.0)  # C^(-1/2) (m' - m) / sigma = B <z>
        for j in range(dofs):
            mean_z = float(0.0)
            for r in range(table.mu):
                mean_z += weight[r] * z[run, order[run, r], j]
            whitened += axes[run, i, j] * mean_z
        path = (1.0 - table.c_sigma) * p_sigma[run, i] + to_sigma * whitened  # Eq. 11
        p_sigma[run, i] = path
        length_sq += path * path
    relative = wp.sqrt(length_sq) / table.chi_n
    unbiased = relative / wp.sqrt(1.0 - wp.pow(1.0 - table.c_sigma, 2.0 * float(generation[run])))
    h_sigma = wp.where(unbiased < 1.4 + 2.0 / (float(dofs) + 1.0), 1.0, 0.0)
    stalled[run] = 1.0 - h_sigma
    to_c = h_sigma * wp.sqrt(table.c_c * (2.0 - table.c_c) * table.mu_eff)
    for i in range(dofs):
        step = float(0.0)  # (m' - m) / sigma
        for r in range(table.mu):
            step += weight[r] * y[run, order[run, r], i]
        p_c[run, i] = (1.0 - table.c_c) * p_c[run, i] + to_c * step  # Eq. 13
        mean[run, i] = mean[run, i] + sigma[run] * scale[i] * step  # Eq. 10
    grown = sigma[run] * wp.exp(table.c_sigma / table.d_sigma * (relative - 1.0))  # Eq. 12
    best = cost[run * particles + order[run, 0]]
    if best == cost[run * particles + order[run, table.flat_rank]]:
        grown *= wp.exp(0.2 + table.c_sigma / table.d_sigma)  # a flat neighbourhood tells nothing: look further
    sigma[run] = wp.min(grown, _WIDEST)


@wp.kernel
def _update_covariance(
    table: CmaEsConstants,
    weight: wp.array[wp.float32],  # (parent,)
    order: wp.array2d[wp.int32],  # (run, rank)
    y: wp.array3d[wp.float32],  # (run, particle, dof)
    p_c: wp.array2d[wp.float32],  # (run, dof)
    stalled: wp.array[wp.float32],  # (run,)
    # in and out
    covariance: wp.array3d[wp.float32],  # (run, dof, dof)
):
    run, i, j = wp.tid()
    old = covariance[run, i, j]
    rank_one = p_c[run, i] * p_c[run, j] + stalled[run] * table.c_c * (2.0 - table.c_c) * old
    rank_mu = float(0.0)
    for r in range(table.mu):
        k = order[run, r]
        rank_mu += weight[r] * y[run, k, i] * y[run, k, j]
    share = 1.0 / table.mu_cov
    covariance[run, i, j] = (1.0 - table.c_cov) * old + table.c_cov * (share * rank_one + (1.0 - share) * rank_mu)


def update(
    table, weight, cost, order, z, y, scale, mean, sigma, p_sigma, p_c, covariance, axes, lengths, generation,
    stalled, scratch,
):  # fmt: skip
    """One generation: rank, then Eq. 10-14 for mean, paths, sigma and C, then ``C = B D^2 B^T`` for the next draw."""
    device = mean.device
    runs, dofs = mean.shape
    wp.launch(_rank, dim=order.shape, inputs=[cost], outputs=[order], device=device)
    wp.launch(
        _update_paths,
        dim=runs,
        inputs=[table, weight, cost, order, z, y, axes, scale],
        outputs=[mean, sigma, p_sigma, p_c, generation, stalled],
        device=device,
    )
    wp.launch(
        _update_covariance,
        dim=(runs, dofs, dofs),
        inputs=[table, weight, order, y, p_c, stalled],
        outputs=[covariance],
        device=device,
    )
    decompose(covariance, axes, lengths, *scratch)
