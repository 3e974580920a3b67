"""``mmocap body show``: a picture of a body, its joints and how they turn."""

from __future__ import annotations

from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from mmocap_warp.cli.console import Console, Switch

if TYPE_CHECKING:
    from mmocap_warp.body.skeleton import Skeleton


def show_body(
    body: str,
    /,
    *,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    force: Switch = False,
    console: Console | None = None,
) -> None:
    """Draw a body: tracking mesh, joints by name, the axes about which they turn or along which they slide, limits.

    Parameters
    ----------
    body
        A body's USD file, or a shipped body's name.
    output
        The picture's file, .png; named after the body by default.
    force
        Replace a file that exists.
    """
    from mmocap_warp.commands.outputs import new_file
    from mmocap_warp.display.body_picture import draw_body
    from mmocap_warp.formats.usd.usd_body import read_body, read_motions
    from mmocap_warp.rigging.shipped import body_file

    console = console or Console()
    file = body_file(body)
    picture = new_file(output or Path(file.stem).with_suffix(".png"), ".png", force=force)
    read, motions = read_body(file), read_motions(file)
    draw_body(read, picture)
    skeleton = read.skeleton
    turning = {name: _freedom(skeleton, name) for name in skeleton.joints if name not in skeleton.sliding}
    sliding = {name: _freedom(skeleton, name) for name in skeleton.sliding}
    values = {
        "picture": picture,
        "parent": {
            name: skeleton.joints[above]
            for name, above in zip(skeleton.joints, skeleton.parent, strict=True)
            if above >= 0
        },
        "limits_deg": turning,
        "limits_m": sliding,
        "sliding": skeleton.sliding,
        "attached": skeleton.attached,
        "parts": skeleton.parts,
        "pairs": [pair[1:] for pair in skeleton.pairs],
        "motions": {name: len(motion.pose) for name, motion in motions.items()},
    }
    width = max(map(len, skeleton.joints))
    told = {name: f"slides {_ranges(free, '.3g')} m" for name, free in sliding.items() if free}
    told |= {name: _ranges(free, ".0f") for name, free in turning.items()}
    lines = [f"{name:<{width}}  {told.get(name) or 'fixed'}" for name in (*sliding, *turning)]
    console.result(values, "\n".join([f"{picture}; degrees that each joint turns about its axes:", *lines]))


def _ranges(free: dict[str, tuple[float, float]], form: str) -> str:
    def told(low: float, high: float) -> str:
        return f"{low:{form}} to {high:{form}}" if low > -inf or high < inf else "freely"

    return "   ".join(f"{axis} {told(*limits)}" for axis, limits in free.items())


def _freedom(skeleton: Skeleton, joint: str) -> dict[str, tuple[float, float]]:
    """Lowest and highest angle about each axis that is searched [degrees], or shift along it [m]."""
    import numpy as np

    first = skeleton.angles(joint).start
    searched = [int(coordinate) - first for coordinate in skeleton.searched()]
    limits = skeleton.limits[skeleton.index(joint)].astype(float)
    told = (limits if joint in skeleton.sliding else np.degrees(limits)).tolist()
    return {"xyz"[axis]: tuple(told[axis]) for axis in searched if 0 <= axis < 3}
