"""Cameras and their times from two points of every silhouette: rough, but from far off, and without a body.

The middle of a silhouette is seen nearly where the body's middle is, and its highest point is nearly the body's, in
every view alike. Over frames these are points that several cameras follow: a small bundle adjustment of them turns and
moves cameras that contours cannot, because their outlines meet nobody.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mmocap_warp.calibration.adjust.camera_changes import OFFSET, changed
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.masks.observation import Observation, unpack_masks

_TOP = 0.02  # of a silhouette's pixels are its highest
_SIGMA = 0.04  # [m] at the body, by which middles and highest points of silhouettes differ from those of the body
_FEWEST = 50  # foreground pixels of a view; fewer show nobody
_BORDER = 2  # px: who is seen up to an image's edge may go on beyond it


def landmarks(rig: CameraRig, observations: Sequence[Observation]) -> np.ndarray:
    """Middle and highest point of every silhouette, (frame, camera, 2, 2) float64 [px]; NaN where there is none.

    Silhouettes that touch the edge of their image have none: what is beyond it is not known.

    Args:
        rig: the cameras, for which way is up in their images.
        observations: masks.
    """
    found = np.full((len(observations), len(rig), 2, 2), np.nan)
    up = rig.R @ rig.up_vector
    for frame, observation in enumerate(observations):
        for k, mask in enumerate(unpack_masks(observation.words, rig.size)):
            rows, columns = np.nonzero(mask)
            if len(rows) < _FEWEST or _touches(mask):
                continue
            points = np.stack([columns, rows], axis=1).astype(float)
            height = points @ up[k, :2]
            highest = height >= np.quantile(height, 1 - _TOP)
            found[frame, k] = points.mean(axis=0), points[highest].mean(axis=0)
    return found


def _touches(mask: np.ndarray) -> bool:
    inner = mask[_BORDER:-_BORDER, _BORDER:-_BORDER]
    return int(inner.sum()) < int(mask.sum())


@dataclass(frozen=True, eq=False)
class LandmarkProblem:
    """Cameras before points that move.

    Attributes:
        rig: cameras to start from.
        seen: (frame, camera, point, 2) of consecutive frames [px], NaN where a point is not seen.
        fps: of these frames.
        sigma: (camera, parameter) how far cameras may be from ``rig``; zero for what is held.
    """

    rig: CameraRig
    seen: np.ndarray
    fps: float
    sigma: np.ndarray

    def solved(self) -> np.ndarray:
        """(camera, parameter) by which cameras are changed so that points are seen where they meet."""
        from scipy.optimize import least_squares

        free = self.sigma > 0

        def residuals(standardised: np.ndarray) -> np.ndarray:
            error = self.errors(self._change(standardised)) / _SIGMA
            pull = np.sqrt(np.isfinite(error).sum() / error.shape[0]) * standardised  # as one frame would have it
            return np.concatenate([np.nan_to_num(error).ravel(), pull])

        found = least_squares(residuals, np.zeros(int(free.sum())), loss="soft_l1", x_scale=1.0, max_nfev=50)
        return self._change(found.x)

    def _change(self, standardised: np.ndarray) -> np.ndarray:
        change = np.zeros(self.sigma.shape)
        free = self.sigma > 0
        change[free] = standardised * self.sigma[free]
        return change

    def errors(self, change: np.ndarray) -> np.ndarray:
        """(frame, camera, point, 2) how far points are seen from where all cameras together put them [m at the body].

        NaN where a point is seen by less than two cameras.
        """
        rig = changed(self.rig, change)
        seen = self._at_times(change[:, OFFSET])
        focal, middle = rig.K[:, [0, 1], [0, 1]][:, None], rig.K[:, :2, 2][:, None]
        plane = (seen - middle) / focal
        ray = np.einsum("kji,fkpj->fkpi", rig.R, np.concatenate([plane, np.ones_like(plane[..., :1])], axis=-1))
        ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
        known = np.isfinite(ray).all(axis=-1)
        known &= known.sum(axis=1, keepdims=True) > 1
        across = np.where(known[..., None, None], np.eye(3) - ray[..., :, None] * ray[..., None, :], 0.0)
        toward = np.einsum("fkpij,kj->fpi", across, rig.centres)
        point = np.linalg.solve(across.sum(axis=1) + 1e-9 * np.eye(3), toward[..., None])[..., 0]
        inside = np.einsum("kij,fpj->fkpi", rig.R, point) + rig.t[:, None]
        depth = np.maximum(inside[..., 2:], _NEAREST)
        error = inside[..., :2] - plane * depth
        return np.where(known[..., None], error, np.nan)

    def _at_times(self, offset: np.ndarray) -> np.ndarray:
        """What each camera saw when the frames were, if its images were taken ``offset`` (camera,) later [s]."""
        frames, cameras = self.seen.shape[:2]
        at = np.arange(frames)[:, None] + offset * self.fps
        before = np.clip(np.floor(at).astype(int), 0, frames - 2)
        share = (at - before)[..., None, None]
        own = np.arange(cameras)
        between = (1 - share) * self.seen[before, own] + share * self.seen[before + 1, own]
        return np.where((share >= -1e-9) & (share <= 1 + 1e-9), between, np.nan)


_NEAREST = 0.1  # [m] before a camera that a point is
