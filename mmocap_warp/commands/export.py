"""A result's animation for other programs: ``mmocap export``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from mmocap_warp.commands.caller import arguments_checked, start_warp
from mmocap_warp.commands.inputs import Frames, positions_of, result_from
from mmocap_warp.commands.outputs import new_file, releases_locks
from mmocap_warp.errors import UsageError
from mmocap_warp.formats import table
from mmocap_warp.formats.exports.rigs import with_rig
from mmocap_warp.result.excerpt import at_rate, before_smoothing, of_run, stood_up
from mmocap_warp.result.result import Result


@dataclass(frozen=True)
class Export:
    """What was exported.

    Attributes:
        files: those that were written, one for each run.
        frames: how many each has.
        fps: frames per second.
        up: the vertical of its world.
    """

    files: tuple[Path, ...]
    frames: int
    fps: float
    up: str


@releases_locks
def export(
    result: Result | str | Path,
    output: str | Path,
    *,
    run: int | str | None = None,
    raw: bool = False,
    frames: Frames = None,
    fps: float | None = None,
    up: Literal["y", "z"] | None = None,
    rig: str | None = None,
    bake: bool = False,
    force: bool = False,
) -> Export:
    """Write a result's animation alone, in the format of the file's ending.

    The world is the result's, which is the calibration's. A format with a vertical of its own has it turned.

    Args:
        result: what was tracked, or its file.
        output: the animation's file, known by its ending.
        run: which run: its number from 0, or "all" for a file a run, such as walk-run0.bvh. [default: the best]
        raw: the track as it was before it was smoothed.
        frames: which of the result's frames. [default: all]
        fps: frames per second, resampled by time. [default: the result's own]
        up: turn the world so that y or z is up: (x, y, z) becomes (x, z, -y) from z up to y up, and (x, -z, y) back.
            [default: the result's own, or the format's]
        rig: name and bind the body as this rig, in its rest pose.
        bake: USD only: the skin's points at every frame instead of a skeleton that moves it.
        force: replace files that exist.

    Raises:
        UsageError: what the result or the format does not have.
        InputError: a file that cannot be written, or is no result.
    """
    output = Path(output)
    new_file(output, *table.EXPORT_SUFFIXES, force=force or run == "all")
    _check_format(output, up, bake)
    tracked, _ = result_from(result)
    files = _files(output, run, len(tracked.pose), tracked.best_run)
    for file in files:
        new_file(file, *table.EXPORT_SUFFIXES, force=force)
    start_warp()
    for file, number in files.items():
        chosen = _chosen(of_run(tracked, number), raw, frames, fps, rig, up)
        (table.export_point_cache if bake else table.export)(chosen, file)
    vertical = table.export_format(output).up or chosen.cameras.up
    return Export(tuple(files), len(chosen.frame_numbers), chosen.rate, vertical)


def _check_format(output: Path, up: str | None, bake: bool) -> None:
    """Refuse another vertical than the format's, and points in a format without."""
    format = table.export_format(output)
    if up is not None and format.up not in (None, f"+{up}"):
        raise UsageError(f"--up {up}: {format} is always {format.up[1:]} up")
    if bake and not any(cache.matches(output) for cache in table.POINT_CACHES):
        raise UsageError(f"--bake writes {' or '.join(map(str, table.POINT_CACHES))}, not {output.suffix}")


def _files(output: Path, run: int | str | None, runs: int, best: int) -> dict[Path, int]:
    """The run that each file holds."""
    if run == "all":
        return {output.with_name(f"{output.stem}-run{number}{output.suffix}"): number for number in range(runs)}
    if run is None:
        return {output: best}
    if not str(run).isdecimal() or int(run) >= runs:
        raise UsageError(f'--run = {run} is neither "all" nor a run of this result, 0 to {runs - 1}')
    return {output: int(run)}


def _chosen(result: Result, raw: bool, frames: Frames, fps: float | None, rig: str | None, up: str | None) -> Result:
    """The part of a result that is asked for."""
    if raw and result.raw_pose is None:
        raise UsageError("--raw: the track was not smoothed; without the flag it is as it was tracked")
    result = before_smoothing(result) if raw else result
    result = result.at(positions_of(result, frames))
    with arguments_checked():
        result = result if fps is None else at_rate(result, fps)
        result = result if rig is None else with_rig(result, rig)
    return result if up is None else stood_up(result, f"+{up}")
