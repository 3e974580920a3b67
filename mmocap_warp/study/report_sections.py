"""The report's sections, each a piece of HTML that reads without its script."""

from collections.abc import Mapping, Sequence
from functools import partial
from itertools import product

import numpy as np

from mmocap_warp.study import overview, paper, report_figures, report_tables
from mmocap_warp.study.report_parts import Html, Section, by_measure, choice, drawn, fill, html_of
from mmocap_warp.study.source import Clip
from mmocap_warp.study.study_tables import Ranking, algorithm_rankings, by_algorithm, model_differences, model_rankings
from mmocap_warp.study.summary import Contender, Measure, StudySummary, algorithm_label
from mmocap_warp.study.wording import counted, extent, listed, named, over, with_unit


def trackers_section(study: StudySummary) -> Section | None:
    """Error against time, our tracker against the others' best, and everything in one table; None for a grid alone."""
    main, parts = study.measures[0], [fill("trackers")]
    placed = {} if main.higher_is_better else report_figures.times_and_errors(study, main)
    table = overview.lead_table(study, study.sequences)
    if not placed and table is None and not study.baselines:
        return None
    if placed:
        size = extent(study.cells_of([each for each in study.contenders if each.algorithm in placed], main))
        words = {"measure": main.label, "sequences": over(study.sequences), "dof": study.models[0], "extent": size}
        words |= {"budgets": listed(study.budgets), "seconds": f"{paper.SECONDS_PER_500:g}"}
        caption = fill("trackers-caption", **words)
        drawing = drawn(report_figures.time_error_figure(study, main), caption)
        parts.append(fill("figure", content=[drawing, report_figures.legend([*placed])]))
    if table is not None:
        parts += [fill("paragraph", text=_lead_sentence(study)), table.html()]
    return Section("trackers", "Error against time, all trackers", [*parts, overview.all_trackers(study).html()])


def _lead_sentence(study: StudySummary) -> str:
    """On how many sequences our tracker has half the best one's error in a tenth of its time."""
    found = overview.leads(study, study.sequences)
    timed, not_half = [lead for lead in found if lead.timed], [lead.sequence for lead in found if not lead.half]
    sentence = (
        f"{algorithm_label(found[0].ours.algorithm)} has at most half the {named(study.measures[0])} of the best of "
        f"the others on {len(found) - len(not_half)} of {counted(len(found), 'sequence')} "
        f"({listed(sorted({lead.best.evaluations for lead in found}))} evaluations)"
    )
    if timed:
        fast = sum(lead.tenth for lead in timed)
        sentence += f", and takes at most a tenth of its time on {fast} of {len(timed)}"
    return f"{sentence}." + (f" Not half of it: {', '.join(not_half)}." if not_half else "")


def ranks_section(study: StudySummary) -> Section:
    """Tables 4 and 5."""
    parts: list[str] = [fill("ranks", measure=named(study.measures[0]))]
    for number, dof in enumerate(study.models, 4):
        parts += by_measure(study, partial(_ranked, study, number, dof))
    for dof in study.models:
        parts += html_of(overview.rank_pairs(study, dof))
    return Section("ranks", "Ranking", parts)


def _ranked(study: StudySummary, number: int, dof: int, measure: Measure) -> str:
    """Rankings of a model by a measure: the figure, the table with its notes, and the effects' sizes."""
    rankings = algorithm_rankings(study, measure, dof)
    if not rankings:
        return ""
    size, in_paper = extent(study.of_grid(dof=dof)), any(paper.printed_ranks(dof, budget) for budget in study.budgets)
    panels = [fill("panel", drawing=[report_figures.rank_figure(ranking, study.algorithms)]) for ranking in rankings]
    diamonds = "; diamonds are the paper" if in_paper else ""
    words = {"dof": dof, "measure": named(measure), "diamonds": diamonds, "extent": size}
    figure = fill("rank-panels", panels=panels, **words)
    caption = f"{dof}-DOF model, ranked by {named(measure)}, as Table {number} of the paper. {size}."
    table = report_tables.ranking_table(rankings, caption).html()
    floor = report_tables.floor_note(study, measure, rankings[0].sequences)
    effects: list[str] = [fill("effects"), *(report_tables.effect_table(ranking).html() for ranking in rankings)]
    effects += html_of(report_tables.unranked_table(study, measure))
    details = fill("details", summary=f"Intervals and effect sizes, {dof} DOF", content=effects)
    return figure + table + (fill("paragraph", text=floor) if floor else "") + _left_out(rankings) + details


