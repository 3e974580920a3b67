"""Joint angles against planted ones."""

from dataclasses import replace

import numpy as np
import pytest
from measured import answer, mirrored
from other_bodies import arm_robot, quadruped
from synthetic import synthetic_body

from mmocap_warp.biomechanics.joint_angles import joint_angles, joints_left_out, own_angles
from mmocap_warp.biomechanics.measure_all import measure
from mmocap_warp.biomechanics.segments import SEGMENTS
from mmocap_warp.body.joint_sets import joint_set
from mmocap_warp.body.rotations import turn, zyx_angles
from mmocap_warp.rigging.shipped import load_body
from mmocap_warp.synthesis.motion.limb_motion import Leg

MAN = load_body("adult_man")


def angles_of(body, poses, **world):
    return measure(answer(body, poses, **world)).runs[0].angles


def some_poses(body, frames=12, wide=0.4, seed=3):
    """Within the limits, a root that turns and moves."""
    rng = np.random.default_rng(seed)
    poses = np.zeros((frames, body.skeleton.coordinates))
    poses[:, 3:] = rng.uniform(-wide, wide, (frames, body.skeleton.coordinates - 3))
    poses[:, :3] = rng.normal(size=(frames, 3))
    return poses


@pytest.mark.parametrize("name", ["adult_man", "adult_woman", "tall_slim_adult"])
@pytest.mark.parametrize("side", "LR")
def test_knee_flexion_is_what_was_planted(name, side):
    """Counted from the straight leg. The bodies' knees bend about the bind pose's x, 6 degrees off a leg's normal."""
    body, planted = load_body(name), np.arange(0.0, 121.0, 5.0)
    poses = np.zeros((len(planted), body.skeleton.coordinates))
    poses[:, body.skeleton.angles(f"{side}Knee").start] = Leg.of(body, side).straight + np.radians(planted)
    off = np.abs(angles_of(body, poses)[f"{side}Knee"]["flexion"] - planted)
    assert off[planted <= 30].max() < 0.2
    assert off[planted <= 60].max() < 0.4
    assert off.max() < 0.65


@pytest.mark.parametrize("name", ["adult_man", "adult_woman", "tall_slim_adult"])
def test_limbs_go_by_the_centres_of_a_joint_set(name):
    """In the bind pose, where all definitions of a centre stand still, thigh and shank point from one to the next."""
    body = load_body(name)
    isb = joint_set("isb", body)
    rest = dict(zip(isb.names, isb.at_rest(body), strict=True))
    measured = measure(answer(body, np.zeros((1, body.skeleton.coordinates))), joint_set=isb)
    for side in "LR":
        hip, knee, ankle = (rest[f"{side}{joint}"] for joint in ("Hip", "Knee", "Ankle"))
        thigh, shank = ((a - b) / np.linalg.norm(a - b) for a, b in ((hip, knee), (knee, ankle)))
        angles = measured.runs[0].angles[f"{side}Knee"]
        both = np.cos(np.radians([angles["flexion"][0], angles["adduction"][0]])).prod()
        assert both == pytest.approx(thigh @ shank, abs=1e-6)
        assert measured.lengths[f"{side}Hip to {side}Knee"].length == pytest.approx(np.linalg.norm(hip - knee))


def planted_pose(body, joint, upper, lower, relative):
    """A pose in which one joint turns so that its segments' axes differ by a rotation (3, 3), all else in the bind."""
    skeleton = body.skeleton
    number = skeleton.index(SEGMENTS[lower].joint)
    rest = {name: skeleton.frame[skeleton.index(SEGMENTS[name].joint)] @ SEGMENTS[name].axes(body)
            for name in (upper, lower)}  # fmt: skip
    frame = skeleton.frame[number].astype(float)
    own = frame.T @ rest[upper] @ relative @ rest[lower].T @ frame
    pose = np.zeros((1, skeleton.coordinates))
    pose[0, skeleton.angles(joint)] = zyx_angles(own)
    return pose


# Joint, its segments, the order of rotations, and by how much to turn: rotations about the axes that are named, as the
# right side's are, and the angles that must be told.
PLANTED = [
    ("RHip", "pelvis", "R thigh", "zxy", (50, 12, -7), (50, 12, -7)),
    ("RKnee", "R thigh", "R shank", "zxy", (-70, 3, 9), (70, 3, 9)),
    ("RAnkle", "R shank", "R foot", "zxy", (15, -8, 5), (15, -8, 5)),
    ("UpperSpine", "pelvis", "thorax", "zxy", (-30, 10, 20), (30, 10, 20)),
    ("Neck", "thorax", "head", "zxy", (25, -10, 40), (-25, -10, 40)),
    ("RShoulder", "thorax", "R upper arm", "yxy", (60, -80, -25), (60, 80, -25)),
    ("RElbow", "R upper arm", "R forearm", "zxy", (80, 5, 60), (80, 5, 60)),
    ("RWrist", "R forearm", "R hand", "zxy", (30, -15, 4), (30, -15, 4)),
]


