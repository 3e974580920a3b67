"""Joint angles, contacts, steps, centre of mass and lengths: ``mmocap measure``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

from mmocap_warp.biomechanics import measure_all
from mmocap_warp.biomechanics.measure_all import Measures
from mmocap_warp.biomechanics.measure_tables import write_tables
from mmocap_warp.commands.caller import arguments_checked, start_warp
from mmocap_warp.commands.inputs import Frames, positions_of, result_from
from mmocap_warp.commands.outputs import new_folder, releases_locks
from mmocap_warp.display.result_plots import plot_angles, plot_feet
from mmocap_warp.errors import UsageError
from mmocap_warp.result.result import Result


@releases_locks
def measure(
    result: Result | str | Path,
    run: int | None = None,
    raw: bool = False,
    sex: Literal["female", "male"] | None = None,
    *,
    output: str | Path | None = None,
    frames: Frames = None,
    force: bool = False,
) -> Measures:
    """Joint angles, heel strikes, steps, the centre of mass and the lengths of the bones, of every frame.

    Args:
        result: what was tracked, or its file.
        run: the number of one run. [default: all]
        raw: measure the track before it was smoothed.
        sex: whose shares of mass the body's segments have: female or male. [default: the mean of both]
        output: a folder for every frame's figures as .csv, and plots of angles and feet as .svg.
        frames: which of the result's frames. [default: all]
        force: write into a folder that holds something.

    Returns:
        The measures; docs/measures.md defines every figure, :func:`mmocap_warp.biomechanics.measure_report.report`
        sums them up, and ``files`` are those that were written.

    Raises:
        UsageError: no such run or frames, or no track before it was smoothed.
        InputError: a file that is no result, or a folder that cannot be written.
    """
    tracked, _ = result_from(result)
    tracked = tracked.at(positions_of(tracked, frames))
    if raw and tracked.raw_pose is None:
        raise UsageError("--raw needs a result that was smoothed; this one was not")
    folder = None if output is None else new_folder(output, force=force)
    start_warp()
    with arguments_checked():
        measures = measure_all.measure(tracked, run, raw, sex)
    return measures if folder is None else replace(measures, files=tuple(_write(folder, measures)))


def _write(folder: Path, measures: Measures) -> list[Path]:
    """Write the tables, and the plots of what was measured."""
    written = write_tables(folder, measures)
    for name, plot, has_any in (
        ("angles.svg", plot_angles, measures.shown.angles),
        ("feet.svg", plot_feet, measures.shown.feet),
    ):
        if has_any:
            plot(folder / name, measures)
            written.append(folder / name)
    return written
