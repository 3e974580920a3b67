from dataclasses import replace

import numpy as np
import pytest
import reference
from random_scenes import ODD_SIZES, indoor_rig, perfect_masks, random_poses
from synthetic import ring_rig, synthetic_body, synthetic_subject

from mmocap_warp.body import FULL_DOF
from mmocap_warp.objective import COSTS, Objective
from mmocap_warp.observation import Observation
from mmocap_warp.shape_space import ShapeSpace, heading_rotation, upright_base

FLOAT32 = 1e-6
OWN_BODY = 2e-3  # of a cost: a few pixels turn where vertices move by 1e-6 m


def objective_of(subject, rig, candidates, **settings):
    return Objective(subject.body, subject.root_base, rig, candidates, **settings)


def costs(objective, poses):
    """(candidate,) of the poses; the others are NaN before and after."""
    values = np.full(objective.pose.shape, np.nan, np.float32)
    values[: len(poses)] = poses
    objective.pose.assign(values)
    objective.cost.fill_(np.nan)
    found = objective.evaluate(len(poses)).numpy()
    assert np.isnan(found[len(poses) :]).all()
    return found[: len(poses)]


@pytest.mark.parametrize("cost", COSTS)
def test_the_true_pose_costs_exactly_nothing_and_others_something(device, cost):
    subject, rig = synthetic_subject(), ring_rig(cameras=3, size=(320, 240))
    poses = random_poses(4, reach=0.3, bend=0.6)
    objective = objective_of(subject, rig, 4, cost=cost, device=device)
    for c, pose in enumerate(poses):
        objective.observe(Observation.from_masks(perfect_masks(subject, rig, pose, device)))
        found = costs(objective, poses)
        assert found[c] == 0.0
        assert np.all(np.delete(found, c) > 0.0)


def test_costs_and_counts_are_the_twins(device):
    subject, rig = synthetic_subject(), indoor_rig()
    rng = np.random.default_rng(0)
    masks = [rng.random((height, width)) < 0.3 for width, height in ODD_SIZES]
    objective = objective_of(subject, rig, 12, device=device)
    objective.observe(Observation.from_masks(masks))
    poses = random_poses(12)
    found = costs(objective, poses)
    for c, pose in enumerate(poses):
        models = perfect_masks(subject, rig, pose, device)
        assert found[c] == pytest.approx(reference.paper_cost(models, masks), abs=FLOAT32)
        expected = [(m.sum(), (m & f).sum()) for m, f in zip(models, masks, strict=True)]
        np.testing.assert_array_equal(objective.count.numpy()[c], expected)


def test_a_new_observation_replaces_the_old(device):
    subject, rig = synthetic_subject(), ring_rig(cameras=2, size=(160, 120))
    objective = objective_of(subject, rig, 1, device=device)
    masks = perfect_masks(subject, rig, subject.pose, device)
    for judged, expected in ((masks, 0.0), ([~mask for mask in masks], 1.0), (masks, 0.0)):
        objective.observe(Observation.from_masks(judged))
        assert costs(objective, subject.pose[None])[0] == expected


@pytest.mark.parametrize("candidates", [1, 2, 7, 23])
def test_threads_do_not_change_a_bit(candidates):
    subject, rig = synthetic_subject(), indoor_rig()
    rng = np.random.default_rng(0)
    seen = Observation.from_masks([rng.random((height, width)) < 0.3 for width, height in ODD_SIZES])
    poses = random_poses(candidates)
    found = []
    for threads in (1, 2, 5):
        objective = objective_of(subject, rig, 23, threads=threads)
        objective.observe(seen)
        found.append((costs(objective, poses), objective.count.numpy()[:candidates]))
    for cost, count in found[1:]:
        np.testing.assert_array_equal(cost, found[0][0])
        np.testing.assert_array_equal(count, found[0][1])


def with_a_pair(body):
    """A body with a slider that has two sides."""
    return replace(
        body,
        shape_names=(*body.shape_names, "height_decr"),
        shape_vertex=np.concatenate([body.shape_vertex, -0.8 * body.shape_vertex[:1]]),
        shape_joint=np.concatenate([body.shape_joint, -0.8 * body.shape_joint[:1]]),
    )


@pytest.mark.parametrize("threads", [1, 2])
def test_own_bodies_cost_what_the_shaped_bodies_cost(device, threads):
    space = ShapeSpace(with_a_pair(synthetic_body()), "+y")
    subject, rig = synthetic_subject(), ring_rig(cameras=3, size=(320, 240))
    seen = Observation.from_masks(perfect_masks(subject, rig, subject.pose, device))
    coordinates = np.zeros((5, len(space)))
    coordinates[:, :FULL_DOF] = random_poses(5, reach=0.2, bend=0.4)
    coordinates[:, space.slider_index] = [(0, 0), (0.7, 0.5), (-0.9, 1.0), (0.3, 0), (-0.2, 0.1)]
    coordinates[:, space.scale_index] = np.log([1.0, 1.1, 0.9, 0.7, 1.3])
    coordinates[:, space.heading_index] = [0.0, 0.5, -2.0, 3.0, 1.0]
    together = Objective(space.body, np.eye(3), rig, 5, shapes=space, device=device, threads=threads)
    together.observe(seen)
    found = costs(together, coordinates)
    for c, coordinate in enumerate(coordinates):
        shaped = space.subject(coordinate, {})
        alone = objective_of(shaped, rig, 1, device=device)
        alone.observe(seen)
        assert found[c] == pytest.approx(costs(alone, shaped.pose[None])[0], abs=OWN_BODY)
        heading = upright_base("+y") @ heading_rotation(coordinate[space.heading_index])
        np.testing.assert_allclose(shaped.root_base, heading)


def test_wrong_use_is_refused():
    subject, rig = synthetic_subject(), ring_rig(cameras=2, size=(160, 120))
    with pytest.raises(ValueError, match="cost must be one of"):
        objective_of(subject, rig, 1, cost="dice")
    objective = objective_of(subject, rig, 3)
    for candidates in (0, 4):
        with pytest.raises(ValueError, match=r"candidates must be in 1\.\.3"):
            objective.evaluate(candidates)
    with pytest.raises(ValueError, match="masks are packed as"):
        objective.observe(Observation.from_masks([np.ones((120, 160), bool)]))
