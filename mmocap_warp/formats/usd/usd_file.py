"""USD files and attributes: read with plain errors, written whole or not at all."""

import json
import os
from collections.abc import Callable, Iterable, Sequence
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec, Self, TypeVar

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdUtils, Vt

from mmocap_warp.body.rotations import quarter_turn
from mmocap_warp.errors import InputError
from mmocap_warp.formats.sandbox import sandboxed, trust
from mmocap_warp.whole_file import native_path, whole_file

P = ParamSpec("P")
T = TypeVar("T")
K = TypeVar("K")

USD_SUFFIXES: tuple[str, ...] = (".usd", ".usda", ".usdc")


def read_stage(path: str | Path) -> Usd.Stage:
    """Open a USD file, in a function that :func:`reads_usd` decorates.

    A file rewritten since it was last read in this process is read anew. Raises an InputError for no file, not USD, or
    one that refers to files outside its folder.
    """
    path = Path(path)
    if not os.path.isfile(path):
        raise InputError(path, "is a folder" if path.is_dir() else "no such file", "name a USD file that is there")
    # USD keeps layers by file name and would hand out the old one; an anonymous layer has no name.
    layer = Sdf.Layer.OpenAsAnonymous(str(path))
    if layer:
        check_references(layer, path)
    stage = Usd.Stage.Open(layer) if layer else None
    if stage is None:
        raise InputError(path, "is not a USD file", f"give a file that ends in {', '.join(USD_SUFFIXES)}")
    return stage


def reads_usd(reader: Callable[P, T]) -> Callable[P, T]:
    """Decorate a reader of a USD file, whose path is its first argument, to raise ``InputError`` for damage.

    USD reads values when they are asked for, and only then finds damage: the reader goes from :func:`read_stage` to the
    last value. A file of others is read in the sandbox first, see :func:`~mmocap_warp.formats.sandbox.sandboxed`.
    """

    @wraps(reader)
    def read_with_input_errors(*args: P.args, **kwargs: P.kwargs) -> T:
        try:
            return reader(*args, **kwargs)
        except (Tf.ErrorException, UnicodeDecodeError) as error:
            raise InputError(args[0], "is not a USD file that can be read", "write it again") from error

    return sandboxed(read_with_input_errors)


def write_stage(path: str | Path, stage: Usd.Stage) -> None:
    """Write the stage's root layer to ``path``, replacing it in one step."""
    path = Path(path)
    if path.suffix not in USD_SUFFIXES:
        raise InputError(path, "is not a USD file name", f"end it in {', '.join(USD_SUFFIXES)}")
    with whole_file(path) as unfinished:
        export_root(stage, unfinished)
    trust(path)


def set_time_range(stage: Usd.Stage, frame_numbers: np.ndarray, fps: float) -> None:
    """Set a stage's rate [time codes/s], and its first and last frame of frame numbers (frame,)."""
    stage.SetTimeCodesPerSecond(fps)
    stage.SetFramesPerSecond(fps)
    stage.SetStartTimeCode(float(frame_numbers[0]))
    stage.SetEndTimeCode(float(frame_numbers[-1]))


def export_root(stage: Usd.Stage, file: Path) -> None:
    """Write the stage's root layer to a file; an OSError with the first of USD's complaints, which may be thousands."""
    try:
        stage.GetRootLayer().Export(native_path(file))
    except Tf.ErrorException as error:
        raise OSError(error.args[0].commentary) from error


def valid_names(names: Iterable[str], taken: Sequence[str] = ()) -> dict[str, str]:
    """Names that USD takes, by the names that are given: each another, and none of those ``taken``."""
    valid: dict[str, str] = {}
    for name in names:
        kept = "".join(letter if Sdf.Path.IsValidIdentifier(f"_{letter}") else "_" for letter in name)
        kept = kept if Sdf.Path.IsValidIdentifier(kept) else f"_{kept}"
        while kept in (*taken, *valid.values()):
            kept += "_"
        valid[name] = kept
    return valid


