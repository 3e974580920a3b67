"""A study's results are complete and the same bits whatever happens on the way: kills, deaths, full disks, damage."""

from __future__ import annotations

import errno
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from serving_never import serve_never
from study_workers import (
    DYING_ALWAYS,
    DYING_ONCE,
    FAILING,
    ScriptedEngine,
    serve_and_be_killed,
    serve_and_die_once,
)
from tiny_study import CELLS, FRAMES, STUDY, answer_members, run_quietly, tasks_of

from mmocap_warp.jobs import job_run
from mmocap_warp.jobs.engine import EngineLost, Refusal
from mmocap_warp.jobs.job_run import run_jobs
from mmocap_warp.jobs.local_engine import LocalEngine, local_devices
from mmocap_warp.study import job, store
from mmocap_warp.study.cell import read_cell
from mmocap_warp.study.job import Worker
from mmocap_warp.study.summary import summarise, with_typical_pose


def same_answers(left: Path, right: Path) -> bool:
    """Equal files, time and place aside."""
    names = [sorted(path.name for path in folder.glob("*.npz")) for folder in (left, right)]
    return names[0] == names[1] and same_files(left, right)


def same_files(some: Path, whole: Path) -> bool:
    """Results of some of the cells that are equal to those of all of them, time and place aside."""
    return all(answer_members(path) == answer_members(whole / path.name) for path in some.glob("*.npz"))


def test_a_result_says_what_was_tracked(whole, study):
    task = tasks_of(study, whole)[0]
    result = read_cell(task.path)
    assert result.cell == task.name
    assert result.pose.shape == (2, FRAMES, 51)
    assert result.seeds.tolist() == [0, 1]
    assert result.frames.tolist() == list(range(FRAMES))
    assert np.isfinite(result.per_frame["marker_error"]).all()
    assert (result.per_run["evaluations"] == FRAMES * 12).all()
    assert result.meta["config"]["evaluations"] == 12
    assert {"fps", "cameras", "size", "versions", "device", "host", "started", "wall_seconds", "study"} <= set(
        result.meta
    )


