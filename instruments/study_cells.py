"""Cells for docs/study: ``python instruments/study_cells.py COMMIT RESULTS...`` puts them into results.csv.

They are those that ``mmocap study run`` wrote into folders, and take the places of the lines that results.csv has of
them. Each line names the commit that tracked it. ``study_figures.py`` then writes the page anew.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mmocap_warp.errors import InputError
from mmocap_warp.study.cell import Cell
from mmocap_warp.study.report_build import csv_table
from mmocap_warp.study.store import read_results
from mmocap_warp.study.summary import MEASURE_OF, CellSummary, Measure, StudySummary

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "study"

FIRST_COMMIT = "58249c3"
"""The one that tracked most cells."""


def cell_of(row: dict[str, str]) -> Cell:
    """Which cell a line of results.csv is of."""
    return Cell(row["sequence"], row["algorithm"], int(row["dof"]), int(row["evaluations"]), row["preset"])


def read_rows(folder: Path = FOLDER) -> dict[Cell, dict[str, str]]:
    """The lines of a folder's results.csv."""
    with (folder / "results.csv").open(encoding="utf-8", newline="") as lines:
        return {cell_of(row): row for row in csv.DictReader(lines)}


def study_of(rows: dict[Cell, dict[str, str]]) -> StudySummary:
    """Lines as a study, of which each cell has one run: the mean of its runs."""
    return StudySummary({cell: _summary(cell, row) for cell, row in rows.items()})


def measure_of(column: str) -> Measure:
    """What a column of results.csv is of."""
    return next(MEASURE_OF[key] for key in sorted(MEASURE_OF, key=len, reverse=True) if column.startswith(key))


def _summary(cell: Cell, row: dict[str, str]) -> CellSummary:
    columns = [name.removesuffix("_sd") for name in row if name.endswith("_sd")]
    runs = {measure_of(name).key: np.array([float(row[name])]) for name in columns}
    quartiles = np.array([float(row[f"mpjpe_{name}"]) for name in ("min", "q1", "median", "q3", "max")])
    meta = {"started": row["started"], "wall_seconds": float(row["seconds"]), "device": row["device"]}
    of_frames = {"runs": runs, "spread": {"mpjpe": quartiles}, "curve": {}, "floors": {}, "frames_lost": 0.0}
    no_pose = {"frames": np.zeros(0), "typical_pose": np.zeros(0), "typical_curve": np.zeros(0)}
    spent = int(row["evaluations_spent"])
    return CellSummary(
        cell, np.arange(1), **of_frames, **no_pose, seconds=float(row["seconds"]), evaluations=spent, meta=meta
    )


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
