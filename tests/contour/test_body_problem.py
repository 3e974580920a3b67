"""A body is found with the poses it is seen in, near the generic one where it isn't seen, and says how surely."""

from __future__ import annotations

import numpy as np
import pytest
from planted import swung
from synthetic import synthetic_body

from mmocap_warp.body.skeleton import ROOT_ANGLES
from mmocap_warp.contour.body_problem import BodyProblem, BodySolution
from mmocap_warp.contour.clip.motion_points import MotionPoints
from mmocap_warp.contour.frame.normal_equations import NormalEquations
from mmocap_warp.contour.frame.rooted import RootedPoses, Rooting

BODY = synthetic_body()
SKELETON = BODY.skeleton
SEARCHED = SKELETON.searched()
DOF = len(SEARCHED)
ROOTING = Rooting(SKELETON, np.eye(3), SEARCHED)
FRAMES = np.array([3, 8, 11, 20])
TRUTH = np.array([0.4, -0.5, 0.3, 0.0])
SIGMA = np.array([1.0, 1.0, 1.0, 0.5])
PARAMETERS = len(TRUTH)


def points_of(beta: np.ndarray) -> MotionPoints:
    """Of a body whose thighs, shins and upper arms are longer; the last parameter changes nothing."""
    rest = BODY.joint_rest.astype(float)
    for parameter, names in enumerate((("LKnee", "RKnee"), ("LAnkle", "RAnkle"), ("LElbow", "RElbow"))):
        for name in names:
            joint = SKELETON.index(name)
            bone = BODY.joint_rest[joint] - BODY.joint_rest[SKELETON.parent[joint]]
            below = [j for j in range(len(rest)) if j == joint or SKELETON.parent[j] == joint]
            rest[below] += 0.1 * beta[parameter] * bone / np.linalg.norm(bone)
    return MotionPoints(SKELETON, rest, SEARCHED)


class PlantedBody:
    """Normal equations of the distances to where the true body's points are."""

    def __init__(self, true_poses: RootedPoses, sigma: float = 0.002) -> None:
        self._target, self._sigma = points_of(TRUTH).at(true_poses), sigma

    def __call__(self, frames: np.ndarray, rooted: RootedPoses, beta: np.ndarray) -> NormalEquations:
        assert (frames == FRAMES).all()
        points, by_pose = points_of(beta).linearised(rooted)
        by_beta = [(points_of(beta + s).at(rooted) - points_of(beta - s).at(rooted)) / 2 for s in np.eye(PARAMETERS)]
        derivative = np.concatenate([by_pose, np.stack(by_beta, axis=-1)], axis=-1)
        rows = derivative.reshape(len(frames), -1, DOF + PARAMETERS) / self._sigma
        error = (self._target - points).reshape(len(frames), -1) / self._sigma
        across = np.swapaxes(rows, 1, 2)
        return NormalEquations(across @ rows, (across @ error[..., None])[..., 0], 0.5 * (error**2).sum(axis=1))


@pytest.fixture(scope="module")
def true_poses() -> RootedPoses:
    return ROOTING.enter(swung(BODY, 30, 60.0)[FRAMES])


def solved(true_poses: RootedPoses, **changes) -> BodySolution:
    linearise = changes.pop("linearise", PlantedBody(true_poses))
    off = np.random.default_rng(0).normal(0, 0.05, (len(FRAMES), DOF))
    problem = BodyProblem(linearise, ROOTING, np.zeros(PARAMETERS), SIGMA)
    return problem.solved(FRAMES, ROOTING.stepped(true_poses, off), np.full(PARAMETERS, 0.2), **changes)


def test_body_and_poses_are_found_together(true_poses):
    solution = solved(true_poses)
    np.testing.assert_allclose(solution.beta, TRUTH, atol=2e-3)
    where = points_of(solution.beta).at(solution.rooted) - points_of(TRUTH).at(true_poses)
    assert np.abs(where).max() < 1e-3
    assert solution.cost.shape == FRAMES.shape


def test_what_no_frame_shows_goes_to_the_generic_body_and_is_as_unsure_as_before(true_poses):
    solution = solved(true_poses)
    assert solution.beta[3] == pytest.approx(0.0, abs=1e-9)
    assert np.sqrt(solution.covariance[3, 3]) == pytest.approx(SIGMA[3])


