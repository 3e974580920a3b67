"""``mmocap study run`` and ``show``: what they print, and their exit codes."""

from __future__ import annotations

import io
import json
import os
from pathlib import Path

import pytest
from study_workers import DYING_ALWAYS, ScriptedEngine
from tiny_study import CELLS

from mmocap_warp import cli
from mmocap_warp.cli import console
from mmocap_warp.cli.progress import JobsProgress, headline
from mmocap_warp.commands import studies
from mmocap_warp.errors import InputError
from mmocap_warp.jobs.engine import Advance
from mmocap_warp.jobs.job_run import Seat, Status
from mmocap_warp.study import store
from mmocap_warp.study.cell import Cell
from mmocap_warp.study.job import Job
from mmocap_warp.study.store import CellTask, open_folder, read_results
from mmocap_warp.whole_file import whole_file


def run(study: Path, folder: Path, *flags: str) -> int:
    return cli.main(["study", "run", str(study), "-o", str(folder), "--device", "cpu", "--threads", "1", *flags])


def test_what_is_missing_is_tracked_and_summed_up(study, copied, capsys):
    next(copied.glob("*-pso-*")).unlink()
    assert run(study, copied, "--json") == console.OK
    out, err = capsys.readouterr()
    answer = json.loads(out)
    assert (answer["cells"], answer["finished_before"], answer["finished_now"]) == (CELLS, CELLS - 1, 1)
    assert answer["failed"] == []
    assert answer["evaluations"] == 12 * 3 * 2
    assert answer["paper_grid_hours"] == pytest.approx(2.0e10 / answer["evaluations_per_second"] / 3600)
    assert len(answer["results"]) == CELLS
    assert all(0 < row["marker_error_mm"] < 500 and 0 < row["iou"] <= 1 for row in answer["results"])
    assert "tiny: 12/12 cells" in err


def test_a_complete_study_prints_its_table(study, copied, capsys):
    assert run(study, copied, "--quiet") == console.OK
    out, err = capsys.readouterr()
    assert out.startswith(f"{copied}: 12 of 12 cells, 0 of them new\n")
    assert len([line for line in out.splitlines() if line.startswith("recording")]) == CELLS
    assert err == ""


def test_the_table_is_aligned_however_trackers_are_called():
    from mmocap_warp.cli.study_command import _COLUMNS, _text

    measured = dict.fromkeys(_COLUMNS, 0.5)
    rows = [
        {"preset": preset, "evaluations": 100, "dof": 39, "algorithm": algorithm} | measured
        for preset, algorithm in (("recording", "pso"), ("recording-restart", "search-contour+solved"))
    ]
    values = {"folder": "f", "cells": 2, "finished_now": 2, "finished_before": 0, "failed": [], "results": rows}
    head, *lines = _text(values | {"evaluations_per_second": None}).splitlines()[2:]
    for title in ("algorithm", "MPJPE", "Eq. 20 as printed", "IoU", "growth"):
        assert all(line[head.index(title) - 1] == " " != line[head.index(title)] for line in lines)


def test_a_wrong_study_leaves_no_folder(tmp_path, capsys):
    (tmp_path / "s.toml").write_text('[[grid]]\nsequences = ["S9/Fly"]\nalgorithms = ["pso"]\ndof = [39]\n')
    assert run(tmp_path / "s.toml", tmp_path / "results") == console.BAD_INPUT
    assert "no sequence 'S9/Fly'" in capsys.readouterr().err
    assert not (tmp_path / "results").exists()


def test_cells_that_fail_are_told_and_the_run_fails(study, copied, capsys, monkeypatch):
    for path in copied.glob("*-pso-*"):
        path.unlink()
    # The sequence has changed between the planning and the tracking.
    monkeypatch.setattr(store, "Job", lambda cell, clip, identity, *rest: Job(cell, clip, "as it was", *rest))
    assert run(study, copied) == console.FAILURE
    out, err = capsys.readouterr()
    assert "9 of 12 cells, 0 of them new" in out
    assert "missing: Walk pso 28 DOF 12 evaluations recording, " in out
    assert "Walk is not the same here as where the study was started" in out
    assert out.endswith("run the study again to track what is missing\n")
    assert err.count("given up: ") == 3


def test_workers_that_are_killed_are_told_in_one_line_and_the_run_fails(study, tmp_path, capsys, monkeypatch):
    engine = ScriptedEngine(1, {Cell("Walk", "pso", 39, 12): DYING_ALWAYS})
    monkeypatch.setattr(studies, "engine_of", lambda *_: ("cpu", lambda: engine))
    assert run(study, tmp_path / "r") == console.FAILURE
    out, err = capsys.readouterr()
    assert f"{CELLS - 1} of {CELLS} cells" in out
    reason = "seat 0 died (lightning), as workers did 3 times at this cell; stand elsewhere"
    assert f"missing: Walk pso 39 DOF 12 evaluations recording: {reason}\n" in out
    assert f"Walk pso 39 DOF 12 evaluations recording: given up: {reason}\n" in err


