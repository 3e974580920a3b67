"""Known positions of markers and joints, which a result is compared with."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from mmocap_warp.body.skeleton import Skeleton
from mmocap_warp.errors import InputError

_SAME_RATE = 0.005  # share by which one rate may differ: video of 59.94 frames a second is called one of 60
_DECIMALS = 6  # of a frame's number at another rate: what differs by less coincides, and is not interpolated


@dataclass(frozen=True)
class Truth:
    """Where markers and joints really were, in the world of the cameras.

    Raises:
        ValueError: arrays whose lengths disagree, frame numbers that do not ascend.
    """

    fps: float  # frames per second of the recording
    # (frame,) int, the recording's own frame numbers, ascending; frames without truth may be absent
    frame_numbers: np.ndarray
    marker_names: tuple[str, ...]  # one per marker on the skin; may be empty
    markers: np.ndarray  # (frame, marker, 3) float64 [m], NaN where a marker is unseen
    joint_names: tuple[str, ...]  # one per joint, named as the body's where they mean the same; may be empty
    joints: np.ndarray  # (frame, joint, 3) float64 [m], NaN where a joint is unknown
    # (frame, coordinate) float64, poses of the body that made the recording, where one did; ``joint_names`` then
    # begins with that body's joints
    pose: np.ndarray | None = None
    # (3, 3) float64, world from that body's axes at zero root rotation; None where it is unknown
    root_base: np.ndarray | None = None

    def __post_init__(self) -> None:
        frames = len(self.frame_numbers)
        if (np.diff(self.frame_numbers) <= 0).any():
            raise ValueError("frame_numbers must ascend")
        for name, names in (("markers", self.marker_names), ("joints", self.joint_names)):
            shape, actual = (frames, len(names), 3), getattr(self, name).shape
            if actual != shape:
                raise ValueError(f"{name} must be {shape}, got {actual}")
        if self.pose is not None and (self.pose.ndim != 2 or len(self.pose) != frames):
            raise ValueError(f"pose must be ({frames}, coordinate), got {self.pose.shape}")
        if self.root_base is not None and self.root_base.shape != (3, 3):
            raise ValueError(f"root_base must be (3, 3), got {self.root_base.shape}")

    def has_poses_of(self, skeleton: Skeleton) -> bool:
        """Whether it has poses of a body with the same joints."""
        same_joints = self.joint_names[: len(skeleton.joints)] == skeleton.joints
        return same_joints and self.pose is not None and self.pose.shape[1] == skeleton.coordinates

    def at_frames(self, keep: np.ndarray | slice) -> Self:
        """The truth of some of its frames."""
        arrays = {name: getattr(self, name)[keep] for name in ("frame_numbers", "markers", "joints")}
        return replace(self, **arrays, pose=None if self.pose is None else self.pose[keep])


def at_rate(truth: Truth, fps: float) -> Truth:
    """The truth at the times of a recording's frames, whose frame 0 is at the time of the truth's frame 0.

    Between two frames of the truth, markers and joints are on the straight line from one to the other, and unknown
    where one of these is. Poses are not interpolated: they are dropped where times do not coincide. Raises an
    InputError for a truth of fewer frames a second than the recording.
    """
    if abs(truth.fps / fps - 1.0) < _SAME_RATE:
        return truth
    if truth.fps < fps:
        problem = f"has {truth.fps:g} frames a second, and the recording {fps:g}"
        raise InputError("truth", problem, "give a truth of at least the recording's rate")
    # The recording's frames that lie within the truth, and their places among its frame numbers.
    ratio, known = truth.fps / fps, truth.frame_numbers
    first, last = np.round(known[[0, -1]] / ratio, _DECIMALS) if len(known) else (0, -1)
    numbers = np.arange(int(np.ceil(first)), int(np.floor(last)) + 1)
    place = np.round(numbers * ratio, _DECIMALS)
    # Each is interpolated between two frames of the truth, which must be next to each other.
    before, after = np.searchsorted(known, place, side="right") - 1, np.searchsorted(known, place)
    neighbours = known[after] - known[before] <= 1
    before, after, along = before[neighbours], after[neighbours], (place - known[before])[neighbours]

    def between(values: np.ndarray) -> np.ndarray:
        share = along[:, None, None]
        return np.where(share > 0, (1.0 - share) * values[before] + share * values[after], values[before])

    return replace(
        truth,
        fps=fps,
        frame_numbers=numbers[neighbours],
        markers=between(truth.markers),
        joints=between(truth.joints),
        pose=None if truth.pose is None or along.any() else truth.pose[before],
    )