def spread_section(study: StudySummary) -> Section:
    """Fig. 7, and our trackers in the same way."""
    parts: list[str] = [fill("spread")]
    halves = (("Hierarchical algorithms", study.hierarchical), ("Holistic algorithms", study.holistic))
    for measure in study.measures:
        for budget in study.budgets:
            content = ""
            for title, names in halves:
                kinds = [Contender(name, dof, budget) for name in names for dof in study.models]
                content += _spread(study, measure, f"{title}, {budget:,} evaluations per frame", kinds)
            content = content or fill("paragraph", text=f"{measure.label} is one number a run: see the table.")
            table = report_tables.sequence_table(study, measure, budget).html()
            content += fill("details", summary="The numbers by sequence", content=table)
            parts.append(choice(study, content, measure=measure.key, budget=budget))
        own = _spread(study, measure, "Our trackers, at their own budgets", study.others)
        parts += [choice(study, own, measure=measure.key)] if own else []
    return Section("spread", "Spread by sequence", parts)


def _spread(study: StudySummary, measure: Measure, title: str, kinds: Sequence[Contender]) -> str:
    """One half of Fig. 7 with its caption; empty where there is nothing to draw."""
    drawing = report_figures.box_figure(study, measure, title, kinds) if measure.per_frame else ""
    if not drawing:
        return ""
    models = sorted({who.dof for who in kinds}, reverse=True)
    several = f". Filled: {study.models[0]} DOF, hollow: {listed(study.models[1:])} DOF." if len(models) > 1 else ""
    model = several or f", {models[0]} DOF."
    figure = drawn(drawing, f"{title}{model} {extent(study.cells_of(kinds, measure))}.")
    return fill("figure", content=[figure, report_figures.legend([*dict.fromkeys(who.algorithm for who in kinds)])])


def curves_section(study: StudySummary) -> Section:
    """Fig. 10, which is Eq. 20, beside the main measure and the overlap; and how errors grow over whole clips."""
    main = study.measures[0]
    measures = [measure for measure in study.measures if measure == main or measure.key in ("eq20_as_printed", "iou")]
    parts, grown = [], []
    for dof, budget in product(study.models, study.budgets):
        setting = f"{dof} DOF, {budget:,} evaluations per frame"
        if drawing := report_figures.growth_figure(study, main, dof, budget):
            caption = (
                f"{main.label} in each tenth of the clips: the median over runs, mean over {len(study.sequences)} "
                f"sequences, {setting}. {extent(study.of_grid(dof=dof, evaluations=budget))}."
            )
            grown.append(choice(study, drawn(drawing, caption), model=dof, budget=budget))
        for measure, sequence in product(measures, study.sequences):
            if drawing := report_figures.curve_figure(study, measure, sequence, dof, budget):
                size = extent(study.of_grid(dof=dof, evaluations=budget, sequence=sequence))
                keys = {"curve": measure.key, "sequence": sequence, "model": dof, "budget": budget}
                parts.append(choice(study, drawn(drawing, f"{measure.label}, {sequence}, {setting}. {size}."), **keys))
    ours = " Of our trackers, those with the body solved where they were run; at their own budgets."
    marks = report_figures.curves_legend(study)
    figures = [fill("figure", content=[*curves, marks]) for curves in (grown, parts) if curves or curves is parts]
    return Section("curves", "Error over time", [fill("curves", ours=ours if study.others else ""), *figures])


