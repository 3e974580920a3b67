from dataclasses import replace

import numpy as np
import pytest
import reference
import warp as wp
from body_parts import hierarchical
from person_skeleton import JOINTS
from random_scenes import ODD_SIZES, indoor_rig, perfect_masks, random_masks, random_poses
from synthetic import COORDINATES, SKELETON, ring_rig, synthetic_body, synthetic_subject

from mmocap_warp.body.shape_space import ShapeSpace, heading_rotation, upright_base
from mmocap_warp.masks.observation import Observation
from mmocap_warp.silhouettes import COSTS, RENDERERS
from mmocap_warp.silhouettes.objective import Objective

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


@pytest.mark.parametrize("renderer", RENDERERS)
@pytest.mark.parametrize("cost", COSTS)
def test_the_true_pose_costs_exactly_nothing_and_others_something(device, cost, renderer):
    subject, rig = synthetic_subject(), ring_rig(cameras=3, size=(320, 240))
    poses = random_poses(4, reach=0.3, bend=0.6)
    objective = objective_of(subject, rig, 4, cost=cost, renderer=renderer, device=device)
    for c, pose in enumerate(poses):
        objective.observe(Observation.from_masks(perfect_masks(subject, rig, pose, device)))
        found = costs(objective, poses)
        assert found[c] == 0.0
        assert np.all(np.delete(found, c) > 0.0)


@pytest.mark.parametrize("renderer", RENDERERS)
def test_costs_and_counts_are_those_of_the_pictures(device, renderer):
    subject, rig = synthetic_subject(), indoor_rig()
    rng = np.random.default_rng(0)
    masks = [rng.random((height, width)) < 0.3 for width, height in ODD_SIZES]
    objective = objective_of(subject, rig, 12, renderer=renderer, device=device)
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
    seen = Observation.from_masks(random_masks(rig.size))
    poses = random_poses(candidates)
    found = []
    for threads in (1, 2, 5):
        objective = objective_of(subject, rig, 23, threads=threads)
        objective.observe(seen)
        found.append((costs(objective, poses), objective.count.numpy()[:candidates]))
    for cost, count in found[1:]:
        np.testing.assert_array_equal(cost, found[0][0])
        np.testing.assert_array_equal(count, found[0][1])


# A part that moves

PARTS = {part.name: part.index for part in hierarchical(SKELETON, 39)}


def held_apart(part, runs=3, particles=4, seed=0):
    """Bases (run, 51) and poses (run particle, 51) that differ from them in a part alone."""
    base = random_poses(runs, seed=seed, reach=0.3).astype(np.float32)
    poses = np.repeat(base, particles, axis=0)
    poses[:, PARTS[part]] += np.random.default_rng(seed).normal(0, 0.3, (len(poses), len(PARTS[part])))
    return base, poses


def on(device, values):
    return wp.array(values, dtype=wp.float32, device=device)


@pytest.mark.parametrize("renderer", RENDERERS)
def test_holding_what_stays_does_not_change_a_bit_of_the_cost(device, renderer):
    """Part after part and frame after frame, as a search does, with other bases and masks each time."""
    subject, rig = synthetic_subject(), ring_rig(cameras=3, size=(97, 61))
    objective = objective_of(subject, rig, 12, renderer=renderer, device=device)
    objective.prior.fill_(0.01)
    for frame in range(2):
        objective.observe(Observation.from_masks(random_masks(rig.size, frame)))
        for part in PARTS:
            base, poses = held_apart(part, seed=frame)
            objective.hold(on(device, base), PARTS[part])
            held = costs(objective, poses)
            objective.release()
            np.testing.assert_array_equal(held, costs(objective, poses))


@pytest.mark.parametrize("renderer", RENDERERS)
def test_poses_from_the_host_that_differ_in_a_part_cost_the_same_bits(device, renderer):
    subject, rig = synthetic_subject(), ring_rig(cameras=3, size=(97, 61))
    objective = objective_of(subject, rig, 12, renderer=renderer, device=device)
    for frame in range(3):  # on a GPU the third replays a graph
        objective.observe(Observation.from_masks(random_masks(rig.size, frame)))
        for part in PARTS:
            others = held_apart(part, seed=frame)[1]
            poses = np.repeat(others[:1], len(others), axis=0)
            poses[:, PARTS[part]] = others[:, PARTS[part]]
            cost, count = (each.copy() for each in objective.judged(poses, PARTS[part]))
            whole = objective.judged(poses)
            np.testing.assert_array_equal(cost, whole[0])
            np.testing.assert_array_equal(count, whole[1])


