"""``mmocap bench pages``: reports as documents."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from mmocap_warp.cli.console import Console, Switch


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
    from mmocap_warp.bench.pages import write_pages
    from mmocap_warp.bench.report_file import read_report
    from mmocap_warp.commands.outputs import new_folder
    from mmocap_warp.errors import UsageError

    console = console or Console()
    if not reports:
        raise UsageError("name at least one report")
    read = [read_report(report) for report in reports]
    files = write_pages(new_folder(output, force=force), read)
    console.result({"files": files}, "\n".join(map(str, files)))
