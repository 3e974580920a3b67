"""Where a command may write: checked, and claimed for it alone, before any work starts."""

from __future__ import annotations

import os
from pathlib import Path

from mmocap_warp.cli.output_locks import FOLDER_CLAIM, claim
from mmocap_warp.errors import InputError


def new_file(path: Path, *suffixes: str, force: bool = False) -> Path:
    """``path``, if a file of that name can be written there.

    Args:
        path: the file.
        suffixes: endings that it may have.
        force: replace a file that exists.

    Raises:
        InputError: another ending, no such folder, not writable, a file that exists, or another process writes it.
    """
    if path.suffix not in suffixes:
        ending = f"ends in '{path.suffix}'" if path.suffix else "has no ending"
        raise InputError(path, ending, f"end it in {' or '.join(suffixes)}")
    _check_folder(path.parent)
    if path.is_dir():
        raise InputError(path, "is a folder", "name a file")
    if path.exists() and not force:
        raise InputError(path, "exists already", "give --force to replace it, or write elsewhere")
    claim(path)
    return path


def new_folder(path: Path, *, force: bool = False) -> Path:
    """``path`` as a folder, made if it does not exist (its parent must).

    Raises:
        InputError: no such parent, not writable, a file, a folder that holds something, or another process writes it.
    """
    _check_folder(path.parent)
    if path.exists() and not path.is_dir():
        raise InputError(path, "is a file", "name a folder")
    if path.is_dir() and any(file.name != FOLDER_CLAIM for file in path.iterdir()) and not force:
        raise InputError(path, "holds files already", "give --force to write among them, or name another folder")
    path.mkdir(exist_ok=True)
    claim(path)
    return path


def _check_folder(folder: Path) -> None:
    if not folder.is_dir():
        raise InputError(folder, "no such folder", "make it first")
    if not os.access(folder, os.W_OK):
        raise InputError(folder, "cannot be written to", "change its permissions, or write elsewhere")
