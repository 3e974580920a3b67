"""The calibrations that are read and written and the animations that a result is exported to, known by their endings.

And the data sets that become scenes, known by their names.

A new format is a file in this room and a line here; see CONTRIBUTING.md. A format's module is imported when a file of
it is read or written, so that the table itself costs nothing to import.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from mmocap_warp.errors import InputError, UsageError

if TYPE_CHECKING:
    from mmocap_warp.body.joint_sets import JointSet
    from mmocap_warp.cameras.rig import CameraRig
    from mmocap_warp.formats.datasets.dataset_scene import DatasetScene
    from mmocap_warp.result.result import Result


@dataclass(frozen=True)
class Format:
    """An outside format."""

    name: str  # what people call it
    # Endings of its files' names, in lower case (the case of a file's own does not matter), or whole names.
    suffixes: tuple[str, ...]
    function: str  # ``module:function`` within this package that reads or writes a file of it
    folder: str = ""  # what a folder that may stand for its files holds, as a pattern; empty where none may
    # Of an export: the vertical that the format prescribes, or that its readers assume; None where the file says it.
    up: str | None = None
    open_units: bool = False  # of a calibration: whether neither its files nor its writers' custom say its unit
    open_sizes: bool = False  # of a calibration: whether it may leave out how large the images are
    beside: tuple[str, ...] = ()  # names of further files that a calibration of it is written to
    takes_joint_set: bool = False  # of an export: whether it may go by a joint set
    people: tuple[str, ...] = ()  # of an export: endings of files that hold several people, whose results come by name
    lenses: str = ""  # of a calibration that may lack the cameras' places: the function that reads such a file

    def matches(self, path: Path) -> bool:
        """Whether a file of this name, or this folder, has the format."""
        if os.path.isdir(path):
            return bool(self.folder) and any(path.glob(self.folder))
        endings = tuple(each for each in self.suffixes if each.startswith("."))
        return path.name in self.suffixes or path.name.lower().endswith(endings)

    def __str__(self) -> str:
        return f"{self.name} ({', '.join([*self.suffixes, *(['their folder'] if self.folder else [])])})"

    def load(self) -> Callable:
        """The function that reads or writes it."""
        return _function(self.function)


def _function(name: str) -> Callable:
    module, _, function = name.partition(":")
    return getattr(import_module(f"mmocap_warp.formats.{module}"), function)


CALIBRATIONS: tuple[Format, ...] = (
    Format(
        "Pose2Sim/aniposelib/Caliscope TOML",
        (".toml",),
        "calibration.toml_rig:read_toml_rig",
        lenses="calibration.toml_rig:read_toml_lenses",
    ),
    Format("Qualisys", (".qca.txt",), "calibration.qualisys:read_qualisys"),
    Format(
        "OpenCV/EasyMocap YAML",
        ("intri.yml", "extri.yml"),
        "calibration.opencv_yaml:read_opencv_yaml",
        folder="*tri.yml",
        open_sizes=True,
        lenses="calibration.opencv_yaml:read_yaml_lenses",
    ),
    Format(
        "COLMAP text",
        ("cameras.txt", "images.txt"),
        "calibration.colmap:read_colmap",
        folder="cameras.txt",
        open_units=True,
    ),
    Format(
        "MultiCal",
        (".json",),
        "calibration.multical:read_multical",
        open_units=True,
        lenses="calibration.multical:read_multical_lenses",
    ),
    Format("HumanEva", (".cal",), "humaneva.humaneva_files:read_cal_folder", folder="*.[cC][aA][lL]", open_sizes=True),
    Format("USD", (".usda", ".usdc", ".usd"), "usd.usd_camera:read_usd_cameras", open_sizes=True),
)
"""Their functions are called as :func:`read_calibration` is, and give what it gives."""

CALIBRATION_EXPORTS: tuple[Format, ...] = (
    Format("Pose2Sim/aniposelib TOML", (".toml",), "calibration.toml_rig:write_toml_rig"),
    Format("OpenCV/EasyMocap YAML", ("intri.yml",), "calibration.opencv_yaml:write_opencv_yaml", beside=("extri.yml",)),
    Format("COLMAP text", ("cameras.txt",), "calibration.colmap:write_colmap", beside=("images.txt", "points3D.txt")),
    Format("USD", (".usda", ".usdc", ".usd"), "usd.usd_camera:write_usd_cameras"),
)
"""Their functions take the file and the rig, as :func:`write_calibration` does."""

_USD = (".usda", ".usdc", ".usdz")

EXPORTS: tuple[Format, ...] = (
    Format("USD", _USD, "usd.usd_result:export_animation", people=_USD),
    Format("glTF", (".glb", ".vrma"), "exports.glb:write_glb", up="+y", people=(".glb",)),
    Format("BVH", (".bvh",), "exports.write_bvh:write_bvh", up="+y"),
    Format("OpenSim markers", (".trc",), "exports.tables:write_trc", up="+y", takes_joint_set=True),
    Format("OpenSim motion", (".mot",), "exports.tables:write_mot", up="+y", takes_joint_set=True),
    Format("C3D", (".c3d",), "exports.tables:write_c3d", takes_joint_set=True),
    Format("CSV", (".csv",), "exports.tables:write_csv", takes_joint_set=True),
    Format("Parquet", (".parquet",), "exports.tables:write_parquet", takes_joint_set=True),
    Format("JSON", (".json",), "exports.tables:write_json", takes_joint_set=True),
    Format("NumPy", (".npz",), "exports.tables:write_npz", takes_joint_set=True),
)
"""Their functions are called as :func:`export` is."""

POINT_CACHES: tuple[Format, ...] = (Format("USD point cache", _USD, "usd.usd_result:export_point_cache"),)
"""Exports of the skin's points at every frame instead of a skeleton that moves it; called as :func:`export` is."""

