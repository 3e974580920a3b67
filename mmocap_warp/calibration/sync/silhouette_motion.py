"""How a silhouette moves, in numbers that other views of the same person share.

Left and right differ between views, and so do sizes. What views share is *when* something moves. A view's signals are
the speeds of its silhouette's outline, place and spread, and how much of it changes from one frame to the next at each
relative height. That some combination of one view's signals goes with some combination of another's is what tells two
views' common time; see :mod:`mmocap_warp.calibration.sync.shared_motion`.
"""

from __future__ import annotations

import numpy as np

_ENDS = (0.01, 0.99)  # shares of the foreground beyond which a speck may lie
_BANDS = 6  # of relative height
_BEYOND = 0.05  # of the height: how far the bands reach beyond the silhouette
_PART = 0.3  # of the usual area; a smaller silhouette is a fault
_SMOOTHING = 0.042  # [s], standard deviation of the filter
_LEAST_SMOOTHING = 1.0  # [frames]


class SilhouetteMotion:
    """A view's masks, looked at in the order in which its camera took them."""

    def __init__(self) -> None:
        self._shape: list[np.ndarray] = []  # per frame: place, outline, size and spread [px]
        self._area: list[int] = []
        self._change: list[np.ndarray] = []  # per frame but the first, per band [px^2]
        self._before: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self._area)

    def add(self, mask: np.ndarray) -> None:
        """Look at the next frame's mask, (height, width) bool; an empty one is a frame without a silhouette."""
        rows, columns = mask.sum(axis=1).astype(float), mask.sum(axis=0).astype(float)
        area = int(rows.sum())
        shape = _shape(mask, rows, columns) if area else np.zeros(_SHAPE)
        if self._before is not None:
            both = area and self._area[-1]
            self._change.append(_changes(self._before, mask, self._shape[-1], shape) if both else np.zeros(_BANDS))
        self._before = mask
        self._area.append(area)
        self._shape.append(shape)

    @property
    def seen(self) -> np.ndarray:
        """(frame,) bool: frames with a whole silhouette."""
        area = np.array(self._area)
        some = area[area > 0]
        return area > _PART * np.median(some) if len(some) else np.zeros(len(area), bool)

    def signals(self, fps: float) -> np.ndarray:
        """(frame - 1, signal) float64: between a frame and the next, in body heights; frames without one are bridged.

        Args:
            fps: the camera's frames per second.

        Raises:
            ValueError: fewer than two frames with a silhouette.
        """
        seen = self.seen
        if seen.sum() < 2:
            raise ValueError("two frames with a silhouette are needed")
        smoothing = max(_LEAST_SMOOTHING, _SMOOTHING * fps)
        shape = np.array(self._shape)
        height = float(np.median(shape[seen, _BOTTOM] - shape[seen, _TOP]))
        speed = _filtered(_bridged(shape / height, seen), smoothing, slope=True)
        change = _filtered(_bridged(np.sqrt(np.array(self._change)) / height, seen[1:] & seen[:-1]), smoothing)
        signals = np.concatenate([0.5 * (speed[1:] + speed[:-1]), change], axis=1)
        return np.where(np.ptp(signals, axis=0) > _ROUNDING, signals, 0.0)


_SHAPE, _TOP, _BOTTOM = 10, 2, 3
LIKE = np.array([float(signal == _TOP) for signal in range(_SHAPE)] + _BANDS * [0.5])
"""(signal,) how much each says that all views show alike: heads go up and down, and limbs at a height move, for all."""

_ROUNDING = 1e-9
"""Of a silhouette's height a frame: what does not move leaves less, alike in all views that see the same."""


def _shape(mask: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """(10,) of a silhouette [px]: centre x and y, top, bottom, left, right, root of the area, spreads, lean."""
    area, y, x = rows.sum(), np.arange(len(rows)) + 0.5, np.arange(len(columns)) + 0.5
    top, bottom, left, right = *_places(rows), *_places(columns)
    centre_x, centre_y = columns @ x / area, rows @ y / area
    down, across = np.sqrt(rows @ y**2 / area - centre_y**2), np.sqrt(columns @ x**2 / area - centre_x**2)
    lean = (y @ (mask @ x) / area - centre_x * centre_y) / (bottom - top)
    return np.array([centre_x, centre_y, top, bottom, left, right, np.sqrt(area), down, across, lean])


def _places(sums: np.ndarray) -> np.ndarray:
    """(2,) between which almost all of the foreground lies, of the sums of rows or columns."""
    gathered = np.concatenate([[0.0], np.cumsum(sums)])
    return np.interp(_ENDS, gathered / gathered[-1], np.arange(len(gathered)))


def _changes(before: np.ndarray, mask: np.ndarray, shape_before: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """(band,) pixels that differ, from the top of both silhouettes to their bottom."""
    top, bottom = min(shape_before[_TOP], shape[_TOP]), max(shape_before[_BOTTOM], shape[_BOTTOM])
    beyond = _BEYOND * (bottom - top)
    edges = np.linspace(top - beyond, bottom + beyond, _BANDS + 1)
    gathered = np.concatenate([[0.0], np.cumsum((before ^ mask).sum(axis=1))])
    return np.diff(np.interp(edges, np.arange(len(gathered)), gathered))


def _bridged(values: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Values (frame, signal) with those that are not known (frame,) on the line between their neighbours."""
    at = np.flatnonzero(known)
    frames = np.arange(len(values))
    return np.stack([np.interp(frames, at, column[at]) for column in values.T], axis=1) if len(at) else 0.0 * values


def _filtered(values: np.ndarray, smoothing: float, slope: bool = False) -> np.ndarray:
    """Values (frame, signal) smoothed by a Gaussian [frames], or the slope of what it leaves."""
    reach = int(3 * smoothing + 1)
    x = np.arange(-reach, reach + 1)
    gauss = np.exp(-0.5 * (x / smoothing) ** 2)
    kernel = gauss / gauss.sum()
    if slope:
        kernel = -x / smoothing**2 * kernel
    padded = np.pad(values, ((reach, reach), (0, 0)), mode="edge")
    return np.stack([np.convolve(column, kernel, "valid") for column in padded.T], axis=1)
