"""The report's headline, and its sections on time, search radii, setting and how to cite."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from datetime import datetime
from html import escape

import numpy as np

from mmocap_warp.study import paper
from mmocap_warp.study.overview import level, milliseconds, missing
from mmocap_warp.study.report_figures import baseline_words, budget_figure, legend, seconds_per_frame, time_figure
from mmocap_warp.study.report_sections import Section, choice
from mmocap_warp.study.report_tables import floor_note, grid_table
from mmocap_warp.study.study_tables import Ranking, Row, by_algorithm
from mmocap_warp.study.summary import EQ_20, CellSummary, Contender, Measure, StudySummary
from mmocap_warp.study.tracker_labels import algorithm_label
from mmocap_warp.study.wording import counted, extent, listed, spelled, with_unit

_CODE_DIGITS = 12  # of 64 that are shown


def headline(study: StudySummary, measure: Measure) -> tuple[str, str]:
    """The page's title, and the figures beneath it."""
    rows = _all_rows(study, measure)
    title = "No ranking: fewer than two of the paper's algorithms with the same model and budget"
    cards = []
    if rows:
        best = min(rows, key=lambda found: -found[1].mean if measure.higher_is_better else found[1].mean)
        ranking, row = best
        who = row.contender
        name = algorithm_label(who.algorithm)
        over = spelled(len(ranking.sequences), "sequence")
        title = f"{name} tracks {over} to {with_unit(row.mean, measure)}"
        ours = _ours(study, measure)
        if ours is not None:
            title = (
                f"{algorithm_label(ours[0].algorithm)}: {over} to {with_unit(ours[1], measure)}; the best of the "
                f"others, {name}, to {with_unit(row.mean, measure)}"
            )
            cards.append((with_unit(ours[1], measure), f"{measure.label}, mean over {over}: {ours[0]}"))
        setting = f"{name}, {who.dof} DOF, {who.evaluations:,} evaluations per frame"
        cards.append((with_unit(row.mean, measure), f"{measure.label}, mean over {over}: {setting}"))
        cards += _eq_20_cards(study, measure, who)
        least = by_algorithm(study, measure, study.models[0], study.budgets[0])
        if least is not None:
            first = least.rows[0]
            printed = paper.printed_ranks(first.contender.dof, first.contender.evaluations)
            theirs = printed.get(first.contender.algorithm)
            beside = f"; in the paper it has {theirs:.2f}" if theirs is not None else ""
            text = f"average rank of {first.contender}, the best at the least budget{beside}"
            cards.append((f"{first.comparison.rank:.2f}", text))
    rate, hours, device = _pace(study)
    if np.isfinite(rate):
        per_second = paper.EVALUATIONS[0] / paper.SECONDS_PER_500
        text = f"evaluations, images included, on {device}; the paper’s CPU core: {per_second:.0f}/s"
        cards.append((f"{rate:,.0f}/s", text))
        cpus, weeks = paper.CPU_WEEKS
        text = f"for the paper’s whole grid at that pace; it took {cpus} CPUs {weeks} weeks"
        cards.append((f"{hours:,.0f} h" if hours >= 10 else f"{hours:.1f} h", text))
    figures = "".join(f"<li><strong>{escape(value)}</strong><span>{escape(text)}</span></li>" for value, text in cards)
    return title, f'<ul class="cards">{figures}</ul>'


def _ours(study: StudySummary, measure: Measure) -> tuple[Contender, float] | None:
    """The best of our trackers that has tracked all sequences; None if there is none."""
    levels = [(who, level(study, who, measure, study.sequences)) for who in study.others]
    known = [(who, value) for who, value in levels if np.isfinite(value)]
    return min(known, key=lambda each: -each[1] if measure.higher_is_better else each[1], default=None)


def _eq_20_cards(study: StudySummary, main: Measure, who: Contender) -> Iterator[tuple[str, str]]:
    """What a contender scores by both readings of Eq. 20, each with its floor."""
    for measure in study.measures:
        if measure == main or measure.key not in EQ_20:
            continue
        ranking = by_algorithm(study, measure, who.dof, who.evaluations)
        row = ranking.row(who.algorithm, who.dof, who.evaluations) if ranking is not None else None
        if ranking is not None and row is not None:
            note = floor_note(study, measure, ranking.sequences)
            yield with_unit(row.mean, measure), f"{measure.label}, of the same. {note}".strip()


