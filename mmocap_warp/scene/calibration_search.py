"""Which calibration a folder holds: that of a project of Pose2Sim, EasyMocap, Caliscope or OpenCap, or any other."""

from __future__ import annotations

import json
import os
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.errors import InputError
from mmocap_warp.formats.calibration.calibration_text import read_short_text
from mmocap_warp.formats.humaneva.humaneva_files import read_cal
from mmocap_warp.formats.table import CALIBRATIONS, Format, read_calibration

_PARENTS = 2  # number of folders above that are searched too: projects of many trials keep their calibration there
_PICKLE = "is a Python pickle, which can run any program when it is opened, so it is not read"
_PROJECT_FILES = ("scene.toml", "config.toml", "pyproject.toml")
_CONVERT = "convert it with Pose2Sim (calibration_type = 'convert', convert_from = '{}') and give its .toml"
_SOLVE = "or write scene.toml by hand with this calibration, and let mmocap calib solve find where they stand"
_ANY_OTHER = "write it as a Pose2Sim .toml (docs/calibration.md says what is in one)"


@dataclass(frozen=True)
class CalibrationFile:
    """A calibration that can be read.

    Attributes:
        path: the file.
        format: its format.
        others: calibrations beside it that can be read too.
    """

    path: Path
    format: Format
    others: tuple[Path, ...]


def project_kind(folder: Path) -> str | None:
    """Whose project a folder is, by the files that its program puts there; None for none that is known."""
    marks = {
        "OpenCap": ("sessionMetadata.yaml", "Videos/Cam*/cameraIntrinsicsExtrinsics.pickle", "Videos/Cam*/InputMedia"),
        "EasyMocap": ("intri.yml", "extri.yml"),
        "Caliscope": ("camera_array*.toml", "calibration/extrinsic", "calibration/intrinsic/port_*"),
        "Pose2Sim": ("Config.toml",),
    }
    for name, patterns in marks.items():
        if any(next(folder.glob(pattern), None) is not None for pattern in patterns):
            return name
    return None


def find_calibration(folder: Path) -> CalibrationFile | None:
    """The calibration in a folder, or else in one above it; None where there is none.

    Raises:
        InputError: there is only one that cannot be read, by its name.
    """
    for place in [folder, *folder.resolve().parents[:_PARENTS]]:
        files = list(_candidates(place))
        readable = sorted((rank, file) for file in files if (rank := _rank(file)) is not None)
        if readable:
            rank, best = readable[0]
            return CalibrationFile(best, CALIBRATIONS[rank], tuple(file for _, file in readable[1:]))
        if place == folder or project_kind(place) is not None:
            for file in files:
                _refuse(file, place)
    return None


def read_with_unit(file: CalibrationFile, sizes: dict[str, tuple[int, int]]) -> tuple[CameraRig, str]:
    """The cameras, and the unit of their lengths: metres, or millimetres where metres cannot be.

    Raises:
        InputError: a file that is no sound calibration in either.
    """
    try:
        return read_calibration(file.path, "m", "+z", sizes), "m"
    except InputError as error:
        if "millimetres" not in error.remedy:
            raise
        return read_calibration(file.path, "mm", "+z", sizes), "mm"


def _candidates(place: Path) -> Iterator[Path]:
    """Files that may be a calibration: in the folder, and in its folders of that name to any depth."""
    folders = [place, *sorted(each for each in place.glob("[Cc]alib*") if each.is_dir())]
    for folder in folders:
        if not os.access(folder, os.R_OK):
            continue
        for file in sorted(folder.iterdir() if folder == place else folder.rglob("*")):
            if file.is_file() and not file.name.startswith("."):
                yield file
    yield from sorted(place.glob("Videos/Cam*/*.pickle"))  # OpenCap's


