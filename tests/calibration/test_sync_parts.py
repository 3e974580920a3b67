"""What common time is found by, piece by piece: signals of silhouettes, scores of lags, courses, and what is said."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from ball_scene import RIG as BALL_RIG

from mmocap_warp.calibration.sync import synchronise as sync
from mmocap_warp.calibration.sync.hull_agreement import HullAgreement, HullOffsets, PackedMasks, Sampling, _smooth_mean
from mmocap_warp.calibration.sync.lag_course import LagCourse, lag_course, margin, peak
from mmocap_warp.calibration.sync.shared_motion import (
    PairScores,
    _information,
    _self_information,
    common_offsets,
    pair_scores,
)
from mmocap_warp.calibration.sync.silhouette_motion import LIKE, SilhouetteMotion, _changes, _shape
from mmocap_warp.calibration.sync.synchronise import ViewOffset, _can_trust, _judge

FPS = 60.0
CENTRE_X, CENTRE_Y, TOP, BOTTOM, LEFT, RIGHT, ROOT_AREA, DOWN, ACROSS, LEAN = range(10)


def box(rows: slice, columns: slice) -> np.ndarray:
    mask = np.zeros((100, 80), bool)
    mask[rows, columns] = True
    return mask


def shape_of(mask: np.ndarray) -> np.ndarray:
    return _shape(mask, mask.sum(axis=1).astype(float), mask.sum(axis=0).astype(float))


def test_the_shape_of_a_silhouette_is_its_place_outline_and_spread() -> None:
    shape = shape_of(box(slice(10, 60), slice(20, 40)))
    np.testing.assert_allclose(shape[[CENTRE_X, CENTRE_Y]], [30.0, 35.0])
    np.testing.assert_allclose(shape[[TOP, BOTTOM, LEFT, RIGHT]], [10.5, 59.5, 20.2, 39.8])  # but for one in a hundred
    assert shape[ROOT_AREA] == pytest.approx(np.sqrt(1000))
    np.testing.assert_allclose(shape[[DOWN, ACROSS]], np.sqrt((np.array([50, 20]) ** 2 - 1) / 12))
    assert shape[LEAN] == pytest.approx(0.0, abs=1e-9)


def test_a_silhouette_that_leans_has_the_covariance_of_its_pixels() -> None:
    mask = box(slice(10, 40), slice(20, 40)) | box(slice(40, 60), slice(35, 60))
    row, column = np.nonzero(mask)
    shape = shape_of(mask)
    np.testing.assert_allclose(shape[[CENTRE_X, CENTRE_Y]], [column.mean() + 0.5, row.mean() + 0.5])
    np.testing.assert_allclose(shape[[DOWN, ACROSS]], [row.std(), column.std()])
    covariance = np.cov(row, column, bias=True)[0, 1]
    assert shape[LEAN] == pytest.approx(covariance / (shape[BOTTOM] - shape[TOP]))


def test_what_changes_is_counted_in_six_bands_that_reach_a_little_beyond_the_silhouettes() -> None:
    before = box(slice(10, 70), slice(20, 40))
    shape = shape_of(before)
    top, bottom = shape[TOP], shape[BOTTOM]
    beyond = 0.05 * (bottom - top)
    band = (bottom - top + 2 * beyond) / 6
    for height in (20, 35, 66):
        after = before.copy()
        after[height, 40:46] = True
        counts = _changes(before, after, shape, shape)
        assert counts.sum() == pytest.approx(6.0)
        assert counts.argmax() == int((height + 0.5 - top + beyond) // band)
    above = before.copy()
    above[: int(top - beyond) - 1] = True  # somewhere else in the image
    np.testing.assert_array_equal(_changes(before, above, shape, shape), 0.0)
    lower = shape.copy()
    lower[[TOP, BOTTOM]] += 12  # both silhouettes are reached
    after = before.copy()
    after[72, 20:26] = True
    assert _changes(before, after, shape, lower).sum() == pytest.approx(6.0)
    assert _changes(before, after, lower, shape).sum() == pytest.approx(6.0)


def test_a_steady_motion_has_its_speed_in_body_heights_for_signals() -> None:
    motion = SilhouetteMotion()
    for frame in range(30):
        motion.add(box(slice(10, 60), slice(5 + frame, 25 + frame)))
    signals = motion.signals(FPS)
    assert signals.shape == (29, 16)
    height = 49.0  # between the heights that hold all but one in a hundred of the rows
    np.testing.assert_allclose(signals[12:17, [CENTRE_X, LEFT, RIGHT]], 1 / height, rtol=0.01)
    np.testing.assert_array_equal(signals[:, [CENTRE_Y, TOP, BOTTOM, ROOT_AREA, DOWN]], 0.0)
    np.testing.assert_array_equal(signals[:, 10:], 0.0)  # as much changes in all frames


def test_a_silhouette_that_is_too_small_is_bridged_as_one_that_is_missing() -> None:
    missing, small = SilhouetteMotion(), SilhouetteMotion()
    for frame in range(20):
        whole = box(slice(10 + frame, 60 + frame), slice(20, 40))
        for motion, instead in ((missing, 0 * whole), (small, box(slice(5, 10), slice(70, 80)))):
            motion.add(instead.astype(bool) if frame == 9 else whole)
    np.testing.assert_array_equal(small.signals(FPS), missing.signals(FPS))
    assert np.abs(missing.signals(FPS)[5:14, CENTRE_Y] - 1 / 49.0).max() < 5e-4


def test_one_silhouette_is_no_motion() -> None:
    motion = SilhouetteMotion()
    for frame in range(4):
        motion.add(box(slice(10, 60), slice(20, 40)) & (frame == 2))
    with pytest.raises(ValueError, match="two frames"):
        motion.signals(FPS)


def made_scores(reach: int, *pairs: dict[int, float], views: int = 2, near: int = 2) -> PairScores:
    """What pairs of views share at some lags, pair by pair; nothing at all others."""
    score = np.zeros((views, views, 2 * reach + 1))
    for (one, other), shared in zip(combinations(range(views), 2), pairs, strict=True):
        for lag, value in shared.items():
            score[one, other, reach + lag] = score[other, one, reach - lag] = value
    return PairScores(score, reach, near)


def test_a_view_scores_at_each_offset_what_its_pairs_do_in_the_mean() -> None:
    scores = made_scores(4, {1: 3.0}, {2: 5.0}, {0: 7.0}, views=3)
    of_view = scores.of_view(2, np.array([0, 1, 0]))
    np.testing.assert_allclose(of_view[[4 + 2, 4 + 1]], [2.5, 3.5])  # of pairs 0-2 and 1-2
    far = scores.of_view(2, np.array([-9, -9, 0]))
    assert np.isneginf(far).all()
    partly = scores.of_view(2, np.array([-7, -7, 0]))
    assert np.isneginf(partly[2:]).all()
    np.testing.assert_array_equal(partly[:2], 0.0)
    assert scores.total(np.array([0, 1, 2])) == 3.0 + 5.0
    assert scores.total(np.array([0, 1, 9])) == 3.0
    np.testing.assert_array_equal(scores.within(2).score, scores.score[:, :, 2:7])
    assert scores.within(2).best_lag(0, 1) == 1
    assert scores.without(0).best_lag(0, 1) == 0


@pytest.mark.parametrize("lag", [-6, 3, 6])
def test_views_share_most_at_the_lag_between_them(lag: int) -> None:
    """As far as lags are looked for, and in clips of other lengths."""
    source = np.cumsum(np.random.default_rng(1).standard_normal((90, 3)), axis=0) * [1.0, 1.0, -1.0]
    signals = [source[10:70], source[10 - lag : 65 - lag] @ np.diag([2.0, 0.5, 1.0])]
    scores = pair_scores(signals, np.ones(3), FPS, 6)
    assert scores.best_lag(0, 1) == lag
    assert scores.best_lag(1, 0) == -lag
    assert scores.score[0, 1].max() > 1.2 * np.delete(scores.score[0, 1], lag + 6).max()
    assert scores.near == 6
    np.testing.assert_array_equal(common_offsets(scores), [0, lag])


def test_information_grows_with_the_correlation_and_is_none_of_a_still_signal() -> None:
    """Of Gaussian signals whose own noise is as large as they are: rho is half of the correlation."""
    random = np.random.default_rng(3)
    one, noise = random.standard_normal((2, 4000))
    for rho in (0.0, 0.6, 1.0):
        other = rho * one + np.sqrt(1 - rho**2) * noise
        assert _information(one[:, None], other[:, None]) == pytest.approx(-0.5 * np.log1p(-((rho / 2) ** 2)), abs=4e-3)
        (alike,) = _self_information(one[:, None], 3 * other[:, None])
        assert alike == pytest.approx(-0.5 * np.log1p(-((rho / 1.1) ** 2)), abs=0.02)
    assert _information(one[:, None], 0 * one[:, None]) == 0.0
    assert _self_information(one[:, None], -one[:, None]) == 0.0
    assert _self_information(one[:, None], 0 * one[:, None]) == 0.0


def test_chance_is_taken_off_what_views_share() -> None:
    """Signals that have nothing to do with one another score about nothing at every lag, however few the frames are."""
    random = np.random.default_rng(5)
    scores = [pair_scores([random.standard_normal((24, 4)) for _ in "ab"], np.zeros(4), FPS, 6) for _ in range(40)]
    assert abs(np.mean([each.score[0, 1] for each in scores])) < 0.02


def test_masks_come_back_by_the_recordings_frames() -> None:
    masks = np.random.default_rng(1).random((7, 5, 19)) > 0.5
    packed = PackedMasks(0.5)
    for mask in masks:
        packed.add(mask)
    assert len(packed) == 14
    at = packed.at(np.array([0, 4, 7, 13]))
    np.testing.assert_array_equal(at, masks[[0, 2, 4, 6]])
    assert at.dtype == bool


def test_shares_that_are_unknown_do_not_count_and_the_rest_is_smoothed() -> None:
    shares = np.array([[0.0, 1.0, 0.0, np.nan], [np.nan, 1.0, 0.0, np.nan]])
    np.testing.assert_allclose(_smooth_mean(shares), [0.25, 0.5, 0.25, 0.0])


def test_a_hull_judges_only_frames_in_which_all_views_see_somebody() -> None:
    """And a view at a lag at which it sees nobody has no share there."""
    width, height = BALL_RIG.size[0]
    row, column = np.mgrid[:height, :width]
    ball = (column - width / 2) ** 2 + (row - height / 2) ** 2 < 400
    views = [PackedMasks(1.0) for _ in range(3)]
    for frame in range(12):
        for k, view in enumerate(views):
            view.add(ball & (k > 0 or frame != 5))
    hulls = HullAgreement(BALL_RIG.select(BALL_RIG.names[:3]), views, np.zeros(3, int), 2, Sampling(20, 500, 1))
    assert hulls.judged == 12 - 2 * 2 - 1


def course_of(lag: list[float]) -> LagCourse:
    return lag_course(np.arange(25, 25 + 50 * len(lag), 50), np.array(lag))


def test_a_change_must_be_large_and_much_larger_than_the_scatter() -> None:
    assert course_of([0, 0, 0, 2, 2, 2]).jump == 2
    assert course_of([0, 0, 0, 1.4, 1.4, 1.4]) == LagCourse()
    assert course_of([0, 0.5, 1, 1.5, 2, 2.6]).slope == pytest.approx(0.0103, abs=1e-4)
    assert course_of([0, 0.4, 0.8, 1.2, 1.6, 2.0]) == LagCourse()
    noisy = course_of([-0.8, 0.5, 2.3, 3.9, 1.3, 5.3])  # a line leaves more than half of the scatter
    assert not noisy.changes
    assert noisy.scatter == pytest.approx(2.0465, abs=1e-4)
    assert course_of([0, 5, 0, 5, 7, 2, 7, 2]).jump == 0
    three = course_of([0, 0, 9])
    assert not three.changes
    assert three.scatter == pytest.approx(np.std([0, 0, 9]))


def test_a_jump_has_its_frame_and_what_scatter_is_left() -> None:
    course = course_of([1, 1, 1, 1, -2, -2.2])
    assert (course.jump, course.at) == (-3, (175 + 225) // 2)
    assert course.scatter == pytest.approx(np.sqrt(2 * 0.1**2 / 6))
    early = course_of([3, 3, 0, 0, 0, 0])
    assert (early.jump, early.at) == (-3, 100)


def test_a_peak_lies_between_lags_by_the_parabola_through_its_neighbours() -> None:
    lags = np.arange(9)
    assert peak(-((lags - 3.3) ** 2)) == pytest.approx(3.3)
    assert peak(-((lags + 4.0) ** 2)) == 0.0  # beyond the first: at most one lag away
    assert peak(np.zeros(9)) == 1.0


def test_the_margin_is_the_half_of_a_99_percent_interval() -> None:
    """Student's 0.995 quantile for ten degrees of freedom is 3.169."""
    assert margin(np.array([0.5, 1.0]), 6) == pytest.approx(3.169, abs=1e-3)


