"""Cameras from epipolar tangents: planes through two cameras that touch a body touch both its silhouettes (frontier
points; Cipolla, Astrom and Giblin 1995, Sinha and Pollefeys 2010).

Of all planes through the centres of two cameras those that touch the body are the same in both views, whatever its
shape and pose. So in each frame every pair of views gives two equations for the cameras, and needs no model of the
person: only the convex hulls of the silhouettes count.
"""

from dataclasses import dataclass, replace
from itertools import combinations
from typing import Self

import numpy as np

OUTLIERS = (20.0, 5.0, 1.5)
"""Residuals beyond these begin to count less, one stage after the other [px]."""
MAX_MISS = 3.0
"""Residual of a tangent that two views agree on, at most [px]."""
FOCAL_SIGMA, LIKE_SIGMA = 0.25, 0.04
"""Standard deviations of the logarithms of guessed focal lengths: of their mean, and of each from the mean."""

_MAX_STEPS = 30  # steps of each stage
_MIN_GAIN = 1e-6  # share of the cost: a stage ends at a smaller gain
_MAX_ANGLE = 2.5  # radians that a silhouette spans about the line through two cameras: a wider one may be pierced by it
_MISSING = 50.0  # pixels: the residual of a tangent that should be there and is not
_CORRELATED = 10  # residuals that err alike, and count as one beside the prior of focal lengths
_NUDGE = 1e-6  # step for derivatives by differences [rad, m, 1]


@dataclass(frozen=True, eq=False)
class Pinholes:
    """Pinhole cameras as arrays."""

    R: np.ndarray  # (camera, 3, 3), rotation, world to camera
    centre: np.ndarray  # (camera, 3), optical centres [m]
    focal: np.ndarray  # (camera, 2), focal lengths [px]
    middle: np.ndarray  # (camera, 2), principal points [px]

    def moved(self, step: np.ndarray) -> Self:
        """The cameras after a step (camera, 7): rotation [rad], shift [m] and logarithm of the zoom."""
        from scipy.spatial.transform import Rotation

        turned = Rotation.from_rotvec(step[:, :3]).as_matrix() @ self.R
        return replace(self, R=turned, centre=self.centre + step[:, 3:6], focal=self.focal * np.exp(step[:, 6:]))

    def rays(self, camera: np.ndarray, pixels: np.ndarray) -> np.ndarray:
        """Directions in the world (..., 3), of length one, through pixels (..., 2) of cameras (...)."""
        plane = (pixels - self.middle[camera]) / self.focal[camera]
        seen = np.concatenate([plane, np.ones((*plane.shape[:-1], 1))], axis=-1)
        rays = np.einsum("...i,...ij->...j", seen, self.R[camera])
        return rays / np.linalg.norm(rays, axis=-1, keepdims=True)


@dataclass(frozen=True, eq=False)
class Tangents:
    """Points of two silhouettes where a plane through both cameras touches them."""

    camera: np.ndarray  # (2, n) int, the first and the second camera
    frame: np.ndarray  # (n,) int
    pixel: np.ndarray  # (2, n, 2), the point in the first and the second view [px]
    missing: int = 0  # tangents that do not exist because a silhouette surrounds the line through two cameras

    def in_view(self, k: int) -> np.ndarray:
        """(n,) bool: the tangents of which one point is in this view."""
        return (self.camera == k).any(axis=0)


def find_tangents(cameras: Pinholes, hulls: np.ndarray) -> Tangents:
    """Both tangents of every pair of views in every frame, for the cameras where they are.

    ``hulls`` are the silhouettes' convex hulls, (camera, frame, corner, 2) [px]; NaN where there is none.
    """
    # A ray through each corner of each hull, and the mean ray of each hull.
    seen = np.isfinite(hulls[:, :, 0, 0])
    filled = np.where(seen[..., None, None], hulls, 0.0)
    rays = np.stack([cameras.rays(np.full(one.shape[:2], k), one) for k, one in enumerate(filled)])
    towards = rays.mean(axis=2)
    pairs, numbers, pixels, missing = [np.zeros((2, 0), int)], [np.zeros(0, int)], [np.zeros((2, 0, 2))], 0
    for i, j in combinations(range(len(hulls)), 2):
        frames = np.flatnonzero(seen[i] & seen[j])
        if not len(frames):
            continue
        line = cameras.centre[j] - cameras.centre[i]
        line /= np.linalg.norm(line)
        # Planes through the line are numbered by their angle about it, counted from the person; the silhouette's first
        # and last planes touch it.
        ends, narrow = [], np.ones(len(frames), bool)
        ahead = towards[i, frames] + towards[j, frames]
        ahead -= (ahead @ line)[:, None] * line
        for k in (i, j):
            sides = (np.einsum("fci,fi->fc", rays[k, frames], way) for way in (np.cross(line, ahead), ahead))
            angle = np.arctan2(*sides)
            narrow &= np.ptp(angle, axis=1) < _MAX_ANGLE
            ends.append(np.stack([angle.argmin(axis=1), angle.argmax(axis=1)]))  # (end, frame)
        # A silhouette that surrounds the line has no tangents.
        missing += 2 * int(np.sum(~narrow))
        frames, ends = frames[narrow], [each[:, narrow] for each in ends]
        corners = zip((i, j), ends, strict=True)
        pixels.append(np.stack([hulls[k][np.tile(frames, 2), corner.ravel()] for k, corner in corners]))
        pairs.append(np.repeat([[i], [j]], 2 * len(frames), axis=1))
        numbers.append(np.tile(frames, 2))
    return Tangents(np.concatenate(pairs, axis=1), np.concatenate(numbers), np.concatenate(pixels, axis=1), missing)


