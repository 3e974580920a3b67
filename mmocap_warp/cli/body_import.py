"""``mmocap body import``: a body of another program's character or robot."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from mmocap_warp.cli.console import Console, Switch
from mmocap_warp.errors import InputError

if TYPE_CHECKING:
    from mmocap_warp.formats.rigged.rigged_mesh import RiggedMesh
    from mmocap_warp.rigging.importing.freedom import Freedom
    from mmocap_warp.rigging.importing.imported import Imported

_Axis = Literal["+x", "-x", "+y", "-y", "+z", "-z"]


def import_body(
    file: Path,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    up: Annotated[_Axis | None, Parameter(show_choices=False)] = None,
    facing: Annotated[_Axis | None, Parameter(show_choices=False)] = None,
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
    """Write a body of a rigged character (.glb, .gltf, .usd, .usda, .usdc) or a robot (.urdf).

    What was done to it is printed: joints left out, holes closed, triangles and weights reduced.

    Parameters
    ----------
    file
        The character or robot.
    output
        The body's file: .usdc, .usda or .usd.
    up
        The file's axis that points up, such as +z. [default: what its format says]
    facing
        The file's axis along which the body faces. [default: +z of glTF, +x of URDF, +z or -y of USD]
    scale
        What lengths are multiplied by, besides the unit that the file states.
    triangles
        At most, of the mesh that is tracked.
    skin_triangles
        At most, of the mesh that is shown.
    joints
        A file that says how joints turn, .toml; what it leaves out is derived.
    write_joints
        Write how joints turn to this file, .toml, to be edited and given as --joints.
    meshes
        The folder of a robot's meshes; its file's own by default.
    name
        The body's name; the output's name without ending by default.
    attribution
        Who made it, and under which licence; what the file says by default.
    force
        Replace files that exist.
    """
    from mmocap_warp.commands.outputs import new_file
    from mmocap_warp.formats.usd.usd_body import write_body
    from mmocap_warp.formats.usd.usd_file import USD_SUFFIXES
    from mmocap_warp.rigging.importing.joints_file import write_joints_file

    console = console or Console()
    new_file(output, *USD_SUFFIXES, force=force)
    if write_joints is not None:
        new_file(write_joints, ".toml", force=force)
    made = _made(file, name or output.stem, up, facing, scale, triangles, skin_triangles, joints, meshes)
    if attribution is not None:
        made = replace(made, body=replace(made.body, attribution=attribution))
    write_body(output, made.body, made.motions)
    if write_joints is not None:
        write_joints_file(write_joints, made.body, made.freedom)
    _tell(made, output, console)


def _made(
    file: Path,
    name: str,
    up: str | None,
    facing: str | None,
    scale: float,
    triangles: int,
    skin_triangles: int,
    joints: Path | None,
    meshes: Path | None,
) -> Imported:
    """The body of a file.

    Raises:
        InputError: no body can be made of it.
        UsageError: a flag that cannot be.
    """
    from mmocap_warp.errors import UsageError
    from mmocap_warp.rigging.importing.body_axes import body_from_file
    from mmocap_warp.rigging.importing.imported import imported
    from mmocap_warp.rigging.importing.joints_file import read_joints_file

    given = None if joints is None else read_joints_file(joints)
    mesh = _read(file, meshes)
    try:
        body_from_file(up or mesh.up, facing or mesh.facing)
    except ValueError as error:
        raise UsageError.of_setting(error) from None
    if not scale > 0 or triangles < 4 or skin_triangles < triangles:
        raise UsageError(
            "--scale must be positive, --triangles at least 4 and --skin-triangles as many at least, "
            f"got {scale:g}, {triangles} and {skin_triangles}"
        )
    plain = re.sub(r"\W", "_", name, flags=re.ASCII)
    plain = plain if plain[:1].isalpha() else f"_{plain}"
    try:
        return imported(
            mesh,
            plain,
            up=up,
            facing=facing,
            scale=scale,
            triangles=triangles,
            skin_triangles=skin_triangles,
            joints=given,
        )
    except InputError:
        raise
    except ValueError as error:
        raise InputError(file, str(error), "change the file, or say how joints are with --joints") from None


def _read(file: Path, meshes: Path | None) -> RiggedMesh:
    from mmocap_warp.formats.usd.usd_file import USD_SUFFIXES

    suffix = file.suffix.lower()
    if not file.is_file():
        raise InputError(file, "no such file", "check the path")
    if suffix in (".glb", ".gltf"):
        from mmocap_warp.formats.rigged.gltf import read_gltf

        return read_gltf(file)
    if suffix == ".urdf":
        from mmocap_warp.formats.rigged.urdf import read_urdf

        return read_urdf(file, meshes)
    if suffix in USD_SUFFIXES:
        from mmocap_warp.formats.rigged.usd_skel import read_usd_skel

        return read_usd_skel(file)
    known = ", ".join((".glb", ".gltf", ".urdf", *USD_SUFFIXES))
    raise InputError(file, "is of a kind that is not read", f"give a file that ends in {known}")


def _tell(made: Imported, output: Path, console: Console) -> None:
    import numpy as np

    body, skeleton = made.body, made.body.skeleton
    size = np.ptp(body.skin.rest[np.unique(body.skin.face)], axis=0).astype(float)
    kinds = [_kind(how) for how in made.freedom[1:]]
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
    wide, tall, long = size
    of_kinds = ", ".join(f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds))
    lines = [
        f"{output}: {len(skeleton.joints)} joints ({of_kinds}), "
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
