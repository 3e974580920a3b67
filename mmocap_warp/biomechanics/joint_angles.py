"""Joint angles: a person's by the recommendations of the International Society of Biomechanics, others' as searched.

docs/measures.md has the formulas.

Wu et al., *ISB recommendation on definitions of joint coordinate system of various joints for the reporting of human
joint motion*: part I, ankle, hip and spine (J. Biomechanics 35, 2002); part II, shoulder, elbow, wrist and hand (38,
2005). The knee, which they leave out: Grood and Suntay, *A joint coordinate system for the clinical description of
three-dimensional motions* (J. Biomechanical Engineering 105, 1983).
"""

from dataclasses import dataclass

import numpy as np

from mmocap_warp.biomechanics.segments import SEGMENTS, segment_axes
from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.rotations import transposed
from mmocap_warp.body.skeleton import TRANSLATION, Skeleton

_LEAST_ELEVATION = 5.0  # an arm that hangs, or points up, within this angle has no plane of elevation [degrees]
_LEAST_FOLLOWED = 0.05  # how far some angle of a joint goes along with a coordinate that moves the joint, as a share
# A rotation times this, element by element, is the one that its mirror image across the xy plane makes.
_MIRROR = np.array([[1.0, 1.0, -1.0], [1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]])


@dataclass(frozen=True)
class JointAngles:
    """How the angles of a joint are defined."""

    upper: str  # the upper one of the segments that it joins, without its side
    lower: str  # likewise the lower one
    names: tuple[str, str, str]  # of the three angles
    sign: int = 1  # of the first angle, from the right-handed rotation about the first axis; the others are as they are
    order: str = "zxy"  # the order of the three rotations, ``zxy`` or ``yxy``


_BENDING = ("flexion", "bending_to_the_right", "rotation_to_the_left")
_PAIRED: dict[str, JointAngles] = {
    "Hip": JointAngles("pelvis", "thigh", ("flexion", "adduction", "internal_rotation")),
    "Knee": JointAngles("thigh", "shank", ("flexion", "adduction", "internal_rotation"), sign=-1),
    "Ankle": JointAngles("shank", "foot", ("dorsiflexion", "inversion", "internal_rotation")),
    "Shoulder": JointAngles(
        "thorax", "upper arm", ("plane_of_elevation", "elevation", "internal_rotation"), order="yxy"
    ),
    "Elbow": JointAngles("upper arm", "forearm", ("flexion", "carrying_angle", "pronation")),
    "Wrist": JointAngles("forearm", "hand", ("flexion", "ulnar_deviation", "pronation")),
}
_MIDDLE: dict[str, JointAngles] = {
    "Trunk": JointAngles("pelvis", "thorax", _BENDING, sign=-1),
    "Neck": JointAngles("thorax", "head", _BENDING, sign=-1),
}
_JOINTS = {joint: (each, each.upper, each.lower) for joint, each in _MIDDLE.items()} | {
    side + joint: (each, each.upper if each.upper in SEGMENTS else f"{side} {each.upper}", f"{side} {each.lower}")
    for joint, each in _PAIRED.items()
    for side in "LR"
}
"""All joints, each with how its angles are defined and the names of its two segments."""


def joint_angles(body: BodyModel, transforms: np.ndarray) -> dict[str, dict[str, np.ndarray]]:
    """Of each joint that the body has the segments for, its angles by name: each (frame,) float64 [degrees].

    Angles go on over half a turn from one frame to the next; one that is not defined is NaN. A joint of a side is named
    after it, such as ``LKnee``. ``transforms`` (frame, joint, 4, 4) are those of the body's joints in the world.
    """
    angles = {}
    for joint, (definition, upper, lower) in _available_joints(body).items():
        between = transposed(segment_axes(body, transforms, upper)) @ segment_axes(body, transforms, lower)
        if lower.startswith("L "):
            between = between * _MIRROR
        first, second, third = map(_unwrap_degrees, (_yxy if definition.order == "yxy" else _zxy)(between))
        angles[joint] = dict(zip(definition.names, (definition.sign * first, second, third), strict=True))
    return angles


