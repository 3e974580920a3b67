"""People unlike the tracker's bodies: segments of their own sizes, a skirt that hangs over both legs, a coat."""

from __future__ import annotations

import numpy as np
import pytest

from mmocap_warp.synthesis.exact_posing import ExactPoser
from mmocap_warp.synthesis.footage.outlines import Surface
from mmocap_warp.synthesis.garment import GARMENTS, GarmentPoser, dressed, worn_vertices
from mmocap_warp.synthesis.walkers import PEOPLE, STRANGERS, resized


@pytest.fixture(scope="module")
def man():
    return PEOPLE["S1"].true_body()


@pytest.fixture(scope="module")
def woman():
    return STRANGERS["Skirt"].true_body()


def length(body, start, end):
    index = body.skeleton.index
    return np.linalg.norm(body.joint_rest[index(end)].astype(float) - body.joint_rest[index(start)])


# Sizes


def test_a_body_whose_segments_keep_their_size_is_the_same(man):
    same = resized(man, {"LKnee": (1.0, 1.0)})
    np.testing.assert_allclose(same.skin.rest, man.skin.rest, atol=1e-6)
    np.testing.assert_allclose(same.joint_rest, man.joint_rest, atol=1e-6)
    assert same.shape_vertex.shape == (0, *man.skin.rest.shape)


def test_a_segment_has_its_length_and_girth_and_no_other_changes(man):
    other = resized(man, {"LShoulder": (1.10, 0.90)})
    assert length(other, "LShoulder", "LElbow") == pytest.approx(1.10 * length(man, "LShoulder", "LElbow"), rel=1e-5)
    for start, end in (("LElbow", "LWrist"), ("RShoulder", "RElbow"), ("LHip", "LKnee"), ("UpperSpine", "LShoulder")):
        assert length(other, start, end) == pytest.approx(length(man, start, end), rel=1e-5)

    def girth(body):
        j, end = body.skeleton.index("LShoulder"), body.skeleton.index("LElbow")
        own = (body.skin.joint[:, 0] == j) & (body.skin.weight[:, 0] > 0.999)
        bone = (body.joint_rest[end] - body.joint_rest[j]).astype(float)
        away = (body.skin.rest[own] - body.joint_rest[j]).astype(float)
        across = away - np.outer(away @ bone, bone) / (bone @ bone)
        return np.linalg.norm(across, axis=1)

    np.testing.assert_allclose(girth(other), 0.90 * girth(man), rtol=1e-3)
    with pytest.raises(ValueError, match="LWing"):
        resized(man, {"LWing": (1.0, 1.0)})


def test_uneven_limbs_differ_from_side_to_side():
    body = STRANGERS["Uneven"].true_body()
    assert length(body, "LShoulder", "LElbow") > 1.1 * length(body, "RShoulder", "RElbow")
    assert 0.005 < length(body, "RHip", "RKnee") - length(body, "LHip", "LKnee") < 0.02


def test_a_child_has_a_big_head_and_short_limbs():
    child, grown = STRANGERS["Child"].true_body(), PEOPLE["S2"].true_body()
    tall, stature = (np.ptp(body.skin.rest[:, 1]) for body in (child, grown))
    assert 1.05 < tall < 1.20
    share = [
        (body.skin.rest[:, 1].max() - body.joint_rest[body.skeleton.index("Neck"), 1]) / height
        for body, height in ((child, tall), (grown, stature))
    ]
    assert share[0] > 1.3 * share[1]
    leg = [(length(body, "LHip", "LKnee") + length(body, "LKnee", "LAnkle")) for body in (child, grown)]
    assert leg[0] / tall < 0.95 * leg[1] / stature


@pytest.mark.parametrize("name", STRANGERS)
def test_each_stands_on_the_floor_and_has_no_shapes(name):
    body = STRANGERS[name].true_body()
    assert body.skin.rest[:, 1].min() == pytest.approx(0.0, abs=0.01)
    assert body.shape_names == ()


# The skirt


def test_a_skirt_is_a_closed_surface_of_its_own(woman):
    bare = len(PEOPLE["S2"].true_body().skin.rest)
    own = woman.skin.face[(woman.skin.face >= bare).all(axis=1)] - bare
    assert len(own) == len(woman.skin.face) - len(PEOPLE["S2"].true_body().skin.face)
    surface = Surface.of(own)
    assert (surface.right < len(own)).all()  # every edge has a face on both sides
    assert set(own.ravel()) == set(range(len(woman.skin.rest) - bare))
    corner = woman.skin.rest[own + bare].astype(float)
    normal = np.cross(corner[:, 2] - corner[:, 0], corner[:, 3] - corner[:, 1])
    middle = woman.skin.rest[bare:].mean(axis=0)
    assert ((corner.mean(axis=1) - middle) * normal).sum(axis=1).min() > 0  # all face outward