def overlays_section(study: StudySummary, clips: Mapping[str, Clip]) -> Section | None:
    """Fig. 8 and 9: the control with the larger model and the least budget; None where no recording is at hand."""
    from mmocap_warp.study.report_overlays import Picture, best_and_worst, side_by_side

    main, dof, budget = study.measures[0], study.models[0], study.budgets[0]
    ranking = by_algorithm(study, main, dof, budget)
    at_hand = [name for name in study.sequences if name in clips]
    extremes = list(best_and_worst(study, main, ranking, clips)) if ranking and at_hand else []
    rows = side_by_side(study, at_hand[0], dof, budget, clips[at_hand[0]]) if ranking and at_hand else []
    if not extremes and not rows:
        return None

    def picture(drawn: Picture, title: str = "") -> Html:
        error = with_unit(drawn.error, main) if np.isfinite(drawn.error) else "no truth"
        bold = Html(f"<b>{title}</b> " if title else "")
        return fill("picture", **vars(drawn) | {"drawing": [drawn.drawing], "title": bold, "error": error})

    pairs = []
    for best, worst in extremes:
        both, who = [picture(best, "best"), picture(worst, "worst")], algorithm_label(best.algorithm)
        pairs.append(fill("pair", pictures=both, sequence=best.sequence, algorithm=who))
    strips = [fill("strip", algorithm=algorithm_label(row[0].algorithm), pictures=[*map(picture, row)]) for row in rows]
    parts = [fill("overlays", dof=dof, budget=f"{budget:,}", pairs=pairs)]
    parts += [fill("strips", sequence=rows[0][0].sequence, strips=strips)] if strips else []
    return Section("frames", "Best and worst frames", parts)


def models_section(study: StudySummary) -> Section | None:
    """Tables 6 and 7; None with one model and one budget."""

    def tables(measure: Measure) -> str:
        content = ""
        for number, kind, names in ((6, "hierarchical", study.hierarchical), (7, "holistic", study.holistic)):
            if rankings := model_rankings(study, measure, names):
                size = extent(study.cells[cell] for cell in study.grid if cell.algorithm in names)
                caption = f"The {kind} algorithms by {named(measure)}, as Table {number} of the paper. {size}."
                content += report_tables.ranking_table(rankings, caption).html() + _left_out(rankings)
        differences = model_differences(study, measure)
        table = report_tables.difference_table(differences, measure, study.models) if differences else None
        return "".join([content, *html_of(table)])

    parts = by_measure(study, tables)
    title = f"{' against '.join(map(str, study.models))} degrees of freedom"
    return Section("models", title, [fill("models"), *parts]) if parts else None


def _left_out(rankings: Sequence[Ranking]) -> str:
    absent = [", ".join(map(str, each.absent)) for each in rankings if each.absent]
    notes = [f"{names} tracked too few sequences for a ranking." for names in absent]
    gaps = [(each.rows[0].contender, ", ".join(each.left_out)) for each in rankings if each.left_out]
    notes += [f"Not all in the ranking of {who} have tracked {names}: left out of the ranking." for who, names in gaps]
    return fill("warning", text=" ".join(notes)) if notes else ""


def presets_section(study: StudySummary) -> Section | None:
    """The other presets beside the main one, by budget; None with one preset."""

    def tables(measure: Measure) -> str:
        beside = [measure, overview.LOST_LIMB] if measure == study.measures[0] else [measure]
        return "".join(table.html() for each in beside for table in overview.radii_tables(study, each))

    parts = by_measure(study, tables)
    radii = fill("paragraph", text=" ".join(overview.radii(study)))
    return Section("presets", "Search radii", [radii, *parts]) if parts else None


def strangers_section(study: StudySummary) -> Section | None:
    """People outside the family of the tracker's bodies; None where none was tracked."""
    main, dof, budget = study.measures[0], study.models[0], study.budgets[0]
    parts = by_measure(study, lambda measure: "".join(html_of(overview.strangers_table(study, measure))))
    parts += html_of(overview.lead_table(study, study.strangers))
    for name in study.strangers:
        if drawing := report_figures.curve_figure(study, main, name, dof, budget):
            size = extent(summary for cell, summary in study.cells.items() if cell.sequence == name)
            caption = f"{main.label}, {name}, {dof} DOF, {budget:,} evaluations per frame. {size}."
            parts.append(fill("figure", content=drawn(drawing, caption)))
    content = [fill("strangers"), *parts, report_figures.curves_legend(study)]
    return Section("strangers", "People outside the family of bodies", content) if parts else None
