"""``mmocap study run``: track what a study lacks."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from mmocap_warp.cli.console import FAILURE, OK, Console, table
from mmocap_warp.errors import UsageError

if TYPE_CHECKING:
    from mmocap_warp.study.engines.engine import Engine
    from mmocap_warp.study.run import Status
    from mmocap_warp.study.tasks import Task

_COLUMNS = {  # of the table, by measure: its key in JSON, its title, how it is shown, its unit
    "mpjpe": ("mpjpe_mm", "MPJPE", ".1f", " mm"),
    "eq20_as_printed": ("eq20_as_printed_mm", "Eq. 20 as printed", ".1f", " mm"),
    "marker_error": ("marker_error_mm", "from own answer", ".1f", " mm"),
    "iou": ("iou", "IoU", ".3f", ""),
    "shake": ("shake_mm", "shake", ".1f", " mm"),
    "growth": ("growth", "growth", ".2f", ""),
}
_NAMED = 3  # cells that are missing for one reason; of more, the number is told


def run(
    study: Path,
    /,
    *,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    engine: str = "local",
    device: str = "auto",
    threads: int | None = None,
    address: str = "auto",
    workers: int | None = None,
    gpus: float = 1.0,
    minutes: float | None = None,
    poses: str = "all",
    console: Console | None = None,
) -> int:
    """Track every cell of a study whose result is missing.

    Parameters
    ----------
    study
        The study's TOML file.
    output
        Folder of the results, made if it does not exist; the study's name by default.
    engine
        local: the devices of this machine, a process each. ray: a Ray cluster that is running.
    device
        local: auto (all CUDA devices, or the CPU), cpu, or a list such as cuda:0,cuda:2; a device that is listed
        twice gets two processes.
    threads
        local: CPU threads. All by default.
    address
        ray: of the cluster; auto finds the one that this machine belongs to.
    workers
        ray: how many. One per GPU by default, or one per machine without any.
    gpus
        ray: of each worker; 0.5 puts two workers on a GPU, 0 none.
    minutes
        Of the run, from when its workers are started. A cell that would not be finished in time is not begun; the same
        command goes on.
    poses
        What is kept of them: all, or typical, those of the run in the middle, which a report draws. Numbers are kept of
        all runs.
    """
    from mmocap_warp.cli.study_progress import StudyProgress
    from mmocap_warp.commands.outputs import lock
    from mmocap_warp.commands.settings import start_warp
    from mmocap_warp.study.definition import load_study
    from mmocap_warp.study.run import run_study
    from mmocap_warp.study.store import open_folder
    from mmocap_warp.study.summary import with_typical_pose
    from mmocap_warp.study.tasks import plan_tasks

    console = console or Console()
    loaded = load_study(study)
    if engine not in ("local", "ray"):
        raise UsageError(f"--engine must be local or ray, got '{engine}'")
    if poses not in ("all", "typical"):
        raise UsageError(f"--poses must be all or typical, got '{poses}'")
    if minutes is not None and not minutes > 0:
        raise UsageError(f"--minutes must be positive, got {minutes:g}")
    start_warp()
    if engine == "local":
        kind, start = _local(device, threads)
    else:
        kind, start = _ray(address, workers, gpus)
    folder = output or Path(loaded.name)
    tasks = plan_tasks(loaded, folder, kind)  # a study that is wrong leaves no folder
    open_folder(folder)
    lock(folder)
    with _ray_messages(console), StudyProgress(loaded.name, quiet=console.quiet) as progress:
        keep = {"keep": with_typical_pose} if poses == "typical" else {}
        seconds = None if minutes is None else 60.0 * minutes
        status = run_study(tasks, start, progress.show, progress.note, seconds, **keep)
    values = {"study": loaded.name, "folder": folder} | _values(status, tasks)
    console.result(values, _text(values))
    return FAILURE if status.failures else OK


@contextmanager
def _ray_messages(console: Console) -> Iterator[None]:
    """Ray prints the last lines of its logs to stdout when something of it dies; the run says so in one line."""
    with open(os.devnull, "w") as nowhere, redirect_stdout(sys.stderr if console.debug else nowhere):
        yield


def _local(device: str, threads: int | None) -> tuple[str, Callable[[], Engine]]:
    """The kind of this machine's devices, and what starts a process on each."""
    from mmocap_warp.study.engines.local import LocalEngine, local_devices
    from mmocap_warp.study.job import device_kind

    try:
        devices = local_devices(device)
    except ValueError as error:
        raise UsageError.of_setting(error) from None
    return device_kind(devices[0]), lambda: LocalEngine(devices, threads)


