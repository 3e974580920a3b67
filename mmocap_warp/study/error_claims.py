"""Claims of the paper's section 5.3 about tracking errors, and what judges each of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mmocap_warp.study.summary import MEASURES, CellSummary, Measure, StudySummary
from mmocap_warp.study.tracker_labels import algorithm_label
from mmocap_warp.study.verdicts import UNTESTED, judged, with_unit


def error_claims(study: StudySummary, measure: Measure) -> tuple[tuple[str, Measure, tuple[str, str]], ...]:
    """What the paper says of errors in section 5.3, the measure that judges it, and the verdict with its evidence."""
    jerk = next(measure for measure in MEASURES if measure.key == "jerk")
    return (
        ("Gestures are tracked best.", measure, _gestures_first(study, measure)),
        ("Errors spread least in gestures and most in boxing.", measure, _boxing_spreads(study, measure)),
        ("Subject S3 is the hardest.", measure, _subjects(study, measure)),
        ("More evaluations narrow the errors’ spread.", measure, _narrower(study, measure)),
        ("CMAES tracks more evenly over time than DE and PSO, whose bodies vibrate.", jerk, _steadier(study, jerk)),
    )


def _gestures_first(study: StudySummary, measure: Measure) -> tuple[str, str]:
    return _in_order(_by_part(study, measure, 1, _mean), [("Gestures", "Walking"), ("Gestures", "Box")], measure)


def _boxing_spreads(study: StudySummary, measure: Measure) -> tuple[str, str]:
    """By the interquartile range over all frames of all runs; the less, the better, whatever the measure."""
    of = _by_part(study, measure, 1, _quartile_range)
    return _in_order(of, [("Gestures", "Walking"), ("Walking", "Box")], replace(measure, higher_is_better=False))


def _subjects(study: StudySummary, measure: Measure) -> tuple[str, str]:
    of = _by_part(study, measure, 0, _mean)
    verdict, evidence = _in_order(of, [("S1", "S3"), ("S2", "S3")], measure)
    made_so = " The shipped sequences are made so: S3's tracked body and masks are the worst."
    return verdict, evidence if verdict == UNTESTED else evidence + made_so


def _in_order(of: dict[str, float], pairs: list[tuple[str, str]], measure: Measure) -> tuple[str, str]:
    """Whether the first of each pair is better, where the study has all of them."""
    if not {name for pair in pairs for name in pair} <= of.keys():
        return judged([], "")
    sign = -1 if measure.higher_is_better else 1
    cases = [sign * (of[worse] - of[better]) for better, worse in pairs]
    return judged(cases, ", ".join(f"{name} {with_unit(of[name], measure)}" for name in sorted(of)) + ".")


def _narrower(study: StudySummary, measure: Measure) -> tuple[str, str]:
    """The least budget's interquartile range against the largest's, for every algorithm and model."""
    least, most = study.budgets[0], study.budgets[-1]
    cases = []
    for name in study.algorithms:
        for dof in study.models:
            for sequence in study.sequences:
                few, many = (study.find(sequence, name, dof, budget) for budget in (least, most))
                if few and many and least < most and measure.key in few.spread and measure.key in many.spread:
                    cases.append(_quartile_range(few, measure) - _quartile_range(many, measure))
    text = f"From {least} to {most} evaluations the interquartile range shrinks in {{held}} of {{cases}} cells."
    return judged(cases, text)


def _steadier(study: StudySummary, measure: Measure) -> tuple[str, str]:
    of = {name: _level(study, measure, name) for name in ("cmaes", "de", "pso", "h-cmaes", "h-de", "h-pso")}
    pairs = [("cmaes", "de"), ("cmaes", "pso"), ("h-cmaes", "h-de"), ("h-cmaes", "h-pso")]
    cases = [of[other] - of[mine] for mine, other in pairs if np.isfinite(of[mine]) and np.isfinite(of[other])]
    known = [f"{algorithm_label(name)} {with_unit(value, measure)}" for name, value in of.items() if np.isfinite(value)]
    return judged(cases, f"Jerk: {', '.join(known)}.")


def _level(study: StudySummary, measure: Measure, algorithm: str) -> float:
    """Mean of a measure over an algorithm's cells of the grid; NaN where there is none."""
    values = [
        _mean(study.cells[cell], measure)
        for cell in study.grid
        if measure.key in study.cells[cell].runs and cell.algorithm == algorithm
    ]
    return float(np.mean(values)) if values else np.nan


def _by_part(
    study: StudySummary, measure: Measure, part: int, of: Callable[[CellSummary, Measure], float]
) -> dict[str, float]:
    """Mean over cells of ``of``, by the subject (part 0) or the action (part 1) of the sequences' names.

    Empty unless every subject was tracked in every action, as else one would be taken for the other.
    """
    names = [tuple(sequence.split("/")) for sequence in study.sequences if sequence.count("/") == 1]
    if len(names) != len({name[0] for name in names}) * len({name[1] for name in names}):
        return {}
    values: dict[str, list[float]] = {}
    for cell in study.grid:
        parts, summary = cell.sequence.split("/"), study.cells[cell]
        if len(parts) == 2 and measure.key in summary.spread:
            values.setdefault(parts[part], []).append(of(summary, measure))
    return {name: float(np.mean(found)) for name, found in values.items()}


def _mean(cell: CellSummary, measure: Measure) -> float:
    return float(cell.runs[measure.key].mean())


def _quartile_range(cell: CellSummary, measure: Measure) -> float:
    spread = cell.spread[measure.key]
    return float(spread[3] - spread[1])
