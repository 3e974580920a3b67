"""``mmocap bench``: how fast the program is on this machine."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from mmocap_warp.cli.command_help import documented_by
from mmocap_warp.cli.console import CHECK_FAILED, OK, Console, Output, Switch

app = App(name="bench", version_flags=[])


@app.default
@documented_by("benchmarks:benchmark")
def bench(
    *,
    device: str = "auto",
    threads: int | None = None,
    against: str | None = None,
    growth: Switch = False,
    compare: Annotated[
        Path | None, Parameter(help="An earlier report: show how many times as quick each line is now.")
    ] = None,
    output: Annotated[Path | None, Output] = None,
    force: Switch = False,
    console: Console | None = None,
) -> int:
    from mmocap_warp.bench.report_file import read_report, rendered, to_text
    from mmocap_warp.commands.benchmarks import benchmark

    console = console or Console()
    old = None if compare is None else read_report(compare)
    report = benchmark(
        output,
        device=device,
        threads=threads,
        against=() if against is None else against,
        growth=growth,
        force=force,
        reporter=console,
    )
    console.result(report, to_text(rendered(report, old), colours=sys.stdout.isatty()))
    return OK if report["ok"] else CHECK_FAILED


@app.command(help="Write reports as a page of tables, and plots of growth.")
@documented_by("benchmarks:write_benchmark_pages")
def pages(
    *reports: Path,
    output: Annotated[Path, Output],
    force: Switch = False,
    console: Console | None = None,
) -> None:
    from mmocap_warp.commands.benchmarks import write_benchmark_pages

    files = write_benchmark_pages(reports, output, force=force)
    (console or Console()).result({"files": files}, "\n".join(map(str, files)))
