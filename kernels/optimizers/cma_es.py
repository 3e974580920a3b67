"""CMA-ES on the device, a block of lanes for each run: one launch draws a generation, one learns from its costs.

Equations and misprints are those of the paper's Section 4 as settled in ``docs/algorithms.md``. The covariance matrix
``C = B D^2 B^T`` is kept as its eigenvectors and the square roots of its eigenvalues. In the eigenvectors' coordinates
it is diagonal and an offspring's step ``B D z`` is ``D z``: Eq. 14 is worked out there, and what it leaves beside the
diagonal is small.
"""

import warp as wp

from mmocap_warp.kernels.block import WORDS, lanes_of, matrix_at, seat, shared_words, sync
from mmocap_warp.kernels.optimizers.eigen import Spectrum, diagonalize, even, lanes_worth, spectrum_at, spectrum_words

wp.set_module_options({"enable_backward": False})

_WIDEST = wp.constant(1.0e8)  # sigma; costs that stay flat would widen it until candidates overflow
_SMALLEST = wp.constant(1.0e-20)  # eigenvalue
_LARGEST = wp.constant(1.0e16)  # eigenvalue; its square still fits


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


@wp.struct
class CmaEsState:
    """What a generation hands to the next."""

    mean: wp.array2d[wp.float32]  # (run, dof)
    sigma: wp.array[wp.float32]  # (run,)
    p_sigma: wp.array2d[wp.float32]  # (run, dof)
    p_c: wp.array2d[wp.float32]  # (run, dof)
    axes: wp.array3d[wp.float32]  # (run, dof, dof) B^T: an eigenvector a row
    lengths: wp.array2d[wp.float32]  # (run, dof) D: square roots of the eigenvalues
    generation: wp.array[wp.int32]  # (run,)


@wp.kernel
def _start(
    pose: wp.array2d[wp.float32],  # (run, coordinate)
    index: wp.array[wp.int32],  # (dof,) coordinates that are searched
    sigma_start: float,
    # out
    state: CmaEsState,
):
    run, i, j = wp.tid()
    state.axes[run, i, j] = wp.where(i == j, 1.0, 0.0)
    if j == 0:
        state.mean[run, i] = pose[run, index[i]]
        state.p_sigma[run, i] = 0.0
        state.p_c[run, i] = 0.0
        state.lengths[run, i] = 1.0
        if i == 0:
            state.sigma[run] = sigma_start
            state.generation[run] = 0


def start(pose, index, sigma_start, state):
    """Begin anew at ``pose[:, index]``: ``C = I``, zero paths, ``sigma = sigma_start``."""
    wp.launch(_start, dim=state.axes.shape, inputs=[pose, index, sigma_start], outputs=[state], device=pose.device)


@wp.kernel
def _sample(
    seed: wp.array[wp.int32],  # (run,)
    state: CmaEsState,
    scale: wp.array[wp.float32],  # (dof,)
    particles: int,
    lanes: int,
    # in and out
    draw: wp.array[wp.int32],  # (run,) candidates drawn so far, each from a random stream of its own
    # out
    z: wp.array3d[wp.float32],  # (run, particle, dof)
    x: wp.array3d[wp.float32],  # (run, particle, dof)
):
    run, lane = wp.tid()
    dofs = scale.shape[0]
    first = draw[run]
    for k in range(lane, particles, lanes):
        stream = wp.rand_init(seed[run], first + k)
        for i in range(dofs):
            z[run, k, i] = wp.randn(stream)
    sync()
    if lane == 0:
        draw[run] = first + particles
    sigma = state.sigma[run]
    mine = seat(lane, lanes, dofs)
    for k in range(mine.row, particles, mine.rows):
        for i in range(mine.column, dofs, mine.width):
            y = float(0.0)
            for j in range(dofs):
                y += state.axes[run, j, i] * state.lengths[run, j] * z[run, k, j]
            x[run, k, i] = state.mean[run, i] + sigma * scale[i] * y


def sample(seed, draw, state, scale, particles, z, x):
    """Draw ``x = mean + sigma * scale * y`` with ``y = B D z ~ N(0, C)``; ``draw`` advances by ``particles``."""
    lanes = lanes_of(z.device)
    wp.launch(
        _sample,
        dim=(z.shape[0], lanes),
        inputs=[seed, state, scale, particles, lanes],
        outputs=[draw, z, x],
        block_dim=lanes,
        device=z.device,
    )


@wp.struct
class Generation:
    """What a generation is learned from."""

    cost: wp.array[wp.float32]  # (candidate,)
    z: wp.array3d[wp.float32]  # (run, particle, dof)
    weight: wp.array[wp.float32]  # (parent,)
    scale: wp.array[wp.float32]  # (dof,)
    order: wp.array2d[wp.int32]  # (run, rank) particles, the best first; written


