"""Every verdict on every claim of the paper, reached by a table made for it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from paper_claims import (
    AGREES,
    DIFFERS,
    EVOLUTIONARY,
    FAILS,
    MOSTLY,
    TIED,
    TOO_FEW,
    UNTESTED,
    check_claims,
    main,
    which_half,
)
from study_results import SEQUENCES, made_up_study, with_lost_limbs

from mmocap_warp.study import statistics
from mmocap_warp.study.cell import Cell, write_cell
from mmocap_warp.study.paper import ALGORITHM_ORDER, EVALUATIONS
from mmocap_warp.study.store import result_path
from mmocap_warp.study.summary import MEASURES, CellSummary, StudySummary

MEASURE = {measure.key: measure for measure in MEASURES}
_BY_SUBJECT = {"S1": 0.0, "S2": 1.0, "S3": 2.0}
_BY_ACTION = {"Gestures": 0.0, "Box": 1.0, "Walking": 2.0}
_SPREAD = {"Gestures": 50.0, "Walking": 60.0, "Box": 70.0}


@pytest.fixture(scope="module", autouse=True)
def _remembered_signed_ranks() -> Iterator[None]:
    """Most tables have pairs in common, and each exact test takes long."""
    p_values: dict[tuple[tuple[int, ...], bytes], float] = {}
    signed_rank = statistics.signed_rank

    def remembered(pairs: np.ndarray) -> float:
        key = pairs.shape, pairs.tobytes()
        if key not in p_values:
            p_values[key] = signed_rank(pairs)
        return p_values[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(statistics, "signed_rank", remembered)
        yield


def error(cell: Cell) -> float:
    """An error [mm] of which all that the paper says holds: algorithms as in Table 4, budgets all alike."""
    subject, action = cell.sequence.split("/")
    place = 100.0 * ALGORITHM_ORDER.index(cell.algorithm)
    model = 10.0 if (cell.dof == 28) == (cell.algorithm in EVOLUTIONARY) else 0.0
    return 100.0 + place + model + _BY_ACTION[action] + _BY_SUBJECT[subject]


def spread(cell: Cell) -> float:
    """Between the quartiles [mm]."""
    return _SPREAD[cell.sequence.split("/")[1]] - cell.evaluations / 1000


def jerk(cell: Cell) -> float:
    return 100.0 if cell.algorithm in ("cmaes", "h-cmaes") else 200.0


def planted(
    sequences=SEQUENCES,
    algorithms=ALGORITHM_ORDER,
    models=(39, 28),
    budgets=EVALUATIONS,
    error=error,
    spread=spread,
    jerk=jerk,
    **others,
) -> StudySummary:
    """A study whose every run has these values; ``others`` are of further measures."""
    cells = {}
    for sequence, algorithm, dof, budget in product(sequences, algorithms, models, budgets):
        cell = Cell(sequence, algorithm, dof, budget)
        of_runs = {"marker_error": error, "jerk": jerk} | others
        reach = spread(cell) / 2 * np.array([-9, -1, 0, 1, 9])
        cells[cell] = CellSummary(
            cell=cell,
            seeds=np.arange(2),
            frames=np.arange(1),
            runs={key: np.full(2, value(cell)) for key, value in of_runs.items()},
            spread={key: value(cell) + reach for key, value in of_runs.items()},
            curve={},
            floors={},
            frames_lost=0.0,
            typical_pose=np.zeros((1, 51)),
            typical_curve=np.zeros(1),
            seconds=1.0,
            evaluations=budget,
            meta={},
        )
    return StudySummary(cells)


def with_(value, where, of=error):
    """``of``, but ``value`` of the cells for which ``where`` holds."""
    return lambda cell: value(cell) if where(cell) else of(cell)


def at(algorithm, dof, budget):
    return lambda cell: (cell.algorithm, cell.dof, cell.evaluations) == (algorithm, dof, budget)


def one_of(*algorithms):
    return lambda cell: cell.algorithm in algorithms


def boxing(cell):
    return cell.sequence.endswith("Box")


def as_ever(cell):
    return 9.0


def smooth(cell):
    return 50.0


def first(cell):
    """Better than all others."""
    return error(cell) / 1000


def last(cell):
    """Worse than all others."""
    return error(cell) * 1000


def second(cell):
    return error(Cell(cell.sequence, "h-cmaes", cell.dof, cell.evaluations)) + 5.0


def other_model(cell):
    """The models change places."""
    return error(Cell(cell.sequence, cell.algorithm, 67 - cell.dof, cell.evaluations))


def before_the_hierarchy(cell):
    return error(Cell(cell.sequence, f"h-{cell.algorithm}", cell.dof, cell.evaluations)) - 1.0


def level_with_the_hierarchy(cell):
    return error(Cell(cell.sequence, f"h-{cell.algorithm}", cell.dof, cell.evaluations))


def easy(cell):
    return error(cell) - 50.0


def hard(cell):
    return error(cell) + 50.0


VERDICTS = [
    ("H-CMAES has the best", FAILS, {"error": with_(first, at("h-pso", 39, 500))}, "5 of 6; elsewhere H-PSO(39,500)."),
    ("H-CMAES has the best", UNTESTED, {"algorithms": ("de", "pso")}, "no case"),
    ("In all cases the evol", FAILS, {"error": with_(first, at("psapf", 28, 3000))}, "of 66 of 72 pairs"),
    ("In all cases the evol", UNTESTED, {"algorithms": EVOLUTIONARY}, "no case"),
    ("In all cases the part", FAILS, {"error": with_(second, at("psapf", 39, 500))}, "in 11 of 12 cases"),
    ("In all cases the part", UNTESTED, {"sequences": SEQUENCES[:1]}, "no case"),
    (
        "In all tests searching",
        FAILS,
        {"error": with_(before_the_hierarchy, at("de", 39, 500))},
        "H-CMAES 6 of 6, H-PSO 6 of 6, H-DE 5 of 6",
    ),
    (
        "In all tests searching",
        FAILS,
        {"error": with_(level_with_the_hierarchy, at("pso", 28, 1500))},
        "H-CMAES 6 of 6, H-PSO 5 of 6, H-DE 6 of 6",
    ),
    ("In all tests searching", UNTESTED, {"algorithms": ("cmaes", "h-pso")}, "no case"),
    ("39 degrees", MOSTLY, {"error": with_(other_model, one_of("h-de"))}, "DE 3 of 3 (+10.0 mm)"),
    ("39 degrees", MOSTLY, {"error": with_(other_model, one_of("h-de", "de"))}, "H-DE 0 of 3 (−10.0 mm)"),
    ("39 degrees", DIFFERS, {"error": with_(other_model, one_of("h-de", "de", "pso"))}, "PSO 0 of 3"),
    ("39 degrees", UNTESTED, {"models": (39,)}, "no case"),
    ("39 are significantly", FAILS, {"error": with_(other_model, one_of("h-de"))}, "H-DE 0 of 3 (worse: 3), DE 3 of 3"),
    ("39 are significantly", AGREES, {"error": with_(other_model, one_of("cmaes"))}, "CMAES 0 of 3 (worse: 3)"),
    ("39 are significantly", TOO_FEW, {"sequences": SEQUENCES[:5]}, "Too few for that: five sequences."),
    ("39 are significantly", UNTESTED, {"models": (39,)}, "no case"),
    ("28 degrees", MOSTLY, {"error": with_(other_model, at("apf", 39, 500))}, "APF 0 of 3 (−6.7 mm), PSAPF 0 of 3"),
    ("28 degrees", DIFFERS, {"error": with_(other_model, one_of("psapf"))}, "APF 0 of 3 (−10.0 mm), PSAPF 3 of 3"),
    ("28 degrees", UNTESTED, {"models": (28,)}, "no case"),
    ("CMAES and H-CMAES need", DIFFERS, {"error": with_(last, at("cmaes", 39, 500))}, "p = "),
    ("CMAES and H-CMAES need", UNTESTED, {"budgets": (500,)}, "no case"),
    (
        "H-DE, H-PSO, DE and PSO",
        MOSTLY,
        {"error": with_(last, at("de", 39, 1500))},
        "H-PSO: best ranked is (39,500), p = 1;",
    ),
    (
        "H-DE, H-PSO, DE and PSO",
        DIFFERS,
        {"error": with_(last, lambda c: at("de", 39, 1500)(c) or at("h-pso", 39, 1500)(c))},
        "H-PSO: best ranked is (39,500), p = 3.4e-07;",
    ),
    ("H-DE, H-PSO, DE and PSO", UNTESTED, {"budgets": (500, 1500)}, "no case"),
    ("Gestures", DIFFERS, {"error": with_(easy, boxing)}, "Box 407.0 mm"),
    ("Gestures", UNTESTED, {"sequences": SEQUENCES[:6]}, "no case"),
    ("Errors spread", DIFFERS, {"spread": with_(as_ever, boxing, spread)}, "Box 9.0 mm"),
    ("Errors spread", UNTESTED, {"sequences": SEQUENCES[3:]}, "no case"),
    ("Subject S3", DIFFERS, {"error": with_(hard, lambda c: c.sequence.startswith("S2"))}, "made so: S3's"),
    ("Subject S3", UNTESTED, {"sequences": ("S1/Box", "S2/Box")}, "no case"),
    ("More evaluations", MOSTLY, {"spread": with_(as_ever, one_of("de", "pso", "apf"), spread)}, "in 90 of 144"),
    (
        "More evaluations",
        DIFFERS,
        {"spread": with_(as_ever, one_of("de", "pso", "apf", "cmaes"), spread)},
        "in 72 of 144",
    ),
    ("More evaluations", UNTESTED, {"budgets": (500,)}, "no case"),
    ("CMAES tracks", MOSTLY, {"jerk": with_(smooth, one_of("de"), jerk)}, "CMAES 100 m/s³, DE 50 m/s³, PSO 200 m/s³"),
    ("CMAES tracks", DIFFERS, {"jerk": with_(smooth, one_of("de", "h-pso"), jerk)}, "H-PSO 50 m/s³"),
    ("CMAES tracks", UNTESTED, {"algorithms": ("de", "h-pso", "apf")}, "no case"),
]


def finding_of(study, claim, measure="marker_error", by=None):
    findings = check_claims(study, MEASURE[measure])
    (found,) = [each for each in findings if each.claim.startswith(claim) and by in (None, each.by)]
    return found


def test_all_agrees_where_all_that_the_paper_says_holds():
    findings = check_claims(planted(), MEASURE["marker_error"])
    assert len(findings) == 14
    assert {finding.verdict for finding in findings} == {AGREES}
    assert {finding.claim.split()[0] for finding in findings} >= {claim.split()[0] for claim, *_ in VERDICTS}


@pytest.mark.parametrize(("claim", "verdict", "table", "evidence"), VERDICTS, ids=[f"{v[0]}: {v[1]}" for v in VERDICTS])
def test_every_verdict_has_a_table(claim, verdict, table, evidence):
    found = finding_of(planted(**table), claim)
    assert found.verdict == verdict
    assert evidence in found.evidence


def test_where_more_is_better_the_same_holds():
    """By an overlap that falls as the error grows."""
    study = planted(iou=lambda cell: 1 - error(cell) / 2000)
    verdicts = [found.verdict for found in check_claims(study, MEASURE["iou"]) if found.by == "overlap (IoU)"]
    assert verdicts == [AGREES] * 13
    gain = finding_of(study, "39 degrees", "iou").evidence
    assert "H-CMAES 3 of 3 (+0.005)" in gain


def test_rankings_are_judged_by_fitness_beside_error():
    """39 degrees of freedom fit the masks better and the markers worse: two verdicts, each with its measure's name."""
    study = planted(error=with_(other_model, one_of(*EVOLUTIONARY)), cost=lambda cell: error(cell) / 1e4)
    by_error, by_fitness = (
        finding_of(study, "39 degrees", by=by) for by in ("marker error (Eq. 20 from own answer)", "fitness (Eq. 5)")
    )
    assert (by_error.verdict, by_fitness.verdict) == (DIFFERS, AGREES)
    findings = check_claims(study, MEASURE["marker_error"])
    place = findings.index(by_error)
    assert findings[place + 1] == by_fitness
    assert len([finding for finding in findings if finding.by == "fitness (Eq. 5)"]) == 9
    alone = check_claims(study, MEASURE["cost"])
    assert [finding.by for finding in alone].count("fitness (Eq. 5)") == 13


