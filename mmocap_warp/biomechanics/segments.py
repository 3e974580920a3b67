"""Anatomical axes of a person's segments, from joint centres and hinges in the bind pose, carried by the joints.

Axes are the International Society of Biomechanics': x forward, y up, z to the right, in the anatomical position, for
segments of both sides. docs/measures.md says which of them are anatomical and which are the bind pose's.

The centre of mass is found from the shares of the segments: de Leva, *Adjustments to Zatsiorsky-Seluyanov's segment
inertia parameters* (J. Biomechanics 29, 1996), table 4, with the ends that a skeleton has: the head from its top to the
neck, the trunk from the middle of the shoulders to that of the hips, the hand to the tip of the longest finger, the
shank to the ankle's centre.
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from mmocap_warp.body.model import BodyModel

_UPRIGHT = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
"""x, y and z in columns, of a segment that stands as the body does: facing body z, its left side at body x."""


@dataclass(frozen=True)
class Segment:
    """A rigid part of a person."""

    joint: str  # that carries it
    # Joints whose centres lie on its long axis, which points up to the first; empty where its axes are those of the
    # bind pose.
    upper: str = ""
    lower: str = ""
    across: tuple[str, str] = ("", "")  # the joint whose frame says where z points; that frame's signed column, as "-x"

    @property
    def joints(self) -> tuple[str, ...]:
        """All joints that it needs."""
        return tuple(name for name in (self.joint, self.upper, self.lower, self.across[0]) if name)

    def axes(self, body: BodyModel) -> np.ndarray:
        """(3, 3) float64, its axes in columns, in the frame of its joint."""
        skeleton = body.skeleton
        own, centre = skeleton.frame[skeleton.index(self.joint)].astype(float), body.joint_rest.astype(float)
        if not self.upper:
            return own.T @ _UPRIGHT
        joint, column = self.across
        hinge = skeleton.frame[skeleton.index(joint)][:, "xyz".index(column[1])].astype(float)
        z = hinge if column[0] == "+" else -hinge
        y = centre[skeleton.index(self.upper)] - centre[skeleton.index(self.lower)]
        y /= np.linalg.norm(y)
        z -= (y @ z) * y
        z /= np.linalg.norm(z)
        return own.T @ np.stack([np.cross(y, z), y, z], axis=1)


_JOINTS_OF_SIDE = ("Hip", "Knee", "Ankle", "Shoulder", "Elbow", "Wrist")


def _of_side(side: str) -> dict[str, Segment]:
    """The segments of one side. Knees bend about their frame's x, a left elbow about -y, a right one about y.

    The thumb points to where the elbow bends, along z of the elbow's frame, which on the right is the outer side of a
    forearm whose palm is turned forward.
    """
    hip, knee, ankle, shoulder, elbow, wrist = (side + name for name in _JOINTS_OF_SIDE)
    sign = "-" if side == "L" else "+"
    knee_hinge, elbow_hinge, outer = (knee, "-x"), (elbow, f"{sign}y"), (elbow, f"{sign}z")
    return {
        f"{side} thigh": Segment(hip, hip, knee, knee_hinge),
        f"{side} shank": Segment(knee, knee, ankle, knee_hinge),
        f"{side} foot": Segment(ankle),
        f"{side} upper arm": Segment(shoulder, shoulder, elbow, elbow_hinge),
        f"{side} forearm": Segment(elbow, elbow, wrist, outer),
        f"{side} hand": Segment(wrist, elbow, wrist, outer),
    }


SEGMENTS: dict[str, Segment] = {
    "pelvis": Segment("Root"),
    "thorax": Segment("UpperSpine"),
    "head": Segment("Neck"),
    **_of_side("L"),
    **_of_side("R"),
}
"""By name; those of a side begin with ``L`` or ``R``."""


def segment_axes(body: BodyModel, transforms: np.ndarray, name: str) -> np.ndarray:
    """A segment's axes in the world, in columns: (frame, 3, 3) float64.

    ``transforms`` (frame, joint, 4, 4) are the joints' in the world; the body has those of the segment.
    """
    segment = SEGMENTS[name]
    return transforms[:, body.skeleton.index(segment.joint), :3, :3].astype(float) @ segment.axes(body)


Direction = tuple[float, float, float] | None
"""In body axes in the bind pose; None for any."""


def skin_place(body: BodyModel, transforms: np.ndarray, joint: str, direction: Direction) -> np.ndarray:
    """(frame, 3), a joint's skin that is furthest out along ``direction`` in the bind pose, carried by the joint.

    It is the joint's centre where no skin follows it. ``transforms`` (frame, joint, 4, 4) are the joints' in the world.
    """
    number = body.skeleton.index(joint)
    away = (body.skin.rest[body.skin.heaviest_joint == number] - body.joint_rest[number]).astype(float)
    far = np.linalg.norm(away, axis=1) if direction is None else away @ direction
    local = away[far.argmax()] @ body.skeleton.frame[number] if len(away) else np.zeros(3)
    return transforms[:, number, :3, :3].astype(float) @ local + transforms[:, number, :3, 3]


Sex = Literal["female", "male"]


class _Share(NamedTuple):
    """A segment's female and male mass, as shares of the body's, and where its centre is on the way to ``end``.

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
_SKIN: dict[str, tuple[str, Direction]] = {  # places on the skin: joint and direction of :func:`skin_place`
    "Top": ("Neck", (0.0, 1.0, 0.0)),
    "Fingertip": ("Wrist", None),
    "Heel": ("Ankle", (0.0, 0.0, -1.0)),
    "Toe": ("Ankle", (0.0, 0.0, 1.0)),
}


def centre_of_mass(body: BodyModel, transforms: np.ndarray, sex: Sex | None = None) -> np.ndarray | None:
    """(frame, 3) float64 in the world [m]; None for a body that lacks joints of a person.

    ``transforms`` (frame, joint, 4, 4) are the joints' in the world. Without ``sex`` the shares are the mean of both.
    """
    if not {"Neck", *(side + name for side in "LR" for name in _JOINTS_OF_SIDE)} <= {*body.skeleton.joints}:
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
        joint, direction = _SKIN[name]
        return skin_place(body, transforms, side + joint, direction)
    return transforms[:, body.skeleton.index(side + name), :3, 3].astype(float)