def test_the_covariance_is_a_block_of_the_whole_inverse(true_poses):
    linearise = PlantedBody(true_poses)
    solution = solved(true_poses, linearise=linearise)
    equations = linearise(FRAMES, solution.rooted, solution.beta)
    size = len(FRAMES) * DOF
    whole = np.zeros((size + PARAMETERS, size + PARAMETERS))
    whole[size:, size:] = np.diag(SIGMA**-2.0) + equations.matrix[:, DOF:, DOF:].sum(axis=0)
    for frame, matrix in enumerate(equations.matrix):
        own = slice(frame * DOF, (frame + 1) * DOF)
        whole[own, own] = equations.with_prior(ROOTING.anywhere**-2.0)[frame]
        whole[own, size:], whole[size:, own] = matrix[:DOF, DOF:], matrix[DOF:, :DOF]
    np.testing.assert_allclose(solution.covariance, np.linalg.inv(whole)[size:, size:], rtol=1e-6, atol=1e-12)


def test_the_cost_does_not_rise_from_a_bad_start(true_poses):
    costs = []

    class Watched(PlantedBody):
        def __call__(self, frames, rooted, beta):
            equations = super().__call__(frames, rooted, beta)
            costs.append(equations.cost.sum() + 0.5 * ((beta / SIGMA) ** 2).sum())
            return equations

    solution = solved(true_poses, linearise=Watched(true_poses), steps=5)
    found = solution.cost.sum() + 0.5 * ((solution.beta / SIGMA) ** 2).sum()
    assert found == min(costs)
    assert len(costs) == 6


def test_no_parameter_moves_further_in_a_step_than_three_of_its_own_deviations(true_poses):
    seen = []

    class Watched(PlantedBody):
        def __call__(self, frames, rooted, beta):
            seen.append(beta)
            return super().__call__(frames, rooted, beta)

    sigma = np.array([0.02, 1.0, 1.0, 0.5])
    problem = BodyProblem(Watched(true_poses), ROOTING, np.zeros(PARAMETERS), sigma)
    solution = problem.solved(FRAMES, true_poses, np.zeros(PARAMETERS))
    moved = np.abs(np.diff(seen, axis=0)).max(axis=0)
    assert moved[0] == pytest.approx(0.06)
    assert moved[1] > 0.4
    np.testing.assert_allclose(solution.beta[:3], TRUTH[:3], atol=0.03)  # which is 20 deviations from the generic one


def test_a_base_that_stands_still_is_found_once_for_all_frames(true_poses):
    """From a base that is off by the same in all frames, and joints that are off by chance in each."""
    pose, base = true_poses.pose.copy(), np.tile(true_poses.base[:1], (len(FRAMES), 1, 1))
    pose[:, : ROOT_ANGLES.stop] = pose[0, : ROOT_ANGLES.stop]
    true = RootedPoses(base, pose)
    off = np.random.default_rng(1).normal(0, 0.05, (len(FRAMES), DOF))
    off[:, : ROOT_ANGLES.stop] = off[0, : ROOT_ANGLES.stop]
    problem = BodyProblem(PlantedBody(true), ROOTING, np.zeros(PARAMETERS), SIGMA, still=ROOT_ANGLES.stop)
    solution = problem.solved(FRAMES, ROOTING.stepped(true, off), np.full(PARAMETERS, 0.2))
    np.testing.assert_allclose(solution.beta, TRUTH, atol=2e-3)
    np.testing.assert_array_equal(solution.rooted.base, np.tile(solution.rooted.base[:1], (len(FRAMES), 1, 1)))
    np.testing.assert_allclose(solution.rooted.base[0], true.base[0], atol=1e-3)
    np.testing.assert_allclose(solution.rooted.pose[:, SEARCHED], true.pose[:, SEARCHED], atol=3e-3)
    assert solution.covariance.shape == (PARAMETERS, PARAMETERS)


def test_a_step_that_the_bodys_prior_outweighs_is_not_taken(true_poses):
    """Contours promise more than they keep: their cost hardly falls, and the body would be 1.2 deviations away."""

    def promising(frames: np.ndarray, rooted: RootedPoses, beta: np.ndarray) -> NormalEquations:
        size = DOF + PARAMETERS
        gradient = np.zeros((len(frames), size))
        gradient[:, DOF] = 0.9
        matrix = np.tile(np.diag([1.0] * DOF + [0.5] * PARAMETERS), (len(frames), 1, 1))
        return NormalEquations(matrix, gradient, np.full(len(frames), 1.0 - 0.01 * beta[0]))

    problem = BodyProblem(promising, ROOTING, np.zeros(PARAMETERS), SIGMA)
    solution = problem.solved(FRAMES, true_poses, np.zeros(PARAMETERS), steps=1)
    np.testing.assert_array_equal(solution.beta, 0.0)
