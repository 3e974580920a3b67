"""Writing a HumanEva sequence as a scene: text, calibration and truth; images stay where the user has them."""

from __future__ import annotations

from pathlib import Path

from mmocap_warp.errors import InputError
from mmocap_warp.formats.calibration.toml_rig import write_toml_rig
from mmocap_warp.formats.humaneva.sequence import FPS, HumanEvaSequence
from mmocap_warp.formats.toml_table import quoted
from mmocap_warp.formats.usd.usd_truth import write_truth
from mmocap_warp.whole_file import write_whole

_FOREGROUND = """
# Lengths suit a subject of 300 pixels. Gray images have no colour to tell a shadow by, so shadows stay.
[foreground]
source = "background_video"
model = "gaussian"
shadow_brightness = 1.0
median = 3.0
close = 5.0
fill_holes = 60.0
min_area = 120.0
keep = "largest"
join = 20.0
"""


def write_scene(folder: str | Path, sequence: HumanEvaSequence) -> Path:
    """Write ``calibration.toml``, ``truth.usdc`` and last ``scene.toml``, which names the user's videos.

    Files of the same names are replaced.

    Args:
        folder: made if it does not exist.
        sequence: what to write.

    Returns:
        Path of ``scene.toml``.

    Raises:
        InputError: a folder that cannot be written to.
    """
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(folder, f"cannot be written to ({error})", "choose another folder") from error
    write_toml_rig(folder / "calibration.toml", sequence.rig)
    write_truth(folder / "truth.usdc", sequence.truth, sequence.rig.up)
    write_whole(folder / "scene.toml", _scene_text(sequence).encode())
    return folder / "scene.toml"


def _scene_text(sequence: HumanEvaSequence) -> str:
    lines = [
        f"# HumanEva-I, {sequence.subject} {sequence.action}, trial 1, written by mmocap humaneva.",
        f"# Frame 0 is frame {sequence.first} of HumanEva's own numbers.",
        "[scene]",
        f'name = "{sequence.subject} {sequence.action}"',
        f"fps = {FPS:g}",
        f'up = "{sequence.rig.up}"',
        f"frames = {sequence.count}",
        "",
        "[truth]",
        'file = "truth.usdc"',
        "",
        "[cameras]",
        'calibration = "calibration.toml"',
    ]
    cameras = zip(sequence.rig.names, sequence.videos, sequence.backgrounds, sequence.frame_offsets, strict=True)
    for name, video, background, offset in cameras:
        lines += [
            "",
            f"[cameras.{name}]",
            f"video = {_quoted(video.path)}",
            f"background = {_quoted(background.path)}",
            f"frame_offset = {offset}",
        ]
    return "\n".join(lines) + "\n" + _FOREGROUND


def _quoted(path: Path) -> str:
    """A TOML string of the whole path, since scene and data set move apart."""
    return quoted(path.resolve().as_posix())
