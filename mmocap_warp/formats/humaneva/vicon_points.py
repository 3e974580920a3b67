"""HumanEva's markers, and its fifteen joints computed from Vicon's segments, at the times of its video frames.

The markers are those of Vicon's Plug-in Gait. It also writes four points a segment: its origin ``O``, and where its
axes end: ``A`` forward (x), ``L`` to the left (y), ``P`` toward the trunk or up (z). The hip is at ``FEP``, the knee at
``FEO``, the ankle at ``TIO``, the shoulder at ``CLO``, the elbow at ``HUO``, the wrist at ``RAO``. HumanEva takes
joints from them and moves some, because a marker sits on the skin:

- the trunk starts 50 mm behind the pelvis's origin, is as long as from there to the thorax's, and leans back, at its
  top by half of the torso's radius;
- the upper arm is turned back, at the elbow by half of the shoulder's offset, and the forearm forward by that angle;
- the top of the head is 316.103 mm from the thorax's origin along the head's axis.

Where two limbs meet, HumanEva gives an end of each, and at the thorax and the elbows they differ: a joint here is their
mean.
"""

from collections.abc import Sequence
from functools import partial

import numpy as np

from mmocap_warp.formats.motion.captured_points import PointTracks

_MIDDLE = ("CLAV", "STRN", "C7", "T10", "RBAK")
_UPPER_BODY = ("FHD", "BHD", "SHO", "UPA", "ELB", "FRM", "WRA", "WRB", "FIN")
_LOWER_BODY = ("ASI", "PSI", "THI", "KNE", "TIB", "ANK", "HEE", "TOE")
MARKERS: tuple[str, ...] = (*_MIDDLE, *(side + name for side in "LR" for name in _UPPER_BODY + _LOWER_BODY))
"""The 39 markers that HumanEva asks for: a frame that lacks one of them is not valid."""

_OTHER_NAMES = {"LFRM": "LFRA", "RFRM": "RFRA"}  # the forearm's marker has two names


class MissingPointError(ValueError):
    """A recording lacks points, which the message names: whatever here takes a recording may raise it."""


def point_positions(tracks: PointTracks, *names: str) -> np.ndarray:
    """(frame, point, 3) [m]: where a name comes twice, its first."""
    missing = [name for name in names if name not in tracks.names]
    if missing:
        raise MissingPointError(f"has no {', '.join(missing)}")
    return tracks.positions[:, [tracks.names.index(name) for name in names]]


def markers_at(tracks: PointTracks, position: np.ndarray) -> np.ndarray:
    """(time, 39, 3) positions of ``MARKERS`` at fractional frames counted from 0 [m].

    All markers of a frame are NaN in which one is: HumanEva trusts no part of it.
    """
    names = (name if name in tracks.names else _OTHER_NAMES.get(name, name) for name in MARKERS)
    markers = interpolate_frames(point_positions(tracks, *names), position)
    return np.where(np.isfinite(markers).all(axis=(1, 2), keepdims=True), markers, np.nan)


