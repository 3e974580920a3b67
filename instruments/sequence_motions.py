"""Make the motions of the shipped sequences again: ``python instruments/sequence_motions.py``.

They ship as pose vectors, because they were made once for the sequences' people. This writes them, and those of the
passer-by of degraded recordings, to ``scenes/sequences/motions.npz``.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from gait_curves import CADENCE
from made_boxing import FIGHTS, ROUNDS, boxing
from made_gestures import SCRIPTS, SHAKES, gesturing
from made_spins import SPINS, spinning
from made_walks import Walk, walking_around

from mmocap_warp.study.sequences import CLIP_PLANS, FPS, Motion
from mmocap_warp.synthesis.motion.stored_poses import MOTIONS, PASSER_BY_RATE, predicted_bits
from mmocap_warp.synthesis.walkers import PEOPLE, STRANGERS


def _acted(action: Callable[..., np.ndarray], script: object) -> Motion:
    return lambda body, frames, seed: action(body, frames, FPS, script, seed)


ACTIONS: dict[str, Motion] = {
    "S1/Walking": walking_around(1.10, 1.15, 112.0),
    "S2/Walking": walking_around(1.00, 1.10, 116.0),
    "S3/Walking": walking_around(1.15, 1.22, 106.0),
    "Uneven/Walking": walking_around(1.10, 1.10, 112.0),
    "Skirt/Walking": walking_around(1.00, 1.10, 116.0),
    "Swing/Walking": walking_around(0.90, 1.10, 116.0),
    "Coat/Walking": walking_around(1.00, 1.15, 112.0),
    "Child/Walking": walking_around(0.90, 0.60, 138.0, step_width=0.07),
    **{f"{person}/Gestures": _acted(gesturing, script) for person, script in SCRIPTS.items()},
    **{f"{person}/Box": _acted(boxing, script) for person, script in ROUNDS.items()},
    **{f"{person}/Handshake": _acted(gesturing, script) for person, script in SHAKES.items()},
    **{f"{person}/Fight": _acted(boxing, script) for person, script in FIGHTS.items()},
    **{f"{person}/Spin": _acted(spinning, spin) for person, spin in SPINS.items()},
}
"""By the sequence's name."""

_STRAIGHT = 200.0  # radius of the circle that the passer-by walks along: nearly a line [m]
_STEPS = 295  # poses before and after the passer-by is in the middle of the way: 2.6 m


def made_motion(name: str) -> np.ndarray:
    """(frame, 51) one of the motions, in body axes about the origin of the floor."""
    if name == "passer-by":
        phase = CADENCE / 120.0 * (np.arange(-_STEPS, _STEPS + 1) / PASSER_BY_RATE)
        return Walk(PEOPLE["S3"].true_body(), radius=_STRAIGHT).poses(phase)
    plan = CLIP_PLANS[name]
    return ACTIONS[name]((PEOPLE | STRANGERS)[plan.person].true_body(), plan.frames, plan.seed)


def pack_poses(poses: np.ndarray) -> np.ndarray:
    """Pack pose vectors (frame, coordinate) without loss, as (byte 8, coordinate, frame), which compress better.

    A frame is predicted from those before it. What is kept is how far the bits of the double are from the prediction's,
    as an integer whose lowest bit is the sign: its high bytes are mostly zero.
    """
    bits = np.array([pose.view(np.int64) - predicted_bits(poses[:frame]) for frame, pose in enumerate(poses)])
    unsigned = (bits << 1) ^ (bits >> 63)
    return np.ascontiguousarray(unsigned[..., None].view(np.uint8).T)


if __name__ == "__main__":
    MOTIONS.parent.mkdir(exist_ok=True)
    np.savez_compressed(MOTIONS, **{name: pack_poses(made_motion(name)) for name in (*ACTIONS, "passer-by")})
