"""A report: its tables of words, for the terminal and for the documents alike, and its files."""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console, Group, RenderableType
from rich.table import Table as RichTable
from rich.text import Text

from mmocap_warp.bench.evaluations import EVALUATION
from mmocap_warp.errors import InputError
from mmocap_warp.whole_file import read_json, write_whole

PEERS, ASK_AND_TELL, FUNCTION = "peers", "ask and tell beside peers", "a function beside peers"
FRAME = "a frame"
"""Groups that ``instruments/bench_report.py`` measures; other programs beside ours always on the CPU."""
OURS = "mmocap-warp"
_WIDTH = 200  # columns of the terminal: more than any table needs, also where times spread on a busy machine
_COLOURS = {"✓": "green", "✗": "bold red"}

FORMAT = 1
"""Of a report; another number means other keys."""

Report = dict[str, Any]
"""What ``suite.run_suite`` returns."""
Row = dict[str, Any]

_IN_WORDS = {"dof": "{} DOF", "budget": "{} evaluations", "function": "{}", "moving": "all but the {}"}
_MEASURE = ("cameras", "pixels", "triangles", "vertices", "renderer")  # the same for all, or said elsewhere


class Table(NamedTuple):
    """Words in columns, with lines below."""

    title: str
    columns: list[str]
    rows: list[list[str]]
    notes: list[str]


def report_tables(report: Report, old: Report | None = None, answers: bool = False) -> list[Table]:
    """A table for each group; those of growth are plotted instead, by ``instruments/bench_report.py``.

    Lines say how many times as quick as in an ``old`` report it is now, and how ``answers`` were checked.
    """
    before = {_key(row): row for row in old["measurements"]} if old else None
    groups: dict[str, list[Row]] = {}
    for row in report["measurements"]:
        if not row["group"].startswith("growth"):
            groups.setdefault(row["group"], []).append(row)
    return [_group_table(group, rows, report["kind"] == "cuda", before, answers) for group, rows in groups.items()]


def _key(row: Row) -> str:
    return json.dumps([row["group"], row["name"], row["sizes"]], sort_keys=True)


def _group_table(group: str, rows: list[Row], gpu: bool, before: dict[str, Row] | None, answers: bool) -> Table:
    host = "launched" if gpu and group not in (PEERS, ASK_AND_TELL, FUNCTION) else "processor"
    columns = ["", "of", "median", "lowest", "quartiles", host, "compile", "an evaluation", "in 1 s"]
    columns += ["speed-up"] * (before is not None) + ["answer"]
    common = [name for name, value in rows[0]["sizes"].items() if all(row["sizes"].get(name) == value for row in rows)]
    lines, notes = [], [*_notes(group, rows)]
    for row in rows:
        count, middle = row["evaluations"], row["median"]
        line = [case_name(row), sizes_in_words(row["sizes"], leave=common), duration(middle)]
        line += [digits(row["lowest"], middle), "–".join(digits(q, middle) for q in row["quartiles"])]
        line += [duration(row[host]), f"{row['compiling']:.2f} s"]
        line += [duration(middle / count), f"{count / middle:,.0f}"] if count else ["", ""]
        if before is not None:
            same = before.get(_key(row))
            line.append(f"{_ratio(same, row):.2f}x" if same else "")
        mark = "✓" if row["ok"] else "✗"
        lines.append([*line, f"{mark} {row['check']}" if answers else mark])
        notes += [] if row["ok"] else [f"wrong: {case_name(row)}, {sizes_in_words(row['sizes'])}: {row['check']}"]
    shared = sizes_in_words({name: rows[0]["sizes"][name] for name in common})
    # A column that holds no word is left out.
    kept = [i for i in range(len(columns)) if any(line[i] for line in lines)]
    columns, *lines = ([line[i] for i in kept] for line in (columns, *lines))
    return Table(f"{group}: {shared}" if shared else group, columns, lines, notes)


def _notes(group: str, rows: list[Row]) -> Iterable[str]:
    """Ratios of what was measured side by side."""
    if group == PEERS:
        theirs = [row for row in rows if "renderer" not in row["sizes"]]
        for mine in (row for row in rows if "renderer" in row["sizes"]):
            ratios = (f"{_ratio(other, mine):.1f} times as quick as {other['name']}'s drawing" for other in theirs)
            yield f"{mine['name']}, posing and cost included: {', '.join(ratios)}"
    for mine in rows if group in (ASK_AND_TELL, FUNCTION) else ():
        alike = [row for row in rows if row["sizes"] == mine["sizes"] and row is not mine]
        if mine["name"] == OURS and alike:
            ratios = (f"{_ratio(other, mine):.2f} times as quick as {other['name']}" for other in alike)
            yield f"{OURS}, {sizes_in_words(mine['sizes'])}: {', '.join(ratios)}"
    for one, many in pairs(rows, "runs") if group == FRAME else ():
        renderer, runs = many["sizes"]["renderer"], many["sizes"]["runs"]
        yield f"{renderer}: {runs} runs at once do {runs * _ratio(one, many):.1f} times one run's evaluations a second"
    for one, many in pairs(rows, "threads") if group == EVALUATION else ():
        renderer, threads = many["sizes"]["renderer"], many["sizes"]["threads"]
        yield f"{renderer}: {threads} threads are {_ratio(one, many):.2f} times as quick as one"


