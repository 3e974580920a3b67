"""``mmocap body export``: a body for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from mmocap_warp.cli.console import Console, Switch


def export_body(
    body: str,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    force: Switch = False,
    console: Console | None = None,
) -> None:
    """Write a body in its bind pose as glTF, with its own motions. As USD it is for other programs already.

    Parameters
    ----------
    body
        A body's USD file, or a shipped body's name.
    output
        The file: .glb.
    force
        Replace a file that exists.
    """
    from mmocap_warp.commands.outputs import new_file
    from mmocap_warp.formats.exports.glb import write_body_glb
    from mmocap_warp.formats.usd.usd_body import read_body, read_motions
    from mmocap_warp.rigging.shipped import body_file

    console = console or Console()
    new_file(output, ".glb", force=force)
    file = body_file(body)
    read, motions = read_body(file), read_motions(file)
    write_body_glb(read, motions, output)
    values = {"file": output, "joints": read.skeleton.joints, "motions": list(motions)}
    console.result(values, f"{output}: {len(read.skeleton.joints)} joints, {len(motions)} motions")