def test_a_lag_may_be_a_third_of_the_shortest_view_and_of_the_time_asked_for(monkeypatch) -> None:
    asked: list[int] = []

    def pair_scores(signals: list[np.ndarray], like: np.ndarray, fps: float, reach: int) -> PairScores:
        asked.append(reach)
        return made_scores(reach, {0: 1.0})

    monkeypatch.setattr(sync, "pair_scores", pair_scores)
    for frames, within in ((180, 10.0), (180, 0.5), (2, 10.0)):
        sync._offsets_by_motion([np.zeros((frames, 6)), np.zeros((300, 6))], FPS, within)
    assert asked == [60, 30, 1]


@pytest.mark.parametrize(
    ("offsets", "spread", "margin", "trusted"),
    [
        ([0, 3, 0], 1, 0.9, True),
        ([0, 4, 0], 0, 0.1, False),
        ([0, 0, 0], 2, 0.1, False),
        ([0, 0, 0], 0, 1.0, False),
        ([5, 5, 5], 0, 0.1, True),
    ],
)
def test_hulls_are_trusted_near_what_motion_is_sure_of(offsets, spread, margin, trusted) -> None:
    hull = HullOffsets(np.array(offsets), spread, [], margin)
    assert _can_trust(hull, np.zeros(3)) == trusted
    if offsets == [0, 4, 0]:
        assert _can_trust(hull, None)


