"""Writing a recording as a scene: masks, calibration, truth, and the scene file that names them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from mmocap_warp.errors import InputError
from mmocap_warp.formats.png import write_png
from mmocap_warp.formats.toml_rig import write_toml_rig
from mmocap_warp.formats.usd_truth import write_truth
from mmocap_warp.formats.whole_file import write_whole
from mmocap_warp.synthesis.recording import Recording

_SCENE = """\
# A person walking along part of a circle, made up with known truth. See README.md.
[scene]
name = "{name}"
fps = {fps:g}
up = "{up}"

[truth]
file = "truth.usdc"

[cameras]
calibration = "calibration.toml"
{cameras}
# The masks have ragged contours, holes, specks and shadows.
[foreground]
source = "masks"
median = 3.0
fill_holes = 150.0
min_area = 200.0
keep = "largest"
join = 6.0
"""


def write_recording(folder: str | Path, recording: Recording, progress: Callable[[int], None] | None = None) -> Path:
    """Write ``masks/<camera>/<frame>.png`` (1 bit), ``calibration.toml``, ``truth.usdc`` and last ``scene.toml``.

    Files of the same names are replaced.

    Args:
        folder: made if it does not exist; its name becomes the scene's.
        recording: what to write.
        progress: called after each frame with the number of frames done.

    Returns:
        Path of ``scene.toml``.

    Raises:
        InputError: a folder that cannot be written to.
    """
    folder, rig = Path(folder), recording.rig
    try:
        for name in rig.names:
            (folder / "masks" / name).mkdir(parents=True, exist_ok=True)
        for frame in range(len(recording.poses)):
            for name, mask in zip(rig.names, recording.masks(frame), strict=True):
                write_png(folder / "masks" / name / f"{frame:04d}.png", mask)
            if progress is not None:
                progress(frame + 1)
        write_toml_rig(folder / "calibration.toml", rig)
        write_truth(folder / "truth.usdc", recording.truth(), rig.up)
        cameras = "".join(f'\n[cameras.{name}]\nmasks = "masks/{name}"\n' for name in rig.names)
        text = _SCENE.format(name=folder.resolve().name, fps=recording.fps, up=rig.up, cameras=cameras)
        write_whole(folder / "scene.toml", text.encode())
    except OSError as error:
        raise InputError(folder, f"cannot be written to ({error})", "choose another folder") from error
    return folder / "scene.toml"
