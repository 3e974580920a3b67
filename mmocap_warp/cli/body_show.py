"""``mmocap body show``: a picture of a body, its joints and how they turn."""

from __future__ import annotations

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
    """Draw a body: tracking mesh, joints by name, the axes about which they turn, and their limits.

    Parameters
    ----------
    body
        A body's USD file, or a shipped body's name.
    output
        The picture's file, .png; named after the body by default.
    force
        Replace a file that exists.
    """
    from mmocap_warp.bodies.shipped import body_file
    from mmocap_warp.cli.outputs import new_file
    from mmocap_warp.drawing.body_picture import draw_body
    from mmocap_warp.formats.usd.body import read_body, read_motions

    console = console or Console()
    file = body_file(body)
    picture = new_file(output or Path(file.stem).with_suffix(".png"), ".png", force=force)
    read, motions = read_body(file), read_motions(file)
    draw_body(read, picture)
    skeleton = read.skeleton
    freedom = {name: _freedom(skeleton, name) for name in skeleton.joints if name not in skeleton.sliding}
    values = {
        "picture": picture,
        "parent": {
            name: skeleton.joints[above]
            for name, above in zip(skeleton.joints, skeleton.parent, strict=True)
            if above >= 0
        },
        "limits_deg": freedom,
        "sliding": skeleton.sliding,
        "attached": skeleton.attached,
        "parts": skeleton.parts,
        "pairs": [pair[1:] for pair in skeleton.pairs],
        "motions": {name: len(motion.pose) for name, motion in motions.items()},
    }
    width = max(map(len, skeleton.joints))
    lines = [f"{name:<{width}}  slides" for name in skeleton.sliding]
    for name, free in freedom.items():
        turns = "   ".join(f"{axis} {low:.0f} to {high:.0f}" for axis, (low, high) in free.items())
        lines.append(f"{name:<{width}}  {turns or 'fixed'}")
    console.result(values, "\n".join([f"{picture}; degrees that each joint turns about its axes:", *lines]))


def _freedom(skeleton: Skeleton, joint: str) -> dict[str, tuple[float, float]]:
    """Lowest and highest angle about each axis that is searched [degrees]."""
    import numpy as np

    first = skeleton.angles(joint).start
    searched = [int(coordinate) - first for coordinate in skeleton.searched()]
    limits = np.degrees(skeleton.limits[skeleton.index(joint)].astype(float)).tolist()
    return {"xyz"[axis]: tuple(limits[axis]) for axis in searched if 0 <= axis < 3}
