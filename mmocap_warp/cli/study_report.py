"""``mmocap study report``: a study's results as a page, and its tables as text."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from mmocap_warp.cli.console import Console, Switch

if TYPE_CHECKING:
    from mmocap_warp.study.cell import CellResult

_TABLES, _CELLS = "tables.md", "results.csv"


def report(
    results: Path,
    /,
    *more: Path,
    output: Annotated[Path, Parameter(name=["--output", "-o"])] = Path("report.html"),
    study: Annotated[tuple[Path, ...], Parameter(negative="", show_default=False)] = (),
    alone: Path | None = None,
    force: Switch = False,
    console: Console | None = None,
) -> None:
    """Write a study's results as one HTML page that needs no network.

    Beside the page go tables.md, the tables as text, and results.csv, a line per cell.

    Parameters
    ----------
    results
        What 'mmocap study run' wrote.
    more
        Further folders of results, of the same page.
    output
        The page, .html.
    study
        The study's TOML file: says what should be there, so that what is missing is listed, and where sequences of
        your own are, for pictures of the tracked body over them; may be given several times.
    alone
        A folder of results of one seed, tracked one at a time: what a frame takes. They stand in no table but the
        times.
    force
        Replace files that exist.
    """
    from mmocap_warp.commands.outputs import new_file
    from mmocap_warp.commands.settings import start_warp
    from mmocap_warp.errors import InputError
    from mmocap_warp.study.baselines import baselines
    from mmocap_warp.study.definition import load_study
    from mmocap_warp.study.report_build import clips_of, write_report
    from mmocap_warp.study.report_setting import mixture
    from mmocap_warp.study.store import read_results
    from mmocap_warp.study.summary import StudySummary, seconds_alone

    console = console or Console()
    page = new_file(output, ".html", force=force)
    tables = new_file(page.with_name(_TABLES), ".md", force=force)
    cells = new_file(page.with_name(_CELLS), ".csv", force=force)
    studies = [load_study(path) for path in study]
    own = {clip.name: clip for each in studies for clip in each.clips}
    start_warp()
    notes: list[str] = []

    def sound(*folders: Path) -> Iterator[CellResult]:
        for found in chain.from_iterable(map(read_results, folders)):
            if isinstance(found, InputError):
                console.note(f"left out: {found}")
                notes.append(f"Left out: {Path(found.source).name} {found.problem}.")
            else:
                yield found

    tracked = StudySummary.of(sound(results, *more))
    if not tracked.measures:
        raise InputError(results, "holds no result", "run 'mmocap study run' first, or name its folder")
    clips = clips_of(tracked, own)
    summary = replace(
        tracked,
        baselines=baselines(tracked, clips),
        alone={} if alone is None else seconds_alone(sound(alone)),
        planned=frozenset(plan.cell for each in studies for plan in each.plans),
    )
    mixed = mixture(summary)
    if mixed:
        console.note(f"{results}: {mixed}")
    write_report(summary, clips, notes, page, tables, cells)
    values = {"page": page, "tables": tables, "cells": cells, "results": len(summary.cells), "left_out": notes}
    values["mixed_code"] = mixed or None
    console.result(values, f"{page}\n{tables}\n{cells}")
