"""Clips beyond the nine sequences: somebody who turns fast, and people whom no shape of the tracker's body comes near.

They are made as the nine are, and stand in no table of the study. ``docs/sequences.md`` says what is in them.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mmocap_warp.body.model import BodyModel
from mmocap_warp.study.sequences import (
    FPS,
    PLANS,
    MadeSequences,
    Motion,
    SequencePlan,
    StudySequence,
    walking_around,
)
from mmocap_warp.synthesis.motion.spinning import SPINS, spinning

_FIVE_CAMERAS = ("C1", "C2", "C3", "BW2", "BW4")


def _spinning(person: str) -> Motion:
    def motion(body: BodyModel, frames: int, seed: int) -> np.ndarray:
        return spinning(body, frames, FPS, SPINS[person], seed)

    return motion


FURTHER_PLANS: dict[str, SequencePlan] = {
    "S1/Spin": SequencePlan("S1", 240, _spinning("S1"), 0.9, 41, _FIVE_CAMERAS),
    "S2/Spin": SequencePlan("S2", 240, _spinning("S2"), 2.6, 42, _FIVE_CAMERAS),
    "Uneven/Walking": SequencePlan("Uneven", 240, walking_around(1.10, 1.10, 112.0), 0.4, 51),
    "Skirt/Walking": SequencePlan("Skirt", 240, walking_around(1.00, 1.10, 116.0), 2.1, 52),
    "Child/Walking": SequencePlan("Child", 240, walking_around(0.90, 0.60, 138.0, step_width=0.07), 4.0, 53),
}
"""By name."""

CLIP_PLANS: Mapping[str, SequencePlan] = {**PLANS, **FURTHER_PLANS}
"""Of all that is made by name: the nine sequences, and these."""

CLIPS: Mapping[str, StudySequence] = MadeSequences(CLIP_PLANS)
"""The clips by name."""
