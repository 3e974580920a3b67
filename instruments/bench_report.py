"""Reports of times beside other programs and as sizes grow, and their page: what docs/performance.md shows.

    python instruments/bench_report.py REPORT.json [--device DEVICE] [--against NAME,...] [--growth]
    python instruments/bench_report.py --pages FOLDER REPORT.json...

The first measures all that ``mmocap bench`` does and adds to it; it exits with 4 where an answer is wrong. The second
writes reports, of a CPU, of a GPU or of both, as a page of tables and plots of growth.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path

from bench_contours import contour_frames
from bench_growth import AXES, growth, growth_lines, growth_plots
from bench_optimizers import optimizer_peers
from bench_peers import peers
from bench_searches import ask_and_tell, frames, measure_generations, moving_parts, same_frames

from mmocap_warp.bench.report_file import Report, heading, read_report, rendered, report_tables, to_text, write_report
from mmocap_warp.bench.suite import Plan, Steps, run_suite
from mmocap_warp.bench.workload import Workload
from mmocap_warp.device.cores import available_threads
from mmocap_warp.device.resolve import device_kind, resolve_device
from mmocap_warp.kernels.benchmarks.timing import Case, measure
from mmocap_warp.whole_file import write_whole

# Embree's module serves trimesh, too: it casts its rays with Embree.
MODULES = {
    "embree": "embreex",
    "trimesh": "embreex",
    "opencv": "cv2",
    "evosax": "evosax",
    "cmaes": "cmaes",
    "cma": "cma",
}
"""What may be run beside us, and the module that each needs; ``pip install -e ".[peers]"`` has them all."""
PAGE = "results.md"
"""The file of the page of times."""

_RUNS = 30  # at once, beside one
_BUDGET = {"cpu": 60, "cuda": 500}  # evaluations of these runs' frames
_SMALL_WORK_SECONDS = 0.1  # for each of many small works


def missing(names: Iterable[str]) -> list[str]:
    """Those of ``MODULES`` that are not installed."""
    return [name for name in names if find_spec(MODULES[name]) is None]


def full_report(plan: Plan, against: Sequence[str], growing: bool, load: Workload | None = None) -> Report:
    """What ``run_suite`` measures, optimizers, frames, the peers on the CPU, and how times grow."""
    device, threads, runs = plan.device, plan.thread_numbers, (1, _RUNS)

    def steps(groups: Iterable[list[Case]], device: str = device, seconds: float | None = None) -> Steps:
        for cases in groups:
            yield measure(cases, device, seconds if plan.seconds is None else plan.seconds)

    more: list[Callable[[Workload], Steps]] = [
        lambda load: steps(moving_parts(load, device)),
        lambda load: steps(ask_and_tell(load, runs, device), seconds=_SMALL_WORK_SECONDS),
        lambda load: measure_generations(load, device, threads[0], plan.seconds),
        lambda load: steps(frames(load, device, threads[-1])),
        lambda load: steps(same_frames(load, runs, _BUDGET[device_kind(device)], device, threads[-1])),
        lambda load: steps(contour_frames(load, runs, device)),
        lambda load: steps(peers(load, against), "cpu"),
        lambda _: steps(optimizer_peers(against, runs), "cpu"),
    ]
    if growing:
        more.append(lambda load: steps(growth(load, device), seconds=_SMALL_WORK_SECONDS))
    packages = {MODULES[name] for name in against}
    return run_suite(plan, partial(print, file=sys.stderr), load, more, packages)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, or write pages."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("reports", nargs="+", type=Path)
    parser.add_argument("--device", default="auto")
    parser.add_argument("--against", default="", help=", ".join(MODULES))
    parser.add_argument("--growth", action="store_true")
    parser.add_argument("--pages", type=Path, metavar="FOLDER")
    given = parser.parse_args(arguments)
    if given.pages:
        given.pages.mkdir(exist_ok=True)
        print(*write_pages(given.pages, [read_report(report) for report in given.reports]), sep="\n")
        return 0
    against = given.against.split(",") if given.against else []
    unknown = [name for name in against if name not in MODULES]
    if unknown or missing(against):
        parser.error(f"--against {','.join(unknown or missing(against))}: unknown, or not installed")
    plan = Plan.usual(resolve_device(given.device), available_threads())
    report = full_report(plan, against, given.growth)
    write_report(given.reports[0], report)
    print(to_text(rendered(report), colours=sys.stdout.isatty()))
    return 0 if report["ok"] else 4


def write_pages(folder: Path, reports: Sequence[Report]) -> list[Path]:
    """Write the page and the plots into a folder, replacing those of earlier reports; returns the files.

    Raises:
        InputError: it cannot be written to.
    """
    files = {PAGE: report_page(reports)}
    files |= {f"growth-{axis}.svg": plot for axis, plot in growth_plots(reports).items()}
    for name, words in files.items():
        write_whole(folder / name, words.encode())
    return [folder / name for name in files]


def report_page(reports: Sequence[Report]) -> str:
    """The page of reports beside each other, as Markdown; its plots of growth are files beside it."""
    parts = [
        "# Measured",
        "Written by `instruments/bench_report.py`. What is measured and how: [performance](../performance.md).",
    ]
    parts += ["; ".join(heading(report).splitlines()) + "." for report in reports]
    growing = {axis: lines for axis in AXES if (lines := growth_lines(reports, axis))}
    parts += ["## Growth"] if growing else []
    for axis, lines in growing.items():
        slopes = ", ".join(f"{line.name} {line.slope:.2f}" for line in lines if len(line.points) > 1)
        parts += [f"![{axis}](growth-{axis}.svg)", f"Slope at the end: {slopes}."]
    for report in reports:
        parts.append(f"## {report['device']}")
        for table in report_tables(report, answers=True):
            rows = [[word.replace("|", "\\|") for word in row] for row in table.rows]
            grid = [f"| {' | '.join(row)} |" for row in (table.columns, ["---"] * len(table.columns), *rows)]
            parts += [f"### {table.title[0].upper()}{table.title[1:]}", "\n".join(grid)]
            parts += [f"- {note}" for note in table.notes]
    return "\n\n".join(parts) + "\n"


if __name__ == "__main__":
    sys.exit(main())
