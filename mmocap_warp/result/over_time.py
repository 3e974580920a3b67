"""How a track changes from frame to frame, and its error from the clip's beginning to its end."""

from __future__ import annotations

import numpy as np

from mmocap_warp.result.pose_errors import nanmean

_SHAKE_RATE = 60.0
"""Shake is told at this many frames a second: a smooth motion's is then the same at any rate."""


def second_differences(joints: np.ndarray, frame_numbers: np.ndarray, fps: float) -> np.ndarray:
    """Lengths of the second differences of the joints' paths, as at 60 Hz: (run, three frames in a row, joint) [m].

    Args:
        joints: (run, frame, joint, 3) [m].
        frame_numbers: (frame,); where frames are missing between two, no difference reaches across.
        fps: frames per second of the numbering.
    """
    step = np.diff(frame_numbers)
    consecutive = (step[1:] == step.min()) & (step[:-1] == step.min()) if len(step) > 1 else np.zeros(0, bool)
    second = np.diff(joints, n=2, axis=1)[:, consecutive]
    rate = fps / step.min() if len(step) else fps
    return np.linalg.norm(second, axis=-1) * (rate / _SHAKE_RATE) ** 2


def growth(error: np.ndarray) -> np.ndarray:
    """Mean error of the last third over that of the first third: (run,), NaN with fewer than three frames.

    Args:
        error: (run, frame) of the frames that have a truth, NaN where it is unknown.
    """
    third = error.shape[1] // 3
    if not third:
        return np.full(len(error), np.nan)
    first, last = nanmean(error[:, :third], axis=1), nanmean(error[:, -third:], axis=1)
    return np.divide(last, first, out=np.full(len(error), np.nan), where=first > 0)
