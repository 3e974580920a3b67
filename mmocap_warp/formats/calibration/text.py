"""Reading a calibration's text, which is short: a camera takes about a thousand bytes."""

from __future__ import annotations

import os
from pathlib import Path

from mmocap_warp.errors import InputError

_MOST_BYTES = 2**20


def refuse_huge(path: str | Path, most: int = _MOST_BYTES) -> None:
    """Raise InputError for a file of more bytes than a calibration has; one that is not there is for its reader."""
    try:
        size = os.stat(path).st_size
    except (OSError, ValueError):
        return
    if size > most:
        raise InputError(path, f"has over {most >> 20} MB", "give a calibration of cameras")


def read_text(path: str | Path, kind: str, most: int = _MOST_BYTES) -> str:
    """A file's text; ``kind`` says what it should be, for the remedy.

    Raises:
        InputError: missing, too large, not text.
    """
    refuse_huge(path, most)
    try:
        return Path(path).read_text(encoding="utf-8")
    except FileNotFoundError:
        raise InputError(path, "no such file", f"give {kind}") from None
    except (OSError, ValueError) as error:
        raise InputError(path, f"cannot be read ({error})", f"give {kind}") from None
