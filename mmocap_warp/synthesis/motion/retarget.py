"""A motion clip's movement on a body of this project: bones point where the clip's point, hinges stay hinges.

Pelvis, chest, head and feet turn from the upright rest pose as the clip's do. Thighs, shanks, upper arms and forearms
take the directions of the clip's bones, whatever pose their skeletons rest in; elbow and knee bend about their hinge
alone and never beyond straight. The path is scaled by the ratio of the legs, so feet stay where they stand as nearly as
the two skeletons allow.
"""

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Self

import numpy as np

from mmocap_warp.body.model import BodyModel
from mmocap_warp.errors import InputError
from mmocap_warp.formats.motion.motion_clip import MotionClip
from mmocap_warp.synthesis.exact_posing import ExactPoser
from mmocap_warp.synthesis.motion.limb_motion import Posture, leg_length, rest_place

# What the joints of Acclaim's, Biovision's and Mixamo's skeletons are called, in small letters and without a prefix.
_NAMES: dict[str, tuple[str, ...]] = {
    "pelvis": ("root", "hips", "hip", "pelvis"),
    "chest": ("thorax", "spine2", "spine1", "chest2", "chest", "spine"),
    "head": ("head",),
    "LHip": ("lfemur", "leftupleg", "lefthip", "leftthigh", "lhip", "lthigh"),
    "LKnee": ("ltibia", "leftleg", "leftknee", "leftshin", "lknee", "lshin"),
    "LAnkle": ("lfoot", "leftfoot", "leftankle", "lankle"),
    "LShoulder": ("lhumerus", "leftarm", "leftuparm", "leftupperarm", "lshldr"),
    "LElbow": ("lradius", "leftforearm", "leftlowarm", "leftelbow", "lforearm"),
    "LWrist": ("lwrist", "lefthand", "leftwrist", "lhand"),
}
_REACH = 1.3  # distance that the body may have from its place in the clip's middle frame [m]
_HALF_STRAIGHT = np.radians(3.0)  # knees stay bent by at least this


