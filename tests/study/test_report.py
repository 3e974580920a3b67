"""The report without a browser: its structure, that it asks nobody for anything, and the tables beside it."""

import base64
import csv
import hashlib
import io
import re
from dataclasses import replace

import numpy as np
import pytest
from report_page import Page
from study_results import SEQUENCES, made_up_result, made_up_study

from mmocap_warp.optimizers.cma_es import CmaEs
from mmocap_warp.study.cell import Cell
from mmocap_warp.study.definition import Plan
from mmocap_warp.study.report_build import csv_table, markdown_tables, render
from mmocap_warp.study.source import Clip
from mmocap_warp.study.study_tables import by_algorithm, by_model, model_differences
from mmocap_warp.study.summary import MEASURES, StudySummary, summarise
from mmocap_warp.tracking.algorithms import ALGORITHMS, Algorithm
from mmocap_warp.tracking.track_config import TrackConfig

MAIN = MEASURES[0]
MARKER_ERROR = next(measure for measure in MEASURES if measure.key == "marker_error")


@pytest.fixture(scope="module")
def study():
    """The paper's grid on four sequences."""
    return StudySummary.of(made_up_study(SEQUENCES[2:6], seeds=4, frames=40))


@pytest.fixture(scope="module")
def html(study):
    return render(study, {}, ["A remark."])


@pytest.fixture(scope="module")
def page(html):
    return Page(html)


def test_the_page_needs_nothing_but_itself(page, html):
    """No attribute fetches anything, nor does the style; the policy forbids it besides."""
    for _, attributes in page.elements:
        for name in ("src", "srcset", "href", "action", "data", "poster", "xlink:href"):
            value = attributes.get(name) or ""
            assert not value or value.startswith(("#", "data:")), value
        assert not [name for name in attributes if name.startswith("on") or name == "style"]
    assert "@import" not in html
    assert "url(" not in html
    assert not re.search(r"\b(fetch|XMLHttpRequest|WebSocket|importScripts|eval)\b", html)


def test_the_policy_allows_its_own_style_and_script_alone(page, html):
    policy = next(meta["content"] for meta in page.all("meta") if meta.get("http-equiv") == "Content-Security-Policy")
    assert policy.startswith("default-src 'none'")
    for tag in ("style", "script"):
        (content,) = re.findall(rf"<{tag}>(.*?)</{tag}>", html, re.S)
        digest = base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()
        assert f"{tag}-src 'sha256-{digest}'" in policy
    assert "unsafe" not in policy


def test_it_has_every_section_and_links_to_it(page):
    ids = [attributes["id"] for _, attributes in page.elements if "id" in attributes]
    assert len(ids) == len(set(ids))
    assert ids == ["ranks", "spread", "curves", "budget", "models", "setting", "cite"]
    assert [link["href"] for link in page.all("a")] == [f"#{name}" for name in ids]
    assert "A remark." in page.text
    assert "Applied Soft Computing" in page.text
    assert "Made-up GPU" in page.text


def test_controls_start_where_the_page_does(page, study):
    """Without the script exactly the first choice of everything shows, and the dead controls do not."""
    (form,) = page.of_class("controls")
    assert "hidden" in form
    assert [select["name"] for select in page.all("select")] == ["measure", "model", "budget", "sequence"]
    assert all("disabled" in button for button in page.all("button"))
    first = {"measure": "mpjpe", "curve": "mpjpe", "model": "39", "budget": "500"}
    first["sequence"] = study.sequences[0]
    parts = page.of_class("choice")
    assert len(parts) > 50
    for part in parts:
        keys = {name[5:]: value for name, value in part.items() if name.startswith("data-")}
        assert ("hidden" not in part) == all(first[name] == value for name, value in keys.items())


def test_figures_can_be_told_without_being_seen(page):
    figures = [svg for svg in page.all("svg") if svg.get("aria-hidden") != "true"]
    assert figures
    assert all(svg["role"] == "img" and svg["aria-label"] and svg["viewbox"] for svg in figures)


def test_no_number_is_missing_from_a_drawing(html):
    drawn = re.findall(r' (?:d|x|y|cx|cy)="([^"]*)"', html)
    assert len(drawn) > 1000
    assert not [value for value in drawn if "nan" in value or "inf" in value]


def with_a_ninth(name):
    """Results of two of the paper's algorithms and another one."""
    for result in made_up_study(SEQUENCES[:2], ("h-cmaes", "pso", "apf"), (39, 28), (500,), seeds=2, frames=12):
        algorithm = name if result.cell.algorithm == "apf" else result.cell.algorithm
        yield replace(result, cell=replace(result.cell, algorithm=algorithm))


