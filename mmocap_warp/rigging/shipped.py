"""Bodies by name: those that ship with the package, or a file of one's own."""

from __future__ import annotations

from pathlib import Path

from mmocap_warp.body.model import BodyModel
from mmocap_warp.errors import InputError
from mmocap_warp.formats.usd.usd_body import read_body
from mmocap_warp.scenes import ROOT

_FOLDERS = ("bodies", "characters")  # people, and others

DEFAULT_BODY = "adult_man"
"""Where a fit starts if nobody says."""


def load_body(name: str | Path, source: object = "body") -> BodyModel:
    """A body by the name of a shipped one, such as ``adult_man``, or by the path of its USD file.

    Args:
        name: a name without an ending, or a path with one.
        source: where the name stands, for messages.

    Raises:
        InputError: no such body, or a file that holds none.
    """
    return read_body(body_file(name, source))


def body_file(name: str | Path, source: object = "body") -> Path:
    """The file of a body, by name or path as :func:`load_body` takes it.

    Raises:
        InputError: no shipped body of that name.
    """
    if Path(name).suffix:
        return Path(name)
    shipped = [file for folder in _FOLDERS for file in sorted((ROOT / folder).glob("*.usdc"))]
    found = next((file for file in shipped if file.stem == str(name)), None)
    if found is None:
        known = ", ".join(file.stem for file in shipped)
        raise InputError(source, f"there is no body '{name}'", f"name a USD file, or one of {known}")
    return found
