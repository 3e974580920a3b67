"""Make the motions of the shipped sequences again: ``python instruments/sequence_motions.py``.

Gestures, Box and Spin ship as pose vectors, because they were acted once for the sequences' people. This writes them
to ``scenes/sequences/motions.npz``. Walks are not among them: the package makes those itself.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from made_boxing import ROUNDS, boxing
from made_gestures import SCRIPTS, gesturing
from made_spins import SPINS, spinning

from mmocap_warp.body.model import BodyModel
from mmocap_warp.study.sequences import CLIP_PLANS, FPS, MOTIONS
from mmocap_warp.synthesis.walkers import PEOPLE

Action = Callable[[BodyModel, int, int], np.ndarray]
"""Pose vectors (frame, 51) of a body, a number of frames and a seed."""


def _acted(action: Callable[..., np.ndarray], script: object) -> Action:
    return lambda body, frames, seed: action(body, frames, FPS, script, seed)


ACTIONS: dict[str, Action] = {
    f"{person}/{name}": _acted(action, script)
    for name, action, scripts in (
        ("Gestures", gesturing, SCRIPTS),
        ("Box", boxing, ROUNDS),
        ("Spin", spinning, SPINS),
    )
    for person, script in scripts.items()
}
"""By the sequence's name."""


def made_motion(name: str) -> np.ndarray:
    """(frame, 51) the pose vectors of a shipped sequence's person, in body axes about the origin of the floor."""
    plan = CLIP_PLANS[name]
    return ACTIONS[name](PEOPLE[plan.person].true_body(), plan.frames, plan.seed)


if __name__ == "__main__":
    MOTIONS.parent.mkdir(exist_ok=True)
    np.savez_compressed(MOTIONS, **{name: made_motion(name) for name in ACTIONS})