def residuals(cameras: Pinholes, tangents: Tangents) -> np.ndarray:
    """(n,), the angle between the planes through the two views' points, in pixels that both views share."""
    a, b = cameras.rays(tangents.camera, tangents.pixel)
    i, j = tangents.camera
    line = cameras.centre[j] - cameras.centre[i]
    line = line / np.linalg.norm(line, axis=-1, keepdims=True)
    along = np.array([np.einsum("ni,ni->n", each, line) for each in (a, b)])
    sine = np.einsum("ni,ni->n", line, np.cross(a, b))
    angle = np.arctan2(sine, np.einsum("ni,ni->n", a, b) - along[0] * along[1])
    # A plane that turns by an angle moves its trace in a view by that angle times the sine between ray and line.
    share = 1 / np.maximum(cameras.focal[tangents.camera, 0] ** 2 * (1 - along**2), 1e-12)
    return angle / np.sqrt(share[0] + share[1])


def solve_tangents(
    cameras: Pinholes, hulls: np.ndarray, free_focal: np.ndarray, outliers: tuple[float, ...] = OUTLIERS
) -> Pinholes:
    """The cameras near the given ones on which tangents agree best, by Levenberg-Marquardt with Cauchy's weights.

    The world's origin, rotation and scale are not determined, and stay nearly as they were. ``hulls`` are those of
    :func:`find_tangents`; ``free_focal`` (camera,) bool says whose focal length is a guess and may change.
    """
    guess = np.log(cameras.focal[:, 0])
    for outlier in outliers:
        damping = 1e-3
        cost = _cost(cameras, find_tangents(cameras, hulls), outlier, guess)
        for _ in range(_MAX_STEPS):
            tangents = find_tangents(cameras, hulls)
            information, gradient = _normal_equations(cameras, tangents, outlier, guess, free_focal)
            # Parameters that are held have an empty column. Damping grows until a step lowers the cost.
            held = np.diag(information) == 0
            while True:
                damped = information + np.diag(damping * np.diag(information) + np.where(held, 1.0, 1e-9))
                trial = cameras.moved(-np.linalg.solve(damped, gradient).reshape(-1, 7))
                better = _cost(trial, find_tangents(trial, hulls), outlier, guess)
                if better < cost or damping > 1e6:
                    break
                damping *= 8
            if better >= cost:
                break
            # A good step lowers the damping.
            gain, cameras, cost, damping = cost - better, trial, better, max(damping / 8, 1e-6)
            if gain < _MIN_GAIN * cost:
                break
    return cameras


def _cost(cameras: Pinholes, tangents: Tangents, outlier: float, guess: np.ndarray) -> float:
    """The robust cost of all tangents, of those that are missing, and of the prior of focal lengths."""
    prior = _prior(np.log(cameras.focal[:, 0]) - guess, outlier)
    losses = np.log1p((residuals(cameras, tangents) / outlier) ** 2)
    # Missing tangents cost, or cameras would turn until no pair of views has any.
    missing = tangents.missing * np.log1p((_MISSING / outlier) ** 2)
    return 0.5 * outlier**2 * float(losses.sum() + missing) + 0.5 * float(prior @ prior)


def _prior(zoom: np.ndarray, outlier: float) -> np.ndarray:
    """(camera + 1,), residuals of focal lengths: of each from their mean, and of the mean from the guess [px]."""
    weight = outlier * np.sqrt(_CORRELATED)
    return np.append((zoom - zoom.mean()) / LIKE_SIGMA, zoom.mean() / FOCAL_SIGMA) * weight


def _normal_equations(
    cameras: Pinholes, tangents: Tangents, outlier: float, guess: np.ndarray, free_focal: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The Gauss-Newton matrix and gradient, (7 camera, 7 camera) and (7 camera,)."""
    count, now = len(cameras.R), residuals(cameras, tangents)
    weight = 1 / (1 + (now / outlier) ** 2)
    # Derivatives of each residual by the parameters of its two cameras, by differences.
    rows = np.zeros((len(now), count, 7))
    for k in range(count):
        mine = tangents.in_view(k)
        part = Tangents(tangents.camera[:, mine], tangents.frame[mine], tangents.pixel[:, mine])
        for column in range(7 if free_focal[k] else 6):
            step = np.zeros((count, 7))
            step[k, column] = _NUDGE
            rows[mine, k, column] = (residuals(cameras.moved(step), part) - now[mine]) / _NUDGE
    # The normal equations, with the prior of the free focal lengths.
    flat = rows.reshape(len(now), -1)
    information, gradient = flat.T @ (weight[:, None] * flat), flat.T @ (weight * now)
    if free_focal.any():
        by_zoom = np.stack([_prior(each, outlier) for each in np.eye(count)[free_focal]], axis=1)
        zooms = 7 * np.flatnonzero(free_focal) + 6
        information[np.ix_(zooms, zooms)] += by_zoom.T @ by_zoom
        gradient[zooms] += by_zoom.T @ _prior(np.log(cameras.focal[:, 0]) - guess, outlier)
    return information, gradient
