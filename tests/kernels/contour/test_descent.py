"""Damped steps solve the system that NumPy solves, stay within limits, and only what costs less is taken."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from poisoned import poisoned

from mmocap_warp.kernels.block import batch_of
from mmocap_warp.kernels.contour.descent import MOST_SEARCHED, Descent, descend
from mmocap_warp.kernels.contour.normal_equations import Sums
from mmocap_warp.kernels.structs import filled

LONGEST = 0.3
CAMERAS = 2


class Case:
    """Made-up sums of candidates that stand between their limits, and some at one."""

    def __init__(self, dof: int, parameters: int, device: str, candidates: int = 4, seed: int = 0):
        rng = np.random.default_rng(seed)
        self.device, self.n, self.dof, self.candidates = device, dof + parameters, dof, candidates
        self.coordinates = dof + 3
        self.index = np.sort(rng.permutation(self.coordinates)[:dof])
        width = self.n + 1
        rows = rng.normal(0, 1, (candidates, CAMERAS, 3 * width, width))
        rows[..., :-1] *= rng.uniform(1.0, 20.0, self.n)
        rows[..., -1] *= rng.uniform(0.05, 3.0, (candidates, 1, 1))
        self.full = np.einsum("cksi,cksj->ckij", rows, rows)
        self.tally = rng.uniform(1.0, 2.0, (candidates, CAMERAS, 4))
        self.pose = rng.uniform(-1, 1, (candidates, self.coordinates)).astype(np.float32)
        self.start = (self.pose + rng.normal(0, 0.1, self.pose.shape)).astype(np.float32)
        self.limits = np.stack([np.full(dof, -1.1), np.full(dof, 1.1)], axis=1).astype(np.float32)
        at_limit = rng.random((candidates, dof)) < 0.3
        sides = np.where(rng.random((candidates, dof)) < 0.5, self.limits[:, 0], self.limits[:, 1])
        self.pose[:, self.index] = np.where(at_limit, sides, self.pose[:, self.index])
        self.pull = rng.uniform(1.0, 50.0, dof).astype(np.float32)
        lower = np.tril_indices(width)
        self.sums = filled(
            Sums,
            triangle=wp.array(self.full[:, :, lower[0], lower[1]].ravel(), dtype=wp.float32, device=device),
            tally=wp.array(self.tally, dtype=wp.vec4, device=device),
        )
        self.descent: Descent = filled(
            Descent,
            index=wp.array(self.index, dtype=wp.int32, device=device),
            gradient=self.n,
            pull=wp.array(self.pull, dtype=wp.float32, device=device),
            limits=wp.array(self.limits, dtype=wp.float32, device=device),
            start=wp.array(self.start, dtype=wp.float32, device=device),
            pose=wp.array(self.pose, dtype=wp.float32, device=device),
            best=poisoned(self.pose.shape, wp.float32, device),
            cost=wp.full(candidates, np.inf, dtype=wp.float32, device=device),
            tally=poisoned((candidates, CAMERAS), wp.vec4, device),
            damping=wp.full(candidates, 0.01, dtype=wp.float32, device=device),
            triangle=poisoned((candidates, len(lower[0])), wp.float32, device),
        )

    def go(self, steps: bool = True) -> None:
        descend(self.sums, batch_of(0, self.candidates, self.candidates, self.device), self.descent, steps)

    @property
    def pull_cost(self) -> np.ndarray:
        return (self.pull * (self.pose.astype(float) - self.start)[:, self.index] ** 2).sum(axis=1)

    def expected(self, c: int, damping: float) -> np.ndarray:
        """The next pose, in float64."""
        dof, total = self.dof, self.full[c].sum(axis=0)
        value = self.pose[c, self.index].astype(float)
        gradient = total[-1, :dof] - self.pull * (value - self.start[c, self.index])
        matrix = total[:dof, :dof] + np.diag(self.pull)
        matrix[np.diag_indices(dof)] *= 1 + damping
        low, high = self.limits.astype(float).T
        free = ~((value <= low) & (gradient < 0) | (value >= high) & (gradient > 0))
        step = np.zeros(dof)
        step[free] = np.linalg.solve(matrix[np.ix_(free, free)], gradient[free])
        assert 0 < free.sum() < dof
        step *= min(1.0, LONGEST / np.abs(step).max())
        pose = self.pose[c].astype(float)
        pose[self.index] = np.clip(value + step, low, high)
        return pose


@pytest.mark.parametrize(("dof", "parameters"), [(31, 0), (48, 0), (12, 9), (MOST_SEARCHED, 0)])
def test_a_step_is_numpys(device, dof, parameters):
    """Of the searched coordinates alone, where there are parameters too; with coordinates that a limit stops."""
    case = Case(dof, parameters, device)
    case.go()
    descent = case.descent
    np.testing.assert_allclose(descent.cost.numpy(), case.tally[..., 0].sum(axis=1) + case.pull_cost, rtol=1e-5)
    np.testing.assert_allclose(descent.tally.numpy(), case.tally, rtol=1e-6)
    np.testing.assert_array_equal(descent.best.numpy(), case.pose)
    lower = np.tril_indices(case.n + 1)
    total = case.full.sum(axis=1)[:, lower[0], lower[1]]
    np.testing.assert_allclose(descent.triangle.numpy(), total, rtol=1e-5, atol=1e-3)
    np.testing.assert_allclose(descent.damping.numpy(), 0.3 * 0.01, rtol=1e-6)
    for c in range(case.candidates):
        np.testing.assert_allclose(descent.pose.numpy()[c], case.expected(c, 0.3 * 0.01), atol=2e-5)


def test_steps_are_no_longer_than_the_outline_holds(device):
    case = Case(20, 0, device)
    case.sums.triangle.assign(case.sums.triangle.numpy() * np.float32(1e-3))
    case.full *= 1e-3
    triangle = case.sums.triangle.numpy().reshape(case.candidates, CAMERAS, -1)
    triangle[..., -case.n - 1 :] *= 1000.0
    case.full[..., -1, :] *= 1000.0
    case.sums.triangle.assign(triangle.ravel())
    case.limits[:] = (-9.0, 9.0)
    case.descent.limits.assign(case.limits)
    case.go()
    moved = np.abs(case.descent.pose.numpy() - case.pose).max(axis=1)
    np.testing.assert_allclose(moved, LONGEST, rtol=1e-5)


def test_what_costs_more_is_left_and_the_next_step_is_shorter(device):
    case = Case(31, 0, device)
    case.go()
    first = case.descent.pose.numpy().copy()
    before = {name: getattr(case.descent, name).numpy().copy() for name in ("best", "cost", "tally", "triangle")}
    case.sums.tally.assign(case.tally.astype(np.float32) + np.float32(50.0))
    case.sums.triangle.fill_(7.0)
    case.go()
    for name, values in before.items():
        np.testing.assert_array_equal(getattr(case.descent, name).numpy(), values)
    damping = 6.0 * 0.3 * 0.01
    np.testing.assert_allclose(case.descent.damping.numpy(), damping, rtol=1e-6)
    shorter = case.descent.pose.numpy()
    for c in range(case.candidates):
        np.testing.assert_allclose(shorter[c], case.expected(c, damping), atol=2e-5)
    assert (np.abs(shorter - case.pose).sum(axis=1) < np.abs(first - case.pose).sum(axis=1)).all()


def test_without_steps_the_pose_stays(device):
    case = Case(31, 0, device)
    case.go(steps=False)
    np.testing.assert_array_equal(case.descent.pose.numpy(), case.pose)
    np.testing.assert_array_equal(case.descent.best.numpy(), case.pose)


def test_nothing_seen_pulls_to_the_start(device):
    """The matrix is that of the pull alone: a step as long as the way to the start, but for the damping."""
    case = Case(31, 0, device)
    case.limits[:] = (-9.0, 9.0)
    case.descent.limits.assign(case.limits)
    case.sums.triangle.zero_()
    case.sums.tally.zero_()
    case.start = np.clip(case.start, case.pose - 0.25, case.pose + 0.25)
    case.descent.start.assign(case.start)
    case.go()
    expected = case.pose.copy()
    expected[:, case.index] += (case.start - case.pose)[:, case.index] / np.float32(1.0 + 0.003)
    np.testing.assert_allclose(case.descent.pose.numpy(), expected, atol=1e-5)
    np.testing.assert_allclose(case.descent.cost.numpy(), case.pull_cost, rtol=1e-5)


def test_the_bits_are_the_same_however_candidates_are_shared(device):
    whole, parts = Case(31, 0, device), Case(31, 0, device)
    whole.go()
    for first, end in ((2, 4), (0, 1), (1, 2)):
        descend(parts.sums, batch_of(first, end, 4, device), parts.descent, True)
    for name in ("pose", "best", "cost", "damping", "triangle"):
        np.testing.assert_array_equal(getattr(whole.descent, name).numpy(), getattr(parts.descent, name).numpy())
