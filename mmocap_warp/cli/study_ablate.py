"""``mmocap study ablate``: clips, degradations and trackers in every combination."""

from __future__ import annotations

from collections.abc import Callable
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mmocap_warp.cli.command import Answer, command, several
from mmocap_warp.cli.console import Console

if TYPE_CHECKING:
    from mmocap_warp.study.ablation import AblationCell


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
_ROW = ("clip", "purpose", "degradation", "start", "tracker")  # what a line of the table is about


@command(
    "clips:ablate",
    clips=several("--clip"),
    degradations=several("--degrade"),
    starts=several("--start"),
    trackers=several("--tracker"),
)
def ablate(call: Any, console: Console, folder: Path) -> Answer:
    done = 0

    def show(cell: AblationCell, measures: dict[str, Any], total: int) -> None:
        nonlocal done
        done += 1
        console.note(f"{done} of {total}: {cell}: " + ", ".join(_shown(measures)))

    rows = call(show=show)
    return Answer({"folder": folder, "cells": rows}, [_table(rows)])


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
        return tuple(row["cell"][name] for name in _ROW)

    lines = [("clip", "for", "degradation", "start", "tracker", "seeds", *(title for title, *_ in _COLUMNS.values()))]
    place = {row: i for i, row in enumerate(dict.fromkeys(map(which, rows)))}
    for key, group in groupby(sorted(rows, key=lambda row: place[which(row)]), which):
        seeds = [row["measures"] for row in group]
        values = [_over_seeds([one[name] for one in seeds], kind, how) for name, (_, kind, how) in _COLUMNS.items()]
        lines.append((*key, str(len(seeds)), *values))
    columns = []
    for i, column in enumerate(zip(*lines, strict=True)):
        width, side = max(map(len, column)), "<" if i < len(_ROW) else ">"
        columns.append([f"{text:{side}{width}}" for text in column])
    return "\n".join([*("  ".join(line) for line in zip(*columns, strict=True)), "", _LEGEND])


def _over_seeds(values: list[float | None], kind: str, how: Callable[[list[float]], float]) -> str:
    known = [value for value in values if value is not None]
    return format(how(known), kind) if known else "-"
