"""Cameras from epipolar tangents: planes through two cameras that touch a body touch both its silhouettes (frontier
points; Cipolla, Astrom and Giblin 1995, Sinha and Pollefeys 2010).

Of all planes through the centres of two cameras those that touch the body are the same in both views, whatever its
shape and pose. So in each frame every pair of views gives two equations for the cameras, and needs no model of the
person: only the convex hulls of the silhouettes count.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

OUTLIERS = (20.0, 5.0, 1.5)
"""[px], one after the other: where residuals begin to count for less."""

_STEPS = 30  # at each of these, at most
_DONE = 1e-6  # of the cost, a gain that is none
_WIDEST = 2.5  # [rad], of a silhouette about the line through two cameras; wider, and that line may pierce it
_MISSING = 50.0  # [px], the residual of a tangent that should be there and is not
_ALIKE = 10  # residuals that err alike, and count as one beside what is expected of focal lengths
_NUDGE = 1e-6  # [rad, m, 1], for derivatives
FOCAL_SIGMA, LIKE_SIGMA = 0.25, 0.04
"""Standard deviations of the logarithms of guessed focal lengths: of their mean, and of each from it."""


@dataclass(frozen=True, eq=False)
class Pinholes:
    """Cameras as the equations know them.

    Attributes:
        R: (camera, 3, 3), rotation, world to camera.
        centre: (camera, 3), optical centres [m].
        focal: (camera, 2), focal lengths [px].
        middle: (camera, 2), principal points [px].
    """

    R: np.ndarray
    centre: np.ndarray
    focal: np.ndarray
    middle: np.ndarray

    def moved(self, step: np.ndarray) -> Pinholes:
        """The cameras after a step (camera, 7): a turn [rad], a shift [m] and the logarithm of a zoom each."""
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
    """Points of two silhouettes where a plane through both cameras touches them.

    Attributes:
        first, second: (n,) int, the cameras.
        frame: (n,) int.
        pixel: (2, n, 2), the point in the first and the second view [px].
        missing: how many more there would be if no silhouette lay about the line through two cameras.
    """

    first: np.ndarray
    second: np.ndarray
    frame: np.ndarray
    pixel: np.ndarray
    missing: int = 0


def touching(cameras: Pinholes, hulls: np.ndarray) -> Tangents:
    """Both tangents of every pair of views and frame, as the cameras stand.

    Args:
        cameras: where they are.
        hulls: (camera, frame, corner, 2), convex hulls of the silhouettes [px]; NaN where there is none.
    """
    seen = np.isfinite(hulls[:, :, 0, 0])
    filled = np.where(seen[..., None, None], hulls, 0.0)
    rays = np.stack([cameras.rays(np.full(one.shape[:2], k), one) for k, one in enumerate(filled)])
    towards = rays.mean(axis=2)
    found, missing = [], 0
    for i, j in combinations(range(len(hulls)), 2):
        frames = np.flatnonzero(seen[i] & seen[j])
        if not len(frames):
            continue
        line = cameras.centre[j] - cameras.centre[i]
        line /= np.linalg.norm(line)
        ends, narrow = [], np.ones(len(frames), bool)
        for k in (i, j):
            ahead = towards[i, frames] + towards[j, frames]
            ahead -= (ahead @ line)[:, None] * line
            aside = np.cross(line, ahead)
            angle = np.arctan2(
                np.einsum("fci,fi->fc", rays[k, frames], aside), np.einsum("fci,fi->fc", rays[k, frames], ahead)
            )
            narrow &= np.ptp(angle, axis=1) < _WIDEST
            ends.append(np.stack([angle.argmin(axis=1), angle.argmax(axis=1)]))  # (end, frame)
        missing += 2 * int(np.sum(~narrow))
        frames, ends = frames[narrow], [each[:, narrow] for each in ends]
        pixel = np.stack([hulls[k][np.tile(frames, 2), each.ravel()] for k, each in zip((i, j), ends, strict=True)])
        count = 2 * len(frames)
        found.append(Tangents(np.full(count, i), np.full(count, j), np.tile(frames, 2), pixel))
    first, second, frame = (
        np.concatenate([getattr(each, name) for each in found]) for name in ("first", "second", "frame")
    )
    return Tangents(first, second, frame, np.concatenate([each.pixel for each in found], axis=1), missing)


def residuals(cameras: Pinholes, tangents: Tangents) -> np.ndarray:
    """(n,), the angle between the planes through either view's point, as pixels that both views share."""
    i, j = tangents.first, tangents.second
    a, b = cameras.rays(i, tangents.pixel[0]), cameras.rays(j, tangents.pixel[1])
    line = cameras.centre[j] - cameras.centre[i]
    line = line / np.linalg.norm(line, axis=-1, keepdims=True)
    along_a, along_b = (np.einsum("ni,ni->n", each, line) for each in (a, b))
    sine = np.einsum("ni,ni->n", line, np.cross(a, b))
    angle = np.arctan2(sine, np.einsum("ni,ni->n", a, b) - along_a * along_b)
    # A turn of the plane by an angle moves its trace in a view by that angle times the sine between ray and line.
    share = [
        1 / np.maximum(cameras.focal[k, 0] ** 2 * (1 - along**2), 1e-12) for k, along in ((i, along_a), (j, along_b))
    ]
    return angle / np.sqrt(share[0] + share[1])