@pytest.mark.parametrize("renderer", RENDERERS)
@pytest.mark.parametrize("part", PARTS)
def test_only_what_moves_is_posed(device, part, renderer):
    subject, rig = synthetic_subject(), ring_rig(cameras=2, size=(97, 61))
    base, poses = held_apart(part)
    objective = objective_of(subject, rig, 12, renderer=renderer, device=device)
    objective.hold(on(device, base), PARTS[part])
    objective._posed.fill_(np.nan)
    costs(objective, poses)
    posed = np.isfinite(objective._posed.numpy()).all(axis=(0, 2))
    mesh = subject.body.tracking
    moved = np.any(SKELETON.moved_by(PARTS[part])[mesh.joint] & (mesh.weight > 0), axis=1)
    assert posed[moved].all()
    if part == "root":
        assert posed.all()
    elif part == "left arm":  # the box around a bone beyond the torso is the furthest that a triangle reaches
        legs = [JOINTS.index(name) for name in JOINTS if name[1:] in ("Hip", "Knee", "Ankle")]
        assert not posed[np.isin(mesh.joint[:, 0], legs)].any()


def test_bodies_that_are_shaped_are_never_held(device):
    """Their vertices move with their shape: nothing stays, and no pose is overwritten."""
    space = ShapeSpace(with_a_pair(synthetic_body()), "+y")
    rig = ring_rig(cameras=2, size=(97, 61))
    objective = Objective(space.body, np.eye(3), rig, 5, shapes=space, device=device)
    objective.observe(Observation.from_masks(random_masks(rig.size)))
    coordinates = np.zeros((5, len(space)))
    coordinates[:, :COORDINATES] = random_poses(5, reach=0.2)
    coordinates[:, space.scale_index] = np.log([1.0, 1.1, 0.9, 0.7, 1.3])
    expected = costs(objective, coordinates)
    before = objective.pose.numpy().copy()
    objective.hold(on(device, 1 + coordinates[:1]), np.r_[PARTS["left arm"], space.scale_index])
    np.testing.assert_array_equal(objective.pose.numpy(), before)
    np.testing.assert_array_equal(costs(objective, coordinates), expected)


# Bases and bodies of their own


@pytest.mark.parametrize("part", [None, "torso and head"])
@pytest.mark.parametrize("threads", [1, 2, 5])
def test_runs_may_have_bases_of_their_own(device, threads, part):
    """A run's candidates cost what they cost in an objective with its base, held or not, however threads share them."""
    subject, rig = synthetic_subject(), ring_rig(cameras=2, size=(97, 61))
    turned = [subject.root_base @ reference.rotation(1, angle) for angle in (0.0, 1.0, -2.5)]
    seen = Observation.from_masks(random_masks(rig.size))
    start, poses = held_apart(part or "torso and head")
    together = objective_of(subject, rig, 12, bases=3, device=device, threads=threads)
    together.body.root_base.assign(np.stack(turned).astype(np.float32))
    together.observe(seen)
    if part:
        together.hold(on(device, start), PARTS[part])
    found = costs(together, poses).reshape(3, 4)
    for run, root_base in enumerate(turned):
        alone = objective_of(replace(subject, root_base=root_base), rig, 4, device=device)
        alone.observe(seen)
        np.testing.assert_array_equal(costs(alone, poses[4 * run : 4 * run + 4]), found[run])


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
    coordinates[:, :COORDINATES] = random_poses(5, reach=0.2, bend=0.4)
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
    objective = objective_of(subject, rig, 3)
    for candidates in (0, 4):
        with pytest.raises(ValueError, match=r"candidates must be in 1\.\.3"):
            objective.evaluate(candidates)
    with pytest.raises(ValueError, match="masks are packed as"):
        objective.observe(Observation.from_masks([np.ones((120, 160), bool)]))


@pytest.mark.parametrize("renderer", RENDERERS)
def test_pixels_that_may_hide_the_subject_count_nowhere(device, renderer):
    """Also where the resting piece is drawn once; a frame in which nothing is in front counts all pixels again."""
    subject, rig = synthetic_subject(), indoor_rig()
    rng = np.random.default_rng(1)
    masks, hidden = ([rng.random((h, w)) < share for w, h in ODD_SIZES] for share in (0.3, 0.4))
    index, poses = np.arange(3, 9), random_poses(4)
    poses[:, np.setdiff1d(np.arange(poses.shape[1]), index)] = poses[0, np.setdiff1d(np.arange(poses.shape[1]), index)]
    objective = objective_of(subject, rig, 4, renderer=renderer, device=device)
    objective.prepare(1, index)
    base = wp.array(poses[:1], dtype=wp.float32, device=device)
    for in_front in (hidden, None):
        objective.observe(Observation.from_masks(masks, None, in_front))
        counted = [np.ones_like(mask) for mask in masks]
        if in_front is not None:
            counted = [~there | mask for there, mask in zip(in_front, masks, strict=True)]
        for holds in (False, True):
            if holds:
                objective.hold(base, index)
            found = costs(objective, poses)
            for c, pose in enumerate(poses):
                models = perfect_masks(subject, rig, pose, device)
                models = [model & counts for model, counts in zip(models, counted, strict=True)]
                assert found[c] == pytest.approx(reference.paper_cost(models, masks), abs=FLOAT32)
