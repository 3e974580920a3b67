"""A cell of the study's grid and its result, and the result as one file."""

import io
import json
import struct
import tokenize
import zipfile
import zlib
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mmocap_warp.errors import InputError
from mmocap_warp.whole_file import write_whole

# The parts of ``meta`` that say where and when a result was made: with the seconds, all that a repetition changes.
_PROVENANCE = ("study", "host", "started", "wall_seconds", "versions", "code", "code_covers", "clip")
PROVENANCE_FILE = "provenance.json"
"""The member of a result's file that holds these."""

_VERSION = 1
_ANSWER = "cell.json"
_EPOCH = (1980, 1, 1, 0, 0, 0)  # the date of all members, so that equal results are equal bytes
_MOST_BYTES = 2**30  # largest size of a result's members together; a study's have about 2**20
_DAMAGE = (
    OSError, ValueError, KeyError, TypeError, EOFError, NotImplementedError, RuntimeError, AttributeError,
    MemoryError, OverflowError, zipfile.BadZipFile, zlib.error, struct.error, tokenize.TokenError,
)  # fmt: skip


@dataclass(frozen=True, order=True)
class Cell:
    """One point of the grid; all seeds are tracked in it at once."""

    sequence: str  # what is tracked, such as ``S1/Walking``
    # One of ``mmocap_warp.tracking.algorithms``, with ``+polish`` where its frames are finished by contours, and
    # ``+solved`` where the body is solved from the clip
    algorithm: str
    dof: int  # degrees of freedom of the tracked body
    evaluations: int  # budget of a frame's search, 0 where nothing is searched
    preset: str = "recording"  # where the radii come from, a key of ``mmocap_warp.tracking.algorithms.PRESETS``

    def __str__(self) -> str:
        return f"{self.sequence} {self.algorithm} {self.dof} DOF {self.evaluations} evaluations {self.preset}"


@dataclass(frozen=True)
class CellResult:
    """What tracking a cell gave; a ValueError for arrays whose shapes disagree."""

    cell: Cell
    seeds: np.ndarray  # (run,) int64
    frames: np.ndarray  # (frame,) int64, the sequence's own frame numbers
    per_frame: dict[str, np.ndarray]  # (run, frame) float32 by name: see :func:`mmocap_warp.study.metrics.measure`
    per_run: dict[str, np.ndarray]  # (run,) float64 by name: see there
    # (run, frame, coordinate) float32; or (1, frame, coordinate), the poses of the typical run alone, see
    # :func:`mmocap_warp.study.summary.with_typical_pose`
    pose: np.ndarray
    # JSON values: ``fps``, ``cameras``, ``size``, ``config``, ``versions``, ``device``, ``host``, ``started``,
    # ``wall_seconds``, ``study``, ``clip`` (its identity), ``code`` and ``code_covers`` (see ``mmocap_warp.code_hash``)
    meta: dict[str, Any]

    def __post_init__(self) -> None:
        runs, frames = len(self.seeds), len(self.frames)
        posed = 1 if len(self.pose) == 1 else runs
        shapes: dict[str, tuple[np.ndarray, tuple[int, ...]]] = {"pose": (self.pose[..., 0], (posed, frames))}
        shapes |= {name: (array, (runs, frames)) for name, array in self.per_frame.items()}
        shapes |= {name: (array, (runs,)) for name, array in self.per_run.items()}
        for name, (array, shape) in shapes.items():
            if array.shape != shape:
                raise ValueError(f"{name} must be {shape}, got {array.shape}")


def write_cell(path: Path, result: CellResult) -> None:
    """Write a result as one ``.npz`` file, whole or not at all.

    Two results of the same search differ only in the member ``provenance.json``: the time it took and where it was.
    Raises an InputError for a folder that cannot be written to, or a full disk.
    """
    measured = {name: result.meta[name] for name in _PROVENANCE if name in result.meta}
    known = {name: value for name, value in result.meta.items() if name not in _PROVENANCE}
    per_run = dict(result.per_run)
    if "seconds" in per_run:
        measured["seconds"] = per_run.pop("seconds").tolist()
    arrays = {"seeds": (result.seeds, np.int64), "frames": (result.frames, np.int64), "pose": (result.pose, np.float32)}
    arrays |= {f"per_frame.{name}": (array, np.float32) for name, array in result.per_frame.items()}
    arrays |= {f"per_run.{name}": (array, np.float64) for name, array in per_run.items()}
    members = {_ANSWER: _json({"version": _VERSION, "cell": asdict(result.cell), "meta": known})}
    members |= {f"{name}.npy": _npy(np.asarray(array, kind)) for name, (array, kind) in arrays.items()}
    members[PROVENANCE_FILE] = _json(measured)
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as file:
        for name, data in members.items():
            file.writestr(zipfile.ZipInfo(name, _EPOCH), data, zipfile.ZIP_DEFLATED)
    write_whole(path, content.getvalue())


def read_cell(path: Path) -> CellResult:
    """Read a result and check its checksums; an InputError if it is missing, damaged, cut short or none of a cell."""
    try:
        with zipfile.ZipFile(path) as file:
            if sum(member.file_size for member in file.infolist()) > _MOST_BYTES:
                raise ValueError("its members are too large")
            members = {name: file.read(name) for name in file.namelist()}
        return _assemble(members)
    except FileNotFoundError:
        raise InputError(path, "no such file", "run the study again") from None
    except _DAMAGE as error:
        remedy = "delete it and run the study again, which repeats this cell alone"
        raise InputError(path, f"is damaged, or no result of a cell ({error})", remedy) from None


def _assemble(members: dict[str, bytes]) -> CellResult:
    answer, measured = json.loads(members[_ANSWER]), json.loads(members[PROVENANCE_FILE])
    if answer["version"] != _VERSION:
        raise ValueError(f"version {answer['version']}, this program reads {_VERSION}")
    arrays = {
        name.removesuffix(".npy"): np.lib.format.read_array(io.BytesIO(data), allow_pickle=False)
        for name, data in members.items()
        if name.endswith(".npy")
    }
    per_frame, per_run = (
        {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}
        for prefix in ("per_frame.", "per_run.")
    )
    if (seconds := measured.pop("seconds", None)) is not None:
        per_run["seconds"] = np.array(seconds, np.float64)
    known, meta = (arrays["seeds"], arrays["frames"], per_frame, per_run, arrays["pose"]), answer["meta"] | measured
    return CellResult(Cell(**answer["cell"]), *known, meta)


def _json(value: Any) -> bytes:
    return json.dumps(value, sort_keys=True, allow_nan=False).encode()


def _npy(array: np.ndarray) -> bytes:
    content = io.BytesIO()
    np.lib.format.write_array(content, np.ascontiguousarray(array), allow_pickle=False)
    return content.getvalue()