@pytest.mark.parametrize("sequences", [("S1/Walking",), ("S1/Walking", "S2/Box")])
def test_a_sequence_or_two_do_not_judge(sequences):
    findings = check_claims(planted(sequences=sequences), MEASURE["marker_error"])
    assert {found.verdict for found in findings} == {TOO_FEW, UNTESTED}
    ranked = [found for found in findings if found.claim.startswith("H-CMAES has the best")]
    assert ranked[0].verdict == TOO_FEW
    words = {1: "one sequence", 2: "two sequences"}[len(sequences)]
    assert ranked[0].evidence == f"Too few for that: {words}."


def test_significance_of_two_algorithms_needs_more_sequences_than_of_eight():
    """Over three sequences the worst of eight may differ significantly from the best, but one of two never."""
    both = planted(sequences=SEQUENCES[:3], algorithms=("h-cmaes", "apf"))
    assert finding_of(both, "In all cases the part").verdict == TOO_FEW
    assert finding_of(both, "H-CMAES has the best").verdict == AGREES
    assert finding_of(planted(sequences=SEQUENCES[:3]), "In all cases the part").verdict == AGREES


def test_a_tie_for_the_first_place_is_one_whoever_is_listed_first():
    def level(cell):
        return error(Cell(cell.sequence, "h-cmaes", cell.dof, cell.evaluations))

    shared = planted(error=with_(level, at("h-pso", 39, 500)))
    found = finding_of(shared, "H-CMAES has the best")
    assert (found.verdict, found.evidence) == (FAILS, "First in 5 of 6. 1 tie.")
    everywhere = finding_of(planted(error=with_(level, one_of("h-pso"))), "H-CMAES has the best")
    assert (everywhere.verdict, everywhere.evidence) == (TIED, "First in 0 of 6. 6 ties.")


