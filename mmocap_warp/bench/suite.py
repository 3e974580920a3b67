"""All measurements, in order, as one report that JSON can hold."""

import os
import platform
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from itertools import chain
from pathlib import Path
from typing import Any, Self

import warp as wp

from mmocap_warp.bench.end_to_end import Walk, end_to_end
from mmocap_warp.bench.evaluations import evaluations, stages
from mmocap_warp.bench.report_file import FORMAT
from mmocap_warp.bench.workload import Workload, workload
from mmocap_warp.kernels.benchmarks.timing import Measurement, measure
from mmocap_warp.versions import package_versions, versions

Steps = Iterator[list[Measurement]]
"""Measurements of one group after the other."""


@dataclass(frozen=True)
class Plan:
    """What is measured."""

    device: str  # a Warp device
    threads: int  # of the CPU, beside one
    batches: tuple[int, ...]  # candidates of the whole evaluation
    kernel_candidates: tuple[int, ...]  # candidates of each kernel alone
    seconds: float | None = None  # to spend on each work, about; what suits it where None

    @property
    def thread_numbers(self) -> list[int]:
        """Of the CPU, by which times differ."""
        return sorted({1, self.threads}) if self.device == "cpu" else [1]

    @classmethod
    def usual(cls, device: str, threads: int) -> Self:
        """What takes a CPU less than a minute, and a GPU too."""
        if device == "cpu":
            return cls(device, threads, batches=(14,), kernel_candidates=(14,))
        return cls(device, threads, batches=(9, 14, 256, 2048, 4096), kernel_candidates=(14, 2048))


def run_suite(
    plan: Plan,
    report_step: Callable[[str], None],
    load: Workload | Walk | None = None,
    more: Sequence[Callable[[Workload], Steps]] = (),
    packages: Iterable[str] = (),
) -> dict[str, Any]:
    """Measure; raises nothing where an answer is wrong, but says so.

    What is measured is the load: the measure where it is omitted, or the walk from files to result. ``more`` are
    further steps, of the load, and ``packages`` those whose versions the report has besides those that the program
    needs.
    """
    started, clock, load_before = datetime.now(UTC), time.perf_counter(), _machine_load()
    compiled, load = _compiled_kernels(), load or workload()
    measured: list[Measurement] = []
    if isinstance(load, Walk):
        stages_of_walk = end_to_end(load, plan.device, plan.thread_numbers)
        steps: Steps = (measure(cases, plan.device, 0.0) for cases in stages_of_walk)
    else:
        kernels = [stages(load, candidates, plan.device) for candidates in plan.kernel_candidates]
        cases_of = chain(*kernels, evaluations(load, plan.batches, plan.thread_numbers, plan.device))
        own = (measure(cases, plan.device, plan.seconds) for cases in cases_of)
        steps = chain(own, *(each(load) for each in more))
    for rows in steps:
        if not measured or rows[0].group != measured[-1].group:
            report_step(rows[0].group)
        measured += rows
    return {
        "format": FORMAT,
        "started": started.isoformat(timespec="seconds"),
        "seconds": time.perf_counter() - clock,
        "versions": versions(plan.device) | package_versions(packages) | {"python": platform.python_version()},
        "device": wp.get_device(plan.device).name if plan.device != "cpu" else _processor(),
        "kind": "cpu" if plan.device == "cpu" else "cuda",
        "cores": os.cpu_count(),
        "load": [load_before, _machine_load()],
        "kernels_compiled": len(_compiled_kernels() - compiled),
        "plan": asdict(plan),
        "measure": load.sizes | {"height": round(load.height), "size": load.rig.size[0].tolist()},
        "measurements": [asdict(row) for row in measured],
        "ok": all(row.ok for row in measured),
    }


def _compiled_kernels() -> set[str]:
    """Names of what Warp's kernel cache holds."""
    return {path.name for path in Path(wp.config.kernel_cache_dir or "").glob("**/wp_*") if path.is_dir()}


def _machine_load() -> float | None:
    """Programs that ran or waited for a core, mean of the last minute; None where the system does not say."""
    return round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None


def _processor() -> str:
    table = Path("/proc/cpuinfo")
    lines = table.read_text().splitlines() if table.exists() else []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, "") or platform.processor() or platform.machine()
