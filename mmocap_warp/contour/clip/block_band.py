"""Symmetric matrices whose blocks couple a frame with the next two: solved, and inverted where that is needed.

A block is small, so that a step of the elimination is done before a second thread would have started: LAPACK's banded
solver, which starts one at every step, took a hundred times as long while other programs worked.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


class BlockBand:
    """A symmetric matrix of (frame, frame) blocks, zero where frames are more than two apart.

    Args:
        blocks: by how many frames apart, three at most: ``blocks[o][f]`` is the block in row ``f + o`` and column
            ``f``; (frame - o, n, n).
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
        """``x`` (frame, n) of ``matrix @ x = right`` (frame, n); a LinAlgError if it is not positive definite."""
        own, next_one, next_two = self._factor()
        x = np.zeros((self.frames + 2, self.size))
        x[:-2] = right
        for f in range(self.frames):
            x[f] = own[f] @ x[f]
            x[f + 1] -= next_one[f] @ x[f]
            x[f + 2] -= next_two[f] @ x[f]
        x[-2:] = 0.0
        for f in reversed(range(self.frames)):
            x[f] = own[f].T @ (x[f] - next_one[f].T @ x[f + 1] - next_two[f].T @ x[f + 2])
        return x[:-2]

    def inverse_diagonal(self) -> np.ndarray:
        """The inverse's blocks on the diagonal, (frame, n, n): of a normal matrix, each frame's covariance.

        Going back from the last frame, a frame's part of the inverse follows from those of the next two (Takahashi,
        Fagan and Chin, 1973). Raises a LinAlgError where the matrix is not positive definite.
        """
        own, next_one, next_two = self._factor()
        inverse = np.zeros((self.frames + 2, self.size, self.size))
        below = np.zeros((self.size, self.size))  # in the inverse: row f + 2, column f + 1
        for f in reversed(range(self.frames)):
            one, two = next_one[f] @ own[f], next_two[f] @ own[f]
            first = -(inverse[f + 1] @ one + below.T @ two)
            second = -(below @ one + inverse[f + 2] @ two)
            whole = own[f].T @ own[f] - one.T @ first - two.T @ second
            inverse[f] = 0.5 * (whole + whole.T)  # what rounding makes unsymmetric would grow from frame to frame
            below = first
        return inverse[:-2]

    def _factor(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Cholesky's factor by columns: its blocks on the diagonal, inverted; those one and those two rows below.

        Each is (frame, n, n).
        """
        remaining = np.zeros((3, self.frames + 2, self.size, self.size))
        for apart, block in enumerate(self.blocks):
            remaining[apart, : len(block)] = block
        own, next_one, next_two = (np.empty((self.frames, self.size, self.size)) for _ in range(3))
        for f in range(self.frames):
            own[f] = np.linalg.inv(np.linalg.cholesky(remaining[0, f]))
            next_one[f] = remaining[1, f] @ own[f].T
            next_two[f] = remaining[2, f] @ own[f].T
            remaining[0, f + 1] -= next_one[f] @ next_one[f].T
            remaining[1, f + 1] -= next_two[f] @ next_one[f].T
            remaining[0, f + 2] -= next_two[f] @ next_two[f].T
        return own, next_one, next_two
