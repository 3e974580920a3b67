"""Make a body of a given build from MakeHuman's data: joints, meshes, shape targets, limits and markers.

``python instruments/make_body.py -o BODY.usdc --data DIR --gender 1 --age 30 --height 1.78``: docs/bodies.md says where
the data is from, and ``--help`` what the numbers mean.

Limits come from published ranges of motion: American Academy of Orthopaedic Surgeons, *Joint Motion: Method of
Measuring and Recording* (1965), as tabulated by Norkin and White, *Measurement of Joint Motion* (5th ed., 2016), for
hinges and single movements; Kapandji, *The Physiology of the Joints*, for the spine and for the shoulder's compound
range; Rajagopal et al., *Full-body musculoskeletal model* (IEEE TBME 63, 2016), for the signs and the knee.

A hinge's limits are its clinical range, with a few degrees to spare. A ball joint's Euler angles are not clinical
angles: there the limits hold every pose that combines the clinical ranges, so they are wider. They keep a limb from
turning round itself; they do not say that a pose is possible.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from makehuman import MacroSliders, MakeHuman, age_slider
from person_skeleton import JOINTS, human_skeleton

from mmocap_warp.body.model import BodyModel, SkinMesh
from mmocap_warp.errors import InputError
from mmocap_warp.formats.usd.usd_body import write_body
from mmocap_warp.formats.usd.usd_file import USD_SUFFIXES
from mmocap_warp.rigging.decimation import decimate

ATTRIBUTION = (
    "Shape, rig and skinning weights from MakeHuman's base mesh hm08 and targets, (c) 2020 Data Collection AB, "
    "Joel Palmius, Jonas Hauquier, released as CC0 1.0 (https://creativecommons.org/publicdomain/zero/1.0/), "
    "taken from MPFB2; collapsed to 16 joints by mmocap-warp, and released as CC0 1.0 too."
)

TRACKING_TRIANGLES = 2600

_BONE: dict[str, str] = {
    "Root": "Hips",
    "BottomSpine": "LowerBack",
    "UpperSpine": "Spine1",
    "LShoulder": "LeftArm",
    "LElbow": "LeftForeArm",
    "LWrist": "LeftHand",
    "RShoulder": "RightArm",
    "RElbow": "RightForeArm",
    "RWrist": "RightHand",
    "Neck": "Neck",
    "LHip": "LeftUpLeg",
    "LKnee": "LeftLeg",
    "LAnkle": "LeftFoot",
    "RHip": "RightUpLeg",
    "RKnee": "RightLeg",
    "RAnkle": "RightFoot",
}  # the bone of MakeHuman's rig that starts at each joint

_MACRO_STEP: dict[str, float] = {"height": 0.25, "weight": 1.0, "muscle": 1.0}
"""Slider travel of a macro shape target at weight 1, cut off at the slider's end. Height's whole travel is 1.1 m."""

_LOCAL_TARGETS: dict[str, tuple[str, ...]] = {
    "torso_length": ("torso/torso-scale-vert",),
    "arm_length": ("arms/measure-upperarm-length", "arms/measure-lowerarm-length"),
    "leg_length": ("legs/upperlegs-height", "legs/lowerlegs-height"),
    "shoulder_width": ("torso/measure-shoulder-dist",),
    "hip_width": ("hip/hip-scale-horiz",),
    "chest_depth": ("torso/torso-scale-depth",),
    "waist": ("torso/measure-waist-circ",),
    "belly": ("stomach/stomach-pregnant",),
}  # MakeHuman's targets that add up to each of ours; each has an -incr and a -decr

_HEIGHT_TOLERANCE = 1e-4  # [m]
_NEGLIGIBLE = 5e-5  # Displacements below this [m] are dropped, so that local targets stay small.
_INFLUENCES = 4


def make_body(
    data: str | Path,
    name: str,
    *,
    gender: float,
    age: float,
    height: float,
    weight: float = 0.5,
    muscle: float = 0.5,
    proportions: float = 0.5,
) -> BodyModel:
    """A body of the given build.

    Args:
        data: MPFB2's data folder, see :class:`MakeHuman`.
        name: identifier, a valid USD prim name.
        gender: 0 woman to 1 man.
        age: [years], 1 to 90.
        height: of the standing body [m].
        weight: 0 thin, 0.5 average, 1 heavy, for the height.
        muscle: 0 slack, 0.5 average, 1 muscular.
        proportions: 0 uncommon, 0.5 average, 1 ideal.

    Raises:
        ValueError: an argument outside its range, or a height that MakeHuman cannot reach with the others.
        InputError: the data is incomplete.
    """
    if not (name.isidentifier() and name.isascii()):
        raise ValueError(f"name must be letters, digits and underscores and start with no digit, got {name!r}")
    build = (
        f"gender {gender:g}, age {age:g} years, height {height:g} m, "
        f"weight {weight:g}, muscle {muscle:g}, proportions {proportions:g}"
    )
    makehuman = MakeHuman(data)
    person = MacroSliders(gender=gender, age=age_slider(age), weight=weight, muscle=muscle, proportions=proportions)
    person = replace(person, height=_height_slider(makehuman, person, height))

    shape = _Shape(makehuman)
    rest, joint_rest = shape.standing(makehuman.shaped(person))
    shape_names, shape_vertex, shape_joint = _shape_targets(makehuman, shape, person)
    joint_frame, elbow_flexion, knee_flexion = joint_frames(joint_rest)
    skin = SkinMesh(rest.astype(np.float32), shape.face, *_skin_weights(makehuman, shape.vertex))
    tracking_vertex, tracking_face = _tracking_mesh(makehuman, shape)
    marker_names, marker_vertex = place_markers(skin, joint_rest, joint_frame)
    return BodyModel(
        name=name,
        skeleton=human_skeleton(joint_frame, joint_limits(elbow_flexion, knee_flexion)),
        joint_rest=joint_rest.astype(np.float32),
        skin=skin,
        tracking_vertex=tracking_vertex,
        tracking_face=tracking_face,
        shape_names=shape_names,
        shape_vertex=shape_vertex,
        shape_joint=shape_joint,
        marker_names=marker_names,
        marker_vertex=marker_vertex,
        attribution=f"{ATTRIBUTION} Build: {build}.",
    )


class _Shape:
    """Which of MakeHuman's vertices make the skin and the joint centres.

    Attributes:
        vertex: (vertex,) int, the skin's vertices in the base mesh.
        face: (face, 4) int32, over ``vertex``.
    """

    def __init__(self, makehuman: MakeHuman) -> None:
        self.vertex, face = np.unique(makehuman.group_face["body"], return_inverse=True)
        self.face = face.reshape(-1, 4).astype(np.int32)
        self._joint_vertices = [makehuman.bone_head(_BONE[joint]) for joint in JOINTS]

    def reduce(self, base: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Skin vertices (vertex, 3) and joint centres (joint, 3) of positions or displacements of the base mesh."""
        return base[self.vertex], np.stack([base[index].mean(axis=0) for index in self._joint_vertices])

    def standing(self, base: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """As :meth:`reduce`, for positions, moved so that the lowest vertex is at y = 0."""
        skin, joints = self.reduce(base)
        ground = np.array([0.0, skin[:, 1].min(), 0.0])
        return skin - ground, joints - ground


def joint_frames(joint_rest: np.ndarray) -> tuple[np.ndarray, float, float]:
    """Axes of each joint in body space (joint, 3, 3), and how far elbow and knee are bent in this pose [rad].

    The arm's Y is the normal of the elbow's bend, so that a body whose arms hang bent still has Ry as its hinge.
    """
    at = dict(zip(JOINTS, joint_rest, strict=True))
    frame = np.tile(np.eye(3), (len(JOINTS), 1, 1))
    elbow_flexion, knee_flexion = [], []
    for side, sign in (("L", 1.0), ("R", -1.0)):
        upper = _unit(at[f"{side}Elbow"] - at[f"{side}Shoulder"])
        fore = _unit(at[f"{side}Wrist"] - at[f"{side}Elbow"])
        hinge = sign * _unit(np.cross(fore, upper))
        for joint, along in (("Shoulder", upper), ("Elbow", fore), ("Wrist", fore)):
            x = sign * along
            frame[JOINTS.index(side + joint)] = np.stack([x, hinge, np.cross(x, hinge)], axis=1)
        elbow_flexion.append(np.arccos(upper @ fore))

        thigh, shank = at[f"{side}Knee"] - at[f"{side}Hip"], at[f"{side}Ankle"] - at[f"{side}Knee"]
        knee_flexion.append(np.arctan2(thigh[2], -thigh[1]) - np.arctan2(shank[2], -shank[1]))
    return frame, float(np.mean(elbow_flexion)), float(np.mean(knee_flexion))


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)