def interpolate_frames(values: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Interpolate linearly: (frame, ...) at fractional frames (time,), counted from 0, to (time, ...).

    NaN beyond the ends, and where one of the two neighbours is NaN; a whole frame has one neighbour only.
    """
    lower, upper = np.floor(position).astype(int), np.ceil(position).astype(int)
    inside = (lower >= 0) & (upper < len(values))
    lower, upper = np.where(inside, lower, 0), np.where(inside, upper, 0)
    share = np.where(inside, position - lower, np.nan).reshape(-1, *[1] * (values.ndim - 1))
    return (1 - share) * values[lower] + share * values[upper]


JOINT_NAMES: tuple[str, ...] = (
    *("Root", "Neck", "HeadTop"),
    *("LShoulder", "LElbow", "LWrist", "LHip", "LKnee", "LAnkle"),
    *("RShoulder", "RElbow", "RWrist", "RHip", "RKnee", "RAnkle"),
)
"""HumanEva's joints by this project's names: Root is its pelvis, Neck its thorax."""

_PELVIS_BACK = 0.050  # [m]
_HEAD_LENGTH = 0.316103  # [m]
_MARKER_RADIUS = 0.007  # [m]


def torso_radius(static: PointTracks) -> float:
    """Half the mean distance of the shoulders' markers in the static trial less a marker's radius [m], or NaN."""
    left, right = np.moveaxis(point_positions(static, "LSHO", "RSHO"), 1, 0)
    span = np.linalg.norm(left - right, axis=1)
    seen = span[np.isfinite(span)]
    return float(seen.mean()) / 2 - _MARKER_RADIUS if len(seen) else np.nan


def joint_positions(
    tracks: PointTracks, position: np.ndarray, radius: float, shoulder_offsets: Sequence[float]
) -> np.ndarray:
    """(time, 15, 3) positions of ``JOINT_NAMES`` at fractional frames counted from 0 [m]; NaN where not known.

    Of the subject these are the torso's radius, and how far a shoulder's joint is from its marker, left and right [m].
    """
    turn = partial(_rotation, tracks, position)

    def point(name: str) -> np.ndarray:
        return interpolate_frames(point_positions(tracks, name)[:, 0], position)

    pelvis, thorax = point("PELO"), point("TRXO")
    trunk = np.linalg.norm(thorax - pelvis, axis=1)
    lean = np.arctan2(radius / 2, trunk)
    root = pelvis + turn("PEL") @ [-_PELVIS_BACK, 0.0, 0.0]
    trunk_top = root + _segment_vector(turn("PEL"), trunk, lean)
    head_top = thorax + turn("HED") @ [0.0, 0.0, _HEAD_LENGTH]
    joints = {"Root": root, "Neck": (trunk_top + thorax) / 2, "HeadTop": head_top}
    for side, offset in zip("LR", shoulder_offsets, strict=True):
        shoulder, elbow, wrist = (point(side + name) for name in ("CLO", "HUO", "RAO"))
        arm = _arm(shoulder, elbow, wrist, turn(f"{side}HU"), turn(f"{side}RA"), offset)
        leg = (point(side + name) for name in ("FEP", "FEO", "TIO"))
        names = ("Shoulder", "Elbow", "Wrist", "Hip", "Knee", "Ankle")
        joints |= {side + name: place for name, place in zip(names, (*arm, *leg), strict=True)}
    return np.stack([joints[name] for name in JOINT_NAMES], axis=1)


def _arm(
    shoulder: np.ndarray, elbow: np.ndarray, wrist: np.ndarray, upper: np.ndarray, lower: np.ndarray, offset: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """HumanEva's shoulder, elbow and wrist from Vicon's and the rotations of upper arm and forearm."""
    upper_length = np.linalg.norm(elbow - shoulder, axis=1)
    lower_length = np.linalg.norm(wrist - elbow, axis=1)
    angle = np.arctan2(offset / 2, upper_length)
    upper_end = shoulder - _segment_vector(upper, upper_length, -angle)
    lower_start = upper_end + elbow - (shoulder - _segment_vector(upper, upper_length, 0 * angle))
    return shoulder, (upper_end + lower_start) / 2, lower_start - _segment_vector(lower, lower_length, angle)


def _segment_vector(rotation: np.ndarray, length: np.ndarray, lean: np.ndarray) -> np.ndarray:
    """(time, 3): a segment's z axis of a length, after leaning back (toward -x) by an angle [rad]."""
    local = np.stack([-np.sin(lean), np.zeros_like(lean), np.cos(lean)], axis=-1)
    return np.einsum("tij,tj->ti", rotation, local * length[:, None])


def _rotation(tracks: PointTracks, position: np.ndarray, segment: str) -> np.ndarray:
    """(time, 3, 3), world from the segment's axes; between two frames the rotation nearest to their mix."""
    origin, *ends = np.moveaxis(point_positions(tracks, *(segment + letter for letter in "OALP")), 1, 0)
    axes = np.stack([end - origin for end in ends], axis=-1)
    axes /= np.linalg.norm(axes, axis=-2, keepdims=True)
    mixed = interpolate_frames(axes, position)
    known = np.isfinite(mixed).all(axis=(1, 2))
    u, _, vt = np.linalg.svd(mixed[known])
    rotation = np.full_like(mixed, np.nan)
    rotation[known] = u @ vt
    return rotation
