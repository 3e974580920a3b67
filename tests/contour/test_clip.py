"""A clip as one problem: found where the answer is known, in windows as in one, and where frames show nothing."""

from __future__ import annotations

import numpy as np
import pytest
from other_bodies import arm_robot, burdened, quadruped
from planted import Planted, solved_clip, swung
from synthetic import synthetic_body

from mmocap_warp.body.rotations import turn
from mmocap_warp.contour import ACCELERATION
from mmocap_warp.contour.clip import clip_problem as clip
from mmocap_warp.contour.clip.clip_problem import LAG, ClipProblem, FixedLag, Pass, coarse_then_fine
from mmocap_warp.contour.frame.rooted import RootedPoses, Rooting

HOME = turn("x", 1.3) @ turn("z", 0.4)
BODIES = {"person": synthetic_body(), "dog": quadruped(), "arm": arm_robot(), "burdened": burdened()}
SEEN = 0.004
"""How surely a frame shows a point [m]: the four points of a joint show its centre twice as surely."""


class Case:
    """A body that moves, points that show it with noise, and poses to start from."""

    def __init__(self, body=BODIES["person"], pose=None, frames=60, rate=60.0, noise=SEEN, hidden=()):
        rng = np.random.default_rng(7)
        self.body, self.rate = body, rate
        self.pose = swung(body, frames, rate) if pose is None else pose
        self.rooting = Rooting(body.skeleton, HOME, body.skeleton.searched())
        self.rooted = self.rooting.enter(self.pose)
        seen = np.full(len(self.pose), SEEN)
        seen[list(hidden)] = np.inf
        self.linearise = Planted(body, self.rooting, np.zeros((len(self.pose), 1)), seen)
        self.points = self.linearise.points
        self.truth = self.points.at(self.rooted)
        self.linearise.target = self.truth + rng.normal(0, noise, self.truth.shape)
        self.problem = ClipProblem(self.linearise, self.rooting, self.points, rate)
        off = rng.normal(0, 0.03, (len(self.pose), len(self.rooting.searched)))
        self.start = self.rooting.stepped(self.rooted, off)

    def error(self, rooted: RootedPoses) -> np.ndarray:
        """(frame,) how far the furthest point is from the truth [m]."""
        return np.linalg.norm(self.points.at(rooted) - self.truth, axis=2).max(axis=1)

    def shake(self, rooted: RootedPoses) -> float:
        """Median acceleration of the joints [m/s^2]."""
        centres = self.points.at(rooted)[:, ::4]
        return float(np.median(np.linalg.norm(np.diff(centres, 2, axis=0), axis=2))) * self.rate**2


@pytest.mark.parametrize("name", BODIES)
def test_what_is_seen_well_is_found_for_any_skeleton(name):
    case = Case(BODIES[name], noise=0.0)
    solution = solved_clip(case.problem, case.start)
    assert solution.observed.all()
    assert case.error(solution.rooted).max() < 0.002
    assert solution.cost.shape == (60,)


@pytest.mark.parametrize("rate", [15.0, 30.0, pytest.param(60.0, marks=pytest.mark.nightly), 120.0])
def test_noise_is_taken_out_at_any_frame_rate(rate):
    case = Case(frames=round(1.5 * rate), rate=rate)
    alone = solved_clip(case.problem, case.start, coarse_then_fine(1e6))
    together = solved_clip(case.problem, case.start)
    assert case.shake(together.rooted) < case.shake(case.rooted) + 0.25 * ACCELERATION
    assert np.median(case.error(together.rooted)) <= np.median(case.error(alone.rooted))


def test_a_clip_in_windows_is_the_clip_in_one(monkeypatch):
    case = Case(frames=150)
    whole = solved_clip(case.problem, case.start)
    monkeypatch.setattr(clip, "WINDOW", 1.0)
    case.linearise.calls.clear()
    windows = solved_clip(case.problem, case.start)
    assert max(map(len, case.linearise.calls)) == 60
    assert len({frames[0] for frames in case.linearise.calls}) > 3
    apart = np.linalg.norm(case.points.at(windows.rooted) - case.points.at(whole.rooted), axis=2)
    assert apart.max() < 2e-4


def test_live_poses_are_nearly_those_of_the_whole_clip():
    case = Case()
    whole = solved_clip(case.problem, case.start)
    live = FixedLag(case.problem)
    final = [live.add(case.start[frame : frame + 1]) for frame in range(60)]
    came = np.cumsum([0 if each is None else len(each) for each in final])
    assert (np.arange(1, 61) - came < LAG).all()
    parts = [*(each for each in final if each is not None), live.rest()]
    solution = parts[0].followed_by(*parts[1:])
    assert len(solution) == 60
    assert live.rest() is None
    assert np.median(case.error(solution)) < 1.1 * np.median(case.error(whole.rooted))
    assert case.shake(solution) < 1.1 * case.shake(whole.rooted)  # a frame has two steps


