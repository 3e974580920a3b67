"""What a folder holds: videos and folders of images, the camera that each belongs to, and the calibration.

Projects of Pose2Sim, EasyMocap, Caliscope and OpenCap are known.
"""

import json
import os
import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.errors import InputError
from mmocap_warp.formats.calibration.calibration_text import read_short_text
from mmocap_warp.formats.humaneva.humaneva_files import read_cal
from mmocap_warp.formats.table import CALIBRATIONS, Format, read_calibration
from mmocap_warp.whole_file import walk

Kind = Literal["recording", "masks", "background", "clean_plate"]
Take = dict[str, Path]  # one video or folder a camera, by the camera's name

_VIDEOS = (".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg", ".mts", ".wmv")
_IMAGES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
_MAX_DEPTH = 6  # of folders within each other
_MASKS = re.compile(r"(^|[-_ ])(masks?|segm?|segmentations?|silhouettes?|mattes?|alphas?)([-_ .]|$)", re.IGNORECASE)
_BACKGROUND = re.compile(r"(^|[-_ ])(backgrounds?|bg|empty|clean[-_ ]?plates?|plates?)([-_ .]|$)", re.IGNORECASE)
_IGNORED = re.compile(
    r"\..*|calib.*|intrinsics?|extrinsics?|targets?|axes|annots|sparse|openpose|pose|pose[-_].*|kinematics|output.*"
    r"|markerdata|opensimdata|onnx.*|.*_study",
    re.IGNORECASE,
)
"""Folders of calibration pictures, and of what programs write."""
_PARENTS = 2  # number of folders above that are searched too: projects of many trials keep their calibration there
_PICKLE = "is a Python pickle, which can run any program when it is opened, so it is not read"
_PROJECT_FILES = ("scene.toml", "config.toml", "pyproject.toml")
_CONVERT = "convert it with Pose2Sim (calibration_type = 'convert', convert_from = '{}') and give its .toml"
_SOLVE = "or write scene.toml by hand with this calibration, and let mmocap calib solve find where they stand"
_ANY_OTHER = "write it as a Pose2Sim .toml (docs/calibration.md says what is in one)"


@dataclass(frozen=True)
class Medium:
    """A video, a folder of images or a picture, and what it shows, by its name."""

    path: Path
    parts: tuple[str, ...]  # its place below the folder that was looked through, without its ending
    kind: Kind


def find_media(folder: Path) -> list[Medium]:
    """All videos and folders of images below a folder, and pictures of a background, in the order of their names."""
    media: list[Medium] = []
    for place, folders, files in walk(folder):
        here, files = Path(place), [name for name in files if not name.startswith(".")]
        below = here.relative_to(folder).parts
        folders[:] = sorted(name for name in folders if len(below) < _MAX_DEPTH and not _IGNORED.fullmatch(name))
        images = sorted(name for name in files if name.lower().endswith(_IMAGES))
        pictures = [name for name in images if _BACKGROUND.search("_".join([*below, name]))]
        videos = sorted(name for name in files if name.lower().endswith(_VIDEOS))
        media += [_medium(here / name, (*below, Path(name).stem)) for name in videos]
        # Pictures of a background are one a camera, unless they are numbered alone, as the frames of one camera are.
        of_cameras = bool(pictures) and not all(Path(name).stem.isdecimal() for name in images)
        if len(images) > 1 and below and not of_cameras:
            media.append(_medium(here, below))
        else:
            media += [Medium(here / name, (*below, Path(name).stem), "clean_plate") for name in pictures]
    return media


def _medium(path: Path, parts: tuple[str, ...]) -> Medium:
    kind: Kind = "recording"
    if any(_MASKS.search(part) for part in parts):
        kind = "masks"
    elif any(_BACKGROUND.search(part) for part in parts):
        kind = "background"
    return Medium(path, parts, kind)


