"""What stands beside the paper's grid: baselines, our trackers, strangers, search radii, and what was not run."""

from copy import copy
from dataclasses import replace

import numpy as np
import pytest
from study_results import SEQUENCES, like, made_up_result, made_up_study, with_lost_limbs

from mmocap_warp.study.baselines import baselines
from mmocap_warp.study.cell import Cell
from mmocap_warp.study.overview import (
    LOST_LIMB,
    all_trackers,
    lead_table,
    leads,
    missing,
    radii_table,
    radii_tables,
    rank_pairs,
    strangers_table,
)
from mmocap_warp.study.report_build import markdown_tables, render
from mmocap_warp.study.report_figures import time_error_figure
from mmocap_warp.study.sequences import SEQUENCES as SHIPPED
from mmocap_warp.study.source import Clip
from mmocap_warp.study.study_tables import by_algorithm, model_differences
from mmocap_warp.study.summary import MEASURES, Contender, StudySummary, seconds_alone

MAIN = MEASURES[0]
OURS = {("search-contour+solved", 120): 0.3, ("search-contour", 120): 0.6, ("h-cmaes+polish", 500): 0.7}


def beside(sequences=SEQUENCES[:3]):
    """Our trackers on these sequences."""
    for sequence in sequences:
        for (algorithm, budget), factor in OURS.items():
            yield like(Cell(sequence, algorithm, 39, budget), Cell(sequence, "h-cmaes", 39, 500), factor)


def on_strangers():
    for name, factor in (("h-cmaes", 2.0), ("de", 3.0)):
        yield like(Cell("Child/Walking", name, 39, 500), Cell("S1/Walking", name, 39, 500), factor)
    ours = Cell("Child/Walking", "search-contour+solved", 39, 120)
    yield like(ours, Cell("S1/Walking", "h-cmaes", 39, 500), 0.4)


def searches():
    return made_up_study(SEQUENCES[:3], ("h-cmaes", "de"), (39,), (500, 3000), seeds=3, frames=20)


@pytest.fixture(scope="module")
def study():
    """Two searches, our trackers beside them, and a stranger; what a frame takes."""
    alone = {
        Contender("h-cmaes", 39, 3000): 0.2,
        Contender("de", 39, 3000): 0.1,
        Contender("search-contour", 39, 120): 0.01,
    }
    return replace(StudySummary.of([*searches(), *beside(), *on_strangers()]), alone=alone)


def test_the_grid_is_the_same_with_and_without_what_stands_beside(study):
    """Nobody's rank or mean changes."""
    without = StudySummary.of(searches())
    for name in ("preset", "sequences", "algorithms", "models", "budgets"):
        assert getattr(study, name) == getattr(without, name)
    assert by_algorithm(study, MAIN, 39, 500) == by_algorithm(without, MAIN, 39, 500)
    assert study.strangers == ["Child/Walking"]
    assert [str(who) for who in study.others] == [
        "search-contour, body solved (39,120)",
        "search-contour (39,120)",
        "H-CMAES + polish (39,500)",
    ]


def test_everything_is_in_one_table_the_best_first(study):
    table = all_trackers(study)
    means = [float(row[1]) for row in table.rows]
    assert means == sorted(means)
    assert table.rows[0][0] == "search-contour, body solved (39,120)"
    assert len(table.rows) == 2 * 2 + 3
    assert "3 seeds, 20 frames" in table.caption


def test_what_has_not_tracked_all_sequences_is_left_out_of_means():
    results = [result for result in (*searches(), *beside()) if result.cell != Cell(SEQUENCES[2], "de", 39, 500)]
    study = StudySummary.of(results)
    assert "DE(39,500)" not in [row[0] for row in all_trackers(study).rows]
    assert "DE(39,3000)" in [row[0] for row in all_trackers(study).rows]


