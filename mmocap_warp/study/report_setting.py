"""The report's headline, and its sections on time, search radii, setting and how to cite."""

from collections import Counter
from collections.abc import Callable, Sequence
from datetime import datetime
from itertools import product

import numpy as np

from mmocap_warp.study import paper
from mmocap_warp.study.overview import missing, radii
from mmocap_warp.study.report_figures import baseline_words, budget_figures, legend, seconds_per_frame
from mmocap_warp.study.report_parts import Html, Section, Table, choice, fill
from mmocap_warp.study.report_tables import floor_note
from mmocap_warp.study.study_tables import algorithm_rankings, by_algorithm
from mmocap_warp.study.summary import EQ_20, CellSummary, Contender, StudySummary, algorithm_label
from mmocap_warp.study.wording import DASH, counted, extent, listed, with_unit

_CODE_DIGITS = 12  # of a hash's 64 digits that are shown


def headline(study: StudySummary) -> tuple[str, Html]:
    """The page's title, and the figures beneath it."""
    # The best row of those rankings that are over the most sequences.
    measure = study.measures[0]
    rankings = [ranking for dof in study.models for ranking in algorithm_rankings(study, measure, dof)]
    most = max((len(ranking.sequences) for ranking in rankings), default=0)
    rows = [row for ranking in rankings if len(ranking.sequences) == most for row in ranking.rows]
    title = "No ranking: fewer than two of the paper's algorithms with the same model and budget"
    cards = []
    if rows:
        best = min(rows, key=lambda row: measure.sign * row.mean)
        who, error = best.contender, with_unit(best.mean, measure)
        name, over = algorithm_label(who.algorithm), counted(most, "sequence", in_words=True)
        title = f"{name} tracks {over} to {error}"
        # The best of our trackers that has tracked all sequences stands before it.
        known = {who: level for who in study.others if np.isfinite(level := study.level(who, measure))}
        if known:
            ours = min(known, key=lambda who: measure.sign * known[who])
            own = with_unit(known[ours], measure)
            title = f"{algorithm_label(ours.algorithm)}: {over} to {own}; the best of the others, {name}, to {error}"
            cards.append((own, f"{measure.label}, mean over {over}: {ours}"))
        setting = f"{name}, {who.dof} DOF, {who.evaluations:,} evaluations per frame"
        cards.append((error, f"{measure.label}, mean over {over}: {setting}"))
        # What it scores by both readings of Eq. 20, each with its floor.
        for reading in (reading for reading in study.measures[1:] if reading.key in EQ_20):
            ranking = by_algorithm(study, reading, who.dof, who.evaluations)
            if ranking and (row := ranking.row(who.algorithm, who.dof, who.evaluations)):
                note = floor_note(study, reading, ranking.sequences)
                cards.append((with_unit(row.mean, reading), f"{reading.label}, of the same. {note}".strip()))
        # The best at the least budget, beside its rank in the paper.
        if least := by_algorithm(study, measure, study.models[0], study.budgets[0]):
            first = least.rows[0]
            printed = paper.printed_ranks(first.contender.dof, first.contender.evaluations)
            theirs = printed.get(first.contender.algorithm)
            beside = f"; in the paper it has {theirs:.2f}" if theirs is not None else ""
            text = f"average rank of {first.contender}, the best at the least budget{beside}"
            cards.append((f"{first.comparison.rank:.2f}", text))
    rate, hours, device = pace_of(study)
    if np.isfinite(rate):
        theirs, (cpus, weeks) = paper.EVALUATIONS[0] / paper.SECONDS_PER_500, paper.CPU_WEEKS
        text = f"evaluations, images included, on {device}; the paper’s CPU core: {theirs:.0f}/s"
        grid = f"for the paper’s whole grid at that pace; it took {cpus} CPUs {weeks} weeks"
        cards += [(f"{rate:,.0f}/s", text), (f"{hours:,.0f} h" if hours >= 10 else f"{hours:.1f} h", grid)]
    return title, fill("cards", cards=[fill("card", value=value, text=text) for value, text in cards])


def grid_sentence(study: StudySummary) -> str:
    """What was compared, in a sentence, and a warning where results should not be compared."""
    cells, beside = counted(len(study.grid), "cell"), len(study.cells) - len(study.grid)
    sentence = (
        f"{counted(len(study.algorithms), 'algorithm')}, {listed(study.models)} degrees of freedom, "
        f"{listed(study.budgets)} evaluations per frame, {counted(len(study.sequences), 'sequence')}, "
        f"{extent(study.of_grid())}: {cells}"
    )
    sentence += f", and {beside} beside them (our trackers, strangers, radii)" if beside else ""
    sentence += f". {study.evaluations:,} evaluations in all."
    if absent := len(study.planned - study.cells.keys()):
        were = "was" if absent == 1 else "were"
        sentence += f" {counted(absent, 'cell')} that the study defines {were} not run: see the setting."
    return f"{sentence} {mixture(study)}".strip()


