"""``mmocap cameras``: does the calibration look like the room it was made in?"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from mmocap_warp.cli.console import CHECK_FAILED, OK, Console, Switch

if TYPE_CHECKING:
    from mmocap_warp.scene.recording import Scene

_SEEN, _UNSEEN = 128, 64
"""Gray of foreground and background where a camera has no image."""


def cameras(
    scene: Path,
    /,
    *,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    force: Switch = False,
    console: Console | None = None,
) -> int:
    """Print a scene's cameras and draw the world axes into their views; masks need not be there yet.

    Parameters
    ----------
    scene
        The scene file, or its folder.
    output
        Folder for one picture per camera with the world's x, y and z axis in red, green and blue.
    force
        Write into a folder that holds files.
    """
    import numpy as np

    from mmocap_warp.cameras.rig import describe_rig
    from mmocap_warp.cli.console import mask_step, track_step
    from mmocap_warp.commands.outputs import new_folder
    from mmocap_warp.scene.scene_toml import load_scene

    console = console or Console()
    loaded = load_scene(scene, masks=False)
    rows = describe_rig(loaded.calibrated)
    mean_height = float(np.mean([row.height for row in rows]))
    drawn = [] if output is None else _draw_axes(loaded, new_folder(output, force=force))
    good = mean_height > 0
    have_masks = all(source.masks is not None for source in loaded.cameras)
    step = track_step(loaded.path) if have_masks else mask_step(loaded.path)
    values = {
        "cameras": [
            {
                "name": row.name,
                "size": size,
                "centre_m": row.centre,
                "height_m": row.height,
                "nearest_m": row.nearest,
                "field_of_view_deg": row.field_of_view,
            }
            for row, size in zip(rows, loaded.calibrated.size, strict=True)
        ],
        "up": loaded.calibrated.up,
        "mean_height_m": mean_height,
        "mean_height_ok": good,
        "pictures": drawn,
        "next": step if good else None,
    }
    header = f"{'camera':<12} {'size':>10} {'x':>8} {'y':>8} {'z':>8} {'height':>8} {'nearest':>8} {'view':>10}"
    lines = [header, f"{'':<12} {'px':>10} {'m':>8} {'m':>8} {'m':>8} {'m':>8} {'m':>8} {'deg':>10}"]
    for row, (width, height) in zip(rows, loaded.calibrated.size, strict=True):
        place = " ".join(f"{value:8.2f}" for value in (*row.centre, row.height, row.nearest))
        view = "{:.0f}x{:.0f}".format(*row.field_of_view)
        lines.append(f"{row.name:<12} {f'{width}x{height}':>10} {place} {view:>10}")
    lines += [str(picture) for picture in drawn]
    lines.append(f"mean height {mean_height:.2f} m along {loaded.calibrated.up}")
    if not good:
        lines.append("check failed: cameras at or below the world's zero; is [scene] up this calibration's vertical?")
    if output is not None:
        lines.append(f"{output}: the world's axes in {len(rows)} pictures, x red, y green, z blue")
    if good:
        lines.append(f"next: {step}")
    console.result(values, "\n".join(lines))
    return OK if good else CHECK_FAILED


def _draw_axes(scene: Scene, folder: Path) -> list[Path]:
    """Write a picture for each camera; returns their files."""
    import numpy as np

    from mmocap_warp.cameras.rig import draw_world_axes
    from mmocap_warp.formats.png import write_png

    rig = scene.rig()
    images = next(scene.images(count=1))
    masks = [np.zeros((height, width), bool) for width, height in rig.size]
    if any(image is None for image in images) and all(source.masks is not None for source in scene.cameras):
        masks = next(scene.masks(count=1))  # where there is no video, a view shows its mask
    for k, name in enumerate(rig.names):
        image = images[k]
        if image is None:
            image = np.where(masks[k][..., None], _SEEN, _UNSEEN).astype(np.uint8).repeat(3, axis=2)
        write_png(folder / f"{name}.png", draw_world_axes(image, rig, k))
    return [folder / f"{name}.png" for name in rig.names]
