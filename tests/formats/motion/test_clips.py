"""Motion clips: tiny ones made by hand, with places worked out on paper, and real ones where they are at hand."""

from __future__ import annotations

import numpy as np
import pytest
from given_clips import BVH
from person_skeleton import JOINTS

from mmocap_warp.body.rotations import turn
from mmocap_warp.cli import main
from mmocap_warp.errors import InputError
from mmocap_warp.formats.motion.motion_clip import MotionClip, read_bvh
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.study.sequences import clip_sequence
from mmocap_warp.synthesis.exact_posing import ExactPoser, led_by
from mmocap_warp.synthesis.motion.retarget import retargeted
from mmocap_warp.synthesis.walkers import PEOPLE

DIRECTION = 0.03  # between a bone's direction and the clip's: the body's bones and joint axes differ by a degree or two
STRAIGHT = 0.06  # the same of a straight leg, which is bent by 3 degrees
MOST_SLIDE = 0.12  # [m/s], mean, of the standing foot of a retargeted walk

UPRIGHT = {
    "Hips": ("", (0.0, 10.0, 0.0)),
    "LeftUpLeg": ("Hips", (1.0, 0.0, 0.0)),
    "LeftLeg": ("LeftUpLeg", (0.0, -5.0, 0.0)),
    "LeftFoot": ("LeftLeg", (0.0, -4.0, 0.0)),
    "RightUpLeg": ("Hips", (-1.0, 0.0, 0.0)),
    "RightLeg": ("RightUpLeg", (0.0, -5.0, 0.0)),
    "RightFoot": ("RightLeg", (0.0, -4.0, 0.0)),
    "Spine": ("Hips", (0.0, 2.0, 0.0)),
    "Head": ("Spine", (0.0, 4.0, 0.0)),
    "LeftArm": ("Spine", (2.0, 3.0, 0.0)),
    "LeftForeArm": ("LeftArm", (3.0, 0.0, 0.0)),
    "LeftHand": ("LeftForeArm", (2.5, 0.0, 0.0)),
    "RightArm": ("Spine", (-2.0, 3.0, 0.0)),
    "RightForeArm": ("RightArm", (-3.0, 0.0, 0.0)),
    "RightHand": ("RightForeArm", (-2.5, 0.0, 0.0)),
}


@pytest.fixture(scope="module")
def body():
    return PEOPLE["S1"].true_body()


def figure(turned: dict[str, np.ndarray], frames: int = 3, prefix: str = "") -> MotionClip:
    """A figure in a T-pose; each named joint turned by (frame, 3, 3) in its parent's axes."""
    names = list(UPRIGHT)
    rest, place = np.zeros((len(names), 3)), np.zeros((frames, len(names), 3))
    rotation = np.zeros((frames, len(names), 3, 3))
    for j, (name, (parent, offset)) in enumerate(UPRIGHT.items()):
        own = turned.get(name, np.tile(np.eye(3), (frames, 1, 1)))
        if not parent:
            rest[j], place[:, j], rotation[:, j] = offset, offset, own
            continue
        p = names.index(parent)
        rest[j] = rest[p] + offset
        place[:, j] = place[:, p] + np.einsum("fab,b->fa", rotation[:, p], offset)
        rotation[:, j] = rotation[:, p] @ own
    return MotionClip(60.0, tuple(prefix + name for name in names), rest, place, rotation)


def bone(body, poses, start, end):
    """(frame, 3), a unit vector."""
    places = ExactPoser(body, np.eye(3)).joint_transforms(poses)[..., :3, 3]
    away = places[:, JOINTS.index(end)] - places[:, JOINTS.index(start)]
    return away / np.linalg.norm(away, axis=1, keepdims=True)


# Files


