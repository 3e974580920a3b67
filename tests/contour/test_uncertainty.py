"""Standard deviations: of the dense inverse, of repeated noise, and wide where nothing is seen."""

from __future__ import annotations

import numpy as np
import pytest
from planted import Planted, dense, solved_clip, swung
from synthetic import synthetic_body

from mmocap_warp.body.rotations import turn
from mmocap_warp.contour import ACCELERATION
from mmocap_warp.contour.clip import clip_problem as clip
from mmocap_warp.contour.clip import uncertainty
from mmocap_warp.contour.clip.clip_problem import ClipProblem, SolvedWindow
from mmocap_warp.contour.clip.motion_penalty import MotionPenalty
from mmocap_warp.contour.clip.uncertainty import (
    NOISE,
    SYSTEMATIC,
    USUAL_MISFIT,
    BodyChanges,
    BodyDeviations,
    Deviations,
    Uncertainty,
    body_axes,
    combine,
    departure,
    marginal_covariance,
    misfit,
    stretched,
)
from mmocap_warp.contour.frame.normal_equations import NormalEquations, ViewEquations
from mmocap_warp.contour.frame.rooted import RootedPoses, Rooting

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
    for _ in range(30):
        problem.linearise.target = true + rng.normal(0, 0.004, true.shape)
        found = solved_clip(problem, rooted).rooted
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


CHANGE = np.random.default_rng(5).normal(0, 0.02, (2, len(SKELETON.joints), 3))
"""Of the joints' centres in the bind pose by two parameters of a body [m]."""
PRIOR = np.array([0.5, 2.0])
CHANGES = BodyChanges(np.zeros((2, 0, 3)), CHANGE, PRIOR)


class WithBody:
    """What two views say that see the points on the joints, as they are or as the body moves them, to ``sigma`` [m].

    They ask for changes of the body (view, parameter) in prior standard deviations.
    """

    def __init__(
        self, problem: ClipProblem, moves: float, sigma: float = 0.004, asked: np.ndarray | float = 0.0
    ) -> None:
        self.points, self.moves, self.sigma = problem.points, moves, sigma
        self.asked = np.broadcast_to(asked, (2, len(CHANGE)))
        self.frames: list[int] = []

    def __call__(self, frames: np.ndarray, rooted: RootedPoses) -> ViewEquations:
        self.frames.extend(frames)
        pose = self.points.linearised(rooted)[1].reshape(len(frames), -1, DOF)
        centres = self.moves * self.points.centres_by_rest(rooted, CHANGE)
        body = np.repeat(centres[:, :, None], 4, axis=2).reshape(len(frames), -1, len(CHANGE))
        rows = np.concatenate([pose, body], axis=2) / self.sigma / np.sqrt(2)
        matrix = np.repeat((np.swapaxes(rows, 1, 2) @ rows)[:, None], 2, axis=1)
        gradient = np.zeros(matrix.shape[:3])
        gradient[..., DOF:] = self.asked / PRIOR
        world = np.zeros((len(frames), 2, 3))
        return ViewEquations(matrix, gradient, np.ones(matrix.shape[:2]), world[..., None, :], world)


def body_deviations(problem: ClipProblem, rooted: RootedPoses, linearise: WithBody) -> Uncertainty:
    deviations = BodyDeviations(problem, linearise, CHANGES)
    pieces = [deviations.of(window) for window in problem.windows(rooted)]
    return Uncertainty(*(np.concatenate([getattr(piece, name) for piece in pieces]) for name in ("pose", "joint")))


def test_a_body_that_contours_do_not_show_is_as_unsure_as_its_prior():
    problem, rooted = clip_of(5, 0.004)
    window = SolvedWindow(rooted, problem.linearise(np.arange(5), rooted), 5)
    stated = BodyDeviations(problem, WithBody(problem, moves=0.0), CHANGES).of(window)
    np.testing.assert_allclose(stated.pose, 0.0, atol=1e-12)
    moved = problem.points.centres_by_rest(rooted[:1], CHANGE) * PRIOR
    np.testing.assert_allclose(stated.joint[0], np.linalg.norm(moved[0], axis=-1), rtol=1e-4, atol=1e-9)