@wp.struct
class Desk:
    """What a run's lanes share while they learn."""

    spectrum: Spectrum  # C in the coordinates of the last eigenvectors
    mean_z: wp.array2d[wp.float32]  # (1, dof) of the parents
    step: wp.array2d[wp.float32]  # (1, dof) (m' - m) / sigma, without scale
    path: wp.array2d[wp.float32]  # (1, dof) p_sigma
    turned: wp.array2d[wp.float32]  # (1, dof) B^T p_c


@wp.func
def desk_words(dofs: int) -> int:
    """32-bit words of a desk."""
    return spectrum_words(dofs) + 4 * dofs


@wp.func
def _desk_at(words: wp.array[wp.uint32], dofs: int) -> Desk:
    first = spectrum_words(dofs)
    desk = Desk()
    desk.spectrum = spectrum_at(words, dofs)
    desk.mean_z = matrix_at(words, first, 1, dofs)
    desk.step = matrix_at(words, first + dofs, 1, dofs)
    desk.path = matrix_at(words, first + 2 * dofs, 1, dofs)
    desk.turned = matrix_at(words, first + 3 * dofs, 1, dofs)
    return desk


@wp.func
def _rank(run: int, lane: int, lanes: int, seen: Generation):
    particles = seen.order.shape[1]
    for k in range(lane, particles, lanes):
        mine = seen.cost[run * particles + k]
        rank = int(0)
        for other in range(particles):
            theirs = seen.cost[run * particles + other]
            if theirs < mine or (theirs == mine and other < k):
                rank += 1
        seen.order[run, rank] = k


@wp.func
def _lay_out(run: int, lane: int, lanes: int, state: CmaEsState, spectrum: Spectrum):
    """Copy the eigenvectors, filled up by zeros."""
    dofs = state.mean.shape[1]
    n = even(dofs)
    columns = spectrum.axes.shape[1]
    mine = seat(lane, lanes, columns)
    for j in range(mine.row, n, mine.rows):
        for i in range(mine.column, columns, mine.width):
            value = float(0.0)
            if i < dofs and j < dofs:
                value = state.axes[run, j, i]
            spectrum.axes[j, i] = value


@wp.func
def _move_mean(table: CmaEsConstants, run: int, lane: int, lanes: int, seen: Generation, state: CmaEsState, desk: Desk):
    """Eq. 10 and 11. The mean's step is ``B D <z>``, and ``C^(-1/2)`` times that is ``B <z>``."""
    dofs = state.mean.shape[1]
    for j in range(lane, dofs, lanes):
        total = float(0.0)
        for r in range(table.mu):
            total += seen.weight[r] * seen.z[run, seen.order[run, r], j]
        desk.mean_z[0, j] = total
    sync()
    to_sigma = wp.sqrt(table.c_sigma * (2.0 - table.c_sigma) * table.mu_eff)
    for i in range(lane, dofs, lanes):
        step = float(0.0)
        whitened = float(0.0)
        for j in range(dofs):
            along = desk.spectrum.axes[j, i] * desk.mean_z[0, j]
            step += along * state.lengths[run, j]
            whitened += along
        path = (1.0 - table.c_sigma) * state.p_sigma[run, i] + to_sigma * whitened  # Eq. 11
        state.p_sigma[run, i] = path
        state.mean[run, i] = state.mean[run, i] + state.sigma[run] * seen.scale[i] * step  # Eq. 10
        desk.path[0, i] = path
        desk.step[0, i] = step
    sync()


@wp.func
def _path_length(table: CmaEsConstants, desk: Desk) -> float:
    """The step-size path's length, 1 for a random walk; every lane adds it up for itself."""
    total = float(0.0)
    for i in range(desk.path.shape[1]):
        total += desk.path[0, i] * desk.path[0, i]
    return wp.sqrt(total) / table.chi_n


@wp.func
def _move_path(table: CmaEsConstants, h_sigma: float, run: int, lane: int, lanes: int, state: CmaEsState, desk: Desk):
    """Eq. 13, and the path in the eigenvectors' coordinates."""
    dofs = state.mean.shape[1]
    to_c = h_sigma * wp.sqrt(table.c_c * (2.0 - table.c_c) * table.mu_eff)
    for i in range(lane, dofs, lanes):
        path = (1.0 - table.c_c) * state.p_c[run, i] + to_c * desk.step[0, i]  # Eq. 13
        state.p_c[run, i] = path
        desk.path[0, i] = path
    sync()
    for j in range(lane, dofs, lanes):
        total = float(0.0)
        for i in range(dofs):
            total += desk.spectrum.axes[j, i] * desk.path[0, i]
        desk.turned[0, j] = total
    sync()