def test_our_tracker_is_compared_with_the_best_at_the_largest_budget(study):
    found = leads(study, study.sequences)
    assert [lead.sequence for lead in found] == study.sequences
    for lead in found:
        assert lead.best.evaluations == 3000
        errors = [study.cells[Cell(lead.sequence, name, 39, 3000)].runs["mpjpe"].mean() for name in ("h-cmaes", "de")]
        assert lead.error[1] == pytest.approx(min(errors))
        assert lead.half == (lead.error[0] <= 0.5 * min(errors))
        assert lead.seconds == (0.01, 0.2)  # of search-contour: solving the body is once a clip
        assert lead.tenth
    ours = min((who for who in study.others), key=lambda who: study.level(who, MAIN))
    assert {lead.ours for lead in found} == {ours}
    other_order = copy(study)
    object.__setattr__(other_order, "others", sorted(study.others, key=lambda who: -study.level(who, MAIN)))
    assert leads(other_order, study.sequences) == found
    table = lead_table(study, study.sequences)
    assert len({len(row) for row in [table.head, *table.rows]}) == 1
    assert lead_table(StudySummary.of(searches()), study.sequences) is None


def test_strangers_stand_apart(study):
    table = strangers_table(study, MAIN)
    assert table.head == ["Tracker", "Child/Walking", "mean"]
    assert [row[0] for row in table.rows] == ["search-contour, body solved (39,120)", "H-CMAES(39,500)", "DE(39,500)"]
    assert strangers_table(StudySummary.of(searches()), MAIN) is None


def test_ranks_by_fitness_stand_beside_those_by_error(study):
    """DE is the better one by fitness, and by fitness alone."""
    cells = {
        cell: replace(
            summary, runs=summary.runs | {"cost": summary.runs["cost"] * (0.01 if cell.algorithm == "de" else 1)}
        )
        for cell, summary in study.cells.items()
    }
    table = rank_pairs(StudySummary(cells), 39)
    assert table.head[:4] == ["Algorithm", "500: MPJPE", "500: fitness (Eq. 5)", "500: the paper"]
    assert table.rows == [
        ["H-CMAES", "1.000", "2.000", "1.222", "1.000", "2.000", "1.778"],
        ["DE", "2.000", "1.000", "5.111", "2.000", "1.000", "4.222"],
    ]


def test_lost_limbs_stand_beside_each_other_by_preset():
    lost = {"common": 1, "paper-rotation": 12, "paper-translation": 2, "paper": 15}
    table = radii_table(StudySummary.of([*searches(), *with_lost_limbs(lost)]), LOST_LIMB)
    assert table.head[2:] == [f"500: {preset}" for preset in lost]
    assert table.rows[-1][2:] == ["5.0", "60.0", "10.0", "75.0"]
    assert radii_table(StudySummary.of(searches()), MAIN) is None


def test_radii_of_presets_that_lack_sequences_are_compared_where_all_have_them():
    """One table over the sequence that all have, one over both with a dash for who lacks one."""
    lacking = Cell(SEQUENCES[1], "de", 39, 500, "paper")
    cells = [
        Cell(sequence, name, 39, 500, preset)
        for sequence in SEQUENCES[:2]
        for name in ("h-cmaes", "de")
        for preset in ("common", "paper")
    ]
    others = [like(cell, replace(cell, preset="recording"), 2.0) for cell in cells if cell != lacking]
    shared, every = radii_tables(StudySummary.of([*searches(), *others]), MAIN)
    assert "over S1/Walking" in shared.caption
    assert "–" not in [text for row in shared.rows for text in row]
    assert "over S1/Walking, S2/Walking" in every.caption
    of = {row[0]: row[1:] for row in every.rows}
    assert [text == "–" for text in of["DE"]] == [False, False, True]
    assert [text == "–" for text in of["H-CMAES"]] == [False, False, False]


