"""The report's sections, each a piece of HTML that reads without its script."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from mmocap_warp.study import paper
from mmocap_warp.study.overview import rank_pairs
from mmocap_warp.study.report_claims import check_claims
from mmocap_warp.study.report_figures import (
    box_figure,
    curve_figure,
    growth_figure,
    legend,
    rank_figure,
    shown_others,
)
from mmocap_warp.study.report_overlays import Picture
from mmocap_warp.study.report_tables import (
    beside_table,
    difference_table,
    effect_table,
    floor_note,
    grid_table,
    ranking_table,
    sequence_table,
)
from mmocap_warp.study.study_tables import Ranking, by_algorithm, by_model, model_differences
from mmocap_warp.study.summary import Contender, Measure, StudySummary
from mmocap_warp.study.tracker_labels import algorithm_label
from mmocap_warp.study.wording import extent, listed, named, with_unit


class Section:
    """A part of the page.

    Args:
        anchor: its place in the page's address.
        title: its heading.
        parts: HTML; empty ones are left out.
    """

    def __init__(self, anchor: str, title: str, *parts: str) -> None:
        self.anchor, self.title = anchor, title
        self.content = "".join(part for part in parts if part)

    def html(self) -> str:
        """The section with its heading."""
        return f'<section id="{self.anchor}"><h2>{escape(self.title)}</h2>{self.content}</section>'


def choice(content: str, *, default: bool, **keys: object) -> str:
    """A part that shows while the controls stand at ``keys``; at first, and without the script, the default one."""
    data = "".join(f' data-{name}="{escape(str(value))}"' for name, value in keys.items())
    return f'<div class="choice"{data}{"" if default else " hidden"}>{content}</div>'


def claims_section(study: StudySummary, measure: Measure) -> Section:
    """What agrees with the paper, what does not."""
    items = "".join(
        f'<li><span class="verdict {finding.verdict.split()[0]}">{finding.verdict}</span>'
        f"<div><p>{escape(finding.claim)} <small>{escape(finding.where)}; here by {escape(finding.by)}</small></p>"
        f'<p class="evidence">{escape(finding.evidence)}</p></div></li>'
        for finding in check_claims(study, measure)
    )
    note = (
        f"Each of the paper’s findings, checked on this study’s {named(measure)}; those of the rankings on the fitness "
        "as well, by which the paper’s section 5.4 ranks. A claim of all cases fails with the first exception. The "
        "paper’s own sequences are HumanEva-I’s; where others were tracked, a difference may be theirs."
    )
    return Section("claims", "What agrees with the paper", f"<p>{note}</p>", f'<ul class="claims">{items}</ul>')


def ranks_section(study: StudySummary) -> Section:
    """Tables 4 and 5."""
    parts = []
    for number, dof in enumerate(study.models, 4):
        for measure in study.measures:
            found = [by_algorithm(study, measure, dof, budget) for budget in study.budgets]
            rankings = [ranking for ranking in found if ranking is not None]
            if not rankings:
                continue
            size = _extent(study, dof)
            caption = f"{dof}-DOF model, ranked by {named(measure)}, as Table {number} of the paper. {size}."
            effects = "".join(effect_table(ranking) for ranking in rankings) + beside_table(study, measure)
            in_paper = any(paper.printed_ranks(dof, budget) for budget in study.budgets)
            diamonds = "; diamonds are the paper" if in_paper else ""
            panels = "".join(f"<div>{rank_figure(ranking, study.algorithms)}</div>" for ranking in rankings)
            content = (
                f'<figure><div class="panels">{panels}</div>'
                f"<figcaption>Average ranks, {dof} DOF, by {named(measure)}; 1 is the best. Dots are this study, with "
                f"95 % intervals over seeds{diamonds}. {size}.</figcaption></figure>"
                + ranking_table(rankings, caption)
                + _paragraph(floor_note(study, measure, rankings[0].sequences))
                + _left_out(rankings)
                + f"<details><summary>Intervals and effect sizes, {dof} DOF</summary>{_EFFECTS}{effects}</details>"
            )
            parts.append(choice(content, default=measure == study.measures[0], measure=measure.key))
    pairs = [table for dof in study.models if (table := rank_pairs(study, dof)) is not None]
    parts += [grid_table(table.caption, table.head, table.rows, "compared") for table in pairs]
    note = (
        "Average rank over the sequences, of each algorithm’s mean over runs. Friedman’s test asks whether any differ; "
        "p-values compare each algorithm with the best ranked, the control, and are bold where Holm’s procedure "
        f"rejects equality at 0.05. This study is judged by {named(study.measures[0])}; the list at the top chooses "
        "another measure."
    )
    return Section("ranks", "Ranking", f"<p>{note}</p>", *parts)


def spread_section(study: StudySummary) -> Section:
    """Fig. 7, and our trackers in the same way."""
    parts = []
    ours = [who.algorithm for who in study.others]
    for measure in study.measures:
        for budget in study.budgets:
            halves = [
                (title, names, [Contender(name, dof, budget) for name in names for dof in study.models])
                for title, names in (
                    ("Hierarchical algorithms", study.hierarchical),
                    ("Holistic algorithms", study.holistic),
                )
            ]
            shown = [
                _spread(study, measure, f"{title}, {budget:,} evaluations per frame", names, kinds)
                for title, names, kinds in halves
            ]
            content = "".join(shown) or f"<p>{measure.label} is one number a run: see the table.</p>"
            table = sequence_table(study, measure, budget)
            content += f"<details><summary>The numbers by sequence</summary>{table}</details>"
            default = measure == study.measures[0] and budget == study.budgets[0]
            parts.append(choice(content, default=default, measure=measure.key, budget=budget))
        own = _spread(study, measure, "Our trackers, at their own budgets", ours, study.others) if ours else ""
        if own:
            parts.append(choice(own, default=measure == study.measures[0], measure=measure.key))
    note = (
        "Over all frames of all runs, as in the paper’s Fig. 7: a box holds the middle half, its line is the median, "
        "whiskers reach to the extremes. An arrow ends a whisker that leaves the axis. Dotted rules are the medians of "
        "the baselines, where the axis reaches that far."
    )
    return Section("spread", "Spread by sequence", f"<p>{note}</p>", *parts)


def _spread(study: StudySummary, measure: Measure, title: str, names: list[str], kinds: list[Contender]) -> str:
    """One half of Fig. 7 with its caption; empty where there is nothing to draw."""
    drawing = box_figure(study, measure, title, kinds) if measure.per_frame else ""
    if not drawing:
        return ""
    size = extent(cell for who in kinds for cell in study.known(who, study.sequences, measure).values())
    return (
        f'<figure><div class="wide">{drawing}</div><figcaption>{escape(title)}{_models_key(study, kinds)} {size}.'
        f"</figcaption>{legend([*dict.fromkeys(names)])}</figure>"
    )


def curves_section(study: StudySummary) -> Section:
    """Fig. 10, which is Eq. 20, beside the main measure and the overlap; and how errors grow over whole clips."""
    beside = ("eq20_as_printed", "iou")
    main = study.measures[0]
    measures = [measure for measure in study.measures if measure == main or measure.key in beside]
    first = (study.models[0], study.budgets[0], study.sequences[0])
    parts, grown = [], []
    for dof in study.models:
        for budget in study.budgets:
            drawing = growth_figure(study, main, dof, budget)
            if drawing:
                caption = (
                    f"{main.label} in each tenth of the clips: the median over runs, mean over "
                    f"{len(study.sequences)} sequences, {dof} DOF, {budget:,} evaluations per frame. "
                    f"{_extent(study, dof, budget)}."
                )
                content = f'<div class="wide">{drawing}</div><figcaption>{escape(caption)}</figcaption>'
                grown.append(choice(content, default=(dof, budget) == first[:2], model=dof, budget=budget))
            for measure in measures:
                for sequence in study.sequences:
                    drawing = curve_figure(study, measure, sequence, dof, budget)
                    if not drawing:
                        continue
                    size = _extent(study, dof, budget, sequence)
                    caption = f"{measure.label}, {sequence}, {dof} DOF, {budget:,} evaluations per frame. {size}."
                    content = f'<div class="wide">{drawing}</div><figcaption>{escape(caption)}</figcaption>'
                    default = measure == main and (dof, budget, sequence) == first
                    keys = {"curve": measure.key, "sequence": sequence, "model": dof, "budget": budget}
                    parts.append(choice(content, default=default, **keys))
    ours = (
        " Of our trackers, those with the body solved where they were run; at their own budgets."
        if study.others
        else ""
    )
    note = (
        "The median over runs; the paper’s Fig. 10 has one run and shows Eq. 20. Gaps have no truth. For other "
        f"measures than these the main one stays.{ours} Axes are logarithmic where values are far apart."
    )
    marks = legend([*study.algorithms, *shown_others(study)])
    figures = f"<figure>{''.join(parts)}{marks}</figure>"
    over_clips = f"<figure>{''.join(grown)}{marks}</figure>" if grown else ""
    return Section("curves", "Error over time", f"<p>{note}</p>", over_clips, figures)


def _extent(study: StudySummary, dof: int, budget: int | None = None, sequence: str | None = None) -> str:
    """How many seeds and frames the grid's cells of a model have."""
    cells = [
        study.cells[cell]
        for cell in study.grid
        if cell.dof == dof and budget in (None, cell.evaluations) and sequence in (None, cell.sequence)
    ]
    return extent(cells)


