"""Studies that are run and reported, ``mmocap study``, and how fast the program is here, ``mmocap bench``."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any, Literal

from mmocap_warp.bench import report_file, suite
from mmocap_warp.bench.end_to_end import Walk
from mmocap_warp.commands.caller import Reporter, engine_of, seconds_of, start_warp
from mmocap_warp.commands.outputs import lock, new_file, releases_locks
from mmocap_warp.device.cores import available_threads
from mmocap_warp.device.resolve import resolve_device
from mmocap_warp.errors import InputError, UsageError
from mmocap_warp.jobs.job_run import Status, run_jobs
from mmocap_warp.study.baselines import baselines
from mmocap_warp.study.cell import CellResult, read_cell
from mmocap_warp.study.definition import Study, load_study
from mmocap_warp.study.job import Worker
from mmocap_warp.study.report_build import clips_of, write_report
from mmocap_warp.study.report_setting import mixture
from mmocap_warp.study.store import CellTask, keep_earlier_cells, open_folder, plan_tasks, read_results
from mmocap_warp.study.summary import StudySummary, seconds_alone, summarise, with_typical_pose
from mmocap_warp.whole_file import file_name

SUMMARY = {name: f"{name}_mm" for name in ("mpjpe", "eq20_as_printed", "marker_error", "iou", "shake", "growth")}
SUMMARY |= {"iou": "iou", "growth": "growth"}
"""The measures of a tracker's summary, and their keys there."""


@dataclass(frozen=True)
class StudyRun:
    """Where a study stands after a run."""

    name: str  # the study's
    folder: Path  # of its results
    status: Status  # what was tracked, and what is missing
    # of every tracker whose sequences are all there: its preset, evaluations, dof, algorithm, and the means over
    # sequences, seeds and frames of the measures in ``SUMMARY``
    results: list[dict[str, Any]]


@releases_locks
def run_study(
    study: Study | str | Path,
    output: str | Path | None = None,
    *,
    engine: str = "local",
    device: str = "auto",
    threads: int | None = None,
    address: str = "auto",
    workers: int | None = None,
    gpus: float = 1.0,
    minutes: float | None = None,
    poses: str = "all",
    accept_changed_code: bool = False,
    show: Callable[[Status], None] | None = None,
    reporter: Reporter | None = None,
) -> StudyRun:
    """Track every cell of a study whose result is missing.

    Args:
        study: the study, or its TOML file.
        output: folder of the results, made if it does not exist. [default: the study's name]
        engine: what works: local, the devices of this machine, a process each, or ray, a Ray cluster that is running.
        device: local: auto (all CUDA devices, or the CPU), cpu, or a list such as cuda:0,cuda:2; a device that is
            listed twice gets two processes.
        threads: local: CPU threads. [default: all]
        address: ray: of the cluster; auto finds the one that this machine belongs to.
        workers: ray: how many. [default: one on each GPU, or on each machine without any]
        gpus: ray: of each worker; 0.5 puts two workers on a GPU, 0 none.
        minutes: limit of the run, from its workers' start. A cell that would not be finished in time is not begun;
            the same command goes on.
        poses: which are kept: all, or typical, the median run's, which a report draws. All runs' numbers are kept.
        accept_changed_code: keep what another version of the program has finished, where three cells of the algorithm
            that are tracked again have the same bits.
        show: called with the study's status, at least twice a second.
        reporter: who is warned of cells that are given up.

    Raises:
        UsageError: arguments that cannot be.
        InputError: a study that is wrong, or a folder that cannot be used.
    """
    loaded = study if isinstance(study, Study) else load_study(Path(study))
    if engine == "local" and (workers is not None or gpus != 1.0 or address != "auto"):
        raise UsageError("--workers, --gpus and --address need --engine ray; here --device cpu,cpu is two workers")
    if poses not in ("all", "typical"):
        raise UsageError(f"--poses must be all or typical, got '{poses}'")
    seconds = seconds_of(minutes)
    start_warp()
    kind, start = engine_of(Worker, engine, device, threads, address, workers, gpus)
    # A study that is wrong leaves no folder.
    folder = Path(output or file_name(loaded.name, "[study] name"))
    tasks = plan_tasks(loaded, folder, kind)
    open_folder(folder)
    lock(folder)
    keep = {"keep": with_typical_pose} if poses == "typical" else {}
    reporter, done = reporter or Reporter(), list[Status]()

    def track(chosen: list[CellTask]) -> None:
        left = None if seconds is None else max(0.0, seconds - sum(each.seconds for each in done))
        done.append(run_jobs(chosen, start, show or (lambda status: None), reporter.warn, left, **keep))

    if accept_changed_code:
        keep_earlier_cells(loaded, tasks, kind, track, reporter.note)
    track(tasks)
    *earlier, last = done
    reused, spent = last.reused - sum(each.finished for each in earlier), sum(each.seconds for each in done)
    finished, evaluations = sum(each.finished for each in done), sum(each.evaluations for each in done)
    status = replace(last, reused=reused, finished=finished, evaluations=evaluations, seconds=spent)
    return StudyRun(loaded.name, folder, status, _summaries(tasks))


