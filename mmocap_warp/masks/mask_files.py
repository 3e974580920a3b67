"""A camera's masks, in any of the forms that people have them in."""

from __future__ import annotations

import os
import tarfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import NamedTuple

import numpy as np

from mmocap_warp.errors import InputError, input_errors
from mmocap_warp.masks import frames
from mmocap_warp.masks.frames import VideoFile, evenly_spread
from mmocap_warp.masks.mask_image import Labels, palette_labels
from mmocap_warp.masks.rle_masks import RleMasks, open_rle
from mmocap_warp.whole_file import MAX_BYTES


@dataclass(frozen=True)
class MaskImages:
    """Mask images of a folder or of a tar archive, in natural order of their names."""

    path: Path  # the folder or archive
    members: tuple[Path | TarMember, ...]  # a file, or a part of the archive, for each frame
    size: tuple[int, int]  # width and height [px] of the first; the others must be alike
    soft = False

    def __len__(self) -> int:
        return len(self.members)

    @property
    def files(self) -> tuple[Path, ...]:
        """The files on disk: the images, or the one archive."""
        return tuple(member for member in self.members if isinstance(member, Path)) or (self.path,)

    def read(self, first: int = 0) -> Iterator[np.ndarray | Labels]:
        """Frames from ``first`` on, unchanged; of an indexed PNG its objects."""
        for member in self.members[first:]:
            image = _read(self.path, member)
            frames.check_size(image.shape, self.size, member if isinstance(member, Path) else self.path / member.name)
            yield image

    def sample(self, count: int) -> Iterator[np.ndarray | Labels]:
        """At most ``count`` frames, evenly spread."""
        return (_read(self.path, self.members[i]) for i in evenly_spread(len(self), count))


Masks = MaskImages | RleMasks | VideoFile


def open_masks(path: Path) -> Masks:
    """A folder or ``.tar`` of images, a ``.json`` of run lengths, or a video."""
    if path.suffix.lower() == ".json":
        return open_rle(path)
    members: tuple[Path | TarMember, ...]
    if os.path.isfile(path) and path.suffix.lower() == ".tar":
        by_name = {member.name: member for member in list_tar(path)}
        members = tuple(by_name[name] for name in frames.images_in_order(list(by_name), path))
    else:
        opened = frames.open_frames(path)
        if isinstance(opened, VideoFile):
            return opened
        members = opened.files
    height, width = _read(path, members[0]).shape[:2]
    return MaskImages(path, members, (width, height))


def _read(path: Path, member: Path | TarMember) -> np.ndarray | Labels:
    if isinstance(member, TarMember):
        return decode_mask_image(read_member(path, member), path / member.name)
    return decode_mask_image(frames.read_file(member), member)


def decode_mask_image(data: bytes, source: object) -> np.ndarray | Labels:
    """The content of a mask's image file, unchanged, of an indexed PNG its objects; ``source`` names it in messages."""
    labels = palette_labels(data)
    return frames.decode_image(data, source) if labels is None else labels


_MAX_PATH = 4096  # characters, as in file systems


class TarMember(NamedTuple):
    """Where a file lies in an archive: its path there, the place of its first byte, and its length in bytes."""

    name: str
    offset: int
    length: int


def list_tar(path: Path) -> list[TarMember]:
    """The files of an uncompressed archive, in its order; hidden ones and folders are left out.

    Raises:
        InputError: not such an archive, or one that holds links, devices, or paths that lead out of it.
    """
    members, kinds = [], (tarfile.TarError, OSError, ValueError, OverflowError)
    with (
        input_errors(path, "has a header that is larger than the memory", "make it anew, uncompressed", MemoryError),
        input_errors(path, "cannot be read as a tar archive ({error})", "make it anew, uncompressed", *kinds),
        tarfile.open(path, "r:") as archive,
    ):
        for member in archive:
            name = PurePosixPath(member.name)
            if name.is_absolute() or ".." in name.parts:
                raise InputError(path, f"holds a path that leads out of it ({member.name!r})", "make it anew")
            if len(member.name) > _MAX_PATH:
                raise InputError(path, f"holds a path of {len(member.name)} characters", "shorten its files' names")
            if member.size >= 0 and (member.isdir() or name.name.startswith(".")):
                continue
            if not member.isreg() or member.issparse() or not 0 <= member.size <= MAX_BYTES:
                raise InputError(path, f"'{member.name}' is no plain image file", "put only image files there")
            members.append(TarMember(member.name, member.offset_data, member.size))
    return members


def read_member(path: Path, member: TarMember) -> bytes:
    """A file's content."""
    with input_errors(path, "cannot be read ({error})", "check its permissions", OSError), path.open("rb") as stream:
        stream.seek(member.offset)
        data = stream.read(member.length)
    if len(data) < member.length:
        raise InputError(path, f"ends within '{member.name}'", "copy it again")
    return data
