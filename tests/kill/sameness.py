"""Whether two folders that a command wrote hold the same answers, to the last bit; times are no answers."""

from __future__ import annotations

import re
import zipfile
from pathlib import Path

import numpy as np

from mmocap_warp.formats.usd.usd_result import holds_result, read_result

_PROGRESS = (".checkpoint", ".part")  # what a killed run leaves to be continued
_SECONDS = re.compile(
    rb'"step_seconds": {[^}]*}|"(evaluations_per_second|seconds)": [0-9.e+-]+|[0-9]+ s<'
)  # of a batch's records and its page
_FIELDS = ("pose", "cost", "iou", "evaluations", "status", "frame_numbers", "angle_sigma", "joint_sigma")


def difference(whole: Path, other: Path, *, complete: bool) -> list[str]:
    """What differs; not ``complete``: whatever is there must be as it should be, but some may not be there yet."""
    theirs, ours = _files(whole), _files(other)
    found = [f"{name} should not be there" for name in sorted(ours.keys() - theirs.keys())]
    if complete:
        found += [f"{name} is missing" for name in sorted(theirs.keys() - ours.keys())]
    return found + [
        f"{name} differs" for name in sorted(ours.keys() & theirs.keys()) if not _same(ours[name], theirs[name])
    ]


def _files(folder: Path) -> dict[str, Path]:
    """Files under a name that a user would look at: none that is hidden or of an unfinished run."""
    found = {str(path.relative_to(folder)): path for path in folder.rglob("*") if path.is_file()}
    return {name: path for name, path in found.items() if path.name[0] != "." and path.suffix not in _PROGRESS}


def _same(left: Path, right: Path) -> bool:
    if left.read_bytes() == right.read_bytes():
        return True
    if left.suffix == ".json" or left.name == "index.html":
        one, two = (_SECONDS.sub(b"", path.read_bytes()) for path in (left, right))
        return one == two
    if left.suffix in (".npz", ".usdz"):
        return _members(left) == _members(right)
    if left.suffix == ".usdc" and holds_result(left) and holds_result(right):
        one, two = read_result(left), read_result(right)
        return all(np.array_equal(getattr(one, name), getattr(two, name), equal_nan=True) for name in _FIELDS)
    return False


def _members(archive: Path) -> dict[str, bytes]:
    """What an archive holds, but where and when a study's result was made."""
    with zipfile.ZipFile(archive) as file:
        return {name: file.read(name) for name in file.namelist() if name != "provenance.json"}