def pairs(rows: list[Row], size: str) -> list[tuple[Row, Row]]:
    """Measurements with one of a size, and the same with the most of it; the last ones, which were side by side."""
    found = {
        _key(many): (one, many)
        for many in rows
        for one in rows
        if one["name"] == many["name"] and one["sizes"] == many["sizes"] | {size: 1} and many["sizes"].get(size, 1) > 1
    }
    return list(found.values())


def _ratio(other: Row, mine: Row) -> float:
    return other["median"] / mine["median"]


def case_name(row: Row) -> str:
    """What a line is called, with its renderer."""
    renderer = row["sizes"].get("renderer", row["name"])
    return row["name"] if renderer == row["name"] else f"{row['name']}, {renderer}"


def sizes_in_words(sizes: dict[str, Any], leave: Sequence[str] = ()) -> str:
    """What a time depends on, but for the measure's own sizes and those to ``leave`` out."""
    shown = ((name, value) for name, value in sizes.items() if name not in (*_MEASURE, *leave))
    return ", ".join(
        _IN_WORDS[name].format(value) if name in _IN_WORDS else f"{value:,} {name.removesuffix('s' * (value == 1))}"
        for name, value in shown
    )


def duration(seconds: float | None) -> str:
    """Three digits, in the unit that suits."""
    return "" if seconds is None else f"{digits(seconds, seconds)} {_unit(seconds)[1]}"


def digits(seconds: float, like: float) -> str:
    """Three digits, in the unit that suits another duration."""
    value = seconds * _unit(like)[0]
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.1f}" if abs(value) >= 10 else f"{value:.2f}"


def _unit(seconds: float) -> tuple[float, str]:
    """How many there are in a second, and its sign."""
    return next(((n, unit) for n, unit in ((1.0, "s"), (1e3, "ms")) if abs(seconds) * n >= 1.0), (1e6, "µs"))


def heading(report: Report) -> str:
    """Where and when it was measured, and what, in a few lines."""
    measure, versions = report["measure"], report["versions"]
    load = " and ".join("unknown" if value is None else f"{value:g}" for value in report["load"])
    packages = ", ".join(f"{name} {versions[name]}" for name in ("mmocap-warp", "warp-lang", "python"))
    kernels, (width, height) = report["kernels_compiled"], measure["size"]
    compiled = f"{kernels} kernel modules compiled" if kernels else "kernels came from the cache"
    return (
        f"{report['device']}, {report['cores']} cores, machine load {load} (before and after); {packages}; "
        f"{report['started']}, {report['seconds']:.0f} s, {compiled}\n"
        f"{measure['cameras']} cameras of {width}x{height}, a body {measure['height']} px tall of "
        f"{measure['triangles']:,} triangles"
    )


def write_report(path: Path, report: dict[str, Any]) -> None:
    """Write a report; an InputError if that cannot be."""
    write_whole(path, (json.dumps(report, indent=1, allow_nan=False) + "\n").encode())


def read_report(path: Path) -> dict[str, Any]:
    """Read a report; an InputError if there is none, or of another version."""
    report = read_json(path, "name a file that 'mmocap bench -o' wrote")
    if report.get("format") != FORMAT or not report.get("measurements"):
        raise InputError(path, "is no report of this version", "write one with 'mmocap bench -o'")
    return report


def rendered(report: Report, old: Report | None = None) -> Group:
    """A report's tables for the terminal, with ratios to an older one's."""
    parts: list[RenderableType] = [Text(heading(report))]
    for table in report_tables(report, old):
        rich = RichTable(title=Text(f"{table.title}\n", style="bold"), title_justify="left", box=None)
        rich.header_style, rich.padding = "dim", (0, 2, 0, 0)
        for name in table.columns:
            rich.add_column(name, justify="left" if name in ("", "of", "answer") else "right", no_wrap=True)
        for row in table.rows:
            rich.add_row(*(Text(word, style=_COLOURS[word]) if word in _COLOURS else Text(word) for word in row))
        parts += [Text(), rich, *(Text(f"  {note}", style="dim") for note in table.notes)]
    return Group(*parts)


def to_text(parts: RenderableType, *, colours: bool) -> str:
    """What a terminal shows of it."""
    console = Console(width=_WIDTH, force_terminal=colours, no_color=not colours, highlight=False)
    with console.capture() as captured:
        console.print(parts)
    return "\n".join(line.rstrip() for line in captured.get().splitlines())
