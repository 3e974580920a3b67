"""Images in a tar archive, read where they lie: nothing is extracted."""

from __future__ import annotations

import tarfile
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from mmocap_warp.errors import InputError

_LARGEST = 1 << 28  # bytes of an image: far above any mask, far below the memory
_LONGEST = 4096  # characters of a path, as in file systems; names are sorted by the numbers in them


@dataclass(frozen=True)
class TarMember:
    """Where a file lies in an archive.

    Attributes:
        name: its path in the archive.
        offset: of its first byte.
        length: in bytes.
    """

    name: str
    offset: int
    length: int


def list_tar(path: Path) -> list[TarMember]:
    """The files of an uncompressed archive, in its order; hidden ones and folders are left out.

    Raises:
        InputError: not such an archive, or one that holds links, devices, or paths that lead out of it.
    """
    found = []
    try:
        with tarfile.open(path, "r:") as archive:
            for member in archive:
                name = PurePosixPath(member.name)
                if name.is_absolute() or ".." in name.parts:
                    raise InputError(path, f"holds a path that leads out of it ({member.name!r})", "make it anew")
                if len(member.name) > _LONGEST:
                    raise InputError(path, f"holds a path of {len(member.name)} characters", "shorten its files' names")
                if member.size >= 0 and (member.isdir() or name.name.startswith(".")):
                    continue
                if not member.isreg() or member.issparse() or not 0 <= member.size <= _LARGEST:
                    raise InputError(path, f"'{member.name}' is no plain image file", "put image files there alone")
                found.append(TarMember(member.name, member.offset_data, member.size))
    except (tarfile.TarError, OSError, ValueError, OverflowError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(path, f"cannot be read as a tar archive ({error})", "make it anew, uncompressed") from None
    except MemoryError:
        raise InputError(path, "has a header that is larger than the memory", "make it anew, uncompressed") from None
    return found


def read_member(path: Path, member: TarMember) -> bytes:
    """A file's content.

    Raises:
        InputError: the archive cannot be read, or is shorter than it was.
    """
    try:
        with path.open("rb") as stream:
            stream.seek(member.offset)
            data = stream.read(member.length)
    except OSError as error:
        raise InputError(path, f"cannot be read ({error})", "check its permissions") from None
    if len(data) < member.length:
        raise InputError(path, f"ends within '{member.name}'", "copy it again")
    return data
