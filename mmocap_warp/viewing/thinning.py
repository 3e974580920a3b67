"""Which frames a page holds, so that it stays small: poses of some, masks and images of fewer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mmocap_warp.result.result import Result

_MOTION_BYTES = 2_400_000  # of all poses; a joint takes 14 bytes
_JOINT_BYTES = 14
_MASKS = 1200  # of all cameras, at about half a kilobyte
_IMAGES = 240  # of all cameras, at about six kilobytes


@dataclass(frozen=True)
class Thinning:
    """Every so manieth frame, always with the first.

    Attributes:
        poses: every this many frames of the result have poses, and values in the curves.
        masks: every this many frames of those have masks.
        images: likewise images.
    """

    poses: int
    masks: int
    images: int

    @classmethod
    def of(cls, result: Result) -> Thinning:
        """What keeps a page of a result below 5 MB or near it."""
        runs, frames, _ = result.pose.shape
        tracks = runs * (1 if result.raw_pose is None else 2)
        a_frame = tracks * len(result.subject.body.skeleton.joints) * _JOINT_BYTES
        poses = _every(frames * a_frame, _MOTION_BYTES)
        pictures = -(-frames // poses) * len(result.cameras)
        return cls(poses, _every(pictures, _MASKS), _every(pictures, _IMAGES))

    def kept(self, frames: int) -> np.ndarray:
        """Positions of the frames that have poses, of ``frames``."""
        return np.arange(0, frames, self.poses)

    def sentence(self, fps: float, masks: bool, images: bool) -> str:
        """What the page says that it shows of a recording of ``fps`` frames a second."""
        parts = [f"poses of {_frames(self.poses)} ({fps / self.poses:.3g} a second)"]
        if masks:
            parts.append(f"masks of {_frames(self.poses * self.masks)}")
        if images:
            parts.append(f"images of {_frames(self.poses * self.images)}")
        between = "" if self.poses == 1 else " Between them, the body moves evenly."
        return f"This page holds {', '.join(parts)}.{between}"


def _every(amount: int, limit: int) -> int:
    """The smallest step that leaves ``limit`` of an amount."""
    return max(1, -(-amount // limit))


def _frames(step: int) -> str:
    return "every frame" if step == 1 else f"one frame in {step}"
