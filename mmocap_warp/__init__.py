"""Markerless motion capture from silhouettes, on NVIDIA Warp and OpenUSD: ``import mmocap_warp as mm``.

What stands here is the public face, with a function for each command; docs/python.md shows it at work. A name is
imported when it is first used, so that importing the package imports nothing else. Metres, radians and seconds
throughout; arrays are NumPy's. No room imports it. ``__init__.pyi`` says where each name is defined.
"""

import ast
from importlib import import_module
from pathlib import Path
from typing import Any

from mmocap_warp.version import __version__ as __version__


def _homes() -> dict[str, tuple[str, str]]:
    """The module that each public name is defined in, and its name there."""
    stub = ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    imports = [statement for statement in stub.body if isinstance(statement, ast.ImportFrom)]
    return {name.asname or name.name: (str(each.module), name.name) for each in imports for name in each.names}


_HOMES = _homes()

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, own_name = _HOMES[name]
    value = globals()[name] = getattr(import_module(module), own_name)
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