@pytest.mark.parametrize("most_stops", [2, pytest.param(5, marks=pytest.mark.nightly)])
def test_killed_again_and_again_it_ends_with_the_same_bits_and_repeats_nothing(study, whole, tmp_path, most_stops):
    """By turns killed and interrupted."""
    results = tmp_path / "results"
    command = [sys.executable, "-m", "mmocap_warp", "study", "run", str(study), "-o", str(results), "--device", "cpu"]
    ended = sorted(path.stat().st_mtime for path in whole.iterdir())
    shortest = float(np.min(np.diff(ended)))
    random, kept, stops = np.random.default_rng(0), {}, 0

    def finished() -> dict[str, int]:
        return {path.name: path.stat().st_mtime_ns for path in results.glob("[!.]*.npz")}

    while True:
        running = subprocess.Popen(
            [*command, "--threads", "1", "--quiet"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        if stops == most_stops:
            assert running.wait() == 0
            break
        while len(finished()) == len(kept):  # until a cell was finished; then at any moment of the next one
            assert running.poll() is None, "it ended before its moment came"
            time.sleep(0.005)
        time.sleep(random.uniform(0.0, 0.5 * shortest))  # so that twelve cells are enough for all stops
        running.send_signal(signal.SIGINT if stops % 2 else signal.SIGKILL)
        running.wait()
        wait_until_gone(running.pid)
        assert kept.items() <= finished().items()
        kept, stops = finished(), stops + 1
    assert kept.items() <= finished().items()
    assert same_answers(results, whole)


def wait_until_gone(group: int) -> None:
    """The workers end with whoever started them."""
    deadline = time.monotonic() + 10.0
    while time.monotonic() < deadline:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return
        time.sleep(0.01)
    raise AssertionError("a worker has outlived its parent")


def test_a_complete_study_starts_no_worker(study, whole):
    status = run_quietly(tasks_of(study, whole), engine=lambda: pytest.fail("a worker was started"))
    assert (status.reused, status.finished, status.rate) == (CELLS, 0, 0.0)


def test_added_cells_are_tracked_alone(study, copied, tmp_path):
    before = {path.name: path.stat().st_mtime_ns for path in copied.iterdir()}
    added = study.with_name("added.toml")
    added.write_text(STUDY.replace('"pso"]', '"pso", "apf"]'))
    status = run_quietly(tasks_of(added, copied))
    assert (status.reused, status.finished) == (CELLS, 3)
    after = {path.name: path.stat().st_mtime_ns for path in copied.iterdir()}
    assert before.items() <= after.items()


def test_folders_of_two_machines_are_merged_by_copying(study, whole, tmp_path):
    """Whichever of them tracked a cell that both have."""
    tasks = tasks_of(study, tmp_path / "one")[:4]
    run_quietly(tasks[::2])
    run_quietly(tasks_of(study, tmp_path / "other")[1:4])
    for path in (tmp_path / "other").iterdir():
        shutil.copy(path, tmp_path / "one")
    assert run_quietly(tasks).reused == 4
    assert same_files(tmp_path / "one", whole)


def test_the_number_of_threads_changes_nothing(study, whole, tmp_path):
    tasks = tasks_of(study, tmp_path / "results")[:2]
    run_quietly(tasks, lambda: LocalEngine(Worker, ["cpu"], threads=3))
    assert len(list((tmp_path / "results").iterdir())) == 2
    assert same_files(tmp_path / "results", whole)


def test_a_damaged_result_is_told_and_tracked_again(study, whole, copied):
    tasks, notes = tasks_of(study, copied), []
    damaged = tasks[3].path
    content = damaged.read_bytes()
    damaged.write_bytes(content[:1000] + bytes(100) + content[1100:])
    status = run_quietly(tasks, notes=notes)
    assert (status.reused, status.finished) == (CELLS - 1, 1)
    assert len(notes) == 1
    assert f"{damaged}: is damaged" in notes[0]
    assert "this cell is repeated" in notes[0]
    assert same_answers(copied, whole)


def test_the_result_of_another_cell_is_told_and_replaced(study, whole, copied):
    (one, other), notes = tasks_of(study, copied)[:2], []
    shutil.copyfile(other.path, one.path)
    run_quietly(tasks_of(study, copied), notes=notes)
    assert notes == [f"{one.path}: is the result of another cell; this cell is repeated"]
    assert same_answers(copied, whole)


def test_a_worker_that_is_killed_is_replaced_and_its_cell_repeated(study, whole, tmp_path):
    notes, serve = [], partial(serve_and_die_once, tmp_path / "mark")
    tasks = tasks_of(study, tmp_path / "results")[:4]
    status = run_quietly(tasks, lambda: LocalEngine(Worker, ["cpu"], 1, serve), notes)
    assert (status.finished, status.failures) == (4, {})
    assert len(notes) == 1
    assert "cpu died (killed by SIGKILL); the cell is tried again" in notes[0]
    assert same_files(tmp_path / "results", whole)


def test_a_cell_that_workers_are_killed_at_is_told_with_the_remedy(study, tmp_path):
    """As by a system that is short of memory."""
    tasks, notes = tasks_of(study, tmp_path / "results"), []
    few = [next(task for task in tasks if task.name.algorithm == name) for name in ("pso", "de", "cmaes")]
    status = run_quietly(few, lambda: LocalEngine(Worker, ["cpu"], 1, serve_and_be_killed), notes)
    assert (status.finished, list(status.failures)) == (2, [few[0].name])
    assert notes[-1] == (
        f"{few[0].name}: given up: cpu died (killed by SIGKILL), as workers did 3 times at this cell; a system that is "
        "short of memory kills so: give it fewer runs or frames, or let fewer workers run at a time on this machine"
    )
    assert len(notes) == 3


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (MemoryError("Unable to allocate\n3 GiB"), "Unable to allocate 3 GiB"),
        (MemoryError(), "MemoryError"),
        (RuntimeError("Failed to allocate 9 bytes on device 'cpu'"), "Failed to allocate 9 bytes on device 'cpu'"),
    ],
    ids=["NumPy", "Python", "Warp"],
)
def test_a_worker_out_of_memory_says_so_and_goes_on(error, told, study, tmp_path, monkeypatch):
    first, second = (task.job for task in tasks_of(study, tmp_path / "results")[:2])
    worker = Worker("cpu", 1)
    with monkeypatch.context() as patched:
        patched.setattr(job, "make_tracker", fails_with(error))
        *_, refusal = worker.work(first)
    assert refusal == Refusal(
        f"cpu: memory ran out ({told}); give it fewer runs or frames, or let fewer workers run at a time on this "
        "machine"
    )
    *_, result = worker.work(second)
    assert result.cell == second.cell


