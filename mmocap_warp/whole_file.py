"""Whole files: read as text, hashed, and written so that they appear complete or not at all."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mmocap_warp.errors import InputError

_RESERVED = re.compile(r'[<>:"/\\|?*]|^\.|[. ]$|^(con|prn|aux|nul|com[0-9]|lpt[0-9])(\.|$)|^$', re.IGNORECASE)
MAX_NAME = 200
"""Bytes of a name of a file; file systems allow 255, of which endings take some."""


def file_name(name: str, source: object) -> str:
    """The name of a file or folder for what ``source`` calls ``name``, such as a camera: the same, if that is possible.

    Raises:
        InputError: it would lead elsewhere, or some system has no file of that name.
    """
    if _RESERVED.search(name) or not name.isprintable() or len(name.encode()) > MAX_NAME:
        problem = f"{name!r} cannot be the name of a file"
        raise InputError(source, problem, 'name it without any of <>:"/\\|?* and control characters')
    return name


def native_path(path: str | Path) -> str:
    """A path as OpenCV, USD and ezc3d take it: one that is not UTF-8 may end the process in them.

    Raises:
        InputError: it is not UTF-8.
    """
    try:
        return str(path).encode().decode()
    except UnicodeEncodeError:
        problem, remedy = "has a name that is not UTF-8", "rename the file or its folder"
        raise InputError(ascii(str(path)), problem, remedy) from None


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Give a temporary name beside ``path``, of the same ending, and rename what is written there when all went well.

    A file of that name is replaced; of a link, the file that it points to. Whatever goes wrong, nothing is left under
    either name that was not there before.

    Raises:
        InputError: its folder does not exist or cannot be written to, or the disk is full (any ``OSError`` within).
    """
    if not path.parent.is_dir():
        raise InputError(path, "its folder does not exist", "create the folder first")
    place = Path(os.path.realpath(path)) if path.is_symlink() else path
    unfinished = place.with_name(f".{place.stem}.{os.getpid()}{path.suffix}")
    try:
        yield unfinished
        os.replace(unfinished, place)
    except OSError as error:
        raise InputError(
            path, f"cannot be written ({error})", "check its folder, permissions and free space"
        ) from error
    finally:
        unfinished.unlink(missing_ok=True)


def write_whole(path: Path, data: bytes) -> None:
    """Write ``data`` as :func:`whole_file` says, with its errors."""
    with whole_file(path) as unfinished:
        unfinished.write_bytes(data)


def content_hash(file: Path) -> bytes:
    """SHA-256 of a file's bytes.

    Raises:
        InputError: it cannot be read.
    """
    try:
        with file.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").digest()
    except OSError as error:
        raise InputError(file, f"cannot be read ({error})", "check its permissions") from error


def read_text(
    path: str | Path, remedy: str, *, missing: str = "check the path", encoding: str = "utf-8", errors: str = "strict"
) -> str:
    """A file's text.

    Raises:
        InputError: no such file, for which ``missing`` says what to do; or one that cannot be read as text.
    """
    try:
        return Path(path).read_text(encoding=encoding, errors=errors)
    except FileNotFoundError:
        raise InputError(path, "no such file", missing) from None
    except (OSError, ValueError) as error:
        raise InputError(path, f"cannot be read as text ({error})", remedy) from None
