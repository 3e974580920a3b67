"""What other code has finished is kept where a sample of it has the same bits."""

from __future__ import annotations

import shutil

import pytest
from study_workers import DirectEngine
from tiny_study import CELLS, FRAMES, answer_members, run_quietly, tasks_of

from mmocap_warp.commands import studies
from mmocap_warp.study import store
from mmocap_warp.study.cell import read_cell, write_cell
from mmocap_warp.study.definition import load_study
from mmocap_warp.study.store import keep_earlier_cells
from mmocap_warp.study.summary import with_typical_pose

TRACKERS = 4  # of the tiny study, with three cells each


@pytest.fixture(scope="module")
def of_other_code(study, tmp_path_factory):
    """The study's results, made when the code was another."""
    folder = tmp_path_factory.mktemp("earlier") / "results"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(store, "code_of", lambda *_: "of the version before")
        patch.setattr("mmocap_warp.study.job.code_of", lambda *_: "of the version before")
        run_quietly(tasks_of(study, folder))
    return folder


def kept(study, folder):
    """Keep what can be: all cells, those that were tracked, and the notes."""
    planned, tracked, notes = tasks_of(study, folder), [], []

    def track(chosen):
        tracked.extend(chosen)
        run_quietly(chosen)

    keep_earlier_cells(load_study(study), planned, "cpu", track, notes.append)
    return planned, tracked, notes


def test_a_sample_is_tracked_again_and_the_rest_is_kept(study, of_other_code, tmp_path):
    folder = shutil.copytree(of_other_code, tmp_path / "results")
    one_algorithm = tasks_of(study, folder)[:3]
    assert not any(task.path.exists() for task in one_algorithm)
    planned, tracked, notes = kept(study, folder)
    assert len(tracked) == CELLS  # three of each algorithm, which has three here
    assert all(task.path.exists() for task in planned)
    assert len(notes) == TRACKERS
    assert all("have the same bits now" in note for note in notes)


def test_cells_beyond_the_sample_are_copied_and_name_their_code(study, of_other_code, tmp_path, monkeypatch):
    folder = shutil.copytree(of_other_code, tmp_path / "results")
    monkeypatch.setattr("mmocap_warp.study.store.sample_of", lambda cells: cells[:1])
    planned, tracked, notes = kept(study, folder)
    assert len(tracked) == TRACKERS
    copied = [task for task in planned if task not in tracked]
    assert {read_cell(task.path).meta["code"] for task in copied} == {"of the version before"}
    assert all(note.endswith("2 more are kept") for note in notes)


def test_poses_of_the_typical_run_alone_are_no_other_bits(study, of_other_code, tmp_path):
    folder = shutil.copytree(of_other_code, tmp_path / "results")
    for file in folder.glob("*.npz"):
        write_cell(file, with_typical_pose(read_cell(file)))
    *_, notes = kept(study, folder)
    assert all("have the same bits now" in note for note in notes)


def test_cells_of_the_sample_count_as_tracked(study, of_other_code, tmp_path, monkeypatch):
    folder = shutil.copytree(of_other_code, tmp_path / "results")
    monkeypatch.setattr("mmocap_warp.study.store.sample_of", lambda cells: cells[:1])
    monkeypatch.setattr(studies, "engine_of", lambda *_: ("cpu", DirectEngine))
    status = studies.run_study(study, folder, accept_changed_code=True).status
    assert (status.reused, status.finished) == (CELLS - TRACKERS, TRACKERS)
    assert status.evaluations == TRACKERS * 2 * FRAMES * 12


def test_other_bits_keep_nothing(study, of_other_code, tmp_path, monkeypatch):
    folder = shutil.copytree(of_other_code, tmp_path / "results")
    monkeypatch.setattr("mmocap_warp.study.store.sample_of", lambda cells: cells[:1])
    monkeypatch.setattr("mmocap_warp.study.store._answer", lambda file: str(file))
    planned, tracked, notes = kept(study, folder)
    assert {task.path for task in planned if task.path.exists()} == {task.path for task in tracked}
    assert all("1 of 1 cells have other bits now" in note for note in notes)


def test_what_differs_in_more_than_the_code_is_no_earlier_result(study, of_other_code, tmp_path):
    folder = shutil.copytree(of_other_code, tmp_path / "results")
    other = study.with_name("other.toml")
    other.write_text(study.read_text().replace("scale = 0.5", "scale = 0.4"))
    planned = tasks_of(other, folder)
    keep_earlier_cells(
        load_study(other), planned, "cpu", lambda chosen: pytest.fail(f"{chosen}") if chosen else None, print
    )
    assert not any(task.path.exists() for task in planned)
    assert answer_members(next(folder.glob("*.npz")))
