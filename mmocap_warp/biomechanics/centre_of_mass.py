"""A person's centre of mass, from the shares of the segments.

De Leva, *Adjustments to Zatsiorsky-Seluyanov's segment inertia parameters* (J. Biomechanics 29, 1996), table 4, with
the ends that a skeleton has: the head from its top to the neck, the trunk from the middle of the shoulders to that of
the hips, the hand to the tip of the longest finger, the shank to the ankle's centre.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np

from mmocap_warp.biomechanics.segments import has_joints, skin_place
from mmocap_warp.body.model import BodyModel

Sex = Literal["female", "male"]


class _Share(NamedTuple):
    """Of a segment: female and male mass as shares of the body's, and where its centre is on the way to ``end``.

    Ends are joints, ``Mid...`` of a left and a right one, or places on the skin.
    """

    start: str
    end: str
    mass: tuple[float, float]
    centre: tuple[float, float]


_HEAD_AND_TRUNK = (
    _Share("Top", "Neck", (0.0668, 0.0694), (0.4841, 0.5002)),
    _Share("MidShoulder", "MidHip", (0.4257, 0.4346), (0.3782, 0.4310)),
)
_LIMBS = (  # of either side
    _Share("Shoulder", "Elbow", (0.0255, 0.0271), (0.5754, 0.5772)),
    _Share("Elbow", "Wrist", (0.0138, 0.0162), (0.4559, 0.4574)),
    _Share("Wrist", "Fingertip", (0.0056, 0.0061), (0.3427, 0.3624)),
    _Share("Hip", "Knee", (0.1478, 0.1416), (0.3612, 0.4095)),
    _Share("Knee", "Ankle", (0.0481, 0.0433), (0.4352, 0.4395)),
    _Share("Heel", "Toe", (0.0129, 0.0137), (0.4014, 0.4415)),
)
_JOINTS = ("Neck", *(side + name for side in "LR" for name in ("Shoulder", "Elbow", "Wrist", "Hip", "Knee", "Ankle")))

# Places on the skin: the joint that has most weight there, and of its vertices, from its centre, the one furthest out.
_SKIN: dict[str, tuple[str, Callable[[np.ndarray], np.ndarray]]] = {
    "Top": ("Neck", lambda away: away[:, 1]),
    "Fingertip": ("Wrist", lambda away: np.linalg.norm(away, axis=1)),
    "Heel": ("Ankle", lambda away: -away[:, 2]),
    "Toe": ("Ankle", lambda away: away[:, 2]),
}


def centre_of_mass(body: BodyModel, transforms: np.ndarray, sex: Sex | None = None) -> np.ndarray | None:
    """(frame, 3) float64 in the world [m]; None for a body that lacks joints of a person.

    Args:
        body: whose it is.
        transforms: (frame, joint, 4, 4), of its joints in the world.
        sex: whose shares to take; the mean of both where it is not known.
    """
    if not has_joints(body.skeleton, _JOINTS):
        return None
    weights = {"female": (1.0, 0.0), "male": (0.0, 1.0), None: (0.5, 0.5)}[sex]
    total, centre = 0.0, np.zeros((len(transforms), 3))
    sided = [(share, side) for share in _LIMBS for side in "LR"]
    for share, side in [*((share, "") for share in _HEAD_AND_TRUNK), *sided]:
        mass, along = np.dot(weights, share.mass), np.dot(weights, share.centre)
        start, end = (_place(body, transforms, side, name) for name in (share.start, share.end))
        total += mass
        centre += mass * ((1 - along) * start + along * end)
    return centre / total


def _place(body: BodyModel, transforms: np.ndarray, side: str, name: str) -> np.ndarray:
    """(frame, 3), an end of a segment."""
    if name.startswith("Mid"):
        return (_place(body, transforms, "L", name[3:]) + _place(body, transforms, "R", name[3:])) / 2
    if name in _SKIN:
        joint, _ = _SKIN[name]
        return skin_place(body, transforms, side + joint, _SKIN[name][1])
    return transforms[:, body.skeleton.index(side + name), :3, 3].astype(float)
