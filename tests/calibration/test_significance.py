"""Of cameras' parameters those that have to change do, the others stay."""

from __future__ import annotations

import numpy as np

from mmocap_warp.calibration.refine.refinement import CLEAR, UNDETERMINED, select_parameters

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