def _height_slider(makehuman: MakeHuman, person: MacroSliders, height: float) -> float:
    """The slider at which the body is ``height`` metres tall, by bisection."""
    skin = np.unique(makehuman.group_face["body"])

    def tall(slider: float) -> float:
        return float(np.ptp(makehuman.shaped(replace(person, height=slider))[skin, 1]))

    low, high = 0.0, 1.0
    shortest, tallest = tall(low), tall(high)
    if not shortest <= height <= tallest:
        raise ValueError(f"height must lie in {shortest:.2f}..{tallest:.2f} m for this person, got {height}")
    while True:
        middle = 0.5 * (low + high)
        difference = tall(middle) - height
        if abs(difference) < _HEIGHT_TOLERANCE:
            return middle
        low, high = (low, middle) if difference > 0 else (middle, high)


def _shape_targets(
    makehuman: MakeHuman, shape: _Shape, person: MacroSliders
) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """Names, vertex displacements (shape, vertex, 3) and joint displacements (shape, joint, 3), float32 [m]."""
    here = makehuman.shaped(person)
    displacement: dict[str, np.ndarray] = {}
    for slider, step in _MACRO_STEP.items():
        value = getattr(person, slider)
        for suffix, to in (("incr", min(1.0, value + step)), ("decr", max(0.0, value - step))):
            displacement[f"{slider}_{suffix}"] = makehuman.shaped(replace(person, **{slider: to})) - here
    displacement["gender_female"] = makehuman.shaped(replace(person, gender=0.0)) - here
    displacement["gender_male"] = makehuman.shaped(replace(person, gender=1.0)) - here
    displacement["age_incr"] = makehuman.shaped(replace(person, age=1.0)) - here
    for name, parts in _LOCAL_TARGETS.items():
        for suffix in ("incr", "decr"):
            moved = [makehuman.target(f"{part}-{suffix}") for part in parts]
            displacement[f"{name}_{suffix}"] = np.sum(moved, axis=0)

    lowest = shape.reduce(here)[0][:, 1].argmin()
    names, vertices, joints = [], [], []
    for name, whole in displacement.items():
        vertex, joint = shape.reduce(whole)
        if np.abs(vertex).max() < _NEGLIGIBLE:
            continue  # The slider is at its end, as gender is for a man.
        drop = np.array([0.0, vertex[lowest, 1], 0.0])  # keeps the feet on the ground
        vertex, joint = vertex - drop, joint - drop
        vertex[np.abs(vertex).max(axis=1) < _NEGLIGIBLE] = 0.0
        names.append(name)
        vertices.append(vertex)
        joints.append(joint)
    return tuple(names), np.stack(vertices).astype(np.float32), np.stack(joints).astype(np.float32)