class PrimReader:
    """Reads a prim's attributes while its stage lives, and says what is wrong, naming ``source`` and ``remedy``."""

    def __init__(self, prim: Usd.Prim, source: object, remedy: str) -> None:
        self.prim, self.source = prim, source
        self.remedy = remedy

    def require(self, condition: bool | np.bool_, problem: str) -> None:
        """Raise InputError, naming the prim, unless the condition holds."""
        if not condition:
            raise InputError(self.source, f"{self.prim.GetPath()}: {problem}", self.remedy)

    def child(self, name: str) -> Self:
        """The reader of a child prim, which must exist."""
        prim = self.prim.GetChild(name)
        self.require(prim.IsValid(), f"has no {name}")
        return type(self)(prim, self.source, self.remedy)

    def value(self, name: str) -> Any:
        """An attribute's value, which must exist."""
        value = self.prim.GetAttribute(name).Get() if self.prim.HasAttribute(name) else None
        self.require(value is not None, f"attribute {name} is missing or empty")
        return value

    def typed(self, name: str, kind: type[K], unsaid: K | None = None) -> K:
        """An attribute's value, which must be of a Python type, as any file may call it something else.

        It must exist, unless there is a value for one that is ``unsaid``.
        """
        if unsaid is not None and not self.prim.HasAttribute(name):
            return unsaid
        value = self.value(name)
        self.require(type(value) is kind, f"attribute {name} is of type {type(value).__name__}, not {kind.__name__}")
        return value

    def texts(self, name: str, *, optional: bool = False) -> list[str]:
        """An attribute that is a list of texts, which must exist unless it is ``optional``; then it may be empty."""
        if optional and not self.prim.HasAttribute(name):
            return []
        value = self.value(name)
        self.require(isinstance(value, Vt.StringArray | Vt.TokenArray), f"attribute {name} is no list of texts")
        return [str(text) for text in value]

    def json_object(self, name: str) -> dict[str, Any]:
        """An attribute that holds a JSON object as text, which must exist."""
        text = self.typed(name, str)
        try:
            value = json.loads(text)
        except (ValueError, RecursionError):
            value = None
        self.require(isinstance(value, dict), f"{name} is not a JSON object")
        return value

    def samples(self, name: str, times: Sequence[float]) -> list[Any]:
        """An attribute's values at time codes. Each must have been authored: nothing is interpolated."""
        attribute = self.prim.GetAttribute(name)
        authored = set(attribute.GetTimeSamples()) if attribute else set()
        values = [attribute.Get(time) if time in authored else None for time in times]
        absent = [time for time, value in zip(times, values, strict=True) if value is None]  # a value may be blocked
        self.require(not absent, f"attribute {name} has no value at frame {absent[0] if absent else 0:g}")
        return values

    def sampled_array(self, name: str, times: Sequence[float], shape: tuple[int, ...] | None = None) -> np.ndarray:
        """A numeric attribute at time codes, (time, *shape), as many as at the first; NaN may stand for "no value"."""
        rows = [np.array(value) for value in self.samples(name, times)]
        shape = shape or np.shape(rows[0] if rows else ())
        for time, row in zip(times, rows, strict=True):
            self.require(row.size == np.prod(shape), f"{name} holds {row.size} values at frame {time:g}, not {shape}")
        return np.array(rows).reshape(len(times), *shape)

    def array(self, name: str, shape: tuple[int | None, ...], dtype: type = np.float32) -> np.ndarray:
        """An array attribute as ``dtype``; in ``shape``, None stands for any length."""
        raw = np.array(self.value(name))
        if raw.size == 0:  # An empty array has lost its inner shape.
            raw = raw.reshape([0 if n is None else n for n in shape] if 0 in shape or None in shape else [0])
        fits = raw.ndim == len(shape) and all(n in (None, have) for n, have in zip(shape, raw.shape, strict=True))
        wanted = " x ".join("any" if n is None else str(n) for n in shape)
        self.require(fits, f"{name} has shape {raw.shape}, expected {wanted}")
        self.require(raw.dtype.kind in "biuf", f"{name} holds no numbers")
        self.require(not np.isnan(raw).any(), f"{name} holds NaN")
        return raw.astype(dtype)


ALLOWED = "MMOCAP_ALLOW_REFERENCES"
"""The environment's variable that lets references pass wherever they lead: ``1`` for yes."""


def check_references(layer: Sdf.Layer, path: Path) -> None:
    """See that a layer, and the layers that it names, refer to files of its own folder only.

    Composing a stage opens sublayers, references, payloads, clips and assets wherever they lie: a file from a stranger
    could read any other file. Therefore names are checked before a stage is composed. ``layer`` was read from ``path``
    as an anonymous one; what it names relative to its file is made absolute. Raises an InputError for a file elsewhere,
    or one that is named by an expression, unless ``ALLOWED`` says yes.
    """
    names = _absolute_names(layer, path)
    if names and os.environ.get(ALLOWED, "0") in ("", "0"):
        _check_names(names, path, path.resolve().parent, {path.resolve()})