def grid_sentence(study: StudySummary) -> str:
    """What was compared, in a sentence, and a warning where results should not be compared."""
    grid = [study.cells[cell] for cell in study.grid]
    sentence = (
        f"{counted(len(study.algorithms), 'algorithm')}, {listed(study.models)} degrees of freedom, "
        f"{listed(study.budgets)} evaluations per frame, {counted(len(study.sequences), 'sequence')}, "
        f"{extent(grid)}: {counted(len(grid), 'cell')}"
    )
    beside = [cell for cell in study.cells if cell not in set(study.grid)]
    if beside:
        sentence += f", and {len(beside)} beside them (our trackers, strangers, radii)"
    sentence += f". {study.evaluations:,} evaluations in all."
    absent = len(study.planned - study.cells.keys())
    told = (
        f"{counted(absent, 'cell')} that the study defines {'was' if absent == 1 else 'were'} not run: see the setting."
    )
    return " ".join(part for part in (sentence, told if absent else "", mixture(study)) if part)


def mixture(study: StudySummary) -> str:
    """A warning, if results of the same kind of work come from different code; else nothing."""
    kinds: dict[str, set[str]] = {}
    for cell in study.cells.values():
        kinds.setdefault(str(cell.meta.get("code_covers")), set()).add(_code(cell))
    if all(len(codes) == 1 for codes in kinds.values()):
        return ""
    return (
        f"Results of different code are mixed: {_spans(study, _code)}; "
        "run the study again, which tracks what the present code has not."
    )


def budget_section(study: StudySummary) -> Section:
    """Error and time against the budget."""
    parts = []
    for measure in study.measures:
        for dof in study.models:
            left, right = budget_figure(study, measure, dof), time_figure(study, dof)
            content = f'<div class="two"><div>{left}</div><div>{right}</div></div>'
            size = extent(study.cells[cell] for cell in study.grid if cell.dof == dof)
            baselines = baseline_words(study, measure)
            content += f"<figcaption>{dof} DOF, mean over {len(study.sequences)} sequences. {size}."
            content += f" {baselines}.</figcaption>" if baselines else "</figcaption>"
            default = measure == study.measures[0] and dof == study.models[0]
            parts.append(choice(content, default=default, measure=measure.key, model=dof))
    head = ["Algorithm", *(f"{budget:,} evaluations" for budget in study.budgets), "evaluations/s"]
    rows = [_time_row(study, name) for name in study.algorithms]
    alone = _alone_table(study)
    note = (
        "Search time of a frame of one run. All runs of a cell are tracked at once, so this is a share of what the "
        f"device did in that time. The paper reports {paper.SECONDS_PER_500:g} s for 500 evaluations on one core, "
        "images included."
    )
    size = extent(study.cells[cell] for cell in study.grid)
    table = grid_table(f"Milliseconds per frame and run, mean over sequences and models. {size}.", head, rows)
    return Section(
        "budget",
        "Error and time by budget",
        f"<p>{note}</p>",
        f"<figure>{''.join(parts)}{legend(study.algorithms)}</figure>",
        table,
        alone,
    )


def _alone_table(study: StudySummary) -> str:
    """Milliseconds of a frame where a single run is tracked at a time; empty where that was not measured."""
    if not study.alone:
        return ""
    dof = study.models[0]
    rows = []
    for name in [*study.algorithms, *dict.fromkeys(who.algorithm for who in study.others)]:
        own = sorted({who.evaluations for who in study.alone if who.algorithm == name} - set(study.budgets))
        times = [milliseconds(study, Contender(name, dof, budget)) for budget in study.budgets]
        other = ", ".join(
            f"{time:.1f} ({budget})"
            for budget in own
            if np.isfinite(time := milliseconds(study, Contender(name, dof, budget)))
        )
        if other or np.isfinite(times).any():
            rows.append([algorithm_label(name), *(f"{t:.1f}" if np.isfinite(t) else "–" for t in times), other or "–"])
    head = ["Tracker", *(f"{budget:,} evaluations" for budget in study.budgets), "other budgets (evaluations)"]
    return grid_table(f"Milliseconds per frame of one run tracked alone, {dof} DOF", head, rows)


