"""The other files that a USD file names: sublayers, references, payloads, clips and assets.

Composing a stage opens them wherever they lie, so that a file from a stranger could have others read that nobody named.
They are looked at before a stage is composed, and only those in the file's own folder are let pass.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pxr import Sdf, UsdUtils

from mmocap_warp.errors import InputError

ALLOWED = "MMOCAP_ALLOW_REFERENCES"
"""The environment's variable that lets references pass wherever they lead: ``1`` for yes."""


def check_references(layer: Sdf.Layer, path: Path) -> None:
    """See that a layer, and the layers that it names, refer to files of its own folder only.

    ``layer`` was read from ``path`` as an anonymous one; what it names relative to its file is made absolute.

    Raises:
        InputError: a file elsewhere, or one that is named by an expression, unless ``ALLOWED`` says yes.
    """
    names = _anchored(layer, path)
    if names and os.environ.get(ALLOWED, "0") in ("", "0"):
        _check(names, path, path.resolve().parent, {path.resolve()})


def _check(names: list[str], source: Path, folder: Path, seen: set[Path]) -> None:
    for name in names:
        target = Path(os.path.realpath(name.split("[", 1)[0]))  # of a package's member, the package
        if "`" in name or not target.is_relative_to(folder):
            raise InputError(
                source,
                f"refers to {name}, which is not in its folder",
                "put that file beside it, or give --allow-references if you trust both",
            )
        if target in seen or not target.is_file():
            continue
        seen.add(target)
        with _opened(target) as layer:
            if layer:
                _check(_anchored(layer, target), target, folder, seen)


@contextmanager
def _opened(path: Path) -> Iterator[Sdf.Layer | None]:
    """A layer by itself; None for what is no layer, such as a picture."""
    yield Sdf.Layer.OpenAsAnonymous(str(path)) if Sdf.FileFormat.FindByExtension(path.suffix) else None


def _anchored(layer: Sdf.Layer, path: Path) -> list[str]:
    """The names of all other files in a layer, which are made absolute there."""
    names: list[str] = []

    def absolute(name: str) -> str:
        names.append(os.path.join(path.resolve().parent, name))
        return names[-1]

    UsdUtils.ModifyAssetPaths(layer, absolute)
    names += (name for name in layer.GetCompositionAssetDependencies() if "`" in name)  # which the function leaves out
    return names + _expressions_of_clips(layer)


def _expressions_of_clips(layer: Sdf.Layer) -> list[str]:
    found = []

    def look(path: Sdf.Path) -> None:
        prim = layer.GetPrimAtPath(path) if path.IsPrimPath() or path.IsPrimVariantSelectionPath() else None
        if prim and prim.HasInfo("clips") and "`" in str(prim.GetInfo("clips")):
            found.append(f"`...` in the clips of {path}")

    layer.Traverse(Sdf.Path.absoluteRootPath, look)
    return found
