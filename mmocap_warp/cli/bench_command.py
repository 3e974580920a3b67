"""``mmocap bench``: how fast the program is on this machine."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from mmocap_warp.cli.console import CHECK_FAILED, OK, Console, Switch
from mmocap_warp.errors import UsageError

app = App(name="bench", version_flags=[])
app.command(
    "mmocap_warp.cli.bench_pages:pages", name="pages", help="Write reports as a page of tables, and plots of growth."
)


@app.default
def bench(
    *,
    device: str = "auto",
    threads: int | None = None,
    against: str | None = None,
    growth: Switch = False,
    compare: Path | None = None,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    force: Switch = False,
    console: Console | None = None,
) -> int:
    """See this command's help in ``cli``.

    Parameters
    ----------
    device
        auto (the first CUDA device, or the CPU), cpu, or a CUDA device such as cuda:0.
    threads
        CPU threads beside one. All by default.
    against
        Others to run beside it on the CPU: embree, trimesh (Embree as trimesh offers it) and opencv draw; evosax, cmaes
        and cma have a CMA-ES; or a list such as embree,opencv.
    growth
        Also measure how time grows with candidates, cameras, pixels, triangles and runs.
    compare
        An earlier report: show how many times as quick each line is now.
    output
        Write the report, .json.
    force
        Replace a file that exists.
    """
    from mmocap_warp.commands.outputs import new_file
    from mmocap_warp.commands.settings import start_warp

    console = console or Console()
    if threads is not None and threads < 1:
        raise UsageError(f"--threads must be at least 1, got {threads}")
    if output is not None:
        new_file(output, ".json", force=force)
    peers = _peers(against)
    start_warp(device)

    from mmocap_warp.bench.report_file import read_report, write_report
    from mmocap_warp.bench.suite import Plan, run_suite
    from mmocap_warp.bench.terminal import rendered, to_text
    from mmocap_warp.device.cores import available_threads
    from mmocap_warp.device.resolve import resolve_device

    old = None if compare is None else read_report(compare)
    plan = Plan.usual(resolve_device(device), threads or available_threads(), peers, growth)
    report = run_suite(plan, lambda step: console.note(f"bench: {step}"))
    if output is not None:
        write_report(output, report)
    console.result(report, to_text(rendered(report, old), colours=sys.stdout.isatty()))
    return OK if report["ok"] else CHECK_FAILED


def _peers(names: str | None) -> tuple[str, ...]:
    """The peers of a list, all known and installed."""
    if names is None:
        return ()
    from mmocap_warp.bench.against import PEERS, missing

    wanted = tuple(name.strip() for name in names.split(","))
    unknown = [name for name in wanted if name not in PEERS]
    if unknown:
        raise UsageError(f"--against must name {', '.join(PEERS)}, got '{', '.join(unknown)}'")
    absent = missing(wanted)
    if absent:
        module, extra = PEERS[absent[0]]
        raise UsageError(f"--against {absent[0]} needs the package {module}: pip install 'mmocap-warp[{extra}]'")
    return wanted