@pytest.mark.parametrize(("hierarchical", "table"), [(True, 6), (False, 7)])
def test_a_ninth_algorithm_is_reported(hierarchical, table, monkeypatch):
    """By its label, after the paper's, among those that search as it does."""
    monkeypatch.setitem(ALGORITHMS, "random", Algorithm(CmaEs, "RANDOM <9>", hierarchical))
    study = StudySummary.of(with_a_ninth("random"))
    assert study.algorithms == ["h-cmaes", "pso", "random"]
    assert "RANDOM <9>(39,500)" in Page(render(study, {})).text
    tables = markdown_tables(study)
    assert "RANDOM <9>(39,500)" in tables.split("(as the paper’s Table 5)")[0]
    assert "RANDOM <9>(39,500)" in tables.split(f"(as the paper’s Table {table})")[1].split("##")[0]
    assert "random" in csv_table(study)


def test_an_algorithm_that_is_not_registered_here_has_its_name():
    study = StudySummary.of(with_a_ninth('"<b>elsewhere'))
    page = Page(render(study, {}))
    assert page.all("b") == []
    assert '"<b>elsewhere(39,500)' in page.text
    assert '"<b>elsewhere(39,500)' in markdown_tables(study)


def test_names_are_escaped():
    cell = Cell('<img src="x">/A&B', "cmaes", 39, 500)
    result = replace(made_up_result(Cell("S1/Box", "cmaes", 39, 500), 2, 10), cell=cell)
    other = replace(made_up_result(Cell("S1/Box", "de", 39, 500), 2, 10), cell=replace(cell, algorithm="de"))
    page = Page(render(StudySummary.of([result, other]), {}, ["<script>"]))
    assert page.all("img") == []
    assert len(page.all("script")) == 1
    assert "A&B" in page.text


@pytest.mark.parametrize(
    "grid",
    [
        {"algorithms": ("h-cmaes",), "budgets": (500,), "models": (39,), "sequences": SEQUENCES[:1], "seeds": 1},
        {"algorithms": ("h-cmaes", "pso"), "budgets": (700,), "models": (51,), "sequences": SEQUENCES[:2]},
        {"truth": False, "sequences": SEQUENCES[:2], "budgets": (500,)},
        {"presets": ("recording", "paper"), "algorithms": ("cmaes", "de"), "sequences": SEQUENCES[:1]},
        {"frames": 1, "sequences": SEQUENCES[:2], "algorithms": ("cmaes", "de")},
    ],
    ids=["one cell", "another grid", "no truth", "two presets", "one frame"],
)
def test_any_grid_has_a_page(grid):
    study = StudySummary.of(made_up_study(**({"seeds": 3, "frames": 12} | grid)))
    page = Page(render(study, {}))
    assert "nan" not in page.text.split()
    assert ("presets" in [a.get("id") for _, a in page.elements]) == (len(grid.get("presets", ())) == 2)
    assert markdown_tables(study)
    assert csv_table(study)


def test_a_study_of_contours_alone_has_a_page():
    """Nothing is evaluated."""
    cell = Cell("S1/Box", "de", 39, 500)
    results = [made_up_result(cell, 2, 10)]
    results = [replace(one, cell=replace(cell, algorithm="contour", evaluations=0)) for one in results]
    assert Page(render(StudySummary.of(results), {})).all("table")


def test_without_truth_fitness_decides():
    study = StudySummary.of(made_up_study(SEQUENCES[:2], budgets=(500,), seeds=2, frames=12, truth=False))
    assert [measure.key for measure in study.measures] == ["cost", "iou", "shake", "jerk", "foot_slide"]


def readings_that_disagree():
    """PSO is the better one by MPJPE, H-CMAES by both readings of Eq. 20."""
    other_way_round = {"h-cmaes": 0.040, "pso": 0.030}
    for result in made_up_study(SEQUENCES[:3], ("h-cmaes", "pso"), (39,), (500,), seeds=2, frames=12):
        error = other_way_round[result.cell.algorithm]
        yield replace(result, per_frame=result.per_frame | {"mpjpe": np.full((2, 12), error, np.float32)})


def test_mpjpe_decides_and_both_readings_of_eq_20_stand_beside():
    study = StudySummary.of(readings_that_disagree())
    assert [measure.key for measure in study.measures[:3]] == ["mpjpe", "eq20_as_printed", "marker_error"]
    firsts = [by_algorithm(study, measure, 39, 500).rows[0].contender.algorithm for measure in study.measures[:3]]
    assert firsts == ["pso", "h-cmaes", "h-cmaes"]
    text = Page(render(study, {})).text
    tables = markdown_tables(study)
    for written in (text, tables):
        assert "PSO tracks three sequences to 30.0\N{NO-BREAK SPACE}mm" in written
        for label in ("by MPJPE", "by marker error (Eq. 20 as printed)", "by marker error (Eq. 20 from own answer)"):
            assert f"39 DOF {label}" in written or f"39 DOF, {label}" in written