def adjusted(
    cameras: Pinholes, hulls: np.ndarray, free_focal: np.ndarray, outliers: tuple[float, ...] = OUTLIERS
) -> Pinholes:
    """The cameras that the tangents agree on best, near to those given; Levenberg and Marquardt, Cauchy's weights.

    Where the world lies, how it is turned and its scale are not determined and stay about as they were.

    Args:
        cameras: to start with.
        hulls: see :func:`touching`.
        free_focal: (camera,) bool, whose focal length is a guess and may change.
        outliers: see ``OUTLIERS``.
    """
    guess = np.log(cameras.focal[:, 0])
    for outlier in outliers:
        damping = 1e-3
        cost = _cost(cameras, touching(cameras, hulls), outlier, guess)
        for _ in range(_STEPS):
            tangents = touching(cameras, hulls)
            information, gradient = _normal_equations(cameras, tangents, outlier, guess, free_focal)
            held = np.diag(information) == 0
            while True:
                damped = information + np.diag(damping * np.diag(information) + np.where(held, 1.0, 1e-9))
                tried = cameras.moved(-np.linalg.solve(damped, gradient).reshape(-1, 7))
                better = _cost(tried, touching(tried, hulls), outlier, guess)
                if better < cost or damping > 1e6:
                    break
                damping *= 8
            if better >= cost:
                break
            gain, cameras, cost, damping = cost - better, tried, better, max(damping / 8, 1e-6)
            if gain < _DONE * cost:
                break
    return cameras


def _cost(cameras: Pinholes, tangents: Tangents, outlier: float, guess: np.ndarray) -> float:
    prior = _prior(np.log(cameras.focal[:, 0]) - guess, outlier)
    losses = np.log1p((residuals(cameras, tangents) / outlier) ** 2)
    missing = tangents.missing * np.log1p((_MISSING / outlier) ** 2)  # a pair of views is not to be turned out of use
    return 0.5 * outlier**2 * float(losses.sum() + missing) + 0.5 * float(prior @ prior)


def _prior(zoom: np.ndarray, outlier: float) -> np.ndarray:
    """(camera + 1,), by how much focal lengths differ from their guesses, and from each other's, as residuals [px]."""
    weight = outlier * np.sqrt(_ALIKE)
    return np.append((zoom - zoom.mean()) / LIKE_SIGMA, zoom.mean() / FOCAL_SIGMA) * weight


def _normal_equations(
    cameras: Pinholes, tangents: Tangents, outlier: float, guess: np.ndarray, free_focal: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Gauss' and Newton's matrix and gradient, (7 camera, 7 camera) and (7 camera,)."""
    count = len(cameras.R)
    now = residuals(cameras, tangents)
    weight = 1 / (1 + (now / outlier) ** 2)
    rows = np.zeros((len(now), count, 7))
    place = np.arange(len(now))
    for k in range(count):
        for column in range(7 if free_focal[k] else 6):
            step = np.zeros((count, 7))
            step[k, column] = _NUDGE
            mine = (tangents.first == k) | (tangents.second == k)
            part = Tangents(tangents.first[mine], tangents.second[mine], tangents.frame[mine], tangents.pixel[:, mine])
            rows[place[mine], k, column] = (residuals(cameras.moved(step), part) - now[mine]) / _NUDGE
    flat = rows.reshape(len(now), -1)
    information = flat.T @ (weight[:, None] * flat)
    gradient = flat.T @ (weight * now)
    if free_focal.any():
        by_zoom = np.stack([_prior(each, outlier) for each in np.eye(count)[free_focal]], axis=1)
        zooms = 7 * np.flatnonzero(free_focal) + 6
        information[np.ix_(zooms, zooms)] += by_zoom.T @ by_zoom
        gradient[zooms] += by_zoom.T @ _prior(np.log(cameras.focal[:, 0]) - guess, outlier)
    return information, gradient
