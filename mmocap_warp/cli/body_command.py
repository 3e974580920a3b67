"""``mmocap body``: bodies of other programs' characters and robots, and what is done with bodies."""

from __future__ import annotations

from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import App, Parameter

from mmocap_warp.cli.command import Answer, attributes, command, several
from mmocap_warp.cli.console import CHECK_FAILED

if TYPE_CHECKING:
    from mmocap_warp.body.skeleton import Skeleton
    from mmocap_warp.rigging.importing.freedom import Freedom

_Axis = Annotated[
    Literal["+x", "-x", "+y", "-y", "+z", "-z"] | None, Parameter(show_choices=False, allow_leading_hyphen=True)
]

app = App(name="body", help="Import another program's body, export, draw it, or learn its limits.", version_flags=[])


@app.command(name="import", help="Write a body of a rigged character or a robot.")
@command("bodies:import_body", up=_Axis, facing=_Axis)
def import_body(call: Any, output: Path) -> Answer:
    import numpy as np

    made = call()
    body, skeleton = made.body, made.body.skeleton
    size = np.ptp(body.skin.rest[np.unique(body.skin.face)], axis=0).astype(float)
    values = {
        "body": body.name,
        "file": output,
        "joints": skeleton.joints,
        "degrees_of_freedom": len(skeleton.searched()),
        "rigid": body.rigid,
        "stands": skeleton.stands,
        "size": size.round(4).tolist(),
        "vertices": len(body.skin.rest),
        "tracking_triangles": len(body.tracking_face),
        "motions": list(made.motions),
        "notes": made.notes,
        "outline_overlap": round(made.outline.overlap, 4),
        "fault": made.fault,
    }
    kinds = [_kind(how) for how in made.freedom[1:]]
    counts = ", ".join(f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds))
    wide, tall, long = size
    lines = [
        f"{output}: {len(skeleton.joints)} joints ({counts}), "
        f"{len(skeleton.searched())} degrees of freedom, {len(skeleton.pairs)} left-right pairs"
        + (", rigid" if body.rigid else "")
        + ("" if skeleton.stands else ", any way up")
        + ("" if made.freedom[0].free else ", on a base that stands still"),
        f"  {wide:.3g} m wide, {tall:.3g} m tall, {long:.3g} m long; {len(body.tracking_face)} tracking triangles",
        *(f"  {note}" for note in made.notes),
        f"  {body.attribution}",
    ]
    if not made.fault:
        return Answer(values, lines)
    remedy = "if that joint hangs on a wrong one, say so in a joints file (--write-joints, --joints), or use --force"
    return Answer(values, [*lines, f"check failed: {made.fault}; {remedy}"], CHECK_FAILED)


def _kind(how: Freedom) -> str:
    if not how.free:
        return "fixed"
    return "slider" if how.slides else "hinge" if len(how.free) == 1 else "ball"


@app.command(name="export", help="Write a body as glTF, with its motions.")
@command("bodies:export_body")
def export_body(call: Any, output: Path) -> Answer:
    written = call()
    joints = written.body.skeleton.joints
    return Answer({"file": output, "joints": joints, "motions": list(written.motions)}, [written])


@app.command(help="Write a body that turns as far as it was seen to.")
@command("bodies:learn_body", motions=several("--motion"), results=several("--result", Path))
def learn(call: Any, output: Path) -> Answer:
    written = call()
    before, after = _mean_ranges(written.before), _mean_ranges(written.body.skeleton)
    values: dict[str, object] = {"body": written.body.name, "file": output, "frames": written.frames}
    parts = []
    for unit, move, form, word in (("deg", "angles turn", ".0f", "degrees"), ("m", "joints slide", ".3g", "m")):
        if unit in before:
            values |= {f"mean_range_{unit}": after[unit], f"before_{unit}": before[unit]}
            parts.append(f"{move} by {after[unit]:{form}} {word} on average, {before[unit]:{form}} before")
    return Answer(values, [f"{output}: {'; '.join([*parts, f'{written.frames} frames'])}"])


def _mean_ranges(skeleton: Skeleton) -> dict[str, float]:
    """Mean width of the limits of searched coordinates, by unit: angles [``deg``] and shifts [``m``]."""
    import numpy as np

    searched = skeleton.searched()
    width, is_length = np.ptp(skeleton.coordinate_limits[searched], axis=1), skeleton.is_length[searched]
    ranges = {"deg": np.degrees(width[np.isfinite(width) & ~is_length]), "m": width[np.isfinite(width) & is_length]}
    return {unit: float(each.mean()) for unit, each in ranges.items() if len(each)}


@app.command(name="show", help="Draw a body, its joints and how they turn.")
@command("bodies:show_body")
def show_body(call: Any) -> Answer:
    shown = call()
    skeleton = shown.body.skeleton
    turning = {name: _freedom(skeleton, name) for name in skeleton.joints if name not in skeleton.sliding}
    sliding = {name: _freedom(skeleton, name) for name in skeleton.sliding}
    parents = zip(skeleton.joints, skeleton.parent, strict=True)
    values = {
        "picture": shown.file,
        "parent": {name: skeleton.joints[above] for name, above in parents if above >= 0},
        "limits_deg": turning,
        "limits_m": sliding,
        **attributes(skeleton, "sliding", "attached", "parts"),
        "pairs": [pair[1:] for pair in skeleton.pairs],
        "motions": {name: len(motion.pose) for name, motion in shown.motions.items()},
    }
    width = max(map(len, skeleton.joints))
    ranges = {name: f"slides {_ranges(free, '.3g')} m" for name, free in sliding.items() if free}
    ranges |= {name: _ranges(free, ".0f") for name, free in turning.items()}
    lines = [f"{name:<{width}}  {ranges.get(name) or 'fixed'}" for name in (*sliding, *turning)]
    return Answer(values, [f"{shown.file}; degrees that each joint turns about its axes:", *lines])


def _ranges(free: dict[str, tuple[float, float]], form: str) -> str:
    """Limits about each axis in words."""
    return "   ".join(
        f"{axis} " + (f"{low:{form}} to {high:{form}}" if low > -inf or high < inf else "freely")
        for axis, (low, high) in free.items()
    )


def _freedom(skeleton: Skeleton, joint: str) -> dict[str, tuple[float, float]]:
    """Lowest and highest angle about each axis that is searched [degrees], or shift along it [m]."""
    import numpy as np

    first = skeleton.angles(joint).start
    searched = [int(coordinate) - first for coordinate in skeleton.searched()]
    limits = skeleton.limits[skeleton.index(joint)].astype(float)
    values = (limits if joint in skeleton.sliding else np.degrees(limits)).tolist()
    return {"xyz"[axis]: tuple(values[axis]) for axis in searched if 0 <= axis < 3}
