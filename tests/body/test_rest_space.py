"""The rest shape as a linear space: what its parameters do, on people and on other bodies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from other_bodies import arm_robot, burdened, quadruped
from random_scenes import perfect_masks
from scipy.spatial import cKDTree
from synthetic import ring_rig

from mmocap_warp.body.mirroring import mirrored_joints, mirrored_weights
from mmocap_warp.body.model import BodyModel, SkinMesh, Subject
from mmocap_warp.body.posing import Poser
from mmocap_warp.body.rest_space import RestSpace
from mmocap_warp.formats.usd.usd_body import read_subject, write_subject
from mmocap_warp.formats.usd.usd_check import faults
from mmocap_warp.formats.usd.usd_result import export_animation
from mmocap_warp.masks.observation import Observation
from mmocap_warp.rigging.shipped import load_body
from mmocap_warp.tracking.frame_loop import track_observations
from mmocap_warp.tracking.track_config import TrackConfig

BODIES: dict[str, Callable[[], BodyModel]] = {
    "adult_man": lambda: load_body("adult_man"),
    "adult_woman": lambda: load_body("adult_woman"),
    "tall_slim_adult": lambda: load_body("tall_slim_adult"),
    "quadruped": quadruped,
    "arm": arm_robot,
    "burdened": burdened,
}
PEOPLE = ("adult_man", "adult_woman", "tall_slim_adult")
MIRROR = np.array([-1.0, 1.0, 1.0])


@cache
def space_of(name: str) -> RestSpace:
    return RestSpace(BODIES[name]())


@pytest.fixture(params=BODIES)
def space(request: pytest.FixtureRequest) -> RestSpace:
    return space_of(request.param)


@pytest.fixture(params=PEOPLE)
def person(request: pytest.FixtureRequest) -> RestSpace:
    return space_of(request.param)


def likely(space: RestSpace, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=len(space.names)) * space.sigma


def only(space: RestSpace, name: str, value: float) -> np.ndarray:
    beta = np.zeros(len(space.names))
    beta[space.names.index(name)] = value
    return beta


def bone_lengths(space: RestSpace, joint: np.ndarray) -> np.ndarray:
    """(joint - 1,), from each joint but the root to its parent."""
    return np.linalg.norm(joint[1:] - joint[list(space.body.skeleton.parent[1:])], axis=1)


def test_parameters_of_a_person(person: RestSpace) -> None:
    sliders = [name for name in person.names if "." not in name][:-1]
    assert sliders == [  # height is left to the scale; age has no younger side; one gender goes both ways
        *("weight", "muscle", "gender_male" if person.body.name == "adult_woman" else "gender_female"),
        *("torso_length", "arm_length", "leg_length", "shoulder_width", "hip_width", "chest_depth", "waist", "belly"),
    ]
    bones = [name.removeprefix("bone.") for name in person.names if name.startswith("bone.")]
    girths = [name.removeprefix("girth.") for name in person.names if name.startswith("girth.")]
    arm, leg = (
        [f"L{joint}+R{joint}" for joint in limb] for limb in (("Shoulder", "Elbow", "Wrist"), ("Hip", "Knee", "Ankle"))
    )
    assert bones == ["BottomSpine", "UpperSpine", *arm, "Neck", *leg]
    assert girths == ["Root", *bones]
    assert person.names[-1] == "log_scale"


def test_standard_deviations_are_in_units_of_the_parameters(space: RestSpace) -> None:
    rest = space.body.skin.rest[space.body.own_vertex]
    size = min(1.0, np.ptp(rest, axis=0).max() / 1.2)  # lengths are those of people, and smaller of smaller bodies
    expected = {"bone": 0.02 * size, "girth": 0.01 * size, "log_scale": 0.3}
    kinds = [name.split(".")[0] for name in space.names]
    np.testing.assert_allclose(space.sigma, [expected.get(kind, 0.5) for kind in kinds], rtol=1e-6)


def test_bodies_without_shape_targets() -> None:
    pairs = ("LForeHip+RForeHip", "LForeKnee+RForeKnee", "LHindHip+RHindHip", "LHindKnee+RHindKnee")
    girths = tuple(f"girth.{name}" for name in ("Trunk", "Head", *pairs))
    assert space_of("quadruped").names == ("bone.Head", *(f"bone.{name}" for name in pairs), *girths, "log_scale")
    axes = [f"Axis{i}" for i in range(1, 7)]
    expected = (*(f"bone.{name}" for name in axes), *(f"girth.{name}" for name in ("Base", *axes)), "log_scale")
    assert space_of("arm").names == expected


def test_zero_is_the_body_itself(space: RestSpace) -> None:
    same, body = space.model(np.zeros(len(space.names))), space.body
    for mine, theirs in (
        (same.skin.rest, body.skin.rest),
        (same.joint_rest, body.joint_rest),
        (same.shape_vertex, body.shape_vertex),
        (same.shape_joint, body.shape_joint),
    ):
        assert mine.dtype == np.float32
        np.testing.assert_array_equal(mine, theirs)


def test_derivatives(space: RestSpace) -> None:
    beta, step = likely(space), 1e-6
    d_rest, d_joint = space.basis(beta)
    assert d_rest.dtype == d_joint.dtype == np.float64
    for k in range(len(beta)):
        aside = step * np.eye(len(beta))[k]
        above, below = space.at(beta + aside), space.at(beta - aside)
        np.testing.assert_allclose(d_rest[k], (above[0] - below[0]) / (2 * step), atol=1e-8)
        np.testing.assert_allclose(d_joint[k], (above[1] - below[1]) / (2 * step), atol=1e-8)


def test_a_rigid_body_has_no_parameters(space: RestSpace) -> None:
    rigid = RestSpace(replace(space.body, rigid=True))
    assert rigid.names == ()
    assert not len(rigid.sigma)
    none = rigid.nearest(space.body)
    for known, other in zip(rigid.at(none), space.at(np.zeros(len(space.names))), strict=True):
        np.testing.assert_array_equal(known, other)
    vertex, joint = rigid.basis(none, space.body.tracking_vertex)
    assert vertex.shape == (0, len(space.body.tracking_vertex), 3)
    assert joint.shape == (0, *space.body.joint_rest.shape)
    assert rigid.model(none) is rigid.body


def test_some_vertices_are_as_among_all(space: RestSpace) -> None:
    beta, some = likely(space), space.body.tracking_vertex[::3]
    np.testing.assert_array_equal(space.at(beta, some)[0], space.at(beta)[0][some])
    np.testing.assert_array_equal(space.basis(beta, some)[0], space.basis(beta)[0][:, some])


def test_people_stay_symmetric(person: RestSpace) -> None:
    mirror = cKDTree(person.body.skin.rest).query(person.body.skin.rest * MIRROR)[1]
    for seed in range(3):
        rest, joint = person.at(likely(person, seed))
        np.testing.assert_allclose(rest[mirror], rest * MIRROR, atol=1e-4)
        for _, left, right in person.body.skeleton.pairs:
            sides = [person.body.skeleton.index(name) for name in (left, right)]
            np.testing.assert_allclose(joint[sides[1]], joint[sides[0]] * MIRROR, atol=1e-4)


def test_a_difference_of_sides_lengthens_or_widens_left_limbs_as_it_shortens_or_thins_right_ones(
    person: RestSpace,
) -> None:
    body, skeleton = person.body, person.body.skeleton
    mirror = cKDTree(body.skin.rest).query(body.skin.rest * MIRROR)[1]
    sigma, skin, joint = person.between_sides()
    pairs = {name for name in person.names if "+" in name}
    assert len(sigma) == len(skin) == len(joint) == len(pairs) > 6
    assert (sigma < 0.02).all()
    np.testing.assert_allclose(skin[:, mirror], -skin * MIRROR, atol=0.1)
    lengths = np.array([bone_lengths(person, body.joint_rest + 0.01 * each) for each in joint])
    lengths -= bone_lengths(person, body.joint_rest)
    for name in pairs:
        if name.startswith("bone."):
            left, right = (skeleton.index(end) - 1 for end in name.removeprefix("bone.").split("+"))
            own = np.flatnonzero(np.abs(lengths[:, left]) > 1e-4)
            assert len(own) == 1
            np.testing.assert_allclose(lengths[own[0], [left, right]], [0.01, -0.01], atol=1e-4)


def test_sliders_of_one_side_change_the_kind(person: RestSpace) -> None:
    kinds = [name for name, kind in zip(person.names, person.changes_kind, strict=True) if kind]
    assert kinds == [name for name in ("gender_female", "gender_male") if name in person.names]


def test_a_bone_lengthens_by_its_parameter_and_no_other_does(space: RestSpace) -> None:
    groups = mirrored_joints(space.body)
    before = bone_lengths(space, space.at(np.zeros(len(space.names)))[1])
    for name in (name for name in space.names if name.startswith("bone.")):
        longer = bone_lengths(space, space.at(only(space, name, 0.03))[1]) - before
        expected = np.isin(np.arange(1, len(before) + 1), groups[name.removeprefix("bone.")]) * 0.03
        np.testing.assert_allclose(longer, expected, atol=1e-12)


def test_skin_follows_a_bone_that_lengthens() -> None:
    space = space_of("adult_man")
    body = space.body
    moved = space.at(only(space, "bone.LKnee+RKnee", 0.03))[0] - body.skin.rest
    hip, knee, ankle = (body.joint_rest[body.skeleton.index(f"L{name}")] for name in ("Hip", "Knee", "Ankle"))
    down = (knee - hip) / np.linalg.norm(knee - hip)
    heaviest = body.skin.heaviest_joint
    foot = (heaviest == body.skeleton.index("LAnkle")) & (body.skin.rest[:, 1] < ankle[1])
    np.testing.assert_allclose(moved[foot], np.broadcast_to(0.03 * down, moved[foot].shape), atol=1e-4)
    head = heaviest == body.skeleton.index("Neck")
    np.testing.assert_allclose(moved[head], 0, atol=1e-12)
    thigh = (heaviest == body.skeleton.index("LHip")) & (np.abs((body.skin.rest - hip) @ down - 0.2) < 0.01)
    share = 0.2 / np.linalg.norm(knee - hip)
    np.testing.assert_allclose(moved[thigh] @ down, 0.03 * share, atol=2e-3)


def test_girth_widens_a_limb_and_moves_no_joint(space: RestSpace) -> None:
    for name in (name for name in space.names if name.startswith("girth.")):
        rest, joint = space.at(only(space, name, 0.01))
        np.testing.assert_array_equal(joint, space.body.joint_rest)
        outward = np.linalg.norm(rest - space.body.skin.rest, axis=1)
        whole = mirrored_weights(space.body)[:, list(mirrored_joints(space.body)[name.removeprefix("girth.")])].sum(1)
        np.testing.assert_allclose(outward, 0.01 * whole, atol=1e-12)


def test_girth_makes_a_thigh_thicker() -> None:
    space = space_of("adult_man")
    body = space.body
    hip, knee = (body.joint_rest[body.skeleton.index(f"L{name}")] for name in ("Hip", "Knee"))
    down = (knee - hip) / np.linalg.norm(knee - hip)
    middle = (hip + knee) / 2

    def radius(rest: np.ndarray) -> float:
        away = body.skin.rest - middle
        slab = (np.abs(away @ down) < 0.02) & (np.linalg.norm(away, axis=1) < 0.15)
        from_axis = rest[slab] - middle
        return float(np.linalg.norm(from_axis - (from_axis @ down)[:, None] * down, axis=1).mean())

    wider = radius(space.at(only(space, "girth.LHip+RHip", 0.02))[0]) - radius(body.skin.rest.astype(float))
    assert wider == pytest.approx(0.02, abs=2e-3)


def test_scale_is_that_of_a_shaped_body(space: RestSpace) -> None:
    mine, theirs = space.model(only(space, "log_scale", np.log(1.2))), space.body.shaped({}, 1.2)
    np.testing.assert_allclose(mine.skin.rest, theirs.skin.rest, atol=1e-6)
    np.testing.assert_allclose(mine.joint_rest, theirs.joint_rest, atol=1e-6)
    np.testing.assert_allclose(mine.shape_vertex, theirs.shape_vertex, atol=1e-6)
    np.testing.assert_allclose(mine.shape_joint, theirs.shape_joint, atol=1e-6)


def test_a_slider_is_the_mean_of_its_targets() -> None:
    space = space_of("adult_man")
    more, less = (space.body.shaped({f"waist_{side}": 0.5}) for side in ("incr", "decr"))
    rest, joint = space.at(only(space, "waist", 0.5))
    mean = space.body.skin.rest + (more.skin.rest.astype(float) - less.skin.rest) / 2
    np.testing.assert_allclose(rest, mean, atol=1e-6)
    np.testing.assert_allclose(
        joint, space.body.joint_rest + (more.joint_rest.astype(float) - less.joint_rest) / 2, atol=1e-6
    )


def test_planted_parameters_are_found(space: RestSpace) -> None:
    planted = likely(space, 1)
    body = space.model(planted)
    elsewhere = replace(
        body, skin=replace(body.skin, rest=body.skin.rest + np.float32(0.3)), joint_rest=body.joint_rest + 0.3
    )
    for target in (body, elsewhere):
        np.testing.assert_allclose((space.nearest(target) - planted) / space.sigma, 0, atol=0.02)


def test_the_nearest_body_to_another_person_is_close() -> None:
    space, woman = space_of("adult_man"), load_body("adult_woman")
    found = space.model(space.nearest(woman))
    apart = (found.skin.rest - found.joint_rest[0]) - (woman.skin.rest - woman.joint_rest[0])
    assert np.sqrt((apart**2).sum(axis=1).mean()) < 1e-3


def test_a_body_of_another_mesh_has_no_nearest() -> None:
    with pytest.raises(ValueError, match="joints and the mesh of 'Dog'"):
        space_of("quadruped").nearest(arm_robot())


def test_the_model_is_written_and_read(tmp_path: Path, space: RestSpace) -> None:
    body = space.model(likely(space, 2) / 2)
    pose = np.zeros(body.skeleton.coordinates)
    pose[:3] = body.joint_rest[0]
    write_subject(tmp_path / "subject.usdc", Subject(body, np.eye(3), pose, {}))
    again = read_subject(tmp_path / "subject.usdc").body
    np.testing.assert_array_equal(again.skin.rest, body.skin.rest)
    np.testing.assert_array_equal(again.tracking.rest, body.tracking.rest)
    np.testing.assert_allclose(again.joint_rest, body.joint_rest, atol=1e-6)
    np.testing.assert_array_equal(again.shape_vertex, body.shape_vertex)


@pytest.mark.parametrize("name", ["adult_man", "quadruped", "arm"])
def test_the_model_is_tracked_and_exported(tmp_path: Path, name: str) -> None:
    space = space_of(name)
    body = space.model(likely(space, 2) / 2)
    pose = np.zeros(body.skeleton.coordinates)
    pose[:3] = body.joint_rest[0]
    subject, rig = Subject(body, np.eye(3), pose, {}), ring_rig(cameras=3, size=(80, 60), distance=4.0)
    seen = [Observation.from_masks(perfect_masks(subject, rig, pose))] * 2
    result = track_observations(
        subject, rig, seen, 60.0, TrackConfig("h-cmaes", evaluations=120, device="cpu", threads=1)
    )
    standing = Poser(body, np.eye(3)).joint_transforms(pose[None].astype(np.float32))[0, :, :3, 3]
    np.testing.assert_allclose(standing, body.joint_rest, atol=1e-5)
    export_animation(result, tmp_path / "animation.usda")
    assert not faults(tmp_path / "animation.usda")


def test_joints_that_are_no_pair_mirror_each_other_by_name_and_place() -> None:
    dog = quadruped()
    unpaired = replace(dog, skeleton=replace(dog.skeleton, pairs=()))
    assert mirrored_joints(unpaired) == mirrored_joints(dog)

    rest = dog.joint_rest.copy()
    rest[dog.skeleton.index("LForeKnee")] += 0.1
    lame = mirrored_joints(replace(unpaired, joint_rest=rest))
    assert {"LForeKnee", "RForeKnee"} < set(lame)


@pytest.mark.parametrize("names", [("hip_left", "hip_right"), ("LeftHip", "RightHip"), ("hip_l", "hip_r")])
def test_sides_are_read_off_names(names: tuple[str, str]) -> None:
    dog = quadruped()
    renamed = {"LForeHip": names[0], "RForeHip": names[1]}
    joints = tuple(renamed.get(joint, joint) for joint in dog.skeleton.joints)
    groups = mirrored_joints(replace(dog, skeleton=replace(dog.skeleton, joints=joints, pairs=())))
    assert f"{names[0]}+{names[1]}" in groups


def test_weights_are_equal_on_both_sides_where_vertices_lie_on_each_other() -> None:
    """Two joints' skins that touch have mirror images of their own."""
    dog = quadruped()
    skin = dog.skin
    touching = np.concatenate([skin.rest, skin.rest[:8]])
    joint = np.concatenate([skin.joint, np.full((8, 4), 1, np.int32)])
    doubled = SkinMesh(touching, skin.face, joint, np.concatenate([skin.weight, skin.weight[:8]]))
    weight = mirrored_weights(replace(dog, skin=doubled))
    np.testing.assert_array_equal(weight[:8, 0], 1)
    np.testing.assert_array_equal(weight[-8:, 1], 1)


def test_a_bone_of_no_length_has_no_parameter() -> None:
    arm = arm_robot()
    rest = arm.joint_rest.copy()
    rest[3] = rest[2]
    names = RestSpace(replace(arm, joint_rest=rest)).names
    assert "bone.Axis3" not in names
    assert {"bone.Axis2", "bone.Axis4", "girth.Axis3"} < set(names)
