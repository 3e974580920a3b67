"""Cameras that were turned, moved, zoomed or late are found again with the body and the poses before them."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from moving_person import BODY, FPS, RIG, ROOTING, masks_at, motion

from mmocap_warp.body.rest_space import RestSpace
from mmocap_warp.calibration.adjust import camera_problem
from mmocap_warp.calibration.adjust.camera_changes import KINDS, OFFSET, Deviations, changed, difference
from mmocap_warp.calibration.adjust.camera_problem import CameraProblem, known_distance, known_height
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.contour.body_problem import BodyProblem
from mmocap_warp.contour.frame.fitter import MatchingConfig
from mmocap_warp.masks.observation import Observation, unpack_masks

SPACE = RestSpace(BODY)
FRAMES = np.arange(4, 60, 7)
WRONG = 2  # the camera that is
NONE = np.zeros(len(SPACE.names))


def solved(
    device: str,
    wrong: CameraRig,
    sigma: np.ndarray,
    late: np.ndarray | None = None,
    known=(),
    share: float = 0.02,
    grown: bool = False,
) -> np.ndarray:
    """(camera, parameter) changes that are found, from poses that are a little off; the body is known by ``share``."""
    observations = masks_at(RIG, FRAMES, np.zeros(len(RIG)) if late is None else late)
    observations = [grown_by_a_pixel(each) for each in observations] if grown else observations
    off = np.random.default_rng(0).normal(0, 0.02, (len(FRAMES), len(ROOTING.searched)))
    rooted, velocity = ROOTING.stepped(motion().rooted[FRAMES], off), motion().velocity(FRAMES)
    stages = (MatchingConfig(0.3, 0.03, 0.03), 8), (MatchingConfig(), 8)
    problem = CameraProblem(wrong, np.zeros(len(RIG)), SPACE, ROOTING, share, sigma, known)
    solution = problem.solved(observations, rooted, velocity, NONE, np.zeros(sigma.shape), stages, device, 1)
    np.testing.assert_array_equal(solution.free, sigma > 0)
    assert len(solution.covariance) == solution.free.sum()
    return solution.change


def grown_by_a_pixel(observation: Observation) -> Observation:
    """With the wrong camera's mask larger all around."""
    masks = unpack_masks(observation.words, RIG.size)
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    masks[WRONG] = cv2.dilate(masks[WRONG].astype(np.uint8), cross).astype(bool)
    return Observation.from_masks(masks)


def one_of(*kinds: str) -> np.ndarray:
    """Deviations of the wrong camera's parameters of some kinds; all else is held."""
    sigma = np.zeros((len(RIG), len(KINDS)))
    wanted = [KINDS.index(kind) for kind in kinds]
    sigma[WRONG, wanted] = Deviations().of(RIG)[WRONG, wanted]
    return sigma


@pytest.mark.parametrize(
    ("kinds", "by", "within"),
    [
        (("tilt", "pan", "roll"), np.radians([2.0, -2.0, 2.0]), np.radians(0.1)),
        (("right", "down", "ahead"), np.array([0.08, 0.05, -0.1]), 0.005),
        (("focal",), np.array([0.03]), 0.003),
        (("centre_x", "centre_y"), np.array([8.0, -6.0]), 0.5),
    ],
)
def test_a_camera_is_found_again(device, kinds, by, within):
    planted = np.zeros((len(RIG), len(KINDS)))
    planted[WRONG, [KINDS.index(kind) for kind in kinds]] = by
    wrong = changed(RIG, planted)
    found = solved(device, wrong, one_of(*kinds))
    left = difference(RIG, changed(wrong, found))
    assert np.abs(left[WRONG, [KINDS.index(kind) for kind in kinds]]).max() < within
    np.testing.assert_array_equal(found[np.arange(len(RIG)) != WRONG], 0.0)


def test_a_camera_that_is_late_is_found_to_a_fraction_of_a_frame(device):
    late = np.zeros(len(RIG))
    late[WRONG] = 0.6
    found = solved(device, RIG, one_of("offset"), late=late)
    assert found[WRONG, OFFSET] * FPS == pytest.approx(0.6, abs=0.1)