@wp.func
def _update_covariance(
    table: CmaEsConstants,
    h_sigma: float,
    run: int,
    lane: int,
    lanes: int,
    seen: Generation,
    state: CmaEsState,
    desk: Desk,
):
    """Eq. 14 in the eigenvectors' coordinates, where C is ``D^2`` and an offspring's step ``D z``."""
    dofs = state.mean.shape[1]
    n = even(dofs)
    share = 1.0 / table.mu_cov
    kept = 1.0 - table.c_cov + table.c_cov * share * (1.0 - h_sigma) * table.c_c * (2.0 - table.c_c)
    mine = seat(lane, lanes, n)
    for i in range(mine.row, n, mine.rows):
        for j in range(mine.column, n, mine.width):
            value = float(0.0)
            if i <= j and j < dofs:
                rank_mu = float(0.0)
                for r in range(table.mu):
                    k = seen.order[run, r]
                    rank_mu += seen.weight[r] * seen.z[run, k, i] * seen.z[run, k, j]
                spread = state.lengths[run, i] * state.lengths[run, j]
                rank_one = desk.turned[0, i] * desk.turned[0, j]
                value = table.c_cov * (share * rank_one + (1.0 - share) * spread * rank_mu)
                if i == j:
                    value += kept * spread
            desk.spectrum.matrix[i, j] = value
    sync()


@wp.func
def _keep(run: int, lane: int, lanes: int, spectrum: Spectrum, state: CmaEsState):
    """Hand on the new B and D."""
    dofs = state.mean.shape[1]
    mine = seat(lane, lanes, dofs)
    for j in range(mine.row, dofs, mine.rows):
        for i in range(mine.column, dofs, mine.width):
            state.axes[run, j, i] = spectrum.axes[j, i]
    for j in range(lane, dofs, lanes):
        state.lengths[run, j] = wp.sqrt(wp.clamp(spectrum.matrix[j, j], _SMALLEST, _LARGEST))


@wp.func
def _grown(table: CmaEsConstants, length: float, run: int, seen: Generation, state: CmaEsState) -> float:
    """The next sigma."""
    grown = state.sigma[run] * wp.exp(table.c_sigma / table.d_sigma * (length - 1.0))  # Eq. 12
    first = run * seen.order.shape[1]
    if seen.cost[first + seen.order[run, 0]] == seen.cost[first + seen.order[run, table.flat_rank]]:
        grown *= wp.exp(0.2 + table.c_sigma / table.d_sigma)  # a flat neighbourhood tells nothing: look further
    return wp.min(grown, _WIDEST)


@wp.func
def _learn(
    table: CmaEsConstants,
    run: int,
    lane: int,
    lanes: int,
    seen: Generation,
    words: wp.array[wp.uint32],
    state: CmaEsState,
):
    """A run's generation, in ``words`` that its lanes share."""
    dofs = state.mean.shape[1]
    desk = _desk_at(words, dofs)
    _rank(run, lane, lanes, seen)
    _lay_out(run, lane, lanes, state, desk.spectrum)
    sync()
    _move_mean(table, run, lane, lanes, seen, state, desk)
    length = _path_length(table, desk)
    age = float(state.generation[run] + 1)
    unbiased = length / wp.sqrt(1.0 - wp.pow(1.0 - table.c_sigma, 2.0 * age))
    h_sigma = wp.where(unbiased < 1.4 + 2.0 / (float(dofs) + 1.0), 1.0, 0.0)
    sync()
    _move_path(table, h_sigma, run, lane, lanes, state, desk)
    _update_covariance(table, h_sigma, run, lane, lanes, seen, state, desk)
    diagonalize(desk.spectrum, lane, lanes)
    _keep(run, lane, lanes, desk.spectrum, state)
    if lane == 0:
        state.sigma[run] = _grown(table, length, run, seen, state)
        state.generation[run] = state.generation[run] + 1


@wp.kernel
def _update(
    table: CmaEsConstants,
    seen: Generation,
    used: int,  # lanes; those beyond leave, so that few wait for few
    shares: bool,
    scratch: wp.array2d[wp.uint32],  # (run, word), unless the runs have room in shared memory
    # in and out
    state: CmaEsState,
):
    run, lane = wp.tid()
    if lane >= used:
        return
    if shares:
        _learn(table, run, lane, used, seen, shared_words(scratch[run]), state)
    else:
        _learn(table, run, lane, used, seen, scratch[run], state)


def _has_room(dofs, device):
    """Whether a run's desk fits into a block's shared memory."""
    return device.is_cuda and desk_words(dofs) <= WORDS


def scratch(runs, dofs, device):
    """Words for runs to learn in where shared memory has no room for them."""
    words = 1 if _has_room(dofs, device) else desk_words(dofs)
    return wp.empty((runs, words), dtype=wp.uint32, device=device)


def update(table, seen, scratch, state):
    """One generation: rank, then Eq. 10-14 for mean, paths, sigma and C, then ``C = B D^2 B^T`` for the next draw."""
    runs, dofs = state.mean.shape
    device = seen.z.device
    lanes = lanes_of(device)
    wp.launch(
        _update,
        dim=(runs, lanes),
        inputs=[table, seen, min(lanes, lanes_worth(dofs)), _has_room(dofs, device), scratch],
        outputs=[state],
        block_dim=lanes,
        device=device,
    )
