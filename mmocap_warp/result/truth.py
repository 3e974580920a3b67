"""Known positions of markers and joints, which a result is judged against."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Truth:
    """Where markers and joints really were, in the world of the cameras.

    Attributes:
        fps: frames per second of the recording.
        frame_numbers: (frame,) int, the recording's own frame numbers, ascending; frames without truth may be absent.
        marker_names: one per marker on the skin; may be empty.
        markers: (frame, marker, 3) float64 [m], NaN where a marker is unseen.
        joint_names: one per joint, named as the body's where they mean the same; may be empty.
        joints: (frame, joint, 3) float64 [m], NaN where a joint is unknown.
        pose: (frame, coordinate) float64, poses of the body that made the recording, where one did; ``joint_names``
            then begins with that body's joints.
        root_base: (3, 3) float64, world from that body's axes at zero root rotation; None where it is unknown.

    Raises:
        ValueError: arrays whose lengths disagree, frame numbers that do not ascend.
    """

    fps: float
    frame_numbers: np.ndarray
    marker_names: tuple[str, ...]
    markers: np.ndarray
    joint_names: tuple[str, ...]
    joints: np.ndarray
    pose: np.ndarray | None = None
    root_base: np.ndarray | None = None

    def __post_init__(self) -> None:
        frames = len(self.frame_numbers)
        if (np.diff(self.frame_numbers) <= 0).any():
            raise ValueError("frame_numbers must ascend")
        for name, array, shape in (
            ("markers", self.markers, (frames, len(self.marker_names), 3)),
            ("joints", self.joints, (frames, len(self.joint_names), 3)),
        ):
            if array.shape != shape:
                raise ValueError(f"{name} must be {shape}, got {array.shape}")
        if self.pose is not None and (self.pose.ndim != 2 or len(self.pose) != frames):
            raise ValueError(f"pose must be ({frames}, coordinate), got {self.pose.shape}")
        if self.root_base is not None and self.root_base.shape != (3, 3):
            raise ValueError(f"root_base must be (3, 3), got {self.root_base.shape}")
