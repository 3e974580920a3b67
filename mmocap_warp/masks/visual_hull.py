"""The visual hull, the space that all silhouettes agree on (Laurentini 1994), and repair of masks by it.

How well a view agrees with the hull of the others is measured in two ways, by :func:`explained_share` of its mask, or
by voxels that are drawn into its image (``silhouette_agreement.coherence``):

- ``mask_check`` judges masks at their own size, about the point where they meet, and asks for two other views.
- ``gross_mistake`` judges calibrations of any unit and subject: masks are small and grown by a pixel, the world is
  scaled to a person's size, and one other view is enough.
- ``coherence`` judges small errors of cameras. Beyond an image it sees background, so that a camera that looks away
  loses; the other two leave such a point to the views that could see it.
"""

from collections.abc import Callable, Iterable

import cv2
import numpy as np

from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.masks.cleanup import around, closed, dilated
from mmocap_warp.masks.observation import Observation, unpack_masks

_COARSE_SPACING = 0.10  # first grid [m]; bodies are found on it, then carved finely
_FAR_PIXEL = 1e6  # px, beyond any image
_REACH = 2.0  # half the first grid's edge [m]


def visual_hull(rig: CameraRig, observation: Observation, spacing: float, tolerate: int = 0) -> np.ndarray:
    """(n, 3) float64, centres of the voxels that project onto foreground [m]; possibly none.

    The cameras are undistorted pinholes, as the masks. Views without foreground are left out; at least two must be
    left. Outside of an image counts as background, which ``tolerate`` views may see at a voxel: 1 survives one bad
    camera or mask, and a subject that one camera sees in part.

    Voxels have edges of ``spacing`` [m]. Their grid is aligned with the world's axes and surrounds the subject by
    itself: a coarse grid about the point where the silhouettes' central rays meet finds what to carve finely.
    """
    own, masks = (unpack_masks(words, rig.size) for words in (observation.words, observation.possible))
    judging = [k for k, count in enumerate(observation.foreground) if count > 0]
    tolerate = min(tolerate, len(judging) - 2)
    if tolerate < 0:
        return np.empty((0, 3))
    rig, masks = rig.select(tuple(rig.names[k] for k in judging)), [masks[k] for k in judging]
    centre = meeting_point(rig, [own[k] for k in judging])
    coarse_grid = _grid(centre - _REACH, centre + _REACH, _COARSE_SPACING)
    coarse = _carve(rig, _grow_masks(rig, masks, centre), coarse_grid, tolerate)
    if not len(coarse):
        return coarse
    low, high = coarse.min(axis=0) - _COARSE_SPACING, coarse.max(axis=0) + _COARSE_SPACING
    return _carve(rig, masks, _grid(low, high, spacing), tolerate)


def meeting_point(rig: CameraRig, masks: list[np.ndarray]) -> np.ndarray:
    """(3,), the point nearest to all rays through the masks' centroids [m], least squares with one reweighting.

    The reweighting (Cauchy, 0.3 m) keeps one camera with a wrong mask from pulling the point away. Empty masks have no
    part in it.
    """
    seeing = [k for k, mask in enumerate(masks) if mask.any()]
    centroids = np.array([mask_centroid(masks[k]) for k in seeing])
    return meeting_point_of(rig.select(tuple(rig.names[k] for k in seeing)), centroids)


def mask_centroid(mask: np.ndarray) -> tuple[float, float]:
    """Column and row of a mask's centroid [px]."""
    left, top, width, height = cv2.boundingRect(mask.view(np.uint8))
    sums = cv2.moments(mask[top : top + height, left : left + width].view(np.uint8), binaryImage=True)
    count = sums["m00"]
    return (sums["m10"] + left * count) / count, (sums["m01"] + top * count) / count


def meeting_point_of(rig: CameraRig, pixels: np.ndarray) -> np.ndarray:
    """As :func:`meeting_point`, of the rays through pixels (camera, 2)."""
    centres, rays = rig.centres, np.empty((len(rig), 3))
    for k, (column, row) in enumerate(pixels):
        ray = rig.R[k].T @ np.linalg.solve(rig.K[k], [column, row, 1.0])
        rays[k] = ray / np.linalg.norm(ray)
    across = np.eye(3) - rays[:, :, None] * rays[:, None, :]  # projects onto the plane across the ray
    weight = np.ones(len(rig))
    for _ in range(10):
        A = (weight[:, None, None] * across).sum(axis=0) + 1e-9 * np.eye(3)  # parallel rays have no meeting point
        point = np.linalg.solve(A, np.einsum("k,kij,kj->i", weight, across, centres))
        distance = np.linalg.norm(np.einsum("kij,kj->ki", across, point - centres), axis=1)
        weight = 1 / (1 + (distance / 0.3) ** 2)
    return point