def overlays_section(
    extremes: Sequence[tuple[Picture, Picture]], rows: Sequence[Sequence[Picture]], measure: Measure, setting: str
) -> Section | None:
    """Fig. 8 and 9; None where no recording is at hand."""
    if not extremes and not rows:
        return None
    pairs = "".join(
        f'<figure class="pair"><div>{_picture(best, measure, "best")}{_picture(worst, measure, "worst")}</div>'
        f"<figcaption>{escape(f'{best.sequence}, {algorithm_label(best.algorithm)}')}</figcaption></figure>"
        for best, worst in extremes
    )
    strips = "".join(
        f'<figure class="strip"><figcaption>{escape(algorithm_label(row[0].algorithm))}</figcaption>'
        f"<div>{''.join(_picture(picture, measure) for picture in row)}</div></figure>"
        for row in rows
        if row
    )
    note = (
        f"{setting} Of each sequence, the best and the worst frame of the typical run, the one in the middle of all "
        "seeds; the first tenth, which starts from a given pose, is left out. The view is the one in which body and "
        "mask agree least."
    )
    key = (
        '<ul class="legend key"><li class="seen">mask</li><li class="model">tracked body</li>'
        '<li class="left">left limbs</li><li class="right">right limbs</li></ul>'
    )
    side = ""
    if strips:
        side = f"<h3>The same frames of {escape(rows[0][0].sequence)} by every algorithm</h3>"
        side += f'<div class="strips">{strips}</div>'
    return Section(
        "frames", "Best and worst frames", f"<p>{escape(note)}</p>", key, f'<div class="pairs">{pairs}</div>', side
    )


