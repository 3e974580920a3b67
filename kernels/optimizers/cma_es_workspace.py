"""What a run's lanes share while CMA-ES learns, and where it lies: in a block's shared memory if there is room."""

import warp as wp

from mmocap_warp.kernels.block import WORDS, matrix_at
from mmocap_warp.kernels.optimizers.eigen import Spectrum, spectrum_at, spectrum_words

wp.set_module_options({"enable_backward": False})


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
