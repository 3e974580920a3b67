"""A hash of the code that a study's results come from, so that those of different code are told apart."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable

_ROOTS = ("mmocap_warp", "mmocap_warp.kernels")
"""Where the package's modules lie: its kernels may be in a folder elsewhere, as in an editable install."""

_LEFT_OUT: tuple[str, ...] = ("bench", "bodies", "cli", "drawing", "kernels.benchmarks", "scenes", "study")
"""Packages that no pose, mask or error comes from, or data alone. A new package counts unless it is named here."""

_OF_STUDY: tuple[str, ...] = ("degradations", "further_clips", "job", "metrics", "sequences", "source")
"""The modules of the study that count: what is tracked, how, and how it is judged."""


@cache
def code_hash() -> str:
    """SHA-256 of every module that a result depends on, by name and content; the same however it is installed.

    Computed once: a process goes on with the modules that it has loaded.
    """
    modules = {name: file for root in _ROOTS for name, file in _modules(root) if _counts(name)}
    digest = hashlib.sha256()
    for name, file in sorted(modules.items()):
        digest.update(f"{name}\n".encode())
        digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()


def _modules(package: str, folder: Traversable | None = None) -> Iterator[tuple[str, Traversable]]:
    """The source files of a package and of the packages in it, by the name that they are imported as."""
    for item in (files(package) if folder is None else folder).iterdir():
        name = f"{package}.{item.name.removesuffix('.py')}"
        if item.joinpath("__init__.py").is_file():
            yield from _modules(name, item)
        elif item.name.endswith(".py"):
            yield name, item


def _counts(name: str) -> bool:
    """Whether results depend on a module."""
    within = name.removeprefix("mmocap_warp.")
    if within in {f"study.{module}" for module in _OF_STUDY}:
        return True
    return not any(within.startswith(f"{package}.") for package in _LEFT_OUT)
