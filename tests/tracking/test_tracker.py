import warnings
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from person_skeleton import JOINTS
from random_scenes import perfect_masks
from synthetic import COORDINATES, SKELETON, ring_rig, synthetic_poses, synthetic_subject
from tracked_motion import TRACKED

from mmocap_warp.body.posing import Poser
from mmocap_warp.device.resolve import resolve_device
from mmocap_warp.masks.mask_settings import ForegroundSettings
from mmocap_warp.masks.observation import Observation
from mmocap_warp.result.result import STATUS
from mmocap_warp.tracking.algorithms import ALGORITHMS
from mmocap_warp.tracking.frame_loop import collect, track, track_observations
from mmocap_warp.tracking.track_config import TrackConfig
from mmocap_warp.tracking.tracker import Tracker, TrackState, others_in, overlap, without_stranger

FPS = 60.0
TRACKING_ERROR = 0.025  # [m], mean marker error of one run, see the test
RIG = ring_rig(cameras=4, size=(160, 120))


def poses_of(dof, frames):
    """(frame, 51) a motion of the searched angles alone, about 0.02 rad a frame."""
    subject = synthetic_subject()
    poses = np.tile(subject.pose, (frames, 1))
    index = SKELETON.searched(dof)
    poses[:, index] = synthetic_poses(120)[:frames, index]
    return poses


def observed(poses, device="cpu", lost=()):
    """Perfect observations; ``lost`` names (frame, camera) without foreground."""
    seen = []
    for f, pose in enumerate(poses):
        masks = perfect_masks(synthetic_subject(), RIG, pose, device)
        seen.append(Observation.from_masks([mask & ((f, k) not in lost) for k, mask in enumerate(masks)]))
    return seen


@pytest.fixture(scope="module")
def walk():
    """Five observed frames."""
    return observed(poses_of(39, 5))


def tracker_of(device="cpu", subject=None, **settings):
    return Tracker(
        subject or synthetic_subject(),
        RIG,
        TrackConfig(**({"algorithm": "h-cmaes", "device": device, "threads": 1} | settings)),
        FPS,
    )


def count_evaluations(tracker):
    """The list of how many candidates each later call of the objective judges."""
    calls, evaluate = [], tracker.search.objective.evaluate

    def counted(candidates):
        calls.append(candidates)
        return evaluate(candidates)

    tracker.search.objective.evaluate = counted
    return calls


@pytest.mark.parametrize("evaluations", [1, 2, 7, 500])
@pytest.mark.parametrize(("algorithm", "dof", "runs"), [("h-cmaes", 39, 1), ("h-cmaes", 28, 3), ("cmaes", 39, 2)])
def test_a_frame_costs_its_budget_exactly(device, walk, evaluations, algorithm, dof, runs):
    tracker = tracker_of(device, algorithm=algorithm, dof=dof, runs=runs, evaluations=evaluations)
    calls = count_evaluations(tracker)
    for observation in walk[:2]:
        assert tracker.step(observation).evaluations == evaluations
        assert calls.pop() == runs  # the answer is looked at once more, for its overlap
        assert sum(calls) == evaluations * runs
        calls.clear()


def test_one_evaluation_is_that_of_the_pose_carried_over(device, walk):
    tracker = tracker_of(device, evaluations=1, runs=2)
    start = synthetic_subject().pose.astype(np.float32)
    for observation in walk:
        answer = tracker.step(observation)
        np.testing.assert_array_equal(answer.pose, [start, start])
        assert np.all(np.isfinite(answer.cost))


def test_a_pose_carried_over_that_is_perfect_is_kept(device):
    tracker = tracker_of(device, evaluations=200, runs=2)
    start = synthetic_subject().pose
    answer = tracker.step(observed(start[None], device)[0])
    np.testing.assert_array_equal(answer.pose, np.tile(start.astype(np.float32), (2, 1)))
    assert answer.cost.tolist() == [0.0, 0.0]
    np.testing.assert_array_equal(answer.iou, np.ones((2, 4)))


def test_the_pose_carried_over_wins_ties(device, walk):
    """Out of every camera's view all poses cost the same."""
    subject = synthetic_subject()
    away = replace(subject, pose=subject.pose + np.r_[[0, 50.0, 0], np.zeros(48)])
    answer = tracker_of(device, away, evaluations=100).step(walk[0])
    np.testing.assert_array_equal(answer.pose[0], away.pose.astype(np.float32))
    assert answer.cost[0] == 1.0