def fails_with(error):
    def failing(*_):
        raise error

    return failing


def test_other_errors_are_none_of_memory(study, tmp_path, monkeypatch):
    monkeypatch.setattr(job, "make_tracker", fails_with(RuntimeError("an illegal memory access was encountered")))
    with pytest.raises(RuntimeError, match="illegal"):
        list(Worker("cpu", 1).work(tasks_of(study, tmp_path / "results")[0].job))


def test_more_seeds_than_fit_are_refused_with_the_number_that_does(study, tmp_path):
    many = study.with_name("many.toml")
    many.write_text(STUDY.replace("seeds = 2", "seeds = 100_000_000"))
    *_, refusal = Worker("cpu", 1).work(tasks_of(many, tmp_path / "results")[0].job)
    assert re.search(
        r"^cpu: h-cmaes with runs = 100000000 .* GB are free; the most that fits is runs = \d+", refusal.problem
    )
    assert "\n" not in refusal.problem


def test_workers_that_cannot_start_end_the_run(study, tmp_path):
    notes = []
    status = run_quietly(
        tasks_of(study, tmp_path / "results"), lambda: LocalEngine(Worker, ["cpu"], 1, serve_never), notes
    )
    assert len(status.failures) == CELLS
    assert "died while it waited or started (ended with exit code 3)" in notes[0]
    assert notes[-1] == f"every worker died while starting; {CELLS} cells are left for another run"


def test_an_engine_that_cannot_start_ends_the_run(study, tmp_path):
    def starting() -> LocalEngine:
        raise EngineLost("no process can be started here")

    notes = []
    status = run_quietly(tasks_of(study, tmp_path / "results"), starting, notes)
    assert len(status.failures) == CELLS
    assert notes == [f"no process can be started here; {CELLS} cells are left for another run"]


def test_an_error_in_a_worker_names_itself(study, tmp_path, monkeypatch):
    """Wrong input is refused at once; anything else is tried again on a new process."""
    tasks, notes = tasks_of(study, tmp_path / "results")[:1], []
    status = run_quietly(tasks, lambda: Spoiling(Worker, ["cpu"], 1, config=None), notes)
    assert "AttributeError: 'NoneType'" in status.failures[tasks[0].name]
    assert len(notes) == 3
    status = run_quietly(tasks, lambda: Spoiling(Worker, ["cpu"], 1, clip_identity="other"), notes)
    assert "Walk is not the same here as where the study was started" in status.failures[tasks[0].name]
    assert len(notes) == 4


class Spoiling(LocalEngine):
    """An engine that changes the jobs it is given."""

    def __init__(self, make, devices, threads, **changes):
        super().__init__(make, devices, threads)
        self._changes = changes

    def submit(self, worker, job):
        super().submit(worker, replace(job, **self._changes))


def test_a_cell_is_tried_three_times_and_the_rest_goes_on(study, tmp_path):
    tasks, notes = tasks_of(study, tmp_path / "results"), []
    engine = ScriptedEngine(2, {tasks[1].name: DYING_ALWAYS, tasks[4].name: DYING_ONCE, tasks[6].name: FAILING})
    status = run_quietly(tasks, lambda: engine, notes)
    assert status.finished == CELLS - 2
    assert set(status.failures) == {tasks[1].name, tasks[6].name}
    assert "as workers did 3 times at this cell" in status.failures[tasks[1].name]
    assert status.failures[tasks[6].name] == "scene.toml: is wrong; mend it"
    tried = [job.cell for job in engine.submitted]
    assert [tried.count(tasks[i].name) for i in (0, 1, 4, 6)] == [1, 3, 2, 1]
    assert engine.closed


