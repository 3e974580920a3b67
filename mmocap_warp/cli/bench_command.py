"""``mmocap bench``: how fast the program is on this machine."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from mmocap_warp.cli.console import CHECK_FAILED, OK, Console, Switch

app = App(name="bench", version_flags=[])


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
    from mmocap_warp.bench.report_file import read_report
    from mmocap_warp.bench.terminal import rendered, to_text
    from mmocap_warp.commands.benchmarks import benchmark

    console = console or Console()
    old = None if compare is None else read_report(compare)
    report = benchmark(
        output,
        device=device,
        threads=threads,
        against=() if against is None else [name.strip() for name in against.split(",")],
        growth=growth,
        force=force,
        reporter=console,
    )
    console.result(report, to_text(rendered(report, old), colours=sys.stdout.isatty()))
    return OK if report["ok"] else CHECK_FAILED


@app.command(help="Write reports as a page of tables, and plots of growth.")
def pages(
    *reports: Path,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    force: Switch = False,
    console: Console | None = None,
) -> None:
    """Write reports as a page of tables, and plots of growth.

    Parameters
    ----------
    reports
        What 'mmocap bench -o' wrote: of a CPU, of a GPU, or both.
    output
        Folder, made if it does not exist: results.md, and growth-*.svg where growth was measured.
    force
        Write among files that are there.
    """
    from mmocap_warp.commands.benchmarks import write_benchmark_pages

    files = write_benchmark_pages(reports, output, force=force)
    (console or Console()).result({"files": files}, "\n".join(map(str, files)))
