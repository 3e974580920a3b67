"""Cameras over the floor, from a person of known height who walks before them.

**One view** (Lv, Zhao and Nevatia 2002). The person is an upright stick. The pixels of its foot and its head give a ray
each; the foot's ray meets the floor, and the head is at a known height above that place. The camera's tilt, roll and
height explain all frames, and each frame's place on the floor follows.

**All views over one floor.** Two upright views of a walk differ by a rotation about the vertical and a shift on the
floor, and by no mirror image: both look down on the same side of it. A straight walk therefore is enough.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from mmocap_warp.calibration.solve import UnsolvableError

FEWEST_FRAMES = 12
"""Frames with the whole person from which a view is solved, and which it must share with the others, at least."""

_PIXEL_OUTLIER = 3.0  # pixels: residuals beyond this begin to count less
_START_TILTS = np.radians([-20.0, -5.0, 10.0, 25.0, 40.0, 55.0])
_START_HEIGHTS = (0.6, 1.2, 2.0, 3.5)  # metres
_MAX_TILT = np.radians(60.0)  # steeper cameras do not see a person as a stick
_MIN_HEIGHT, _MAX_HEIGHT = 0.1, 8.0  # metres of a plausible camera over the floor
_MIN_WALK = 0.25  # metres: standard deviation of places along the walk's main direction
_PLACE_OUTLIER = 0.1  # metres: places that differ by more begin to count less
_REWEIGHTINGS = 20


@dataclass(frozen=True, eq=False)
class StandingView:
    """A camera over the floor, in axes of its own: x to its right, y ahead, z up from the floor below it."""

    R: np.ndarray  # (3, 3), rotation from these axes to the camera's
    height: float  # of the camera over the floor [m]
    track: np.ndarray  # (frame, 2), where the person stood [m]; NaN where not seen


def standing_view(name: str, head: np.ndarray, foot: np.ndarray, K: np.ndarray, stature: float) -> StandingView:
    """Tilt, roll and height of a camera with intrinsics ``K`` [px], and the person's way over the floor.

    Args:
        name: of the camera, for errors.
        head, foot: (frame, 2), where the camera sees the person's ends [px]; NaN where it does not see all of it.
        K: (3, 3), intrinsics [px].
        stature: from the floor to the top of the head while walking [m].

    Raises:
        UnsolvableError: too few frames show the whole person, no plausible camera explains them, or nobody walks.
    """
    from scipy.optimize import least_squares

    # Only frames that show the whole person count.
    seen = np.isfinite(head[:, 0])
    if seen.sum() < FEWEST_FRAMES:
        raise UnsolvableError(
            f"camera '{name}': {int(seen.sum())} of {len(seen)} frames show the whole person, upright and inside the "
            f"image, and at least {FEWEST_FRAMES} are needed; record more, or place the camera further away"
        )
    head, foot = head[seen], foot[seen]
    right, down = (head - foot).mean(axis=0)
    # The camera may lie on its side, so its roll starts from the nearest quarter turn; tilt and height from a grid.
    quarter = 0.5 * np.pi * round(np.arctan2(right, -down) / (0.5 * np.pi))
    rays = np.concatenate([foot, np.ones((len(foot), 1))], axis=1) @ np.linalg.inv(K).T
    given, settings = (K, head, rays, stature), {"loss": "cauchy", "f_scale": _PIXEL_OUTLIER, "max_nfev": 60}
    starts = [[tilt, quarter, height] for tilt, height in product(_START_TILTS, _START_HEIGHTS)]
    solutions = [least_squares(_head_errors, start, args=given, **settings) for start in starts]
    # What explains the frames clearly worse than another start's end, by a pixel a frame, is no solution.
    enough = 2 * min(each.cost for each in solutions) + len(head)
    good = [each for each in solutions if each.cost <= enough]
    plausible = [each for each in good if abs(each.x[0]) < _MAX_TILT and _MIN_HEIGHT < each.x[2] < _MAX_HEIGHT]
    if not plausible:
        raise UnsolvableError(
            f"camera '{name}': nobody of {stature:.2f} m walks upright on a level floor in its masks; check --height, "
            "let the person walk several metres upright, and tilt the camera less than 60 degrees down"
        )
    # The best camera gives the person's places on the floor, which must be apart.
    tilt, roll, height = min(plausible, key=lambda each: float(each.cost)).x
    R = _rotation_over_floor(tilt, roll)
    track = np.full((len(seen), 2), np.nan)
    track[seen] = _on_floor(R, height, rays)[:, :2]
    walked = float(np.sqrt(np.linalg.eigvalsh(np.cov(track[seen].T))[1]))
    if walked < _MIN_WALK:
        raise UnsolvableError(
            f"camera '{name}': the person hardly moves (standard deviation {walked:.2f} m, at least {_MIN_WALK} m are "
            "needed); record somebody who walks about"
        )
    return StandingView(R, float(height), track)


def _rotation_over_floor(tilt: float, roll: float) -> np.ndarray:
    """(3, 3), rotation to the camera's axes from axes over the floor: x right, y ahead, z up."""
    c, s = np.cos(roll), np.sin(roll)
    up = np.array([s * np.cos(tilt), -c * np.cos(tilt), -np.sin(tilt)])
    ahead = np.array([0.0, 0.0, 1.0]) - up * up[2]
    ahead /= np.linalg.norm(ahead)
    # Their cross product by components: np.cross takes ten times as long for one pair of vectors.
    (ax, ay, az), (ux, uy, uz) = ahead, up
    return np.stack([[ay * uz - az * uy, az * ux - ax * uz, ax * uy - ay * ux], ahead, up], axis=1)