def test_a_cluster_that_vanishes_loses_nothing_that_was_finished(study, tmp_path):
    tasks, notes = tasks_of(study, tmp_path / "results"), []
    status = run_quietly(tasks, lambda: ScriptedEngine(1, {}, vanishes_after=3), notes)
    assert (status.finished, len(status.failures)) == (3, CELLS - 3)
    assert notes[-1] == f"the cluster has vanished; {CELLS - 3} cells are left for another run"
    status = run_quietly(tasks, lambda: ScriptedEngine(1, {}))
    assert (status.reused, status.finished) == (3, CELLS - 3)


def test_workers_keep_to_the_masks_they_hold(study, tmp_path):
    second = study.with_name("two.toml")
    second.write_text(
        STUDY.replace('Walk = "walk/scene.toml"', 'A = "walk/scene.toml"\nB = "walk/scene.toml"').replace(
            '["Walk"]', '["A", "B"]'
        )
    )
    engine = ScriptedEngine(2, {})
    run_quietly(tasks_of(second, tmp_path / "results"), lambda: engine)
    held = [[job.cell.sequence for worker, job in engine.given if worker == seat] for seat in (0, 1)]
    assert [len(set(names)) for names in held] == [1, 1]
    assert held[0][0] != held[1][0]


def test_grids_are_tracked_in_their_order(study, tmp_path):
    """Though longer cells, and others of the clip that a worker holds, are left in a later one."""
    grid = STUDY[STUDY.index("[[grid]]") :]
    ordered = study.with_name("ordered.toml")
    ordered.write_text(STUDY + grid.replace("[12]", "[24]") + grid.replace("[12]", "[6]"))
    engine = ScriptedEngine(2, {})
    run_quietly(tasks_of(ordered, tmp_path / "results"), lambda: engine)
    assert [job.cell.evaluations for job in engine.submitted] == [12] * CELLS + [24] * CELLS + [6] * CELLS


class Clock(ScriptedEngine):
    """An engine whose cells take a second each ten evaluations, by a clock of its own."""

    def __init__(self, monkeypatch) -> None:
        super().__init__(1, {})
        self.now = 1000.0
        monkeypatch.setattr(job_run.time, "monotonic", lambda: self.now)

    def submit(self, worker, job):
        super().submit(worker, job)
        self.now += job.config.budget / 10.0


def test_no_cell_is_begun_that_the_time_would_not_do_for(study, tmp_path, monkeypatch):
    grid = STUDY[STUDY.index("[[grid]]") :]
    several = study.with_name("several.toml")
    several.write_text(STUDY + grid.replace("[12]", "[120]") + grid.replace("[12]", "[6]"))
    tasks, notes = tasks_of(several, tmp_path / "results"), []
    engine = Clock(monkeypatch)
    status = run_jobs(tasks, lambda: engine, lambda _: None, notes.append, seconds=12 * 1.2 + 12 + 6)
    budgets = [job.cell.evaluations for job in engine.submitted]
    assert budgets == [12] * CELLS + [120] + [6] * 9
    assert (status.finished, len(status.failures)) == (len(budgets), 2 * CELLS - 10)
    assert notes == [f"the time of 32 s is up; {2 * CELLS - 10} cells are left for another run"]
    assert engine.closed


def test_the_typical_runs_poses_can_be_kept_alone(study, whole, tmp_path):
    tasks = tasks_of(study, tmp_path / "results")[:2]
    run_jobs(tasks, lambda: LocalEngine(Worker, ["cpu"], 1), lambda _: None, print, keep=with_typical_pose)
    for task in tasks:
        kept, full = read_cell(task.path), read_cell(whole / task.path.name)
        assert kept.pose.shape == (1, FRAMES, 51)
        np.testing.assert_array_equal(kept.pose[0], summarise(full).typical_pose)
        np.testing.assert_array_equal(summarise(kept).typical_pose, summarise(full).typical_pose)
        assert summarise(kept).runs.keys() == summarise(full).runs.keys()
    assert run_quietly(tasks).reused == 2


