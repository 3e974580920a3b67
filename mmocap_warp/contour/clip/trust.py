"""How far a step is trusted: what damping adds to the normal equations of each frame."""

from __future__ import annotations

import numpy as np

from mmocap_warp.contour.frame.normal_equations import NormalEquations

LARGEST_STEP = 0.2
"""No coordinate moves further in a step [m, rad]."""

_SHIFT, _TURN = 0.05, 0.15  # standard deviation of a step's translation [m] and angles [rad]
_SHARE = 1e-3  # of the diagonal, so that what is seen well is damped too
_UNSEEN = 1e-3  # a frame that shows nothing follows its neighbours: it is trusted to move far


class Trust:
    """A weak pull of each frame to where it is.

    Args:
        is_length: (dof,) bool, which coordinates of a step are lengths, not angles.
    """

    def __init__(self, is_length: np.ndarray) -> None:
        self._information = np.where(is_length, _SHIFT, _TURN) ** -2.0
        self._dof = len(is_length)

    def alone(self, damping: float) -> np.ndarray:
        """(dof, dof) of coordinates that all frames share, whatever is seen of them."""
        matrix: np.ndarray = np.diag(damping * self._information)
        return matrix

    def matrix(self, contour: NormalEquations, damping: np.ndarray) -> np.ndarray:
        """(frame, dof, dof) diagonal matrices to add to normal matrices, for damping (frame,), 1 or more."""
        seen = np.einsum("fdd->fd", contour.matrix)[:, : self._dof]
        information = np.where(contour.observed[:, None], 1.0, _UNSEEN) * self._information
        pull = damping[:, None] * (information + _SHARE * (seen + information))
        diagonal: np.ndarray = pull[:, :, None] * np.eye(self._dof)
        return diagonal
