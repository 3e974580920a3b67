"""Writing offsets into a scene file that people wrote: everything else in it stays as it is, comments too."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mmocap_warp.errors import InputError
from mmocap_warp.whole_file import write_whole

_HEADER = re.compile(r"\s*\[(?!\[)(?P<name>.*)\]\s*(#.*)?$")
_OFFSET = re.compile(r"\s*(frame_offset|offset)\s*=")


def write_timing(path: Path, timing: Mapping[str, Mapping[str, float]]) -> None:
    """Set ``offset`` [s], and ``fps`` where it is given, of cameras by their names; an offset of 0 is left out.

    Raises:
        InputError: the file is written in a way in which they cannot be set, such as cameras in inline tables.
    """
    text = path.read_text(encoding="utf-8")
    lines: list[str] = []
    camera: str | None = None
    for line in text.splitlines(keepends=True):
        if header := _HEADER.match(line):
            camera = _camera_of(header["name"])
            lines.append(line)
            if camera is not None and camera in timing:
                end = "\r\n" if line.endswith("\r\n") else "\n"
                lines[-1] = line if line.endswith(end) else line + end
                lines += [f"{key} = {value!r}{end}" for key, value in timing[camera].items() if value]
            continue
        if camera is not None and camera in timing and _sets(line, timing[camera]):
            continue
        lines.append(line)
    changed = "".join(lines)
    if _read(changed) != _expected(tomllib.loads(text), timing):
        raise InputError(path, "is written in a way that cannot be changed safely", "put the lines there by hand")
    write_whole(path, changed.encode())


def _camera_of(header: str) -> str | None:
    """The camera whose table a header begins; None for other tables."""
    try:
        table = tomllib.loads(f"[{header}]")
    except tomllib.TOMLDecodeError:
        return None
    cameras = table.get("cameras", {})
    return next(iter(cameras)) if len(cameras) == 1 and cameras[next(iter(cameras))] == {} else None


def _sets(line: str, timing: Mapping[str, float]) -> bool:
    return bool(_OFFSET.match(line)) or ("fps" in timing and bool(re.match(r"\s*fps\s*=", line)))


def _read(text: str) -> dict[str, Any] | None:
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return None


def _expected(values: dict[str, Any], timing: Mapping[str, Mapping[str, float]]) -> dict[str, Any]:
    for name, keys in timing.items():
        camera = values["cameras"][name]
        for key in ("frame_offset", "offset", *keys):
            camera.pop(key, None)
        camera |= {key: value for key, value in keys.items() if value}
    return values
