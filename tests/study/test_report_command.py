"""The command that writes the report, and the pictures in it."""

import csv
import io
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from report_page import Page
from study_results import SEQUENCES, made_up_result, made_up_study

import mmocap_warp as mm
from mmocap_warp.cli import main
from mmocap_warp.cli.console import BAD_INPUT, OK
from mmocap_warp.study.cell import Cell, read_cell, write_cell
from mmocap_warp.study.report_figures import rank_figure
from mmocap_warp.study.report_overlays import best_and_worst, extreme_frames, side_by_side
from mmocap_warp.study.report_setting import mixture
from mmocap_warp.study.report_tables import effect_cells
from mmocap_warp.study.sequences import SEQUENCES as SHIPPED
from mmocap_warp.study.source import Clip, clip_facts
from mmocap_warp.study.store import result_path
from mmocap_warp.study.study_tables import by_algorithm, model_differences
from mmocap_warp.study.summary import MEASURES, StudySummary
from mmocap_warp.study.wording import DASH

MAIN = MEASURES[0]


def tracked_walk(frames=20):
    """A result on a shipped sequence whose typical run is the truth, but for one frame that is off."""
    name = "S1/Walking"
    truth = SHIPPED[name].truth
    result = made_up_result(Cell(name, "h-cmaes", 39, 500), 1, frames)
    error = np.full((1, frames), 0.02, np.float32)
    error[0, 0], error[0, 7], error[0, 13] = 0.0, 0.01, 0.09
    pose = np.repeat(truth.pose[None, :frames], 1, axis=0).astype(np.float32)
    pose[0, 13, :3] += 0.3
    return replace(result, pose=pose, per_frame=result.per_frame | {"mpjpe": error})


def test_pictures_show_the_best_and_the_worst_frame():
    study = StudySummary.of([tracked_walk(), made_up_result(Cell("S1/Walking", "apf", 39, 500), 1, 20)])
    (summary,) = [summary for cell, summary in study.cells.items() if cell.algorithm == "h-cmaes"]
    assert extreme_frames(summary, MAIN) == (7, 13)
    ranking = by_algorithm(study, MAIN, 39, 500)
    clips = {"S1/Walking": Clip("S1/Walking")}
    ((best, worst),) = best_and_worst(study, MAIN, ranking, clips)
    assert (best.frame, worst.frame) == (7, 13)
    assert (round(best.error), round(worst.error)) == (10, 90)
    for picture in (best, worst):
        Page(picture.drawing)
        assert picture.camera in SHIPPED["S1/Walking"].rig.names
        assert len(re.findall('class="seen" d="M', picture.drawing)) == 1
        assert len(re.findall('class="model" d="M', picture.drawing)) == 1


def test_pictures_of_another_recording_are_not_drawn():
    """A user's sequence may have a shipped one's name."""
    here = tracked_walk()
    elsewhere = replace(here, pose=here.pose + np.eye(51, dtype=np.float32)[0] * 2)
    cameras = replace(here, meta=here.meta | {"cameras": ["C1"]})
    clip = replace(here, meta=here.meta | {"clip": "another"})
    for result in (elsewhere, cameras, clip):
        study = StudySummary.of([result])
        assert side_by_side(study, "S1/Walking", 39, 500, Clip("S1/Walking")) == []
    here = replace(here, meta=here.meta | {"clip": clip_facts(Clip("S1/Walking", frames=20)).identity})
    rows = side_by_side(StudySummary.of([here]), "S1/Walking", 39, 500, Clip("S1/Walking"))
    assert [[picture.frame for picture in row] for row in rows] == [[6, 12, 18]]


@pytest.fixture
def results(tmp_path):
    """A folder of results, one of which is damaged."""
    folder = tmp_path / "results"
    folder.mkdir()
    for result in made_up_study(SEQUENCES[:2], ("h-cmaes", "apf"), (39,), (500,), seeds=3, frames=12):
        write_cell(result_path(folder, result.cell, "0" * 20), result)
    (folder / "cut-short.npz").write_bytes(b"PK")
    return folder


def test_the_command_writes_page_tables_and_cells(results, tmp_path, capsys):
    page = tmp_path / "report.html"
    assert main(["study", "report", str(results), "-o", str(page), "--json"]) == OK
    said = capsys.readouterr()
    answer = json.loads(said.out)
    assert (answer["results"], len(answer["left_out"]), answer["mixed_code"]) == (4, 1, None)
    assert "cut-short.npz" in said.err
    assert "cut-short.npz" in Page(page.read_text(encoding="utf-8")).text
    assert sorted(path.name for path in tmp_path.iterdir()) == ["report.html", "results", "results.csv", "tables.md"]
    lines = list(csv.DictReader(io.StringIO((tmp_path / "results.csv").read_text(encoding="utf-8"))))
    assert [(line["sequence"], line["algorithm"]) for line in lines][:2] == [
        ("S1/Walking", "apf"),
        ("S1/Walking", "h-cmaes"),
    ]
    expected = made_up_result(Cell("S1/Walking", "apf", 39, 500), 3, 12).per_frame["marker_error"]
    assert float(lines[0]["marker_error_mm"]) == pytest.approx(1000 * np.nanmean(expected), rel=1e-4)
    assert "H-CMAES(39,500) | 1.000" in (tmp_path / "tables.md").read_text(encoding="utf-8")
    assert main(["study", "report", str(results), "-o", str(page)]) == BAD_INPUT
    assert main(["study", "report", str(results), "-o", str(page), "--force"]) == OK


