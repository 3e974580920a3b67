"""The made-up recording: feet that stand, angles as published, masks that agree with the tracker's renderer."""

from dataclasses import replace

import cv2
import gait_curves
import numpy as np
import pytest
import warp as wp
from drawn import cast_bits
from made_walks import Walk, hanging_arm, lean
from person_skeleton import JOINTS
from standing_posture import Sole
from synthetic import COORDINATES
from walk_scene import FRAMES, walking, write_walk

from mmocap_warp.body.model import Subject, joint_transforms
from mmocap_warp.body.rotations import turn, zyx_angles
from mmocap_warp.cameras.rig import check_rig, project
from mmocap_warp.formats.truth_file import load_truth
from mmocap_warp.formats.usd.usd_body import read_body
from mmocap_warp.masks.observation import Observation, unpack_masks
from mmocap_warp.result.marker_errors import triangulated
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.scenes import ROOT
from mmocap_warp.silhouettes.objective import Objective
from mmocap_warp.synthesis.exact_posing import led_by
from mmocap_warp.synthesis.footage.faults import Faults, draw_silhouettes, spoil
from mmocap_warp.synthesis.motion.limb_motion import Leg
from mmocap_warp.synthesis.writing import FAULTY_MASKS, write_made_scene

MOST_SLIDE = 1e-3  # [m] between two frames, of the point that a foot stands on
FLOOR = 1e-4  # [m]
BOUNDARY = 0.005  # share of the silhouette that two renderers may see differently
POSITION = 1e-5  # [m], single precision


@pytest.fixture(scope="module")
def recording():
    return walking()


@pytest.fixture(scope="module")
def phase():
    """Of the left leg, in the recording's frames."""
    return gait_curves.CADENCE / 120.0 / 60.0 * (np.arange(FRAMES) - (FRAMES - 1) / 2)


@pytest.fixture(scope="module")
def vertices(recording):
    """(frame, vertex, 3)."""
    return np.stack([recording.vertices(frame) for frame in range(FRAMES)])


def angles(pose, joint):
    first = 3 + 3 * JOINTS.index(joint)
    return pose[:, first : first + 3]


def iou(a, b):
    return (a & b).sum() / (a | b).sum()


# The walk


def on_the_floor(side, phase):
    """Whether a foot stands at phases of the left leg: the right one is half a stride ahead."""
    return np.mod(phase + 0.5 * (side == "R"), 1.0) <= gait_curves.TOE_OFF


@pytest.mark.parametrize("side", "LR")
def test_a_standing_foot_does_not_slide(recording, vertices, phase, side):
    foot = vertices[:, led_by(recording.body, f"{side}Ankle")]
    lowest = foot[..., 2].argmin(axis=1)
    stands = on_the_floor(side, phase)
    pairs = np.flatnonzero(stands[:-1] & stands[1:])
    assert len(pairs) > FRAMES / 2
    for i in pairs:  # what touches the floor in either frame stays where it is until the other
        moved = [np.linalg.norm(foot[i + 1, v] - foot[i, v]) for v in (lowest[i], lowest[i + 1])]
        assert min(moved) < MOST_SLIDE


def test_feet_are_on_the_floor_and_never_below(recording, vertices, phase):
    assert (on_the_floor("L", phase) | on_the_floor("R", phase)).all()
    assert np.abs(vertices[..., 2].min(axis=1)).max() < FLOOR


def test_joint_limits_hold(recording):
    limits = recording.body.skeleton.limits.reshape(-1, 2)
    assert (recording.poses[:, 3:] >= limits[:, 0]).all()
    assert (recording.poses[:, 3:] <= limits[:, 1]).all()


@pytest.mark.parametrize("side", "LR")
def test_legs_move_as_published(recording, side):
    """Within what separates people: about 7 degrees of standard deviation at hip and knee (Winter, 2009)."""
    own = np.linspace(0.0, 1.0, 101)
    pose = Walk(recording.body).poses(own - (0.5 if side == "R" else 0.0))
    leg = Leg.of(recording.body, side)
    hip, knee = lean(leg) - angles(pose, f"{side}Hip")[:, 0], angles(pose, f"{side}Knee")[:, 0] - leg.straight
    for found, published in ((hip, gait_curves.hip_flexion(own)), (knee, gait_curves.knee_flexion(own))):
        assert np.degrees(np.sqrt(np.mean((found - published) ** 2))) < 10.0
        assert np.corrcoef(found, published)[0, 1] > 0.87
    assert 50 < np.degrees(knee.max()) < 70


def test_a_cycle_closes(recording):
    """After a cycle the body is as before, turned about the circle's middle."""
    walk = Walk(recording.body)
    before, after = walk.poses(np.array([0.3, 1.3]))
    np.testing.assert_allclose(after[6:], before[6:], atol=1e-9)
    turned = walk.stride / walk.radius
    centre = np.array([walk.radius, 0.0, 0.0])
    np.testing.assert_allclose(after[:3], turn("y", turned) @ (before[:3] - centre) + centre, atol=1e-9)