def _ray(address: str, workers: int | None, gpus: float) -> tuple[str, Callable[[], Engine]]:
    """The kind of a cluster's devices, and what starts its workers."""
    from mmocap_warp.study.engines.ray import RayEngine, join_cluster, share_cluster

    head = join_cluster(address)
    try:
        shares = share_cluster(workers, gpus)
    except ValueError as error:
        raise UsageError.of_setting(error) from None
    return shares.device_kind, lambda: RayEngine(head, shares)


def _values(status: Status, tasks: list[Task]) -> dict[str, Any]:
    from mmocap_warp.study.paper import GRID_EVALUATIONS

    return {
        "cells": status.cells,
        "finished_before": status.reused,
        "finished_now": status.finished,
        "failed": [{"cell": str(cell), "problem": problem} for cell, problem in sorted(status.failures.items())],
        "seconds": status.seconds,
        "evaluations": status.evaluations,
        "evaluations_per_second": status.rate,
        "paper_grid_hours": GRID_EVALUATIONS / status.rate / 3600.0 if status.rate else None,
        "results": _summary(tasks),
    }


def _summary(tasks: list[Task]) -> list[dict[str, Any]]:
    """Means over sequences, seeds and frames, for every tracker whose sequences are all there."""
    from mmocap_warp.study.cell import read_cell
    from mmocap_warp.study.summary import summarise

    groups: dict[tuple, list[Task]] = {}
    for task in tasks:
        cell = task.cell
        groups.setdefault((cell.preset, cell.evaluations, cell.dof, cell.algorithm), []).append(task)
    rows = []
    for (preset, evaluations, dof, algorithm), members in groups.items():
        if not all(task.path.exists() for task in members):
            continue
        runs = [summarise(read_cell(task.path)).runs for task in members]
        row = {"preset": preset, "evaluations": evaluations, "dof": dof, "algorithm": algorithm}
        for measure, (column, *_) in _COLUMNS.items():
            means = [float(of[measure].mean()) for of in runs if measure in of]
            row[column] = sum(means) / len(means) if len(means) == len(runs) else None
        rows.append(row)
    return rows


def _text(values: dict[str, Any]) -> str:
    done, before = values["finished_now"], values["finished_before"]
    lines = [f"{values['folder']}: {done + before} of {values['cells']} cells, {done} of them new"]
    if values["evaluations_per_second"]:
        rate, hours = values["evaluations_per_second"], values["paper_grid_hours"]
        lines.append(f"{rate:,.0f} evaluations/s; at that rate the paper's study (2.0e10) takes {hours:,.1f} hours")
    rows: list[tuple[str, ...]] = [
        ("preset", "evaluations", "DOF", "algorithm", *(t for _, t, *_ in _COLUMNS.values()))
    ]
    for row in values["results"]:
        shown = (
            "-" if row[name] is None else format(row[name], kind) + unit for name, _, kind, unit in _COLUMNS.values()
        )
        rows.append((row["preset"], str(row["evaluations"]), str(row["dof"]), row["algorithm"], *shown))
    lines += ["", table(rows)] if values["results"] else []
    lines += _missing(values["failed"])
    return "\n".join(lines)


def _missing(failures: list[dict[str, str]]) -> list[str]:
    """What is missing and why, a line per reason."""
    cells: dict[str, list[str]] = {}
    for failure in failures:
        cells.setdefault(failure["problem"], []).append(failure["cell"])
    lines = [
        f"missing: {', '.join(names) if len(names) <= _NAMED else f'{len(names)} cells'}: {problem}"
        for problem, names in cells.items()
    ]
    return ["", *lines, "run the study again to track what is missing"] if lines else []