def mixture(study: StudySummary) -> str:
    """A warning, if results of the same kind of work come from different code, or clips differ; else nothing."""
    clips = {(cell.cell.sequence, clip) for cell in study.cells.values() if (clip := cell.meta.get("clip"))}
    several = sorted(name for name, number in Counter(name for name, _ in clips).items() if number > 1)
    clips_mixed = f"Results of different frames, images or truth of {', '.join(several)} are mixed."
    kinds: dict[str, set[str]] = {}
    for cell in study.cells.values():
        kinds.setdefault(str(cell.meta.get("code_covers")), set()).add(_code(cell))
    mixed = f"Results of different code are mixed: {_values(study, _code)}; "
    mixed += "run the study again, which tracks what the present code has not, unless that was accepted."
    code_is_mixed = any(len(codes) > 1 for codes in kinds.values())
    return " ".join(text for text, holds in ((clips_mixed, several), (mixed, code_is_mixed)) if holds)


def budget_section(study: StudySummary) -> Section:
    """Error and time against the budget."""
    parts = []
    for measure, dof in product(study.measures, study.models):
        baselines, size = baseline_words(study, measure), extent(study.of_grid(dof=dof))
        left, right = budget_figures(study, measure, dof)
        words = {"count": len(study.sequences), "extent": size, "baselines": f" {baselines}." if baselines else ""}
        content = fill("budget-figures", left=[left], right=[right], dof=dof, **words)
        parts.append(choice(study, content, measure=measure.key, model=dof))
    head = ["Algorithm", *(f"{budget:,} evaluations" for budget in study.budgets), "evaluations/s"]
    caption = f"Milliseconds per frame and run, mean over sequences and models. {extent(study.of_grid())}."
    rows = []
    for name in study.algorithms:
        of = study.of_grid(algorithm=name)
        times = [[1000 * seconds_per_frame(s) for s in of if s.cell.evaluations == budget] for budget in study.budgets]
        means = [f"{np.mean(each):.2f}" if each else DASH for each in times]
        spent, seconds = sum(summary.evaluations for summary in of), sum(summary.seconds for summary in of)
        rows.append([algorithm_label(name), *means, f"{spent / seconds:,.0f}" if seconds > 0 else DASH])
    table = Table(caption, head, rows, "").html()
    figure = fill("figure", content=[*parts, legend(study.algorithms)])
    about = fill("budget", seconds=f"{paper.SECONDS_PER_500:g}")
    return Section("budget", "Error and time by budget", [about, figure, table, *_times_alone(study)])


def _times_alone(study: StudySummary) -> list[Html]:
    """Milliseconds of a frame where a single run is tracked at a time; empty where that was not measured."""
    dof, rows = study.models[0], []
    for name in [*study.algorithms, *dict.fromkeys(who.algorithm for who in study.others)]:
        own = sorted({*study.budgets, *(who.evaluations for who in study.alone if who.algorithm == name)})
        times = {budget: study.milliseconds(Contender(name, dof, budget)) for budget in own}
        times = {budget: time for budget, time in times.items() if np.isfinite(time)}
        other = ", ".join(f"{time:.1f} ({budget})" for budget, time in times.items() if budget not in study.budgets)
        cells = [f"{times[budget]:.1f}" if budget in times else DASH for budget in study.budgets]
        rows += [[algorithm_label(name), *cells, other or DASH]] if times else []
    head = ["Tracker", *(f"{budget:,} evaluations" for budget in study.budgets), "other budgets (evaluations)"]
    caption = f"Milliseconds per frame of one run tracked alone, {dof} DOF"
    return [Table(caption, head, rows, "").html()] if study.alone else []


