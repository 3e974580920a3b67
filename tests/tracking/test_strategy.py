import numpy as np
import pytest

from mmocap_warp.body.model import DOF_MODELS, FULL_NAMES, degrees_of_freedom
from mmocap_warp.tracking.strategy import hierarchical, holistic, share_budget

DIMENSIONS = {39: [6, 9, 6, 6, 6, 6], 28: [6, 6, 4, 4, 4, 4], 51: [6, 9, 9, 9, 9, 9]}


@pytest.mark.parametrize("model", DOF_MODELS)
def test_the_six_parts_hold_every_degree_of_freedom_once(model):
    dofs = degrees_of_freedom(model)
    parts = hierarchical(dofs)
    assert [len(part.index) for part in parts] == DIMENSIONS[model]
    np.testing.assert_array_equal(np.sort(np.concatenate([part.index for part in parts])), dofs.index)


def test_the_order_is_root_torso_arms_legs_left_before_right():
    parts = hierarchical(degrees_of_freedom(39))
    assert [part.name for part in parts] == ["root", "torso and head", "left arm", "right arm", "left leg", "right leg"]
    names = [[FULL_NAMES[i] for i in part.index] for part in parts]
    assert names[0] == ["Tx", "Ty", "Tz", "Root.Rx", "Root.Ry", "Root.Rz"]
    assert names[2] == ["LShoulder.Rx", "LShoulder.Ry", "LShoulder.Rz", "LElbow.Ry", "LWrist.Ry", "LWrist.Rz"]
    assert names[5] == ["RHip.Rx", "RHip.Ry", "RHip.Rz", "RKnee.Rx", "RAnkle.Rx", "RAnkle.Ry"]


@pytest.mark.parametrize("model", DOF_MODELS)
def test_holistic_is_one_part(model):
    dofs = degrees_of_freedom(model)
    (part,) = holistic(dofs)
    np.testing.assert_array_equal(part.index, dofs.index)


@pytest.mark.parametrize("evaluations", [0, 1, 5, 6, 499, 2999])
@pytest.mark.parametrize("parts", [1, 6])
def test_budgets_are_shared_evenly_and_wholly(evaluations, parts):
    shares = share_budget(evaluations, parts)
    assert sum(shares) == evaluations
    assert len(shares) == parts
    assert max(shares) - min(shares) <= 1
    assert shares == sorted(shares, reverse=True)
