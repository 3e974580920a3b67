"""A hash of the code that a result comes from, so that results of different code are told apart.

A result depends on the modules that compute it, and on no others. So the imports are followed from where the work
begins. Modules that only another kind of work needs are left out: those of contours where no contours are fitted, and
those that read recordings where the masks are made.

Comments, docstrings and blank lines do not count. The hash is of text, not of Python's bytecode or syntax tree, so that
it is the same under every version of Python.
"""

import hashlib
import re
from collections.abc import Iterator
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable

_ROOTS = ("mmocap_warp", "mmocap_warp.kernels")
"""Where the package's modules lie: its kernels may be in a folder elsewhere, as in an editable install."""

_CONTOUR_MODULES: tuple[str, ...] = (
    "contour", "fitting", "kernels.contour", "tracking.contour_tracker", "tracking.smoothing",
)  # fmt: skip
"""Modules, and packages with all their modules, that only fitting contours needs."""

_RECORDING_MODULES: tuple[str, ...] = (
    "formats", "masks.cleanup", "masks.frames", "masks.mask_files", "masks.subtraction", "scene",
)  # fmt: skip
"""Modules that only recordings need. A shipped sequence reads only shipped bodies, and their content counts itself."""

_UNCOUNTED: tuple[str, ...] = (
    "code_hash", "device.resolve", "errors", "jobs", "rigging", "scenes", "study.cell", "tracking.body_masks",
    "tracking.checkpoint", "version", "versions", "whole_file",
)  # fmt: skip
"""Modules that are imported but that no pose, mask or error comes from."""


@cache
def code_hash(begin: str, *, contours: bool = True, recorded: bool = True) -> str:
    """SHA-256 of every module that a result depends on, by name and code; the same however the package is installed.

    It is computed once a process, which goes on with the modules that it has loaded.

    Args:
        begin: the module whose imports are followed, and theirs, such as ``study.job``.
        contours: whether contours are fitted, of frames or to solve a body.
        recorded: whether masks are read from a recording.
    """
    digest = hashlib.sha256()
    for name in sorted(counted(begin, contours=contours, recorded=recorded)):
        digest.update(f"{name}\n".encode())
        # Beside a module may lie what Warp puts into its functions, or its numbers.
        beside = [file for ending in (".cu", ".toml") if (file := _files().get(name + ending))]
        text = _code(_source(name)) + "".join(file.read_text(encoding="utf-8") for file in beside)
        digest.update(hashlib.sha256(text.encode()).digest())
    return digest.hexdigest()


def counted(begin: str, *, contours: bool, recorded: bool) -> set[str]:
    """The modules that count for :func:`code_hash`, by their names within the package."""
    uncounted = (*_UNCOUNTED, *(() if contours else _CONTOUR_MODULES), *(() if recorded else _RECORDING_MODULES))
    names: set[str] = set()
    ahead = {begin}
    while ahead:
        name = ahead.pop()
        if name not in names and not any(name == each or name.startswith(f"{each}.") for each in uncounted):
            names.add(name)
            ahead |= _imports(name)
    return names


_TOKEN = re.compile(
    r"""(?P<comment>\#[^\n]*)
    | (?P<string>\"{3}(?:[^\\]|\\.)*?\"{3} | '{3}(?:[^\\]|\\.)*?'{3} | "(?:[^"\\\n]|\\.)*" | '(?:[^'\\\n]|\\.)*')
    | (?P<open>[(\[{]) | (?P<close>[)\]}])""",
    re.VERBOSE | re.DOTALL,
)


def _code(source: str) -> str:
    """A module's text without comments, docstrings and blank lines."""
    kept: list[str] = []
    position = depth = 0
    for token in _TOKEN.finditer(source):
        kept.append(source[position : token.start()])
        position = token.end()
        depth += (token.lastgroup == "open") - (token.lastgroup == "close")
        # A docstring is a string that is a statement by itself: nothing stands beside it, and no bracket is open.
        line = source[source.rfind("\n", 0, token.start()) + 1 : token.start()]
        alone = not line.strip() and source[position : position + 1] in ("\n", "")
        is_docstring = token.lastgroup == "string" and depth == 0 and alone
        if token.lastgroup != "comment" and not is_docstring:
            kept.append(token.group())
    kept.append(source[position:])
    return "\n".join(line.rstrip() for line in "".join(kept).split("\n") if line.strip())


_LAZY = re.compile(r'"([a-z][\w.]*):\w+"')  # "module:name" in a table that imports what is asked for
_IMPORT = re.compile(r"^\s*from mmocap_warp\.?([\w.]*) import (\([^)]*\)|[^\n]*)", re.MULTILINE)


@cache
def _imports(name: str) -> frozenset[str]:
    """The modules of the package that a module imports anywhere in it, and the packages that these are in."""
    names = set(_LAZY.findall(_source(name)))
    for module, imported in _IMPORT.findall(_source(name)):
        rooms = module.split(".")
        names |= {".".join(rooms[: depth + 1]) for depth in range(len(rooms))}
        names |= {f"{module}.{each}".lstrip(".") for each in re.findall(r"\w+", imported)}
    return frozenset(names & _files().keys())


def _source(name: str) -> str:
    """A module's text."""
    return _files()[name].read_text(encoding="utf-8")


@cache
def _files() -> dict[str, Traversable]:
    """The file of every module by its name within the package; a package's own is called as the package."""
    return {
        name.removeprefix("mmocap_warp.").removesuffix(".__init__"): file
        for root in _ROOTS
        for name, file in _modules(root)
    }


def _modules(package: str, folder: Traversable | None = None) -> Iterator[tuple[str, Traversable]]:
    """The source files of a package and of the packages in it, by the name that they are imported as, or would be."""
    for item in (files(package) if folder is None else folder).iterdir():
        name = f"{package}.{item.name.removesuffix('.py')}"
        if item.joinpath("__init__.py").is_file():
            yield from _modules(name, item)
        elif item.name.endswith((".py", ".cu", ".toml")):
            yield name, item
