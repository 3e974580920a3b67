"""What CMA-ES learns from a generation's costs: one launch, a block of lanes for each run.

The best mu candidates are the parents. Their weighted mean ``<z>`` moves m (Eq. 10). The paths p_sigma and p_c are
fading sums of these moves. Where p_sigma (Eq. 11) is longer than that of a random walk, moves point the same way, and
sigma grows, else it shrinks (Eq. 12). C learns from p_c (Eq. 13) and from the parents' steps (Eq. 14)::

    C <- kept C + c_cov / mu_cov p_c p_c^T + c_cov (1 - 1 / mu_cov) sum_r w_r (B D z_r) (B D z_r)^T

Of C only B and D are kept, with ``C = B D^2 B^T``. In the coordinates of B's columns C is D^2 and a parent's step is
D z, so Eq. 14 is worked out there. What it leaves beside the diagonal is small, and few sweeps of rotations give the
next B and D (``eigen``).

Equations and misprints are those of the paper's Section 4 as settled in ``docs/algorithms.md``.
"""

import warp as wp

from mmocap_warp.kernels.block import lane_layout, lanes_of, shared_words, sync
from mmocap_warp.kernels.native import native_sections
from mmocap_warp.kernels.optimizers.cma_es import CmaEsState, Workspace, has_room, workspace_at
from mmocap_warp.kernels.optimizers.eigen import MOST_LANES, Spectrum, diagonalize, lanes_worth
from mmocap_warp.kernels.optimizers.populations import SearchSpace

wp.set_module_options({"enable_backward": False})

_native = native_sections(__file__)

_WIDEST = wp.constant(1.0e8)  # largest sigma: costs that stay flat would widen it until candidates overflow
_SMALLEST = wp.constant(1.0e-20)  # smallest eigenvalue
_LARGEST = wp.constant(1.0e16)  # largest eigenvalue: its square still fits


@wp.struct
class CmaEsParameters:
    """Table 2, for a search in D dimensions."""

    mu: int  # parents
    weight: wp.array[wp.float32]  # (parent,)
    mu_eff: float
    c_sigma: float
    d_sigma: float
    c_c: float
    c_cov: float
    mu_cov: float
    chi_n: float  # expected length of a standard normal vector
    flat_rank: int  # equal costs up to this rank mean a flat neighbourhood


@wp.func
def _rank(run: int, lane: int, lanes: int, cost: wp.array[wp.float32], state: CmaEsState) -> None:
    particles = state.order.shape[1]
    for k in range(lane, particles, lanes):
        mine = cost[run * particles + k]
        rank = int(0)
        for other in range(particles):
            theirs = cost[run * particles + other]
            if theirs < mine or (theirs == mine and other < k):
                rank += 1
        state.order[run, rank] = k


@wp.func_native(_native("lay_out"))
def _lay_out(axes: wp.array2d[wp.float32], lane: int, lanes: int, copy: wp.array2d[wp.float32]) -> None:
    """Copy the eigenvectors, filled up by zeros."""


# Column i of the eigenvectors times the mean draw, once scaled by the axes' lengths and once without.
@wp.func_native(_native("turned"))
def _turned(
    axes: wp.array2d[wp.float32], mean_z: wp.array2d[wp.float32], lengths: wp.array[wp.float32], i: int
) -> wp.vec2:
    """Coordinate i of ``B D <z>`` and of ``B <z>``."""


@wp.func_native(_native("dot"))
def _dot(matrix: wp.array2d[wp.float32], row: int, vector: wp.array2d[wp.float32]) -> float:
    """A row of the matrix times the vector (1, column)."""


@wp.func
def _move_mean(
    radius: wp.array[wp.float32],
    parameters: CmaEsParameters,
    run: int,
    lane: int,
    lanes: int,
    state: CmaEsState,
    work: Workspace,
) -> None:
    """Eq. 10 and 11. The mean's step is ``B D <z>``, and ``C^(-1/2)`` times that is ``B <z>``."""
    dofs = state.mean.shape[1]
    for j in range(lane, dofs, lanes):
        total = float(0.0)
        for r in range(parameters.mu):
            total += parameters.weight[r] * state.z[run, state.order[run, r], j]
        work.mean_z[0, j] = total
    sync()
    to_sigma = wp.sqrt(parameters.c_sigma * (2.0 - parameters.c_sigma) * parameters.mu_eff)
    for i in range(lane, dofs, lanes):
        turned = _turned(work.spectrum.axes, work.mean_z, state.lengths[run], i)
        path = (1.0 - parameters.c_sigma) * state.p_sigma[run, i] + to_sigma * turned[1]  # Eq. 11
        state.p_sigma[run, i] = path
        state.mean[run, i] = state.mean[run, i] + state.sigma[run] * radius[i] * turned[0]  # Eq. 10
        work.path[0, i] = path
        work.step[0, i] = turned[0]
    sync()


@wp.func
def _path_length(parameters: CmaEsParameters, work: Workspace) -> float:
    """The step-size path's length, 1 for a random walk; every lane adds it up for itself."""
    return wp.sqrt(_dot(work.path, 0, work.path)) / parameters.chi_n


@wp.func
def _move_path(
    parameters: CmaEsParameters, h_sigma: float, run: int, lane: int, lanes: int, state: CmaEsState, work: Workspace
) -> None:
    """Eq. 13, and the path in the eigenvectors' coordinates."""
    dofs = state.mean.shape[1]
    to_c = h_sigma * wp.sqrt(parameters.c_c * (2.0 - parameters.c_c) * parameters.mu_eff)
    for i in range(lane, dofs, lanes):
        path = (1.0 - parameters.c_c) * state.p_c[run, i] + to_c * work.step[0, i]  # Eq. 13
        state.p_c[run, i] = path
        work.path[0, i] = path
    sync()
    for j in range(lane, dofs, lanes):
        work.path_along[0, j] = _dot(work.spectrum.axes, j, work.path)
    sync()