def _grow_masks(rig: CameraRig, masks: list[np.ndarray], centre: np.ndarray) -> list[np.ndarray]:
    """Masks grown by the reach of a coarse voxel (half its diagonal), so that none that touches the subject is lost."""
    grown = []
    for k, mask in enumerate(masks):
        depth = max(float((rig.R[k] @ centre + rig.t[k])[2]), _COARSE_SPACING)
        radius = int(np.ceil(np.sqrt(3) / 2 * _COARSE_SPACING * rig.K[k, 0, 0] / depth))
        grown.append(dilated(mask.view(np.uint8), 2 * radius + 1).view(bool))
    return grown


def _grid(low: np.ndarray, high: np.ndarray, spacing: float) -> np.ndarray:
    """(n, 3), centres of voxels from ``low`` to ``high``, on multiples of ``spacing`` so that frames share a grid."""
    ends = zip(np.floor(low / spacing), np.ceil(high / spacing) + 1, strict=True)
    axes = [np.arange(first, last) * spacing for first, last in ends]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def _carve(rig: CameraRig, masks: list[np.ndarray], points: np.ndarray, tolerate: int) -> np.ndarray:
    misses = np.zeros(len(points), np.int16)
    for k, mask in enumerate(masks):
        misses += ~seen_at(rig, k, points, mask)[1]
        alive = misses <= tolerate
        points, misses = points[alive], misses[alive]
    return points


