"""USD files and attributes: read with plain errors, written whole or not at all."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numpy as np
from pxr import Sdf, Tf, Usd, Vt

from mmocap_warp.errors import InputError
from mmocap_warp.formats.tried_first import tried_first, trust
from mmocap_warp.formats.usd.references import check_references
from mmocap_warp.whole_file import whole_file

P = ParamSpec("P")
T = TypeVar("T")
K = TypeVar("K")

USD_SUFFIXES: tuple[str, ...] = (".usd", ".usda", ".usdc")


def read_stage(path: str | Path) -> Usd.Stage:
    """Open a USD file; a file rewritten since it was last read in this process is read anew.

    Raises:
        InputError: no such file, not USD, or one that refers to files outside its folder.
    """
    path = Path(path)
    if not os.path.isfile(path):
        raise InputError(path, "no such file", "check the path")
    with usd_errors_told(path):
        # USD keeps layers by file name and would hand out the old one; an anonymous layer has no name.
        layer = Sdf.Layer.OpenAsAnonymous(str(path))
        if layer:
            check_references(layer, path)
        stage = Usd.Stage.Open(layer) if layer else None
    if stage is None:
        raise InputError(path, "is not a USD file", f"give a file that ends in {', '.join(USD_SUFFIXES)}")
    return stage


def reads_usd(reader: Callable[P, T]) -> Callable[P, T]:
    """What reads a USD file, whose path is its first argument, from :func:`read_stage` to the last value.

    USD reads values when they are asked for, and only then finds damage. A file that this process did not write is read
    in another process first, see :func:`~mmocap_warp.formats.tried_first.tried_first`.
    """

    @wraps(reader)
    def told(*args: P.args, **kwargs: P.kwargs) -> T:
        with usd_errors_told(args[0]):
            return reader(*args, **kwargs)

    return tried_first(told)


@contextmanager
def usd_errors_told(path: object) -> Iterator[None]:
    """Raise ``InputError`` for what USD complains of while a file is read, to the last value."""
    try:
        yield
    except (Tf.ErrorException, UnicodeDecodeError) as error:
        raise InputError(path, "is not a USD file that can be read", "write it again") from error


def write_stage(path: str | Path, stage: Usd.Stage) -> None:
    """Write the stage's root layer to ``path``, replacing it in one step.

    Raises:
        InputError: the name does not end in ``.usd``, ``.usda`` or ``.usdc``, or the folder cannot be written.
    """
    path = Path(path)
    if path.suffix not in USD_SUFFIXES:
        raise InputError(path, "is not a USD file name", f"end it in {', '.join(USD_SUFFIXES)}")
    with whole_file(path) as unfinished:
        export_root(stage, unfinished)
    trust(path)


def export_root(stage: Usd.Stage, file: Path) -> None:
    """Write the stage's root layer to a file.

    Raises:
        OSError: with the first of what USD complains of; after a full disk that is thousands of lines.
    """
    try:
        stage.GetRootLayer().Export(str(file))
    except Tf.ErrorException as error:
        raise OSError(error.args[0].commentary) from error


def author(schema: Usd.SchemaBase, name: str, kind: Sdf.ValueTypeName, value: object) -> None:
    """Author a custom attribute that does not vary in time."""
    schema.GetPrim().CreateAttribute(name, kind, True, Sdf.VariabilityUniform).Set(value)


class PrimReader:
    """Reads one prim's attributes and says what is wrong with them.

    Args:
        prim: the prim; its stage must stay alive.
        source: the file, for errors.
        remedy: what to do about a file that is wrong, for errors.
    """

    def __init__(self, prim: Usd.Prim, source: object, remedy: str) -> None:
        self.prim = prim
        self.source = source
        self.remedy = remedy

    def require(self, condition: bool | np.bool_, problem: str) -> None:
        """Raise InputError, naming the prim, unless the condition holds."""
        if not condition:
            raise InputError(self.source, f"{self.prim.GetPath()}: {problem}", self.remedy)

    def child(self, name: str) -> PrimReader:
        """The reader of a child prim, which must exist."""
        prim = self.prim.GetChild(name)
        self.require(prim.IsValid(), f"has no {name}")
        return PrimReader(prim, self.source, self.remedy)

    def value(self, name: str) -> Any:
        """An attribute's value, which must exist."""
        value = self.prim.GetAttribute(name).Get() if self.prim.HasAttribute(name) else None
        self.require(value is not None, f"attribute {name} is missing or empty")
        return value

    def typed(self, name: str, kind: type[K]) -> K:
        """An attribute's value, which must exist and be of a Python type; any file may call it something else."""
        value = self.value(name)
        self.require(type(value) is kind, f"attribute {name} is of type {type(value).__name__}, not {kind.__name__}")
        return value

    def flag(self, name: str, unsaid: bool = False) -> bool:
        """An attribute that is true or false, ``unsaid`` where there is none."""
        return self.typed(name, bool) if self.prim.HasAttribute(name) else unsaid

    def texts(self, name: str) -> list[str]:
        """An attribute that is a list of texts, which must exist."""
        value = self.value(name)
        self.require(isinstance(value, Vt.StringArray | Vt.TokenArray), f"attribute {name} is no list of texts")
        return [str(text) for text in value]

    def json_object(self, name: str) -> dict[str, Any]:
        """An attribute that holds a JSON object as text, which must exist."""
        try:
            value = json.loads(self.typed(name, str))
        except InputError:
            raise
        except (ValueError, RecursionError):
            value = None
        self.require(isinstance(value, dict), f"{name} is not a JSON object")
        return value

    def samples(self, name: str, times: Sequence[float]) -> list[Any]:
        """An attribute's values at time codes, each of which must have been authored: nothing is interpolated."""
        attribute = self.prim.GetAttribute(name)
        authored = set(attribute.GetTimeSamples()) if attribute else set()
        absent = [time for time in times if time not in authored]
        self.require(not absent, f"attribute {name} has no value at frame {absent[0] if absent else 0:g}")
        return [attribute.Get(time) for time in times]

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
