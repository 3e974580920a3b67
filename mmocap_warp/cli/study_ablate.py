"""``mmocap study ablate``: clips, degradations and trackers in every combination."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from dataclasses import replace
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from mmocap_warp.cli.console import Console
from mmocap_warp.errors import UsageError

if TYPE_CHECKING:
    from mmocap_warp.study.source import Clip
    from mmocap_warp.tracking.track_config import TrackConfig

Several = Annotated[tuple[str, ...], Parameter(negative="", show_default=False)]


def _mean(values: list[float]) -> float:
    return sum(values) / len(values)


_COLUMNS: dict[str, tuple[str, str, Callable[[list[float]], float]]] = {  # title, how it is shown, over seeds
    "marker_error_mm": ("marker", ".1f", _mean),
    "mpjpe_mm": ("MPJPE", ".1f", _mean),
    "shake_mm": ("shake", ".1f", _mean),
    "growth": ("growth", ".2f", _mean),
    "mean_iou": ("IoU", ".3f", _mean),
    "worst_iou": ("worst", ".3f", min),
    "wrongly_tracked": ("wrong", ".0f", max),
    "off_frames": ("off", ".0f", max),
    "longest_off": ("in a row", ".0f", max),
    "near_tracked": ("told", ".2f", min),
    "ms_per_frame": ("ms", ".0f", min),
}
_LEGEND = (
    "Means over seeds: marker error from the run's own first answer, MPJPE and shake at 60 Hz [mm]; growth: MPJPE of "
    "the last third over the first's; IoU. ms: a frame of the fastest seed.\n"
    "Of the worst seed: IoU of the worst frame; wrong: frames said to be tracked with a wrist, an ankle or the root "
    "over 200 mm off; off: such frames whatever is said, and how many in a row; told: share said to be tracked or "
    "partial of the frames with none of these over 50 mm off."
)
_NAMED = ("clip", "purpose", "degradation", "start", "tracker")  # what a line of the table is about
_OWN = ("seed", "runs", "scale", "device", "threads")  # settings that the command has flags for


def ablate(
    folder: Path,
    /,
    *,
    clip: Several = (),
    degrade: Several = (),
    start: Several = (),
    tracker: Several = (),
    seeds: int = 3,
    frames: int | None = None,
    scale: float = 1.0,
    subject: Path | None = None,
    device: str = "auto",
    threads: int | None = None,
    console: Console | None = None,
) -> None:
    """Track clips, made worse in several ways, with several trackers.

    Parameters
    ----------
    folder
        Of the results, made if it does not exist: a JSON file per cell, which is not tracked again, and ablation.csv.
    clip
        A shipped sequence or further clip by name, a scene.toml, or all clips for 'tuning' (choose settings on them)
        or for 'reporting' (choose nothing on them); may be given several times. [default: tuning]
    degrade
        none, passer-by, furniture, fps=15, views=3, cut=2 (or all), calibration=10 (pixels), or several joined by +;
        may be given several times. [default: none]
    start
        Body and first pose: given (the clip's own), solved (the body from the clip, with the given pose to begin
        with), or both found in the masks: first-frame (the body from that frame alone) or fitted (as 'mmocap fit'
        does); may be given several times. [default: given]
    tracker
        An algorithm and settings of 'mmocap track', such as h-cmaes,evaluations=300; may be given several times.
        [default: h-cmaes]
    seeds
        How many, from 0 on.
    frames
        At most so many of each clip. [default: all]
    scale
        Of masks and cameras; shipped sequences have 1.
    subject
        File of the subject to start from. [default: the clip's own]
    device
        auto, cpu, or a CUDA device such as cuda:0.
    threads
        CPU threads. All by default.
    """
    from mmocap_warp.commands.outputs import lock
    from mmocap_warp.commands.settings import start_warp
    from mmocap_warp.study.ablation import STARTS, AblationCell, run_ablation, track_with_seed
    from mmocap_warp.study.degradations import NONE, parse
    from mmocap_warp.study.store import open_folder
    from mmocap_warp.whole_file import write_whole

    console = console or Console()
    if seeds < 1:
        raise UsageError(f"--seeds must be at least 1, got {seeds}")
    if frames is not None and frames < 1:
        raise UsageError(f"--frames must be at least 1, got {frames}")
    ways = tuple(dict.fromkeys(degrade or (NONE,)))
    for way in ways:
        try:
            parse(way)
        except ValueError as error:
            raise UsageError(f"--degrade: {error}") from None
    starts = tuple(dict.fromkeys(start or STARTS[:1]))
    if unknown := set(starts) - set(STARTS):
        raise UsageError(f"--start must be one of {', '.join(STARTS)}, got {min(unknown)}")
    settings = {text: _settings(text, scale, device, threads) for text in tracker or ("h-cmaes",)}
    clips = _clips(clip or ("tuning",), frames, scale, subject)
    start_warp(device)
    cells = [
        AblationCell(of, way, text, chosen, seed, begin)
        for of in clips
        for way in ways
        for seed in range(seeds)
        for begin in starts
        for text, chosen in settings.items()
    ]

    def told(cell: AblationCell, measures: dict[str, Any]) -> None:
        done.append(cell)
        console.note(f"{len(done)} of {len(cells)}: {cell}: " + ", ".join(_shown(measures)))

    done: list[AblationCell] = []
    lock(open_folder(folder))
    try:
        rows = run_ablation(folder, cells, told, track_with_seed)
    except ValueError as error:  # such as more views than a clip has, or no such model of its body
        raise UsageError(str(error)) from None
    write_whole(folder / "ablation.csv", _csv(rows).encode())
    console.result({"folder": folder, "cells": rows}, _table(rows))


def _clips(named: tuple[str, ...], frames: int | None, scale: float, subject: Path | None) -> list[Clip]:
    from mmocap_warp.study.ablation import REPORTING, TUNING
    from mmocap_warp.study.further_clips import CLIP_PLANS
    from mmocap_warp.study.source import Clip

    groups = {"tuning": TUNING, "reporting": REPORTING}
    clips = []
    for name in dict.fromkeys(each for text in named for each in groups.get(text, (text,))):
        if name in CLIP_PLANS:
            clips.append(Clip(name, None, frames, scale, subject))
        elif name.endswith(".toml"):
            path = Path(name)
            clips.append(Clip(path.resolve().parent.name, path, frames, scale, subject))
        else:
            raise UsageError(f"--clip {name} is no scene.toml and not one of {', '.join((*groups, *CLIP_PLANS))}")
    return clips


def _settings(text: str, scale: float, device: str, threads: int | None) -> TrackConfig:
    """``h-cmaes,evaluations=300,cost=iou`` as settings; values are read as in a scene file, words need no quotes."""
    import tomllib

    from mmocap_warp.errors import InputError
    from mmocap_warp.formats.toml_table import Table, config_from_table
    from mmocap_warp.tracking.track_config import TrackConfig

    algorithm, *pairs = text.split(",")
    values: dict[str, Any] = {"algorithm": algorithm}
    for pair in pairs:
        name, _, value = pair.partition("=")
        if name in _OWN:
            raise UsageError(f"--tracker {text}: {name} is a setting of the whole ablation")
        try:
            values[name] = tomllib.loads(f"value = {value}")["value"]
        except tomllib.TOMLDecodeError:
            values[name] = value
    try:
        config = config_from_table(TrackConfig, Table(values, "--tracker", text))
        return replace(config, scale=scale, device=device, threads=threads)
    except (InputError, ValueError) as error:
        raise UsageError(f"--tracker {text}: {error}") from None


def _shown(measures: dict[str, Any]) -> list[str]:
    """What is known of the measures, each with its title."""
    return [
        f"{title} {measures[name]:{kind}}"
        for name, (title, kind, _) in _COLUMNS.items()
        if measures.get(name) is not None
    ]


def _table(rows: list[dict[str, Any]]) -> str:
    """A line per clip, degradation and tracker, over the seeds."""

    def which(row: dict[str, Any]) -> tuple[str, ...]:
        return tuple(row["cell"][name] for name in _NAMED)

    lines = [("clip", "for", "degradation", "start", "tracker", "seeds", *(title for title, *_ in _COLUMNS.values()))]
    place = {row: i for i, row in enumerate(dict.fromkeys(map(which, rows)))}
    for key, group in groupby(sorted(rows, key=lambda row: place[which(row)]), which):
        seeds = [row["measures"] for row in group]
        values = [_over_seeds([one[name] for one in seeds], kind, how) for name, (_, kind, how) in _COLUMNS.items()]
        lines.append((*key, str(len(seeds)), *values))
    columns = []
    for i, column in enumerate(zip(*lines, strict=True)):
        width, side = max(map(len, column)), "<" if i < len(_NAMED) else ">"
        columns.append([f"{text:{side}{width}}" for text in column])
    return "\n".join([*("  ".join(line) for line in zip(*columns, strict=True)), "", _LEGEND])


def _over_seeds(values: list[float | None], kind: str, how: Callable[[list[float]], float]) -> str:
    known = [value for value in values if value is not None]
    return format(how(known), kind) if known else "-"


def _csv(rows: list[dict[str, Any]]) -> str:
    """A line per cell."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*rows[0]["cell"], *rows[0]["measures"]])
    writer.writerows([*row["cell"].values(), *row["measures"].values()] for row in rows)
    return text.getvalue()
