"""Views that are late see the skin where its motion leads: places and rows in float64, and the poses that are found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from contours import MATCHING, Contours, image_of
from synthetic import ring_rig, synthetic_body, synthetic_subject

from mmocap_warp.body.rotations import turn
from mmocap_warp.cameras.silhouette import silhouettes
from mmocap_warp.contour.frame.fitter import ContourFitter
from mmocap_warp.contour.frame.rooted import Neighbours, RootedPoses
from mmocap_warp.masks.observation import Observation
from mmocap_warp.synthesis.exact_posing import ExactPoser

BODY = synthetic_body()
HOME = synthetic_subject().root_base
RATE = 15.0
LATE = np.array([0.0, 0.021, -0.033])
RIG = ring_rig(3)


def skin(pose: np.ndarray, base: np.ndarray = HOME) -> np.ndarray:
    """(tracking vertex, 3) float64 [m]."""
    return ExactPoser(BODY, base).vertices(pose[None])[0][BODY.tracking_vertex]


def course(poses: int, seed: int = 3) -> np.ndarray:
    """(pose, coordinate) of somebody who turns and walks, bending."""
    rng = np.random.default_rng(seed)
    speed, bend = rng.normal(0, 0.05, (2, BODY.skeleton.coordinates))
    time = np.arange(poses)[:, None] - poses / 2
    moved = 0.1 * rng.standard_normal(BODY.skeleton.coordinates) + time * speed + 0.1 * time**2 * bend
    held = np.setdiff1d(np.arange(BODY.skeleton.coordinates), BODY.skeleton.searched())
    moved[:, held] = 0.0
    moved[:, 1] += 0.7
    return np.clip(moved, *BODY.skeleton.coordinate_limits.T)


def rooted(pose: np.ndarray) -> RootedPoses:
    return RootedPoses(np.tile(HOME, (len(pose), 1, 1)), pose)


def fitter_of(device: str, candidates: int, frames: int = 1) -> ContourFitter:
    skeleton = BODY.skeleton
    index, limits = skeleton.searched(), skeleton.coordinate_limits
    return ContourFitter(BODY, RIG, index, limits, candidates=candidates, frames=frames, device=device)


@pytest.mark.parametrize("own", [0.0, RATE])
def test_places_and_rows_of_late_views(device, own):
    """Rows are finite differences of where an edge's middle is seen, with velocity and bend as they are."""
    poses, rng = course(3), np.random.default_rng(1)
    velocity, bend = rng.normal(0, 0.5, (1, 3)), rng.normal(0, 2.0, (1, 3))
    base = turn("y", 0.4) @ HOME
    case = Contours(BODY, RIG, poses[1:2], base[None], device, late=LATE, matching=MATCHING | {"reach": 0.5})
    vertices = len(BODY.tracking.rest)
    held = np.tile(velocity, (vertices, 1)) - own * skin(poses[0], base)
    case.moving.own = own
    case.moving.velocity.assign(held[None].astype(np.float32))
    case.moving.bend.assign(np.tile(bend, (1, vertices, 1)).astype(np.float32))

    def seen(k: int, pose: np.ndarray) -> np.ndarray:
        place = skin(pose, base)
        return place + LATE[k] * (own * place + held) + LATE[k] ** 2 * bend

    case.summed(silhouettes(RIG, skin(poses[1] + 0.01, base), BODY.tracking_face))
    for k in range(len(RIG)):
        np.testing.assert_allclose(
            case.outline.image.numpy()[0, k, :, :2], image_of(RIG, k, seen(k, poses[1])), atol=0.01
        )
        count = case.outline.count.numpy()[0, k]
        counts = np.flatnonzero(case.residuals.weighted.numpy()[0, k, :count, 1] > 0)
        assert len(counts) > 15
        ends = case.outline.ends.numpy()[0, k, counts]
        normal = case.residuals.normal.numpy()[0, k, counts].astype(float)
        rows = case.rows_of(0, k)[counts]
        for column, coordinate in enumerate(case.index):
            sides = []
            for step in (1e-5, -1e-5):
                pose = poses[1].copy()
                pose[coordinate] += step
                points = seen(k, pose)
                sides.append((image_of(RIG, k, points[ends].mean(axis=1)) * normal).sum(axis=1))
            expected = (sides[0] - sides[1]) / 2e-5
            np.testing.assert_allclose(rows[:, column], expected, atol=2e-3 * max(np.abs(expected).max(), 1.0))


