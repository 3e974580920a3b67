"""Standard deviations: of the dense inverse, of repeated noise, and wide where nothing is seen."""

from __future__ import annotations

import numpy as np
from planted import Planted, dense, swung
from synthetic import synthetic_body

from mmocap_warp.body.rotations import turn
from mmocap_warp.contour import clip, uncertainty
from mmocap_warp.contour.clip import ACCELERATION, ClipProblem
from mmocap_warp.contour.motion_penalty import MotionPenalty
from mmocap_warp.contour.normal_equations import NormalEquations
from mmocap_warp.contour.rooted import RootedPoses, Rooting
from mmocap_warp.contour.uncertainty import Deviations, Uncertainty, marginal_covariance

BODY = synthetic_body()
SKELETON = BODY.skeleton
DOF = len(SKELETON.searched())


def clip_of(frames: int, sigma: np.ndarray | float) -> tuple[ClipProblem, RootedPoses]:
    rooting = Rooting(SKELETON, turn("x", 1.3), SKELETON.searched())
    rooted = rooting.enter(swung(BODY, frames, 60.0))
    planted = Planted(BODY, rooting, np.zeros((frames, 1)), sigma)
    planted.target = planted.points.at(rooted)
    return ClipProblem(planted, rooting, planted.points, 60.0), rooted


def stated_by(problem: ClipProblem, rooted: RootedPoses) -> Uncertainty:
    deviations = Deviations(problem, ACCELERATION)
    pieces = [deviations.of(window) for window in problem.windows(rooted)]
    pose, joint = zip(*((piece.pose, piece.joint) for piece in pieces), strict=True)
    return Uncertainty(np.concatenate(pose), np.concatenate(joint))


def test_covariances_are_those_of_the_dense_inverse():
    problem, rooted = clip_of(7, 0.004)
    contour = problem.linearise(np.arange(7), rooted)
    motion = MotionPenalty(ACCELERATION, 60.0).around(*problem.points.linearised(rooted), contour.observed)
    whole = np.linalg.inv(dense(motion.band + contour.with_prior(problem.rooting.anywhere**-2.0)))
    expected = [whole[f * DOF : (f + 1) * DOF, f * DOF : (f + 1) * DOF] for f in range(7)]
    got = marginal_covariance(problem, contour, rooted, ACCELERATION)
    np.testing.assert_allclose(got, expected, rtol=1e-6, atol=1e-9 * np.abs(expected).max())


def test_joints_are_as_unsure_as_the_noise_makes_them():
    problem, rooted = clip_of(12, 0.004)
    stated = stated_by(problem, rooted)
    true = problem.points.at(rooted)
    rng = np.random.default_rng(3)
    errors, angles = [], []
    for _ in range(60):
        problem.linearise.target = true + rng.normal(0, 0.004, true.shape)
        found = problem.solved(rooted).rooted
        errors.append((problem.points.at(found) - true)[:, ::4])
        angles.append((found.pose - rooted.pose)[:, 6:])
    for sigma, error in ((stated.joint, errors), (stated.pose[:, 6:], angles)):
        ratio = np.sqrt(np.mean(np.square(error), axis=(0, 1))) / np.sqrt(np.mean(sigma**2, axis=0)).clip(1e-12)
        searched = sigma.any(axis=0)
        assert 0.8 < np.median(ratio[searched]) < 1.2


def test_unseen_frames_are_unsure_and_what_is_held_is_not():
    seen = np.full(30, 0.004)
    seen[10:20] = np.inf
    problem, rooted = clip_of(30, seen)
    stated = stated_by(problem, rooted)
    assert (stated.joint[15] > stated.joint[11]).all()
    assert (stated.joint[15] > 3 * stated.joint[5]).all()
    held = np.setdiff1d(np.arange(SKELETON.coordinates), SKELETON.searched())
    assert not stated.pose[:, held].any()
    assert (stated.pose[:, SKELETON.searched()] > 0).all()


def test_what_nothing_shows_is_as_wide_as_its_limits():
    problem, rooted = clip_of(4, np.inf)
    stated = stated_by(problem, rooted)
    assert (stated.pose[:, SKELETON.searched()] <= problem.rooting.anywhere).all()
    assert (stated.pose[:, SKELETON.searched()] > 0.3 * problem.rooting.anywhere).all()


def test_windows_say_what_the_whole_clip_says(monkeypatch):
    problem, rooted = clip_of(50, 0.004)
    whole = stated_by(problem, rooted)
    monkeypatch.setattr(clip, "WINDOW", 0.5)
    for module in clip, uncertainty:
        monkeypatch.setattr(module, "OVERLAP", 0.25)
    windows = stated_by(problem, rooted)
    np.testing.assert_allclose(windows.joint, whole.joint, rtol=0.01)
    np.testing.assert_allclose(windows.pose, whole.pose, rtol=0.01)


def test_a_prior_makes_what_single_precision_rounded_invertible():
    problem, rooted = clip_of(2, 0.004)
    contour = problem.linearise(np.arange(2), rooted)
    rounded = NormalEquations(contour.matrix.astype(np.float32).astype(float), contour.gradient, contour.cost)
    proper = rounded.with_prior(np.full(DOF, 1e-9))
    assert (np.linalg.eigvalsh(proper) > 0).all()
    np.testing.assert_allclose(proper, contour.matrix, atol=2e-6 * contour.matrix.max())