def test_bvh_places_and_turns(tmp_path):
    path = tmp_path / "two.bvh"
    path.write_text(BVH)
    clip = read_bvh(path)
    assert clip.joint_names == ("Hips", "Spine")
    assert clip.fps == pytest.approx(20.0)
    np.testing.assert_allclose(clip.rest, [[0, 10, 0], [0, 12, 0]])
    np.testing.assert_allclose(clip.place[0], clip.rest)
    # The root moves and turns by 90 degrees about z, which lays the spine along -x.
    np.testing.assert_allclose(clip.place[1], [[1, 11, 2], [-1, 11, 2]], atol=1e-12)
    np.testing.assert_allclose(clip.rotation[1, 1], turn("z", np.pi / 2) @ turn("x", np.pi / 2), atol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("Frames: 2", "Frames: 3", "3 frames"),
        ("0.05", "0", "0 s"),
        ("Zrotation Yrotation Xrotation\n  JOINT", "Zrotation Wrotation Xrotation\n  JOINT", "line 5.*Wrotation"),
        ("JOINT Spine", "LIMB Spine", "line 6.*LIMB"),
        ("1 11 2 90", "1 11 2 ninety", "not numbers"),
        ("OFFSET 0 2 0", "OFFSET 0 two 0", "line 8.*two"),
        ("MOTION", "", "MOTION"),
        (BVH[BVH.index("MOTION") :], "", "ends before MOTION"),
    ],
)
def test_a_wrong_bvh_says_where(tmp_path, old, new, says):
    path = tmp_path / "wrong.bvh"
    path.write_text(BVH.replace(old, new))
    with pytest.raises(InputError, match=says):
        read_bvh(path)


def test_a_missing_clip_is_named(tmp_path):
    with pytest.raises(InputError, match=r"no\.bvh.*no such file"):
        clip_sequence("S1/Walking", tmp_path / "no.bvh")


def test_resampling_goes_half_way():
    turned = np.stack([turn("y", angle) for angle in (0.0, 0.4, 0.8)])
    clip = figure({"Hips": turned}).at_rate(120.0)
    assert len(clip.place) == 5
    np.testing.assert_allclose(clip.rotation[1, 0], turn("y", 0.2), atol=1e-12)
    np.testing.assert_allclose(figure({}, frames=3).at_rate(30.0).place[:, 0], [[0, 10, 0]] * 2)
    assert len(figure({}, frames=1).at_rate(60.0).place) == 1


# Onto a body


def test_bones_point_where_the_clips_do(body):
    angle = np.radians([0.0, 30.0, 60.0])
    turned = {
        "Hips": turn("y", angle),
        "LeftUpLeg": turn("x", -angle),
        "LeftLeg": turn("x", angle),
        "LeftArm": turn("z", -angle) @ turn("y", 0.2 * angle),
        "LeftForeArm": turn("y", -angle),
        "RightArm": turn("z", angle),
    }
    clip = figure(turned, prefix="mixamorig:")
    poses = retargeted(clip, body, 60.0, "figure")
    plain = [name.removeprefix("mixamorig:") for name in clip.joint_names]
    for ours, theirs in {
        ("LHip", "LKnee"): ("LeftUpLeg", "LeftLeg"),
        ("RHip", "RKnee"): ("RightUpLeg", "RightLeg"),
        ("LShoulder", "LElbow"): ("LeftArm", "LeftForeArm"),
        ("LElbow", "LWrist"): ("LeftForeArm", "LeftHand"),
    }.items():
        start, end = (clip.place[:, plain.index(name)] for name in theirs)
        wanted = (end - start) / np.linalg.norm(end - start, axis=1, keepdims=True)
        atol = DIRECTION if ours[0] != "RHip" else STRAIGHT
        np.testing.assert_allclose(bone(body, poses, *ours)[1:], wanted[1:], atol=atol)
    limits = body.skeleton.limits.reshape(-1, 2)
    assert ((poses[:, 3:] >= limits[:, 0]) & (poses[:, 3:] <= limits[:, 1])).all()


