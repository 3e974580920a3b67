"""Cells for docs/study: ``python instruments/study_cells.py COMMIT RESULTS...`` puts them into results.csv.

They are those that ``mmocap study run`` wrote into folders, and take the places of the lines that results.csv has of
them. Each line names the commit that tracked it. ``study_figures.py`` then writes the page anew.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Sequence
from pathlib import Path

from mmocap_warp.errors import InputError
from mmocap_warp.study.cell import Cell
from mmocap_warp.study.report_build import csv_table
from mmocap_warp.study.store import read_results
from mmocap_warp.study.summary import StudySummary

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "study"


def cell_of(row: dict[str, str]) -> Cell:
    """Which cell a line of results.csv is of."""
    return Cell(row["sequence"], row["algorithm"], int(row["dof"]), int(row["evaluations"]), row["preset"])


def read_rows(folder: Path = FOLDER) -> dict[Cell, dict[str, str]]:
    """The lines of a folder's results.csv."""
    with (folder / "results.csv").open(encoding="utf-8", newline="") as lines:
        return {cell_of(row): row for row in csv.DictReader(lines)}


def add_cells(commit: str, folders: Sequence[str], into: Path = FOLDER) -> None:
    """Put the cells of folders, tracked by a commit, into a folder's results.csv."""
    results = [result for folder in folders for result in read_results(folder)]
    damaged = [result for result in results if isinstance(result, InputError)]
    if damaged:
        raise damaged[0]
    rows = read_rows(into)
    for row in csv.DictReader(csv_table(StudySummary.of(results)).splitlines()):
        rows[cell_of(row)] = row | {"commit": commit}
    with (into / "results.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(next(iter(rows.values()))), lineterminator="\n")
        writer.writeheader()
        writer.writerows(row for _, row in sorted(rows.items()))


if __name__ == "__main__":
    add_cells(sys.argv[1], sys.argv[2:])