def _check_names(names: list[str], source: Path, folder: Path, seen: set[Path]) -> None:
    for name in names:
        target = Path(os.path.realpath(name.split("[", 1)[0]))  # of a package's member, the package
        if "`" in name or not target.is_relative_to(folder):
            remedy = "put that file beside it, or give --allow-references if you trust both"
            raise InputError(source, f"refers to {name}, which is not in its folder", remedy)
        if target in seen or not target.is_file():
            continue
        seen.add(target)
        is_layer = Sdf.FileFormat.FindByExtension(target.suffix)  # and not, say, a picture
        layer = Sdf.Layer.OpenAsAnonymous(str(target)) if is_layer else None
        if layer:
            _check_names(_absolute_names(layer, target), target, folder, seen)


def _absolute_names(layer: Sdf.Layer, path: Path) -> list[str]:
    """The names of all other files in a layer, which are made absolute there."""
    names: list[str] = []
    if layer.GetFileFormat().IsPackage():  # which cannot be changed; what it packs is named as if it lay beside it
        layer, packed = Sdf.Layer.CreateAnonymous(), layer
        layer.TransferContent(packed)

    def absolute(name: str) -> str:
        names.append(os.path.join(path.resolve().parent, name))
        return names[-1]

    def find_clips(path: Sdf.Path) -> None:
        prim = layer.GetPrimAtPath(path) if path.IsPrimPath() or path.IsPrimVariantSelectionPath() else None
        if prim and prim.HasInfo("clips") and "`" in str(prim.GetInfo("clips")):
            names.append(f"`...` in the clips of {path}")

    UsdUtils.ModifyAssetPaths(layer, absolute)
    # Names that are expressions are left out there.
    names += (name for name in layer.GetCompositionAssetDependencies() if "`" in name)
    layer.Traverse(Sdf.Path.absoluteRootPath, find_clips)
    return names


def author(
    prim: Usd.Prim, name: str, value: Any, time: float | None = None, kind: Sdf.ValueTypeName | None = None
) -> None:
    """Set a custom attribute, which varies in time where a ``time`` is given.

    Its type is ``kind``, or follows from the value: text, truth, number, list of texts, or array (flattened).
    """
    kind, usd_value = _usd_value(value) if kind is None else (kind, value)
    variability = Sdf.VariabilityUniform if time is None else Sdf.VariabilityVarying
    code = Usd.TimeCode.Default() if time is None else Usd.TimeCode(time)
    prim.CreateAttribute(name, kind, True, variability).Set(usd_value, code)


def _usd_value(value: Any) -> tuple[Sdf.ValueTypeName, Any]:
    types = Sdf.ValueTypeNames
    for kind, usd_type in ((str, types.String), (bool, types.Bool), (int, types.Int64), (float, types.Double)):
        if isinstance(value, kind):
            return usd_type, value
    if isinstance(value, np.ndarray) and value.dtype.kind == "f":
        return types.DoubleArray, Vt.DoubleArray.FromNumpy(np.ascontiguousarray(value, np.float64).ravel())
    if isinstance(value, np.ndarray) and value.dtype.kind in "iu":
        return types.Int64Array, Vt.Int64Array.FromNumpy(np.ascontiguousarray(value, np.int64).ravel())
    if isinstance(value, list | tuple) and all(isinstance(item, str) for item in value):
        return types.StringArray, Vt.StringArray(list(value))
    raise ValueError(f"no USD attribute type for {value!r}")


def stage_up(up: str) -> str:
    """The vertical of a stage whose contents have the signed axis ``up``: the same where it is +y or +z, else +z."""
    return up if up in ("+y", "+z") else "+z"


def set_world_up(stage: Usd.Stage, world: UsdGeom.Xformable, up: str) -> None:
    """Set the stage's metres and up axis, and turn ``world`` where that is needed to show its contents upright.

    ``world`` is the prim above everything in the cameras' world, whose signed axis ``up`` points up.
    """
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, stage_up(up)[1].upper())
    if up != stage_up(up):
        turn = np.eye(4)
        turn[:3, :3] = quarter_turn(up, stage_up(up))
        world.AddTransformOp().Set(Gf.Matrix4d(turn.T))  # which acts on row vectors
