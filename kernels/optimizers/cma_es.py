"""CMA-ES on the device, a block of lanes for each run: one launch samples a generation, one learns from its costs.

Candidates are normal, ``x = m + sigma B D z``, in units of the search's radius::

    z ~ N(0, I)  --D-->  stretched along the coordinates  --B-->  rotated: N(0, C) with C = B D^2 B^T

Only B and D are kept. This module has what a generation hands to the next, what a run's lanes share while they learn,
and the sampling; ``cma_es_learning`` has what is learnt from the costs.
"""

from typing import Any

import warp as wp

from mmocap_warp.kernels.block import WORDS, lane_layout, lanes_of, matrix_at, sync
from mmocap_warp.kernels.native import native_sections
from mmocap_warp.kernels.optimizers.eigen import Spectrum, Tournament, make_tournament, spectrum_at, spectrum_words
from mmocap_warp.kernels.optimizers.populations import SearchSpace, random_stream
from mmocap_warp.kernels.structs import allocated

wp.set_module_options({"enable_backward": False})

_native = native_sections(__file__)


@wp.struct
class Workspace:
    """What a run's lanes share while they learn."""

    spectrum: Spectrum  # C in the coordinates of the last eigenvectors
    mean_z: wp.array2d[wp.float32]  # (1, dof) of the parents
    step: wp.array2d[wp.float32]  # (1, dof) (m' - m) / sigma, without the radius
    path: wp.array2d[wp.float32]  # (1, dof) p_sigma, then p_c
    path_along: wp.array2d[wp.float32]  # (1, dof) B^T p_c: along each eigenvector


@wp.func
def workspace_words(dofs: int) -> int:
    """32-bit words of a workspace."""
    return spectrum_words(dofs) + 4 * dofs


@wp.func
def workspace_at(words: wp.array[wp.uint32], dofs: int) -> Workspace:
    """The workspace in the first of some words."""
    first = spectrum_words(dofs)
    work = Workspace()
    work.spectrum = spectrum_at(words, dofs)
    work.mean_z = matrix_at(words, first, 1, dofs)
    work.step = matrix_at(words, first + dofs, 1, dofs)
    work.path = matrix_at(words, first + 2 * dofs, 1, dofs)
    work.path_along = matrix_at(words, first + 3 * dofs, 1, dofs)
    return work


def has_room(dofs: int, device: wp.Device) -> bool:
    """Whether a run's workspace fits into a block's shared memory."""
    return device.is_cuda and workspace_words(dofs) <= WORDS


@wp.struct
class CmaEsState:
    """What a generation hands to the next, and its candidates."""

    mean: wp.array2d[wp.float32]  # (run, dof)
    sigma: wp.array[wp.float32]  # (run,)
    p_sigma: wp.array2d[wp.float32]  # (run, dof)
    p_c: wp.array2d[wp.float32]  # (run, dof)
    axes: wp.array3d[wp.float32]  # (run, dof, dof) B^T: an eigenvector a row
    lengths: wp.array2d[wp.float32]  # (run, dof) D: square roots of the eigenvalues
    generation: wp.array[wp.int32]  # (run,)
    z: wp.array3d[wp.float32]  # (run, particle, dof) standard normal
    x: wp.array3d[wp.float32]  # (run, particle, dof)
    order: wp.array2d[wp.int32]  # (run, rank) particles, the best first
    tournament: Tournament  # of the dofs
    scratch: wp.array2d[wp.uint32]  # (run, word) workspaces that shared memory has no room for


def make_state(population: wp.array[wp.float32]) -> Any:
    """Arrays for a search that writes its candidates to ``population`` (run, particle, dof)."""
    runs, particles, dofs = population.shape
    device, tournament = population.device, make_tournament(dofs, population.device)
    shapes: dict[str, tuple[int, ...]] = dict.fromkeys(("sigma", "generation"), (runs,))
    shapes |= dict.fromkeys(("mean", "p_sigma", "p_c", "lengths"), (runs, dofs))
    shapes |= {"axes": (runs, dofs, dofs), "z": population.shape, "order": (runs, particles)}
    shapes["scratch"] = (runs, 1 if has_room(dofs, device) else workspace_words(dofs))
    return allocated(CmaEsState, device, x=population, tournament=tournament, **shapes)


@wp.kernel
def _start(
    space: SearchSpace,
    pose: wp.array2d[wp.float32],  # (run, coordinate)
    sigma_start: float,
    # out
    state: CmaEsState,
) -> None:
    run, i, j = wp.tid()
    state.axes[run, i, j] = wp.where(i == j, 1.0, 0.0)
    if j == 0:
        state.mean[run, i] = pose[run, space.index[i]]
        state.p_sigma[run, i] = 0.0
        state.p_c[run, i] = 0.0
        state.lengths[run, i] = 1.0
        if i == 0:
            state.sigma[run] = sigma_start
            state.generation[run] = 0


def start(space: SearchSpace, pose: wp.array[wp.float32], sigma_start: float, state: CmaEsState) -> None:
    """Begin anew at ``pose[:, index]``: ``C = I``, zero paths, ``sigma = sigma_start``."""
    wp.launch(_start, state.axes.shape, [space, pose, sigma_start], [state], device=pose.device)


# ``x = mean + sigma radius (B D z)``. A GPU's lanes each have some coordinates i and sum over j. A CPU goes through j
# outside and i inside, which is the same order of additions for every i, and turns the inner loop into vectors.
@wp.func_native(_native("transform"))
def _transform(
    axes: wp.array2d[wp.float32],
    lengths: wp.array[wp.float32],
    z: wp.array[wp.float32],
    mean: wp.array[wp.float32],
    sigma: float,
    radius: wp.array[wp.float32],
    x: wp.array[wp.float32],
    column: int,
    columns: int,
) -> None:
    """Write a candidate; the same sums on both kinds of device, on the CPU many coordinates at a time."""


@wp.kernel
def _sample(
    particles: int,
    lanes: int,
    # in and out
    space: SearchSpace,
    state: CmaEsState,
) -> None:
    run, lane = wp.tid()
    dofs = space.radius.shape[0]
    shares = lane_layout(lane, lanes, wp.max(1, lanes // particles))
    share = (dofs + shares.column_step - 1) // shares.column_step
    for k in range(shares.row, particles, shares.row_step):
        if shares.column < shares.column_step:
            first = shares.column * share
            random = random_stream(space, run, k)
            for _ in range(2 * first):  # two for each number that lanes before this one draw
                wp.randu(random)
            for i in range(first, wp.min(first + share, dofs)):
                state.z[run, k, i] = wp.randn(random)
    sync()
    if lane == 0:
        space.counter[run] = space.counter[run] + particles
    sigma = state.sigma[run]
    layout = lane_layout(lane, lanes, dofs)
    for k in range(layout.row, particles, layout.row_step):
        _transform(
            state.axes[run],
            state.lengths[run],
            state.z[run, k],
            state.mean[run],
            sigma,
            space.radius,
            state.x[run, k],
            layout.column,
            layout.column_step,
        )


def sample(space: SearchSpace, particles: int, state: CmaEsState) -> None:
    """Sample ``x = mean + sigma * radius * y`` with ``y = B D z ~ N(0, C)`` for the first ``particles``."""
    device = space.seed.device
    lanes = lanes_of(device)
    wp.launch(
        _sample, (state.sigma.shape[0], lanes), [particles, lanes], [space, state], block_dim=lanes, device=device
    )
