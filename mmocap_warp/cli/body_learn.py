"""``mmocap body learn``: limits and spreads of a body's joints from its motions, or from tracks."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from mmocap_warp.cli.console import Console, Switch
from mmocap_warp.cli.exit_codes import UsageError
from mmocap_warp.errors import InputError

if TYPE_CHECKING:
    import numpy as np

    from mmocap_warp.body.skeleton import Skeleton


def learn(
    body: str,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    motion: list[str] | None = None,
    result: list[Path] | None = None,
    margin: float = 10.0,
    force: Switch = False,
    console: Console | None = None,
) -> None:
    """Write a body whose joints turn as far as motions and results show, and no farther.

    Parameters
    ----------
    body
        A body's USD file, or a shipped body's name.
    output
        The new body's file: .usdc, .usda or .usd.
    motion
        One of the body's motions. May be given more than once. [default: all, unless results are given]
    result
        A track of the same joints, of which all frames that were not lost count. May be given more than once.
    margin
        By which limits are wider than the angles seen, at either end, in degrees.
    force
        Replace a file that exists.
    """
    from dataclasses import replace

    import numpy as np

    from mmocap_warp.body.model import motion_named
    from mmocap_warp.cli.outputs import new_file
    from mmocap_warp.formats.usd.usd_body import read_body, read_motions, write_body
    from mmocap_warp.formats.usd.usd_file import USD_SUFFIXES
    from mmocap_warp.rigging.shipped import body_file
    from mmocap_warp.rigging.start_poses import learnt

    console = console or Console()
    if not 0 <= margin <= 180:
        raise UsageError(f"--margin must be from 0 to 180 degrees, got {margin:g}")
    new_file(output, *USD_SUFFIXES, force=force)
    file = body_file(body)
    read, motions = read_body(file), read_motions(file)
    wanted = motion or ([] if result else list(motions))
    poses = [motion_named(name, motions, file).pose for name in wanted]
    poses += [_tracked(path, read.skeleton) for path in result or []]
    if not poses:
        raise InputError(file, "has no motions", "give a --result to learn from")
    seen = np.concatenate(poses)
    skeleton = learnt(read.skeleton, seen, float(np.radians(margin)))
    write_body(output, replace(read, skeleton=skeleton), motions)
    before, after = (_mean_ranges(each) for each in (read.skeleton, skeleton))
    values: dict[str, object] = {"body": read.name, "file": output, "frames": len(seen)}
    told = []
    for unit, move, form, word in (("deg", "angles turn", ".0f", "degrees"), ("m", "joints slide", ".3g", "m")):
        if unit in before:
            values |= {f"mean_range_{unit}": after[unit], f"before_{unit}": before[unit]}
            told.append(f"{move} by {after[unit]:{form}} {word} on average, {before[unit]:{form}} before")
    console.result(values, f"{output}: {'; '.join([*told, f'{len(seen)} frames'])}")


def _tracked(path: Path, skeleton: Skeleton) -> np.ndarray:
    """(frame, coordinate) of a result's best run, where it was not lost."""
    import numpy as np

    from mmocap_warp.formats.usd.usd_result import read_result
    from mmocap_warp.result.result import STATUS

    result = read_result(path)
    if result.subject.body.skeleton.joints != skeleton.joints:
        raise InputError(path, "is a track of other joints than the body's", "give a track of this body")
    status = result.status[result.best_run]
    found = result.pose[result.best_run][~np.isin(status, [STATUS.index("lost"), STATUS.index("interpolated")])]
    if not len(found):
        raise InputError(path, "has no frame that was not lost", "give another track")
    return found.astype(float)


def _mean_ranges(skeleton: Skeleton) -> dict[str, float]:
    """Of what is searched and has limits, by unit: angles [``deg``] and shifts [``m``], where there are any."""
    import numpy as np

    searched = skeleton.searched()
    width, is_length = np.ptp(skeleton.coordinate_limits[searched], axis=1), skeleton.is_length[searched]
    ranges = {"deg": np.degrees(width[np.isfinite(width) & ~is_length]), "m": width[np.isfinite(width) & is_length]}
    return {unit: float(each.mean()) for unit, each in ranges.items() if len(each)}