def _skin_weights(makehuman: MakeHuman, vertex: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Influencing joints (vertex, 4) int32 and weights (vertex, 4) float32, heaviest first.

    A bone that starts no joint of ours gives its weight to the nearest ancestor that does.
    """
    joint_of = {bone: j for j, bone in enumerate(_BONE[joint] for joint in JOINTS)}
    collapsed = np.zeros((len(vertex), len(JOINTS)))
    for bone, weight in makehuman.bone_weight.items():
        while bone not in joint_of:
            bone = makehuman.parent_bone[bone]
        collapsed[:, joint_of[bone]] += weight[vertex]
    joint = np.argsort(-collapsed, axis=1, kind="stable")[:, :_INFLUENCES]
    weight = np.take_along_axis(collapsed, joint, axis=1)
    if (weight[:, 0] <= 0).any():
        raise InputError(makehuman.directory, "the rig leaves vertices of the skin unbound", "download the data again")
    weight /= weight.sum(axis=1, keepdims=True)
    return np.where(weight > 0, joint, 0).astype(np.int32), weight.astype(np.float32)


def _tracking_mesh(makehuman: MakeHuman, shape: _Shape) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (tracking vertex,) and triangles (tracking face, 3) of the coarse mesh, int32.

    All bodies share it: it is decimated from the average one, so an unusual build cannot spoil it.
    """
    average, _ = shape.reduce(makehuman.shaped(MacroSliders()))
    triangles = np.concatenate([shape.face[:, [0, 1, 2]], shape.face[:, [0, 2, 3]]])
    return decimate(average, triangles, TRACKING_TRIANGLES)


_OFF_RAY_PENALTY = 4.0  # how many times worse a vertex is for lying off the ray than for lying further in along it


@dataclass(frozen=True)
class _Site:
    """Where a ray from inside the body leaves the skin.

    The ray starts on the way from joint ``start`` to joint ``end``, moved by ``offset``, and only meets skin that
    follows one of ``parts``.
    """

    start: str
    end: str
    along: float
    offset: tuple[float, float, float]  # [body heights], in body axes
    direction: tuple[float, float, float]  # in the axes of joint `start`
    parts: tuple[str, ...]


_HEAD, _CHEST, _PELVIS = ("Neck",), ("UpperSpine", "Neck", "BottomSpine"), ("Root", "BottomSpine", "LHip", "RHip")

# Left and middle sites, by Plug-in Gait's names; a leading L has a mirror image on the right.
_SITES: dict[str, _Site] = {
    "LFHD": _Site("Neck", "Neck", 0.0, (0.0, 0.115, 0.015), (0.45, 0.0, 0.9), _HEAD),
    "LBHD": _Site("Neck", "Neck", 0.0, (0.0, 0.115, 0.015), (0.45, 0.0, -0.9), _HEAD),
    "C7": _Site("Neck", "Neck", 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), _CHEST),
    "T10": _Site("Root", "Neck", 0.67, (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), _CHEST),
    "CLAV": _Site("Root", "Neck", 0.91, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), _CHEST),
    "STRN": _Site("Root", "Neck", 0.71, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), _CHEST),
    "LSHO": _Site("LShoulder", "LShoulder", 0.0, (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), ("LShoulder", "UpperSpine")),
    "LUPA": _Site("LShoulder", "LElbow", 0.55, (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), ("LShoulder",)),
    "LELB": _Site("LElbow", "LElbow", 0.0, (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), ("LShoulder", "LElbow")),
    "LFRM": _Site("LElbow", "LWrist", 0.5, (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), ("LElbow",)),
    "LWRA": _Site("LWrist", "LWrist", 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), ("LElbow", "LWrist")),
    "LWRB": _Site("LWrist", "LWrist", 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), ("LElbow", "LWrist")),
    "LFIN": _Site("LElbow", "LWrist", 1.35, (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), ("LWrist",)),
    "LASI": _Site("LHip", "LHip", 0.0, (0.01, 0.045, 0.0), (0.0, 0.0, 1.0), _PELVIS),
    "LPSI": _Site("LHip", "Root", 0.55, (0.0, 0.055, 0.0), (0.0, 0.0, -1.0), _PELVIS),
    "LTHI": _Site("LHip", "LKnee", 0.55, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), ("LHip",)),
    "LKNE": _Site("LKnee", "LKnee", 0.0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), ("LHip", "LKnee")),
    "LTIB": _Site("LKnee", "LAnkle", 0.5, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), ("LKnee",)),
    "LANK": _Site("LAnkle", "LAnkle", 0.0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), ("LKnee", "LAnkle")),
    "LHEE": _Site("LAnkle", "LAnkle", 0.0, (0.0, -0.02, 0.0), (0.0, 0.0, -1.0), ("LAnkle",)),
    "LTOE": _Site("LAnkle", "LAnkle", 0.0, (0.005, -0.03, 0.07), (0.0, 1.0, 0.0), ("LAnkle",)),
}