def models_section(study: StudySummary) -> Section | None:
    """Tables 6 and 7; None with one model and one budget."""
    parts = []
    halves = ((6, "hierarchical", study.hierarchical), (7, "holistic", study.holistic))
    for measure in study.measures:
        tables = []
        for number, kind, names in halves:
            found = [by_model(study, measure, name) for name in names]
            rankings = [ranking for ranking in found if ranking is not None]
            if rankings:
                size = extent(study.cells[cell] for cell in study.grid if cell.algorithm in names)
                caption = f"The {kind} algorithms by {named(measure)}, as Table {number} of the paper. {size}."
                tables.append(ranking_table(rankings, caption) + _left_out(rankings))
        differences = model_differences(study, measure)
        if differences:
            tables.append(difference_table(differences, measure, study.models))
        if tables:
            parts.append(choice("".join(tables), default=measure == study.measures[0], measure=measure.key))
    if not parts:
        return None
    note = (
        "Each algorithm against itself with the other model and other budgets, ranked over the sequences. Of these "
        "tables the paper’s numbers are not to be had, only what it concludes from them; their layout is deduced."
    )
    return Section("models", f"{' against '.join(map(str, study.models))} degrees of freedom", f"<p>{note}</p>", *parts)


_EFFECTS = (
    "<p>Intervals are bootstrapped over seeds, the sequences held. A is Vargha and Delaney’s: the chance that a run of "
    "the control is better than one of this algorithm, mean over sequences; 0.5 means no difference.</p>"
)


def _paragraph(text: str) -> str:
    return f"<p>{escape(text)}</p>" if text else ""


def _picture(picture: Picture, measure: Measure, title: str = "") -> str:
    value = with_unit(picture.error, measure) if np.isfinite(picture.error) else "no truth"
    prefix = f"<b>{title}</b> " if title else ""
    return (
        f'<figure class="picture">{picture.drawing}<figcaption>{prefix}{escape(value)}'
        f" <small>frame {picture.frame}, {escape(picture.camera)}</small></figcaption></figure>"
    )


def _models_key(study: StudySummary, kinds: Sequence[Contender]) -> str:
    models = sorted({who.dof for who in kinds}, reverse=True)
    if len(models) < 2:
        return f", {models[0]} DOF."
    return f". Filled: {study.models[0]} DOF, hollow: {listed(study.models[1:])} DOF."


def _left_out(rankings: Sequence[Ranking]) -> str:
    notes = [
        f"{', '.join(map(str, ranking.absent))} tracked too few sequences for a ranking."
        for ranking in rankings
        if ranking.absent
    ]
    for ranking in rankings:
        if ranking.left_out:
            among = ranking.rows[0].contender
            missing = ", ".join(ranking.left_out)
            notes.append(f"Not all in the ranking of {among} have tracked {missing}: left out of the ranking.")
    return f'<p class="warning">{escape(" ".join(notes))}</p>' if notes else ""