def test_models_that_are_level_are_tied():
    found = finding_of(planted(error=lambda cell: error(Cell(cell.sequence, cell.algorithm, 39, 500))), "39 degrees")
    assert found.verdict == TIED
    assert found.evidence.endswith("18 ties.")


# Made-up results


def test_claims_are_checked_not_assumed():
    """The made-up study agrees with the paper; with two algorithms' results exchanged it no longer does."""
    results = list(made_up_study(seeds=3, frames=30))
    findings = check_claims(StudySummary.of(results), MEASURE["marker_error"])
    of = {finding.claim: finding.verdict for finding in findings}
    assert sum(verdict == AGREES for verdict in of.values()) >= 9
    exchange = {"h-cmaes": "apf", "apf": "h-cmaes"}
    swapped = [
        replace(result, cell=replace(result.cell, algorithm=exchange.get(result.cell.algorithm, result.cell.algorithm)))
        for result in results
    ]
    verdicts = [finding.verdict for finding in check_claims(StudySummary.of(swapped), MEASURE["marker_error"])]
    assert verdicts[0] == FAILS
    assert verdicts.count(AGREES) < sum(verdict == AGREES for verdict in of.values())
    alone = StudySummary.of(made_up_study(("S1/Box",), ("de",), (39,), (500,), seeds=2, frames=10))
    assert {finding.verdict for finding in check_claims(alone, MEASURE["marker_error"])} == {UNTESTED}


