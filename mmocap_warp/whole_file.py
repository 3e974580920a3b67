"""Whole files: read as text, hashed, and written so that they appear complete or not at all."""

import csv
import hashlib
import io
import json
import os
import re
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mmocap_warp.errors import InputError, input_errors

_RESERVED = re.compile(r'[<>:"/\\|?*]|^\.|[. ]$|^(con|prn|aux|nul|com[0-9]|lpt[0-9])(\.|$)|^$', re.IGNORECASE)
MAX_NAME = 200  # bytes of a name of a file; file systems allow 255, of which endings take some
MAX_BYTES = 1 << 28  # bytes of a file that is read at once: far above an image or a long motion, far below the memory


def file_name(name: str, source: object) -> str:
    """The name of a file or folder for what ``source`` calls ``name``, such as a camera: the same, if that is possible.

    Raises:
        InputError: it would lead elsewhere, or some system has no file of that name.
    """
    if _RESERVED.search(name) or not name.isprintable() or len(name.encode()) > MAX_NAME:
        problem = f"{name!r} cannot be the name of a file"
        raise InputError(source, problem, 'name it without any of <>:"/\\|?* and control characters')
    return name


def walk(folder: str | Path) -> Iterator[tuple[str, list[str], list[str]]]:
    """As ``os.walk``, through links too, which may lead back: each folder once."""
    seen = set[str]()
    for place, folders, files in os.walk(folder, followlinks=True):
        if (real := os.path.realpath(place)) in seen:
            folders.clear()
            continue
        seen.add(real)
        folders.sort(key=lambda name: os.path.islink(os.path.join(place, name)))  # by their own names first
        yield place, folders, files


def native_path(path: str | Path) -> str:
    """A path as OpenCV, USD, ezc3d and TOML take it; an InputError where it is not UTF-8, which may end the process."""
    problem, remedy = "has a name that is not UTF-8", "rename the file or its folder"
    with input_errors(ascii(str(path)), problem, remedy, UnicodeEncodeError):
        return str(path).encode().decode()


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Give a temporary name beside ``path``, of the same ending, and rename what is written there when all went well.

    A file of that name is replaced; of a link, the file that it points to. Whatever goes wrong, nothing is left under
    either name that was not there before. Raises an InputError for a folder that is not there or cannot be written to,
    or a full disk (any ``OSError`` within).
    """
    if not path.parent.is_dir():
        raise InputError(path, "its folder does not exist", "create the folder first")
    place = Path(os.path.realpath(path)) if path.is_symlink() else path
    unfinished = place.with_name(f".{place.stem}.{os.getpid()}{path.suffix}")
    try:
        with input_errors(path, "cannot be written ({error})", "check its folder, permissions and free space", OSError):
            yield unfinished
            os.replace(unfinished, place)
    finally:
        unfinished.unlink(missing_ok=True)


def write_whole(path: Path, data: bytes) -> None:
    """Write ``data`` as :func:`whole_file` says, with its errors."""
    with whole_file(path) as unfinished:
        unfinished.write_bytes(data)


def csv_text(rows: Iterable[Iterable[object]]) -> str:
    """Rows of cells as the text of a CSV file, whose lines end alike on every system."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def content_hash(file: Path) -> bytes:
    """SHA-256 of a file's bytes; an InputError if it cannot be read."""
    with input_errors(file, "cannot be read ({error})", "check its permissions", OSError):
        _regular_size(file)
        with file.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").digest()


def _regular_size(path: Path) -> int:
    """Bytes of a file; an InputError for a device or a pipe, which may have no end or never begin."""
    status = os.stat(path)
    if not stat.S_ISREG(status.st_mode):
        raise InputError(path, "is a folder" if path.is_dir() else "is no regular file", "name a file")
    return status.st_size


def read_bytes(path: str | Path, remedy: str, *, missing: str = "check the path", most: int = MAX_BYTES) -> bytes:
    """A file's content.

    Raises:
        InputError: no such file, for which ``missing`` says what to do; one that cannot be read, is no regular file, or
            has over ``most`` bytes.
    """
    path = Path(path)
    try:
        size = _regular_size(path)
        with path.open("rb") as stream:
            data = b"" if size > most else stream.read(size)
    except FileNotFoundError:
        raise InputError(path, "no such file", missing) from None
    except InputError:
        raise
    except (OSError, ValueError) as error:
        raise InputError(path, f"cannot be read ({getattr(error, 'strerror', None) or error})", remedy) from None
    if size > most:
        raise InputError(path, f"has over {most >> 20} MB", remedy)
    return data


def read_text(
    path: str | Path,
    remedy: str,
    *,
    missing: str = "check the path",
    most: int = MAX_BYTES,
    encoding: str = "utf-8-sig",
    errors: str = "strict",
) -> str:
    """A file's text, by default of UTF-8; an InputError as :func:`read_bytes` has it, or where it is no text."""
    data = read_bytes(path, remedy, missing=missing, most=most)
    with input_errors(path, "cannot be read as text ({error})", remedy, ValueError):
        return io.TextIOWrapper(io.BytesIO(data), encoding, errors).read()


def read_json(path: str | Path, remedy: str, most: int = MAX_BYTES) -> dict[str, Any]:
    """The JSON object that a file holds; errors are as :func:`read_text` has them, or it is none."""
    text = read_text(path, remedy, missing=remedy, most=most)
    with input_errors(path, "is not valid JSON ({error})", remedy, ValueError, RecursionError):
        content = json.loads(text)
    if not isinstance(content, dict):
        raise InputError(path, "is not a JSON object", remedy)
    return content