def test_motion_is_smooth(recording):
    joints = recording.truth().joints
    assert np.linalg.norm(np.diff(joints, axis=0), axis=-1).max() < 0.09  # a swinging foot at 5 m/s
    assert np.linalg.norm(np.diff(joints, 2, axis=0), axis=-1).max() < 0.02


def test_the_pelvis_goes_along_the_circle(recording, phase):
    walk = Walk(recording.body)
    root = walk.poses(phase)[:, :3]
    distance = np.hypot(root[:, 0] - walk.radius, root[:, 2])
    assert np.abs(distance - walk.radius).max() < 0.021  # its sway
    assert np.ptp(root[:, 1]) < 0.05


# Its parts


def test_euler_angles_come_back():
    wanted = np.random.default_rng(0).uniform(-1.2, 1.2, (50, 3))
    x, y, z = wanted.T
    np.testing.assert_allclose(zyx_angles(turn("z", z) @ turn("y", y) @ turn("x", x)), wanted, atol=1e-12)


def test_a_leg_reaches_where_it_is_told(recording):
    leg = Leg.of(recording.body, "L")
    hip, ankle = np.zeros((1, 3)), np.array([[0.05, -0.8, 0.12]])
    pelvis = turn("y", np.array([0.2]))
    solved = leg.angles(hip, ankle, pelvis, np.eye(3)[:1])
    x, y, z, knee = solved[0]
    thigh = pelvis[0] @ turn("z", z) @ turn("y", y) @ turn("x", x)
    np.testing.assert_allclose(thigh @ (leg.thigh + turn("x", knee) @ leg.shank), ankle[0], atol=1e-12)
    assert knee > leg.straight
    with pytest.raises(ValueError, match="from its hip"):
        leg.angles(hip, 2 * ankle, pelvis, np.eye(3)[:1])


@pytest.mark.parametrize("side", "LR")
def test_a_hanging_arm_hangs(recording, side):
    body = recording.body
    pose = np.zeros((1, COORDINATES))
    zero = np.zeros(1)
    for joint, found in zip(("Shoulder", "Elbow"), hanging_arm(body, side, zero, zero + 0.5, 0.0, 0.0), strict=True):
        angles(pose, side + joint)[:] = found
    _, (world,) = joint_transforms(Subject(body, np.eye(3), pose[0], {}), pose)
    shoulder, elbow, wrist = (world[JOINTS.index(side + name)][:3, 3] for name in ("Shoulder", "Elbow", "Wrist"))
    upper, fore = elbow - shoulder, wrist - elbow
    # Bones and joint axes differ by up to 2 degrees, because the body was reshaped after they were set.
    np.testing.assert_allclose(upper / np.linalg.norm(upper), (0, -1, 0), atol=0.05)
    np.testing.assert_allclose(fore / np.linalg.norm(fore), (0, -np.cos(0.5), np.sin(0.5)), atol=0.05)


def test_a_sole_rolls_without_sliding(recording):
    sole = Sole.of(recording.body, "L")
    forward, up = sole.ankle(np.array([0.0]))
    np.testing.assert_allclose(
        (forward[0], up[0]), (0.0, recording.body.joint_rest[JOINTS.index("LAnkle"), 1]), atol=1e-3
    )
    # Rolled onto the heel the ankle is behind where it was, onto the toes in front; arc lengths join the two.
    heel, toes = sole.ankle(np.radians([25.0, -40.0]))[0]
    assert heel < 0 < toes


# Cameras and masks


def test_cameras_are_a_calibration_and_see_all_of_the_walk(recording, vertices):
    rig = check_rig(recording.rig, "walk")
    assert len(rig) >= 4
    assert np.abs(rig.distortion).max() > 0.1
    for posed in vertices[::9]:
        pixel = project(rig, posed)
        assert (pixel > 10).all()
        assert (pixel < np.asarray(rig.size)[:, None] - 10).all()
        height = np.ptp(pixel[..., 1], axis=1)
        assert ((height > 220) & (height < 320)).all()


def test_silhouettes_equal_the_ray_caster_up_to_the_boundary(recording):
    rig, vertices, faces = recording.rig.undistorted(), recording.vertices(20), recording.body.skin.face
    posed = wp.array(vertices[None], dtype=wp.vec3, device="cpu")
    cast = cast_bits(triangulated(faces), rig, posed)
    drawn = draw_silhouettes(rig, vertices, faces)
    for by_rays, by_polygons in zip(unpack_masks(cast[0], rig.size), drawn, strict=True):
        differs = by_rays ^ by_polygons
        assert differs.sum() < BOUNDARY * by_rays.sum()
        kernel = np.ones((3, 3), np.uint8)
        seen = by_rays.astype(np.uint8)
        boundary = cv2.dilate(seen, kernel) != cv2.erode(seen, kernel)
        assert not (differs & ~boundary).any()