def seen_at(
    rig: CameraRig, k: int, points: np.ndarray, mask: np.ndarray, beyond: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (n, 2) of points (n, 3), column and row, and what a mask or labels show there; ``beyond`` elsewhere."""
    seen = points @ (rig.K[k] @ rig.R[k]).T
    seen += rig.K[k] @ rig.t[k]
    before = seen[:, 2] > 0
    place = seen[:, :2] / np.where(before, seen[:, 2], np.inf)[:, None]
    place = np.rint(np.clip(place, -_FAR_PIXEL, _FAR_PIXEL, out=place), out=place).astype(np.int32)
    column, row = place.T
    height, width = mask.shape
    within = np.flatnonzero(before & (column >= 0) & (row >= 0) & (column < width) & (row < height))
    inside = np.full(len(points), beyond, np.int16 if beyond else mask.dtype)
    inside[within] = mask.ravel()[row[within] * width + column[within]]
    return place, inside


# A gap or dent up to so wide is filled where the other views' hull is so thick along its rays [m, m]. A narrow one may
# be in a limb. A wide one, or a hole that is enclosed, can only be in the trunk: less is the phantom volume that few
# views leave between arm and trunk. Going from narrow to wide keeps a false gap apart from a true one that it meets.
_GAPS = ((0.04, 0.10), (0.08, 0.18), (0.12, 0.18))
_RAY_REACH = 1.2  # the rays are followed this far before and behind the subject [m]
_STEP = 0.025  # along the rays [m]


def repair_masks(rig: CameraRig, masks: list[np.ndarray], each: Callable[..., Iterable] = map) -> list[np.ndarray]:
    """New masks, with holes, gaps and dents filled where the other views' visual hull is over 10 cm thick.

    The rig's cameras are undistorted pinholes, as the masks, per camera (height, width) bool. A pool's ``map`` for
    ``each`` lets its threads share the views.

    A dark pair of shorts before a dark floor leaves a hole that no single image can mend; seen from elsewhere, the
    body is plainly there. True gaps, as between arm and torso, have little or no hull behind them and stay. A view
    needs two others that see the subject; with fewer, or when it is empty itself, it is returned as it is.
    """
    seen = [k for k, mask in enumerate(masks) if mask.any()]
    if len(seen) < 3:
        return list(masks)
    subject, others = meeting_point(rig, masks), [[j for j in seen if j != k] for k in range(len(masks))]
    repaired = dict(zip(seen, each(lambda k: _repair(rig, masks, k, others[k], subject), seen), strict=True))
    return [repaired.get(k, mask) for k, mask in enumerate(masks)]


def _repair(rig: CameraRig, masks: list[np.ndarray], k: int, others: list[int], subject: np.ndarray) -> np.ndarray:
    mask = masks[k]
    depth = float((rig.R[k] @ subject + rig.t[k])[2])
    if depth <= 0:
        return mask
    diameters = [max(3, round(width * rig.K[k, 0, 0] / depth)) | 1 for width, _ in _GAPS]
    made = mask.copy()
    rows, columns = near = around(mask.view(np.uint8), max(diameters))
    repaired = mask[near]
    for (width, thickness), diameter in zip(_GAPS, diameters, strict=True):
        filled = closed(repaired.view(np.uint8), diameter).view(bool)
        if width == _GAPS[-1][0]:
            filled = fill_enclosed(filled)
        gaps = filled & ~repaired
        row, column = np.nonzero(gaps)
        count, label = cv2.connectedComponents(gaps.view(np.uint8), connectivity=4)
        hole = label[row, column]
        pixels = np.stack([column + columns.start, row + rows.start], axis=1)
        thick = hull_thickness(rig, masks, k, others, pixels, depth)[np.argsort(hole, kind="stable")]
        of_holes = np.split(thick, np.cumsum(np.bincount(hole, minlength=count))[:-1])
        typical = [0.0, *map(np.median, of_holes[1:])]
        repaired = repaired | (np.array(typical) > thickness)[label]
    made[near] = repaired
    return made


def fill_enclosed(mask: np.ndarray) -> np.ndarray:
    """(height, width) bool: ``mask`` with every background region filled that the image's border does not touch."""
    padded = np.pad(mask.astype(np.uint8), 1)
    cv2.floodFill(padded, None, (0, 0), 2)
    return padded[1:-1, 1:-1] != 2


def explained_share(
    rig: CameraRig, masks: list[np.ndarray], k: int, others: list[int], pixels: np.ndarray, depth: float, least: int = 2
) -> float:
    """Share of camera ``k``'s pixels behind which the other views have something; see :func:`hull_thickness`."""
    return float((hull_thickness(rig, masks, k, others, pixels, depth, least) > 0).mean())


def hull_thickness(
    rig: CameraRig,
    masks: list[np.ndarray],
    k: int,
    others: list[int],
    pixels: np.ndarray,
    depth: float,
    least: int = 2,
    tolerate: int = 0,
) -> np.ndarray:
    """(n,), the length of rays through pixels of camera ``k`` that lies in the other cameras' silhouettes [m].

    The cameras are undistorted pinholes, as the masks, per camera (height, width) bool; the pixels (n, 2) are column
    and row. Rays are followed about a ``depth`` [m]. Of the ``others``, one whose image a point misses does not judge
    it, but ``least`` of them must see it, and up to ``tolerate`` may see background there.
    """
    rays = np.column_stack([pixels, np.ones(len(pixels))]) @ np.linalg.inv(rig.K[k]).T  # depth 1
    depths = np.arange(max(depth - _RAY_REACH, _STEP), depth + _RAY_REACH, _STEP, dtype=np.float32)
    agree = np.zeros((len(rays), len(depths)), np.int8)
    misses = np.zeros_like(agree)
    for j in others:
        # A point at depth z is z * direction + origin in camera j's homogeneous pixels: linear in z.
        turn = rig.R[j] @ rig.R[k].T
        direction = (rays @ (rig.K[j] @ turn).T).astype(np.float32)
        origin = (rig.K[j] @ (rig.t[j] - turn @ rig.t[k])).astype(np.float32)
        w = direction[:, 2:] * depths + origin[2]
        column = np.rint((direction[:, :1] * depths + origin[0]) / w)
        row = np.rint((direction[:, 1:2] * depths + origin[1]) / w)
        height, width = masks[j].shape
        inside = (w > 0) & (column >= 0) & (column < width) & (row >= 0) & (row < height)
        hit = masks[j].ravel()[np.where(inside, row * width + column, 0).astype(np.int32)] & inside
        agree += hit
        misses += inside & ~hit
    return ((misses <= tolerate) & (agree >= least)).sum(axis=1) * _STEP * np.linalg.norm(rays, axis=1)