def _summaries(tasks: list[CellTask]) -> list[dict[str, Any]]:
    """Means over sequences, seeds and frames, for every tracker whose sequences are all there."""
    groups: dict[tuple, list[CellTask]] = {}
    for task in tasks:
        cell = task.job.cell
        groups.setdefault((cell.preset, cell.evaluations, cell.dof, cell.algorithm), []).append(task)
    rows = []
    for key, members in groups.items():
        if all(task.path.exists() for task in members):
            row = dict(zip(("preset", "evaluations", "dof", "algorithm"), key, strict=True))
            runs = [summarise(read_cell(task.path)).runs for task in members]
            for measure, name in SUMMARY.items():
                means = [float(of[measure].mean()) for of in runs if measure in of]
                row[name] = sum(means) / len(means) if len(means) == len(runs) else None
            rows.append(row)
    return rows


@dataclass(frozen=True)
class StudyReport:
    """A study's report that was written."""

    page: Path  # the HTML page
    tables: Path  # its tables as text
    cells: Path  # a ``.csv`` with a line for each cell
    count: int  # of the results in it
    left_out: list[str]  # results that could not be read, a sentence each
    mixed_code: str  # why results should not be compared: of different code, frames, images or truth; else empty


@releases_locks
def report_study(
    results: str | Path | Sequence[str | Path],
    output: str | Path = "report.html",
    *,
    studies: Study | str | Path | Sequence[Study | str | Path] = (),
    alone: str | Path | None = None,
    force: bool = False,
    reporter: Reporter | None = None,
) -> StudyReport:
    """Write a study's results as one HTML page that needs no network, with ``tables.md`` and ``results.csv`` beside it.

    Args:
        results: what ``mmocap study run`` wrote: one folder or several.
        output: the page, .html; beside it go tables.md, the tables as text, and results.csv, a line for each cell.
        studies: studies, or their TOML files: they say what should be there, so that what is missing is listed, and
            where sequences of your own are, for pictures of the tracked body over them.
        alone: a folder of results of one seed, tracked one at a time: what a frame takes. They stand in no table but
            the times.
        force: replace files that exist.
        reporter: receives results that are left out, and of mixed code.

    Raises:
        InputError: no results, or files that cannot be written.
    """
    reporter = reporter or Reporter()
    folders = [Path(each) for each in ([results] if isinstance(results, str | Path) else results)]
    if not folders:
        raise UsageError("--results names no folder")
    page = new_file(output, ".html", force=force)
    tables = new_file(page.with_name("tables.md"), ".md", force=force)
    cells = new_file(page.with_name("results.csv"), ".csv", force=force)
    listed = [studies] if isinstance(studies, str | Path | Study) else studies
    loaded = [study if isinstance(study, Study) else load_study(Path(study)) for study in listed]
    start_warp()
    notes: list[str] = []

    def sound_results(*folders: Path) -> Iterator[CellResult]:
        for result in chain.from_iterable(map(read_results, folders)):
            if isinstance(result, InputError):
                reporter.note(f"left out: {result}")
                notes.append(f"Left out: {Path(result.source).name} {result.problem}.")
            else:
                yield result

    # Everything that the page needs.
    plans = [plan for each in loaded for plan in each.plans]
    tracked = StudySummary.of(sound_results(*folders), plans)
    if not tracked.measures:
        raise InputError(folders[0], "holds no result", "run 'mmocap study run' first, or name its folder")
    times = {} if alone is None else seconds_alone(sound_results(Path(alone)))
    if alone is not None and not times:
        raise InputError(alone, "holds no result of one seed", "name the folder of a study with seeds = 1")
    clips = clips_of(tracked, {clip.name: clip for each in loaded for clip in each.clips})
    planned = frozenset(plan.cell for plan in plans)
    summary = replace(tracked, baselines=baselines(tracked, clips), alone=times, planned=planned)
    if mixed := mixture(summary):
        reporter.note(f"{folders[0]}: {mixed}")
    write_report(summary, clips, notes, page, tables, cells)
    return StudyReport(page, tables, cells, len(summary.cells), notes, mixed)


@releases_locks
def benchmark(
    output: str | Path | None = None,
    *,
    what: Literal["kernels", "end-to-end"] = "kernels",
    device: str = "auto",
    threads: int | None = None,
    force: bool = False,
    reporter: Reporter | None = None,
) -> dict[str, Any]:
    """Measure each kernel and the whole evaluation, or a recording end to end, and check every answer.

    Args:
        output: write the report, .json.
        what: kernels, or end-to-end: the shipped walk from files to result, in stages.
        device: auto (the first CUDA device, or the CPU), cpu, or a CUDA device such as cuda:0.
        threads: CPU threads beside one. [default: all]
        force: replace a file that exists.
        reporter: receives each step.

    Returns:
        The report; ``ok`` says whether all answers are right.

    Raises:
        UsageError: a device or number of threads that cannot be.
        InputError: a file that cannot be written.
    """
    if what not in ("kernels", "end-to-end"):
        raise UsageError(f"WHAT must be kernels or end-to-end, got {what!r}")
    if threads is not None and threads < 1:
        raise UsageError(f"--threads must be at least 1, got {threads}")
    file = None if output is None else new_file(output, ".json", force=force)
    start_warp(device)
    plan = suite.Plan.usual(resolve_device(device), threads or available_threads())
    walk = Walk() if what == "end-to-end" else None
    report = suite.run_suite(plan, lambda step: (reporter or Reporter()).note(f"bench: {step}"), walk)
    if file is not None:
        report_file.write_report(file, report)
    return report
