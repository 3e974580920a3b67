"""Jacobi rotations against LAPACK."""

from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp
from poisoned import poisoned

from mmocap_warp.kernels.block import WORDS, shared_words, sync
from mmocap_warp.kernels.optimizers import eigen
from mmocap_warp.kernels.optimizers.eigen import (
    MOST_LANES,
    Spectrum,
    Tournament,
    diagonalize,
    even,
    lanes_worth,
    make_tournament,
    spectrum_at,
    spectrum_words,
)

ORTHONORMAL = 1e-5
DECOMPOSED = 1e-5  # of the largest eigenvalue


@wp.func
def _decompose_in(
    tournament: Tournament,
    spectrum: Spectrum,
    matrix: wp.array2d[wp.float32],
    lane: int,
    lanes: int,
    axes: wp.array2d[wp.float32],
    eigenvalue: wp.array[wp.float32],
):
    dofs = eigenvalue.shape[0]
    for i in range(lane, even(dofs), lanes):
        for j in range(spectrum.axes.shape[1]):
            inside = i < dofs and j < dofs
            spectrum.axes[i, j] = wp.where(i == j and inside, 1.0, 0.0)
        for j in range(i, even(dofs)):
            value = 0.0
            if j < dofs:
                value = matrix[i, j]
            spectrum.elements[0, tournament.start[i, j]] = value
    sync()
    row = diagonalize(tournament, spectrum, lane, lanes)
    for i in range(lane, dofs, lanes):
        eigenvalue[i] = spectrum.elements[row, tournament.start[i, i]]
        for j in range(dofs):
            axes[i, j] = spectrum.axes[i, j]


@wp.kernel(launch_bounds=MOST_LANES)
def _decompose(
    tournament: Tournament,
    matrix: wp.array3d[wp.float32],  # (run, dof, dof)
    lanes: int,
    is_shared: bool,
    scratch: wp.array2d[wp.uint32],  # (run, word)
    # out
    axes: wp.array3d[wp.float32],  # (run, dof, dof) eigenvectors, rows
    eigenvalue: wp.array2d[wp.float32],  # (run, dof)
):
    run, lane = wp.tid()
    dofs = eigenvalue.shape[1]
    if is_shared:
        spectrum = spectrum_at(shared_words(scratch[run]), dofs)
        _decompose_in(tournament, spectrum, matrix[run], lane, lanes, axes[run], eigenvalue[run])
    else:
        spectrum = spectrum_at(scratch[run], dofs)
        _decompose_in(tournament, spectrum, matrix[run], lane, lanes, axes[run], eigenvalue[run])


def decompose(matrix, device, is_shared, lanes):
    """Eigenvectors (run, dof, dof) in rows, and eigenvalues (run, dof)."""
    runs, dofs, _ = matrix.shape
    axes = poisoned(matrix.shape, wp.float32, device)
    eigenvalue = poisoned((runs, dofs), wp.float32, device)
    scratch = wp.array(np.full((runs, max(WORDS, spectrum_words(dofs))), 0x7FC00000), dtype=wp.uint32, device=device)
    lanes = 1 if wp.get_device(device).is_cpu else lanes
    wp.launch(
        _decompose,
        dim=(runs, lanes),
        inputs=[
            make_tournament(dofs, device),
            wp.array(matrix, dtype=wp.float32, device=device),
            lanes,
            is_shared,
            scratch,
        ],
        outputs=[axes, eigenvalue],
        block_dim=lanes,
        device=device,
    )
    return axes.numpy().astype(float), eigenvalue.numpy().astype(float)


@pytest.mark.parametrize("is_shared", [True, False])
@pytest.mark.parametrize("dofs", [1, 2, 3, 4, 6, 9, 28, 39, 64])
@pytest.mark.parametrize("condition", [1.0, 1e2, 1e4])
def test_matrices_are_decomposed(device, dofs, condition, is_shared):
    """In shared memory and out of it, by as many lanes as are worth it: the scratch is full of NaN."""
    rng = np.random.default_rng(dofs)
    rotation = np.stack([np.linalg.qr(rng.normal(0, 1, (dofs, dofs)))[0] for _ in range(2)])
    matrix = np.einsum("rij,j,rkj->rik", rotation, np.geomspace(1, condition, dofs), rotation)
    axes, eigenvalue = decompose(matrix, device, is_shared, lanes_worth(dofs))
    identity = np.tile(np.eye(dofs), (2, 1, 1))
    np.testing.assert_allclose(axes @ axes.transpose(0, 2, 1), identity, rtol=0, atol=ORTHONORMAL)
    again = np.einsum("rji,rj,rjk->rik", axes, eigenvalue, axes)
    np.testing.assert_allclose(again, matrix, rtol=0, atol=DECOMPOSED * condition)
    by_lapack = np.linalg.eigvalsh(matrix)
    np.testing.assert_allclose(np.sort(eigenvalue), by_lapack, rtol=0, atol=DECOMPOSED * condition)


def test_the_number_of_lanes_does_not_change_a_bit(device):
    matrix = np.cov(np.random.default_rng(0).normal(0, 1, (9, 40)))[None]
    for few, many in zip(decompose(matrix, device, True, 32), decompose(matrix, device, True, 256), strict=True):
        np.testing.assert_array_equal(few, many)


@pytest.mark.parametrize("is_cpu", [True, False])
@pytest.mark.parametrize("dofs", [2, 3, 8, 9, 28, 39])
def test_each_element_has_a_place_of_its_own_in_every_round(monkeypatch, dofs, is_cpu):
    """Also of a GPU's matrix, whose elements lie without a gap."""
    monkeypatch.setattr(eigen.wp, "get_device", lambda device: SimpleNamespace(is_cpu=is_cpu))
    monkeypatch.setattr(eigen, "allocated", lambda kind, device, **tables: tables)
    tables = make_tournament(dofs, "any")
    n = even(dofs)
    start = tables["start"]
    np.testing.assert_array_equal(start, start.T)
    own = start[np.triu_indices(n)]
    assert len(np.unique(own)) == len(own) == n * (n + 1) // 2
    assert own.min() == 0
    if not is_cpu:
        assert own.max() == len(own) - 1
    # Once all rounds of a sweep are played, each element is back where it was.
    moved, at = tables["moved"], own
    for _ in range(n - 1):
        before = np.zeros(len(moved), int)
        before[moved[np.unique(start)]] = np.unique(start)  # where an element goes that lay there
        at = before[at]
    np.testing.assert_array_equal(at, own)


@pytest.mark.parametrize(("dofs", "lanes"), [(6, 128), (28, 256), (39, 512), (90, MOST_LANES)])
def test_a_gpu_has_lanes_for_all_that_is_done_at_a_time(dofs, lanes):
    assert lanes_worth(dofs) == lanes
