"""``mmocap body``: bodies from MakeHuman's data, and of other programs' characters and robots."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from mmocap_warp.cli.console import Console, Switch
from mmocap_warp.errors import InputError, UsageError

app = App(name="body", help="Make a body, import another program's, learn its limits, or draw it.", version_flags=[])
app.command(
    "mmocap_warp.cli.body_import:import_body", name="import", help="Write a body of a rigged character or a robot."
)
app.command("mmocap_warp.cli.body_export:export_body", name="export", help="Write a body as glTF, with its motions.")
app.command("mmocap_warp.cli.body_learn:learn", name="learn", help="Write a body that turns as far as it was seen to.")
app.command("mmocap_warp.cli.body_show:show_body", name="show", help="Draw a body, its joints and how they turn.")


@app.command
def make(
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    data: Path,
    gender: float,
    age: float,
    height: float,
    weight: float = 0.5,
    muscle: float = 0.5,
    proportions: float = 0.5,
    name: str | None = None,
    force: Switch = False,
    console: Console | None = None,
) -> None:
    """Write a body of the given build as USD.

    Parameters
    ----------
    output
        The body's file: .usdc, .usda or .usd.
    data
        MakeHuman's data folder as MPFB2 ships it; docs/bodies.md says where to get it.
    gender
        0 woman to 1 man.
    age
        Years, 1 to 90.
    height
        Of the standing body, in metres.
    weight
        0 thin, 0.5 average, 1 heavy, for the height.
    muscle
        0 slack, 0.5 average, 1 muscular.
    proportions
        0 uncommon, 0.5 average, 1 ideal.
    name
        The body's name; the file's name without ending by default.
    force
        Replace a file that exists.
    """
    from mmocap_warp.commands.outputs import new_file
    from mmocap_warp.formats.usd.usd_body import write_body
    from mmocap_warp.formats.usd.usd_file import USD_SUFFIXES
    from mmocap_warp.rigging.making import make_body

    console = console or Console()
    new_file(output, *USD_SUFFIXES, force=force)
    build = {"gender": gender, "age": age, "height": height, "weight": weight, "muscle": muscle}
    try:
        body = make_body(data, name or output.stem, **build, proportions=proportions)
    except InputError:
        raise
    except ValueError as error:
        raise UsageError.of_setting(error) from None
    write_body(output, body)
    values = {
        "body": body.name,
        "file": output,
        "vertices": len(body.skin.rest),
        "tracking_triangles": len(body.tracking_face),
        "shape_targets": body.shape_names,
        "markers": body.marker_names,
    }
    triangles, targets = values["tracking_triangles"], len(body.shape_names)
    console.result(
        values, f"{output}: {values['vertices']} vertices, {triangles} tracking triangles, {targets} shape targets"
    )