@pytest.mark.parametrize(("joint", "upper", "lower", "order", "turned", "told"), PLANTED, ids=lambda each: str(each))
@pytest.mark.parametrize("side", "LR")
def test_three_planted_angles_are_told(joint, upper, lower, order, turned, told, side):
    """On the left the rotation is mirrored: about x and y the other way."""
    sided = lower.startswith("R ")
    if side == "L" and sided:
        joint, upper, lower = "L" + joint[1:], upper.replace("R ", "L "), lower.replace("R ", "L ")
    sign = {"x": -1, "y": -1, "z": 1} if side == "L" and sided else {"x": 1, "y": 1, "z": 1}
    about = [turn(axis, np.radians(sign[axis] * angle)) for axis, angle in zip(order, turned, strict=True)]
    pose = planted_pose(MAN, joint, upper, lower, about[0] @ about[1] @ about[2])
    name = {"UpperSpine": "Trunk"}.get(joint, joint)
    found = [angle[0] for angle in angles_of(MAN, pose)[name].values()]
    np.testing.assert_allclose(found, told, atol=1e-3)


def moved(joint, **turns):
    """The angles of a joint where it alone is turned from the bind pose [degrees]."""
    pose = np.zeros((2, MAN.skeleton.coordinates))
    for axis, angle in turns.items():
        pose[1, MAN.skeleton.angles(joint).start + "xyz".index(axis)] = np.radians(angle)
    name = {"UpperSpine": "Trunk"}.get(joint, joint)
    return {angle: values[1] - values[0] for angle, values in angles_of(MAN, pose)[name].items()}


@pytest.mark.parametrize("side", "LR")
def test_positive_angles_go_the_ways_that_anatomy_names(side):
    """Body axes: x is the left, y up, z forward."""
    out = 1 if side == "L" else -1
    assert moved(f"{side}Hip", x=-30)["flexion"] > 25  # the thigh goes forward
    assert moved(f"{side}Hip", z=20 * out)["adduction"] < -15  # and away from the other one
    assert moved(f"{side}Hip", y=-20 * out)["internal_rotation"] > 15  # toes in
    assert moved(f"{side}Knee", x=40)["flexion"] > 35
    assert moved(f"{side}Ankle", x=-15)["dorsiflexion"] > 10
    assert moved(f"{side}Ankle", z=-15 * out)["inversion"] > 10  # the sole looks to the other foot
    assert moved(f"{side}Elbow", y=-30 * out)["flexion"] > 25
    assert moved("UpperSpine", x=20)["flexion"] > 15
    assert moved("UpperSpine", z=20)["bending_to_the_right"] > 15
    assert moved("Neck", y=20)["rotation_to_the_left"] > 15


def arm(side, direction):
    """Shoulder angles of an arm whose elbow lies in a direction from the shoulder, in body axes."""
    sign = 1.0 if side == "L" else -1.0
    x = sign * np.asarray(direction, float)
    z = np.cross(x, (0.3, 0.5, -0.7))
    z /= np.linalg.norm(z)
    frame = MAN.skeleton.frame[MAN.skeleton.index(f"{side}Shoulder")].astype(float)
    pose = np.zeros((1, MAN.skeleton.coordinates))
    pose[0, MAN.skeleton.angles(f"{side}Shoulder")] = zyx_angles(frame.T @ np.stack([x, np.cross(z, x), z], axis=1))
    return {name: angle[0] for name, angle in angles_of(MAN, pose)[f"{side}Shoulder"].items()}


@pytest.mark.parametrize("side", "LR")
def test_an_arm_is_raised_in_a_plane(side):
    out = 1.0 if side == "L" else -1.0
    sideways, forward, hanging = (arm(side, way) for way in ((out, 0, 0), (0, 0, 1), (0, -1, 0)))
    np.testing.assert_allclose([sideways["elevation"], forward["elevation"]], 90, atol=0.01)
    np.testing.assert_allclose([sideways["plane_of_elevation"], forward["plane_of_elevation"]], [0, 90], atol=0.01)
    assert hanging["elevation"] < 0.01
    assert np.isnan([hanging["plane_of_elevation"], hanging["internal_rotation"]]).all()


def test_a_mirrored_pose_has_the_other_sides_angles():
    """To 0.2 degrees: that is how unlike the two sides of the bodies are."""
    poses = some_poses(MAN)
    angles, other = angles_of(MAN, poses), angles_of(MAN, mirrored(MAN, poses))
    for joint, names in angles.items():
        counterpart = joint if joint in ("Trunk", "Neck") else {"L": "R", "R": "L"}[joint[0]] + joint[1:]
        for name, angle in names.items():
            sign = -1 if name in ("bending_to_the_right", "rotation_to_the_left") else 1
            between = (angle - sign * other[counterpart][name] + 180) % 360 - 180
            assert np.abs(between).max() < 0.2, (joint, name)