def test_what_is_held_keeps_its_bits_and_a_scene_without_fault_stays(device):
    found = solved(device, RIG, one_of("tilt", "pan", "focal"))
    assert np.degrees(np.abs(found[WRONG, :2]).max()) < 0.05
    assert abs(found[WRONG, KINDS.index("focal")]) < 0.002
    assert not found[WRONG, 2:6].any()


@pytest.mark.parametrize(("kind", "within"), [("focal", 0.003), ("ahead", 0.01)])
def test_larger_masks_are_not_taken_for_a_longer_lens_or_a_nearer_camera(device, kind, within):
    found = solved(device, RIG, one_of(kind), grown=True)
    assert abs(found[WRONG, KINDS.index(kind)]) < within


def height() -> float:
    rest = BODY.skin.rest[:, 1]
    return float(np.ptp(rest))


@pytest.mark.parametrize("known", ["height", "distance"])
def test_a_known_length_gives_the_scale(device, known):
    """All cameras but one may move and the person may be of any size: without it the prior would hold both."""
    grown = 1.04
    t = -np.einsum("kij,kj->ki", RIG.R, grown * (RIG.centres - RIG.centres[0]) + RIG.centres[0])
    wrong = CameraRig(RIG.names, RIG.K, RIG.R, t, RIG.size, RIG.distortion, RIG.up)
    sigma = np.zeros((len(RIG), len(KINDS)))
    sigma[1:, 3:6] = 0.3
    true = float(np.linalg.norm(RIG.centres[1] - RIG.centres[0]))
    length = known_height(SPACE, height()) if known == "height" else known_distance(wrong, 0, 1, true)
    found = changed(wrong, solved(device, wrong, sigma, known=(length,), share=0.3))
    assert float(np.linalg.norm(found.centres[1] - found.centres[0])) == pytest.approx(true, abs=0.03)


def test_a_known_length_costs_by_how_much_it_is_missed(device):
    """By two millimetres for each of its deviations, once for all frames."""
    sigma, frames = np.zeros((len(RIG), len(KINDS))), FRAMES[:2]
    observations, there = masks_at(RIG, frames, np.zeros(len(RIG))), motion().rooted[frames]

    def cost(*known) -> float:
        problem = CameraProblem(RIG, np.zeros(len(RIG)), SPACE, ROOTING, 0.3, sigma, known)
        velocity = motion().velocity(frames)
        as_it_is = ((MatchingConfig(), 0),)
        return problem.solved(observations, there, velocity, NONE, sigma, as_it_is, device, 1).cost

    known = cost(known_height(SPACE, height() + 0.006))
    assert known - cost() == pytest.approx(0.5 * 3.0**2 / len(frames), rel=1e-4)


def test_the_person_may_differ_from_the_expected_body_by_a_share_of_what_people_do(device, monkeypatch):
    """And cameras by their own deviations; last of each camera comes the margin of its masks."""
    prior: list[np.ndarray] = []

    def spied(*given):
        prior.append(given[-1])
        return BodyProblem(*given)

    monkeypatch.setattr(camera_problem, "BodyProblem", spied)
    sigma, frames = one_of("pan", "focal"), FRAMES[:2]
    problem = CameraProblem(RIG, np.zeros(len(RIG)), SPACE, ROOTING, 0.3, sigma)
    observations, rooted = masks_at(RIG, frames, np.zeros(len(RIG))), motion().rooted[frames]
    as_it_is = ((MatchingConfig(), 0),)
    velocity = motion().velocity(frames)
    problem.solved(observations, rooted, velocity, NONE, np.zeros(sigma.shape), as_it_is, device, 1)
    np.testing.assert_allclose(prior[0][: len(NONE)], 0.3 * SPACE.sigma)
    np.testing.assert_allclose(prior[0][len(NONE) :], [1.0, 1.0, *sigma[WRONG][sigma[WRONG] > 0], 1.0, 1.0])
