"""How fast the program is on this machine: ``mmocap bench``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mmocap_warp.bench import suite
from mmocap_warp.bench.against import PEERS, missing
from mmocap_warp.bench.report_file import read_report, write_pages, write_report
from mmocap_warp.commands.caller import Reporter, start_warp
from mmocap_warp.commands.outputs import new_file, new_folder, releases_locks
from mmocap_warp.device.cores import available_threads
from mmocap_warp.device.resolve import resolve_device
from mmocap_warp.errors import UsageError


@releases_locks
def benchmark(
    output: str | Path | None = None,
    *,
    device: str = "auto",
    threads: int | None = None,
    against: str | Sequence[str] = (),
    growth: bool = False,
    force: bool = False,
    reporter: Reporter | None = None,
) -> dict[str, Any]:
    """Measure each kernel, the whole evaluation, the optimizers and frames, and check every answer.

    Args:
        output: write the report, .json.
        device: auto (the first CUDA device, or the CPU), cpu, or a CUDA device such as cuda:0.
        threads: CPU threads beside one. [default: all]
        against: others to run beside it on the CPU: embree, trimesh (Embree as trimesh offers it) and opencv draw;
            evosax, cmaes and cma have a CMA-ES; several are joined by commas.
        growth: also measure how time grows with candidates, cameras, pixels, triangles and runs.
        force: replace a file that exists.
        reporter: who is told of each step.

    Returns:
        The report; ``ok`` says whether all answers are right.

    Raises:
        UsageError: a device or number of threads that cannot be, or a program that is unknown or not installed.
        InputError: a file that cannot be written.
    """
    if threads is not None and threads < 1:
        raise UsageError(f"--threads must be at least 1, got {threads}")
    file = None if output is None else new_file(output, ".json", force=force)
    # Other programs must be known and installed.
    others = [name.strip() for name in against.split(",")] if isinstance(against, str) else list(against)
    if unknown := [name for name in others if name not in PEERS]:
        raise UsageError(f"--against must name {', '.join(PEERS)}, got '{', '.join(unknown)}'")
    if absent := missing(tuple(others)):
        module, extra = PEERS[absent[0]]
        raise UsageError(f"--against {absent[0]} needs the package {module}: pip install 'mmocap-warp[{extra}]'")
    start_warp(device)
    plan = suite.Plan.usual(resolve_device(device), threads or available_threads(), tuple(others), growth)
    report = suite.run_suite(plan, lambda step: (reporter or Reporter()).note(f"bench: {step}"))
    if file is not None:
        write_report(file, report)
    return report


@releases_locks
def write_benchmark_pages(reports: Sequence[str | Path], output: str | Path, *, force: bool = False) -> list[Path]:
    """Write reports as a page of tables, and plots of growth.

    Args:
        reports: what :func:`benchmark` wrote: of a CPU, of a GPU, or both.
        output: folder, made if it does not exist: ``results.md``, and ``growth-*.svg`` where growth was measured.
        force: write among files that are there.

    Raises:
        UsageError: no reports.
        InputError: a report that cannot be read, or a folder that cannot be written to.
    """
    if not reports:
        raise UsageError("name at least one report")
    read = [read_report(Path(report)) for report in reports]
    return write_pages(new_folder(output, force=force), read)