def held_angles(around: dict[str, dict[str, np.ndarray]]) -> list[tuple[str, str]]:
    """Joint and name of each angle that a model does not search, though it changes a little with those it does.

    A joint of three searched coordinates or more has all its angles. One of fewer has as many as it has coordinates:
    those that together follow them most. The angles ``around`` are as of :func:`joint_angles`, of poses in each of
    which one searched angle is turned by a degree, and last of the pose that none is turned in: each (searched + 1,)
    [degrees].
    """
    from scipy.optimize import linear_sum_assignment

    held = []
    for joint, names in around.items():
        angles = np.stack(list(names.values()))
        change = np.nan_to_num(np.abs((angles[:, :-1] - angles[:, -1:] + 180.0) % 360.0 - 180.0))
        change = change[:, change.max(axis=0) > _LEAST_FOLLOWED]
        if change.shape[1] < len(names):
            kept = linear_sum_assignment(change, maximize=True)[0]
            held += [(joint, name) for number, name in enumerate(names) if number not in kept]
    return held


def own_angles(skeleton: Skeleton, pose: np.ndarray, model: int | None = None) -> dict[str, dict[str, np.ndarray]]:
    """The angles that a model searches of each joint but the root, by axis of its frame: each (frame,) [degrees].

    They count from the bind pose, in which a robot's joints are at zero, and go on over half a turn. The poses are
    (frame, coordinate); without ``model``, a number of degrees of freedom, the default one counts.
    """
    angles = by_joint(skeleton, skeleton.searched_angles(model), pose)
    return {joint: {axis: _unwrap_degrees(each) for axis, each in own.items()} for joint, own in angles.items()}


def by_joint(skeleton: Skeleton, coordinates: np.ndarray, pose: np.ndarray) -> dict[str, dict[str, np.ndarray]]:
    """Some coordinates of poses, by joint and axis: each (frame,)."""
    values: dict[str, dict[str, np.ndarray]] = {}
    for number in coordinates:
        joint, axis = divmod(int(number) - TRANSLATION, 3)
        values.setdefault(skeleton.joints[joint], {})["xyz"[axis]] = pose[:, number]
    return values


def joints_left_out(body: BodyModel) -> list[str]:
    """The joints of a person whose angles a body lacks; none where it lacks all of them."""
    has = _available_joints(body)
    return [joint for joint in _JOINTS if joint not in has] if has else []


def _available_joints(body: BodyModel) -> dict[str, tuple[JointAngles, str, str]]:
    known = {name for name, segment in SEGMENTS.items() if {*segment.joints} <= {*body.skeleton.joints}}
    return {joint: each for joint, each in _JOINTS.items() if known.issuperset(each[1:])}


def _zxy(rotation: np.ndarray) -> np.ndarray:
    """(3, frame) angles a, b, c [rad] of rotations ``Rz(a) @ Rx(b) @ Ry(c)``, (frame, 3, 3)."""
    r = np.moveaxis(rotation, 0, 2)
    return np.stack([np.arctan2(-r[0, 1], r[1, 1]), np.arcsin(np.clip(r[2, 1], -1, 1)), np.arctan2(-r[2, 0], r[2, 2])])


def _yxy(rotation: np.ndarray) -> np.ndarray:
    """(3, frame) angles a, b, c [rad], b not negative, of rotations ``Ry(a) @ Rx(-b) @ Ry(c)``, (frame, 3, 3).

    a and c are NaN where b is near to 0 or 180 degrees.
    """
    r = np.moveaxis(rotation, 0, 2)
    sine = np.hypot(r[0, 1], r[2, 1])
    plane, turn = np.arctan2(-r[0, 1], -r[2, 1]), np.arctan2(-r[1, 0], r[1, 2])
    known = np.where(sine < np.sin(np.radians(_LEAST_ELEVATION)), np.nan, 1.0)
    return np.stack([plane * known, np.arctan2(sine, r[1, 1]), turn * known])


def _unwrap_degrees(angle: np.ndarray) -> np.ndarray:
    """Angles (frame,) in degrees, each as near to the last known one as whole turns bring it."""
    degrees = np.degrees(angle)
    known = np.isfinite(degrees)
    degrees[known] = np.unwrap(degrees[known], period=360.0)
    return degrees