def place_markers(
    skin: SkinMesh, joint_rest: np.ndarray, joint_frame: np.ndarray
) -> tuple[tuple[str, ...], np.ndarray]:
    """Names of the markers and their vertices (marker,) int32.

    Args:
        skin: the full mesh in its bind pose.
        joint_rest: (joint, 3), joint centres [m].
        joint_frame: (joint, 3, 3), joint axes in columns.
    """
    sites = dict(_SITES)
    sites |= {f"R{name[1:]}": _mirror_site(site) for name, site in _SITES.items() if name.startswith("L")}
    vertex = [_ray_exit(site, skin, joint_rest, joint_frame) for site in sites.values()]
    return tuple(sites), np.array(vertex, np.int32)


def _mirror_site(site: _Site) -> _Site:
    """The same site on the other side. A right joint's axes mirror the left one's, but for x, which is turned over."""

    def other(joint: str) -> str:
        return {"L": "R", "R": "L"}[joint[0]] + joint[1:] if joint[0] in "LR" and joint != "Root" else joint

    (ox, oy, oz), (dx, dy, dz) = site.offset, site.direction
    parts = tuple(other(part) for part in site.parts)
    return _Site(other(site.start), other(site.end), site.along, (-ox, oy, oz), (-dx, dy, dz), parts)