def test_live_frames_are_solved_with_all_that_their_penalty_looks_back_on(monkeypatch):
    case, held = Case(frames=20), []
    solved = ClipProblem.solved_together

    def spied(problem, frames, rooted, before, passes):
        held.append(len(before))
        return solved(problem, frames, rooted, before, passes)

    monkeypatch.setattr(ClipProblem, "solved_together", spied)
    live = FixedLag(case.problem)
    for frame in range(20):
        live.add(case.start[frame : frame + 1])
    assert held == [0, clip.HELD, clip.HELD]


def test_a_window_that_shows_nothing_to_its_end_is_cut_all_the_same():
    observed = np.arange(120) < 40
    assert clip._final_frames(observed, 24) == 96
    assert clip._final_frames(np.arange(120) < 70, 24) == 70


@pytest.mark.parametrize("hidden", [range(20, 32), range(12), range(50, 60)], ids=["within", "first", "last"])
def test_frames_that_show_nothing_are_filled_and_named(hidden):
    case = Case(hidden=hidden)
    lost = case.start
    lost.pose[list(hidden)] = case.start.pose[0]
    lost.base[list(hidden)] = case.start.base[0]
    solution = solved_clip(case.problem, lost)
    assert np.flatnonzero(~solution.observed).tolist() == list(hidden)
    seen = np.setdiff1d(np.arange(60), hidden)
    assert case.error(solution.rooted)[seen].max() < 0.02
    nearest = seen[np.abs(seen[:, None] - np.array(hidden)).argmin(axis=0)]
    repeated = np.linalg.norm(case.truth[nearest] - case.truth[hidden], axis=2).max()
    assert case.error(solution.rooted)[hidden].max() < (0.2 if hidden[0] == 20 else 1.0) * repeated


def test_a_clip_that_shows_nothing_stays_where_it_is():
    case = Case(frames=5, hidden=range(5))
    solution = solved_clip(case.problem, case.start)
    assert not solution.observed.any()
    assert np.isfinite(solution.rooted.pose).all()


def test_a_gap_is_not_cut_by_a_window(monkeypatch):
    hidden = range(30, 55)
    case = Case(frames=100, hidden=hidden)
    whole = solved_clip(case.problem, case.start)
    monkeypatch.setattr(clip, "WINDOW", 1.0)
    monkeypatch.setattr(clip, "OVERLAP", 0.25)
    windows = solved_clip(case.problem, case.start)
    assert {frames[0] for frames in case.linearise.calls} >= {0, 30}
    assert np.abs(case.points.at(windows.rooted) - case.points.at(whole.rooted)).max() < 0.01


@pytest.mark.parametrize("rate", [30.0, pytest.param(60.0, marks=pytest.mark.nightly), 120.0])
def test_a_punch_keeps_its_speed(rate):
    body = BODIES["person"]
    skeleton = body.skeleton
    time = np.arange(round(1.2 * rate)) / rate
    out, back = (np.clip(t, 0, 1) for t in ((time - 0.5) / 0.12, (time - 0.67) / 0.16))
    reach = (out**3 * (10 - 15 * out + 6 * out**2) - back**3 * (10 - 15 * back + 6 * back**2))[:, None]
    pose = np.zeros((len(time), skeleton.coordinates))
    pose[:, skeleton.angles("LElbow")] = (1 - reach) * (0, -1.8, 0)
    pose[:, skeleton.angles("LShoulder")] = reach * (0, -0.8, 0.2)
    case = Case(pose=pose, rate=rate)
    wrist = 4 * skeleton.index("LWrist")

    def fastest(rooted: RootedPoses) -> float:
        return float(np.linalg.norm(np.diff(case.points.at(rooted)[:, wrist], axis=0), axis=1).max()) * rate

    assert fastest(case.rooted) > 3.5
    solved = solved_clip(case.problem, case.start).rooted
    assert fastest(solved) == pytest.approx(fastest(case.rooted), rel=0.05)
    assert case.shake(solved) < 0.85 * case.shake(solved_clip(case.problem, case.start, (Pass(1e6, 7),)).rooted)


def test_the_same_twice():
    case = Case(frames=20)
    first, second = (solved_clip(case.problem, case.start).rooted for _ in range(2))
    assert (first.pose == second.pose).all()
    assert (first.base == second.base).all()
