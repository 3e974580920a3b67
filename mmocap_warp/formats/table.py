"""The calibrations that a scene may name and the animations that a result is exported to, known by their endings.

A new format is a file in this room and a line here; see CONTRIBUTING.md. A format's module is imported when a file of
it is read or written, so that the table itself costs nothing to import.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from mmocap_warp.errors import InputError

if TYPE_CHECKING:
    from mmocap_warp.result.result import Result
    from mmocap_warp.views.rig import CameraRig


@dataclass(frozen=True)
class Format:
    """An outside format.

    Attributes:
        name: what people call it.
        suffixes: endings of its files' names, in lower case; the case of a file's own does not matter.
        function: ``module:function`` within this package that reads or writes a file of it.
        folder: whether a folder may stand for its files.
    """

    name: str
    suffixes: tuple[str, ...]
    function: str
    folder: bool = False

    def matches(self, path: Path) -> bool:
        """Whether a file of this name, or this folder, has the format."""
        return self.folder if os.path.isdir(path) else path.name.lower().endswith(self.suffixes)

    def __str__(self) -> str:
        return f"{self.name} ({', '.join([*self.suffixes, *(['their folder'] if self.folder else [])])})"

    def load(self) -> Callable:
        """The function that reads or writes it."""
        module, name = self.function.split(":")
        return getattr(import_module(f"mmocap_warp.formats.{module}"), name)


CALIBRATIONS: tuple[Format, ...] = (
    Format("Pose2Sim TOML", (".toml",), "calibration.toml_rig:read_toml_rig"),
    Format("Qualisys", (".qca.txt",), "calibration.qualisys:read_qualisys"),
    Format("OpenCV/EasyMocap YAML", (".yml", ".yaml"), "calibration.opencv_yaml:read_opencv_yaml", folder=True),
)
"""Their functions are called as :func:`read_calibration` is, and give what it gives."""

EXPORTS: tuple[Format, ...] = (Format("USD", (".usda", ".usdc", ".usdz"), "usd.animation:export_animation"),)
"""Their functions are called as :func:`export` is."""

EXPORT_SUFFIXES: tuple[str, ...] = tuple(suffix for format in EXPORTS for suffix in format.suffixes)
"""Endings that an exported animation may have."""


def read_calibration(
    path: Path, units: str = "m", up: str = "+z", sizes: dict[str, tuple[int, int]] | None = None
) -> CameraRig:
    """Read the cameras of a calibration of any format in ``CALIBRATIONS``.

    Args:
        path: the file, or a folder where the format has one.
        units: unit of its lengths, "m" or "mm", where the format leaves it open.
        up: the world's up axis.
        sizes: width and height [px] of cameras' images, for a format that may leave them out.

    Raises:
        InputError: an unknown ending, or a file that the format's reader refuses.
    """
    return _format_of(CALIBRATIONS, path).load()(path, units, up, sizes)


def export(result: Result, path: Path) -> None:
    """Write the animation of a result's best run in the format of ``EXPORTS`` that the file's ending names.

    Raises:
        InputError: an unknown ending, or a file that cannot be written.
    """
    _format_of(EXPORTS, path).load()(result, path)


def _format_of(formats: tuple[Format, ...], path: Path) -> Format:
    for candidate in formats:
        if candidate.matches(path):
            return candidate
    ending = "is a folder" if os.path.isdir(path) else f"ends in '{path.suffix}'" if path.suffix else "has no ending"
    raise InputError(path, f"{ending}, which is none of the known formats", f"give {' or '.join(map(str, formats))}")