@pytest.mark.parametrize(
    ("flags", "code", "message"),
    [
        (["--engine", "cloud"], console.USAGE, "--engine must be local or ray"),
        (["--device", "cuda:99"], console.USAGE, "--device must be"),
        (["--threads", "0"], console.USAGE, "--threads must be at least 1, got 0"),
        (["--workers", "2"], console.USAGE, "--workers, --gpus and --address need --engine ray"),
        (["--engine", "ray", "--device", "cpu"], console.USAGE, "cannot be given with --engine ray"),
    ],
)
def test_wrong_flags_are_told(flags, code, message, study, tmp_path, capsys):
    assert cli.main(["study", "run", str(study), "-o", str(tmp_path / "r"), *flags]) == code
    assert message in capsys.readouterr().err
    assert not (tmp_path / "r").exists()


def test_a_folder_that_cannot_be_is_told(study, tmp_path, capsys):
    (tmp_path / "file").touch()
    assert run(study, tmp_path / "file") == console.BAD_INPUT
    assert "cannot be used (File exists); name a folder for results" in capsys.readouterr().err


def test_show_lists_and_checks(copied, capsys):
    assert cli.main(["study", "show", str(copied), "--json"]) == console.OK
    assert len(json.loads(capsys.readouterr().out)["results"]) == CELLS
    damaged = next(copied.glob("*.npz"))
    damaged.write_bytes(damaged.read_bytes()[:-9])
    assert cli.main(["study", "show", str(copied)]) == console.CHECK_FAILED
    out = capsys.readouterr().out
    assert f"damaged: {damaged}: is damaged" in out
    assert out.endswith("11 results, 1 damaged\n")


def test_show_needs_a_folder(tmp_path, capsys):
    assert cli.main(["study", "show", str(tmp_path / "none")]) == console.BAD_INPUT
    assert "no such folder" in capsys.readouterr().err


def test_half_written_files_are_cleared_away_after_a_while(tmp_path):
    others = [tmp_path / name for name in ("whole.key.npz", "._whole.key.npz", ".hidden.npz")]
    with whole_file(tmp_path / "a.key.npz") as old, whole_file(tmp_path / "b.key.npz") as young:
        for path in (old, young, *others):
            path.touch()
        for path in (old, *others):
            os.utime(path, (0, 0))
        open_folder(tmp_path)
        assert sorted(tmp_path.iterdir()) == sorted([young, *others])
        old.touch()  # so that it can be renamed


def test_a_file_that_its_writer_finishes_meanwhile_does_not_stop_a_run(tmp_path, monkeypatch):
    monkeypatch.setattr(Path, "glob", lambda folder, _: iter([folder / ".a.key.123.npz"]))
    open_folder(tmp_path)


def test_a_half_written_result_is_none_yet(copied):
    with whole_file(copied / "a.key.npz") as unfinished:
        unfinished.write_bytes(b"PK")
        results = list(read_results(copied))
    assert len(results) == CELLS
    assert not any(isinstance(result, InputError) for result in results)


def cell(*of) -> CellTask:
    return CellTask(None, Path(), Cell(*of))


STATUS = Status(
    jobs=20,
    reused=5,
    finished=3,
    unstored=1,
    failures={Cell("W", "pso", 39, 500): "why"},
    evaluations=6000,
    evaluations_left=60000,
    seconds=2.0,
    seats=(
        Seat("cuda:0", task=cell("S1/Walking", "h-cmaes", 39, 500), advance=Advance("search", 3, 10, 100)),
        Seat("cuda:1", task=cell("S1/Box", "pso", 28, 500)),
        Seat("cuda:2"),
    ),
    noun="cell",
)


def test_the_headline_has_cells_rate_and_time_left():
    line = headline(STATUS)
    assert line == "8/20 cells, 1 failed, 1 waiting for room on the disk, 3,000 evaluations/s, 0:20 left"


class Terminal(io.StringIO):
    """A stream that passes for a terminal."""

    def isatty(self) -> bool:
        return True


def test_a_terminal_shows_a_table_of_workers(monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "120")
    stream = Terminal()
    with JobsProgress("tiny", stream=stream) as progress:
        progress.note("a worker died")
        progress.show(STATUS)
    shown = stream.getvalue()
    for part in (
        "a worker died",
        "cuda:0",
        "S1/Walking h-cmaes 39 DOF",
        "search 3/10",
        "starts",
        "waits",
        "8/20 cells",
    ):
        assert part in shown


def test_a_quiet_run_tells_what_is_wrong_alone():
    stream = io.StringIO()
    with JobsProgress("tiny", quiet=True, stream=stream) as progress:
        progress.note("a hint")
        progress.warn("a worker died")
    assert stream.getvalue() == "a worker died\n"


def test_elsewhere_lines_come_now_and_then(study):
    stream = io.StringIO()
    with JobsProgress("tiny", stream=stream) as progress:
        for _ in range(3):
            progress.show(STATUS)
    assert stream.getvalue() == ""
