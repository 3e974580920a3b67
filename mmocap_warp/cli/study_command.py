"""``mmocap batch``: many recordings. ``mmocap study``: trackers compared on a grid. ``mmocap bench``: their speed."""

import os
import sys
import tomllib
from contextlib import redirect_stdout
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import App, Parameter

from mmocap_warp.cli import COMMANDS
from mmocap_warp.cli.command import ANY_NUMBER, BY_PLACE, Answer, Given, attributes, command, several
from mmocap_warp.cli.console import FAILURE, OK, Console, checked, table

app = App(name="study", help="Compare trackers: run a grid of them, and report on it.", version_flags=[])
bench_app = App(name="bench", version_flags=[])
_COMPARE = Parameter(help="An earlier report: the text, not --json, shows how many times as quick each line is now.")
_MORE = Given(Annotated[Path, Parameter(help="Further folders of results, of the same page.")], kind=ANY_NUMBER)
_MAX_NAMED = 3  # cells that are missing for one reason; of more, only the number is printed
_COLUMNS = tomllib.loads(Path(__file__).with_name("study_tables.toml").read_text("utf-8"))


@command("batch:batch", order="steps plan output")
def batch(call: Any, console: Console) -> Answer:
    from mmocap_warp.cli.progress import JobsProgress

    with JobsProgress("batch", quiet=console.quiet) as progress:
        done = call(show=progress.show, reporter=progress)
    failed = [{"scene": name, "problem": problem} for name, problem in done.failures.items()]
    values = {"page": done.page, **attributes(done.status, finished_before="reused", finished_now="finished")}
    values |= {"seconds": done.status.seconds, "failed": failed, "scenes": done.trials}
    total = len(done.trials) + len(failed)
    lines = [f"{done.page}: {len(done.trials)} of {total} scenes, {done.status.finished} of them new"]
    lines += ["missing: {scene}: {problem}".format(**each) for each in failed]
    return Answer(values, lines, FAILURE if failed else OK)


@app.command(help="Write shipped sequences as scenes, to look at or to track on their own.", sort_key=0)
@command("clips:make_sequences", sequences=several("--sequence"))
def make(call: Any) -> Answer:
    scenes = call()
    return Answer(scenes, scenes.values())


@app.command(help=COMMANDS["study run"]["help"], sort_key=1)
@command("studies:run_study")
def run(call: Any, console: Console, study: Path) -> Answer:
    from mmocap_warp.cli.progress import JobsProgress
    from mmocap_warp.study.definition import load_study
    from mmocap_warp.study.paper import GRID_EVALUATIONS

    loaded = load_study(study)
    # Ray prints the last lines of its logs to stdout when something of it dies; the run says so in one line.
    with (
        open(os.devnull, "w") as nowhere,
        redirect_stdout(sys.stderr if console.debug else nowhere),
        JobsProgress(loaded.name, quiet=console.quiet) as progress,
    ):
        done = call(study=loaded, show=progress.show, reporter=progress)
    status = done.status
    values = {
        "study": done.name,
        "folder": done.folder,
        **attributes(status, cells="jobs", finished_before="reused", finished_now="finished"),
        "failed": [{"cell": str(cell), "problem": problem} for cell, problem in sorted(status.failures.items())],
        **attributes(status, "seconds", "evaluations", evaluations_per_second="rate"),
        "paper_grid_hours": GRID_EVALUATIONS / status.rate / 3600.0 if status.rate else None,
        "results": done.results,
    }
    return Answer(values, [_text(values)], FAILURE if status.failures else OK)


def _text(values: dict[str, Any]) -> str:
    done, before = values["finished_now"], values["finished_before"]
    lines = [f"{values['folder']}: {done + before} of {values['cells']} cells, {done} of them new"]
    if rate := values["evaluations_per_second"]:
        hours = f"{values['paper_grid_hours']:,.1f} hours"
        lines.append(f"{rate:,.0f} evaluations/s; at that rate the paper's study (2.0e10) takes {hours}")
    rows = [("preset", "evaluations", "DOF", "algorithm", *(title for title, *_ in _COLUMNS.values()))]
    for row in values["results"]:
        cells = ((row[key], form, unit) for key, (_, form, unit) in _COLUMNS.items())
        shown = ("-" if value is None else format(value, form) + unit for value, form, unit in cells)
        rows.append((row["preset"], str(row["evaluations"]), str(row["dof"]), row["algorithm"], *shown))
    lines += ["", table(rows)] if values["results"] else []
    # What is missing and why, a line for each reason.
    reasons: dict[str, list[str]] = {}
    for failure in values["failed"]:
        reasons.setdefault(failure["problem"], []).append(failure["cell"])
    few = {why: ", ".join(of) if len(of) <= _MAX_NAMED else f"{len(of)} cells" for why, of in reasons.items()}
    missing = [f"missing: {names}: {why}" for why, names in few.items()]
    return "\n".join([*lines, *(["", *missing, "run the study again to track what is missing"] if missing else [])])


@app.command(help="List a folder's results, checking every byte. Exits with 4 if one is damaged.", sort_key=3)
def show(folder: Path, /, *, console: Console | None = None) -> int:
    """List a folder's results.

    Parameters
    ----------
    folder
        What 'mmocap study run' wrote, or several such folders copied into one.
    """
    from mmocap_warp.errors import InputError
    from mmocap_warp.study.store import read_results

    rows, damaged = [], []
    names = ("study", "host", "device", "started", "wall_seconds", "versions", "code")
    for result in read_results(folder):
        if isinstance(result, InputError):
            damaged.append(str(result))
            continue
        about = {"cell": str(result.cell), "runs": len(result.seeds), "frames": len(result.frames)}
        rows.append(about | {name: result.meta.get(name) for name in names})
    lines = ["{cell}, {runs} runs of {frames} frames, {device}, {host}".format(**row) for row in rows]
    lines += [f"damaged: {problem}" for problem in damaged]
    lines.append(f"{folder}: {len(rows)} results, {len(damaged)} damaged")
    (console or Console()).result({"folder": folder, "results": rows, "damaged": damaged}, "\n".join(lines))
    return checked(not damaged)


@app.command(help="Write a study's results as one HTML page.", sort_key=4)
@command(
    "studies:report_study", order="results more output", results=Path, more=_MORE, studies=several("--study", Path)
)
def report(call: Any, results: Path, more: tuple[Path, ...]) -> Answer:
    written = call(results=[results, *more])
    values = attributes(written, "page", "tables", "cells", results="count", left_out="left_out")
    return Answer(values | {"mixed_code": written.mixed_code or None}, [written.page, written.tables, written.cells])


@bench_app.default
@command(
    "studies:benchmark",
    order="device threads compare output",
    compare=Annotated[Path | None, _COMPARE],
    what=Given(Literal["kernels", "end-to-end"], kind=BY_PLACE),
)
def bench(call: Any, console: Console, compare: Path | None) -> Answer:
    from mmocap_warp.bench.report_file import read_report, rendered, report_tables, to_text

    old = None if compare is None else read_report(compare)
    report = call()
    if old is not None and not any("speed-up" in table.columns for table in report_tables(report, old)):
        console.warn(f"{compare}: no line is in both reports, so nothing is compared")
    return Answer(report, [to_text(rendered(report, old), colours=sys.stdout.isatty())], checked(report["ok"]))
