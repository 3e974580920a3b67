"""Known positions of markers and joints, which a result is judged against."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mmocap_warp.errors import InputError


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
        pose: (frame, coordinate) float64, poses of the body that made the recording, where one did.

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


def load_truth(path: str | Path, axes: str = "xyz", first_frame: int = 0) -> Truth:
    """Read the truth of a recording: the project's own USD, or joints from a ``.trc`` file.

    Args:
        path: the file.
        axes: of a ``.trc``: which of the file's axes are the world's x, y and z.
        first_frame: of a ``.trc``: the recording's frame number of the first row.

    Raises:
        InputError: a missing or wrong file, or axes for one that is in the world's own.
    """
    from mmocap_warp.formats.motion.trc import read_trc  # the formats build a Truth, so they import this module
    from mmocap_warp.formats.usd.file import USD_SUFFIXES
    from mmocap_warp.formats.usd.truth import read_truth

    path = Path(path)
    if path.suffix == ".trc":
        tracks = read_trc(path, axes)
        frames = tracks.frame_numbers - tracks.frame_numbers[0] + first_frame
        try:
            return Truth(tracks.rate, frames, (), np.zeros((len(frames), 0, 3)), tracks.names, tracks.positions)
        except ValueError as error:
            raise InputError(path, str(error), "export it again") from error
    if path.suffix in USD_SUFFIXES:
        if axes != "xyz":
            raise InputError(path, f"is in the world's own axes, not {axes!r}", "leave the axes out: a .trc needs them")
        return read_truth(path)
    raise InputError(path, f"{path.suffix or 'no suffix'!r} is no format of truth", "give a .usda, .usdc or .trc file")
