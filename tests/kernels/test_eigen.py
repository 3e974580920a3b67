"""Jacobi rotations against LAPACK."""

import numpy as np
import pytest
import warp as wp
from poisoned import poisoned

from mmocap_warp.kernels.block import WORDS, lanes_of, sync, shared_words
from mmocap_warp.kernels.eigen import Spectrum, diagonalize, lanes_worth, spectrum_at, spectrum_words

ORTHONORMAL = 1e-5
DECOMPOSED = 1e-5  # of the largest eigenvalue


@wp.func
def _diagonalize(
    matrix: wp.array3d[wp.float32],
    axes: wp.array3d[wp.float32],
    lengths: wp.array2d[wp.float32],
    run: int,
    lane: int,
    lanes: int,
    spectrum: Spectrum,
):
    """Rotate ``matrix[run]`` until it is diagonal, starting from rows ``axes[run]``."""
    dofs = lengths.shape[1]
    for i in range(lane, spectrum.axes.shape[0], lanes):
        for j in range(spectrum.axes.shape[0]):
            spectrum.matrix[i, j] = 0.0
            spectrum.axes[i, j] = 0.0
            if i < dofs and j < dofs:
                spectrum.axes[i, j] = axes[run, i, j]
                if i <= j:
                    spectrum.matrix[i, j] = matrix[run, i, j]
    sync()
    diagonalize(spectrum, lane, lanes)
    for i in range(lane, dofs, lanes):
        lengths[run, i] = spectrum.matrix[i, i]
        for j in range(dofs):
            axes[run, i, j] = spectrum.axes[i, j]


@wp.kernel
def _decompose(
    matrix: wp.array3d[wp.float32],  # (run, dof, dof)
    used: int,
    scratch: wp.array2d[wp.uint32],  # (run, word)
    shares: bool,
    # out
    axes: wp.array3d[wp.float32],  # (run, dof, dof) eigenvectors, rows
    eigenvalue: wp.array2d[wp.float32],  # (run, dof)
):
    run, lane = wp.tid()
    if lane >= used:
        return
    dofs = eigenvalue.shape[1]
    if shares:
        _diagonalize(matrix, axes, eigenvalue, run, lane, used, spectrum_at(shared_words(scratch[run]), dofs))
    else:
        _diagonalize(matrix, axes, eigenvalue, run, lane, used, spectrum_at(scratch[run], dofs))
