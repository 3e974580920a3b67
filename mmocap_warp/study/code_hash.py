"""A hash of the code that a study's results come from, so that those of different code are told apart.

A result depends on the modules that tracking and judging it import, and on no others. So the imports are followed from
where the work begins; what another kind of work alone needs is left out: the contours' modules where no contours are
fitted, those that read recordings where the masks are made.
"""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterator
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable

_ROOTS = ("mmocap_warp", "mmocap_warp.kernels")
"""Where the package's modules lie: its kernels may be in a folder elsewhere, as in an editable install."""

_OF_CONTOURS: tuple[str, ...] = (
    "contour", "kernels.contour", "study.solved_body", "tracking.contour_tracker", "tracking.smoothing",
)  # fmt: skip
"""Modules, and packages with all their modules, that only fitting contours needs."""

_OF_RECORDINGS: tuple[str, ...] = ("formats", "masks", "scene")
"""That only recordings need: a shipped sequence reads nothing but shipped bodies, whose content is its identity."""

_LEFT_OUT: tuple[str, ...] = (
    "device.resolve", "errors", "rigging", "scenes", "study.cell", "study.code_hash", "tracking.body_masks",
    "tracking.checkpoint", "tracking.run_identity", "version", "versions", "whole_file",
)  # fmt: skip
"""That no pose, mask or error of a study comes from, or data alone, though what counts imports them."""


@cache
def code_hash(begin: str = "study.job", *, contours: bool = True, recorded: bool = True) -> str:
    """SHA-256 of every module that a result depends on, by name and content; the same however it is installed.

    Computed once a process: it goes on with the modules that it has loaded.

    Args:
        begin: the module whose imports are followed, and theirs.
        contours: whether contours are fitted, of frames or to solve a body.
        recorded: whether masks are read from a recording.
    """
    digest = hashlib.sha256()
    for name in sorted(counted(begin, contours=contours, recorded=recorded)):
        digest.update(f"{name}\n".encode())
        digest.update(hashlib.sha256(_sources()[name].read_bytes()).digest())
    return digest.hexdigest()


def counted(begin: str, *, contours: bool, recorded: bool) -> set[str]:
    """The modules that count for :func:`code_hash`, by their names within the package."""
    left_out = (*_LEFT_OUT, *(() if contours else _OF_CONTOURS), *(() if recorded else _OF_RECORDINGS))
    found: set[str] = set()
    ahead = {begin}
    while ahead:
        name = ahead.pop()
        if name not in found and not any(name == each or name.startswith(f"{each}.") for each in left_out):
            found.add(name)
            ahead |= _imports(name)
    return found


@cache
def _imports(name: str) -> frozenset[str]:
    """The modules of the package that a module imports anywhere in it, or names to be imported."""
    named = set()
    for node in ast.walk(ast.parse(_sources()[name].read_bytes())):
        if isinstance(node, ast.ImportFrom) and node.module:
            named |= {node.module, *(f"{node.module}.{imported.name}" for imported in node.names)}
        elif isinstance(node, ast.Import):
            named |= {imported.name for imported in node.names}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and ":" in node.value:
            named.add(node.value.partition(":")[0])  # "module:function" of a table that imports when it is asked
    return frozenset(name for name in (each.removeprefix("mmocap_warp.") for each in named) if name in _sources())


@cache
def _sources() -> dict[str, Traversable]:
    """The file of every module by its name within the package; a package's own is called as the package."""
    return {
        name.removeprefix("mmocap_warp.").removesuffix(".__init__"): file
        for root in _ROOTS
        for name, file in _modules(root)
    }


def _modules(package: str, folder: Traversable | None = None) -> Iterator[tuple[str, Traversable]]:
    """The source files of a package and of the packages in it, by the name that they are imported as."""
    for item in (files(package) if folder is None else folder).iterdir():
        name = f"{package}.{item.name.removesuffix('.py')}"
        if item.joinpath("__init__.py").is_file():
            yield from _modules(name, item)
        elif item.name.endswith(".py"):
            yield name, item