def test_a_figure_that_lies_along_other_axes_moves_alike(body):
    clip = figure({"Hips": turn("y", np.radians([0.0, 20.0, 40.0]))})
    spin = turn("x", np.pi / 2) @ turn("y", np.pi / 2)
    other = MotionClip(60.0, clip.joint_names, clip.rest @ spin.T, clip.place @ spin.T, spin @ clip.rotation @ spin.T)
    np.testing.assert_allclose(
        retargeted(other, body, 60.0, "figure"), retargeted(clip, body, 60.0, "figure"), atol=1e-9
    )


def test_a_clip_at_any_height_stands_on_the_floor(body):
    clip = figure({"LeftUpLeg": turn("x", np.radians([0.0, -20.0, -40.0]))})

    def raised(by: float) -> MotionClip:
        place = clip.place + by * np.array([0.0, 1.0, 0.0])
        return MotionClip(60.0, clip.joint_names, clip.rest, place, clip.rotation)

    low, high = (retargeted(raised(by), body, 60.0, "figure") for by in (0.0, 5.0))
    np.testing.assert_allclose(high, low, atol=1e-9)
    soles = ExactPoser(body, np.eye(3)).vertices(high)[..., 1].min(axis=1)
    np.testing.assert_allclose(soles, 0.0, atol=1e-3)


def test_only_what_the_cameras_see_is_kept(body):
    clip = figure({}, frames=101)
    walked = clip.place + np.linspace(0, 90, 101)[:, None, None] * (0.0, 0.0, 1.0)  # 9 units are a leg, about 0.9 m
    clip = MotionClip(60.0, clip.joint_names, clip.rest, walked, clip.rotation)
    poses = retargeted(clip, body, 60.0, "figure")
    assert np.ptp(poses[:, 2]) == pytest.approx(2.6, abs=0.2)
    assert np.abs(poses[[0, -1], 2]).max() < 1.4


def test_a_skeleton_that_is_not_understood_is_named(body):
    clip = figure({})
    names = tuple(name.replace("LeftLeg", "Bone7") for name in clip.joint_names)
    with pytest.raises(InputError, match=r"Knee.*leftleg"):
        retargeted(MotionClip(60.0, names, clip.rest, clip.place, clip.rotation), body, 60.0, "figure")
    lying = clip.rest @ turn("z", np.pi / 4).T @ np.diag([1.0, 0.0, 1.0])
    with pytest.raises(InputError, match="upright"):
        retargeted(MotionClip(60.0, clip.joint_names, lying, clip.place, clip.rotation), body, 60.0, "figure")


def test_a_real_walk_walks(shared_data):
    clip = shared_data / "cmu_mocap" / "12_01_walk.bvh"
    if not clip.exists():
        pytest.skip("needs 12_01_walk.bvh, which is not part of the project")
    sequence = clip_sequence("S1/Walking", clip)
    assert sequence.frame_count > 100
    recording = sequence.recording
    vertices = np.stack([recording.vertices(f) for f in range(sequence.frame_count)])
    slide = []
    for side in "LR":
        foot = vertices[:, led_by(recording.body, f"{side}Ankle")]
        low, frame = foot[:-1, :, 2].argmin(axis=1), np.arange(len(foot) - 1)
        slide.append(np.linalg.norm((foot[frame + 1, low] - foot[frame, low])[:, :2], axis=1) * 60)
    assert np.min(slide, axis=0).mean() < MOST_SLIDE
    assert np.abs(vertices[..., 2].min(axis=1)).max() < 0.04
    assert all(observation.any() for observation in [sequence.observation(f).foreground for f in (0, 50, 100)])


def test_a_clip_becomes_a_scene(shared_data, tmp_path):
    clip = shared_data / "cmu_mocap" / "12_01_walk.bvh"
    if not clip.exists():
        pytest.skip("needs 12_01_walk.bvh, which is not part of the project")
    argv = ["study", "make", str(tmp_path / "made"), "--sequence", "S2/Box", "--clip", str(clip), "--frames", "2"]
    assert main([*argv, "--quiet"]) == 0
    assert load_scene(tmp_path / "made" / "S2" / "Box").frame_count == 2