def test_the_parabola_through_three_poses(device):
    poses = course(4)
    fitter = fitter_of(device, 4)
    around = Neighbours.of(rooted(poses), np.arange(4), RATE)
    fitter.move(rooted(poses), around)
    velocity, bend = fitter._moving.velocity.numpy().astype(float), fitter._moving.bend.numpy().astype(float)
    places = [skin(pose) for pose in poses]
    for frame in (1, 2):
        for other in (-1, 1):
            time = other / RATE
            there = places[frame] + time * velocity[frame] + time**2 * bend[frame]
            np.testing.assert_allclose(there, places[frame + other], atol=1e-5)
    for end, beside in ((0, 1), (3, 2)):
        np.testing.assert_allclose(bend[end], 0.0)
        there = places[end] + (beside - end) / RATE * velocity[end]
        np.testing.assert_allclose(there, places[beside], atol=1e-5)
    fitter.move(rooted(poses), replace(around, curved=False, sides=np.zeros(4, np.int32)))
    np.testing.assert_array_equal(fitter._moving.velocity.numpy(), 0.0)


def moving_masks(poses: np.ndarray, frame: int) -> Observation:
    """The masks of a frame of a course whose skin moves on straight lines between poses."""
    masks = []
    for k, late in enumerate(LATE):
        share, other = abs(late) * RATE, frame + (1 if late > 0 else -1)
        points = (1 - share) * skin(poses[frame]) + share * skin(poses[other])
        masks.append(silhouettes(RIG, points, BODY.tracking_face)[k])
    return Observation.from_masks(masks, LATE)


def test_following_finds_the_pose_of_the_frame_and_not_of_the_views(device):
    poses = course(3)
    seen = moving_masks(poses, 1)
    off = []
    for observation in (replace(seen, late=None), seen):
        fitter = fitter_of(device, 1)
        fitter.observe(0, observation)
        if fitter.late:
            fitter.follow(poses[:1], HOME[None], RATE)
        fitter.start_at(poses[1:2], HOME[None], np.zeros(1, int))
        fitter.descend(1, 8)
        off.append(np.linalg.norm(skin(fitter.descent.best.numpy()[0].astype(float)) - skin(poses[1]), axis=1).mean())
    assert off[1] < 0.4 * off[0]
    assert off[1] < 0.006


def test_the_true_course_of_a_clip_costs_least_with_its_motion(device):
    poses = course(5)
    frames = np.arange(1, 4)
    fitter = fitter_of(device, 3, frames=3)
    fitter.observe_all([moving_masks(poses, frame) for frame in frames])
    there = rooted(poses)
    still = fitter.linearise(np.arange(3), there[1:4]).cost
    moved = fitter.linearise(np.arange(3), there[1:4], Neighbours.of(there, frames, RATE)).cost
    assert (moved < 0.3 * still).all()


def test_views_in_time_keep_their_bits(device):
    """Once a late frame was observed, frames in time are fitted as by a fitter that never saw one."""
    poses = course(3)
    seen = moving_masks(poses, 1)
    fresh, used = fitter_of(device, 1), fitter_of(device, 1)
    used.observe(0, seen)
    used.follow(poses[:1], HOME[None], RATE)
    costs = []
    for fitter in (fresh, used):
        fitter.observe(0, replace(seen, late=None))
        assert not fitter.late
        fitter.start_at(poses[1:2], HOME[None], np.zeros(1, int))
        fitter.descend(1, 4)
        costs.append((fitter.descent.best.numpy().tobytes(), fitter.descent.cost.numpy().tobytes()))
    assert costs[0] == costs[1]
