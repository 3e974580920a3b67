"""HumanEva's markers at the times of its video frames: Vicon's Plug-in Gait set, with HumanEva's rule of validity."""

from __future__ import annotations

import numpy as np

from mmocap_warp.formats.motion.read_trc import PointTracks

_MIDDLE = ("CLAV", "STRN", "C7", "T10", "RBAK")
_ABOVE = ("FHD", "BHD", "SHO", "UPA", "ELB", "FRM", "WRA", "WRB", "FIN")
_BELOW = ("ASI", "PSI", "THI", "KNE", "TIB", "ANK", "HEE", "TOE")
MARKERS: tuple[str, ...] = (*_MIDDLE, *(side + name for side in "LR" for name in _ABOVE + _BELOW))
"""The 39 markers that HumanEva asks for: a frame that lacks one of them is not valid."""

_OTHER_NAMES = {"LFRM": "LFRA", "RFRM": "RFRA"}  # the forearm's marker goes by either


class MissingPointError(ValueError):
    """A recording lacks points; the message names them."""


def points_named(tracks: PointTracks, *names: str) -> np.ndarray:
    """(frame, point, 3) [m]: where a name comes twice, its first.

    Raises:
        MissingPointError: names that the recording does not have.
    """
    missing = [name for name in names if name not in tracks.names]
    if missing:
        raise MissingPointError(f"has no {', '.join(missing)}")
    return tracks.positions[:, [tracks.names.index(name) for name in names]]


def captured_markers(tracks: PointTracks) -> np.ndarray:
    """(frame, 39, 3) positions of ``MARKERS`` [m].

    Raises:
        MissingPointError: markers that the recording does not have.
    """
    names = (name if name in tracks.names else _OTHER_NAMES.get(name, name) for name in MARKERS)
    return points_named(tracks, *names)


def between_frames(values: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Interpolate linearly: (frame, ...) at fractional frames (time,), counted from 0, to (time, ...).

    NaN beyond the ends, and where one of the two neighbours is NaN; a whole frame has one neighbour only.
    """
    lower, upper = np.floor(position).astype(int), np.ceil(position).astype(int)
    inside = (lower >= 0) & (upper < len(values))
    lower, upper = np.where(inside, lower, 0), np.where(inside, upper, 0)
    share = np.where(inside, position - lower, np.nan).reshape(-1, *[1] * (values.ndim - 1))
    return (1 - share) * values[lower] + share * values[upper]


def only_valid(markers: np.ndarray) -> np.ndarray:
    """(time, marker, 3) with every marker of a frame NaN in which one is: HumanEva trusts no part of it."""
    valid = np.isfinite(markers).all(axis=(1, 2))
    return np.where(valid[:, None, None], markers, np.nan)
