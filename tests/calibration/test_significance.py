"""Of cameras' parameters those that have to change do, the others stay; and what is named is significant."""

from __future__ import annotations

import re
from types import SimpleNamespace

import numpy as np
import pytest
from synthetic import ring_rig

from mmocap_warp.calibration.adjust.camera_changes import CENTRE, KINDS, RADIAL
from mmocap_warp.calibration.adjust.camera_problem import CameraSolution
from mmocap_warp.calibration.camera_check import changing_lags, small_errors, with_words
from mmocap_warp.calibration.refine.refinement import (
    CLEAR,
    UNDETERMINED,
    implausible,
    select_parameters,
    with_all_cameras,
)

PRIOR = np.ones(4)
ALONE = np.arange(4)


def test_what_is_far_from_where_it_was_moves_and_what_is_near_stays():
    moved, determined, sigma = select_parameters(
        np.array([0.5, 0.01, -0.4, 0.0]), np.diag([0.01, 0.02, 0.01, 0.05]) ** 2, PRIOR, ALONE
    )
    np.testing.assert_array_equal(moved, [True, False, True, False])
    assert determined.all()
    np.testing.assert_allclose(sigma, [0.01, 0.02, 0.01, 0.05])


def test_what_the_data_do_not_tell_stays_and_is_named():
    moved, determined, _ = select_parameters(
        np.array([0.5, 0.9, 0.0, 0.0]), np.diag([0.01, UNDETERMINED + 0.1, 0.01, 0.01]) ** 2, PRIOR, ALONE
    )
    np.testing.assert_array_equal(moved, [True, False, False, False])
    np.testing.assert_array_equal(determined, [True, False, True, True])


def test_of_two_that_do_alike_one_is_enough():
    """Both are unsure beside each other, but their sum is well known; the one that fits better is told from it."""
    sum_known, difference_known = 0.01, 0.2
    turn = np.array([[1, 1], [1, -1]]) / np.sqrt(2)
    covariance = np.eye(4) * 0.01**2
    covariance[:2, :2] = turn @ np.diag([sum_known, difference_known]) ** 2 @ turn
    moved, _, sigma = select_parameters(np.array([0.3, 0.1, 0.0, 0.0]), covariance, PRIOR, ALONE)
    np.testing.assert_array_equal(moved, [True, False, False, False])
    assert sigma[0] < 2 * sum_known
    assert CLEAR * sigma[0] < 0.4


def test_what_belongs_together_stays_or_moves_together():
    """The first three are a position of which one axis does what the fourth does; two axes say that it has moved."""
    covariance = np.eye(4) * 0.01**2
    turn = np.array([[1, 1], [1, -1]]) / np.sqrt(2)
    covariance[2:, 2:] = turn @ np.diag([0.01, 2.0]) ** 2 @ turn
    value = np.array([0.3, 0.2, 0.1, 0.2])
    together, _, _ = select_parameters(value, covariance, PRIOR, np.array([0, 0, 0, 1]))
    np.testing.assert_array_equal(together, [True, True, True, False])
    apart, _, _ = select_parameters(value, covariance, PRIOR, ALONE)
    np.testing.assert_array_equal(apart, [True, True, False, True])


def test_several_that_belong_together_need_as_much_each_as_one_alone():
    """Three that are three deviations away each are chance, though together they are 5.2; five each are none."""
    together = np.array([0, 0, 0, 1])
    for deviations, expected in ((3.0, False), (5.0, True)):
        value = np.array([0.03, 0.03, 0.03, 0.0]) * deviations / 3
        moved, _, _ = select_parameters(value, np.eye(4) * 0.01**2, PRIOR, together)
        np.testing.assert_array_equal(moved, [expected] * 3 + [False])


RIG = ring_rig(4)


@pytest.mark.parametrize(
    ("columns", "deviations", "cause"),
    [
        (slice(0, 6), 3.0, "rotation and position"),
        (slice(0, 3), 3.0, "rotation"),
        (slice(3, 6), 3.0, "position"),
        (slice(6, 7), 4.0, "focal length"),
        (slice(9, 10), 4.0, "distortion"),
        (slice(0, 10), 1.0, None),
        (slice(0, 6), 0.8, None),
    ],
)
def test_a_change_is_named_where_it_is_significant(columns: slice, deviations: float, cause: str | None) -> None:
    """Whatever share of the contours' cost it explains, which masks' faults make large."""
    change = np.zeros((len(RIG), len(KINDS)))
    change[1, columns] = 0.01 * deviations
    solution = CameraSolution(
        change, np.zeros(1), None, np.ones(change.shape, bool), 1e-4 * np.eye(change.size), cost=1000.0
    )
    found = small_errors(RIG, solution)
    assert [(each.camera, each.cause) for each in found] == ([(RIG.names[1], cause)] if cause else [])
    if found:
        np.testing.assert_allclose(found[0].change, change)


