"""Where one camera's images and masks lie, and which of them belongs to a frame of the recording."""

from dataclasses import dataclass
from math import ceil
from pathlib import Path

import numpy as np

from mmocap_warp.masks.frames import Frames, ImageFolder
from mmocap_warp.masks.mask_files import Masks
from mmocap_warp.scene.kept_masks import MaskMark

_WHOLE_TOLERANCE = 0.01  # of a frame, by which an offset may differ from whole frames and still be whole


def split_offset(frames: float) -> tuple[int, float]:
    """An offset in whole frames, and the rest; what is nearly whole is whole."""
    whole = round(frames)
    fraction = frames - whole
    return whole, fraction if abs(fraction) > _WHOLE_TOLERANCE else 0.0


@dataclass(frozen=True)
class CameraSource:
    """Where one camera's images lie."""

    name: str  # as in the calibration
    video: Frames | None  # the recording (a video or a folder of images), or None
    masks: Masks | None  # its masks (a folder of images or a video), or None
    clean_plate: ImageFolder | None  # one image without the subject, or None
    background: Frames | None  # a recording without the subject, or None
    frame_offset: int  # scene frame ``f`` is this camera's frame ``f + frame_offset``; 1 for a camera that lags by one
    recorded_scale: float  # recorded pixel = scale * calibrated pixel + offset
    recorded_offset: tuple[float, float]  # likewise
    centre_shift: tuple[float, float] = (0.0, 0.0)  # what the scene added to the calibrated principal point [px]
    mask_mark: MaskMark | None = None  # of masks that are undistorted already; None for masks in the recorded pixels
    # This camera's frames to one of the recording's; where that is not 1, frame ``f`` is the one nearest in time,
    # ``round(f * rate + fraction) + frame_offset``.
    rate: float = 1.0
    fraction: float = 0.0  # what its offset is beyond ``frame_offset`` [its frames], at most half of one either way
    label: int = 0  # in its masks, of the person who is tracked; 0 for the scene's [foreground] identity
    in_front: tuple[int, ...] = ()  # labels of what may be in front of that person
    several: tuple[int, ...] = ()  # labels of pixels that may be of anybody among several people

    def mask_number(self, frame: int) -> int:
        """Which of its masks is the recording's frame; -1 for none."""
        mark = self.mask_mark
        if mark is None:
            return self.number(frame)
        place, between = divmod(frame + self.shift - mark.shift - mark.first_frame, mark.stride)
        return -1 if between else place

    @property
    def shift(self) -> int:
        """Its offset in the recording's frames."""
        return round(self.frame_offset / self.rate)

    def number(self, frame: int) -> int:
        """Which of this camera's frames is the recording's frame."""
        return (frame if self.rate == 1.0 else round(frame * self.rate + self.fraction)) + self.frame_offset

    def late(self, frames: range) -> np.ndarray:
        """(frame,) float64, how much later than the recording's frames its own were taken [the recording's frames].

        Masks that mmocap made of a camera with another rate are taken to be those that it would make now.
        """
        exact = np.array(frames) * self.rate + self.fraction
        nearest = [self.number(frame) - self.frame_offset for frame in frames]
        late: np.ndarray = (np.array(nearest) - exact) / self.rate
        return late if self.rate != 1.0 else np.full(len(frames), -self.fraction)

    def background_examples(self, source: str) -> Frames:
        """What a background is learnt from, by ``ForegroundSettings.source``; a ValueError if the camera has none."""
        images = {"clean_plate": self.clean_plate, "background_video": self.background, "recording": self.video}
        if (examples := images[source]) is None:
            raise ValueError(f"camera '{self.name}' has no images for source '{source}'")
        return examples

    def files_for(self, source: str) -> list[tuple[Path, ...]]:
        """The files that masks are made of, in order: the masks, or the video and what is subtracted from it."""
        if source == "masks":
            return [] if self.masks is None else [self.masks.files]
        video = [] if self.video is None else [self.video.files]
        return video if source == "recording" else [*video, self.background_examples(source).files]


def recorded_frames(source: CameraSource, mask_source: str) -> int:
    """How many of the recording's frames a camera has, in a source of masks; a ValueError if it has no such images."""
    images = source.masks if mask_source == "masks" else source.video
    if images is None:
        raise ValueError(f"camera '{source.name}' has no images for source '{mask_source}'")
    if mask_source == "masks" and source.mask_mark is not None:
        return source.mask_mark.first_frame + (len(images) - 1) * source.mask_mark.stride + 1
    return len(images) if source.rate == 1.0 else ceil((len(images) - 0.5) / source.rate)