def _ray_exit(site: _Site, skin: SkinMesh, joint_rest: np.ndarray, joint_frame: np.ndarray) -> int:
    start, end = JOINTS.index(site.start), JOINTS.index(site.end)
    height = np.ptp(skin.rest[:, 1])
    origin = (1 - site.along) * joint_rest[start] + site.along * joint_rest[end] + height * np.array(site.offset)
    direction = joint_frame[start] @ np.array(site.direction)
    direction /= np.linalg.norm(direction)

    eligible = np.flatnonzero(np.isin(skin.heaviest_joint, [JOINTS.index(part) for part in site.parts]))
    away = skin.rest[eligible] - origin
    along = away @ direction
    off = np.linalg.norm(away - along[:, None] * direction, axis=1)
    return int(eligible[np.argmax(along - _OFF_RAY_PENALTY * off)])


_UNBOUNDED = (-np.inf, np.inf)

_ELBOW_FLEXION = (-10.0, 150.0)  # AAOS 0..150, with up to 10 of hyperextension
_KNEE_FLEXION = (-10.0, 150.0)  # AAOS 0..135, Rajagopal 0..140; 150 in a deep squat

# Degrees from the zero pose about x, y and z, left side for paired joints. Positive Rx bends the trunk and neck
# forward, the knee back and the foot down, and takes the leg back; see `joint_limits` for the right side.
_LEFT_LIMITS: dict[str, tuple[tuple[float, float], ...]] = {
    "Root": (_UNBOUNDED, _UNBOUNDED, _UNBOUNDED),
    # Thoracolumbar flexion 80, extension 30, rotation 45, side bend 35: either joint may take nearly all of it.
    "BottomSpine": ((-40.0, 80.0), (-45.0, 45.0), (-45.0, 45.0)),
    "UpperSpine": ((-40.0, 70.0), (-50.0, 50.0), (-45.0, 45.0)),
    # Cervical flexion 45..60, extension 45..75, rotation 60..80, side bend 45.
    "Neck": ((-80.0, 70.0), (-85.0, 85.0), (-60.0, 60.0)),
    # Shoulder: elevation 0..180 in every plane from sideways to forward, 60 backward, 130 across the body; rotation
    # 80 in and 90 out. Pointing forward is its gimbal lock (Ry = -90), around which Rx and Rz go far.
    "LShoulder": ((-180.0, 180.0), (-170.0, 110.0), (-130.0, 180.0)),
    # Wrist: flexion 80, extension 70, deviation 20 and 30. With the forearm's turn held (Table 1), either axis may
    # carry the flexion.
    "LWrist": ((-90.0, 90.0), (-85.0, 85.0), (-85.0, 85.0)),
    # Hip: flexion 120, extension 30, abduction 45, adduction 30, rotation 45 each way.
    "LHip": ((-150.0, 60.0), (-80.0, 80.0), (-80.0, 80.0)),
    # Ankle: dorsiflexion 20 (40 under load), plantarflexion 50, eversion 15, inversion 35, with the forefoot's turn.
    "LAnkle": ((-45.0, 65.0), (-45.0, 45.0), (-45.0, 45.0)),
}
_ELBOW_TURN = 90.0  # pronation and supination 80 each, about the forearm
_ELBOW_CARRY = 15.0
_KNEE_TURN = 40.0  # tibial rotation of the bent knee
_KNEE_SIDE = 10.0


