"""How a silhouette moves, as signals that other views of the same person share.

Left and right differ between views, and so do sizes. What views share is *when* something moves. A view's signals are
the speeds of its silhouette's outline, place and spread, and how much of it changes from one frame to the next at each
relative height. Two views have a common time where some combination of one view's signals is correlated with some
combination of the other's; see :mod:`mmocap_warp.calibration.sync.shared_motion`.
"""

import numpy as np

_ENDS = (0.01, 0.99)  # quantiles of the foreground that bound the silhouette: beyond them specks may lie
_BANDS = 6  # bands of relative height
_BEYOND = 0.05  # share of the height that the bands reach beyond the silhouette
_MIN_AREA = 0.3  # share of the usual area: a smaller silhouette is a fault
_SMOOTHING = 0.042  # seconds: standard deviation of the filter
_MIN_SMOOTHING = 1.0  # frames
_MIN_RANGE = 1e-9  # body heights a frame: a signal that varies less does not move, but for rounding
_SHAPE, _TOP, _BOTTOM = 10, 2, 3  # numbers of a silhouette's shape, and the places of its top and bottom among them
LIKE = np.array([float(signal == _TOP) for signal in range(_SHAPE)] + _BANDS * [0.5])
"""(signal,) weight of what all views show alike: the head's height, and the movement of limbs at each height."""


class SilhouetteMotion:
    """The movement in a view's masks, which are added in the order in which its camera took them."""

    def __init__(self) -> None:
        self._shape: list[np.ndarray] = []  # of each frame: place, outline, size and spread [px]
        self._area: list[int] = []
        self._change: list[np.ndarray] = []  # of each frame but the first, in each band [px^2]
        self._before: np.ndarray | None = None

    def add(self, mask: np.ndarray) -> None:
        """Add the next frame's mask, (height, width) bool; an empty one is a frame without a silhouette."""
        rows, columns = mask.sum(axis=1).astype(float), mask.sum(axis=0).astype(float)
        area = int(rows.sum())
        shape = _shape(mask, rows, columns) if area else np.zeros(_SHAPE)
        if self._before is not None:
            both = area and self._area[-1]
            self._change.append(_changes(self._before, mask, self._shape[-1], shape) if both else np.zeros(_BANDS))
        self._before = mask
        self._area.append(area)
        self._shape.append(shape)

    def signals(self, fps: float) -> np.ndarray:
        """(frame - 1, signal) float64 from frame to frame [body height]; a ValueError for under two silhouettes."""
        # Frames without a whole silhouette are gaps, which are interpolated.
        area = np.array(self._area)
        seen = area > _MIN_AREA * np.median(area[area > 0]) if area.any() else area > 0
        if seen.sum() < 2:
            raise ValueError("two frames with a silhouette are needed")
        smoothing = max(_MIN_SMOOTHING, _SMOOTHING * fps)
        shape = np.array(self._shape)
        height = float(np.median(shape[seen, _BOTTOM] - shape[seen, _TOP]))
        # Speeds of the shape, and the smoothed changes of its bands, at the times between frames.
        speed = _filter(_interpolate_gaps(shape / height, seen), smoothing, slope=True)
        change = _filter(_interpolate_gaps(np.sqrt(np.array(self._change)) / height, seen[1:] & seen[:-1]), smoothing)
        signals = np.concatenate([0.5 * (speed[1:] + speed[:-1]), change], axis=1)
        return np.where(np.ptp(signals, axis=0) > _MIN_RANGE, signals, 0.0)


def _shape(mask: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """(10,) of a silhouette [px]: centre x and y, top, bottom, left, right, root of the area, spreads, lean."""
    area, y, x = rows.sum(), np.arange(len(rows)) + 0.5, np.arange(len(columns)) + 0.5
    top, bottom, left, right = *_places(rows), *_places(columns)
    centre_x, centre_y = columns @ x / area, rows @ y / area
    down, across = np.sqrt(rows @ y**2 / area - centre_y**2), np.sqrt(columns @ x**2 / area - centre_x**2)
    lean = (y @ (mask @ x) / area - centre_x * centre_y) / (bottom - top)
    return np.array([centre_x, centre_y, top, bottom, left, right, np.sqrt(area), down, across, lean])


def _places(sums: np.ndarray) -> np.ndarray:
    """(2,) the positions between which almost all foreground lies, from the sums of rows or columns."""
    cumulative = np.concatenate([[0.0], np.cumsum(sums)])
    return np.interp(_ENDS, cumulative / cumulative[-1], np.arange(len(cumulative)))


def _changes(before: np.ndarray, mask: np.ndarray, shape_before: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """(band,) pixels that differ, from the top of both silhouettes to their bottom."""
    top, bottom = min(shape_before[_TOP], shape[_TOP]), max(shape_before[_BOTTOM], shape[_BOTTOM])
    beyond = _BEYOND * (bottom - top)
    edges = np.linspace(top - beyond, bottom + beyond, _BANDS + 1)
    cumulative = np.concatenate([[0.0], np.cumsum((before ^ mask).sum(axis=1))])
    return np.diff(np.interp(edges, np.arange(len(cumulative)), cumulative))


def _interpolate_gaps(values: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Values (frame, signal) with unknown frames on the line between their known neighbours."""
    at, frames = np.flatnonzero(known), np.arange(len(values))
    return np.stack([np.interp(frames, at, column[at]) for column in values.T], axis=1) if len(at) else 0.0 * values


def _filter(values: np.ndarray, smoothing: float, slope: bool = False) -> np.ndarray:
    """Values (frame, signal) smoothed by a Gaussian [frames], or the slope of the smoothed values."""
    reach = int(3 * smoothing + 1)
    x = np.arange(-reach, reach + 1)
    gauss = np.exp(-0.5 * (x / smoothing) ** 2)
    kernel = gauss / gauss.sum()
    if slope:
        kernel = -x / smoothing**2 * kernel
    padded = np.pad(values, ((reach, reach), (0, 0)), mode="edge")
    return np.stack([np.convolve(column, kernel, "valid") for column in padded.T], axis=1)
