"""A recording of a data set that becomes a scene, and what the readers of data sets share."""

import io
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.errors import InputError, input_errors
from mmocap_warp.formats.calibration.calibration_text import MOST_BYTES, numbers_of
from mmocap_warp.formats.calibration.toml_rig import write_toml_rig
from mmocap_warp.formats.sandbox import sandboxed
from mmocap_warp.formats.toml_table import quoted, visible
from mmocap_warp.formats.truth_file import write_truth
from mmocap_warp.masks.frames import VideoFile, natural_order, open_video
from mmocap_warp.result.truth import Truth
from mmocap_warp.whole_file import read_bytes, read_text, write_whole

REMEDY = "copy it again from the data set"
MILLIMETRE = 0.001
_MAX_MAT = 1 << 30  # bytes of a .mat file; a session of Rat7M has some 300 MB
_ERRORS = (ValueError, TypeError, AttributeError, NotImplementedError, UnboundLocalError)  # of scipy, for damaged .mat
_MAX_NUMBER = 1e9  # of a calibration, in millimetres or pixels, and of frames
_MAT_VARIABLES = ("annot3", "frames", "cameras", "params", "sync", "labelData", "camnames", "mocap")
FROM_RECORDING = """
# Masks are learnt from the whole recording, in which the person has to walk about; docs/masks.md has other ways.
[foreground]
source = "recording"
"""
"""The text of a [foreground] table, for a copy without masks."""


def read_numbers(path: str | Path) -> np.ndarray:
    """(n,) float64, all numbers of the file."""
    text = read_text(path, REMEDY, missing=REMEDY, most=MOST_BYTES, encoding="ascii")
    return np.array(numbers_of(text.split(), path, REMEDY))


@dataclass(frozen=True)
class CameraFiles:
    """The files of one camera; frame ``f`` of the scene is image ``f + frame_offset`` of its video."""

    video: Path
    masks: Path | None = None
    background: Path | None = None
    frame_offset: int = 0
    mask_channel: str = ""


@dataclass(frozen=True, repr=False)
class DatasetScene:
    """A recording of a data set."""

    about: tuple[str, ...]  # lines that say what it is, for the head of the scene file
    name: str  # of the scene
    rig: CameraRig  # the cameras as calibrated, in metres
    fps: float  # frames a second
    frames: int  # how many
    cameras: tuple[CameraFiles, ...]  # the files of each camera, in the order of the rig
    truth: Truth | None = None  # joints and markers in the world of the rig; None where the copy has none
    notes: tuple[str, ...] = ()  # what is odd or missing in the copy, in sentences
    foreground: str = FROM_RECORDING  # the text of the scene's [foreground] table

    def __repr__(self) -> str:
        known = 0
        if self.truth is not None:
            places = np.concatenate([self.truth.markers, self.truth.joints], axis=1)
            known = int(np.isfinite(places).all(axis=2).any(axis=1).sum())
        return f"{self.name}: {self.frames} frames, {known} with truth, {len(self.rig)} cameras"

    def write(self, folder: str | Path) -> Path:
        """Write ``calibration.toml``, ``truth.usdc`` and last ``scene.toml``, which names the user's videos.

        The folder is made if it does not exist; files of the same names are replaced. The path is the scene file's.
        """
        folder = Path(folder)
        with input_errors(folder, "cannot be written to ({error})", "choose another folder", OSError):
            folder.mkdir(parents=True, exist_ok=True)
        write_toml_rig(folder / "calibration.toml", self.rig)
        if self.truth is not None:
            write_truth(folder / "truth.usdc", self.truth, self.rig.up)
        write_whole(folder / "scene.toml", self._text().encode())
        return folder / "scene.toml"

    def _text(self) -> str:
        lines = [f"# {visible(line)}" for line in self.about]
        lines += ["[scene]", f"name = {quoted(self.name)}", f"fps = {self.fps:g}", f'up = "{self.rig.up}"']
        lines += [f"frames = {self.frames}", ""]
        lines += ["[truth]", 'file = "truth.usdc"', ""] if self.truth is not None else []
        lines += ["[cameras]", 'calibration = "calibration.toml"']
        for name, files in zip(self.rig.names, self.cameras, strict=True):
            paths = {key: getattr(files, key) for key in ("video", "masks", "background")}
            # The whole path, because scene and data set move apart.
            lines += ["", f"[cameras.{quoted(name)}]"]
            lines += [f"{key} = {quoted(path.resolve().as_posix())}" for key, path in paths.items() if path]
            lines += [f"mask_channel = {quoted(files.mask_channel)}"] if files.mask_channel else []
            lines.append(f"frame_offset = {files.frame_offset}")
        return "\n".join(lines) + "\n" + self.foreground


def find_files(folder: Path, pattern: str, what: str) -> list[Path]:
    """Files of a folder by a pattern of names, in natural order; an InputError without any says ``what`` should be."""
    if not folder.is_dir():
        raise InputError(folder, "no such folder", "check the path of the data set")
    files = sorted(folder.glob(pattern), key=lambda file: natural_order(file.name))
    if not files:
        raise InputError(folder, f"holds no {pattern}, {what}", REMEDY)
    return files


def open_videos(paths: list[Path]) -> tuple[list[VideoFile], float, int]:
    """The videos of a recording, their rate, and the frames of the shortest."""
    videos = [open_video(path) for path in paths]
    if not videos[0].fps > 0:
        raise InputError(paths[0], "does not say how many frames a second it has", REMEDY)
    return videos, videos[0].fps, min(map(len, videos))


def finite(value: object, shape: tuple[int, ...], where: str, what: str) -> np.ndarray:
    """Numbers of a file, in ``shape``, where -1 is any length; an InputError unless they are so many, and finite."""
    count = "x".join("n" if side < 0 else str(side) for side in shape)
    with input_errors(where, f"{what} is not {count} numbers", REMEDY, TypeError, ValueError):
        array = np.asarray(value, np.float64).reshape(shape)
    if not (np.abs(array) < _MAX_NUMBER).all():
        raise InputError(where, f"{what} holds a number that is not finite or over {_MAX_NUMBER:g}", REMEDY)
    return array


@sandboxed
def read_mat(path: str | Path) -> dict[str, Any]:
    """The variables of a MATLAB file of version 5 or 7, structs as dicts and cells as lists of objects.

    Raises:
        InputError: no such file, a damaged one, or one of version 7.3, which is HDF5.
    """
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    data = read_bytes(path, REMEDY, most=_MAX_MAT)
    if data.startswith((b"MATLAB 7.3", b"\x89HDF")):
        remedy = "load it in MATLAB and save it with save(..., '-v7'), or convert it with h5py and scipy.io.savemat"
        raise InputError(path, "is a .mat file of version 7.3, which is not read", remedy)
    kinds = MatReadError, zlib.error, ArithmeticError, LookupError, OSError, *_ERRORS
    with input_errors(path, "cannot be read as a .mat file ({error})", REMEDY, *kinds):
        return loadmat(io.BytesIO(data), simplify_cells=True, variable_names=_MAT_VARIABLES)
