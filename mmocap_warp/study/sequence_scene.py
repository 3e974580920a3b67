"""Writing a shipped sequence as an ordinary scene, whole or made worse, to look at or to track on its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from mmocap_warp.formats.truth_file import write_truth
from mmocap_warp.formats.usd.usd_body import write_subject
from mmocap_warp.masks.observation import unpack_masks
from mmocap_warp.study.degradations import NONE, degraded, parse
from mmocap_warp.study.sequences import StudySequence
from mmocap_warp.study.source import OpenClip, open_sequence
from mmocap_warp.synthesis.footage.together import Together, places, shifted_truth
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


def write_people(folder: Path, sequences: Sequence[StudySequence], progress: Progress | None = None) -> Path:
    """Write sequences of one length and of different people as one scene, whose masks are label images.

    People are named as in the sequences' names, and come as near to each other as
    :data:`~mmocap_warp.synthesis.footage.together.APART`. Each has a subject, which tracking starts from, and a truth.

    Returns:
        Path of ``scene.toml``.

    Raises:
        InputError: a folder that cannot be written to.
    """
    shifts = places([sequence.recording.poses[:, :2] for sequence in sequences])
    tables = ""
    folder.mkdir(parents=True, exist_ok=True)
    for label, (sequence, shift) in enumerate(zip(sequences, shifts, strict=True), 1):
        name, pose = sequence.name.split("/")[0], sequence.subject.pose.copy()
        pose[:2] += shift
        write_subject(folder / f"{name}.subject.usdc", replace(sequence.subject, pose=pose))
        write_truth(folder / f"{name}.truth.usdc", shifted_truth(sequence.truth, shift), sequence.rig.up)
        files = f'subject = "{name}.subject.usdc"\ntruth = "{name}.truth.usdc"'
        tables += f"\n[people.{name}]\nlabel = {label}\n{files}\n"
    names = " and ".join(sequence.name for sequence in sequences)
    about = f"{names} of the study's shipped sequences in one room, made up with known truth."
    together = Together.of([sequence.recording for sequence in sequences], shifts)
    foreground = _FOREGROUND + tables
    return write_made_scene(folder, together, None, name=names, about=about, foreground=foreground, progress=progress)


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