def setting_section(study: StudySummary, notes: Sequence[str]) -> Section:
    """The sequences, the settings, the machine."""
    by_sequence = {}
    for cell, summary in study.cells.items():
        by_sequence.setdefault(cell.sequence, summary)
    rows = [[name, *_recording_of(by_sequence[name])] for name in [*study.sequences, *study.strangers]]
    sequences = grid_table("Sequences", ["Sequence", "frames", "frames/s", "cameras", "pixels"], rows)
    facts = [
        ("Algorithms", ", ".join(algorithm_label(name) for name in study.algorithms)),
        ("Degrees of freedom", listed(study.models)),
        ("Evaluations per frame", listed(study.budgets)),
        ("Beside them", ", ".join(str(who) for who in study.others) or "nothing"),
        ("Seeds", _spans(study, lambda cell: str(len(cell.seeds)))),
        ("Cost", _spans(study, lambda cell: str(cell.meta.get("config", {}).get("cost", "unknown")))),
        ("Search radii", " ".join(radii(study))),
        ("Frames without a usable view", f"{100 * np.mean([cell.frames_lost for cell in study.cells.values()]):.2f} %"),
        ("Device", _spans(study, _device)),
        ("Host", _spans(study, lambda cell: str(cell.meta.get("host", "unknown")))),
        ("Software", _spans(study, _software)),
        ("Code", _spans(study, _code)),
        ("Tracked", _period(study)),
    ]
    entries = "".join(f"<dt>{escape(name)}</dt><dd>{escape(value)}</dd>" for name, value in facts)
    absent = missing(study)
    remarks = "".join(f"<p>{escape(note)}</p>" for note in notes)
    if absent:
        remarks += f"<h3>Not run</h3><ul>{''.join(f'<li>{escape(each)}</li>' for each in absent)}</ul>"
    return Section("setting", "Setting and machine", f"<dl>{entries}</dl>", sequences, remarks)


def citing_section() -> Section:
    """How to cite."""
    bibtex = (
        "@article{yeguas2014comparing,\n"
        "  title   = {Comparing evolutionary algorithms and particle filters for Markerless Human Motion Capture},\n"
        "  author  = {Yeguas-Bolivar, Enrique and Muñoz-Salinas, Rafael and Medina-Carnicer, Rafael\n"
        "             and Carmona-Poyato, Angel},\n"
        "  journal = {Applied Soft Computing}, volume = {17}, pages = {153--166}, year = {2014},\n"
        f"  note    = {{{paper.UNVERIFIED}}}\n}}"
    )
    text = "Please cite the paper whose study this repeats, and the software, mmocap-warp (see its CITATION.cff)."
    reference = f"<p>{escape(paper.CITATION)} {escape(paper.UNVERIFIED)}</p><pre>{escape(bibtex)}</pre>"
    return Section("cite", "How to cite", f"<p>{text}</p>", reference)


def _all_rows(study: StudySummary, measure: Measure) -> list[tuple[Ranking, Row]]:
    """Of the rankings over the most sequences."""
    rankings = (by_algorithm(study, measure, dof, budget) for dof in study.models for budget in study.budgets)
    known = [ranking for ranking in rankings if ranking is not None]
    most = max((len(ranking.sequences) for ranking in known), default=0)
    return [(ranking, row) for ranking in known if len(ranking.sequences) == most for row in ranking.rows]


def _pace(study: StudySummary) -> tuple[float, float, str]:
    """Evaluations a second, masks included, on the devices that did most cells, these, and hours of the paper's grid.

    The time is that in which any worker of a host was at work; hosts' times add up.
    """
    searched = [study.cells[cell] for cell in study.cells if cell.algorithm in study.algorithms]
    device = Counter(_device(cell) for cell in searched).most_common(1)[0][0]
    timed = [
        cell
        for cell in searched
        if _device(cell) == device and cell.meta.get("wall_seconds") and cell.meta.get("started")
    ]
    if not timed:
        return np.nan, np.nan, device
    by_host: dict[str, list[tuple[float, float]]] = {}
    for cell in timed:
        start = datetime.fromisoformat(cell.meta["started"]).timestamp()
        by_host.setdefault(str(cell.meta.get("host")), []).append((start, start + cell.meta["wall_seconds"]))
    busy = sum(_covered(spans) for spans in by_host.values())
    rate = sum(cell.evaluations for cell in timed) / busy
    workers = max(_most_at_once(spans) for spans in by_host.values())
    where = device if workers <= 1 else f"{device}, {workers} workers at a time"
    return float(rate), float(paper.GRID_EVALUATIONS / rate / 3600), where