def judged(*pairs: dict[int, float], margin: float = 0.0, **more) -> ViewOffset:
    views = 2 if len(pairs) == 1 else 3
    return _judge(made_scores(30, *pairs, views=views), 0, np.zeros(views, int), margin, LagCourse(), **more)


def test_a_rival_is_the_best_lag_elsewhere_over_the_best_here() -> None:
    view = judged({0: 0.5, -1: 1.0, 20: 0.5})
    assert (view.rival, view.other, view.sure) == (0.5, -20, False)
    assert judged({0: 0.5, 1: 1.0, 20: 0.5}).rival == 0.5
    assert judged({0: 0.5, 2: 1.0, 20: 0.5}).rival == 1.0  # two frames away is neither here nor elsewhere
    assert judged({0: 1.0, 3: 0.7}).rival == pytest.approx(0.7)
    assert judged({20: 1.0}).rival == float("inf")
    assert judged({0: 1.0, 3: 0.49}).sure is True
    assert judged({0: 1.0, 3: 0.51}).sure is False
    assert judged({0: 1.0, 3: 0.8}, by_hull=True).sure is True
    assert judged({0: 1.0}, margin=1.9).sure
    assert not judged({0: 1.0}, margin=2.0).sure
    near = _judge(made_scores(2, {0: 1.0, 1: 0.9}), 0, np.zeros(2, int), 0.0, LagCourse())
    assert (near.rival, near.sure) == (0.0, True)  # no lag that is looked for lies elsewhere