def joint_limits(elbow_flexion: float, knee_flexion: float) -> np.ndarray:
    """Lower and upper angle of each joint about each of its axes; (joint, axis, 2) float32 [rad].

    Angles count from the zero pose, in which elbow and knee are already bent by the given angles [rad]. Left
    elbows flex by negative Ry, right ones by positive; knees flex by positive Rx. Right joints mirror the left
    ones: the same about x, opposite about y and z.
    """
    elbow, knee = np.degrees(elbow_flexion), np.degrees(knee_flexion)
    left = {
        **_LEFT_LIMITS,
        "LElbow": (
            (-_ELBOW_TURN, _ELBOW_TURN),
            (elbow - _ELBOW_FLEXION[1], elbow - _ELBOW_FLEXION[0]),
            (-_ELBOW_CARRY, _ELBOW_CARRY),
        ),
        "LKnee": (
            (_KNEE_FLEXION[0] - knee, _KNEE_FLEXION[1] - knee),
            (-_KNEE_TURN, _KNEE_TURN),
            (-_KNEE_SIDE, _KNEE_SIDE),
        ),
    }
    limits = np.array([left[joint if joint in left else "L" + joint[1:]] for joint in JOINTS])
    right = [j for j, joint in enumerate(JOINTS) if joint not in left]
    mirrored = limits[right]
    mirrored[:, 1:] = -mirrored[:, 1:, ::-1]
    limits[right] = mirrored
    return np.radians(limits).astype(np.float32)


def main() -> int:
    """Make a body as the arguments say; the exit code."""
    parser = argparse.ArgumentParser(description="Write a body of the given build as USD.")
    parser.add_argument("-o", "--output", type=Path, required=True, help="the body's file: .usdc, .usda or .usd")
    parser.add_argument("--data", type=Path, required=True, help="MakeHuman's data folder as MPFB2 ships it")
    parser.add_argument("--gender", type=float, required=True, help="0 woman to 1 man")
    parser.add_argument("--age", type=float, required=True, help="years, 1 to 90")
    parser.add_argument("--height", type=float, required=True, help="of the standing body, in metres")
    parser.add_argument("--weight", type=float, default=0.5, help="0 thin, 0.5 average, 1 heavy, for the height")
    parser.add_argument("--muscle", type=float, default=0.5, help="0 slack, 0.5 average, 1 muscular")
    parser.add_argument("--proportions", type=float, default=0.5, help="0 uncommon, 0.5 average, 1 ideal")
    parser.add_argument("--name", help="the body's name; the file's name without ending by default")
    parser.add_argument("--force", action="store_true", help="replace a file that exists")
    asked = vars(parser.parse_args())
    output, force, name, data = (asked.pop(key) for key in ("output", "force", "name", "data"))
    if output.suffix not in USD_SUFFIXES or (output.exists() and not force):
        parser.error(f"{output} exists, or does not end in {', '.join(USD_SUFFIXES)}")
    try:
        body = make_body(data, name or output.stem, **asked)
        write_body(output, body)
    except InputError as error:
        print(error, file=sys.stderr)
        return 3
    except ValueError as error:
        parser.error(str(error))
    triangles, targets = len(body.tracking_face), len(body.shape_names)
    print(f"{output}: {len(body.skin.rest)} vertices, {triangles} tracking triangles, {targets} shape targets")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
