"""HumanEva's ``.cal``: a camera as Bouguet's calibration toolbox describes it, one number a line.

In this order: focal lengths (2), principal point (2), skew (1), distortion (5), rotation (9, row by row) and
translation (3, millimetres), both world to camera. Bouguet's lens model is OpenCV's, coefficients in the same order,
and he too counts pixel centres from 0. Some files go on with the rotation as a Rodrigues vector, which says nothing
new.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mmocap_warp.cameras.rig import Camera, CameraRig, rig_of
from mmocap_warp.errors import InputError
from mmocap_warp.formats.calibration.image_size import told_size
from mmocap_warp.formats.calibration.text import refuse_huge
from mmocap_warp.formats.humaneva.numbers import read_numbers

_COUNT = 22
_MILLIMETRE = 0.001


def read_cal(path: str | Path, name: str, size: tuple[int, int]) -> Camera:
    """Read a camera, in metres.

    Args:
        path: the file.
        name: the camera's.
        size: width and height of its images [px], which the file does not say.

    Raises:
        InputError: missing, not text, or not at least 22 finite numbers. Whether they can be a camera, see
            :func:`~mmocap_warp.cameras.rig.check_rig`.
    """
    refuse_huge(path)
    numbers = read_numbers(path)
    if len(numbers) < _COUNT:
        raise InputError(path, f"holds {len(numbers)} numbers of {_COUNT}", "copy it again from the data set")
    (fx, fy), (cx, cy), (skew,), distortion, R, t = np.split(numbers[:_COUNT], np.cumsum([2, 2, 1, 5, 9]))
    K = np.array([[fx, fx * skew, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    return Camera(name, K, R.reshape(3, 3), t * _MILLIMETRE, size, distortion)


def read_cal_folder(
    path: str | Path, units: str | None = None, up: str = "+z", sizes: dict[str, tuple[int, int]] | None = None
) -> CameraRig:
    """Read all cameras of a folder, named as their files, from its path or that of one of them.

    Lengths are millimetres by definition; ``units`` is not needed. ``sizes`` holds (width, height) of the cameras,
    which the files do not say.

    Raises:
        InputError: see :func:`read_cal`; a size that nobody has said; or not a calibration (see ``check_rig``).
    """
    folder = Path(path) if Path(path).is_dir() else Path(path).parent
    files = sorted(file for file in folder.glob("*") if file.name.lower().endswith(".cal"))
    problem = "HumanEva's .cal does not say how large the camera's images are"
    cameras = [read_cal(file, file.stem, told_size(sizes, file.stem, file, problem)) for file in files]
    return rig_of(cameras, up, path)
