"""Writing a file so that it appears under its name when it is complete, or not at all."""

from __future__ import annotations

import os
from pathlib import Path

from mmocap_warp.errors import InputError


def write_whole(path: Path, data: bytes) -> None:
    """Write ``data`` under a temporary name beside ``path``, then rename it; a file of that name is replaced.

    Raises:
        InputError: its folder does not exist or cannot be written to, or the disk is full.
    """
    unfinished = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        unfinished.write_bytes(data)
        os.replace(unfinished, path)
    except OSError as error:
        raise InputError(
            path, f"cannot be written ({error})", "check its folder, permissions and free space"
        ) from error
    finally:
        unfinished.unlink(missing_ok=True)
