"""Writing a shipped sequence as an ordinary scene, whole or made worse, to look at or to track on its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mmocap_warp.masks.observation import unpack_masks
from mmocap_warp.study.degradations import NONE, degraded, parse
from mmocap_warp.study.sequences import StudySequence
from mmocap_warp.study.source import OpenClip, open_sequence
from mmocap_warp.synthesis.writing import Progress, write_made_scene

_FOREGROUND = """\
# The study tracks these masks as they are, with all their faults.
[foreground]
source = "masks"
keep = "all"
"""

_LABELS = """
[labels]
person = 1
thing = 2
"""
_THING = 2


def write_sequence(
    folder: str | Path,
    sequence: StudySequence,
    progress: Progress | None = None,
    *,
    degradation: str = NONE,
    seed: int = 0,
) -> Path:
    """Write a sequence as a scene whose observations are the sequence's own, bit for bit, or these made worse.

    The folder gets ``masks/<camera>/<frame>.png`` (1 bit), ``calibration.toml``, ``truth.usdc`` (true markers with
    their noise, joints and poses), ``subject.usdc`` (where tracking starts) and last ``scene.toml``. Files of the same
    names are replaced.

    ``progress`` is called after each frame. Returns the path of ``scene.toml``.

    Raises:
        InputError: a folder that cannot be written to.
        ValueError: a degradation that means nothing to this sequence.
    """
    labelled = "labelled" in parse(degradation)
    worse = degraded(open_sequence(sequence), degradation, seed)
    about = f"{sequence.name} of the study's shipped sequences, made up with known truth."
    if degradation != NONE:
        about += f" Made worse: {degradation}, seed {seed}."
    return write_made_scene(
        Path(folder),
        _Streamed(worse, labelled),
        worse.truth or sequence.truth,
        name=sequence.name,
        about=about,
        foreground=_FOREGROUND + (_LABELS if labelled else ""),
        subject=sequence.subject,
        progress=progress,
    )


class _Streamed:
    """A clip as footage."""

    def __init__(self, clip: OpenClip, labelled: bool) -> None:
        self._clip, self._labelled = clip, labelled
        self.fps, self.rig = clip.fps, clip.rig

    def __len__(self) -> int:
        return self._clip.frames

    def masks(self, frame: int) -> list[np.ndarray]:
        """Per camera (height, width) bool, of the next frame; labels where something may be in front."""
        seen = next(self._clip.observations)
        masks, hidden = unpack_masks(seen.words, self.rig.size), seen.unpacked_hidden(self.rig.size)
        if not self._labelled:
            return masks
        hidden = hidden or [np.zeros_like(mask) for mask in masks]
        return [mask + np.uint8(_THING) * other for mask, other in zip(masks, hidden, strict=True)]
