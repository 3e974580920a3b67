"""Search of a folder for videos and folders of images, and for the camera that each belongs to."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

Kind = Literal["recording", "masks", "background", "clean_plate"]
Take = dict[str, Path]
"""One video or folder a camera, by the camera's name."""

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


@dataclass(frozen=True)
class Medium:
    """A video, a folder of images or a picture.

    Attributes:
        path: where it lies.
        parts: its place below the folder that was looked through, without its ending.
        kind: what it shows, by its name.
    """

    path: Path
    parts: tuple[str, ...]
    kind: Kind


def find_media(folder: Path) -> list[Medium]:
    """All videos and folders of images below a folder, and pictures of a background, in the order of their names."""
    media: list[Medium] = []
    for place, folders, files in os.walk(folder):
        here = Path(place)
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
    for claim in (claim for medium in media if medium.kind == kind for claim in _claims(medium, cameras)):
        candidates.setdefault(claim.place, {}).setdefault(claim.camera, claim.path)
        likeness[claim.place] = min(claim.likeness, likeness.get(claim.place, claim.likeness))
    # Of the takes of most cameras, those of videos come first, then those whose names are most like the cameras'.
    most = max(map(len, candidates.values()), default=0)
    whole = sorted(place for place, take in candidates.items() if len(take) == most)
    whole.sort(key=lambda place: (next(iter(candidates[place].values())).is_dir(), -likeness[place]))
    chosen: dict[str, Take] = {}
    used: set[Path] = set()
    for place in whole:
        take = candidates[place]
        if used.isdisjoint(take.values()):  # else these are the same media, by a part of their names that says less
            chosen[place] = take
            used.update(take.values())
    return chosen


class _Claim(NamedTuple):
    """That a medium may be of a camera, as a part of its place says."""

    camera: str
    place: str
    likeness: int
    path: Path


def _claims(medium: Medium, cameras: tuple[str, ...]) -> Iterator[_Claim]:
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
            yield _Claim(camera, "/".join(starred), most, medium.path)


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