def takes(media: list[Medium], kind: Kind, cameras: tuple[str, ...]) -> dict[str, Take]:
    """What of a kind was recorded at a time: media whose places differ in the camera alone, by that place.

    A medium belongs to the camera whose name, or else whose number, is in its own name or in that of a folder above it:
    of these the one that makes the take of most cameras. Such takes alone are given, those of videos first.
    """
    if not cameras:
        return {}
    candidates: dict[str, Take] = {}
    likeness: dict[str, int] = {}
    for medium in (each for each in media if each.kind == kind):
        for camera, place, like in _claims(medium, cameras):
            candidates.setdefault(place, {}).setdefault(camera, medium.path)
            likeness[place] = min(like, likeness.get(place, like))
    # A number may stand beside each camera's name, as in Walk01_Miqus_1_21001: then no two are of one camera.
    joined: dict[str, Take] = {}
    for place, take in candidates.items():
        under = re.sub("[0-9]+(?=[^/]*$)", "*", place) if likeness[place] > 1 else place
        joined.setdefault(under, {}).update(take)
        likeness.setdefault(under, likeness[place])
    are_single = all(len(take) == 1 for take in candidates.values())
    if are_single and len(joined) < len(candidates) == sum(map(len, joined.values())):
        candidates = joined
    # Of the takes of most cameras, those of videos come first, then those whose names are most like the cameras'.
    most = max(map(len, candidates.values()), default=0)
    whole = sorted(place for place, take in candidates.items() if len(take) == most)
    whole.sort(key=lambda place: (next(iter(candidates[place].values())).is_dir(), -likeness[place]))
    chosen: dict[str, Take] = {}
    for place in whole:
        used = {path for take in chosen.values() for path in take.values()}
        if used.isdisjoint(candidates[place].values()):  # else the same media, by a part of their names that says less
            chosen[place] = candidates[place]
    return chosen


def _claims(medium: Medium, cameras: tuple[str, ...]) -> Iterator[tuple[str, str, int]]:
    """Cameras that a medium may be of as parts of its place say, with its place but for the camera, and how likely."""
    for depth, part in enumerate(medium.parts):
        likeness = {camera: _likeness(camera, part) for camera in cameras}
        most = max(likeness.values())
        likely = [camera for camera in cameras if likeness[camera] == most]
        if most and len(likely) == 1:
            camera = likely[0]
            token = camera if _contains_word(camera.lower(), part.lower()) else part
            word = rf"(?<![A-Za-z0-9]){re.escape(token)}(?![A-Za-z0-9])"
            starred = [re.sub(word, "*", each, flags=re.IGNORECASE) for each in medium.parts]
            starred[depth] = re.sub("[0-9]+", "*", part) if most == 1 else starred[depth]
            # A number that is the camera's name alone may be in a folder's name too.
            yield camera, "/".join([*medium.parts[:depth], starred[depth], *medium.parts[depth + 1 :]]), most
            yield camera, "/".join(starred), most


def _likeness(camera: str, part: str) -> int:
    """How much a part of a path says that it is of a camera.

    3 for its name, 2 for its name among other words, 1 for its number, 0 for nothing.
    """
    camera, part = camera.lower(), part.lower()
    if camera == part:
        return 3
    if _contains_word(camera, part) or _contains_word(part, camera):
        return 2
    numbers, others = ([int(number) for number in re.findall(r"[0-9]+", text)] for text in (camera, part))
    return int(len(numbers) == 1 and numbers == others)


def _contains_word(inner: str, outer: str) -> bool:
    return re.search(rf"(?<![a-z0-9]){re.escape(inner)}(?![a-z0-9])", outer) is not None


def names_without_calibration(media: list[Medium]) -> tuple[str, ...]:
    """Names of cameras without a calibration: of the videos or folders that lie side by side, else of the masks."""
    recordings = [medium for medium in media if medium.kind == "recording"]
    recordings = recordings or [medium for medium in media if medium.kind == "masks"]
    for depth in (1, 2):  # the names of the media, or of the folders that they are alone in
        by_folder: dict[tuple[str, ...], list[str]] = {}
        for medium in recordings:
            if len(medium.parts) >= depth:
                by_folder.setdefault(medium.parts[:-depth], []).append(medium.parts[-depth])
        for names in by_folder.values():
            if len(set(names)) > 1:
                return tuple(dict.fromkeys(names))
    return ()