def _on_floor(R: np.ndarray, height: float, rays: np.ndarray) -> np.ndarray:
    """(n, 3), where rays (n, 3) in the camera's axes meet the floor, from the camera, in axes over the floor [m]."""
    turned = rays @ R
    return turned * (height / np.maximum(-turned[:, 2:], 1e-3))


def _head_errors(unknown: np.ndarray, K: np.ndarray, head: np.ndarray, rays: np.ndarray, stature: float) -> np.ndarray:
    """(2 n,), reprojection errors of the heads [px] above the places of the feet, which are seen along ``rays``."""
    tilt, roll, height = unknown
    R = _rotation_over_floor(tilt, roll)
    top = _on_floor(R, height, rays) + np.array([0.0, 0.0, stature])
    seen = top @ R.T @ K.T
    return np.clip(seen[:, :2] / np.maximum(seen[:, 2:], 0.1) - head, -1e4, 1e4).ravel()


def place_on_floor(names: Sequence[str], views: Sequence[StandingView]) -> tuple[np.ndarray, np.ndarray]:
    """R (camera, 3, 3) and t (camera, 3), world to camera, of cameras over a floor at z = 0.

    The view with most frames comes first: it stands over the origin and looks along +y. Raises an UnsolvableError for a
    view that shares too few frames with the others.
    """
    tracks = np.stack([view.track for view in views])  # (camera, frame, 2)
    seen = np.isfinite(tracks[..., 0])
    turn, shift = np.zeros((len(views), 2, 2)), np.zeros((len(views), 2))
    first = int(seen.sum(axis=1).argmax())
    turn[first], placed = np.eye(2), [first]
    while len(placed) < len(views):
        # Next is the view that shares most frames with the placed ones.
        known = seen[placed].any(axis=0)
        shared = np.where(np.isin(np.arange(len(views)), placed), -1, (seen & known).sum(axis=1))
        k = int(shared.argmax())
        if shared[k] < FEWEST_FRAMES:
            raise UnsolvableError(
                f"camera '{names[k]}' shows the whole person together with another in {shared[k]} frames; at least "
                f"{FEWEST_FRAMES} are needed"
            )
        # Its track is aligned with the mean of theirs; at least one of them saw each frame.
        common = seen[k] & known
        there = np.nanmean([tracks[j][common] @ turn[j].T + shift[j] for j in placed], axis=0)
        turn[k], shift[k] = rigid_motion(tracks[k][common], there)
        placed.append(k)
    # From axes over the floor to cameras.
    R, t = np.zeros((len(views), 3, 3)), np.zeros((len(views), 3))
    for k, view in enumerate(views):
        own = np.eye(3)
        own[:2, :2] = turn[k].T
        R[k] = view.R @ own
        t[k] = -R[k] @ [*shift[k], view.height]
    return R, t


def rigid_motion(here: np.ndarray, there: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The rotation (2, 2) and shift (2,) that map places (n, 2) [m] to others: least squares with Cauchy's weights."""
    weight = np.ones(len(here))
    for _ in range(_REWEIGHTINGS):
        a, b = np.average(here, axis=0, weights=weight), np.average(there, axis=0, weights=weight)
        moment = ((here - a) * weight[:, None]).T @ (there - b)
        angle = np.arctan2(moment[0, 1] - moment[1, 0], moment[0, 0] + moment[1, 1])
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        shift = b - turn @ a
        weight = 1 / (1 + (np.linalg.norm(here @ turn.T + shift - there, axis=1) / _PLACE_OUTLIER) ** 2)
    return turn, shift
