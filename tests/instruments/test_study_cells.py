"""Cells of a study take the places of a table's lines, and nothing else changes."""

from __future__ import annotations

from pathlib import Path

import pytest
from study_cells import add_cells, read_rows, study_of
from study_results import like, made_up_result

from mmocap_warp.errors import InputError
from mmocap_warp.study.cell import Cell, write_cell
from mmocap_warp.study.report_build import csv_table
from mmocap_warp.study.store import result_path
from mmocap_warp.study.summary import StudySummary

KNOWN = [Cell(sequence, "h-cmaes", 39, 500) for sequence in ("S1/Box", "S2/Box", "S3/Box")]
ADDED = Cell("S2/Box", "h-pso", 39, 500)


@pytest.fixture
def table(tmp_path: Path) -> Path:
    """A folder whose results.csv has three cells of one commit."""
    head, *lines = csv_table(StudySummary.of(made_up_result(cell, 3, 20) for cell in KNOWN)).splitlines()
    text = "\n".join([f"{head},commit", *(f"{line},old" for line in lines), ""])
    (tmp_path / "results.csv").write_text(text, encoding="utf-8")
    return tmp_path


def _tracked(folder: Path, *results) -> str:
    folder.mkdir()
    for result in results:
        write_cell(result_path(folder, result.cell, "0" * 20), result)
    return str(folder)


def test_a_cell_takes_the_place_of_its_line_and_a_new_one_gets_its_own(table, tmp_path):
    before = (table / "results.csv").read_text(encoding="utf-8").splitlines()
    again, new = like(KNOWN[1], KNOWN[1], factor=2.0), made_up_result(ADDED, 3, 20)
    add_cells("new", [_tracked(tmp_path / "a", again), _tracked(tmp_path / "b", new)], table)
    after = (table / "results.csv").read_text(encoding="utf-8").splitlines()
    assert [line.rsplit(",", 1)[1] for line in after] == ["commit", "old", "new", "new", "old"]
    assert [after[place] for place in (0, 1, 4)] == [before[place] for place in (0, 1, 3)]
    assert list(read_rows(table)) == [KNOWN[0], KNOWN[1], ADDED, KNOWN[2]]
    there, tracked = study_of(read_rows(table)).cells, StudySummary.of([again, new]).cells
    for cell in (KNOWN[1], ADDED):
        for name in ("mpjpe", "iou", "shake", "limb_lost"):
            assert there[cell].runs[name].mean() == pytest.approx(tracked[cell].runs[name].mean(), rel=1e-4)


def test_a_damaged_cell_leaves_the_table_as_it_was(table, tmp_path):
    before = (table / "results.csv").read_bytes()
    folder = _tracked(tmp_path / "a", made_up_result(ADDED, 3, 20), made_up_result(KNOWN[0], 3, 20))
    next(Path(folder).glob("S1_Box*")).write_bytes(b"PK")
    with pytest.raises(InputError, match="damaged"):
        add_cells("new", [folder], table)
    assert (table / "results.csv").read_bytes() == before
