"""Writing a shipped sequence as an ordinary scene, to look at or to track on its own."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from mmocap_warp.formats.usd.body import write_subject
from mmocap_warp.study.sequences import StudySequence
from mmocap_warp.synthesis.writing import camera_tables, write_images, write_known
from mmocap_warp.whole_file import write_whole

_SCENE = """\
# {name} of the study's shipped sequences, made up with known truth.
[scene]
name = "{name}"
fps = {fps:g}
up = "{up}"
subject = "subject.usdc"

[truth]
file = "truth.usdc"

[cameras]
calibration = "calibration.toml"
{cameras}
# The study tracks these masks as they are, with all their faults.
[foreground]
source = "masks"
"""


def write_sequence(
    folder: str | Path, sequence: StudySequence, progress: Callable[[int, int], None] | None = None
) -> Path:
    """Write a sequence as a scene whose observations are the sequence's own, bit for bit.

    The folder gets ``masks/<camera>/<frame>.png`` (1 bit), ``calibration.toml``, ``truth.usdc`` (true markers with
    their noise, joints and poses), ``subject.usdc`` (where tracking starts) and last ``scene.toml``. Files of the same
    names are replaced.

    Args:
        folder: made if it does not exist, with the folders above it.
        sequence: what to write.
        progress: called after each frame with the numbers of frames done and in all.

    Returns:
        Path of ``scene.toml``.

    Raises:
        InputError: a folder that cannot be written to.
    """
    folder, rig, total = Path(folder), sequence.rig, sequence.frame_count
    report = None if progress is None else lambda done: progress(done, total)
    write_images(folder, rig, (sequence.footage.masks(frame) for frame in range(total)), report)
    write_known(folder, rig, sequence.truth)
    write_subject(folder / "subject.usdc", sequence.subject)
    text = _SCENE.format(name=sequence.name, fps=sequence.fps, up=rig.up, cameras=camera_tables(rig))
    write_whole(folder / "scene.toml", text.encode())
    return folder / "scene.toml"
