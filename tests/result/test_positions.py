"""Joints and skin of a result, against one pose at a time."""

import numpy as np
import pytest
from synthetic import synthetic_result

from mmocap_warp.body import posing
from mmocap_warp.body.posing import Poser


@pytest.fixture
def result(monkeypatch):
    """Two runs of six frames; its positions are found in blocks of less than a run."""
    monkeypatch.setattr(posing, "POSES_AT_ONCE", 5)
    monkeypatch.setattr(posing, "_VERTICES_AT_ONCE", 4 * len(synthetic_result().subject.body.skin.rest))
    return synthetic_result()


def test_joints_of_every_run_and_frame(result):
    poser, joints = Poser(result.subject.body, result.subject.root_base), result.joints()
    assert joints.shape == (2, 6, len(result.subject.body.joint_rest), 3)
    for run, frame in np.ndindex(2, 6):
        np.testing.assert_array_equal(joints[run, frame], poser.joint_transforms(result.pose[run, frame])[0, :, :3, 3])


def test_vertices_of_the_best_run_or_another_and_of_some_frames(result):
    poser = Poser(result.subject.body, result.subject.root_base)
    assert result.best_run == 1
    np.testing.assert_array_equal(result.vertices(), poser.vertices(result.pose[1]))
    np.testing.assert_array_equal(result.vertices(run=0), poser.vertices(result.pose[0]))
    np.testing.assert_array_equal(result.vertices(frames=[2, -1]), poser.vertices(result.pose[1, [2, 5]]))
    np.testing.assert_array_equal(result.vertices(frames=range(1, 3)), poser.vertices(result.pose[1, 1:3]))
    np.testing.assert_array_equal(result.vertices(frames=2), poser.vertices(result.pose[1, [2]]))
    assert result.vertices(frames=[]).shape == (0, len(result.subject.body.skin.rest), 3)


def test_positions_of_a_run_or_frame_that_is_not_there(result):
    with pytest.raises(IndexError):
        result.vertices(run=2)
    with pytest.raises(IndexError):
        result.vertices(frames=[6])


def test_frames_are_chosen_by_positions_from_either_end_or_by_a_mask():
    result = synthetic_result(frames=4)
    early = result.frame_numbers < result.frame_numbers[2]
    assert result.at(early).frame_numbers.tolist() == result.at([0, 1]).frame_numbers.tolist()
    assert result.at([-1]).left_out_before == 3
    np.testing.assert_array_equal(result.vertices(frames=early), result.vertices(frames=[0, 1]))
    for wrong in ([0.5], [9], np.ones(3, bool)):
        with pytest.raises(IndexError):
            result.at(wrong)
