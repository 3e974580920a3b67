"""``mmocap export``: a result's animation for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from mmocap_warp.cli.console import Console, Switch
from mmocap_warp.cli.exit_codes import UsageError
from mmocap_warp.formats.table import EXPORT_SUFFIXES, POINT_CACHES, export_format, export_point_cache
from mmocap_warp.formats.table import export as write_export

if TYPE_CHECKING:
    from mmocap_warp.result.result import Result

_OUTPUT = f"The animation's file: {', '.join(EXPORT_SUFFIXES[:-1])} or {EXPORT_SUFFIXES[-1]}."


def export(
    result: Path,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"], help=_OUTPUT)],
    run: Annotated[str | None, Parameter(show_default=False)] = None,
    raw: Switch = False,
    frames: str | None = None,
    fps: float | None = None,
    up: Annotated[Literal["y", "z"] | None, Parameter(show_choices=False)] = None,
    rig: Literal["mixamo"] | None = None,
    bake: Switch = False,
    force: Switch = False,
    console: Console | None = None,
) -> None:
    """Write a result's animation alone, for other programs: the best run's motion, in the format of the file's ending.

    The world is the result's, which is the calibration's: its up axis, its heading and its origin. Formats that are
    Y up always (.glb, .bvh, .trc, .mot) have it turned.

    Parameters
    ----------
    result
        What 'mmocap track' wrote.
    run
        Which run: its number from 0, or "all" for a file a run, such as walk-run0.bvh. [default: the best]
    raw
        The track as it was before it was smoothed.
    frames
        Which of the result's frames: first:end or first:end:stride by the recording's numbers, or a count. All by
        default.
    fps
        Frames per second, resampled by time. [default: the result's own]
    up
        Turn the world so that y or z is up: (x, y, z) becomes (x, z, -y) from z up to y up, and (x, -z, y) back.
        [default: the result's own, or the format's]
    rig
        Name and bind the body as this rig, in its rest pose.
    bake
        USD only: the skin's points at every frame instead of a skeleton that moves it.
    force
        Replace files that exist.
    """
    from mmocap_warp.cli.devices import start_warp
    from mmocap_warp.cli.outputs import new_file
    from mmocap_warp.formats.usd.usd_result import read_result
    from mmocap_warp.result.excerpt import of_run

    console = console or Console()
    new_file(output, *EXPORT_SUFFIXES, force=force or run == "all")
    _check_format(output, up, bake)
    tracked = read_result(result)
    files = _files(output, run, len(tracked.pose), tracked.best_run)
    for file in files:
        new_file(file, *EXPORT_SUFFIXES, force=force)
    start_warp()
    for file, number in files.items():
        chosen = _chosen(of_run(tracked, number), raw, frames, fps, rig, up)
        (export_point_cache if bake else write_export)(chosen, file)
    vertical = export_format(output).up or chosen.cameras.up
    count, rate = len(chosen.frame_numbers), chosen.rate
    values = {
        "file": output if output in files else None,
        "files": list(files),
        "frames": count,
        "fps": rate,
        "up": vertical,
    }
    written = "\n".join(f"{file}: {count} frames, {rate:g} a second, {vertical} up" for file in files)
    console.result(values, written)


def _check_format(output: Path, up: str | None, bake: bool) -> None:
    """Refuse what the ending's format cannot be.

    Raises:
        UsageError: another vertical than the format's, or points of a format without.
    """
    format = export_format(output)
    if up is not None and format.up not in (None, f"+{up}"):
        raise UsageError(f"--up {up}: {format} is always {format.up[1:]} up")
    if bake and not any(cache.matches(output) for cache in POINT_CACHES):
        raise UsageError(f"--bake writes {' or '.join(map(str, POINT_CACHES))}, not {output.suffix}")


def _files(output: Path, run: str | None, runs: int, best: int) -> dict[Path, int]:
    """The run that each file holds.

    Raises:
        UsageError: no such run.
    """
    if run == "all":
        return {output.with_name(f"{output.stem}-run{number}{output.suffix}"): number for number in range(runs)}
    if run is None:
        return {output: best}
    if not run.isdecimal() or int(run) >= runs:
        raise UsageError(f'--run = {run} is neither "all" nor a run of this result, 0 to {runs - 1}')
    return {output: int(run)}


def _chosen(
    result: Result, raw: bool, frames: str | None, fps: float | None, rig: str | None, up: str | None
) -> Result:
    """The part of a result that the flags ask for.

    Raises:
        UsageError: it has no such track, frames or rate, or is not for the rig.
    """
    from mmocap_warp.cli.flag_settings import as_flag
    from mmocap_warp.cli.result_report import positions_of
    from mmocap_warp.formats.exports.rigs import rigged
    from mmocap_warp.result.excerpt import at_rate, before_smoothing, stood_up

    if raw and result.raw_pose is None:
        raise UsageError("--raw: the track was not smoothed; without the flag it is as it was tracked")
    result = before_smoothing(result) if raw else result
    result = result.at(positions_of(result, frames))
    try:
        result = result if fps is None else at_rate(result, fps)
        result = result if rig is None else rigged(result, rig)
    except ValueError as error:
        raise UsageError(as_flag(error)) from None
    return result if up is None else stood_up(result, f"+{up}")