def test_distortion_that_all_cameras_lack_is_named_though_none_of_them_shows_it_alone() -> None:
    """Beside each of them something else explains as much."""
    change = np.zeros((len(RIG), len(KINDS)))
    change[:, RADIAL] = [-0.11, -0.09, -0.12, -0.08]
    change[1, 6] = 0.02
    free = np.ones(change.shape, bool)
    found = small_errors(RIG, CameraSolution(change, np.zeros(1), None, free, 0.08**2 * np.eye(change.size), 1000.0))
    assert [(each.camera, each.cause) for each in found] == [(name, "distortion") for name in RIG.names]
    assert [each.change[k, RADIAL] for k, each in enumerate(found)] == pytest.approx([-0.1] * 4)
    adjustment = SimpleNamespace(given=RIG, scene=SimpleNamespace(calibrated=RIG, path="scene.toml"))
    edge, focal = RIG.size[0].max() / 2, RIG.K[0, 0, 0]
    words = with_words(found[0], adjustment).words
    assert f"{RIG.names[0]}: distortion ignored, by {0.1 * edge**3 / focal**2:.0f} px at the image's edge" in words
    assert words.endswith("mmocap calib check scene.toml")


@pytest.mark.parametrize(
    ("later", "cause", "says"),
    [
        (lambda at: -4.0 * (at > 60), "dropped frames", "dropped 4 of its frames near frame 1[56]"),
        (lambda at: 0.04 * at - 2.4, "frame rate", "runs 4.0 % faster than it says"),
        (lambda at: 0.0 * at, None, ""),
    ],
    ids=["dropped", "faster", "sound"],
)
def test_a_lag_that_changes_is_named_with_its_frame(later, cause: str | None, says: str) -> None:
    """Frames are numbered as in the recording, which began a hundred frames before; there somebody stands still."""
    frames, lags = np.arange(0, 120, 3), np.arange(-6, 7)
    still = frames[:, None] < 20
    of_view = np.stack([later(frames) if k == 2 else 0.0 * frames for k in range(4)], axis=1) + 6.0 * still
    costs = np.where(still, 0.02, 1.0) * (lags[:, None, None] - of_view) ** 2
    costs += np.random.default_rng(0).normal(0, 0.1, costs.shape)
    cameras = tuple(SimpleNamespace(name=name, rate=1.0) for name in RIG.names)
    adjustment = SimpleNamespace(
        scene=SimpleNamespace(fps=60.0, first_frame=100, cameras=cameras),
        footage=SimpleNamespace(fps=60.0),
        lag_costs=lambda change, person, at: costs,
    )
    found = changing_lags(adjustment, np.zeros((4, len(KINDS))), SimpleNamespace(spread=lambda count: frames))
    assert [(each.camera, each.cause) for each in found] == ([(RIG.names[2], cause)] if cause else [])
    assert all(re.search(says, each.words) for each in found)


@pytest.mark.parametrize(("others", "all_move"), [(0.4, False), (1.2, True)])
def test_cameras_that_are_a_little_off_move_with_those_that_are_clearly_off(others: float, all_move: bool) -> None:
    change = np.zeros((len(RIG), len(KINDS)))
    change[:, CENTRE] = 0.01 * others
    change[1, CENTRE] = 0.05
    moved = change > 0.04
    free = np.broadcast_to(np.isin(np.arange(len(KINDS)), [7, 8]), change.shape)
    solution = CameraSolution(change, np.zeros(1), None, free, 1e-4 * np.eye(int(free.sum())), cost=1.0)
    np.testing.assert_array_equal(with_all_cameras(moved, solution), free if all_move else moved)


def test_a_few_cameras_that_stay_while_most_move_are_implausible() -> None:
    moved = np.zeros((4, len(KINDS)), bool)
    moved[2, 3] = True
    assert not implausible(moved)
    moved[1:, 7] = True
    assert implausible(moved)
    moved[0, 7] = True
    assert not implausible(moved)
