"""Writing what was made up as a scene: masks, calibration, truth, and the scene file that names them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from mmocap_warp.errors import InputError
from mmocap_warp.formats.calibration.toml_rig import write_toml_rig
from mmocap_warp.formats.png import write_png
from mmocap_warp.formats.usd.truth import write_truth
from mmocap_warp.result.truth import Truth
from mmocap_warp.synthesis.walk import Recording
from mmocap_warp.views.rig import CameraRig
from mmocap_warp.whole_file import write_whole

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

Progress = Callable[[int], None]
"""Called after each frame with the number of frames done."""


def write_recording(folder: str | Path, recording: Recording, progress: Progress | None = None) -> Path:
    """Write ``masks/<camera>/<frame>.png`` (1 bit), ``calibration.toml``, ``truth.usdc`` and last ``scene.toml``.

    Files of the same names are replaced.

    Args:
        folder: made if it does not exist; its name becomes the scene's.
        recording: what to write.
        progress: called after each frame.

    Returns:
        Path of ``scene.toml``.

    Raises:
        InputError: a folder that cannot be written to.
    """
    folder, rig = Path(folder), recording.rig
    write_images(folder, rig, (recording.masks(frame) for frame in range(len(recording.poses))), progress)
    write_known(folder, rig, recording.truth())
    text = _SCENE.format(name=folder.resolve().name, fps=recording.fps, up=rig.up, cameras=camera_tables(rig))
    write_whole(folder / "scene.toml", text.encode())
    return folder / "scene.toml"


def write_images(
    folder: Path, rig: CameraRig, frames: Iterable[list[np.ndarray]], progress: Progress | None = None
) -> None:
    """Write the masks of each frame below ``folder/masks``.

    Raises:
        InputError: a folder that cannot be written to.
    """
    try:
        for name in rig.names:
            (folder / "masks" / name).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(folder, f"cannot be written to ({error})", "choose another folder") from error
    for frame, masks in enumerate(frames):
        for name, mask in zip(rig.names, masks, strict=True):
            write_png(folder / "masks" / name / f"{frame:04d}.png", mask)
        if progress is not None:
            progress(frame + 1)


def write_known(folder: Path, rig: CameraRig, truth: Truth) -> None:
    """Write ``calibration.toml`` and ``truth.usdc``.

    Raises:
        InputError: a folder that cannot be written to.
    """
    write_toml_rig(folder / "calibration.toml", rig)
    write_truth(folder / "truth.usdc", truth, rig.up)


def camera_tables(rig: CameraRig) -> str:
    """The tables of a scene file that name the masks."""
    return "".join(f'\n[cameras.{name}]\nmasks = "masks/{name}"\n' for name in rig.names)