def test_a_frame_never_ends_worse_than_it_began(device, walk):
    kept = tracker_of(device, evaluations=1)
    searched = tracker_of(device, evaluations=60)
    for observation in walk:
        kept.state = searched.state
        assert searched.step(observation).cost[0] <= kept.step(observation).cost[0]


def test_a_lost_view_is_left_out_and_marked(device):
    poses = poses_of(39, 2)
    tracker = tracker_of(device, evaluations=100)
    answers = [tracker.step(observation) for observation in observed(poses, device, lost={(1, 2)})]
    assert [STATUS[answer.status] for answer in answers] == ["tracked", "partial"]
    np.testing.assert_array_equal(np.isnan(answers[1].iou), [[False, False, True, False]])
    assert np.isfinite(answers[1].cost).all()


def test_a_frame_without_views_is_lost_and_carries_the_pose_over(device, walk):
    """The frame after it goes on as if the lost one had not been."""
    nothing = Observation.from_masks([np.zeros((120, 160), bool)] * 4)
    tracker, undisturbed = (tracker_of(device, evaluations=60, runs=2) for _ in range(2))
    before = tracker.step(walk[0])
    lost = tracker.step(nothing)
    assert STATUS[lost.status] == "lost"
    assert lost.evaluations == 0
    assert np.isnan(lost.cost).all()
    assert np.isnan(lost.iou).all()
    np.testing.assert_array_equal(lost.pose, before.pose)
    undisturbed.step(walk[0])
    np.testing.assert_array_equal(tracker.step(walk[1]).pose, undisturbed.step(walk[1]).pose)


@pytest.mark.parametrize("algorithm", ["h-cmaes", "cmaes", "apf", "psapf"])
def test_a_run_of_a_batch_is_the_single_run_bit_for_bit(device, walk, algorithm):
    def track(**settings):
        config = TrackConfig(algorithm, evaluations=120, device=device, **settings)
        return track_observations(synthetic_subject(), RIG, walk[1:4], FPS, config)

    batch = track(seed=4, runs=3, threads=2)
    for run in range(3):
        single = track(seed=4 + run, threads=1)
        np.testing.assert_array_equal(batch.pose[run], single.pose[0])
        np.testing.assert_array_equal(batch.cost[run], single.cost[0])
        np.testing.assert_array_equal(batch.iou[run], single.iou[0])
    assert not np.array_equal(batch.pose[0, -1], batch.pose[1, -1])


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_state_is_all_that_the_next_frame_depends_on(device, walk, algorithm):
    tracker = tracker_of(device, algorithm=algorithm, evaluations=240, runs=2)
    for observation in walk[:3]:
        tracker.step(observation)
    resumed = tracker_of(device, algorithm=algorithm, evaluations=240, runs=2)
    resumed.state = tracker.state
    for observation in walk[3:]:
        after, again = tracker.step(observation), resumed.step(observation)
        np.testing.assert_array_equal(after.pose, again.pose)
        np.testing.assert_array_equal(after.cost, again.cost)


@pytest.mark.parametrize("algorithm", ["apf", "psapf"])
def test_a_filter_that_is_given_a_pose_alone_begins_anew(device, walk, algorithm):
    """As a tracker that was never used; with the particles of before it would go on otherwise."""
    used, new = (tracker_of(device, algorithm=algorithm, evaluations=1500) for _ in range(2))
    used.step(walk[0])
    state = used.state
    used.state = new.state = TrackState(state.pose, state.counter)
    answer = used.step(walk[1]).pose
    np.testing.assert_array_equal(answer, new.step(walk[1]).pose)
    new.state = state
    assert not np.array_equal(answer, new.step(walk[1]).pose)


