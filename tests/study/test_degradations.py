"""Clips made worse: what changes is what is said, and nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mmocap_warp.cameras.rig import check_rig
from mmocap_warp.cli import main
from mmocap_warp.formats.truth_file import load_truth
from mmocap_warp.masks.observation import unpack_masks
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.study.degradations import degraded, most_different_views, parse
from mmocap_warp.study.sequences import CLIP_PLANS, CLIPS, PLANS, make_sequence, study_rig
from mmocap_warp.study.source import open_sequence
from mmocap_warp.synthesis.bystanders import PasserBy, furniture

FRAMES = 34


@pytest.fixture(scope="module")
def sequence():
    return make_sequence("S1/Box", replace(PLANS["S1/Box"], frames=FRAMES))


@pytest.fixture(scope="module")
def clip(sequence):
    """The sequence, made once; its masks are a list."""
    opened = open_sequence(sequence)
    return replace(opened, observations=list(opened.observations))


@pytest.fixture(scope="module")
def whole(clip):
    """(frame, camera, height, width) bool."""
    return masks_of(clip)


def masks_of(clip):
    return np.array([unpack_masks(seen.words, clip.rig.size) for seen in clip.observations])


def worse(clip, text, seed=0):
    """The clip made worse, and its masks."""
    changed = degraded(replace(clip, observations=iter(clip.observations)), text, seed)
    masks = masks_of(changed)
    assert len(masks) == changed.frames
    return changed, masks


def test_nothing_is_changed_by_none(clip, whole):
    changed, masks = worse(clip, "none")
    assert changed.rig.names == clip.rig.names
    np.testing.assert_array_equal(masks, whole)


def test_fewer_views_are_different_ones_and_their_masks_are_kept(clip, whole):
    changed, masks = worse(clip, "views=3")
    k = [clip.rig.names.index(name) for name in changed.rig.names]
    assert len(k) == 3
    np.testing.assert_array_equal(masks, whole[:, k])
    np.testing.assert_array_equal(changed.rig.K, clip.rig.K[k])
    ahead = changed.rig.R[:, 2]
    assert np.abs(ahead @ ahead.T - np.eye(3)).max() < np.cos(np.radians(35))


def test_two_views_are_square_on_each_other_not_opposite():
    rig = study_rig()
    a, b = rig.R[list(most_different_views(rig, 2)), 2]
    assert abs(a @ b) < np.cos(np.radians(75))
    assert most_different_views(rig, 7) == tuple(range(7))
    with pytest.raises(ValueError, match="1 to 7, got 8"):
        most_different_views(rig, 8)


@pytest.mark.parametrize(("fps", "step"), [(60, 1), (30, 2), (15, 4)])
def test_fewer_frames_are_numbered_anew_with_their_truth(clip, whole, fps, step):
    changed, masks = worse(clip, f"fps={fps}")
    assert (changed.fps, changed.truth.fps) == (fps, fps)
    np.testing.assert_array_equal(masks, whole[::step])
    np.testing.assert_array_equal(changed.truth.frame_numbers, np.arange(len(masks)))
    np.testing.assert_array_equal(changed.truth.joints, clip.truth.joints[::step])
    np.testing.assert_array_equal(changed.truth.pose, clip.truth.pose[::step])


def test_a_wrong_calibration_is_as_wrong_as_it_says_and_of_its_seed(clip, whole):
    changed, masks = worse(clip, "calibration=10", 1)
    shift = changed.rig.K[:, :2, 2] - clip.rig.K[:, :2, 2]
    np.testing.assert_allclose(np.linalg.norm(shift, axis=1), 10.0)
    np.testing.assert_array_equal(masks, whole)
    np.testing.assert_array_equal(worse(clip, "calibration=10", 1)[0].rig.K, changed.rig.K)
    assert np.abs(worse(clip, "calibration=10", 2)[0].rig.K - changed.rig.K).max() > 1
    check_rig(changed.rig, "worse")


def test_bystanders_are_added_to_the_masks_and_keep_their_distance(clip, whole):
    _, passed = worse(clip, "passer-by")
    _, furnished = worse(clip, "furniture")
    for masks in (passed, furnished):
        assert not (whole & ~masks).any()
    added = furnished & ~whole
    stands = (furnished[0] | furnished[-1]) & ~(whole[0] | whole[-1])
    assert (stands.sum(axis=(1, 2)) > 300).sum() >= 5  # seen beside the person by most cameras
    assert not (added[0] & ~furnished[-1]).any()  # and does not move
    both = (passed[0] & ~whole[0]) & (passed[-1] & ~whole[-1])
    moves = passed[0] & ~whole[0]
    assert both.sum() < 0.8 * moves.sum()


def test_who_walks_by_is_gone_before_and_after():
    rig = study_rig()
    other = PasserBy(rig, np.zeros(3), 1.2)
    assert sum(mask.any() for mask in other.silhouettes(0.0)) >= 6
    assert not any(mask.any() for time in (-6.0, 6.0) for mask in other.silhouettes(time))


def test_what_is_behind_a_camera_is_not_seen():
    rig = study_rig()
    beside = rig.centres[0] * (1.0, 1.0, 0.0)
    assert not furniture(rig, beside, 0.0)[0][0].any()


@pytest.mark.parametrize(("text", "views"), [("cut=2", 2), ("cut=all", 7)])
def test_a_block_is_cut_out_of_some_views_for_half_a_second(clip, whole, text, views):
    _, masks = worse(clip, text)
    assert not (masks & ~whole).any()
    missing = (whole & ~masks).any(axis=(2, 3))  # (frame, camera)
    first, last = FRAMES // 2 - 15, FRAMES // 2 + 15
    seen = whole.any(axis=(2, 3))
    assert (missing[first:last, :views] == seen[first:last, :views]).all()
    assert not missing[:first].any()
    assert not missing[last:].any()
    assert not missing[:, views:].any()
    share = (whole & ~masks)[first:last, :views].sum() / whole[first:last, :views].sum()
    assert 0.4 < share < 0.95


@pytest.mark.parametrize(
    "text",
    [*(pytest.param(way, marks=pytest.mark.nightly) for way in ("cut=all", "furniture", "passer-by")), "cut=2+views=3"],
)
def test_what_is_labelled_is_no_foreground_but_may_hide(clip, whole, text):
    """Where the same without labels changes the masks, labels say so; what is nearer than the person takes pixels."""
    plain, _ = worse(clip, text)
    changed = degraded(replace(clip, observations=iter(clip.observations)), f"{text}+labelled", 0)
    chosen = [clip.rig.names.index(name) for name in plain.rig.names]
    seen = list(changed.observations)
    own = np.array([unpack_masks(each.words, changed.rig.size) for each in seen])
    none = np.zeros_like(own[0])
    hidden = np.array([none if each.hidden is None else each.unpacked_hidden(changed.rig.size) for each in seen])
    unlabelled = worse(clip, text)[1]
    before = whole[:, chosen]
    assert not (own & ~before).any()
    assert not (own & hidden).any()
    near = hidden.any(axis=(2, 3))  # elsewhere it is too far from the person to hide anything
    lost = before & ~own & ~hidden
    assert not lost[near].any()
    assert lost[own.any(axis=(2, 3))].sum(axis=(1, 2)).max() < 100  # specks of the masks, or all that a view shows
    assert not ((unlabelled ^ before) & ~hidden)[near].any()
    assert hidden.any()


def test_people_together_hide_one_another_and_keep_apart(tmp_path):
    folder = tmp_path / "two"
    flags = ["--sequence", "S1/Walking", "--sequence", "S2/Walking", "--together", "--frames", "2"]
    assert main(["study", "make", str(folder), *flags]) == 0
    scene = load_scene(folder)
    places = []
    for name in ("S1", "S2"):
        of_one = scene.of_person(name)
        truth = load_truth(of_one.truth)
        places.append(truth.joints[:, 0, :2])
        seen = next(iter(of_one.observations()))
        assert (seen.foreground > 500).all()
        joints = truth.joints[0] @ scene.calibrated.R[0].T + scene.calibrated.t[0]
        pixels = np.rint((joints @ scene.calibrated.K[0].T)[:, :2] / joints[:, 2:]).astype(int)
        shown = unpack_masks(seen.possible, scene.calibrated.size)[0]
        assert shown[pixels[:, 1].clip(0, 479), pixels[:, 0].clip(0, 639)].mean() > 0.8
    assert np.linalg.norm(places[0] - places[1], axis=1).min() >= 0.69
    assert main(["study", "make", str(folder), *flags[:2], "--together", "--force"]) == 2
    assert main(["study", "make", str(tmp_path / "hold"), *flags, "--apart", "0.4"]) == 0
    joints = [load_truth(tmp_path / "hold" / f"{name}.truth.usdc").joints[:, 0, :2] for name in ("S1", "S2")]
    assert 0.39 <= np.linalg.norm(joints[0] - joints[1], axis=1).min() <= 0.5
    assert main(["study", "make", str(tmp_path / "far"), *flags, "--apart", "-1"]) == 2
    alone = ["study", "make", str(tmp_path / "far"), "--sequence", "S1/Box", "--apart", "0.4"]
    assert main(alone) == 2  # of one


def test_several_are_done_in_one_order(clip):
    a, ours = worse(clip, "views=2+fps=15+calibration=2+cut=1")
    b, theirs = worse(clip, "calibration=2+cut=1+fps=15+views=2")
    np.testing.assert_array_equal(ours, theirs)
    np.testing.assert_array_equal(a.rig.K, b.rig.K)
    assert (a.frames, len(a.rig), a.fps) == (9, 2, 15)


@pytest.mark.parametrize("text", ["", "fog", "views", "views=x", "furniture=2", "fps=0", "views=all", "cut=1+cut=2"])
def test_what_is_no_degradation_is_said(text):
    with pytest.raises(ValueError, match="degradation"):
        parse(text)


@pytest.mark.parametrize("amount", ["inf", "1e999", "nan", "-1"])
@pytest.mark.parametrize("name", ["fps", "views", "cut", "calibration"])
def test_amounts_are_finite(name, amount):
    with pytest.raises(ValueError, match=f"degradation {name} must be above zero and finite, got {amount}"):
        parse(f"{name}={amount}")


def test_a_rate_that_does_not_divide_is_said(sequence):
    with pytest.raises(ValueError, match="must divide the clip's 60, got 25"):
        degraded(open_sequence(sequence), "fps=25", 0)


def test_make_writes_what_a_tracker_is_given(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(CLIP_PLANS, "S2/Box", replace(PLANS["S2/Box"], frames=9))
    flags = ["--sequence", "S2/Box", "--degrade", "views=2+fps=15+calibration=2", "--seed", "3"]
    assert main(["study", "make", str(tmp_path / "made"), *flags, "--quiet"]) == 0
    scene = load_scene(tmp_path / "made" / "S2" / "Box" / "scene.toml")
    clip = degraded(open_sequence(CLIPS["S2/Box"]), flags[3], 3)
    assert (scene.fps, scene.frame_count, len(scene.cameras)) == (15, 3, 2)
    np.testing.assert_allclose(scene.calibrated.K, clip.rig.K, atol=1e-9)
    for ours, theirs in zip(scene.observations(), clip.observations, strict=True):
        np.testing.assert_array_equal(ours.words, theirs.words)
    np.testing.assert_allclose(load_truth(scene.truth).joints, clip.truth.joints, atol=1e-6)


@pytest.mark.parametrize(
    "text", ["fog", "fps=25", "fps=1e-300", "fps=1e-320", "views=8", "views=inf", "calibration=inf"]
)
def test_make_says_which_degradation_is_wrong(tmp_path, monkeypatch, capsys, text):
    monkeypatch.setitem(CLIP_PLANS, "S2/Box", replace(PLANS["S2/Box"], frames=2))
    flags = ["--sequence", "S2/Box", "--degrade", text]
    assert main(["study", "make", str(tmp_path / "made"), *flags, "--quiet"]) == 2
    assert "--degrade" in capsys.readouterr().err
