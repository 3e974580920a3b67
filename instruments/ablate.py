"""Ablations: every combination of clips, degradations of them and trackers, with one file for each.

    python instruments/ablate.py FOLDER --clip tuning --degrade views=3 --tracker h-cmaes,evaluations=300

A cell is one tracker with one seed on one clip made worse in one way. Its file is named by a hash of all that it
depends on, so that a run that was interrupted, or has cells added, tracks what is missing and nothing else.
``FOLDER/ablation.csv`` has a line for each cell. README.md here says what its columns are.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import io
import json
import os
import re
import socket
import sys
import tomllib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from functools import cache
from itertools import groupby
from pathlib import Path
from statistics import fmean
from typing import Any

from mmocap_warp.body.model import Subject
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.cli.console import BAD_INPUT, OK, table
from mmocap_warp.code_hash import code_hash
from mmocap_warp.commands.caller import start_warp
from mmocap_warp.commands.outputs import lock, release_locks
from mmocap_warp.device.resolve import device_kind
from mmocap_warp.errors import InputError
from mmocap_warp.fitting.clip_body import frames_to_follow
from mmocap_warp.fitting.subject_fit import FitConfig, fit_clip
from mmocap_warp.formats.toml_table import Table, config_from_table
from mmocap_warp.masks.observation import Observation
from mmocap_warp.result.evaluation import evaluate
from mmocap_warp.result.pose_errors import LOST_LIMB, common_frames, farthest
from mmocap_warp.result.result import Result
from mmocap_warp.result.truth import Truth, at_rate
from mmocap_warp.rigging.shipped import DEFAULT_BODY, load_body
from mmocap_warp.study.degradations import NONE, degraded, parse
from mmocap_warp.study.job import solved_subject
from mmocap_warp.study.sequences import CLIP_PLANS, PLANS
from mmocap_warp.study.source import Clip, OpenClip, clip_facts, open_clip
from mmocap_warp.study.store import open_folder
from mmocap_warp.tracking.frame_loop import track_observations
from mmocap_warp.tracking.track_config import TrackConfig
from mmocap_warp.version import __version__
from mmocap_warp.whole_file import write_whole

TUNING: tuple[str, ...] = (*tuple(PLANS)[1::2], "S2/Spin")
"""Clips to choose settings on: of the nine sequences those of even number, and a spin."""

REPORTING: tuple[str, ...] = tuple(name for name in CLIP_PLANS if name not in TUNING)
"""Clips whose figures are reported, and on which nothing is chosen."""

STARTS: tuple[str, ...] = ("given", "solved", "first-frame", "fitted")
"""Where body and first pose come from: the clip's own subject; its pose with the body solved from the clip; or a fit of
both to the degraded masks, of the first frame alone or of the clip."""

_MODULES = ("fitting.clip_body", "fitting.subject_fit", "result.evaluation", "study.degradations", "study.job")
"""Where the package's part in a cell begins."""
_VERSION = 2  # of the measures; results of another version are made again
_KEY_DIGITS = 20
_COMMON_SETTINGS = {"seed": "seeds", "runs": "seeds", "scale": "scale", "device": "device", "threads": "threads"}
"""Settings that are the same for all trackers, and the flags that set them."""
_ROW = ("clip", "purpose", "degradation", "start", "tracker")  # what a line of the table is about
_OF_SEEDS: dict[str, Callable[[list[float]], float]] = {"mean": fmean, "min": min, "max": max}
_COLUMNS = {  # title, format, and which of the seeds' values is shown
    "marker_error_mm": ("marker", ".1f", "mean"),
    "mpjpe_mm": ("MPJPE", ".1f", "mean"),
    "shake_mm": ("shake", ".1f", "mean"),
    "growth": ("growth", ".2f", "mean"),
    "mean_iou": ("IoU", ".3f", "mean"),
    "worst_iou": ("worst", ".3f", "min"),
    "wrongly_tracked": ("wrong", ".0f", "max"),
    "off_frames": ("off", ".0f", "max"),
    "longest_off": ("in a row", ".0f", "max"),
    "near_tracked": ("near", ".2f", "min"),
    "ms_per_frame": ("ms", ".0f", "min"),
}
_FROM_EVALUATION = (
    "marker_error_mm", "mpjpe_mm", "shake_mm", "growth", "mean_iou", "worst_iou", "wrongly_tracked", "near_tracked",
    "lost", "partial", "rescued", "interpolated",
)  # fmt: skip

Track = Callable[[Subject, CameraRig, Iterable[Observation], float, TrackConfig, int], Result]
"""From a subject, undistorted cameras, the frames' masks, frames per second, settings and a seed."""


