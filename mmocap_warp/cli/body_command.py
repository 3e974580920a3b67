"""``mmocap body``: bodies of other programs' characters and robots, and what is done with bodies."""

from __future__ import annotations

from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import App, Parameter

from mmocap_warp.cli.command_help import documented_by
from mmocap_warp.cli.console import Console, Output, Switch

if TYPE_CHECKING:
    from mmocap_warp.body.skeleton import Skeleton
    from mmocap_warp.rigging.importing.freedom import Freedom
    from mmocap_warp.rigging.importing.imported import Imported

_Axis = Annotated[Literal["+x", "-x", "+y", "-y", "+z", "-z"] | None, Parameter(show_choices=False)]

app = App(name="body", help="Import another program's body, export, draw it, or learn its limits.", version_flags=[])


@app.command(name="import", help="Write a body of a rigged character or a robot.")
@documented_by("bodies:import_body")
def import_body(
    file: Path,
    /,
    *,
    output: Annotated[Path, Output],
    up: _Axis = None,
    facing: _Axis = None,
    scale: float = 1.0,
    triangles: int = 2600,
    skin_triangles: int = 60_000,
    joints: Path | None = None,
    write_joints: Path | None = None,
    meshes: Path | None = None,
    name: str | None = None,
    attribution: str | None = None,
    force: Switch = False,
    console: Console | None = None,
) -> None:
    from mmocap_warp.commands.bodies import import_body

    made = import_body(
        file,
        output,
        up=up,
        facing=facing,
        scale=scale,
        triangles=triangles,
        skin_triangles=skin_triangles,
        joints=joints,
        write_joints=write_joints,
        meshes=meshes,
        name=name,
        attribution=attribution,
        force=force,
    )
    _print_import(made, output, console or Console())


def _print_import(made: Imported, output: Path, console: Console) -> None:
    import numpy as np

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
    }
    kinds = [_kind(how) for how in made.freedom[1:]]
    counts = ", ".join(f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds))
    wide, tall, long = size
    lines = [
        f"{output}: {len(skeleton.joints)} joints ({counts}), "
        f"{len(skeleton.searched())} degrees of freedom, {len(skeleton.pairs)} left-right pairs"
        + (", rigid" if body.rigid else "")
        + ("" if skeleton.stands else ", lies anyhow")
        + ("" if made.freedom[0].free else ", on a base that stands still"),
        f"  {wide:.3g} m wide, {tall:.3g} m tall, {long:.3g} m long; {len(body.tracking_face)} tracking triangles",
        *(f"  {note}" for note in made.notes),
        f"  {body.attribution}",
    ]
    console.result(values, "\n".join(lines))


def _kind(how: Freedom) -> str:
    if not how.free:
        return "fixed"
    return "slider" if how.slides else "hinge" if len(how.free) == 1 else "ball"


@app.command(name="export", help="Write a body as glTF, with its motions.")
@documented_by("bodies:export_body")
def export_body(
    body: str, /, *, output: Annotated[Path, Output], force: Switch = False, console: Console | None = None
) -> None:
    from mmocap_warp.commands.bodies import export_body

    written = export_body(body, output, force=force)
    values = {"file": output, "joints": written.body.skeleton.joints, "motions": list(written.motions)}
    (console or Console()).result(values, repr(written))


@app.command(help="Write a body that turns as far as it was seen to.")
@documented_by("bodies:learn_body", motion="motions", result="results")
def learn(
    body: str,
    /,
    *,
    output: Annotated[Path, Output],
    motion: list[str] | None = None,
    result: list[Path] | None = None,
    margin: float = 10.0,
    force: Switch = False,
    console: Console | None = None,
) -> None:
    from mmocap_warp.commands.bodies import learn_body

    written = learn_body(body, output, motions=motion or (), results=result or (), margin=margin, force=force)
    before, after = _mean_ranges(written.before), _mean_ranges(written.body.skeleton)
    values: dict[str, object] = {"body": written.body.name, "file": output, "frames": written.frames}
    parts = []
    for unit, move, form, word in (("deg", "angles turn", ".0f", "degrees"), ("m", "joints slide", ".3g", "m")):
        if unit in before:
            values |= {f"mean_range_{unit}": after[unit], f"before_{unit}": before[unit]}
            parts.append(f"{move} by {after[unit]:{form}} {word} on average, {before[unit]:{form}} before")
    (console or Console()).result(values, f"{output}: {'; '.join([*parts, f'{written.frames} frames'])}")


def _mean_ranges(skeleton: Skeleton) -> dict[str, float]:
    """Mean width of the limits of searched coordinates, by unit: angles [``deg``] and shifts [``m``]."""
    import numpy as np

    searched = skeleton.searched()
    width, is_length = np.ptp(skeleton.coordinate_limits[searched], axis=1), skeleton.is_length[searched]
    ranges = {"deg": np.degrees(width[np.isfinite(width) & ~is_length]), "m": width[np.isfinite(width) & is_length]}
    return {unit: float(each.mean()) for unit, each in ranges.items() if len(each)}


@app.command(name="show", help="Draw a body, its joints and how they turn.")
@documented_by("bodies:show_body")
def show_body(
    body: str,
    /,
    *,
    output: Annotated[Path | None, Output] = None,
    force: Switch = False,
    console: Console | None = None,
) -> None:
    from mmocap_warp.commands.bodies import show_body

    shown = show_body(body, output, force=force)
    skeleton = shown.body.skeleton
    turning = {name: _freedom(skeleton, name) for name in skeleton.joints if name not in skeleton.sliding}
    sliding = {name: _freedom(skeleton, name) for name in skeleton.sliding}
    parents = zip(skeleton.joints, skeleton.parent, strict=True)
    values = {
        "picture": shown.file,
        "parent": {name: skeleton.joints[above] for name, above in parents if above >= 0},
        "limits_deg": turning,
        "limits_m": sliding,
        "sliding": skeleton.sliding,
        "attached": skeleton.attached,
        "parts": skeleton.parts,
        "pairs": [pair[1:] for pair in skeleton.pairs],
        "motions": {name: len(motion.pose) for name, motion in shown.motions.items()},
    }
    width = max(map(len, skeleton.joints))
    ranges = {name: f"slides {_ranges(free, '.3g')} m" for name, free in sliding.items() if free}
    ranges |= {name: _ranges(free, ".0f") for name, free in turning.items()}
    lines = [f"{name:<{width}}  {ranges.get(name) or 'fixed'}" for name in (*sliding, *turning)]
    text = "\n".join([f"{shown.file}; degrees that each joint turns about its axes:", *lines])
    (console or Console()).result(values, text)


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
