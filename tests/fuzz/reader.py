"""What a trial knows of a reader of files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mutations
from mutations import Mutation

LINES = mutations.text_or_bytes


@dataclass(frozen=True)
class Reader:
    """A reader.

    Attributes:
        name: of what it reads, without blanks.
        file: the file that is damaged, from a folder on.
        write: writes that file and all it needs into a folder.
        read: reads it, from the folder; all that can be wrong with the file is an ``InputError``.
        damage: what is done to the file.
    """

    name: str
    file: str
    write: Callable[[Path], object]
    read: Callable[[Path], object]
    damage: Mutation


def write_text(folder: Path, **files: str) -> None:
    """Files by name, in which __ stands for the point."""
    for name, content in files.items():
        (folder / name.replace("__", ".")).write_text(content)
