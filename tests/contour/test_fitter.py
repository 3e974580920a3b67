"""The fitter's steps never cost more, its equations are the sums over views, and nobody's bits depend on neighbours."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from other_bodies import arm_robot, burdened, quadruped
from synthetic import ring_rig, synthetic_body, synthetic_subject

from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.rest_space import RestSpace
from mmocap_warp.cameras.silhouette import silhouettes
from mmocap_warp.contour.frame.fitter import ContourFitter
from mmocap_warp.contour.frame.rooted import RootedPoses
from mmocap_warp.kernels.contour.descent import MOST_SEARCHED
from mmocap_warp.masks.observation import Observation
from mmocap_warp.synthesis.exact_posing import ExactPoser

BODIES = {"person": synthetic_body(), "dog": quadruped(), "arm": arm_robot(), "burdened": burdened()}
RIG = ring_rig(3, size=(320, 240))
HOME = synthetic_subject().root_base


def observed(body: BodyModel, pose: np.ndarray, rig=RIG) -> Observation:
    vertices = ExactPoser(body, HOME).vertices(pose[None])[0][body.tracking_vertex]
    return Observation.from_masks(silhouettes(rig, vertices, body.tracking_face))


def poses_of(body: BodyModel, n: int, seed: int = 0) -> np.ndarray:
    """(n, coordinate) within the limits, upright and a little different."""
    rng = np.random.default_rng(seed)
    pose = np.zeros((n, body.skeleton.coordinates))
    index = body.skeleton.searched()
    low, high = np.clip(body.skeleton.coordinate_limits[index].T, -0.3, 0.3)
    pose[:, index] = rng.uniform(low, high, (n, len(index)))
    pose[:, :3] *= 0.3
    pose[:, 1] += 0.7
    return pose


def fitter_of(body: BodyModel, device: str, candidates: int, rig=RIG, **more) -> ContourFitter:
    skeleton = body.skeleton
    return ContourFitter(
        body, rig, skeleton.searched(), skeleton.coordinate_limits, candidates=candidates, device=device, **more
    )


def start(fitter: ContourFitter, pose: np.ndarray, place: np.ndarray | None = None) -> None:
    n = len(pose)
    fitter.start_at(pose, np.tile(HOME, (n, 1, 1)), np.zeros(n, int) if place is None else place)


@pytest.mark.parametrize("name", BODIES)
def test_steps_never_cost_more_and_find_what_was_seen(device, name):
    body = BODIES[name]
    seen = poses_of(body, 1, seed=5)[0]
    index = body.skeleton.searched()
    beside = np.tile(seen, (4, 1))
    beside[:, index] += np.random.default_rng(1).normal(0, 0.03, (4, len(index)))
    low, high = body.skeleton.coordinate_limits.T
    fitter = fitter_of(body, device, 4)
    fitter.observe(0, observed(body, seen))
    costs = []
    for steps in range(7):
        start(fitter, beside)
        fitter.descend(4, steps)
        costs.append(fitter.descent.cost.numpy().copy())
    assert (np.diff(costs, axis=0) <= 0).all()
    best = fitter.descent.best.numpy()
    assert (best >= low.astype(np.float32)).all()
    assert (best <= high.astype(np.float32)).all()
    held = np.setdiff1d(np.arange(body.skeleton.coordinates), index)
    np.testing.assert_array_equal(best[:, held], beside[:, held].astype(np.float32))
    if name == "arm":  # its outline is a few long edges, of which only the middles are looked at
        return
    assert (costs[6] < 0.5 * costs[0]).all()
    poser = ExactPoser(body, HOME)
    truth = poser.vertices(seen[None])[0]

    def off(poses: np.ndarray) -> np.ndarray:
        return np.linalg.norm(poser.vertices(poses) - truth, axis=2).mean(axis=1)

    assert (off(best.astype(float)) < 0.5 * off(beside)).all()


def test_the_cost_of_the_best_is_its_own(device):
    """Data and pull, anew from the pose."""
    body = BODIES["person"]
    fitter = fitter_of(body, device, 2)
    seen = poses_of(body, 1, seed=5)[0]
    fitter.observe(0, observed(body, seen))
    beside = poses_of(body, 2, seed=6) * 0.2 + seen * 0.8
    start(fitter, beside)
    fitter.descend(2, 4)
    descent = fitter.descent
    best, cost, tally = (array.numpy().copy() for array in (descent.best, descent.cost, descent.tally))
    away = (best - beside.astype(np.float32))[:, fitter.index].astype(float)
    pulled = (descent.pull.numpy() * away**2).sum(axis=1)
    np.testing.assert_allclose(cost, tally[..., 0].sum(axis=1) + pulled, rtol=1e-5)
    again = fitter.linearise(np.zeros(2, int), RootedPoses(np.tile(HOME, (2, 1, 1)), best.astype(float)))
    np.testing.assert_allclose(again.cost, 0.5 * tally[..., 0].sum(axis=1), rtol=1e-5)


def test_outline_farther_from_its_mask_than_a_hands_breadth_is_exposed(device):
    """By default more than 4 cm: none of a body in its own masks, nor of one that is 2 cm away; an arm elsewhere is."""
    body = BODIES["person"]
    fitter = fitter_of(body, device, 4)
    seen = poses_of(body, 1, seed=5)[0]
    fitter.observe(0, observed(body, seen))
    poses = np.tile(seen, (4, 1))
    poses[1, 1] += 0.02
    poses[2, 1] += 0.07
    poses[3, body.skeleton.angles("LShoulder")] += [0.0, 1.2, 0.0]
    start(fitter, poses)
    fitter.descend(4, 0)
    exposed = fitter.descent.tally.numpy()[:, :, 3].sum(axis=1)
    np.testing.assert_array_equal(exposed[:2], 0.0)
    assert (exposed[2:] > 0.1).all()


def test_the_equations_are_a_model_of_the_cost(device):
    """A short step changes the cost as they say, mostly: now and then an edge appears, or another match."""
    body, n, rig = BODIES["person"], 30, ring_rig(3)
    fitter = fitter_of(body, device, n, rig=rig)
    seen = poses_of(body, 1, seed=5)[0]
    fitter.observe(0, observed(body, seen, rig))
    pose = np.tile(seen, (n, 1))
    pose[:, fitter.index] += np.random.default_rng(0).normal(0, 0.02, (n, len(fitter.index)))
    base, place = np.tile(HOME, (n, 1, 1)), np.zeros(n, int)
    equations = fitter.linearise(place, RootedPoses(base, pose))
    matrix, gradient = equations.matrix, equations.gradient
    np.testing.assert_array_equal(matrix, np.swapaxes(matrix, 1, 2))
    assert (np.linalg.eigvalsh(matrix)[:, 0] > -1e-6 * np.linalg.eigvalsh(matrix)[:, -1]).all()
    assert (equations.cost > 0).all()
    damped = matrix + 0.01 * matrix * np.eye(len(fitter.index)) + np.eye(len(fitter.index))
    step = 0.05 * np.linalg.solve(damped, gradient[..., None])[..., 0]
    pose[:, fitter.index] += step
    after = fitter.linearise(place, RootedPoses(base, pose)).cost
    fall = (gradient * step).sum(axis=1) - np.einsum("ci,cij,cj->c", step, matrix, step) / 2
    assert (fall > 0.005 * equations.cost).all()
    assert np.median((equations.cost - after) / fall) == pytest.approx(1.0, abs=0.25)


@pytest.mark.parametrize("name", BODIES)
def test_the_bits_depend_on_neither_threads_nor_neighbours(device, name):
    """A candidate alone, in a batch, and with any number of CPU threads; parameters of the rest body too."""
    body = BODIES[name]
    space = RestSpace(body)
    vertex, joint = space.basis(np.zeros(len(space.names)), body.tracking_vertex)
    rig = ring_rig(2, (160, 120))
    frames = [observed(body, pose, rig) for pose in poses_of(body, 2, seed=3)]
    poses, place = poses_of(body, 5, seed=4), np.array([0, 1, 1, 0, 1])
    rooted = RootedPoses(np.tile(HOME, (5, 1, 1)), poses)

    def answers(candidates: int, threads: int) -> list[np.ndarray]:
        fitter = fitter_of(body, device, candidates, frames=2, parameters=len(space.names), threads=threads, rig=rig)
        for number, frame in enumerate(frames):
            fitter.observe(number, frame)
        fitter.set_change(vertex, joint)
        equations = fitter.linearise(place, rooted)
        descents = []
        for first in range(0, 5, candidates):
            part = slice(first, min(first + candidates, 5))
            start(fitter, poses[part], place[part])
            fitter.descend(part.stop - part.start, 3)
            descents.append(fitter.descent.best.numpy()[: part.stop - part.start].copy())
        return [equations.matrix, equations.gradient, equations.cost, np.concatenate(descents)]

    together = answers(5, 1)
    others = [(1, 1), (2, 1)] + ([(5, 2), (5, 3), (3, 8)] if device == "cpu" else [])
    for candidates, threads in others:
        for one, other in zip(together, answers(candidates, threads), strict=True):
            np.testing.assert_array_equal(one, other)


def test_descents_are_the_same_again_and_again(device, monkeypatch):
    """Of any kind in any order, with larger masks in between, whose fields move: on a GPU graphs are replayed."""
    monkeypatch.setattr("mmocap_warp.contour.frame.fields.MOST_WHOLE", 0)
    body, near = BODIES["person"], ring_rig(3, size=(320, 240), distance=2.5)
    poses, seen = poses_of(body, 3, seed=8), poses_of(body, 1, seed=9)[0]
    small, large = observed(body, seen + 4.0 * np.eye(len(seen))[2], near), observed(body, seen, near)
    fitter = fitter_of(body, device, 3, rig=near)
    arrays = set()

    def again(frame: Observation, count: int, steps: int, fitter: ContourFitter) -> list[np.ndarray]:
        fitter.observe(0, frame)
        start(fitter, poses[:count])
        fitter.descend(count, steps)
        descent = fitter.descent
        return [array.numpy()[:count].copy() for array in (descent.best, descent.cost, descent.tally)]

    for frame, count, steps in ((0, 3, 2), (0, 3, 2), (0, 2, 2), (1, 3, 2), (0, 3, 2), (1, 3, 3), (1, 3, 3), (1, 2, 2)):
        observation = (small, large)[frame]
        expected = again(observation, count, steps, fitter_of(body, device, 3, rig=near))
        for one, other in zip(again(observation, count, steps, fitter), expected, strict=True):
            np.testing.assert_array_equal(one, other)
        arrays.add(fitter.fields.struct.value.ptr)
    assert len(arrays) > 1


def test_a_processor_packs_arguments_once(monkeypatch):
    body = BODIES["person"]
    fitters = [fitter_of(body, "cpu", 4, threads=2) for _ in range(2)]
    poses = [poses_of(body, 4, seed=seed) for seed in (5, 6)]
    for fitter in fitters:
        fitter.observe(0, observed(body, poses[0][0]))
    start(fitters[1], poses[1])
    fitters[1].descend(4, 2)
    start(fitters[0], poses[0])
    fitters[0].descend(4, 2)
    monkeypatch.setattr(wp, "launch", None)
    start(fitters[0], poses[1])
    fitters[0].descend(4, 2)
    best, expected = (fitter.descent.best.numpy() for fitter in fitters)
    np.testing.assert_array_equal(best, expected)


def test_a_frame_without_foreground_changes_nothing(device):
    body = BODIES["person"]
    fitter = fitter_of(body, device, 1)
    masks = [np.zeros((240, 320), bool) for _ in range(3)]
    fitter.observe(0, Observation.from_masks(masks))
    pose = poses_of(body, 1)
    start(fitter, pose)
    fitter.descend(1, 3)
    np.testing.assert_array_equal(fitter.descent.best.numpy(), pose.astype(np.float32))
    assert not fitter.descent.tally.numpy().any()
    equations = fitter.linearise(np.zeros(1, int), RootedPoses(HOME[None], pose))
    assert not equations.matrix.any()
    assert not equations.observed.any()


def test_what_is_not_seen_is_pulled_to_the_start(device):
    """A hand hidden by every mask stays; a strong pull holds the whole body."""
    body = BODIES["person"]
    seen = poses_of(body, 1, seed=5)[0]
    pose = seen + 0.02 * np.isin(np.arange(len(seen)), body.skeleton.searched())
    moved = []
    for factor in (1.0, 1e8):
        fitter = fitter_of(body, device, 1)
        fitter.observe(0, observed(body, seen))
        fitter.descent.pull.assign(fitter.descent.pull.numpy() * np.float32(factor))
        start(fitter, pose[None])
        fitter.descend(1, 4)
        moved.append(np.abs(fitter.descent.best.numpy()[0] - pose.astype(np.float32)).max())
    assert moved[0] > 0.01
    assert moved[1] < 1e-4


def test_a_fitter_takes_another_rest_body(device):
    body = BODIES["person"]
    other = body.shaped({"height_incr": 0.8}, 1.0)
    seen = poses_of(body, 1, seed=5)[0]
    frame = observed(other, seen)
    costs = []
    for fitter in (fitter_of(body, device, 1), fitter_of(other, device, 1)):
        fitter.reshape(other.tracking.rest, other.joint_rest)
        fitter.observe(0, frame)
        costs.append(fitter.linearise(np.zeros(1, int), RootedPoses(HOME[None], seen[None])).cost[0])
    assert costs[0] == costs[1]


def test_bad_bodies_are_refused():
    body = BODIES["dog"]
    opened = replace(body, tracking_face=body.tracking_face[1:])
    with pytest.raises(ValueError, match="must be closed"):
        fitter_of(opened, "cpu", 1)
    with pytest.raises(ValueError, match=f"index must have at most {MOST_SEARCHED} coordinates, got 200"):
        ContourFitter(body, RIG, np.arange(200), body.skeleton.coordinate_limits, candidates=1)


def test_no_poses_have_no_equations():
    body = BODIES["dog"]
    fitter = fitter_of(body, "cpu", 2)
    none = RootedPoses(np.zeros((0, 3, 3)), np.zeros((0, body.skeleton.coordinates)))
    equations = fitter.linearise(np.zeros(0, int), none)
    assert equations.matrix.shape == (0, len(fitter.index), len(fitter.index))
    assert equations.cost.shape == (0,)
