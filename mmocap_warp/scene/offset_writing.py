"""Writing offsets into a scene file that people wrote: everything else in it stays as it is, comments too."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from pathlib import Path

from mmocap_warp.errors import InputError
from mmocap_warp.whole_file import write_whole

_HEADER = re.compile(r"\s*\[(?!\[)(?P<name>.*)\]\s*(#.*)?$")
_OFFSET = re.compile(r"\s*(frame_offset|offset)\s*=")
_FPS = re.compile(r"\s*fps\s*=")


def write_timing(path: Path, timing: Mapping[str, Mapping[str, float]]) -> None:
    """Set ``offset`` [s], and ``fps`` where it is given, of cameras by their names; an offset of 0 is left out.

    Raises:
        InputError: the file is written in a way in which they cannot be set, such as cameras in inline tables.
    """
    text = path.read_text(encoding="utf-8")
    lines: list[str] = []
    camera = ""
    for line in text.splitlines(keepends=True):
        if header := _HEADER.match(line):
            camera = _camera_of(header["name"])
            lines.append(line)
            if camera in timing:
                end = "\r\n" if line.endswith("\r\n") else "\n"
                lines[-1] = line if line.endswith(end) else line + end
                lines += [f"{key} = {value!r}{end}" for key, value in timing[camera].items() if value]
        elif camera not in timing or not (_OFFSET.match(line) or ("fps" in timing[camera] and _FPS.match(line))):
            lines.append(line)
    # The text is only written if a reader finds in it what was there, and the new times.
    changed, expected = "".join(lines), tomllib.loads(text)
    for name, keys in timing.items():
        values = expected["cameras"][name]
        for key in ("frame_offset", "offset", *keys):
            values.pop(key, None)
        values |= {key: value for key, value in keys.items() if value}
    try:
        is_expected = tomllib.loads(changed) == expected
    except tomllib.TOMLDecodeError:
        is_expected = False
    if not is_expected:
        raise InputError(path, "is written in a way that cannot be changed safely", "put the lines there by hand")
    write_whole(path, changed.encode())


def _camera_of(header: str) -> str:
    """The camera whose table a header begins; "" for other tables."""
    try:
        cameras = tomllib.loads(f"[{header}]").get("cameras", {})
    except tomllib.TOMLDecodeError:
        return ""
    return next((name for name, values in cameras.items() if values == {}), "")