# In these coordinates C is diagonal, so that the new C is that diagonal, kept in part, plus the path's outer product
# and the weighted sum of the parents' outer products. Each element is written to where the first round of the
# tournament in ``eigen`` wants it.
@wp.func_native(_native("write_covariance"))
def _write_covariance(
    mu: int,
    c_cov: float,
    share: float,
    kept: float,
    weight: wp.array[wp.float32],
    order: wp.array[wp.int32],
    z: wp.array2d[wp.float32],
    lengths: wp.array[wp.float32],
    path_along: wp.array2d[wp.float32],
    start: wp.array2d[wp.int32],
    lane: int,
    lanes: int,
    elements: wp.array2d[wp.float32],
) -> None:
    """Eq. 14 in the eigenvectors' coordinates, where C is ``D^2`` and an offspring's step ``D z``."""


@wp.func
def _update_covariance(
    parameters: CmaEsParameters, h_sigma: float, run: int, lane: int, lanes: int, state: CmaEsState, work: Workspace
) -> None:
    share = 1.0 / parameters.mu_cov
    c_c = parameters.c_c
    _write_covariance(
        parameters.mu,
        parameters.c_cov,
        share,
        1.0 - parameters.c_cov + parameters.c_cov * share * (1.0 - h_sigma) * c_c * (2.0 - c_c),
        parameters.weight,
        state.order[run],
        state.z[run],
        state.lengths[run],
        work.path_along,
        state.tournament.start,
        lane,
        lanes,
        work.spectrum.elements,
    )
    sync()


@wp.func
def _keep(run: int, lane: int, lanes: int, eigenvalues: int, spectrum: Spectrum, state: CmaEsState) -> None:
    """Hand on the new B and D."""
    dofs = state.mean.shape[1]
    layout = lane_layout(lane, lanes, dofs)
    for j in range(layout.row, dofs, layout.row_step):
        for i in range(layout.column, dofs, layout.column_step):
            state.axes[run, j, i] = spectrum.axes[j, i]
    for j in range(lane, dofs, lanes):
        eigenvalue = spectrum.elements[eigenvalues, state.tournament.start[j, j]]
        state.lengths[run, j] = wp.sqrt(wp.clamp(eigenvalue, _SMALLEST, _LARGEST))


@wp.func
def _grown(
    parameters: CmaEsParameters, length: float, run: int, cost: wp.array[wp.float32], state: CmaEsState
) -> float:
    """The next sigma."""
    rate = parameters.c_sigma / parameters.d_sigma
    grown = state.sigma[run] * wp.exp(rate * (length - 1.0))  # Eq. 12
    first = run * state.order.shape[1]
    if cost[first + state.order[run, 0]] == cost[first + state.order[run, parameters.flat_rank]]:
        grown *= wp.exp(0.2 + rate)  # a flat neighbourhood tells nothing: look further
    return wp.min(grown, _WIDEST)


@wp.func
def _learn(
    radius: wp.array[wp.float32],
    parameters: CmaEsParameters,
    run: int,
    lane: int,
    lanes: int,
    cost: wp.array[wp.float32],
    words: wp.array[wp.uint32],
    state: CmaEsState,
) -> None:
    """A run's generation, in ``words`` that its lanes share."""
    dofs = state.mean.shape[1]
    work = workspace_at(words, dofs)
    _rank(run, lane, lanes, cost, state)
    _lay_out(state.axes[run], lane, lanes, work.spectrum.axes)
    sync()
    _move_mean(radius, parameters, run, lane, lanes, state, work)
    length = _path_length(parameters, work)
    age = float(state.generation[run] + 1)
    unbiased = length / wp.sqrt(1.0 - wp.pow(1.0 - parameters.c_sigma, 2.0 * age))
    h_sigma = wp.where(unbiased < 1.4 + 2.0 / (float(dofs) + 1.0), 1.0, 0.0)
    sync()
    _move_path(parameters, h_sigma, run, lane, lanes, state, work)
    _update_covariance(parameters, h_sigma, run, lane, lanes, state, work)
    eigenvalues = diagonalize(state.tournament, work.spectrum, lane, lanes)
    _keep(run, lane, lanes, eigenvalues, work.spectrum, state)
    if lane == 0:
        state.sigma[run] = _grown(parameters, length, run, cost, state)
        state.generation[run] = state.generation[run] + 1


@wp.kernel(launch_bounds=MOST_LANES)
def _update(
    space: SearchSpace,
    parameters: CmaEsParameters,
    cost: wp.array[wp.float32],  # (candidate,)
    lanes: int,
    is_shared: bool,  # whether the workspace lies in shared memory
    # in and out
    state: CmaEsState,
) -> None:
    run, lane = wp.tid()
    if is_shared:
        _learn(space.radius, parameters, run, lane, lanes, cost, shared_words(state.scratch[run]), state)
    else:
        _learn(space.radius, parameters, run, lane, lanes, cost, state.scratch[run], state)


def update(space: SearchSpace, parameters: CmaEsParameters, cost: wp.array[wp.float32], state: CmaEsState) -> None:
    """One generation: rank, then Eq. 10-14 for mean, paths, sigma and C, then ``C = B D^2 B^T`` for the next sample."""
    runs, dofs = state.mean.shape
    device = cost.device
    lanes = 1 if lanes_of(device) == 1 else lanes_worth(dofs)
    dim = (runs, lanes)
    wp.launch(
        _update, dim, [space, parameters, cost, lanes, has_room(dofs, device)], [state], block_dim=lanes, device=device
    )
