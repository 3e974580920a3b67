"""``mmocap calib convert``: a calibration in another program's format."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from mmocap_warp.cli.console import Console, Switch
from mmocap_warp.errors import UsageError


def convert(
    calibration: Path,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    units: str | None = None,
    up: str = "+z",
    size: str | None = None,
    force: Switch = False,
    console: Console | None = None,
) -> None:
    """Write a calibration in the format that the output's name tells, lengths in metres.

    Parameters
    ----------
    calibration
        What is read, known by its ending: a file, or a folder where the format has one.
    output
        NAME.toml (Pose2Sim, aniposelib), intri.yml (EasyMocap, OpenCV; with extri.yml), cameras.txt (COLMAP; with
        images.txt and points3D.txt) or NAME.usda, NAME.usdc, NAME.usd.
    units
        m or mm: of the lengths that are read, where the format leaves that open.
    up
        The vertical of the calibration's world, such as +y; it is written to USD, the other formats do not have it.
    size
        Such as 1920x1080: of the images of cameras for which the calibration tells none.
    force
        Replace files that exist.
    """
    from mmocap_warp.cameras.rig import UP_AXES
    from mmocap_warp.commands.outputs import new_file
    from mmocap_warp.formats.calibration.image_size import EVERY_OTHER
    from mmocap_warp.formats.calibration.units import METRES
    from mmocap_warp.formats.table import calibration_export, read_calibration, write_calibration

    console = console or Console()
    if units is not None and units not in METRES:
        raise UsageError(f"--units must be {' or '.join(METRES)}, got '{units}'")
    if up not in UP_AXES:
        raise UsageError(f"--up must be one of {', '.join(UP_AXES)}, got '{up}'")
    sizes = None if size is None else {EVERY_OTHER: _size(size)}
    written = calibration_export(output)
    files = [output, *(output.with_name(name) for name in written.beside)]
    rig = read_calibration(calibration, units, up, sizes)
    for file in files:
        new_file(file, file.suffix, force=force)
    write_calibration(output, rig)
    rows = [
        {"name": name, "size": rig.size[k], "fisheye": name in rig.fisheye, "centre_m": rig.centres[k]}
        for k, name in enumerate(rig.names)
    ]
    values = {"file": output, "files": files, "format": written.name, "cameras": rows}
    console.result(values, f"{output}: {', '.join(rig.names)} as {written.name}")


def _size(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"([1-9]\d{0,5})x([1-9]\d{0,5})", text)
    if found is None:
        raise UsageError(f"--size must be such as 1920x1080, got '{text}'")
    return int(found[1]), int(found[2])