EXPORT_SUFFIXES: tuple[str, ...] = tuple(suffix for format in EXPORTS for suffix in format.suffixes)
"""Endings that an exported animation may have."""


@dataclass(frozen=True)
class Dataset:
    """A published data set."""

    title: str  # what people call it
    parts: tuple[str, ...]  # what names a recording in it, besides its root; those in brackets may be left out
    function: str  # as of a ``Format``; it takes the root and the parts
    tried_on: str  # on which data its reader was tried

    def usage(self, name: str) -> str:
        """How a recording of it is named on the command line."""
        return " ".join(["mmocap dataset", name, "ROOT", *self.parts])


_TWINS = "made twins"

DATASETS: dict[str, Dataset] = {
    "humaneva": Dataset(
        "HumanEva-I", ("SUBJECT", "ACTION", "[FIRST]", "[LAST]"), "humaneva.sequence:read_humaneva", _TWINS
    ),
    "panoptic": Dataset("CMU Panoptic", ("[PERSON]",), "datasets.panoptic:read_panoptic", _TWINS),
    "biocv": Dataset("BioCV", ("TRIAL",), "datasets.biocv:read_biocv", _TWINS),
    "mpi-inf-3dhp": Dataset("MPI-INF-3DHP", ("SUBJECT", "SEQUENCE"), "datasets.mpi_inf_3dhp:read_3dhp", _TWINS),
    "dannce": Dataset(
        "DANNCE, Rat7M", ("[FIRST]",), "datasets.dannce:read_dannce", f"{_TWINS}; DANNCE's label file and mouse"
    ),
}
"""By their names on the command line."""


def read_dataset(name: str, root: Path, parts: Sequence[str]) -> DatasetScene:
    """Read a recording of a data set in ``DATASETS``.

    Raises:
        UsageError: another name, or too few or too many parts.
        InputError: data that are missing or cannot be read.
    """
    if name not in DATASETS:
        raise UsageError(f"there is no data set {name!r}; there are {', '.join(DATASETS)}")
    dataset = DATASETS[name]
    needed = [part for part in dataset.parts if not part.startswith("[")]
    if not len(needed) <= len(parts) <= len(dataset.parts):
        raise UsageError(f"a recording of {dataset.title} is named so: {dataset.usage(name)}")
    return _function(dataset.function)(root, *parts)


def read_calibration(
    path: Path, units: str | None = None, up: str = "+z", sizes: dict[str, tuple[int, int]] | None = None
) -> CameraRig:
    """Read the cameras of a calibration of any format in ``CALIBRATIONS``: a file, or a folder where it has one.

    What a format may leave open is given: ``units``, of ``METRES``, of its lengths, None where that is not known; the
    world's ``up`` axis; and ``sizes``, width and height [px] of cameras' images, under
    :data:`~mmocap_warp.formats.calibration.calibration_text.EVERY_OTHER` those of all other cameras.

    Raises:
        InputError: an unknown ending, a file that cannot be read, values that are missing, or no calibration (see
            :func:`~mmocap_warp.cameras.rig.check_rig`).
    """
    return format_of(CALIBRATIONS, path).load()(path, units, up, sizes)


def read_lenses(path: Path, up: str, sizes: dict[str, tuple[int, int]]) -> CameraRig | None:
    """As :func:`read_calibration`, a calibration's cameras at the origin, or None if it says where they stand."""
    format = format_of(CALIBRATIONS, path)
    return _function(format.lenses)(path, up, sizes) if format.lenses else None


def write_calibration(path: Path, rig: CameraRig) -> None:
    """Write cameras in the format of ``CALIBRATION_EXPORTS`` that the file's name tells, lengths in metres.

    Raises:
        InputError: an unknown name, a format that cannot hold these cameras, or files that cannot be written.
    """
    if rig.K[:, 0, 1].any() and not path.name.lower().endswith((".toml", ".yml")):
        raise InputError(path, "cannot hold the skew that these cameras have", "write a .toml or intri.yml")
    format_of(CALIBRATION_EXPORTS, path).load()(path, rig)


def export(
    result: Result | dict[str, Result],
    path: Path,
    formats: tuple[Format, ...] = EXPORTS,
    joint_set: JointSet | None = None,
) -> None:
    """Write the animation of a result's best run in that one of some formats that the file's ending names.

    A joint set is for formats that take one, results by people's names for those that hold several.

    A format with a vertical of its own has the world turned to it, as :func:`mmocap_warp.result.excerpt.stood_up` does.
    """
    from mmocap_warp.result.excerpt import stood_up

    format = format_of(formats, path)
    points = {} if joint_set is None else {"joint_set": joint_set}
    people = result if isinstance(result, dict) else {"": result}
    turned = {name: each if format.up is None else stood_up(each, format.up) for name, each in people.items()}
    format.load()(turned if isinstance(result, dict) else turned[""], path, **points)


def format_of(formats: tuple[Format, ...], path: Path) -> Format:
    """The one of some formats that a file's name tells; an InputError where none does."""
    for candidate in formats:
        if candidate.matches(path):
            return candidate
    ending = "is a folder" if os.path.isdir(path) else f"ends in '{path.suffix}'" if path.suffix else "has no ending"
    raise InputError(path, f"{ending}, which is none of the known formats", f"give {' or '.join(map(str, formats))}")