def track_with_seed(
    subject: Subject, rig: CameraRig, observations: Iterable[Observation], fps: float, settings: TrackConfig, seed: int
) -> Result:
    """One run of the tracker that the settings name."""
    return track_observations(subject, rig, observations, fps, replace(settings, seed=seed, runs=1))


@cache
def _code() -> str:
    """A hash of the code that a cell comes from: this file's and the package's."""
    parts = [Path(__file__).read_text("utf-8"), *map(code_hash, _MODULES)]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


@dataclass(frozen=True)
class AblationCell:
    """One point of an ablation."""

    clip: Clip  # it is tracked
    degradation: str  # as :mod:`mmocap_warp.study.degradations` writes it
    label: str  # the tracker's name in tables
    settings: TrackConfig  # the tracker's; their seed and runs do not count
    seed: int  # of the tracker, of the fit, and of the degradation where that is random
    start: str = "given"  # one of ``STARTS``

    def __post_init__(self) -> None:
        if self.start not in STARTS:
            raise ValueError(f"start must be one of {list(STARTS)}, got {self.start!r}")

    def __str__(self) -> str:
        return f"{self.clip.name} {self.degradation} {self.start} {self.label} seed {self.seed}"


def purpose(clip: Clip) -> str:
    """``tuning`` or ``reporting``; of a clip that is not made by name, unknown: an empty string."""
    return "tuning" if clip.name in TUNING else "reporting" if clip.name in REPORTING else ""


def run_ablation(
    folder: Path, cells: Sequence[AblationCell], report: Callable[[AblationCell, dict], None], track: Track
) -> list[dict[str, Any]]:
    """Track the cells whose file is missing in a folder that exists, and read the others.

    Cells of one clip that follow each other share its masks in memory. ``report`` is called with each cell and what
    :func:`measures` gave. Of each cell a file's content is returned: ``cell``, ``settings``, ``measures`` and ``made``.

    Raises:
        InputError: a clip that cannot be opened, a folder that cannot be written to.
        ValueError: a degradation that means nothing to a clip; masks that show nobody to start from.
    """
    rows = []
    for clip, of_clip in groupby(cells, key=lambda cell: cell.clip):
        identity = clip_facts(clip).identity
        takes = _Takes(clip)
        for cell in of_clip:
            path = _path(folder, cell, identity)
            if not path.exists():
                row = _tracked(cell, takes.of(cell), track)
                write_whole(path, json.dumps(row, indent=1, allow_nan=False).encode())
            rows.append(json.loads(path.read_bytes()))
            report(cell, rows[-1]["measures"])
    return rows


def measures(result: Result, truth: Truth | None) -> dict[str, float | None]:
    """The numbers of a result of one run; None where nothing defines them.

    Those of :func:`mmocap_warp.result.evaluation.evaluate` have its names. ``off_frames`` are frames with a limb's end
    or the root over 200 mm off, whatever their status says, ``longest_off`` the most of these in a row.
    """
    report = evaluate(result, truth)
    known: dict[str, float | None] = {name: report.get(name) for name in _FROM_EVALUATION}
    known |= {"off_frames": None, "longest_off": None, "ms_per_frame": 1000.0 * result.seconds / report["frames"]}
    if truth is not None:
        truth = at_rate(truth, result.fps)
        (off,) = farthest(result, truth, *common_frames(result, truth), result.joints()) > LOST_LIMB
        in_a_row = [len(list(run)) for is_off, run in groupby(off) if is_off]
        known |= {"off_frames": sum(in_a_row), "longest_off": max(in_a_row, default=0)}
    return known


class _Takes:
    """A clip's masks, made or read once, and the last degradation of them with the subjects that started from it."""

    def __init__(self, clip: Clip) -> None:
        self._clip, self._whole = clip, cache(lambda: _in_memory(open_clip(clip)))
        self._last: tuple[tuple[str, int], OpenClip, list[Observation]] | None = None
        self._started: dict[tuple[str, int], Subject] = {}

    def of(self, cell: AblationCell) -> OpenClip:
        which = cell.degradation, cell.seed if "calibration" in parse(cell.degradation) else 0  # it alone is random
        if self._last is None or self._last[0] != which:
            whole, masks = self._whole()
            self._last = None  # one in memory at a time
            self._last = which, *_in_memory(degraded(replace(whole, observations=iter(masks)), *which))
            self._started.clear()
        _, take, masks = self._last
        key = cell.start, cell.seed
        if key not in self._started:
            self._started[key] = _subject(cell, take, masks)
        return replace(take, subject=self._started[key], observations=iter(masks))