def full_disk(monkeypatch, *, writes_that_fail: int, patience: float = 0.0) -> list[Path]:
    """The disk is full for so many writes; returns what is written."""
    write, written = store.write_cell, []

    def writing(path, result):
        written.append(path)
        with monkeypatch.context() as patched:
            if len(written) <= writes_that_fail:
                patched.setattr(Path, "write_bytes", no_space)
            write(path, result)

    monkeypatch.setattr(store, "write_cell", writing)
    monkeypatch.setattr(job_run, "_SECONDS_BETWEEN_TRIES", 0.0)
    monkeypatch.setattr(job_run, "_PATIENCE", patience)
    monkeypatch.setattr(job_run, "_WAIT", 0.001)
    return written


def no_space(path, data):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_full_disk_costs_nothing_if_room_is_made(study, whole, tmp_path, monkeypatch):
    full_disk(monkeypatch, writes_that_fail=4)
    tasks, notes = tasks_of(study, tmp_path / "results"), []
    status = run_quietly(tasks, lambda: ScriptedEngine(1, {}), notes)
    assert (status.finished, status.unstored, status.failures) == (CELLS, 0, {})
    assert len(notes) == 1
    assert "cannot be written ([Errno 28] No space left on device)" in notes[0]
    assert len(list((tmp_path / "results").iterdir())) == CELLS


@pytest.mark.parametrize("capacity", [100, 2])
def test_room_is_waited_for(capacity, study, tmp_path, monkeypatch):
    """In the end, and whenever more results wait than should."""
    full_disk(monkeypatch, writes_that_fail=50, patience=60.0)
    monkeypatch.setattr(job_run, "_CAPACITY", capacity)
    tasks, notes = tasks_of(study, tmp_path / "results"), []
    status = run_quietly(tasks, lambda: ScriptedEngine(1, {}), notes)
    assert (status.finished, status.unstored, status.failures) == (CELLS, 0, {})
    assert notes[1] == f"waiting up to 60 s for {min(CELLS, capacity)} results to be stored"


def test_a_disk_that_stays_full_is_told(study, tmp_path, monkeypatch):
    full_disk(monkeypatch, writes_that_fail=1000)
    tasks = tasks_of(study, tmp_path / "results")
    status = run_quietly(tasks, lambda: ScriptedEngine(1, {}))
    assert (status.finished, status.unstored, len(status.failures)) == (0, CELLS, CELLS)
    assert all("No space left" in problem for problem in status.failures.values())
    assert list((tmp_path / "results").iterdir()) == []


def test_nothing_is_begun_that_could_not_be_kept(study, tmp_path, monkeypatch):
    full_disk(monkeypatch, writes_that_fail=1000)
    monkeypatch.setattr(job_run, "_CAPACITY", 2)
    engine = ScriptedEngine(1, {})
    status = run_quietly(tasks_of(study, tmp_path / "results"), lambda: engine)
    assert len(engine.submitted) == 2
    assert len(status.failures) == CELLS


def test_a_run_tells_rate_and_what_is_left(study, tmp_path):
    seen = []
    tasks = tasks_of(study, tmp_path / "results")
    run_jobs(tasks, lambda: ScriptedEngine(1, {}), seen.append, lambda line: None)
    left = [status.evaluations_left for status in seen]
    assert left[-1] == 0
    assert all(later <= earlier for earlier, later in pairwise(left))
    assert seen[-1].rate > 0


def test_devices_are_listed():
    assert local_devices("cpu") == ["cpu"]
    assert local_devices("cpu,cpu") == ["cpu", "cpu"]
    for wrong in ("cuda:77", "nonsense", ""):
        with pytest.raises(ValueError, match="device must"):
            local_devices(wrong)


def test_two_processes_of_one_device_share_the_work(study, whole, tmp_path):
    tasks = tasks_of(study, tmp_path / "results")[:4]
    assert run_quietly(tasks, lambda: LocalEngine(Worker, ["cpu", "cpu"], threads=1)).finished == 4
    assert same_files(tmp_path / "results", whole)