def test_subjects_are_not_taken_for_actions():
    """S3 boxing alone is no evidence that S3 is hard."""
    study = StudySummary.of(made_up_study(("S1/Walking", "S2/Gestures", "S3/Box"), models=(39,), seeds=2, frames=10))
    assert finding_of(study, "Subject S3").verdict == UNTESTED


def test_which_of_the_two_radii_loses_the_limbs():
    others = with_lost_limbs({"common": 1, "paper-rotation": 12, "paper-translation": 2, "paper": 15})
    searches = made_up_study(SEQUENCES[:3], ("h-cmaes", "de"), (39,), (500, 3000), seeds=3, frames=20)
    (sentence,) = which_half(StudySummary.of([*searches, *others]))
    assert "60.0 % with 0.5 rad and 0.02 m; 10.0 % with 0.02 rad and 0.5 m; 75.0 % with 0.5 of both" in sentence
    assert (
        "With 0.5 rad and 0.02 m limbs are lost in 5 % more of the frames, or above that: H-CMAES, DE; less: none."
        in sentence
    )


def test_the_script_prints_a_table(tmp_path, capsys):
    for result in made_up_study(SEQUENCES[:3], ("h-cmaes", "de"), (39,), (500,), seeds=2, frames=12):
        write_cell(result_path(tmp_path, result.cell, "0" * 20), result)
    assert main([str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert (
        "| H-CMAES has the best average rank for either model and every budget. | Tables 4-5 | MPJPE | agrees |" in out
    )
    assert main([str(tmp_path / "none")]) == 3
