"""Banded solutions and inverses are those of the dense matrix."""

from __future__ import annotations

import numpy as np
import pytest
from planted import dense

from mmocap_warp.contour.clip.block_band import BlockBand


def random_band(frames: int, size: int, seed: int = 0) -> BlockBand:
    """Positive definite, with as many couplings as there are frames for."""
    rng = np.random.default_rng(seed)
    count = min(3, frames)
    blocks = [rng.normal(size=(frames - apart, size, size)) for apart in range(count)]
    blocks[0] = blocks[0] + np.swapaxes(blocks[0], 1, 2) + 8 * size * np.eye(size)
    return BlockBand(blocks)


@pytest.mark.parametrize("frames", [1, 2, 3, 4, 7, 12])
def test_solutions_and_inverses_are_those_of_the_dense_matrix(frames):
    size = 5
    band = random_band(frames, size)
    right = np.random.default_rng(1).normal(size=(frames, size))
    expected = np.linalg.solve(dense(band), right.ravel()).reshape(right.shape)
    np.testing.assert_allclose(band.solved(right), expected, rtol=1e-10, atol=1e-14)
    inverse = np.linalg.inv(dense(band)).reshape(frames, size, frames, size)
    own = np.array([inverse[frame, :, frame] for frame in range(frames)])
    np.testing.assert_allclose(band.inverse_diagonal(), own, rtol=1e-10, atol=1e-14)


def test_blocks_are_added_and_first_frames_left_out():
    band, more = random_band(6, 4), np.random.default_rng(2).normal(size=(6, 4, 4))
    more = more + np.swapaxes(more, 1, 2)
    expected = dense(band)
    for frame in range(6):
        expected[4 * frame : 4 * frame + 4, 4 * frame : 4 * frame + 4] += more[frame]
    assert (dense(band + more) == expected).all()
    assert (dense((band + more).without_first(4)) == expected[16:, 16:]).all()


def test_a_matrix_that_is_not_positive_definite_is_refused():
    with pytest.raises(np.linalg.LinAlgError):
        (random_band(4, 3) + -1e3 * np.eye(3)).solved(np.ones((4, 3)))


def test_what_rounding_adds_does_not_grow_from_frame_to_frame():
    """Accelerations that are penalised far more than each frame is seen, over a long window."""
    frames, size = 170, 6
    rng = np.random.default_rng(3)
    jacobian = 100.0 * rng.normal(size=(1, 8, size)) + rng.normal(
        size=(frames, 8, size)
    )  # of what is kept from turning
    stencil = np.array([1.0, -2.0, 1.0])
    blocks = [np.zeros((frames - apart, size, size)) for apart in range(3)]
    blocks[0] += np.eye(size)
    for first in range(frames - 2):
        for i in range(3):
            for j in range(i + 1):
                blocks[i - j][first + j] += stencil[i] * stencil[j] * jacobian[first + i].T @ jacobian[first + j]
    band = BlockBand(blocks)
    inverse = np.linalg.inv(dense(band)).reshape(frames, size, frames, size)
    own = np.array([inverse[frame, :, frame] for frame in range(frames)])
    np.testing.assert_allclose(band.inverse_diagonal(), own, rtol=1e-4, atol=1e-6 * np.abs(own).max())