def test_what_was_not_run_is_listed():
    study = StudySummary.of(searches())
    planned = {*study.cells, *(replace(cell, dof=28) for cell in study.cells), Cell(SEQUENCES[5], "de", 39, 500)}
    told = missing(replace(study, planned=frozenset(planned)))
    assert told == [
        "39 DOF, 500 evaluations, preset recording: 1 of 7 cells was not run (DE: S3/Gestures).",
        "28 DOF, 500 evaluations, preset recording: none of 6 cells was run.",
        "28 DOF, 3,000 evaluations, preset recording: none of 6 cells was run.",
    ]
    assert missing(study) == []


def test_the_signed_rank_test_sees_what_all_sequences_agree_on():
    """39 degrees of freedom are worse on all nine: the least p that nine sequences can have."""
    found = model_differences(StudySummary.of(made_up_study(seeds=3, frames=20)), MAIN)
    assert {difference.sequences for difference in found} == {9}
    assert min(difference.p for difference in found) == pytest.approx(2 / 2**9)


def test_seconds_alone_are_of_a_frame():
    result = made_up_result(Cell("S1/Walking", "de", 39, 500), 1, 20)
    result = replace(result, per_run=result.per_run | {"seconds": np.array([3.0])})
    assert seconds_alone([result]) == {Contender("de", 39, 500): pytest.approx(0.15)}


@pytest.fixture(scope="module")
def standing():
    """A study of a shipped sequence, with its baselines."""
    name, frames = "S1/Gestures", 20
    pose = SHIPPED[name].truth.pose[None, :frames].astype(np.float32)
    cells = [made_up_result(Cell(name, algorithm, 39, 500), 1, frames) for algorithm in ("h-cmaes", "de")]
    study = StudySummary.of([replace(cell, pose=pose) for cell in cells])
    return replace(study, baselines=baselines(study, {name: Clip(name)}))


def test_a_body_that_stands_still_has_the_start_pose_throughout(standing):
    name = "S1/Gestures"
    still, moving = (standing.baselines[name, which] for which in ("stands-still", "constant-velocity"))
    np.testing.assert_array_equal(
        still.typical_pose, np.repeat(SHIPPED[name].subject.pose[None], 20, axis=0).astype(np.float32)
    )
    truth = SHIPPED[name].truth.pose
    expected = SHIPPED[name].subject.pose + 19 * (truth[1] - truth[0])
    np.testing.assert_allclose(moving.typical_pose[19], expected, atol=1e-6)
    assert still.runs["mpjpe"] > 5.0
    assert "cost" not in still.runs


def test_baselines_are_in_tables_and_figures_but_in_no_rank(standing):
    page = render(standing, {})
    for anchor in ("trackers", "spread", "curves", "budget"):
        section = page.split(f'<section id="{anchor}">')[1].split("</section>")[0]
        assert "stands still" in section or "a-stands-still" in section
    assert [row.contender.algorithm for row in by_algorithm(standing, MAIN, 39, 500).rows] == ["h-cmaes", "de"]
    assert "| stands still |" in markdown_tables(standing)


def test_no_baseline_of_another_recording_with_a_shipped_name(standing):
    """A user's own sequence may be called as a shipped one."""
    cells = {
        cell: replace(summary, meta=summary.meta | {"cameras": ["mine"]}) for cell, summary in standing.cells.items()
    }
    assert baselines(StudySummary(cells), {"S1/Gestures": Clip("S1/Gestures")}) == {}


def test_error_against_time_needs_times(study):
    drawing = time_error_figure(study, MAIN)
    assert drawing.count("<circle") == 4  # two searches at one budget each, and search-contour with either body
    assert "the paper, 500 evaluations" in drawing
    assert time_error_figure(replace(study, alone={}), MAIN) == ""


def test_the_page_has_all_of_it(study):
    page, tables = render(study, {}), markdown_tables(study)
    for text in (page, tables):
        assert "search-contour, body solved" in text
        assert "Child/Walking" in text
    assert 'id="strangers"' in page
    assert "nan" not in page.split()
