"""Writing a shipped sequence as an ordinary scene, to look at or to track on its own."""

from __future__ import annotations

from pathlib import Path

from mmocap_warp.study.sequences import StudySequence
from mmocap_warp.synthesis.writing import Progress, write_made_scene

_FOREGROUND = """\
# The study tracks these masks as they are, with all their faults.
[foreground]
source = "masks"
"""


def write_sequence(folder: str | Path, sequence: StudySequence, progress: Progress | None = None) -> Path:
    """Write a sequence as a scene whose observations are the sequence's own, bit for bit.

    The folder gets ``masks/<camera>/<frame>.png`` (1 bit), ``calibration.toml``, ``truth.usdc`` (true markers with
    their noise, joints and poses), ``subject.usdc`` (where tracking starts) and last ``scene.toml``. Files of the same
    names are replaced.

    Args:
        folder: made if it does not exist, with the folders above it.
        sequence: what to write.
        progress: called after each frame.

    Returns:
        Path of ``scene.toml``.

    Raises:
        InputError: a folder that cannot be written to.
    """
    return write_made_scene(
        Path(folder),
        sequence.recording,
        sequence.truth,
        name=sequence.name,
        about=f"{sequence.name} of the study's shipped sequences, made up with known truth.",
        foreground=_FOREGROUND,
        subject=sequence.subject,
        progress=progress,
    )
