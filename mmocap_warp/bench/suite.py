"""All measurements, in order, as one report that JSON can hold."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import warp as wp

from mmocap_warp.bench.against import DRAWING, OPTIMIZING, PEERS
from mmocap_warp.bench.bench_tables import FORMAT
from mmocap_warp.bench.contours import contour_frames
from mmocap_warp.bench.evaluations import evaluations, moving_parts
from mmocap_warp.bench.growth import growth
from mmocap_warp.bench.optimizer_peers import optimizer_peers
from mmocap_warp.bench.peers import peers
from mmocap_warp.bench.searches import ask_and_tell, frames, measure_generations, same_frames
from mmocap_warp.bench.stages import stages
from mmocap_warp.bench.workload import Workload, workload
from mmocap_warp.kernels.benchmarks.case import Case, Measurement, measure
from mmocap_warp.versions import package_versions, versions

_ASK_SECONDS = 0.1  # for each of many small works
_GROWTH_SECONDS = 0.1


@dataclass(frozen=True)
class Plan:
    """What is measured.

    Attributes:
        device: a Warp device.
        threads: of the CPU, beside one.
        against: names in ``against.PEERS``.
        growing: also measure how time grows with every size.
        batches: candidates of the whole evaluation.
        kernel_candidates: of each kernel alone.
        runs: at once, beside one.
        budget: evaluations of their frames.
        seconds: to spend on each work, about; what suits it where None.
    """

    device: str
    threads: int
    against: tuple[str, ...]
    growing: bool
    batches: tuple[int, ...]
    kernel_candidates: tuple[int, ...]
    runs: int = 30
    budget: int = 500
    seconds: float | None = None

    @classmethod
    def usual(cls, device: str, threads: int, against: tuple[str, ...] = (), growing: bool = False) -> Plan:
        """What takes a CPU less than a minute, and a GPU too."""
        if device == "cpu":
            return cls(device, threads, against, growing, batches=(14,), kernel_candidates=(14,), budget=60)
        return cls(device, threads, against, growing, batches=(9, 14, 256, 2048, 4096), kernel_candidates=(14, 2048))


def run_suite(plan: Plan, tell: Callable[[str], None], load: Workload | None = None) -> dict[str, Any]:
    """Measure; raises nothing where an answer is wrong, but says so.

    Args:
        plan: what to measure.
        tell: called with the name of each step.
        load: what is evaluated, but for growth; the measure where omitted.
    """
    started, clock, load_before = datetime.now(UTC), time.perf_counter(), _machine_load()
    compiled = _compiled_kernels()
    load = load or workload()
    measured: list[Measurement] = []
    step = ""
    for rows in _steps(plan, load):
        if rows[0].group != step:
            step = rows[0].group
            tell(step)
        measured += rows
    return {
        "format": FORMAT,
        "started": started.isoformat(timespec="seconds"),
        "seconds": time.perf_counter() - clock,
        "versions": _versions(plan),
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


def _steps(plan: Plan, load: Workload) -> Iterator[list[Measurement]]:
    device, threads = plan.device, sorted({1, plan.threads}) if plan.device == "cpu" else [1]

    def measured(groups: Iterable[list[Case]], device: str = device, seconds: float | None = None) -> Iterator:
        for cases in groups:
            yield measure(cases, device, seconds if plan.seconds is None else plan.seconds)

    for candidates in plan.kernel_candidates:
        yield from measured(stages(load, candidates, device))
    yield from measured(evaluations(load, plan.batches, threads, device))
    yield from measured(moving_parts(load, device))
    yield from measured(ask_and_tell(load, (1, plan.runs), device), seconds=_ASK_SECONDS)
    yield from measure_generations(load, device, threads[0], plan.seconds)
    yield from measured(frames(load, device, threads[-1]))
    yield from measured(same_frames(load, (1, plan.runs), plan.budget, device, threads[-1]))
    yield from measured(contour_frames(load, (1, plan.runs), device))
    yield from measured(peers(load, [name for name in plan.against if name in DRAWING]), "cpu")
    optimizers = [name for name in plan.against if name in OPTIMIZING]
    yield from measured(optimizer_peers(optimizers, (1, plan.runs)), "cpu")
    if plan.growing:
        yield from measured(growth(load, device), seconds=_GROWTH_SECONDS)


def _versions(plan: Plan) -> dict[str, str]:
    peers_need = {PEERS[name].module for name in plan.against}
    return versions(plan.device) | package_versions(peers_need) | {"python": platform.python_version()}


def _compiled_kernels() -> set[str]:
    """Names of what Warp's kernel cache holds."""
    folder = Path(wp.config.kernel_cache_dir or "")
    return {path.name for path in folder.glob("**/wp_*") if path.is_dir()}


def _machine_load() -> float | None:
    """Programs that ran or waited for a core, mean of the last minute; None where the system does not say."""
    return round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None


def _processor() -> str:
    table = Path("/proc/cpuinfo")
    if table.exists():
        for line in table.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
