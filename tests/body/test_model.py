"""The body's degrees of freedom, and what the shipped bodies promise to trackers and fitters."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from person_skeleton import JOINTS, PARENT
from reference import joint_transforms, skin
from synthetic import NAMES as COORDINATE_NAMES

from mmocap_warp.body.mesh_pieces import is_closed
from mmocap_warp.body.model import BodyModel
from mmocap_warp.formats.usd.usd_body import read_body
from mmocap_warp.scenes import ROOT

NAMES = ("adult_man", "adult_woman", "tall_slim_adult")
HEIGHT = {"adult_man": 1.78, "adult_woman": 1.65, "tall_slim_adult": 1.90}  # [m]
HEIGHT_TOLERANCE = 2e-4  # [m]
LEAST_SILHOUETTE_IOU = 0.98
SYMMETRY_TOLERANCE = 2e-3  # [m], MakeHuman's mesh is nearly symmetric


@pytest.fixture(scope="module", params=NAMES)
def body(request: pytest.FixtureRequest) -> BodyModel:
    return read_body(Path(ROOT) / "bodies" / f"{request.param}.usdc")


def posed(body: BodyModel, **degrees: float) -> np.ndarray:
    """Joint centres (joint, 3) with the named angles, such as ``LElbow_Ry``, and the rest at zero."""
    pose = np.zeros(51)
    pose[:3] = body.joint_rest[0]
    for name, angle in degrees.items():
        pose[COORDINATE_NAMES.index(name.replace("_", "."))] = np.radians(angle)
    return joint_transforms(body, np.eye(3), pose)[:, :3, 3]


def test_stands_on_the_ground_facing_z(body: BodyModel) -> None:
    at = dict(zip(JOINTS, body.joint_rest, strict=True))
    assert body.skin.rest[:, 1].min() == pytest.approx(0.0, abs=1e-6)
    assert np.ptp(body.skin.rest[:, 1]) == pytest.approx(HEIGHT[body.name], abs=HEIGHT_TOLERANCE)
    assert at["LShoulder"][0] > 0 > at["RShoulder"][0]
    toes = body.skin.rest[body.skin.rest[:, 1] < 0.05]
    assert toes[:, 2].max() > at["LAnkle"][2] + 0.1


def test_is_symmetric(body: BodyModel) -> None:
    mirror = np.array([-1.0, 1.0, 1.0])
    for left, name in enumerate(JOINTS):
        if name.startswith("L"):
            right = JOINTS.index("R" + name[1:])
            np.testing.assert_allclose(body.joint_rest[right], mirror * body.joint_rest[left], atol=SYMMETRY_TOLERANCE)
            turned = np.diag(mirror) @ body.skeleton.frame[left] @ np.diag(mirror)
            np.testing.assert_allclose(body.skeleton.frame[right], turned, atol=1e-2)


def test_weights(body: BodyModel) -> None:
    assert len(body.skin.rest) == 13380
    for mesh in (body.skin, body.tracking):
        assert mesh.joint.shape == mesh.weight.shape == (len(mesh.rest), 4)
        np.testing.assert_allclose(mesh.weight.sum(axis=1), 1.0, atol=1e-6)
        assert (mesh.joint[mesh.weight == 0] == 0).all()
        assert set(np.unique(mesh.joint[mesh.weight > 0.5])) == set(range(len(JOINTS)))


def test_meshes_are_closed(body: BodyModel) -> None:
    assert is_closed(body.skin.face)
    face = body.tracking_face
    assert 2000 <= len(face) <= 5000
    assert is_closed(face)
    assert len(np.unique(np.sort(face, axis=1), axis=0)) == len(face)
    np.testing.assert_array_equal(np.unique(face), np.arange(len(body.tracking_vertex)))
    assert len(np.unique(body.tracking_vertex)) == len(body.tracking_vertex)
    # Euler's formula of one closed surface without handles
    assert len(body.tracking_vertex) - len(face) // 2 == 2


def test_faces_wind_outwards(body: BodyModel) -> None:
    skin_triangles = np.concatenate([body.skin.face[:, [0, 1, 2]], body.skin.face[:, [0, 2, 3]]])
    volumes = [
        np.linalg.det(mesh[faces]).sum() / 6
        for mesh, faces in ((body.skin.rest, skin_triangles), (body.tracking.rest, body.tracking_face))
    ]
    assert 0.045 < volumes[0] < 0.080  # [m^3]
    assert 0.98 < volumes[1] / volumes[0] <= 1.0


@pytest.mark.parametrize("heading", [0, 45, 90])
def test_tracking_mesh_has_the_full_meshs_silhouette(body: BodyModel, heading: int) -> None:
    c, s = np.cos(np.radians(heading)), np.sin(np.radians(heading))
    across = np.array([[c, 0, -s], [0, -1, 0]])

    def silhouette(vertex: np.ndarray, face: np.ndarray) -> np.ndarray:
        image = np.zeros((900, 600), np.uint8)
        corners = np.round(16 * (400 * vertex @ across.T + [300, 850])).astype(np.int32)
        for polygon in corners[face]:
            cv2.fillConvexPoly(image, polygon, 1, shift=4)
        return image.astype(bool)

    full = silhouette(body.skin.rest, np.r_[body.skin.face[:, [0, 1, 2]], body.skin.face[:, [0, 2, 3]]])
    coarse = silhouette(body.tracking.rest, body.tracking_face)
    assert (full & coarse).sum() / (full | coarse).sum() > LEAST_SILHOUETTE_IOU


def test_zero_pose_is_the_bind_pose(body: BodyModel) -> None:
    pose = np.zeros(51)
    pose[:3] = body.joint_rest[0]
    transforms = joint_transforms(body, np.eye(3), pose)
    np.testing.assert_allclose(skin(body.skin, body, transforms), body.skin.rest, atol=1e-6)


@pytest.mark.parametrize(("side", "sign"), [("L", -1), ("R", 1)])
def test_elbow_flexes_towards_the_shoulder(body: BodyModel, side: str, sign: int) -> None:
    shoulder, elbow, wrist = (JOINTS.index(side + name) for name in ("Shoulder", "Elbow", "Wrist"))
    rest, bent = posed(body), posed(body, **{f"{side}Elbow_Ry": 60.0 * sign})
    assert bent[wrist, 1] > rest[wrist, 1] + 0.1
    assert bent[wrist, 2] > rest[wrist, 2]
    reach = [np.linalg.norm(joints[wrist] - joints[shoulder]) for joints in (rest, bent)]
    assert reach[1] < reach[0] - 0.05
    # A hinge: the forearm stays in the plane of its rest bend.
    np.testing.assert_allclose((bent[wrist] - bent[elbow]) @ body.skeleton.frame[elbow][:, 1], 0.0, atol=1e-6)
    # Full flexion and full extension by the limits are 150 and -10 degrees between upper arm and forearm.
    lower, upper = np.degrees(body.skeleton.limits[elbow, 1])
    flexed, straight = (lower, upper) if side == "L" else (upper, lower)
    for limit, angle in ((flexed, 150.0), (straight, 10.0)):
        joints = posed(body, **{f"{side}Elbow_Ry": limit})
        u, f = joints[elbow] - joints[shoulder], joints[wrist] - joints[elbow]
        cosine = u @ f / np.linalg.norm(u) / np.linalg.norm(f)
        assert np.degrees(np.arccos(cosine)) == pytest.approx(angle, abs=1.0)


@pytest.mark.parametrize("side", ["L", "R"])
def test_knee_flexes_backward(body: BodyModel, side: str) -> None:
    ankle = JOINTS.index(side + "Ankle")
    rest, bent = posed(body), posed(body, **{f"{side}Knee_Rx": 60.0})
    assert bent[ankle, 2] < rest[ankle, 2] - 0.2
    assert bent[ankle, 1] > rest[ankle, 1] + 0.1


def test_t_pose_aligns_the_arms_frames_with_the_body(body: BodyModel) -> None:
    pose = np.zeros(51)
    pose[:3] = body.joint_rest[0]
    for side, sign in (("L", 1), ("R", -1)):
        shoulder, elbow = JOINTS.index(side + "Shoulder"), JOINTS.index(side + "Elbow")
        upper = sign * body.skeleton.frame[shoulder][:, 0]
        fore = sign * body.skeleton.frame[elbow][:, 0]
        lowered = np.arctan2(-upper[1], sign * upper[0])
        pose[COORDINATE_NAMES.index(f"{side}Shoulder.Rz")] = sign * lowered
        pose[COORDINATE_NAMES.index(f"{side}Elbow.Ry")] = sign * np.arccos(upper @ fore)
    frames = joint_transforms(body, np.eye(3), pose)[:, :3, :3]
    off = np.degrees(np.arccos(np.clip((np.trace(frames, axis1=1, axis2=2) - 1) / 2, -1, 1)))
    assert off.max() < 10.0


GROWS = {
    "height_incr": lambda body: np.ptp(body.skin.rest[:, 1]),
    "torso_length_incr": lambda body: between(body, "Neck", "Root"),
    "arm_length_incr": lambda body: between(body, "LShoulder", "LElbow") + between(body, "LElbow", "LWrist"),
    "leg_length_incr": lambda body: between(body, "RHip", "RKnee") + between(body, "RKnee", "RAnkle"),
    "shoulder_width_incr": lambda body: between(body, "LShoulder", "RShoulder"),
    "hip_width_incr": lambda body: between(body, "LHip", "RHip"),
    "weight_incr": lambda body: volume(body),
    "chest_depth_incr": lambda body: volume(body),
    "waist_incr": lambda body: volume(body),
    "belly_incr": lambda body: volume(body),
}
LEAST_GROWTH = 0.02  # of the measure, at weight 1
LEAST_EFFECT = 0.004  # of the measure, either way: MakeHuman's steps down are smaller than those up


def between(body: BodyModel, a: str, b: str) -> float:
    return float(np.linalg.norm(body.joint_rest[JOINTS.index(a)] - body.joint_rest[JOINTS.index(b)]))


def volume(body: BodyModel) -> float:
    return float(np.linalg.det(body.tracking.rest[body.tracking_face]).sum() / 6)


@pytest.mark.parametrize("name", GROWS)
def test_shape_targets_do_what_they_say(body: BodyModel, name: str) -> None:
    measure = GROWS[name]
    before = measure(body)
    assert measure(body.shaped({name: 1.0})) > (1 + LEAST_GROWTH) * before
    assert measure(body.shaped({name.replace("incr", "decr"): 1.0})) < (1 - LEAST_EFFECT) * before


def test_muscle_and_gender_move_the_body(body: BodyModel) -> None:
    for name in ("muscle_incr", "muscle_decr", "age_incr"):
        assert np.abs(body.shape_vertex[body.shape_names.index(name)]).max() > 0.01
    genders = {name for name in body.shape_names if name.startswith("gender")}
    expected = {"adult_man": {"gender_female"}, "adult_woman": {"gender_male"}}
    assert genders == expected.get(body.name, {"gender_female", "gender_male"})
    if "gender_female" in genders:
        woman = body.shaped({"gender_female": 1.0})
        assert between(woman, "LShoulder", "RShoulder") < between(body, "LShoulder", "RShoulder")


def test_shaped_bodies_keep_their_feet_on_the_ground(body: BodyModel) -> None:
    for name in body.shape_names:
        assert body.shaped({name: 1.0}).skin.rest[:, 1].min() == pytest.approx(0.0, abs=0.02), name


def test_shaping_is_linear_and_scales(body: BodyModel) -> None:
    twice = body.shaped({"waist_incr": 0.25}, scale=1.1).shaped({"waist_incr": 0.5})
    once = body.shaped({"waist_incr": 0.75}, scale=1.1)
    np.testing.assert_allclose(twice.skin.rest, once.skin.rest, atol=1e-6)
    np.testing.assert_allclose(twice.joint_rest, once.joint_rest, atol=1e-6)
    with pytest.raises(ValueError, match="unknown shape targets"):
        body.shaped({"beard": 1.0})


PLUG_IN_GAIT = ("LFHD", "RBHD", "C7", "CLAV", "STRN", "LSHO", "RELB", "LWRA", "RASI", "LPSI", "RKNE", "LANK", "RHEE")


def test_markers(body: BodyModel) -> None:
    assert 20 <= len(body.marker_names) <= 40
    assert len(set(body.marker_names)) == len(set(body.marker_vertex.tolist())) == len(body.marker_names)
    assert set(PLUG_IN_GAIT) <= set(body.marker_names)
    at = dict(zip(body.marker_names, body.skin.rest[body.marker_vertex], strict=True))
    joint = dict(zip(JOINTS, body.joint_rest, strict=True))
    for name, position in at.items():
        if name.startswith("L"):
            np.testing.assert_allclose(at["R" + name[1:]], position * [-1, 1, 1], atol=0.01)
    order = ["RFHD", "C7", "CLAV", "STRN", "LASI", "LTHI", "LKNE", "LTIB", "LANK", "LHEE"]
    assert [at[name][1] for name in order] == sorted((at[name][1] for name in order), reverse=True)
    assert at["STRN"][2] > 0.05 > at["T10"][2]
    assert at["LASI"][2] > at["LPSI"][2] + 0.1
    assert at["LTOE"][2] > at["LHEE"][2] + 0.12
    for marker, near in (("LELB", "LElbow"), ("RKNE", "RKnee"), ("LANK", "LAnkle"), ("RWRA", "RWrist")):
        assert np.linalg.norm(at[marker] - joint[near]) < 0.09


def test_says_where_it_comes_from(body: BodyModel) -> None:
    assert "CC0" in body.attribution
    assert "MakeHuman" in body.attribution
    assert f"height {HEIGHT[body.name]:g} m" in body.attribution


def test_parents_come_first() -> None:
    assert all(parent < j for j, parent in enumerate(PARENT))