@dataclass(frozen=True)
class CalibrationFile:
    """A calibration that can be read, its format, and the others beside it that can be read too."""

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
    found = (name for name, patterns in marks.items() if any(any(folder.glob(pattern)) for pattern in patterns))
    return next(found, None)


def find_calibration(folder: Path) -> CalibrationFile | None:
    """The calibration in a folder or above it, None for none; an InputError where the only one cannot be read."""
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
    """The cameras and their unit: metres, or the likeliest where these cannot be; an InputError if neither is sound."""
    try:
        return read_calibration(file.path, "m", "+z", sizes), "m"
    except InputError as error:
        likely = re.search(r'units = "(\w+)"', error.remedy)
        if likely is None:
            raise
        return read_calibration(file.path, likely[1], "+z", sizes), likely[1]


def _candidates(place: Path) -> Iterator[Path]:
    """Files that may be a calibration: in the folder, and in its folders of that name to any depth."""
    folders = [place, *sorted(each for each in place.glob("[Cc]alib*") if each.is_dir())]
    for folder in (each for each in folders if os.access(each, os.R_OK)):
        files = sorted(folder.iterdir() if folder == place else folder.rglob("*"))
        yield from (file for file in files if file.is_file() and not file.name.startswith("."))
    yield from sorted(place.glob("Videos/Cam*/*.pickle"))  # OpenCap's


def _rank(file: Path) -> int | None:
    """The place of a readable file's format among those that are known; None where it is no calibration."""
    looks = {
        ".toml": _holds_cameras,
        ".json": lambda file: {"cameras", "camera_poses"} <= set(_file_values(file)),
        ".cal": _is_humaneva,
        **dict.fromkeys((".usd", ".usda", ".usdc"), _is_called_calibration),
    }
    look = looks.get(file.suffix.lower())
    beside = {"intri.yml": "extri.yml", "cameras.txt": "images.txt"}  # the first of a pair stands for both
    is_half = file.name in beside and not file.with_name(beside[file.name]).is_file()
    if file.name in beside.values() or is_half or (look is not None and not look(file)):
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
    name, suffix, below = file.name.lower(), file.suffix.lower(), str(file.relative_to(place)).lower()
    is_calibration = any(word in below for word in ("calib", "intri", "extri"))
    tables = _inner_tables(_file_values(file)) if suffix == ".toml" else []
    cameras = [camera for table in tables for camera in (table, *_inner_tables(table))]
    if any("matrix" in camera and ("rotation_count" in camera or "grid_count" in camera) for camera in cameras):
        problem = "is a camera array of Caliscope that does not say where the cameras stand, or of an old version"
        other = "camera_array_aniposelib.toml, which Caliscope writes in the project's folder"
        raise InputError(file, problem, f"calibrate that, too, give {other}, {_SOLVE}")
    if suffix in (".pickle", ".pkl") and (is_calibration or "camera" in name):
        raise InputError(file, _PICKLE, _CONVERT.format("opencap") if "intrinsicsextrinsics" in name else _ANY_OTHER)
    by_ending = {
        ".xcp": ("Vicon", _CONVERT.format("vicon")),
        **dict.fromkeys((".mcal", ".cal"), ("OptiTrack", _CONVERT.format("optitrack"))),
        ".calib": ("BioCV", _CONVERT.format("biocv")),
        ".json": ("JSON", _ANY_OTHER),
        **dict.fromkeys((".npz", ".npy"), ("NumPy", _ANY_OTHER)),
        ".xml": ("XML", _ANY_OTHER),
    }
    if suffix in by_ending and is_calibration:
        program, remedy = by_ending[suffix]
        raise InputError(file, f"is a calibration of {program}, which cannot be read yet", remedy)
    if name == "intri.yml":
        problem = "has no extri.yml beside it"
        raise InputError(file, problem, f"calibrate where they stand, too, with EasyMocap, {_SOLVE}")
