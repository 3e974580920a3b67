"""Files that a file names: only those in a folder that the user named."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import unquote

from mmocap_warp.errors import InputError


def file_inside(folder: Path, name: str, source: object) -> Path:
    """The file ``name`` in ``folder`` or below it; ``source`` is the file that names it.

    Raises:
        InputError: it lies elsewhere, or does not exist.
    """
    root = folder.resolve()
    try:
        found = (root / unquote(name)).resolve()
        exists = found.is_file()
    except (OSError, ValueError):  # such as a name with a zero byte
        raise InputError(source, f"names a file {name!r}, which cannot be", "correct that name") from None
    if not found.is_relative_to(root):
        raise InputError(source, f"names '{name}', which is not in {folder}", "copy it there, and say so")
    if not exists:
        raise InputError(source, f"names '{name}', which is not in {folder}", "put it there")
    return found
