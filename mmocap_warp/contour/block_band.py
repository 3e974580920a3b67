"""Symmetric matrices whose blocks couple a frame with the next two: solved, and inverted where that is needed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


class BlockBand:
    """A symmetric matrix of (frame, frame) blocks, zero where frames are further apart than the band is wide.

    Args:
        blocks: by how many frames apart: ``blocks[o][f]`` is the block in row ``f + o`` and column ``f``;
            (frame - o, n, n).
    """

    def __init__(self, blocks: Sequence[np.ndarray]) -> None:
        self.blocks = list(blocks)
        self.frames, self.size, _ = self.blocks[0].shape

    def __add__(self, diagonal: np.ndarray) -> BlockBand:
        """With blocks (frame, n, n) added on the diagonal."""
        return BlockBand([self.blocks[0] + diagonal, *self.blocks[1:]])

    def without_first(self, frames: int) -> BlockBand:
        """Without the rows and columns of the first frames."""
        return BlockBand([block[frames:] for block in self.blocks if len(block) > frames])

    def solved(self, right: np.ndarray) -> np.ndarray:
        """``x`` (frame, n) of ``matrix @ x = right`` (frame, n), by Cholesky's decomposition of the band.

        Raises:
            numpy.linalg.LinAlgError: the matrix is not positive definite.
        """
        from scipy.linalg import solveh_banded

        flat = solveh_banded(self._diagonals(), right.ravel(), lower=True, overwrite_ab=True)
        solution: np.ndarray = flat.reshape(right.shape)
        return solution

    def _diagonals(self) -> np.ndarray:
        """(diagonal, frame * n), LAPACK's lower form: row ``r`` has the elements ``r`` below the diagonal."""
        n = self.size
        row, column = np.divmod(np.arange(n * n), n)
        band = np.zeros((n * len(self.blocks), self.frames, n))
        for apart, block in enumerate(self.blocks):
            below = apart * n + row - column
            kept = below >= 0
            elements = block.reshape(len(block), n * n).T[kept]
            band[below[kept], : len(block), column[kept]] = elements
        return band.reshape(len(band), -1)

    def inverse_diagonal(self) -> np.ndarray:
        """The inverse's blocks on the diagonal, (frame, n, n): of a normal matrix, each frame's covariance.

        Two frames at a time make the matrix block tridiagonal. Eliminating from the first block to the last, and
        going back, gives the inverse's diagonal blocks without its others (Takahashi, Fagan and Chen, 1973; for
        smoothing in time: Rauch, Tung and Striebel, 1965).

        Raises:
            numpy.linalg.LinAlgError: the matrix is not positive definite.
        """
        from scipy.linalg import cho_factor, cho_solve

        diagonal, below = self._tridiagonal()
        remaining = diagonal[0]
        eliminated = []  # each block's matrix once those before it are gone, inverted; and how the next depends on it
        for pair, coupling in enumerate(below):
            factor = cho_factor(remaining, lower=True)
            gain = cho_solve(factor, coupling.T)
            eliminated.append((cho_solve(factor, np.eye(len(remaining))), gain))
            remaining = diagonal[pair + 1] - coupling @ gain
        covariance = np.empty_like(diagonal)
        covariance[-1] = cho_solve(cho_factor(remaining, lower=True), np.eye(len(remaining)))
        for pair in reversed(range(len(below))):
            own, gain = eliminated[pair]
            covariance[pair] = own + gain @ covariance[pair + 1] @ gain.T
        n = self.size
        both = np.stack([covariance[:, :n, :n], covariance[:, n:, n:]], axis=1)
        return both.reshape(-1, n, n)[: self.frames]

    def _tridiagonal(self) -> tuple[np.ndarray, np.ndarray]:
        """Blocks of two frames: (pair, 2 n, 2 n) on the diagonal, (pair - 1, 2 n, 2 n) below it.

        An odd last frame is paired with one that nothing couples it to.
        """
        n, frames = self.size, self.frames
        pairs = (frames + 1) // 2
        own, one, two = (np.zeros((2 * pairs, n, n)) for _ in range(3))
        own[:] = np.eye(n)
        for padded, block in zip((own, one, two), self.blocks, strict=False):
            padded[: len(block)] = block
        diagonal, below = np.zeros((pairs, 2 * n, 2 * n)), np.zeros((pairs - 1, 2 * n, 2 * n))
        diagonal[:, :n, :n], diagonal[:, n:, n:] = own[::2], own[1::2]
        diagonal[:, n:, :n], diagonal[:, :n, n:] = one[::2], np.swapaxes(one[::2], 1, 2)
        below[:, :n, :n], below[:, n:, n:] = two[:-2:2], two[1:-2:2]
        below[:, :n, n:] = one[1:-2:2]
        return diagonal, below