def _in_memory(clip: OpenClip) -> tuple[OpenClip, list[Observation]]:
    return clip, list(clip.observations)


def _subject(cell: AblationCell, take: OpenClip, masks: list[Observation]) -> Subject:
    """Body and first pose that a cell starts from."""
    if cell.start == "given":
        return take.subject
    if cell.start == "solved":
        return solved_subject(take, masks, cell.seed, cell.settings.device, cell.settings.threads)
    config = FitConfig(cell.seed, device=cell.settings.device, threads=cell.settings.threads)
    generic = load_body(DEFAULT_BODY)
    if cell.start == "first-frame":
        return fit_clip(generic, take.rig, take.fps, masks[:1], config)
    numbers = frames_to_follow(take.fps, take.frames)
    return fit_clip(generic, take.rig, take.fps / numbers.step, [masks[number] for number in numbers], config)


def _tracked(cell: AblationCell, take: OpenClip, track: Track) -> dict[str, Any]:
    started = datetime.now(UTC).isoformat(timespec="seconds")
    result = track(take.subject, take.rig, take.observations, take.fps, cell.settings, cell.seed)
    clip, code = cell.clip, _code()
    about: dict[str, Any] = {
        "clip": clip.name,
        "purpose": purpose(clip),
        "degradation": cell.degradation,
        "start": cell.start,
    }
    about |= {"tracker": cell.label, "seed": cell.seed, "frames": take.frames, "scale": clip.scale}
    made = {"started": started, "host": socket.gethostname(), "versions": result.versions, "code": code}
    return {"cell": about, "settings": result.config, "measures": measures(result, take.truth), "made": made}


def _path(folder: Path, cell: AblationCell, identity: str) -> Path:
    """Where a cell's file lies: a name for people, then a hash of all that it depends on."""
    settings = asdict(replace(cell.settings, seed=cell.seed, runs=1))
    kind, _ = device_kind(settings.pop("device")), settings.pop("threads")
    depends: dict[str, Any] = {
        "clip": identity,
        "degradation": cell.degradation,
        "start": cell.start,
        "settings": settings,
    }
    depends |= {"device": kind, "code": _code(), "package": __version__, "version": _VERSION}
    key = hashlib.sha256(json.dumps(depends, sort_keys=True).encode()).hexdigest()[:_KEY_DIGITS]
    name = f"{cell.clip.name}-{cell.degradation}-{cell.start}-{cell.label}-{cell.seed}"
    return folder / f"{re.sub(r'[^A-Za-z0-9.=+-]+', '_', name)}.{key}.json"


def clips_named(names: Sequence[str], frames: int | None, scale: float, subject: Path | None) -> list[Clip]:
    """The clips of names, of scene files and of groups.

    Raises:
        ValueError: a name that is none of these.
    """
    groups = {"tuning": TUNING, "reporting": REPORTING}
    clips = []
    for name in dict.fromkeys(each for text in names for each in groups.get(text, (text,))):
        if name in CLIP_PLANS:
            clips.append(Clip(name, None, frames, scale, subject))
        elif name.endswith(".toml"):
            path = Path(name)
            clips.append(Clip(path.resolve().parent.name, path, frames, scale, subject))
        else:
            raise ValueError(f"--clip {name} is no scene.toml and not one of {', '.join((*groups, *CLIP_PLANS))}")
    return clips


def tracker_settings(text: str, scale: float, device: str, threads: int | None) -> TrackConfig:
    """``h-cmaes,evaluations=300,cost=iou`` as settings; values are read as in a scene file, words need no quotes.

    Raises:
        ValueError: no such algorithm or setting, or one that holds for all trackers.
    """
    algorithm, *pairs = text.split(",")
    values: dict[str, Any] = {"algorithm": algorithm}
    for pair in pairs:
        name, _, value = pair.partition("=")
        if name in _COMMON_SETTINGS:
            raise ValueError(f"--tracker {text}: {name} holds for all trackers; use --{_COMMON_SETTINGS[name]}")
        try:
            values[name] = tomllib.loads(f"value = {value}")["value"]
        except tomllib.TOMLDecodeError:
            values[name] = value
    try:
        config = config_from_table(TrackConfig, Table(values, "--tracker", text))
        return replace(config, scale=scale, device=device, threads=threads)
    except (InputError, ValueError) as error:
        raise ValueError(f"--tracker {text}: {error}") from None