def setting_section(study: StudySummary, notes: Sequence[str]) -> Section:
    """The sequences, the settings, the machine."""
    cells = study.cells.values()
    by_sequence = {each.cell.sequence: each for each in reversed(cells)}
    rows = []
    for name in [*study.sequences, *study.strangers]:
        cell, recorded = by_sequence[name], by_sequence[name].meta
        sizes = sorted({f"{width}×{height}" for width, height in recorded.get("size", [])})
        rate, cameras = recorded.get("fps", float("nan")), recorded.get("cameras", [])
        rows.append([name, f"{len(cell.frames)}", f"{rate:g}", f"{len(cameras)}", ", ".join(sizes)])
    days = sorted(str(cell.meta.get("started", ""))[:10] for cell in cells)
    hours = sum(float(cell.meta.get("wall_seconds") or 0.0) for cell in cells) / 3600

    def software(cell: CellSummary) -> str:
        versions = cell.meta.get("versions", {})
        return ", ".join(f"{name} {version}" for name, version in versions.items() if name != "device")

    facts = {
        "Algorithms": ", ".join(algorithm_label(name) for name in study.algorithms),
        "Degrees of freedom": listed(study.models),
        "Evaluations per frame": listed(study.budgets),
        "Beside them": ", ".join(str(who) for who in study.others) or "nothing",
        "Seeds": _values(study, lambda cell: str(len(cell.seeds))),
        "Cost": _values(study, lambda cell: str(cell.meta.get("config", {}).get("cost", "unknown"))),
        "Search radii": " ".join(radii(study)),
        "Frames without a usable view": f"{100 * np.mean([cell.frames_lost for cell in cells]):.2f} %",
        "Device": _values(study, _device),
        "Host": _values(study, lambda cell: str(cell.meta.get("host", "unknown"))),
        "Software": _values(study, software),
        "Code": _values(study, _code),
        "Tracked": f"{' to '.join(dict.fromkeys((days[0], days[-1])))}, {hours:.1f} h of workers in all",
    }
    parts = [fill("facts", facts=[fill("fact", name=name, value=value) for name, value in facts.items()])]
    parts.append(Table("Sequences", ["Sequence", "frames", "frames/s", "cameras", "pixels"], rows, "").html())
    parts += [fill("paragraph", text=note) for note in notes]
    absent = [fill("item", text=each) for each in missing(study)]
    parts += [fill("not-run", items=absent)] if absent else []
    return Section("setting", "Setting and machine", parts)


def pace_of(study: StudySummary) -> tuple[float, float, str]:
    """Evaluations a second, masks included, on the devices that did most cells, these, and hours of the paper's grid.

    The time is that in which any worker of a host was at work; hosts' times add up.
    """
    searched = [cell for cell in study.cells.values() if cell.cell.algorithm in study.algorithms]
    device = Counter(map(_device, searched)).most_common(1)[0][0]
    timed = [cell for cell in searched if cell.meta.get("wall_seconds") and cell.meta.get("started")]
    timed = [cell for cell in timed if _device(cell) == device]
    by_host: dict[str, list[tuple[float, float]]] = {}
    for cell in timed:
        start = datetime.fromisoformat(cell.meta["started"]).timestamp()
        by_host.setdefault(str(cell.meta.get("host")), []).append((start, start + cell.meta["wall_seconds"]))
    evaluations = sum(cell.evaluations for cell in timed)
    if not evaluations:  # contours are followed without a search
        return np.nan, np.nan, device
    rate = evaluations / sum(_covered(spans) for spans in by_host.values())
    workers = max(_most_at_once(spans) for spans in by_host.values())
    where = device if workers <= 1 else f"{device}, {workers} workers at a time"
    return float(rate), float(paper.GRID_EVALUATIONS / rate / 3600), where


def _covered(spans: list[tuple[float, float]]) -> float:
    """How long any of these spans of time lasts."""
    start, end = np.array(sorted(spans)).T
    gaps = start[1:] - np.maximum.accumulate(end)[:-1]
    return float(end.max() - start[0] - np.maximum(gaps, 0.0).sum())


def _most_at_once(spans: list[tuple[float, float]]) -> int:
    """How many spans there are at once; starts are in whole seconds, so the first second does not count."""
    long = [(start + 1.0, end) for start, end in spans if end > start + 1.0]
    changes = sorted([(start, 1) for start, _ in long] + [(end, -1) for _, end in long])
    return int(np.cumsum([change for _, change in changes]).max(initial=0))


def _device(cell: CellSummary) -> str:
    return str(cell.meta.get("versions", {}).get("device") or cell.meta.get("device", "unknown"))


def _code(cell: CellSummary) -> str:
    """The package's version and the first digits of its code's hash, which older results do not have."""
    version = cell.meta.get("versions", {}).get("mmocap-warp", "unknown version")
    return f"{version} ({str(cell.meta.get('code', 'unknown'))[:_CODE_DIGITS]})"


def _values(study: StudySummary, of: Callable[[CellSummary], str]) -> str:
    """Every value that cells have, with how many cells have it where they differ."""
    counts = Counter(of(cell) for cell in study.cells.values())
    if len(counts) == 1:
        return next(iter(counts))
    return "; ".join(f"{value} ({counted(number, 'cell')})" for value, number in counts.most_common())
