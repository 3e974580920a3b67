"""One camera over the floor, from a person of known height who walks before it (Lv, Zhao and Nevatia 2002).

The person is an upright stick. Where its foot and its head are seen gives a ray each; the foot's meets the floor, the
head is known to be so much above that place. So few numbers as the camera's tilt, roll and height explain all frames,
and each frame's place on the floor follows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mmocap_warp.calibration.solve.person_axis import PersonInView
from mmocap_warp.calibration.solve.unsolvable import UnsolvableError

FEWEST_FRAMES = 12
"""With the whole person, that a view is solved from."""

_OUTLIER = 3.0  # [px], where residuals begin to count for less
_TILTS = np.radians([-20.0, -5.0, 10.0, 25.0, 40.0, 55.0])  # to start from
_HEIGHTS = (0.6, 1.2, 2.0, 3.5)  # [m]
_STEEPEST = np.radians(60.0)  # below which a person still looks like a stick
_LOWEST, _HIGHEST = 0.1, 8.0  # [m], of a camera that can be meant
_SHORTEST_WALK = 0.25  # [m], standard deviation along the walk's main direction


@dataclass(frozen=True, eq=False)
class StandingView:
    """A camera over the floor, in axes of its own: x to its right, y ahead, z up from the floor below it.

    Attributes:
        R: (3, 3), rotation from these axes to the camera's.
        height: of the camera over the floor [m].
        track: (frame, 2), where the person stood [m]; NaN where not seen.
    """

    R: np.ndarray
    height: float
    track: np.ndarray

    @property
    def tilt(self) -> float:
        """How far it looks down [rad]."""
        return float(np.arcsin(-self.R[2, 2]))


def standing_view(name: str, person: PersonInView, K: np.ndarray, stature: float) -> StandingView:
    """Tilt, roll and height of a camera, and the person's way over the floor.

    Args:
        name: of the camera, for errors.
        person: as the camera sees it.
        K: (3, 3), intrinsics [px].
        stature: from the floor to the top of the head while walking [m].

    Raises:
        UnsolvableError: too few frames show the whole person, no camera that could be meant explains them, or the
            person does not walk.
    """
    from scipy.optimize import least_squares

    seen = person.whole
    if seen.sum() < FEWEST_FRAMES:
        raise UnsolvableError(
            f"camera '{name}' shows the whole person, upright and inside the image, in {int(seen.sum())} of "
            f"{len(seen)} frames; at least {FEWEST_FRAMES} are needed"
        )
    head, foot = person.head[seen], person.foot[seen]
    right, down = (head - foot).mean(axis=0)
    quarter = 0.5 * np.pi * round(np.arctan2(right, -down) / (0.5 * np.pi))  # a camera may lie on its side
    solutions = [
        least_squares(
            _missed,
            [tilt, quarter, height],
            args=(K, head, foot, stature),
            loss="cauchy",
            f_scale=_OUTLIER,
            max_nfev=60,
        )
        for tilt in _TILTS
        for height in _HEIGHTS
    ]
    plausible = [each for each in solutions if abs(each.x[0]) < _STEEPEST and _LOWEST < each.x[2] < _HIGHEST]
    if not plausible:
        raise UnsolvableError(
            f"the person in camera '{name}' is no upright stick of {stature:.2f} m on a level floor; let the person "
            "walk upright, over several metres, before cameras that look less than 60 degrees down"
        )
    tilt, roll, height = min(plausible, key=lambda each: float(each.cost)).x
    R = _own_axes(tilt, roll)
    track = np.full((len(seen), 2), np.nan)
    track[seen] = _on_floor(R, height, K, foot)[:, :2]
    walked = float(np.sqrt(np.linalg.eigvalsh(np.cov(track[seen].T))[1]))
    if walked < _SHORTEST_WALK:
        raise UnsolvableError(
            f"the person hardly leaves one place in camera '{name}' (standard deviation {walked:.2f} m, at least "
            f"{_SHORTEST_WALK} are needed); record somebody who walks about"
        )
    return StandingView(R, float(height), track)


def _own_axes(tilt: float, roll: float) -> np.ndarray:
    """(3, 3), rotation to the camera's axes from x right, y ahead, z up."""
    c, s = np.cos(roll), np.sin(roll)
    up = np.array([s * np.cos(tilt), -c * np.cos(tilt), -np.sin(tilt)])
    ahead = np.array([0.0, 0.0, 1.0]) - up * up[2]
    ahead /= np.linalg.norm(ahead)
    return np.stack([np.cross(ahead, up), ahead, up], axis=1)


def _on_floor(R: np.ndarray, height: float, K: np.ndarray, foot: np.ndarray) -> np.ndarray:
    """(n, 3), where the rays through feet meet the floor, from the camera, in its own axes [m]."""
    rays = np.concatenate([foot, np.ones((len(foot), 1))], axis=1) @ np.linalg.inv(K).T @ R
    return rays * (height / np.maximum(-rays[:, 2:], 1e-3))


def _missed(unknown: np.ndarray, K: np.ndarray, head: np.ndarray, foot: np.ndarray, stature: float) -> np.ndarray:
    """(2 n,), by how much the heads above the feet's places are seen elsewhere [px]."""
    tilt, roll, height = unknown
    R = _own_axes(tilt, roll)
    top = _on_floor(R, height, K, foot) + np.array([0.0, 0.0, stature])
    seen = top @ R.T @ K.T
    return np.clip(seen[:, :2] / np.maximum(seen[:, 2:], 0.1) - head, -1e4, 1e4).ravel()