def seeds_table(rows: list[dict[str, Any]]) -> str:
    """A line per clip, degradation and tracker, over the seeds."""
    groups: dict[tuple[str, ...], list[dict[str, Any]]] = {}
    for row in rows:
        groups.setdefault(tuple(row["cell"][name] for name in _ROW), []).append(row["measures"])
    lines = [("clip", "for", "degradation", "start", "tracker", "seeds", *(title for title, *_ in _COLUMNS.values()))]
    for key, seeds in groups.items():
        known = {name: [one[name] for one in seeds if one[name] is not None] for name in _COLUMNS}
        shown = ((known[name], kind, how) for name, (_, kind, how) in _COLUMNS.items())
        values = [format(_OF_SEEDS[how](each), kind) if each else "-" for each, kind, how in shown]
        lines.append((*key, str(len(seeds)), *values))
    return table(lines, left=len(_ROW))


def cells_table(rows: list[dict[str, Any]]) -> str:
    """A line for each cell, for spreadsheets."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*rows[0]["cell"], *rows[0]["measures"]])
    writer.writerows([*row["cell"].values(), *row["measures"].values()] for row in rows)
    return text.getvalue()


def at_least_one(text: str) -> int:
    """A number of seeds or frames."""
    if int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be at least 1, got {text}")
    return int(text)


def arguments_of(given: Sequence[str] | None) -> tuple[argparse.ArgumentParser, argparse.Namespace]:
    """The parser, whose ``error`` ends the program, and what it has read."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="a JSON file for each cell, and ablation.csv")
    several: dict[str, Any] = {"action": "append", "default": []}
    parser.add_argument("--clip", **several, help="a name, a scene.toml, or 'tuning' (the default) or 'reporting'")
    parser.add_argument("--degrade", **several, help="as for 'mmocap study make'; the default is none")
    parser.add_argument("--start", **several, choices=STARTS, help="where body and first pose come from; given")
    parser.add_argument("--tracker", **several, help="an algorithm and settings of 'mmocap track'; h-cmaes")
    parser.add_argument("--seeds", type=at_least_one, default=3, help="how many, from 0 on")
    parser.add_argument("--frames", type=at_least_one, help="at most so many of each clip")
    parser.add_argument("--scale", type=float, default=1.0, help="of masks and cameras; shipped sequences have 1")
    parser.add_argument("--subject", type=Path, help="the file of the subject to start from, not the clip's own")
    parser.add_argument("--device", default="auto")
    parser.add_argument("--threads", type=int)
    parser.add_argument("--json", action="store_true", help="print every cell as JSON")
    parser.add_argument("--quiet", action="store_true", help="print no line for a cell that is done")
    return parser, parser.parse_args(given)


def main(arguments: Sequence[str] | None = None) -> int:
    """Track what is missing, and print all."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    parser, given = arguments_of(arguments)
    try:
        ways = tuple(dict.fromkeys(given.degrade or (NONE,)))
        for way in ways:
            parse(way)
        trackers = given.tracker or ("h-cmaes",)
        settings = {text: tracker_settings(text, given.scale, given.device, given.threads) for text in trackers}
        clips = clips_named(given.clip or ("tuning",), given.frames, given.scale, given.subject)
        start_warp(given.device)
        cells = [  # those of one clip follow each other
            AblationCell(clip, way, text, config, seed, start)
            for clip in clips
            for way in ways
            for seed in range(given.seeds)
            for start in dict.fromkeys(given.start or STARTS[:1])
            for text, config in settings.items()
        ]
        done = 0

        def report(cell: AblationCell, measured: dict[str, Any]) -> None:
            nonlocal done
            done += 1
            known = {name: value for name, value in measured.items() if name in _COLUMNS and value is not None}
            shown = [f"{title} {known[name]:{kind}}" for name, (title, kind, _) in _COLUMNS.items() if name in known]
            if not given.quiet:
                print(f"{done} of {len(cells)}: {cell}: {', '.join(shown)}", file=sys.stderr, flush=True)

        open_folder(given.folder)
        lock(given.folder)
        rows = run_ablation(given.folder, cells, report, track_with_seed)
        write_whole(given.folder / "ablation.csv", cells_table(rows).encode())
    except InputError as error:
        print(error, file=sys.stderr)
        return BAD_INPUT
    except ValueError as error:  # such as more views than a clip has, or no such model of its body
        parser.error(str(error))
    finally:
        release_locks()
    print(json.dumps({"folder": str(given.folder), "cells": rows}, indent=2) if given.json else seeds_table(rows))
    return OK


if __name__ == "__main__":
    sys.exit(main())
