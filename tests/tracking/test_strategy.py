import numpy as np
import pytest
from body_parts import hierarchical, holistic
from synthetic import MODELS, NAMES, SKELETON

DIMENSIONS = {39: [6, 9, 6, 6, 6, 6], 28: [6, 6, 4, 4, 4, 4], 51: [6, 9, 9, 9, 9, 9]}


@pytest.mark.parametrize("model", MODELS)
def test_the_six_parts_hold_every_degree_of_freedom_once(model):
    parts = hierarchical(SKELETON, model)
    assert [len(part.index) for part in parts] == DIMENSIONS[model]
    np.testing.assert_array_equal(np.sort(np.concatenate([part.index for part in parts])), SKELETON.searched(model))


def test_the_order_is_root_torso_arms_legs_left_before_right():
    parts = hierarchical(SKELETON, 39)
    assert [part.name for part in parts] == ["root", "torso and head", "left arm", "right arm", "left leg", "right leg"]
    names = [[NAMES[i] for i in part.index] for part in parts]
    assert names[0] == ["Tx", "Ty", "Tz", "Root.Rx", "Root.Ry", "Root.Rz"]
    assert names[2] == ["LShoulder.Rx", "LShoulder.Ry", "LShoulder.Rz", "LElbow.Ry", "LWrist.Ry", "LWrist.Rz"]
    assert names[5] == ["RHip.Rx", "RHip.Ry", "RHip.Rz", "RKnee.Rx", "RAnkle.Rx", "RAnkle.Ry"]


@pytest.mark.parametrize("model", MODELS)
def test_holistic_is_one_part(model):
    (part,) = holistic(SKELETON, model)
    np.testing.assert_array_equal(part.index, SKELETON.searched(model))