def test_a_skirt_goes_around_both_legs_in_any_pose_and_leaves_the_skin_as_it_is(woman):
    bare = len(PEOPLE["S2"].true_body().skin.rest)
    pose = np.zeros((1, woman.skeleton.coordinates))
    pose[0, :3] = 0.2, 1.0, -0.3
    pose[0, woman.skeleton.angles("Root")] = 0.0, 0.8, 0.0
    pose[0, woman.skeleton.angles("LHip").start] = -0.5
    pose[0, woman.skeleton.angles("RHip").start] = 0.3
    clothed = GarmentPoser(woman, np.eye(3), GARMENTS["skirt"]).vertices(pose)[0]
    plain = ExactPoser(woman, np.eye(3)).vertices(pose)[0]
    np.testing.assert_array_equal(clothed[:bare], plain[:bare])
    rings = clothed[bare:-2].reshape(16, 48, 3)
    joints = ExactPoser(woman, np.eye(3)).joint_transforms(pose)[0, :, :3, 3]
    for side in "LR":  # the middle of each thigh is inside its ring
        thigh = (joints[woman.skeleton.index(f"{side}Hip")] + joints[woman.skeleton.index(f"{side}Knee")]) / 2
        ring = rings[np.abs(rings[:, 0, 1] - thigh[1]).argmin()][:, [0, 2]]
        edge = np.roll(ring, -1, axis=0) - ring
        inward = thigh[[0, 2]] - ring
        assert (edge[:, 1] * inward[:, 0] - edge[:, 0] * inward[:, 1] > 0).mean() > 0.95
    width = np.linalg.norm(rings - rings.mean(axis=1, keepdims=True), axis=-1).mean(axis=1)
    assert width[-1] > 1.3 * width[4]  # it flares
    assert np.ptp(rings[..., 1], axis=1).max() < 1e-9


def test_a_skirt_turns_with_the_pelvis(woman):
    bare = len(PEOPLE["S2"].true_body().skin.rest)
    poses = np.zeros((2, woman.skeleton.coordinates))
    poses[1, woman.skeleton.angles("Root").start + 1] = 0.7
    straight, turned = GarmentPoser(woman, np.eye(3), GARMENTS["skirt"]).vertices(poses)[:, bare:]
    c, s = np.cos(0.7), np.sin(0.7)
    np.testing.assert_allclose(turned, straight @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T, atol=2e-3)


def test_what_swings_lags_behind_and_comes_to_rest(woman):
    count = 480
    poser, resting = (GarmentPoser(woman, np.eye(3), GARMENTS[name]) for name in ("swinging skirt", "skirt"))
    poses, half = np.zeros((count, woman.skeleton.coordinates)), count // 2
    poses[half:, 0] = 1.2 * np.arange(count - half) / 60  # sets off to the left at 1.2 m/s
    hem = slice(-2 - 48, -2)
    swing = {
        f: (poser.moving(poses, f, 60.0) - resting.moving(poses, f, 60.0)) for f in (0, half, half + 15, count - 1)
    }
    for frame in (0, half):
        np.testing.assert_array_equal(swing[frame], 0.0)
    lag = swing[half + 15][hem].mean(axis=0)
    assert -0.0901 < lag[0] < -0.05
    np.testing.assert_allclose(lag[1:], 0.0, atol=1e-12)
    np.testing.assert_allclose(swing[half + 15][hem], np.tile(lag, (48, 1)), atol=1e-12)
    np.testing.assert_array_equal(swing[half + 15][: -2 - 16 * 48], 0.0)  # the skin
    assert np.abs(swing[count - 1]).max() < 1e-3
    np.testing.assert_array_equal(
        poser.moving(poses[: half + 16], half + 15, 60.0), poser.moving(poses, half + 15, 60.0)
    )


def test_a_coat_has_sleeves_and_reaches_below_the_knees():
    coat = STRANGERS["Coat"].true_body()
    worn = worn_vertices(coat, GARMENTS["coat"])
    rest, at = (
        coat.skin.rest,
        {name: coat.joint_rest[coat.skeleton.index(name)] for name in ("LKnee", "LAnkle", "LElbow")},
    )
    assert at["LAnkle"][1] < rest[worn, 1].min() < at["LKnee"][1] - 0.05
    assert worn[np.linalg.norm(rest - at["LElbow"], axis=1) < 0.05].mean() > 0.9
    assert not worn[rest[:, 1] > rest[:, 1].max() - 0.2].any()  # the head


def test_dressing_keeps_the_markers(man):
    clothed = dressed(man, GARMENTS["skirt"])
    np.testing.assert_array_equal(clothed.skin.rest[clothed.marker_vertex], man.skin.rest[man.marker_vertex])
    assert clothed.shape_vertex.shape[1] == len(clothed.skin.rest)
