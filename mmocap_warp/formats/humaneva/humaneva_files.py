"""HumanEva's small text files: cameras (``.cal``), offsets in time (``.ofs``) and a subject's measures (``.mp``)."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mmocap_warp.cameras.rig import Camera, CameraRig, rig_of
from mmocap_warp.errors import InputError, input_errors
from mmocap_warp.formats.calibration.calibration_text import Sizes, image_size_of
from mmocap_warp.formats.datasets.dataset_scene import MILLIMETRE, REMEDY, read_numbers
from mmocap_warp.whole_file import read_text


def read_measures(path: str | Path) -> dict[str, float]:
    """Vicon's measures of a subject [mm, degrees] by name, from lines such as ``$LKneeWidth = 105.0``."""
    text = read_text(path, REMEDY, missing=REMEDY, encoding="ascii")
    lines = re.findall(r"^\s*\$(\w+)\s*=\s*([-+.\deE]+)\s*$", text, re.M)
    with input_errors(path, "{error}", REMEDY, ValueError):
        return {name: float(value) for name, value in lines}


_COUNT = 22


def read_cal(path: str | Path, name: str, size: tuple[int, int]) -> Camera:
    """Read a camera as Bouguet's calibration toolbox describes it, in metres, named ``name``.

    The file has one number a line: focal lengths (2), principal point (2), skew (1), distortion (5), rotation (9, row
    by row) and translation (3, millimetres), both world to camera. Bouguet's lens model is OpenCV's, coefficients in
    the same order, and he too counts pixel centres from 0. Some files go on with the rotation as a Rodrigues vector,
    which says nothing new. No file says the ``size`` of the images, width and height [px].
    """
    numbers = read_numbers(path)
    if len(numbers) < _COUNT:
        raise InputError(path, f"holds {len(numbers)} numbers of {_COUNT}", REMEDY)
    (fx, fy), (cx, cy), (skew,), distortion, R, t = np.split(numbers[:_COUNT], np.cumsum([2, 2, 1, 5, 9]))
    K = np.array([[fx, fx * skew, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    return Camera(name, K, R.reshape(3, 3), t * MILLIMETRE, size, distortion)


def read_cal_folder(path: str | Path, units: str | None = None, up: str = "+z", sizes: Sizes = None) -> CameraRig:
    """Read all cameras of a folder, named as their files, from its path or that of one of them.

    Lengths are millimetres by definition; ``units`` is not needed. ``sizes`` holds (width, height) of the cameras,
    which the files do not say.
    """
    folder = Path(path) if Path(path).is_dir() else Path(path).parent
    files = sorted(file for file in folder.glob("*") if file.name.lower().endswith(".cal"))
    problem = "HumanEva's .cal does not say how large the camera's images are"
    cameras = [read_cal(file, file.stem, image_size_of(sizes, file.stem, file, problem)) for file in files]
    return rig_of(cameras, up, path)


class StreamOffset(NamedTuple):
    """A video frame and the motion capture frame of the same moment, and how many of those pass in one of these."""

    image_start: float
    mocap_start: float
    mocap_per_image: float


@dataclass(frozen=True)
class Synchronisation:
    """Where each frame of a sequence lies in its streams, all counted as HumanEva does: from 1, motion in fractions.

    Frame ``n`` of the sequence is frame ``start[k] + n - 1`` of video ``k`` and lies at
    ``mocap_start + (n - 1) * mocap_per_frame`` in the motion capture.
    """

    start: np.ndarray  # (camera,) int
    mocap_start: float  # at least 1
    mocap_per_frame: float  # about 2, for 120 and 60 Hz

    def mocap_position(self, frames: np.ndarray) -> np.ndarray:
        """Where frames of the sequence lie in the motion capture."""
        return self.mocap_start + (frames - 1) * self.mocap_per_frame


def read_ofs(path: str | Path) -> StreamOffset:
    """Read a camera's offset."""
    numbers = read_numbers(path)
    if len(numbers) != 3 or numbers[2] <= 0:
        problem = f"holds {numbers.tolist()}, not a video frame, a motion capture frame and a positive scale"
        raise InputError(path, problem, "copy it again from the data set's corrected Sync_Data")
    return StreamOffset(*numbers.tolist())


def synchronise(offsets: Sequence[StreamOffset]) -> Synchronisation:
    """Align all streams as HumanEva's software does, for cameras in its order: C1 to C3, then BW1 to BW4.

    The sequence starts where the last stream does: one video, or the motion capture, begins at its frame 1. Videos are
    shifted by whole frames, so a camera may be off by up to half a frame.
    """
    image_start, mocap_start, scale = (np.array(column) for column in zip(*offsets, strict=True))
    common, per_frame = mocap_start[0], scale.mean()
    start = image_start + (common - mocap_start) / scale
    common -= per_frame * (start.min() - 1)
    start -= start.min() - 1
    if common < 1:  # the motion capture starts last
        start -= (common - 1) / per_frame
        common = 1.0
    return Synchronisation(np.floor(start + 0.5).astype(int), float(common), float(per_frame))