def test_a_short_lag_within_its_margin_is_none() -> None:
    def own(lag: int, margin: float, third: int = 0) -> int:
        offsets = np.array([lag, 0, third, 0])
        lags = [offsets[other] - offsets[one] for one, other in combinations(range(4), 2)]
        scores = made_scores(30, *({int(lag): 1.0} for lag in lags), views=4)
        return _judge(scores, 0, offsets, margin, LagCourse()).frames

    assert [own(1, 1.1), own(2, 1.9), own(1, 0.9), own(0, 1.5)] == [0, 2, 1, 0]
    assert [own(1, 1.1, third=2), own(1, 1.1, third=9)] == [0, 1]  # cameras of which one clearly lags are not in step


def test_why_an_offset_is_in_doubt_is_said() -> None:
    def says(rival: float, agreeing: float, margin: float = 0.0) -> str:
        return str(ViewOffset(5, rival, 25, agreeing, sure=False, margin=margin).doubt("a", None))

    assert "shows no motion that the other views share" in says(float("inf"), 1.0)
    assert "a fits 50 % as well 20 frames later: the motion repeats itself every 20 frames" in says(0.5, 1.0)
    assert "give its offset only to 3.3 frames" in says(0.4, 1.0, margin=3.3)
    assert "give its offset to no precision" in says(0.4, 1.0, margin=float("inf"))
    assert "agrees with 50 % of the other views" in says(0.4, 0.5)
    sure = ViewOffset(5, 0.1, 25, 1.0, sure=True)
    assert sure.doubt("a", None) is None
    dropped = ViewOffset(5, 0.1, 25, 1.0, sure=True, course=LagCourse(jump=-2, at=40))
    assert "a dropped 2 of its frames near frame 40" in str(dropped.doubt("a", None))


def test_what_all_views_show_alike_is_the_top_and_the_movement_at_each_height() -> None:
    assert np.flatnonzero(LIKE[:10]).tolist() == [TOP]
    assert LIKE[TOP] == 2 * LIKE[-1]


def test_views_that_never_see_somebody_at_once_have_no_hull() -> None:
    rig = BALL_RIG.undistorted()
    width, height = rig.size[0].tolist()
    masks = np.zeros((3, 8, height, width), bool)
    for k in range(3):
        masks[k, k] = True  # each in a frame of its own
    views = [PackedMasks(1.0) for _ in range(3)]
    for view, of_view in zip(views, masks, strict=True):
        for mask in of_view:
            view.add(mask)
    agreement = HullAgreement(rig, views, np.zeros(3, int), 1, Sampling(8, 100, 1))
    assert agreement.judged == 0