@pytest.mark.parametrize(("up", "heading"), [("+z", 0.0), ("-y", 1.0), ("+x", -2.5), ("+y", 3.0)])
def test_angles_do_not_depend_on_the_world(up, heading):
    poses = some_poses(MAN)
    here, there = angles_of(MAN, poses), angles_of(MAN, poses, up=up, heading=heading)
    for joint, names in here.items():
        for name, angle in names.items():
            np.testing.assert_allclose(there[joint][name], angle, atol=2e-4, err_msg=f"{joint} {name}")


def test_angles_go_on_over_half_a_turn():
    """A head that turns round and round, to the left."""
    poses = np.zeros((40, MAN.skeleton.coordinates))
    poses[:, MAN.skeleton.angles("Neck").start + 1] = np.linspace(0, 2 * np.pi, 40)
    np.testing.assert_allclose(
        angles_of(MAN, poses)["Neck"]["rotation_to_the_left"], np.linspace(0, 360, 40), atol=1e-3
    )


def test_a_body_bound_in_another_pose_has_the_same_angles():
    """The boxes' legs are nearly upright in their bind pose, and its arms straight: they count from themselves."""
    body = synthetic_body()
    angles = angles_of(body, np.zeros((1, body.skeleton.coordinates)))
    straight = np.degrees(Leg.of(body, "L").straight)
    np.testing.assert_allclose(angles["LKnee"]["flexion"], -straight, atol=0.01)
    np.testing.assert_allclose(angles["LElbow"]["flexion"], 0, atol=0.01)
    np.testing.assert_allclose(angles["RElbow"]["pronation"], 90, atol=0.01)


@pytest.mark.parametrize("body", [quadruped(), arm_robot()], ids=lambda body: body.name)
def test_what_is_no_person_has_its_own_angles_and_misses_none_of_a_persons(body):
    transforms = np.tile(np.eye(4), (1, len(body.joint_rest), 1, 1))
    assert joint_angles(body, transforms) == {}
    assert joints_left_out(body) == []
    pose = np.random.default_rng(5).uniform(-1, 1, (3, body.skeleton.coordinates))
    measures = measure(answer(body, pose))
    assert measures.left_out == ("centre of mass",)
    assert measures.lengths
    told = measures.shown.angles
    names = [f"{joint}.R{axis}" for joint, angles in told.items() for axis in angles]
    searched = [body.skeleton.coordinate_names[number] for number in body.skeleton.searched()]
    assert names == [name for name in searched if "." in name and not name.startswith(body.skeleton.joints[0])]
    last = body.skeleton.coordinate_names.index(names[-1])
    np.testing.assert_allclose(told[names[-1].split(".")[0]][names[-1][-1]], np.degrees(pose[:, last]))


def test_a_part_of_a_person_says_which_angles_it_has_not():
    """A person without a left foot has all angles but that ankle's."""
    skeleton = load_body("adult_man").skeleton
    renamed = replace(skeleton, joints=tuple("Stump" if j == "LAnkle" else j for j in skeleton.joints), pairs=())
    assert "LAnkle" in joints_left_out(replace(load_body("adult_man"), skeleton=renamed))


HELD = "Ankle inversion, Elbow carrying_angle, Elbow pronation, Knee adduction, Knee internal_rotation, Wrist pronation"


@pytest.mark.parametrize(("dof", "held"), [(51, []), (39, HELD.split(", "))])
def test_an_angle_that_the_model_holds_is_named_and_left_out(dof, held):
    poses = np.where(np.isin(np.arange(MAN.skeleton.coordinates), MAN.skeleton.searched(dof)), some_poses(MAN), 0.0)
    followed = answer(MAN, poses)
    measures = measure(replace(followed, config=followed.config | {"dof": dof}))
    angles = measures.shown.angles
    assert sorted(measures.held) == sorted(f"{side}{name}" for side in "LR" for name in held)
    assert not {f"{joint} {name}" for joint, own in angles.items() for name in own} & set(measures.held)
    assert "flexion" in angles["LElbow"]


def test_own_angles_go_on_over_half_a_turn():
    arm = arm_robot().skeleton
    pose = np.zeros((3, arm.coordinates))
    pose[:, arm.angles("Axis1").start + 1] = np.radians((170, -175, -160))
    np.testing.assert_allclose(own_angles(arm, pose)["Axis1"]["y"], (170, 185, 200))
    assert "Axis6" not in own_angles(replace(arm, sliding=("Axis6",)), pose)  # which is shifted, not turned
