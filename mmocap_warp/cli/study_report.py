"""``mmocap study report``: a study's results as a page, and its tables as text."""

from __future__ import annotations

from collections.abc import Iterator
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
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])] = Path("report.html"),
    study: Path | None = None,
    force: Switch = False,
    console: Console | None = None,
) -> None:
    """Write a study's results as one HTML page that needs no network.

    Beside the page go tables.md, the tables as text, and results.csv, a line per cell.

    Parameters
    ----------
    results
        What 'mmocap study run' wrote.
    output
        The page, .html.
    study
        The study's TOML file: says where sequences of your own are, for pictures of the tracked body over them.
    force
        Replace files that exist.
    """
    from mmocap_warp.cli.devices import start_warp
    from mmocap_warp.cli.outputs import new_file
    from mmocap_warp.errors import InputError
    from mmocap_warp.study.definition import load_study
    from mmocap_warp.study.report import write_report
    from mmocap_warp.study.report_setting import mixture
    from mmocap_warp.study.source import Clip
    from mmocap_warp.study.store import read_results
    from mmocap_warp.study.summary import StudySummary

    console = console or Console()
    page = new_file(output, ".html", force=force)
    tables = new_file(page.with_name(_TABLES), ".md", force=force)
    cells = new_file(page.with_name(_CELLS), ".csv", force=force)
    clips: dict[str, Clip] = {} if study is None else {clip.name: clip for clip in load_study(study).clips}
    start_warp()
    notes: list[str] = []

    def sound() -> Iterator[CellResult]:
        for found in read_results(results):
            if isinstance(found, InputError):
                console.note(f"left out: {found}")
                notes.append(f"Left out: {Path(found.source).name} {found.problem}.")
            else:
                yield found

    summary = StudySummary.of(sound())
    if not summary.measures:
        raise InputError(results, "holds no result", "run 'mmocap study run' first, or name its folder")
    mixed = mixture(summary)
    if mixed:
        console.note(f"{results}: {mixed}")
    write_report(summary, clips, notes, page, tables, cells)
    values = {"page": page, "tables": tables, "cells": cells, "results": len(summary.cells), "left_out": notes}
    values["mixed_code"] = mixed or None
    console.result(values, f"{page}\n{tables}\n{cells}")