def test_several_folders_make_one_page_and_a_study_says_what_is_missing(results, tmp_path, capsys):
    """Times come from a folder of their own, whose results stand in no other table."""
    more, alone = tmp_path / "more", tmp_path / "alone"
    for folder, seeds in ((more, 3), (alone, 1)):
        folder.mkdir()
        for result in made_up_study(SEQUENCES[:2], ("de",), (39,), (500,), seeds=seeds, frames=12):
            write_cell(result_path(folder, result.cell, "0" * 20), result)
    definition = tmp_path / "planned.toml"
    definition.write_text(
        f'[study]\n[[grid]]\nsequences = ["{SEQUENCES[0]}"]\nalgorithms = ["de", "pso"]\n'
        "dof = [39]\nevaluations = [500]\n"
    )
    page = tmp_path / "report.html"
    command = ["study", "report", str(results), str(more), "--alone", str(alone), "--study", str(definition)]
    assert main([*command, "-o", str(page), "--json"]) == OK
    assert json.loads(capsys.readouterr().out)["results"] == 6
    text = Page(page.read_text(encoding="utf-8")).text
    assert "39 DOF, 500 evaluations, preset recording: 1 of 2 cells was not run (PSO: all)." in text
    assert "Milliseconds per frame of one run tracked alone" in text
    lines = list(csv.DictReader(io.StringIO((tmp_path / "results.csv").read_text(encoding="utf-8"))))
    assert {line["seeds"] for line in lines} == {"3"}


def test_results_of_different_code_are_not_mixed_without_a_word(results, tmp_path, capsys):
    path = min(results.glob("S*.npz"))
    result = read_cell(path)
    write_cell(path, replace(result, meta=result.meta | {"code": "0123456789abcdef"}))
    page = tmp_path / "report.html"
    assert main(["study", "report", str(results), "-o", str(page), "--json"]) == OK
    said = capsys.readouterr()
    warning = (
        "Results of different code are mixed: 0.1.0 (unknown) (3 cells); 0.1.0 (0123456789ab) (1 cell); "
        "run the study again"
    )
    assert f"{results}: {warning}" in said.err
    assert json.loads(said.out)["mixed_code"].startswith(warning)
    assert warning in Page(page.read_text(encoding="utf-8")).text
    assert warning in (tmp_path / "tables.md").read_text(encoding="utf-8")


def test_results_of_different_frames_are_not_mixed_without_a_word():
    results = list(made_up_study(SEQUENCES[:2], ("h-cmaes", "apf"), (39,), (500,), seeds=3, frames=12))
    same = [replace(each, meta=each.meta | {"clip": each.cell.sequence}) for each in results[1:]]
    assert mixture(StudySummary.of([results[0], *same])) == ""  # older results do not say
    other = replace(results[0], meta=results[0].meta | {"clip": "shorter"})
    warning = f"Results of different frames, images or truth of {other.cell.sequence} are mixed."
    assert mixture(StudySummary.of([other, *same])) == warning


def test_of_equally_many_cells_the_page_is_about_the_default_preset():
    results = list(made_up_study(SEQUENCES[:1], ("h-cmaes",), (39,), (500,), ("authors", "recording"), 1, 3))
    assert StudySummary.of(results).preset == "recording"


def test_one_seed_has_no_intervals():
    several, one = (
        StudySummary.of(made_up_study(SEQUENCES[:2], ("h-cmaes", "apf"), (39, 28), (500,), seeds=seeds, frames=12))
        for seeds in (3, 1)
    )
    for study, dashes in ((several, 0), (one, 2)):
        ranking = by_algorithm(study, MAIN, 39, 500)
        assert [effect_cells(row, MAIN).count(DASH) for row in ranking.rows] == [dashes + 1, dashes]
        Page(rank_figure(ranking, study.algorithms))
        ends = np.array([each.interval for each in model_differences(study, MAIN)])
        assert np.isnan(ends).all() == (study is one)


def test_times_alone_are_of_one_seed(results, tmp_path, capsys):
    command = ["study", "report", str(results), "--alone", str(results), "-o", str(tmp_path / "report.html")]
    assert main(command) == BAD_INPUT
    assert "holds no result of one seed; name the folder of a study with seeds = 1" in capsys.readouterr().err


def test_no_folder_at_all_is_wrong_usage():
    with pytest.raises(mm.UsageError, match="results names no folder"):
        mm.report_study([])


def test_code_that_only_other_cells_run_is_no_mixture():
    results = list(made_up_study(SEQUENCES[:2], ("h-cmaes", "apf"), (39,), (500,), seeds=3, frames=12))
    coded = [replace(results[0], meta=results[0].meta | {"code": "b", "code_covers": {"contours": True}})]
    coded += [replace(each, meta=each.meta | {"code": "a", "code_covers": {"contours": False}}) for each in results[1:]]
    assert mixture(StudySummary.of(coded)) == ""
    other = replace(coded[1], meta=coded[1].meta | {"code": "c"})
    assert "different code" in mixture(StudySummary.of([coded[0], other, *coded[2:]]))


@pytest.mark.parametrize("folder", ["nowhere", "empty"])
def test_a_folder_without_results_is_said(folder, tmp_path, capsys):
    (tmp_path / "empty").mkdir()
    assert main(["study", "report", str(tmp_path / folder), "-o", str(tmp_path / "report.html")]) == BAD_INPUT
    assert "mmocap study run" in capsys.readouterr().err
    assert not (tmp_path / "report.html").exists()