def _covered(spans: list[tuple[float, float]]) -> float:
    """How long any of these spans of time lasts."""
    seconds, until = 0.0, -np.inf
    for start, end in sorted(spans):
        seconds += max(end - max(start, until), 0.0)
        until = max(until, end)
    return seconds


def _most_at_once(spans: list[tuple[float, float]]) -> int:
    """How many spans there are at once; starts are told in whole seconds, so the first second does not count."""
    long = [(start + 1.0, end) for start, end in spans if end > start + 1.0]
    changes = sorted([(start, 1) for start, _ in long] + [(end, -1) for _, end in long])
    return int(np.cumsum([change for _, change in changes]).max(initial=0))


def _device(cell: CellSummary) -> str:
    return str(cell.meta.get("versions", {}).get("device") or cell.meta.get("device", "unknown"))


def _software(cell: CellSummary) -> str:
    versions = cell.meta.get("versions", {})
    return ", ".join(f"{name} {version}" for name, version in versions.items() if name != "device")


def _code(cell: CellSummary) -> str:
    """The package's version and the first digits of its code's hash, which older results do not have."""
    version = cell.meta.get("versions", {}).get("mmocap-warp", "unknown version")
    return f"{version} ({str(cell.meta.get('code', 'unknown'))[:_CODE_DIGITS]})"


def _spans(study: StudySummary, of: Callable[[CellSummary], str]) -> str:
    """Every value that cells have, with how many cells have it where they differ."""
    counts = Counter(of(cell) for cell in study.cells.values())
    if len(counts) == 1:
        return next(iter(counts))
    return "; ".join(f"{value} ({counted(number, 'cell')})" for value, number in counts.most_common())


def _period(study: StudySummary) -> str:
    days = sorted(str(cell.meta.get("started", ""))[:10] for cell in study.cells.values())
    hours = sum(float(cell.meta.get("wall_seconds") or 0.0) for cell in study.cells.values()) / 3600
    when = days[0] if days[0] == days[-1] else f"{days[0]} to {days[-1]}"
    return f"{when}, {hours:.1f} h of workers in all"


def _recording_of(cell: CellSummary) -> list[str]:
    sizes = {f"{width}×{height}" for width, height in cell.meta.get("size", [])}
    return [
        f"{len(cell.frames)}",
        f"{cell.meta.get('fps', float('nan')):g}",
        f"{len(cell.meta.get('cameras', []))}",
        ", ".join(sorted(sizes)),
    ]


def radii(study: StudySummary) -> list[str]:
    """Each preset's search radii, the main one's first."""
    return [_radii(study, preset) for preset in study.presets]


def _radii(study: StudySummary, preset: str) -> str:
    """A preset's radii, as the cells used them."""
    used = {
        (config.get("rotation_radius"), config.get("translation_radius"))
        for cell, summary in study.cells.items()
        if cell.preset == preset and (config := summary.meta.get("config"))
    }
    known = [pair for pair in used if None not in pair]
    if not known:
        return f"{preset}: as the software’s documentation says."
    rotation, translation = zip(*known, strict=True)
    return f"{preset}: {_range(rotation)} rad and {_range(translation)} m."


def _range(values: Sequence[float]) -> str:
    return f"{min(values):.3g}" if min(values) == max(values) else f"{min(values):.3g} to {max(values):.3g}"


def _time_row(study: StudySummary, algorithm: str) -> list[str]:
    of = [study.cells[cell] for cell in study.grid if cell.algorithm == algorithm]
    by_budget = [[1000 * seconds_per_frame(s) for s in of if s.cell.evaluations == budget] for budget in study.budgets]
    spent, seconds = sum(summary.evaluations for summary in of), sum(summary.seconds for summary in of)
    return [
        algorithm_label(algorithm),
        *(f"{np.mean(times):.2f}" if times else "–" for times in by_budget),
        f"{spent / seconds:,.0f}" if seconds > 0 else "–",
    ]