def test_poses_make_up_for_a_body_that_contours_show():
    problem, rooted = clip_of(5, 0.004)
    linearise = WithBody(problem, moves=1.0)
    window = SolvedWindow(rooted, problem.linearise(np.arange(5), rooted), 5)
    stated = BodyDeviations(problem, linearise, CHANGES).of(window)
    matrix = linearise(np.arange(1), rooted[:1]).together.matrix[0]
    matrix += np.diag(np.concatenate([problem.rooting.anywhere, PRIOR]) ** -2.0)
    both = np.linalg.inv(matrix)
    alone = np.linalg.inv(matrix[:DOF, :DOF])
    expected = np.sqrt(np.diag(both[:DOF, :DOF] - alone))
    got = stated.pose[0, problem.rooting.searched]
    away = np.setdiff1d(np.arange(DOF), np.flatnonzero(np.isin(problem.rooting.searched, (3, 4, 5))))  # as they leave
    np.testing.assert_allclose(got[away], expected[away], rtol=0.01)
    assert (stated.joint < 0.01).all()


def test_the_body_is_looked_at_now_and_then_in_frames_that_show_it(monkeypatch):
    seen = np.full(40, 0.004)
    seen[:3] = seen[24:] = np.inf
    problem, rooted = clip_of(40, seen)
    monkeypatch.setattr(clip, "WINDOW", 0.25)
    monkeypatch.setattr(clip, "OVERLAP", 0.05)
    linearise = WithBody(problem, moves=1.0)
    stated = body_deviations(problem, rooted, linearise)
    assert len(stated.pose) == 40
    assert 2 <= len(linearise.frames) < 10
    assert set(linearise.frames) <= set(range(3, 24))
    assert (stated.joint[:, 1:] > 0).all()
    np.testing.assert_array_equal(stated.joint[-1], stated.joint[24])


def test_what_residuals_ask_of_the_body_and_views_that_disagree_widen_deviations():
    problem, rooted = clip_of(5, 0.004)
    window = SolvedWindow(rooted, problem.linearise(np.arange(5), rooted), 5)

    def variance(asked: np.ndarray | float) -> np.ndarray:
        linearise = WithBody(problem, moves=0.0, asked=asked)
        return BodyDeviations(problem, linearise, CHANGES).of(window).joint[0] ** 2

    # The prior alone holds the body: a view moves it by its share, and joints move with their bones.
    centres = problem.points.centres_by_rest(rooted[:1], CHANGE)[0] * PRIOR
    first, second = np.array([3.0, 0.0]), np.array([0.0, 1.0])
    asked = (centres @ (first + second)) ** 2
    np.testing.assert_allclose(variance(np.array([first, first])) - variance(0), (2 * centres @ first) ** 2, atol=1e-9)
    disagree = (centres @ (first - second)) ** 2
    np.testing.assert_allclose(variance(np.array([first, second])) - variance(0), asked + disagree, atol=1e-9)
    opposed = variance(np.array([first, -first])) - variance(0)
    np.testing.assert_allclose(opposed, (2 * centres @ first) ** 2, atol=1e-9)


def test_a_body_far_from_its_family_is_less_sure():
    problem, rooted = clip_of(5, 0.004)
    window = SolvedWindow(rooted, problem.linearise(np.arange(5), rooted), 5)
    usual, far = (
        BodyDeviations(problem, WithBody(problem, moves=1.0), CHANGES, departure=each).of(window)
        for each in (1.0, departure({"fit.departure": 3.0}))
    )
    np.testing.assert_allclose(far.joint, 3 * usual.joint)
    np.testing.assert_allclose(far.pose, 3 * usual.pose)
    assert departure({}) == departure({"fit.departure": 0.5}) == 1.0


def test_a_misfit_is_the_distance_of_the_contours():
    rng = np.random.default_rng(0)
    normal = rng.normal(size=(2, 400, 3))
    rows = normal / np.linalg.norm(normal, axis=2, keepdims=True) / 0.004
    off = np.array([0.006, 0.008])
    contour = NormalEquations(np.swapaxes(rows, 1, 2) @ rows, np.zeros((2, 3)), 0.5 * 400 * (off / 0.004) ** 2)
    assert misfit(contour, np.arange(3)) == pytest.approx(np.sqrt(np.mean(off**2)))
    some = NormalEquations(contour.matrix[:, 1:, 1:], contour.gradient[:, 1:], contour.cost)
    assert misfit(some, np.array([1, 2])) == pytest.approx(np.sqrt(np.mean(off**2)), rel=0.1)
    nothing = NormalEquations(0 * contour.matrix, contour.gradient, 0 * contour.cost)
    assert misfit(nothing, np.arange(3)) == misfit(contour, np.arange(6, 9)) == USUAL_MISFIT


