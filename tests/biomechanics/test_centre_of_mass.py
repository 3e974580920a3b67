"""The centre of mass: symmetry, plausibility, and where it cannot be told."""

import numpy as np
import pytest
from measured import answer, mirrored
from other_bodies import quadruped

from mmocap_warp.biomechanics.measure_all import measure
from mmocap_warp.biomechanics.segments import _HEAD_AND_TRUNK, _LIMBS, centre_of_mass, skin_place
from mmocap_warp.body.posing import Poser
from mmocap_warp.rigging.shipped import load_body

BODIES = {name: load_body(name) for name in ("adult_man", "adult_woman", "tall_slim_adult")}


def centre(body, poses, **more):
    sex = more.pop("sex", None)
    return measure(answer(body, poses, **more), sex=sex).runs[0].centre_of_mass


def bent_alike(body, seed=1):
    """A pose that is its own mirror image."""
    rng = np.random.default_rng(seed)
    pose = 0.3 * rng.normal(size=(1, body.skeleton.coordinates))
    pose[0, :3] = 0.0, 1.0, 0.2
    return (pose + mirrored(body, pose)) / 2


@pytest.mark.parametrize("name", BODIES)
def test_of_a_symmetric_pose_it_lies_in_the_mirror_plane(name):
    assert abs(centre(BODIES[name], bent_alike(BODIES[name]))[0, 0]) < 1e-6


@pytest.mark.parametrize("name", BODIES)
def test_it_is_near_the_centre_of_the_skins_volume(name):
    """Standing, within 20 mm: people are not of one density."""
    body = BODIES[name]
    pose = np.zeros((1, body.skeleton.coordinates))
    pose[0, :3] = body.joint_rest[0]
    corner = body.tracking.rest[body.tracking_face].astype(float)
    volume = np.linalg.det(corner) / 6
    middle = volume @ corner.mean(axis=1) * 0.75 / volume.sum()
    assert np.linalg.norm(centre(body, pose)[0] - middle) < 0.02
    assert 0.54 < centre(body, pose)[0, 1] / np.ptp(body.skin.rest[:, 1]) < 0.59


def test_it_moves_with_the_world():
    body = BODIES["adult_man"]
    pose = 0.3 * np.random.default_rng(2).normal(size=(3, body.skeleton.coordinates))
    there = answer(body, pose, up="+z", heading=0.8)
    np.testing.assert_allclose(
        measure(there).runs[0].centre_of_mass, centre(body, pose) @ there.subject.root_base.T, atol=2e-6
    )


def test_raised_arms_raise_it_by_their_share():
    """Of a straight arm that turns from hanging to sideways, each part's centre rises by its way from the shoulder."""
    body, skeleton = BODIES["adult_man"], BODIES["adult_man"].skeleton
    poses = np.zeros((2, skeleton.coordinates))
    poses[1, skeleton.angles("LShoulder").start + 2] = np.pi / 6
    low, high = centre(body, poses, sex="male")
    assert 0.003 < np.linalg.norm(high - low) < 0.04


def test_shares_of_mass_make_a_whole():
    for sex in (0, 1):
        whole = sum(share.mass[sex] for share in _HEAD_AND_TRUNK) + 2 * sum(share.mass[sex] for share in _LIMBS)
        assert abs(whole - 1) < 2e-4


def test_womens_shares_lower_it_and_the_mean_is_between():
    body = BODIES["adult_woman"]
    pose = np.zeros((1, body.skeleton.coordinates))
    female, male, either = (centre(body, pose, sex=sex)[0, 1] for sex in ("female", "male", None))
    assert min(female, male) < either < max(female, male)
    assert abs(female - male) < 0.01


def test_a_dog_has_none():
    assert centre(quadruped(), np.zeros((2, quadruped().skeleton.coordinates))) is None


DE_LEVA = {  # de Leva (1996), table 4: percent of the body's mass; of the way from a segment's first end to its last
    "female": {
        ("Top", "Neck"): (6.68, 48.41), ("Shoulder", "Hip"): (42.57, 37.82), ("Shoulder", "Elbow"): (2.55, 57.54),
        ("Elbow", "Wrist"): (1.38, 45.59), ("Wrist", "Fingertip"): (0.56, 34.27), ("Hip", "Knee"): (14.78, 36.12),
        ("Knee", "Ankle"): (4.81, 43.52), ("Heel", "Toe"): (1.29, 40.14),
    },
    "male": {
        ("Top", "Neck"): (6.94, 50.02), ("Shoulder", "Hip"): (43.46, 43.10), ("Shoulder", "Elbow"): (2.71, 57.72),
        ("Elbow", "Wrist"): (1.62, 45.74), ("Wrist", "Fingertip"): (0.61, 36.24), ("Hip", "Knee"): (14.16, 40.95),
        ("Knee", "Ankle"): (4.33, 43.95), ("Heel", "Toe"): (1.37, 44.15),
    },
}  # fmt: skip
SKIN = {
    "Top": ("Neck", (0, 1, 0)),
    "Fingertip": ("Wrist", None),
    "Heel": ("Ankle", (0, 0, -1)),
    "Toe": ("Ankle", (0, 0, 1)),
}


@pytest.mark.parametrize("sex", DE_LEVA)
def test_each_segment_weighs_what_is_printed_for_its_sex(sex):
    body, rng = BODIES["adult_woman"], np.random.default_rng(4)
    world = Poser(body, np.eye(3)).joint_transforms(0.4 * rng.normal(size=(3, body.skeleton.coordinates)))

    def place(name: str, side: str) -> np.ndarray:
        joint, direction = SKIN.get(name, (name, None))
        joint = joint if joint == "Neck" else side + joint
        on_skin = name in SKIN
        return skin_place(body, world, joint, direction) if on_skin else world[:, body.skeleton.index(joint), :3, 3]

    total, weighted = 0.0, 0.0
    for (first, last), (mass, share) in DE_LEVA[sex].items():
        limb = first not in ("Top", "Shoulder") or last == "Elbow"  # there are two of it, or one between both sides
        for side in "LR":
            here = (1 - share / 100) * place(first, side) + share / 100 * place(last, side)
            total, weighted = total + mass * (1 + limb), weighted + mass * (1 + limb) * here
    np.testing.assert_allclose(centre_of_mass(body, world, sex), weighted / total, atol=1e-6)