@pytest.mark.parametrize("dof", [28, 39])
def test_angles_that_are_not_searched_are_held(device, walk, dof):
    """The start has every angle turned; only the model's own move."""
    subject = synthetic_subject()
    subject = replace(subject, pose=subject.pose + np.random.default_rng(0).uniform(-0.1, 0.1, COORDINATES))
    answer = tracker_of(device, subject, dof=dof, evaluations=200).step(walk[0])
    moved = answer.pose[0] != subject.pose.astype(np.float32)
    searched = np.isin(np.arange(COORDINATES), SKELETON.searched(dof))
    assert not np.any(moved & ~searched)
    assert np.mean(moved[searched]) > 0.9


def test_angles_stay_within_the_bodys_limits(device):
    """But for the root's, whose angles a search counts from where the last frame left them; no body limits these."""
    subject = synthetic_subject()
    narrow = np.tile(np.array([-0.05, 0.1], np.float32), (len(JOINTS), 3, 1))
    skeleton = replace(subject.body.skeleton, limits=narrow)
    subject = replace(subject, body=replace(subject.body, skeleton=skeleton))
    bent = observed(poses_of(39, 40)[-1:], device)[0]
    settings = {"evaluations": 300, "rotation_radius": 0.5}
    angles = tracker_of(device, subject, **settings).step(bent).pose[0, 6:].reshape(-1, 3)
    assert np.all((angles >= narrow[1:, :, 0]) & (angles <= narrow[1:, :, 1]))
    assert np.any(angles == narrow[1:, :, 1])
    free = tracker_of(device, subject, limits=False, **settings).step(bent).pose[0, 6:].reshape(-1, 3)
    assert np.any((free < narrow[1:, :, 0]) | (free > narrow[1:, :, 1]))


def marker_error(poses, truth):
    """Mean distance of the markers per frame (frame,) [m]."""
    subject = synthetic_subject()
    poser, marker = Poser(subject.body, subject.root_base), subject.body.marker_vertex
    between = poser.vertices(poses)[:, marker] - poser.vertices(truth)[:, marker]
    return np.linalg.norm(between, axis=-1).mean(axis=1)


@pytest.mark.parametrize("dof", [39, 28])
def test_a_motion_is_tracked(device, dof):
    """15 frames in which every searched angle moves, seen in four images of 160 x 120: a pixel is 25 mm wide."""
    truth = poses_of(dof, 15)
    config = TrackConfig("h-cmaes", dof=dof, runs=2, device=device)
    result = track_observations(synthetic_subject(), RIG, observed(truth, device), FPS, config)
    for run in range(2):
        errors = marker_error(result.pose[run], truth)
        assert errors.mean() < TRACKED * marker_error(np.tile(truth[0], (15, 1)), truth).mean()
        assert errors.mean() < TRACKING_ERROR
        assert errors.max() < 2 * TRACKING_ERROR
    assert result.iou.mean() > 0.9


def test_a_status_may_be_of_all_runs_or_of_each(walk):
    tracker = tracker_of(evaluations=1, runs=2)
    first, second = tracker.step(walk[0]), tracker.step(walk[1])
    rescued = replace(second, status=np.array([STATUS.index("tracked"), STATUS.index("rescued")]))
    result = collect(synthetic_subject(), RIG, FPS, TrackConfig("h-cmaes", runs=2), [first, rescued])
    assert [[STATUS[status] for status in run] for run in result.status] == [
        ["tracked", "tracked"],
        ["tracked", "rescued"],
    ]


def test_a_result_says_how_it_was_made(walk):
    told = []
    config = TrackConfig("h-cmaes", evaluations=20, runs=2, seed=7, threads=1)
    result = track_observations(
        synthetic_subject(),
        RIG,
        walk[:3],
        FPS,
        config,
        lambda number, answer: told.append((number, answer.evaluations)),
    )
    assert told == [(0, 20), (1, 20), (2, 20)]
    assert result.pose.shape == (2, 3, COORDINATES)
    assert result.cost.shape == result.evaluations.shape == (2, 3)
    assert result.iou.shape == (2, 3, 4)
    assert np.all(result.evaluations == 20)
    assert result.frame_numbers.tolist() == [0, 1, 2]
    assert result.config["seed"] == 7
    assert (result.config["rotation_radius"], result.config["translation_radius"]) == (0.02, 0.0133)
    assert result.config["device"] == resolve_device("auto")
    assert {"warp-lang", "numpy", "device"} <= set(result.versions)