def test_both_parts_count_and_grow_with_the_misfit():
    noise, body = (Uncertainty(np.full((1, 2), value), np.full((1, 1, 3), value)) for value in (0.01, 0.02))
    widest = np.array([np.inf, 0.03])
    usual = combine(noise, body, USUAL_MISFIT, widest)
    expected = np.hypot(NOISE * 0.01, SYSTEMATIC * 0.02)
    np.testing.assert_allclose(usual.joint, expected)
    larger = np.hypot(NOISE * 0.01, 2 * SYSTEMATIC * 0.02)
    np.testing.assert_allclose(combine(noise, body, 2 * USUAL_MISFIT, widest).joint, 2 * larger)
    np.testing.assert_allclose(combine(noise, body, 2 * USUAL_MISFIT, widest).pose, [[2 * larger, 0.03]])
    np.testing.assert_allclose(combine(noise, body, 8 * USUAL_MISFIT, widest).joint, 8 * larger)
    small = combine(noise, body, 0.2 * USUAL_MISFIT, widest, 0.2 * USUAL_MISFIT)
    np.testing.assert_allclose(small.joint, expected, err_msg="a fifth is usual of a body of a fifth of the size")


def turned_about_up(problem: ClipProblem, rooted: RootedPoses) -> RootedPoses:
    """Poses that face another way, so that no axis of the body is one of the world's."""
    return problem.rooting.refold(RootedPoses(turn("z", 0.7) @ turn("x", 0.4) @ rooted.base, rooted.pose))


def test_deviations_are_told_along_the_bodys_axes():
    problem, rooted = clip_of(6, 0.004)
    rooted = turned_about_up(problem, rooted)
    window = SolvedWindow(rooted, problem.linearise(np.arange(6), rooted), 6)
    covariance = marginal_covariance(problem, window.contour, rooted, ACCELERATION)
    centres = problem.points.linearised(rooted)[1][:, ::4]
    of_joints = centres @ covariance[:, None] @ np.swapaxes(centres, 2, 3)
    base = rooted.base[:, None]
    along = np.sqrt(np.einsum("fjii->fji", np.swapaxes(base, 2, 3) @ of_joints @ base))
    np.testing.assert_allclose(Deviations(problem, ACCELERATION, body_axes).of(window).joint, along, rtol=1e-6)
    factor = np.random.default_rng(1).uniform(0.5, 2.0, (len(SKELETON.joints), 3))
    stretch = base @ (factor[:, :, None] * np.swapaxes(base, 2, 3))
    expected = np.sqrt(np.einsum("fjii->fji", stretch @ of_joints @ np.swapaxes(stretch, 2, 3)))
    told = Deviations(problem, ACCELERATION, stretched(factor)).of(window)
    np.testing.assert_allclose(told.joint, expected, rtol=1e-6)
    np.testing.assert_array_equal(told.pose, Deviations(problem, ACCELERATION).of(window).pose)


@pytest.mark.parametrize("moves", [0.0, 1.0])
def test_factors_that_are_one_along_all_axes_stretch_what_the_body_owes_alike(moves):
    problem, rooted = clip_of(5, 0.004)
    rooted = turned_about_up(problem, rooted)
    window = SolvedWindow(rooted, problem.linearise(np.arange(5), rooted), 5)
    linearise = WithBody(problem, moves=moves)
    plain = BodyDeviations(problem, linearise, CHANGES).of(window)
    twice = stretched(np.full((len(SKELETON.joints), 3), 2.0))
    wider = BodyDeviations(problem, linearise, CHANGES, twice).of(window)
    np.testing.assert_allclose(wider.joint, 2 * plain.joint, rtol=1e-6, atol=1e-12)
    np.testing.assert_array_equal(wider.pose, plain.pose)
