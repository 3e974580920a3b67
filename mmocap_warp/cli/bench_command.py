"""``mmocap bench``: how fast the program is on this machine."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Parameter

from mmocap_warp.cli.command import ANY_NUMBER, Answer, Given, command
from mmocap_warp.cli.console import CHECK_FAILED, OK

app = App(name="bench", version_flags=[])
_COMPARE = Parameter(help="An earlier report: show how many times as quick each line is now.")


@app.default
@command(
    "benchmarks:benchmark",
    order="device threads against growth compare output",
    against=Given(str | None, None),
    compare=Annotated[Path | None, _COMPARE],
)
def bench(call: Any, against: str | None, compare: Path | None) -> Answer:
    from mmocap_warp.bench.report_file import read_report, rendered, to_text

    old = None if compare is None else read_report(compare)
    report = call(against=() if against is None else against)
    text = to_text(rendered(report, old), colours=sys.stdout.isatty())
    return Answer(report, [text], OK if report["ok"] else CHECK_FAILED)


@app.command(help="Write reports as a page of tables, and plots of growth.")
@command("benchmarks:write_benchmark_pages", reports=Given(Path, kind=ANY_NUMBER))
def pages(call: Any) -> Answer:
    files = call()
    return Answer({"files": files}, files)