def test_each_reading_has_its_floor_beside_it():
    """The made-up floors are 10 and 5 mm for S1, 1.05 and 1.2 times as much for S2 and S3."""
    study = StudySummary.of(made_up_study(SEQUENCES[:3], ("h-cmaes", "pso"), (39,), (500,), seeds=2, frames=12))
    readings = study.measures[1:3]
    assert [study.floor(measure, ["S2/Walking"]) for measure in readings] == pytest.approx([10.5, 5.25])
    floors = [
        f"Floor: at the true angles the tracked bodies score {floor}\N{NO-BREAK SPACE}mm, mean over three sequences."
        for floor in ("10.8", "5.4")
    ]
    text = Page(render(study, {})).text
    tables = markdown_tables(study)
    for floor in floors:
        assert text.count(floor) == 2  # in the headline and with the ranking
        assert floor in tables
    assert "Floor: at the true angles10.010.512.0" in text
    (line,) = [line for line in csv.DictReader(io.StringIO(csv_table(study))) if line["algorithm"] == "pso"][:1]
    assert (line["eq20_as_printed_floor_mm"], line["marker_error_floor_mm"]) == ("10", "5")


def test_an_unknown_floor_is_not_shown():
    results = [
        replace(result, per_run={name: of for name, of in result.per_run.items() if not name.endswith("_floor")})
        for result in made_up_study(SEQUENCES[:2], ("h-cmaes", "pso"), (39,), (500,), seeds=2, frames=12)
    ]
    study = StudySummary.of(results)
    assert np.isnan(study.floor(MARKER_ERROR, study.sequences))
    assert "Floor" not in Page(render(study, {})).text
    assert "Floor" not in markdown_tables(study)
    assert {line["marker_error_floor_mm"] for line in csv.DictReader(io.StringIO(csv_table(study)))} == {""}


def test_a_gap_in_the_grid_leaves_its_sequence_out():
    study = StudySummary.of(made_up_study(SEQUENCES[2:6], models=(39,), budgets=(500,), seeds=2, frames=12))
    cells = {cell: summary for cell, summary in study.cells.items() if cell != Cell(SEQUENCES[2], "de", 39, 500)}
    ranking = by_algorithm(StudySummary(cells), MARKER_ERROR, 39, 500)
    assert ranking.left_out == (SEQUENCES[2],)
    assert len(ranking.sequences) == 3
    assert len(ranking.rows) == 8
    assert "left out of the ranking" in Page(render(StudySummary(cells), {})).text


def test_who_has_hardly_begun_takes_no_sequence_from_the_others():
    results = made_up_study(SEQUENCES[:5], models=(39,), budgets=(500,), seeds=2, frames=10)
    study = StudySummary.of(
        each for each in results if each.cell.algorithm != "de" or each.cell.sequence == SEQUENCES[0]
    )
    ranking = by_algorithm(study, MARKER_ERROR, 39, 500)
    assert (len(ranking.rows), len(ranking.sequences)) == (7, 5)
    assert [str(who) for who in ranking.absent] == ["DE(39,500)"]
    assert "DE(39,500) tracked too few sequences" in Page(render(study, {})).text


def test_only_seeds_that_all_have_count():
    results = list(made_up_study(SEQUENCES[:2], algorithms=("cmaes", "de"), models=(39,), budgets=(500,), seeds=5))
    results[0] = made_up_result(results[0].cell, 3, 60)
    ranking = by_algorithm(StudySummary.of(results), MARKER_ERROR, 39, 500)
    assert ranking.seeds == 3
    levels = [result.per_frame["marker_error"][:3] for result in results if result.cell.algorithm == "de"]
    assert ranking.row("de", 39, 500).mean == pytest.approx(1000 * np.nanmean(levels), rel=1e-5)


def test_the_later_of_two_results_counts():
    """Whatever their order, and their versions."""
    result = made_up_result(Cell("S1/Box", "cmaes", 39, 500), 2, 10)
    later = replace(result, meta=result.meta | {"started": "2026-02-01T00:00:00+00:00", "host": "later"})
    for order in ([result, later], [later, result]):
        (summary,) = StudySummary.of(order).cells.values()
        assert summary.meta["host"] == "later"


