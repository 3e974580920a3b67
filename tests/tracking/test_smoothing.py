"""A track smoothed: nearer to the truth, honest about what it filled in, and the same bits however it was run."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from random_scenes import perfect_masks
from swinging import CONFIG, FPS, FRAMES, RIG, SUBJECT, hidden, joint_errors, rough_track, swinging
from synthetic import SKELETON, ring_rig

from mmocap_warp.body.model import Subject
from mmocap_warp.body.posing import joint_positions
from mmocap_warp.body.shape_space import upright_base
from mmocap_warp.contour.clip import clip_problem as clip
from mmocap_warp.masks.observation import Observation, unpack_masks
from mmocap_warp.result.result import STATUS, FrameAnswer
from mmocap_warp.rigging.shipped import load_body
from mmocap_warp.tracking import smoothing
from mmocap_warp.tracking.algorithms import ALGORITHMS
from mmocap_warp.tracking.frame_loop import collect, track_observations
from mmocap_warp.tracking.pose_search import PoseSearch
from mmocap_warp.tracking.smoothing import smoothed
from mmocap_warp.tracking.track_config import TrackConfig


def test_the_clip_is_nearer_the_truth_than_its_frames():
    raw = rough_track()
    result = smoothed(raw, CONFIG, swinging()[1])
    assert joint_errors(result.pose[0]).mean() < 0.4 * joint_errors(raw.pose[0]).mean()
    np.testing.assert_array_equal(result.raw_pose, raw.pose)
    off = result.joints()[0] - joint_positions(SUBJECT, swinging()[0])
    assert (np.abs(off) <= 2 * result.joint_sigma[0]).mean() > 0.9
    assert (result.status == raw.status).all()
    searched = SKELETON.searched()
    assert (result.angle_sigma[..., searched] > 0).all()
    assert not np.delete(result.angle_sigma, searched, axis=2).any()
    assert (result.joint_sigma > 0).all()


def test_learnt_factors_stretch_deviations_and_the_roots_are_those_of_its_joint(monkeypatch):
    """A coordinate's by its own factor, up to how wide anything can be; the root's place is that of the root joint."""
    raw, joints, coordinates = rough_track(), len(SKELETON.joints), SKELETON.coordinates
    raw.pose[0] = swinging()[0]
    factors, stated = SimpleNamespace(joint=np.ones((joints, 3)), coordinate=np.full(coordinates, 3.0)), []
    combine = smoothing.uncertainty.combine

    def combined(*given):
        sigma = combine(*given)
        stated.append(sigma.pose.copy())
        return sigma

    monkeypatch.setattr(smoothing, "deviation_factors", lambda *_: factors)
    monkeypatch.setattr(smoothing.uncertainty, "combine", combined)
    result = smoothed(raw, CONFIG, swinging()[1])
    np.testing.assert_allclose(result.angle_sigma[0, :, :3], result.joint_sigma[0, :, 0], rtol=1e-5)
    angles = SKELETON.searched()[3:]
    before, after = np.concatenate(stated)[:, angles], result.angle_sigma[0][:, angles]
    known = before < 0.1  # far from as wide as limits are
    assert known.mean() > 0.5
    np.testing.assert_allclose(after[known], 3 * before[known], rtol=1e-5)
    assert (after <= 3.00001 * before).all()


def test_an_arm_that_later_frames_know_better_is_found(monkeypatch):
    raw = rough_track()
    folded, elbow = slice(9, 16), SKELETON.angles("LElbow")
    raw.pose[0] = swinging()[0]
    raw.pose[0, folded, elbow] += np.linspace(0.4, 1.4, 7)[:, None] * (0.0, 0.0, 1.0)
    wrist = SKELETON.index("LWrist")
    assert joint_errors(raw.pose[0])[folded, wrist].max() > 0.2
    found = smoothed(raw, CONFIG, swinging()[1])
    assert joint_errors(found.pose[0])[:, wrist].max() < 0.12
    assert (found.status == raw.status).all()
    monkeypatch.setattr(smoothing, "BackwardPass", lambda *_: None)
    assert joint_errors(smoothed(raw, CONFIG, swinging()[1]).pose[0])[:, wrist].max() > 0.15


def test_arms_that_are_crossed_in_all_frames_are_uncrossed():
    """Nothing in the track knows better, but arms that are looked for from rest leave less of the masks uncovered."""
    man = load_body("adult_man")
    skeleton, rig = man.skeleton, ring_rig(cameras=4, size=(320, 240), distance=3.5)
    truth = np.zeros((12, skeleton.coordinates))
    truth[:, 1] = 1.0
    swing = 0.1 * np.sin(np.arange(12) / 3)
    for joint, angles in {"LShoulder": (0.2, -0.1, -0.6), "RShoulder": (0.1, -0.4, 0.5), "RElbow": (0, 0.3, 0)}.items():
        truth[:, skeleton.angles(joint)] = angles
    truth[:, skeleton.angles("LShoulder").start] += swing
    crossed = truth.copy()
    for joint, angles in {"LShoulder": (-1.2, 0.4, -2.0), "RShoulder": (-1.5, -0.1, 2.2), "RElbow": (0, 0, 0)}.items():
        crossed[:, skeleton.angles(joint)] = angles
    subject = Subject(man, upright_base("+y"), crossed[0], {})
    seen = [Observation.from_masks(list(perfect_masks(subject, rig, pose))) for pose in truth]
    answers = [
        FrameAnswer(pose[None], np.zeros(1), np.full((1, len(rig)), 0.8), 1, STATUS.index("tracked"), 0.0)
        for pose in crossed
    ]
    found = smoothed(collect(subject, rig, FPS, CONFIG, answers), CONFIG, seen)
    wrists = [skeleton.index("LWrist"), skeleton.index("RWrist")]
    away = np.linalg.norm(joint_positions(subject, found.pose[0]) - joint_positions(subject, truth), axis=-1)[:, wrists]
    assert away.max() < 0.05


def test_cost_and_overlap_are_those_of_the_answer():
    result = smoothed(rough_track(), CONFIG, swinging()[1])
    search = PoseSearch(SUBJECT, RIG, replace(CONFIG, evaluations=1, runs=1), ALGORITHMS["cmaes"], FPS)
    for frame in (0, 11, FRAMES - 1):
        observation = swinging()[1][frame]
        search.objective.observe(observation)
        search.best_pose.assign(result.pose[:, frame].astype(np.float32))
        count = search.judge()[0].astype(float)
        union = count[:, 0] + observation.foreground - count[:, 1]
        np.testing.assert_allclose(result.iou[0, frame], count[:, 1] / union)
        assert result.cost[0, frame] == search.best_cost.numpy()[0]
    assert result.iou.mean() > 0.9


def test_lost_frames_are_filled_from_both_sides_and_say_so():
    lost = (0, 9, 10, 11, FRAMES - 1)
    result = smoothed(rough_track(lost=lost), CONFIG, hidden(swinging()[1], lost))
    status = [STATUS[i] for i in result.status[0]]
    assert [status[frame] for frame in lost] == ["lost", "interpolated", "interpolated", "interpolated", "lost"]
    assert set(status) == {"lost", "interpolated", "tracked"}
    assert np.isnan(result.cost[0, list(lost)]).all()
    assert np.isfinite(np.delete(result.cost[0], lost)).all()
    errors, sigma = joint_errors(result.pose[0]), result.joint_sigma[0]
    assert errors[9:12].mean() < 2.5 * errors[4:8].mean()
    assert np.median(sigma[10] / sigma[6]) > 1.2


def test_a_lost_frame_is_not_believed_though_it_has_masks():
    lost = (9, 10, 11)
    seen = swinging()[1]
    wrong = [seen[-1] if frame in lost else each for frame, each in enumerate(seen)]
    believed = smoothed(rough_track(lost=lost), CONFIG, wrong)
    hid = smoothed(rough_track(lost=lost), CONFIG, hidden(seen, lost))
    np.testing.assert_array_equal(believed.pose, hid.pose)


@pytest.mark.parametrize("crowded_views", [0, 2, 3])
def test_what_masks_show_of_others_costs_nothing_and_calls_for_no_limb(monkeypatch, crowded_views):
    """Somebody like the body stands beside it in some views; where these are most, what is uncovered is theirs."""
    raw, truth = rough_track(), swinging()[0]
    views = unpack_masks(swinging()[1][1].words, RIG.size)
    seen = [mask | np.roll(mask, 50, axis=1) if k < crowded_views else mask for k, mask in enumerate(views)]
    window = smoothing._MaskWindow(raw, CONFIG, iter([Observation.from_masks(seen)] * 2))
    smoother = smoothing._RunSmoother(raw, CONFIG, window, 0)
    window.read_until(2)
    folded = np.stack([truth[1], truth[1]])
    folded[1, SKELETON.angles("LShoulder").start + 2] -= 1.0
    true, wrong = smoother._area_costs(np.array([1, 1]), smoother._rooting.enter(folded))
    assert true < 0.06
    assert wrong > true + 0.02
    monkeypatch.setattr(window, "uncovered", lambda *_: [SimpleNamespace(area=np.ones(1))] * 2)
    assert smoother.area(1, smoother._rooting.enter(folded)).any() == (crowded_views < 3)


def test_before_an_end_that_is_lost_limbs_are_in_doubt():
    raw, drift = rough_track(lost=(FRAMES - 2, FRAMES - 1)), round(0.2 * FPS)
    gone = smoothed(raw, CONFIG, swinging()[1])  # nobody is seen there any more
    assert {STATUS[each] for each in gone.status[0, :-2]} == {"tracked"}
    lost = smoothed(replace(raw, iou=np.full_like(raw.iou, 0.5)), CONFIG, swinging()[1])
    expected = ["tracked"] * (FRAMES - 2 - drift) + ["partial"] * drift + ["lost"] * 2
    assert [STATUS[each] for each in lost.status[0]] == expected
    assert (lost.joint_sigma[0, -2 - drift : -2] >= 0.15 * raw.subject.body.relative_size).all()
    np.testing.assert_array_equal(lost.pose, gone.pose)


def test_a_run_is_the_same_alone_and_beside_others():
    seen = swinging()[1]
    batch = rough_track(runs=2)
    together = smoothed(batch, replace(CONFIG, runs=2, threads=2), seen)
    alone = smoothed(replace(batch, **{name: getattr(batch, name)[1:] for name in PER_RUN}), CONFIG, seen)
    for name in (*PER_RUN, "angle_sigma", "joint_sigma"):
        np.testing.assert_array_equal(getattr(together, name)[1:], getattr(alone, name), err_msg=name)


PER_RUN = ("pose", "cost", "iou", "evaluations", "status")


@pytest.mark.parametrize("rate", [0.2, 0.5])
def test_few_frames_a_minute_are_smoothed_too(rate):
    seen = hidden(swinging()[1][:4], (1,))
    result = track_observations(SUBJECT, RIG, iter(seen), rate, replace(CONFIG, algorithm="contour"))
    assert [STATUS[status] for status in result.status[0]] == ["tracked", "interpolated", "tracked", "tracked"]


def test_a_clip_of_one_frame_may_be_bridged():
    raw = rough_track()
    skeleton = SUBJECT.body.skeleton
    one = replace(
        raw, frame_numbers=np.arange(1), **{name: getattr(raw, name)[:, :1] for name in PER_RUN}
    )  # fmt: skip
    turned = one.pose.copy()
    turned[0, 0, skeleton.angles("LElbow")] += 1.5  # so that the way back finds another pose
    result = smoothed(replace(one, pose=turned), CONFIG, swinging()[1][:1])
    assert joint_errors_of(result.pose[0]) < joint_errors_of(turned[0])


@pytest.mark.parametrize("runs", [1, 2])
def test_masks_are_read_once_and_as_they_are_wanted(monkeypatch, runs):
    seen = swinging()[1]
    whole = smoothed(rough_track(runs), replace(CONFIG, runs=runs), seen)
    monkeypatch.setattr(clip, "WINDOW", 12 / FPS)
    for module in clip, smoothing:
        monkeypatch.setattr(module, "AHEAD", 3 / FPS)
    monkeypatch.setattr(clip, "OVERLAP", 5 / FPS)
    read, told = [], []

    def stream():
        for frame, observation in enumerate(seen):
            read.append(frame)
            yield observation

    def report(final: int) -> None:
        told.append((final, len(read)))

    windows = smoothed(rough_track(runs), replace(CONFIG, runs=runs), stream(), report)
    assert read == list(range(FRAMES))
    assert told == [(7, 15), (14, 22), (FRAMES, FRAMES)]
    apart = np.linalg.norm(windows.joints() - whole.joints(), axis=-1)
    assert np.median(apart) < 5e-4


def test_tracking_smooths_where_it_is_told_to():
    seen = swinging()[1][:6]
    config = TrackConfig("cmaes", evaluations=40, device="cpu", threads=1)
    rough = track_observations(SUBJECT, RIG, iter(seen), FPS, config)
    assert rough.raw_pose is None
    assert rough.joint_sigma is None
    result = track_observations(SUBJECT, RIG, iter(seen), FPS, replace(config, smooth=10.8))
    np.testing.assert_array_equal(result.raw_pose, rough.pose)
    assert joint_errors_of(result.pose[0]) < joint_errors_of(rough.pose[0])


def joint_errors_of(pose: np.ndarray) -> float:
    truth = swinging()[0][: len(pose)]
    return float(np.linalg.norm(joint_positions(SUBJECT, pose) - joint_positions(SUBJECT, truth), axis=-1).mean())