def test_the_objective_sees_the_true_body_in_perfect_masks(recording):
    """The tracking mesh at the true pose, against the full mesh drawn by OpenCV."""
    rig, frame = recording.rig.undistorted(), 40
    objective = Objective(recording.body, recording.root_base, rig, 1, device="cpu")
    masks = draw_silhouettes(rig, recording.vertices(frame), recording.body.skin.face)
    objective.observe(Observation.from_masks(masks))
    objective.pose.assign(recording.poses[frame][None].astype(np.float32))
    cost = objective.evaluate(1).numpy()[0]
    assert cost < 0.02  # what decimating the mesh costs


def test_undistorted_masks_are_the_pinhole_silhouettes(recording, tmp_path):
    """Perfect masks through the lens, undistorted as scenes are, against the same body through the pinhole."""
    faultless = replace(recording.segmentation, faults=(Faults(),) * len(recording.rig))
    perfect = replace(recording.first(1), segmentation=faultless)
    path = write_walk(tmp_path / "perfect", perfect)
    scene = path.read_text()
    path.write_text(scene[: scene.index("# The masks have")])  # no clean-up
    scene = load_scene(path)
    drawn = draw_silhouettes(scene.rig(), perfect.vertices(0), perfect.body.skin.face)
    for mask, expected in zip(next(scene.masks()), drawn, strict=True):
        assert iou(mask, expected) > 0.97  # the contour of a 1-bit mask is good to half a pixel


def test_faults_keep_most_of_a_mask(recording):
    for frame in (0, 30):
        perfect = recording.segmentation.silhouettes(recording.rig, recording.vertices(frame))
        overlap = [iou(*pair) for pair in zip(perfect, recording.masks(frame), strict=True)]
        assert min(overlap) > 0.88
        assert max(overlap) < 0.98


def test_a_contour_grows_by_what_it_is_told():
    mask = np.zeros((80, 80), bool)
    mask[20:60, 20:60] = True
    none = np.zeros_like(mask)
    rng = np.random.default_rng(0)
    np.testing.assert_array_equal(spoil(mask, none, Faults(), rng), mask)
    spread = spoil(mask, none, Faults(grow=2.0), rng)
    assert spread[40, 18]
    assert not spread[40, 17]


# The scene


def test_writing_twice_gives_the_same_bytes(tmp_path):
    first, second = (write_walk(tmp_path / name / "walk", walking(frames=3)).parent for name in "ab")
    names = sorted(path.relative_to(first) for path in first.rglob("*") if path.suffix in (".png", ".toml"))
    assert len(names) == 3 * 5 + 2
    for name in names:
        assert (first / name).read_bytes() == (second / name).read_bytes()


def test_a_longer_scene_leaves_no_masks_in_a_shorter_one(tmp_path):
    for frames in (4, 2):
        assert load_scene(write_walk(tmp_path, walking(frames=frames))).frame_count == frames


def test_any_name_and_words_about_it_are_written_as_toml(tmp_path):
    said = {"name": 'a "b"\\', "about": "by\nsomebody", "foreground": FAULTY_MASKS}
    assert load_scene(write_made_scene(tmp_path, walking(frames=1), None, **said)).name == said["name"]


def test_another_seed_gives_other_faults(recording):
    other = walking(seed=1)
    for a, b in zip(other.masks(0), recording.masks(0), strict=True):
        assert 0.8 < iou(a, b) < 1.0


def test_the_shipped_scene_is_this_recording(recording):
    scene = load_scene(ROOT / "walk")
    assert (scene.frame_count, scene.fps, scene.subject) == (FRAMES, recording.fps, None)
    np.testing.assert_allclose(scene.calibrated.centres, recording.rig.centres, atol=1e-9)
    truth, made = load_truth(scene.truth), recording.truth()
    assert truth.marker_names == made.marker_names
    np.testing.assert_allclose(truth.markers, made.markers, atol=POSITION)
    np.testing.assert_allclose(truth.joints, made.joints, atol=POSITION)
    np.testing.assert_allclose(truth.pose, made.pose, atol=1e-12)
    np.testing.assert_allclose(truth.root_base, made.root_base, atol=1e-12)
    for source, mask in zip(scene.cameras, recording.masks(7), strict=True):
        shipped = cv2.imread(str(source.masks.path / "0007.png"), cv2.IMREAD_UNCHANGED) > 0
        assert iou(shipped, mask) > 0.999
    assert sum(path.stat().st_size for path in (ROOT / "walk").rglob("*") if path.is_file()) < 1_500_000


def test_the_walker_is_not_the_tracker(recording):
    man = read_body(ROOT / "bodies" / "adult_man.usdc")
    assert abs(np.ptp(man.skin.rest[:, 1]) - np.ptp(recording.body.skin.rest[:, 1])) > 0.03
