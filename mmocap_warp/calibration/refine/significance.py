"""Which parameters of cameras have to change: the others stay exactly where they were.

Every camera that may turn, move and zoom explains masks a little better, and is a little wrong by that. So of all
parameters that may change, those that matter least go back to where they were and the others follow, as long as they
matter less than chance does (backward elimination). What belongs together, such as a position along three axes, goes
back together: a camera that was moved has moved along its view too, and a longer lens, which looks nearly like that
alone, is not needed beside it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

CLEAR = 4.0
"""Standard deviations by which parameters that belong together must differ from where they were, in the mean."""
UNDETERMINED = 0.7
"""Of its prior standard deviation: what is known no better than that is not determined."""


@dataclass(frozen=True, eq=False)
class Selection:
    """What became of the parameters.

    Attributes:
        moved: (parameter,) bool: those that have to change.
        determined: (parameter,) bool: those that the data would tell, each with those that moved unknown beside it.
        sigma: (parameter,) their standard deviations, likewise.
    """

    moved: np.ndarray
    determined: np.ndarray
    sigma: np.ndarray


def selected(value: np.ndarray, covariance: np.ndarray, prior: np.ndarray, group: np.ndarray) -> Selection:
    """Choose among parameters.

    Args:
        value: (parameter,) how far each is from where it was.
        covariance: (parameter, parameter) of all.
        prior: (parameter,) standard deviations before anything was seen.
        group: (parameter,) int, the same for those that belong together.
    """
    information = np.linalg.inv(covariance)
    moved = np.ones(len(value), bool)
    while moved.any():
        at = np.flatnonzero(moved)
        own = np.linalg.inv(information[np.ix_(at, at)])
        held = information[np.ix_(at, np.flatnonzero(~moved))] @ -value[~moved]
        found = value[at] - own @ held  # where the others are best once some are back at zero
        clearly = {}
        for number in np.unique(group[at]):
            together = group[at] == number
            far = found[together] @ np.linalg.solve(own[np.ix_(together, together)], found[together])
            clearly[number] = np.sqrt(far / together.sum())
        least = min(clearly, key=lambda number: clearly[number])
        if clearly[least] >= CLEAR:
            break
        moved[group == least] = False
    sigma = np.empty(len(value))
    for parameter in range(len(value)):
        unknown = np.flatnonzero(moved | (np.arange(len(value)) == parameter))
        own = np.linalg.inv(information[np.ix_(unknown, unknown)])
        sigma[parameter] = np.sqrt(own[unknown == parameter][:, unknown == parameter][0, 0])
    return Selection(moved, sigma <= UNDETERMINED * prior, sigma)