def _rank(file: Path) -> int | None:
    """The place of a readable file's format among those that are known; None where it is no calibration."""
    looks = {
        ".toml": _holds_cameras,
        ".yml": lambda file: file.name == "intri.yml" and file.with_name("extri.yml").is_file(),
        ".yaml": lambda file: False,
        ".json": lambda file: {"cameras", "camera_poses"} <= set(_file_values(file)),
        ".cal": _is_humaneva,
        **dict.fromkeys((".usd", ".usda", ".usdc"), _is_called_calibration),
    }
    look = looks.get(file.suffix.lower())
    if file.name == "images.txt" or (file.name == "cameras.txt" and not file.with_name("images.txt").is_file()):
        return None
    if look is not None and not look(file):
        return None
    return next((rank for rank, format in enumerate(CALIBRATIONS) if format.matches(file)), None)


def _holds_cameras(file: Path) -> bool:
    """Whether a TOML file says where cameras are, each in a table of its own or all in Caliscope's ``cameras``."""
    values = _file_values(file)
    caliscope = values.get("cameras")
    tables = _inner_tables(caliscope if isinstance(caliscope, dict) else values)
    older = any("rotation_count" in table for table in tables) and not isinstance(caliscope, dict)
    return any({"matrix", "rotation", "translation", "size"} <= set(table) for table in tables) and not older


def _is_humaneva(file: Path) -> bool:
    """Whether it is the first of a folder of HumanEva's; OptiTrack has files of this ending, too."""
    try:
        read_cal(file, "", (1, 1))
    except InputError:
        return False
    return not any(other.name < file.name for other in file.parent.glob("*.cal"))


def _is_called_calibration(file: Path) -> bool:
    """Whether a USD file's name, or its folder's, says that it is one: results and bodies lie about, too."""
    return any(word in name.lower() for name in (file.name, file.parent.name) for word in ("calib", "camera"))


def _file_values(file: Path) -> dict[str, Any]:
    """What a TOML or JSON file holds; nothing where it is another program's settings, or neither."""
    if file.name.lower() in _PROJECT_FILES:
        return {}
    try:
        text = read_short_text(file, "")
        values = json.loads(text) if file.suffix.lower() == ".json" else tomllib.loads(text)
    except (ValueError, RecursionError):
        return {}
    return values if isinstance(values, dict) else {}


def _inner_tables(values: dict[str, Any]) -> list[dict[str, Any]]:
    return [table for table in values.values() if isinstance(table, dict)]


def _refuse(file: Path, place: Path) -> None:
    """Raise InputError for what its name, or its folder's below ``place``, calls a calibration: it cannot be read."""
    name, below = file.name.lower(), str(file.relative_to(place)).lower()
    is_calibration = any(word in below for word in ("calib", "intri", "extri"))
    tables = _inner_tables(_file_values(file)) if file.suffix == ".toml" else []
    cameras = [camera for table in tables for camera in (table, *_inner_tables(table))]
    if any("matrix" in camera and ("rotation_count" in camera or "grid_count" in camera) for camera in cameras):
        raise InputError(
            file,
            "is a camera array of Caliscope that does not say where the cameras stand, or of an old version",
            "calibrate that, too, give camera_array_aniposelib.toml, which Caliscope writes in the project's folder, "
            + _SOLVE,
        )
    if file.suffix in (".pickle", ".pkl") and (is_calibration or "camera" in name):
        opencap = "intrinsicsextrinsics" in name
        raise InputError(file, _PICKLE, _CONVERT.format("opencap") if opencap else _ANY_OTHER)
    by_ending = {
        ".xcp": ("Vicon", _CONVERT.format("vicon")),
        **dict.fromkeys((".mcal", ".cal"), ("OptiTrack", _CONVERT.format("optitrack"))),
        ".calib": ("BioCV", _CONVERT.format("biocv")),
        ".json": ("JSON", _ANY_OTHER),
        **dict.fromkeys((".npz", ".npy"), ("NumPy", _ANY_OTHER)),
        ".xml": ("XML", _ANY_OTHER),
    }
    if file.suffix.lower() in by_ending and is_calibration:
        program, remedy = by_ending[file.suffix.lower()]
        raise InputError(file, f"is a calibration of {program}, which cannot be read yet", remedy)
    if name == "intri.yml":
        problem = "has no extri.yml beside it"
        raise InputError(file, problem, f"calibrate where they stand, too, with EasyMocap, {_SOLVE}")