def retargeted(clip: MotionClip, body: BodyModel, fps: float, source: object) -> np.ndarray:
    """The clip's movement on a body, at so many frames per second; errors name the clip's ``source``.

    The result is (frame, 51) full pose vectors in body axes about the origin of the floor. The part about the clip's
    middle frame is kept that stays within 1.3 m of where the body is then, and moved to the origin, where the study's
    cameras see it. Raises an InputError for a skeleton whose joints have none of their usual names, or that does not
    rest upright.
    """
    # The clip in this project's axes and the body's size, as far as it stays near to where it is in the middle.
    actor = _Actor.of(clip.at_rate(fps), source)
    scale = leg_length(body) / actor.leg_length
    place = actor.place["pelvis"] * scale
    middle = len(place) // 2
    beyond = np.flatnonzero(np.hypot(*(place - place[middle])[:, [0, 2]].T) > _REACH)
    begin, end = beyond[beyond < middle].max(initial=-1) + 1, beyond[beyond > middle].min(initial=len(place))
    actor = actor.part(slice(int(begin), int(end)))
    # Root and legs: the body's hips are where the actor's are, moved to the middle.
    pelvis, hips = actor.rotation["pelvis"], (actor.place["LHip"] + actor.place["RHip"]) / 2 * scale
    posture = Posture(body, len(pelvis))
    hips_rest = (rest_place(body, "LHip") + rest_place(body, "RHip")) / 2
    root = hips - pelvis @ (hips_rest - body.joint_rest[0])
    shift = (root.min(axis=0) + root.max(axis=0)) / 2 * (1.0, 0.0, 1.0)
    posture.point_legs(
        root - shift,
        pelvis,
        {side: (actor.bone(f"{side}Hip", f"{side}Knee"), actor.bone(f"{side}Knee", f"{side}Ankle")) for side in "LR"},
        {side: actor.rotation[f"{side}Hip"][:, :, 0] for side in "LR"},
        {side: actor.rotation[f"{side}Ankle"] for side in "LR"},
        _HALF_STRAIGHT,
    )
    # Trunk and arms.
    posture.bend(actor.rotation["chest"], actor.rotation["head"])
    for side in "LR":
        upper, fore = actor.bone(f"{side}Shoulder", f"{side}Elbow"), actor.bone(f"{side}Elbow", f"{side}Wrist")
        posture.point_arm(side, upper, fore)
    # Angles within the limits, and the floor at zero.
    poses = np.clip(posture.poses, *body.skeleton.coordinate_limits.T)
    skin = ExactPoser(body, np.eye(3)).vertices(poses[:: max(1, len(poses) // 100)])
    poses[:, 1] -= float(np.median(skin[..., 1].min(axis=1)))  # where the body stands in most frames
    return poses


@dataclass(frozen=True)
class _Actor:
    """A clip by this project's names and axes: +Y up, +X left, +Z ahead in the rest pose; lengths are the clip's."""

    # By joint, as in ``_NAMES`` with both sides.
    rest: dict[str, np.ndarray]  # (3,)
    place: dict[str, np.ndarray]  # (frame, 3)
    rotation: dict[str, np.ndarray]  # (frame, 3, 3), from the rest pose

    @classmethod
    def of(cls, clip: MotionClip, source: object) -> Self:
        joints = _find_joints(clip, source)
        # The body's axes in the file's, from a rest pose that stands upright; they follow the file's axes.
        at = {name: clip.rest[j] for name, j in joints.items()}
        up = _nearest_axis(at["head"] - (at["LAnkle"] + at["RAnkle"]) / 2)
        left = _nearest_axis(at["LHip"] - at["RHip"])
        if abs(up @ left) > 0.5:
            problem = "its rest pose does not stand along an axis"
            raise InputError(source, problem, "give a clip whose rest pose is upright")
        axes = np.stack([left, up, np.cross(left, up)], axis=1)
        rest = {name: place @ axes for name, place in at.items()}
        place = {name: clip.place[:, j] @ axes for name, j in joints.items()}
        return cls(rest, place, {name: axes.T @ clip.rotation[:, j] @ axes for name, j in joints.items()})

    def part(self, frames: slice) -> Self:
        """The same in some of the frames."""
        place, rotation = ({name: of[frames] for name, of in each.items()} for each in (self.place, self.rotation))
        return replace(self, place=place, rotation=rotation)

    @property
    def leg_length(self) -> float:
        """Hip to knee to ankle, mean of both sides."""
        at = self.rest
        bones = [np.linalg.norm(at[s + a] - at[s + b]) for s in "LR" for a, b in pairwise(("Hip", "Knee", "Ankle"))]
        return float(np.sum(bones)) / 2

    def bone(self, start: str, end: str) -> np.ndarray:
        """(frame, 3), the direction from a joint to another."""
        away = self.place[end] - self.place[start]
        return away / np.linalg.norm(away, axis=1, keepdims=True)


def _find_joints(clip: MotionClip, source: object) -> dict[str, int]:
    # In small letters, without a prefix such as Mixamo's and without separators.
    own = [name.split(":")[-1].lower().removeprefix("mixamorig") for name in clip.joint_names]
    plain = [name.replace("_", "").replace(" ", "") for name in own]
    number = {}
    for role, names in _NAMES.items():
        for side in "LR" if role[0] == "L" else ("",):
            wanted = [_other_side(name) if side == "R" else name for name in names]
            known = [name for name in wanted if name in plain]
            joint = side + role[1:] if side else role
            if not known:
                problem = f"none of its joints is the {joint}: {', '.join(clip.joint_names)}"
                raise InputError(source, problem, f"name it {' or '.join(wanted)}")
            number[joint] = plain.index(known[0])
    return number


def _other_side(name: str) -> str:
    return name.replace("left", "right") if name.startswith("left") else f"r{name[1:]}"


def _nearest_axis(direction: np.ndarray) -> np.ndarray:
    return np.where(np.arange(3) == np.abs(direction).argmax(), np.sign(direction), 0.0)