def test_a_summary_is_of_its_result():
    result = made_up_result(Cell("S1/Box", "apf", 39, 500), 5, 60)
    summary = summarise(result)
    error = result.per_frame["marker_error"].astype(float) * 1000
    np.testing.assert_allclose(summary.runs["marker_error"], np.nanmean(error, axis=1), rtol=1e-9)
    known = error[np.isfinite(error)]
    np.testing.assert_allclose(summary.spread["marker_error"], np.percentile(known, (0, 25, 50, 75, 100)), rtol=1e-9)
    assert np.isnan(summary.curve["marker_error"]).tolist() == [24 <= frame < 27 for frame in range(60)]
    assert summary.typical_pose.shape == (60, 51)
    middle = np.argsort(summary.runs["mpjpe"])[2]
    np.testing.assert_allclose(summary.typical_curve, 1000 * result.per_frame["mpjpe"][middle].astype(float), rtol=1e-9)
    judged = np.isfinite(result.per_frame["mpjpe"]).any(axis=0).sum()
    assert judged < 60  # the truth has not all frames
    np.testing.assert_allclose(summary.runs["limb_lost"], 100 * result.per_run["limb_lost"] / judged, rtol=1e-9)


def test_tables_have_the_papers_layout(study):
    """ALG(DOF, EVAL) by ascending rank; Table 4's blocks are sequences, Table 6's contenders one algorithm's."""
    ranking = by_algorithm(study, MARKER_ERROR, 39, 500)
    assert str(ranking.rows[0].contender) == "H-CMAES(39,500)"
    assert [row.comparison.rank for row in ranking.rows] == sorted(row.comparison.rank for row in ranking.rows)
    assert ranking.test.dof == 7
    models = by_model(study, MARKER_ERROR, "de")
    assert sorted(str(row.contender) for row in models.rows) == sorted(
        f"DE({dof},{budget})" for dof in (39, 28) for budget in (500, 1500, 3000)
    )
    assert models.test.dof == 5


def test_more_overlap_is_better():
    study = StudySummary.of(made_up_study(SEQUENCES[:3], models=(39,), budgets=(500,), seeds=3, frames=20))
    iou = next(measure for measure in MEASURES if measure.key == "iou")
    rows = by_algorithm(study, iou, 39, 500).rows
    assert [row.mean for row in rows] == sorted((row.mean for row in rows), reverse=True)
    assert all(row.mean_interval[0] <= row.mean <= row.mean_interval[1] for row in rows)
    assert all(row.superiority > 0.5 for row in rows[1:])


def test_differences_between_models_have_the_papers_signs(study):
    found = model_differences(study, MARKER_ERROR)
    assert len(found) == 24
    for difference in found:
        filters = difference.algorithm in ("apf", "psapf")
        assert (difference.difference > 0) == filters
        assert (difference.superiority < 0.5) == filters
        assert difference.interval[0] < difference.difference < difference.interval[1]


def test_presets_are_compared_where_both_have_tracked():
    """The grid is the main preset's; a budget that only the other has is shown without a companion."""
    main_cells = made_up_study(SEQUENCES[:2], ("cmaes", "de"), (39,), (500, 1500), seeds=2, frames=12)
    others = made_up_study(SEQUENCES[:1], ("cmaes",), (39,), (500, 9000), ("paper",), seeds=2, frames=12)
    study = StudySummary.of([*main_cells, *others])
    assert (study.preset, study.budgets, study.sequences) == ("recording", [500, 1500], list(SEQUENCES[:2]))
    text = Page(render(study, {})).text
    assert "recording: 0.01 to 0.08 rad and 0.0067 to 0.053 m. paper: 0.5 rad and 0.5 m." in text
    of = {preset: study.cells[Cell(SEQUENCES[0], "cmaes", 39, 500, preset)] for preset in ("recording", "paper")}
    shown = [f"{of[preset].runs['mpjpe'].mean():.1f}" for preset in ("recording", "paper")]
    assert f"9,000: paperCMAES{''.join(shown)}–" in text


def test_the_result_of_the_plan_counts_though_another_is_later():
    """Of a trial with fewer seeds or frames, in the same folder."""
    cell = Cell("S1/Box", "cmaes", 39, 500)
    planned, trial = made_up_result(cell, 3, 10), made_up_result(cell, 1, 10)
    later = replace(trial, meta=trial.meta | {"started": "2026-02-01T00:00:00+00:00"})
    first = int(planned.seeds[0])
    plan = Plan(cell, Clip("S1/Box", frames=10), TrackConfig("cmaes", evaluations=500, seed=first, runs=3))
    for order in ([planned, later], [later, planned]):
        (summary,) = StudySummary.of(order, [plan]).cells.values()
        assert len(summary.seeds) == 3
        (summary,) = StudySummary.of(order).cells.values()
        assert len(summary.seeds) == 1
