"""What silhouettes alone say about cameras, without a body: how well they agree, and which rough changes they ask for.

**Coherence.** Whatever casts the silhouettes lies within the visual hull of any views. So the hull of the other views,
seen by a camera, covers its silhouette; how much of it is covered says how well the camera agrees with them, as in
C. Hernandez, F. Schmitt and R. Cipolla, *Silhouette coherence for camera calibration under circular motion* (2007).
It judges cameras, by masks of one moment. A hull that reaches beyond the silhouette costs nothing, since the hull of a
few views is larger than the body anyway. ``hull_agreement`` judges times, and also counts what the hull has too much.

**Landmarks.** The centroid of a silhouette is seen nearly where the body's centroid is, and its highest point is nearly
the body's, in every view alike. Over frames these are points that several cameras follow. A small bundle adjustment of
them turns and moves cameras that contours cannot, because their outlines do not meet.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from mmocap_warp.calibration.adjust.camera_changes import OFFSET, changed
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.masks.cleanup import dilated
from mmocap_warp.masks.observation import Observation, unpack_masks
from mmocap_warp.masks.visual_hull import meeting_point, seen_at
from mmocap_warp.result.pose_errors import nanmean

_SPACING = 0.03  # metres between the hull's voxels
_REACH = 1.0  # metres that the voxels reach along each axis from the point where the silhouettes meet
_BLOCK = 4  # voxels along the edge of a block; the cube has 17 blocks along its own
_TOP_SHARE = 0.02  # share of a silhouette's pixels that count as its highest
_SIGMA = 0.04  # metres by which a silhouette's centroid and highest point differ from those of the body
_MIN_PIXELS = 50  # a view with fewer foreground pixels shows nobody
_BORDER = 2  # pixels: a silhouette that comes so near an image's edge may go on beyond it
_MIN_DEPTH = 0.1  # metres before a camera that a point is at least


def coherence(rig: CameraRig, observations: Sequence[Observation]) -> np.ndarray:
    """(camera,) share of each silhouette that the hull of the other views covers, the mean over frames.

    Frames in which fewer than three views see anybody do not count; NaN where no frame counts. The cameras are
    undistorted, at the masks' size.
    """
    shares = np.array([_covered_shares(rig, observation) for observation in observations]).reshape(-1, len(rig))
    return nanmean(shares, axis=0)


def _covered_shares(rig: CameraRig, observation: Observation) -> np.ndarray:
    """(camera,) the shares in one frame; NaN where a view sees nobody, or fewer than three views see anybody."""
    share = np.full(len(rig), np.nan)
    seeing = np.flatnonzero(observation.foreground > 0).tolist()
    if len(seeing) < 3:
        return share
    # Voxels fill a cube about the point where the silhouettes meet.
    masks = unpack_masks(observation.words, rig.size)
    centre = meeting_point(rig, masks)
    points = _voxels_in_all_but_one(rig, seeing, masks, centre)
    # Voxels outside two silhouettes are in no hull of all views but one, so they are dropped. For the others `misses`
    # is 0 or 1, and `outside_of` names the view that misses them.
    pixels, misses = [], np.zeros(len(points), int)
    outside_of = np.full(len(points), -1)
    for k in seeing:
        pixel, inside = seen_at(rig, k, points, masks[k])
        misses += ~inside
        outside_of[~inside] = k
        alive = misses <= 1
        points, misses, outside_of = points[alive], misses[alive], outside_of[alive]
        pixels = [each[alive] for each in pixels] + [pixel[alive]]
    # The hull of the others is what nobody misses, and what this view alone misses.
    for number, k in enumerate(seeing):
        share[k] = _covered_share(rig, k, centre, pixels[number][(outside_of == k) | (misses == 0)], masks[k])
    return share


def _voxels_in_all_but_one(rig: CameraRig, views: list[int], masks: list[np.ndarray], centre: np.ndarray) -> np.ndarray:
    """Centres (n, 3) of all voxels that may be in the silhouettes of all views but one [m], and of some others.

    Most of the cube is empty, so blocks of voxels are dropped where two views see only background about them.
    """
    axis = np.arange(-_REACH, _REACH + _SPACING, _SPACING)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    middle = (grid[::_BLOCK, ::_BLOCK, ::_BLOCK] + 0.5 * (_BLOCK - 1) * _SPACING).reshape(-1, 3) + centre
    reach = 0.5 * np.sqrt(3) * _BLOCK * _SPACING
    misses = np.zeros(len(middle), int)
    for k in views:
        # A block's pixels are at most `spread` from its middle: both terms of a pixel, numerator and depth, change.
        matrix = rig.K[k] @ rig.R[k]
        seen = middle @ matrix.T + rig.K[k] @ rig.t[k]
        before = seen[:, 2] > 2 * reach
        depth = np.where(before, seen[:, 2], 1.0)[:, None]
        row_length = np.linalg.norm(matrix[:2], axis=1)
        spread = reach * (row_length * depth + np.abs(seen[:, :2])) / (depth * (depth - reach)) + 1.0
        # How much foreground is in that rectangle tells the sum table of the mask.
        table, limit = cv2.integral(masks[k].view(np.uint8)), masks[k].shape[::-1]
        low = np.clip(np.floor(seen[:, :2] / depth - spread), 0, limit).astype(int).T
        high = np.clip(np.ceil(seen[:, :2] / depth + spread) + 1, 0, limit).astype(int).T
        count = table[high[1], high[0]] - table[low[1], high[0]] - table[high[1], low[0]] + table[low[1], low[0]]
        misses += before & (count == 0)
    kept = (misses <= 1).reshape((len(axis) // _BLOCK,) * 3)
    for dimension in range(3):
        kept = np.repeat(kept, _BLOCK, axis=dimension)
    return grid[kept] + centre


def _covered_share(rig: CameraRig, k: int, centre: np.ndarray, pixels: np.ndarray, mask: np.ndarray) -> float:
    """The share of a mask that voxels at these pixels cover; each voxel is drawn as a disc of its size."""
    height, width = mask.shape
    within = (pixels >= 0).all(axis=1) & (pixels[:, 0] < width) & (pixels[:, 1] < height)
    drawn = np.zeros(mask.shape, np.uint8)
    drawn[pixels[within, 1], pixels[within, 0]] = 1
    depth = max(float((rig.R[k] @ centre + rig.t[k])[2]), 0.1)
    radius = max(1, int(np.ceil(0.5 * np.sqrt(2) * _SPACING * rig.K[k, 0, 0] / depth)))
    return float((dilated(drawn, 2 * radius + 1).astype(bool) & mask).sum() / mask.sum())


def landmarks(rig: CameraRig, observations: Sequence[Observation]) -> np.ndarray:
    """Centroid and highest point of every silhouette, (frame, camera, 2, 2) float64 [px]; NaN where there is none.

    Silhouettes that touch the edge of their image have none, because what lies beyond it is unknown. The cameras say
    which way is up in their images.
    """
    points = np.full((len(observations), len(rig), 2, 2), np.nan)
    up = rig.R @ rig.up_vector
    for frame, observation in enumerate(observations):
        for k, mask in enumerate(unpack_masks(observation.words, rig.size)):
            rows, columns = np.nonzero(mask)
            if len(rows) < _MIN_PIXELS or int(mask[_BORDER:-_BORDER, _BORDER:-_BORDER].sum()) < int(mask.sum()):
                continue
            pixels = np.stack([columns, rows], axis=1).astype(float)
            height = pixels @ up[k, :2]
            points[frame, k] = pixels.mean(axis=0), pixels[height >= np.quantile(height, 1 - _TOP_SHARE)].mean(axis=0)
    return points


@dataclass(frozen=True, eq=False)
class LandmarkProblem:
    """A bundle adjustment of cameras and moving points."""

    rig: CameraRig  # cameras to start from
    seen: np.ndarray  # (frame, camera, point, 2) in consecutive frames [px], NaN where a point is not seen
    fps: float  # of these frames
    sigma: np.ndarray  # (camera, parameter) standard deviations of the cameras about ``rig``; zero holds a parameter

    def solve(self) -> np.ndarray:
        """(camera, parameter) changes of the cameras after which points are seen where they meet."""
        from scipy.optimize import least_squares

        free = self.sigma > 0

        def change(standardised: np.ndarray) -> np.ndarray:
            values = np.zeros(self.sigma.shape)
            values[free] = standardised * self.sigma[free]
            return values

        def residuals(standardised: np.ndarray) -> np.ndarray:
            error = self.errors(change(standardised)) / _SIGMA
            # The prior weighs as much as in a single frame, because neighbouring frames err alike.
            prior = np.sqrt(np.isfinite(error).sum() / error.shape[0]) * standardised
            return np.concatenate([np.nan_to_num(error).ravel(), prior])

        return change(least_squares(residuals, np.zeros(int(free.sum())), loss="soft_l1", x_scale=1.0, max_nfev=50).x)

    def errors(self, change: np.ndarray) -> np.ndarray:
        """(frame, camera, point, 2) reprojection errors [m at the body]; NaN where fewer than two cameras see it."""
        rig, plane, known, point = self._triangulated(change)
        # The points' distances from each ray, across the camera's axis.
        inside = np.einsum("kij,fpj->fkpi", rig.R, point) + rig.t[:, None]
        depth = np.maximum(inside[..., 2:], _MIN_DEPTH)
        return np.where(known[..., None], inside[..., :2] - plane * depth, np.nan)

    def points(self, change: np.ndarray) -> np.ndarray:
        """(frame, point, 3) the points that all cameras triangulate [m]; NaN where fewer than two see them."""
        _, _, known, point = self._triangulated(change)
        return np.where(np.asarray(known.any(axis=1))[..., None], point, np.nan)

    def _triangulated(self, change: np.ndarray) -> tuple[CameraRig, np.ndarray, np.ndarray, np.ndarray]:
        """The changed cameras, what they see at depth 1, where points are known, and the points nearest to the rays."""
        rig = changed(self.rig, change)
        # A ray through each pixel.
        focal, centre = rig.K[:, [0, 1], [0, 1]][:, None], rig.K[:, :2, 2][:, None]
        plane = (self._seen_later(change[:, OFFSET]) - centre) / focal
        ray = np.einsum("kji,fkpj->fkpi", rig.R, np.concatenate([plane, np.ones_like(plane[..., :1])], axis=-1))
        ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
        known = np.isfinite(ray).all(axis=-1)
        known &= known.sum(axis=1, keepdims=True) > 1
        # The point nearest to all rays in the least-squares sense.
        across = np.where(known[..., None, None], np.eye(3) - ray[..., :, None] * ray[..., None, :], 0.0)
        toward = np.einsum("fkpij,kj->fpi", across, rig.centres)
        point = np.linalg.solve(across.sum(axis=1) + 1e-9 * np.eye(3), toward[..., None])[..., 0]
        return rig, plane, known, point

    def _seen_later(self, offset: np.ndarray) -> np.ndarray:
        """What each camera saw at the frames' times, if its images were taken ``offset`` (camera,) later [s]."""
        frames, cameras = self.seen.shape[:2]
        at = np.arange(frames)[:, None] + offset * self.fps
        before = np.clip(np.floor(at).astype(int), 0, frames - 2)
        share = (at - before)[..., None, None]
        own = np.arange(cameras)
        between = (1 - share) * self.seen[before, own] + share * self.seen[before + 1, own]
        return np.where((share >= -1e-9) & (share <= 1 + 1e-9), between, np.nan)