@pytest.mark.parametrize(
    ("settings", "fps", "radii"),
    [
        ({}, 60.0, (0.02, 0.0133)),
        ({}, 30.0, (0.04, 0.0266)),
        ({"algorithm": "de"}, 60.0, (0.08, 0.053)),
        ({"preset": "paper"}, 30.0, (0.5, 0.5)),
        ({"preset": "authors"}, 120.0, (0.05, 0.05)),
        ({"preset": "authors", "algorithm": "apf"}, 120.0, (0.0349, 0.01)),
        ({"rotation_radius": 0.2}, 30.0, (0.2, 0.0266)),
        ({"preset": "paper", "translation_radius": 0.1}, 60.0, (0.5, 0.1)),
    ],
)
def test_radii_come_from_the_preset_unless_given(settings, fps, radii):
    assert TrackConfig(**({"algorithm": "h-cmaes"} | settings)).radii(fps) == pytest.approx(radii)


@pytest.mark.parametrize(
    "settings",
    [
        {"algorithm": "H-CMAES"},
        {"evaluations": 0},
        {"runs": -1},
        {"seed": -1},
        {"seed": 2**31 - 1},
        {"preset": "fast"},
        {"cost": "dice"},
        {"renderer": "zbuffer"},
        {"rotation_radius": 0.0},
        {"rotation_radius": float("nan")},
        {"translation_radius": float("inf")},
        {"scale": 0.0},
        {"scale": 1.5},
        {"threads": 0},
    ],
)
def test_wrong_settings_are_refused_by_name_and_value(settings):
    ((name, value),) = settings.items()
    with pytest.raises(ValueError, match=rf"^{name} must .*{value}".replace("2147483647", "")):
        TrackConfig(**({"algorithm": "h-cmaes"} | settings))


def test_a_model_that_the_body_lacks_is_refused():
    with pytest.raises(ValueError, match=r"dof must be one of \[39, 28, 51\], got 40"):
        tracker_of(dof=40)


def test_an_unknown_device_is_refused():
    with pytest.raises(ValueError, match="device must be auto or one of"):
        resolve_device("cuda:99")


def test_the_component_nearest_the_tracked_body_is_kept(walk):
    """Where ``keep = "nearest"`` the masks are asked for with the body as it was tracked last."""
    asked = []

    class Recording:
        path, fps, rate, frames, frame_count, attached = Path("scene.toml"), FPS, FPS, range(3), 3, ()
        foreground = ForegroundSettings(keep="nearest")

        def rig(self, scale):
            return RIG

        def observations(self, scale, first=0, body=None):
            for observation in walk[first:3]:
                asked.append(body())
                yield observation

    result = track(Recording(), synthetic_subject(), TrackConfig("h-cmaes", evaluations=60, device="cpu"))
    starts = [synthetic_subject().pose, *result.pose[0, :2]]
    for masks, pose in zip(asked, starts, strict=True):
        for mask, expected in zip(masks, perfect_masks(synthetic_subject(), RIG, pose, "cpu"), strict=True):
            assert (mask & expected).sum() > 0.85 * (mask | expected).sum()  # another rasteriser, at 25 mm a pixel


def test_what_of_a_mask_is_somebody_elses():
    """The body has 100 pixels: of masks that show it all and far more the rest is others', but for what is usual."""
    count = np.array([[[100, 95], [100, 95], [100, 79], [100, 0], [0, 0]]])
    foreground = np.array([295, 124, 300, 200, 50])
    assert others_in(count, foreground).tolist() == [[195, 0, 0, 0, 0]]
    seen = SimpleNamespace(foreground=foreground)
    np.testing.assert_allclose(overlap(count, seen, others_in(count, foreground))[0, :2], [95 / 105, 95 / 129])


def test_of_many_views_one_that_shows_another_instead_does_not_count():
    nan = np.nan
    iou = np.array([[0.9, 0.8, 0.7, 0.0], [0.9, 0.8, nan, 0.0], [0.9, 0.8, 0.7, nan], [0.9, 0.8, 0.7, 0.4]])
    np.testing.assert_allclose(without_stranger(iou), [0.8, 1.7 / 3, 0.8, 0.7])
    with warnings.catch_warnings(action="error"):
        assert without_stranger(np.zeros((1, 4))) == 0  # somebody who is elsewhere in all views is no stranger in one
