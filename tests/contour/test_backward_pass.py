"""A clip followed backwards: what was lost ahead is found, what was right stays, and the choice is the cheapest."""

from __future__ import annotations

import threading
import time
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from planted import Planted, solved_clip, swung
from synthetic import synthetic_body

from mmocap_warp.contour.clip.backward_pass import STARTS, BackwardPass, least_costly
from mmocap_warp.contour.clip.clip_problem import ClipProblem
from mmocap_warp.contour.frame.rooted import RootedPoses, Rooting

RATE, FRAMES = 60.0, 40
BODY = synthetic_body()
ELBOW = BODY.skeleton.angles("LElbow")
ASTRAY = range(14, 26)
"""Frames in which a fold of the elbow is mistaken for another one."""


class TwoBasins:
    """Frames that lead poses to the truth, or to another fold of the elbow, whichever is nearer.

    Args:
        folds: (frame,) how much further the other fold bends the elbow [rad].
        costs: (frame,) by how much the other fold costs more.
    """

    def __init__(self, folds: np.ndarray, costs: np.ndarray | float = 40.0) -> None:
        self.rooting = Rooting(BODY.skeleton, np.eye(3), BODY.skeleton.searched())
        self.truth = self.rooting.enter(swung(BODY, FRAMES, RATE))
        self.other = RootedPoses(self.truth.base, self.truth.pose.copy())
        self.other.pose[:, ELBOW] += folds[:, None]
        planted = Planted(BODY, self.rooting, np.zeros((FRAMES, 1)), 0.004)
        self.points = planted.points
        self.basins = [self.points.at(poses) for poses in (self.truth, self.other)]
        self.planted = planted
        self.extra = np.stack([np.zeros(FRAMES), np.broadcast_to(costs, FRAMES)])
        self.hidden = 0.0
        """How much more of the masks the other fold leaves uncovered: a share of what the truth does."""
        self.asked: list[int] = []

    def nearest(self, frames: np.ndarray, rooted: RootedPoses) -> np.ndarray:
        """(pose,) which basin each pose is in."""
        points = self.points.at(rooted)
        away = [np.linalg.norm(points - basin[frames], axis=2).max(axis=1) for basin in self.basins]
        basin: np.ndarray = np.argmin(away, axis=0)
        return basin

    def linearise(self, frames, rooted):
        basin = self.nearest(frames, rooted)
        self.planted.target = np.zeros((FRAMES, *self.basins[0].shape[1:]))
        self.planted.target[frames] = np.where((basin == 0)[:, None, None], *(each[frames] for each in self.basins))
        contour = self.planted(frames, rooted)
        return replace(contour, cost=contour.cost + 100.0 + self.extra[basin, frames])

    def descend(self, frames, starts):
        self.asked.append(int(frames[0]))
        basin = self.nearest(frames, starts)
        return self.truth[frames].where(basin == 0, self.other[frames]), 100.0 + self.extra[basin, frames]

    def areas(self, frames, rooted, moving=None):
        return np.where(self.nearest(frames, rooted) == 0, 0.05, 0.05 * (1.0 + self.hidden))

    @property
    def backward(self) -> BackwardPass:
        return BackwardPass(self.descend, self.linearise, self.rooting, self.points, RATE, self.areas, [])

    def error(self, rooted: RootedPoses) -> np.ndarray:
        """(frame,) [m]"""
        error: np.ndarray = np.linalg.norm(self.points.at(rooted) - self.basins[0], axis=2).max(axis=1)
        return error


def leaving_slowly() -> np.ndarray:
    """A fold that leaves the truth little by little, and is far from it when it ends."""
    folds = np.full(FRAMES, 1.2)
    folds[: ASTRAY.stop] = np.interp(np.arange(ASTRAY.stop), [ASTRAY.start, ASTRAY.stop - 1], [0.02, 1.2])
    return folds


@pytest.fixture
def lost():
    """A clip whose elbow is lost in some frames, and the poses that are known of it."""
    clip = TwoBasins(leaving_slowly())
    astray = np.isin(np.arange(FRAMES), ASTRAY)
    return clip, clip.other.where(astray, clip.truth)


def revised(backward: BackwardPass, known: RootedPoses) -> RootedPoses:
    """The second opinion on the whole clip, of which the contours of a window are known and those beyond it are not."""
    frames = np.arange(FRAMES)
    window = frames[: FRAMES // 2]
    return backward.revised(frames, known, known[:0], backward.linearise(window, known[window]))


def test_a_fold_that_later_frames_know_better_is_found(lost):
    clip, known = lost
    assert clip.error(known).max() > 0.15
    poses = revised(clip.backward, known)
    assert clip.error(poses).max() < 0.02
    assert clip.asked[: FRAMES - 1] == list(range(FRAMES - 2, -1, -1))


def test_the_clip_is_solved_from_what_was_found(lost):
    clip, known = lost
    without = ClipProblem(clip.linearise, clip.rooting, clip.points, RATE)
    assert clip.error(solved_clip(without, known).rooted).max() > 0.1
    solved = solved_clip(replace(without, backward=clip.backward), known)
    assert clip.error(solved.rooted).max() < 0.02


def test_a_way_back_that_goes_astray_is_left_though_it_costs_less_for_a_while():
    for_a_while = np.isin(np.arange(FRAMES), ASTRAY)
    clip = TwoBasins(np.full(FRAMES, 1.2), np.where(for_a_while, -4.0, 20.0))

    def astray(frames: np.ndarray, starts: RootedPoses) -> tuple[RootedPoses, np.ndarray]:
        on_the_way = len(starts) == STARTS
        return (clip.other if on_the_way else clip.truth)[frames], 100.0 + clip.extra[int(on_the_way), frames]

    backward = BackwardPass(astray, clip.linearise, clip.rooting, clip.points, RATE, clip.areas, [])
    poses = revised(backward, clip.truth)
    assert clip.error(poses).max() < 1e-6


def returned(clip: TwoBasins, astray, uncovered=None) -> np.ndarray:
    """(frame,) bool, where a solution is wrong that went astray in some frames, after the tracked poses were asked."""
    frames = np.arange(FRAMES)
    solved = clip.other.where(np.isin(frames, astray), clip.truth)
    contour = clip.linearise(frames, solved)
    backward = replace(clip.backward, uncovered=uncovered)
    answer = backward.returned(frames, solved, contour, clip.truth, clip.rooting.none)
    wrong = clip.error(answer) > 0.0
    assert (answer is solved) == np.array_equal(np.flatnonzero(wrong), astray)
    return wrong


def test_where_solving_went_astray_the_tracked_poses_come_back():
    clip = TwoBasins(np.full(FRAMES, 1.2))
    assert not returned(clip, ASTRAY).any()
    # A stretch that gains less than what a frame costs is left, also beside one that gains more.
    assert np.flatnonzero(returned(clip, ASTRAY[:2])).tolist() == [*ASTRAY[:2]]
    assert np.flatnonzero(returned(clip, [*ASTRAY, 32, 33])).tolist() == [32, 33]
    clip.extra[1] = -40.0
    assert np.flatnonzero(returned(clip, ASTRAY)).tolist() == [*ASTRAY]


@pytest.mark.parametrize(("area", "frames", "comes_back"), [(0.9, 12, False), (1.0, 2, False), (1.0, 12, True)])
def test_what_a_solution_leaves_uncovered_counts_if_it_makes_a_doubt(area, frames, comes_back):
    clip = TwoBasins(np.full(FRAMES, 1.2), 0.0)

    class Uncovered:
        def area(self, frame, rooted):
            return area * clip.nearest(np.full(len(rooted), frame), rooted)

    assert returned(clip, ASTRAY[:frames], Uncovered()).any() != comes_back


def test_a_clip_whose_solution_went_astray_has_tracked_poses_and_their_contours():
    clip = TwoBasins(np.full(FRAMES, 1.2))

    class Astray(ClipProblem):
        def solved_together(self, frames, rooted, held, passes):
            wrong = clip.other.where(np.isin(frames, ASTRAY), clip.truth)
            return wrong, self.linearise(frames, wrong)

    problem = Astray(clip.linearise, clip.rooting, clip.points, RATE, clip.backward)
    (window,) = problem.windows(clip.truth)
    assert clip.error(window.rooted).max() < 1e-6
    np.testing.assert_array_equal(window.contour.cost, clip.linearise(np.arange(FRAMES), clip.truth).cost)


def test_an_answer_whose_limb_has_no_outline_is_not_taken():
    """Contours alone prefer a limb that hides in the trunk; the mask that it leaves uncovered tells."""
    clip = TwoBasins(leaving_slowly(), -20.0)
    known = clip.truth.where(np.arange(FRAMES) < ASTRAY.stop, clip.other)
    backward = clip.backward
    poses = revised(backward, known)
    assert clip.error(poses)[: ASTRAY.stop].max() > 0.15
    clip.hidden = 0.3
    assert revised(backward, known) is known


def test_a_limb_that_is_lost_to_the_end_is_recalled_from_before():
    clip = TwoBasins(np.full(FRAMES, 1.2))
    known = clip.truth.where(np.arange(FRAMES) < ASTRAY.start, clip.other)
    assert revised(clip.backward, known) is known
    limb = np.arange(BODY.skeleton.coordinates)[ELBOW]
    recalling = BackwardPass(clip.descend, clip.linearise, clip.rooting, clip.points, RATE, clip.areas, [limb])
    assert clip.error(revised(recalling, known)).max() < 0.02
    assert revised(recalling, clip.truth) is clip.truth


@pytest.mark.parametrize("seconds", [0.0, 0.02])
def test_limbs_that_are_recalled_beside_the_way_change_no_pose(seconds):
    """The way has gone on by one frame or by many when a limb is found."""
    clip, limb = TwoBasins(np.full(FRAMES, 1.2)), np.arange(BODY.skeleton.coordinates)[ELBOW]
    known = clip.truth.where(np.arange(FRAMES) < ASTRAY.start, clip.other)
    threads = []

    def beside(frames: np.ndarray, starts: RootedPoses) -> tuple[RootedPoses, np.ndarray]:
        threads.append(threading.current_thread())
        time.sleep(seconds)
        return clip.descend(frames, starts)

    in_turn = revised(replace(clip.backward, limbs=[limb]), known)
    poses = revised(replace(clip.backward, limbs=[limb], beside=beside), known)
    assert threads[0] is not threading.current_thread()
    np.testing.assert_array_equal(poses.pose, in_turn.pose)
    assert clip.error(poses).max() < 0.02


def test_a_recalled_limb_that_fits_the_areas_far_worse_is_not_fitted():
    clip, limb = TwoBasins(np.full(FRAMES, 1.2), 1000.0), np.arange(BODY.skeleton.coordinates)[ELBOW]
    known = clip.truth.where(np.arange(FRAMES) < ASTRAY.start, clip.other)
    recalling = replace(clip.backward, limbs=[limb])
    clip.hidden = -0.1
    assert clip.error(revised(recalling, known)).max() < 0.02
    clip.hidden = -0.3
    assert revised(recalling, known) is known


def test_a_limb_that_no_frame_knows_is_recalled_from_the_other_side():
    clip = TwoBasins(np.full(FRAMES, 1.2))
    limb = np.arange(BODY.skeleton.coordinates)[ELBOW]
    alone = BackwardPass(clip.descend, clip.linearise, clip.rooting, clip.points, RATE, clip.areas, [limb])
    assert revised(alone, clip.other) is clip.other

    def mirrored(pose: np.ndarray) -> np.ndarray:
        """As if the other arm were not folded."""
        exchanged = pose + 0.3  # what is not of the limb does not count
        exchanged[ELBOW] = pose[ELBOW] - 1.2
        return exchanged

    both = replace(alone, mirrored=mirrored)
    assert clip.error(revised(both, clip.other)).max() < 0.02


def test_a_body_that_stands_still_recalls_nothing():
    clip = TwoBasins(np.full(FRAMES, 1.2))
    still = RootedPoses(clip.truth.base, np.repeat(clip.truth.pose[:1], FRAMES, axis=0))
    clip.truth, clip.other = still, RootedPoses(still.base, still.pose + 0.0)
    clip.other.pose[:, ELBOW] += 1.2
    clip.basins = [clip.points.at(poses) for poses in (clip.truth, clip.other)]
    limb = np.arange(BODY.skeleton.coordinates)[ELBOW]
    recalling = BackwardPass(clip.descend, clip.linearise, clip.rooting, clip.points, RATE, clip.areas, [limb])
    assert revised(recalling, clip.truth) is clip.truth


def test_a_limb_that_leaps_away_and_soon_back_goes_straight_on():
    clip = TwoBasins(np.full(FRAMES, 1.2))
    limb = np.arange(ELBOW.start, ELBOW.stop + 3)  # with the wrist, which leaps
    frames = np.arange(FRAMES)
    known = clip.truth.where(frames < 8, clip.other)

    def misled(at: np.ndarray, starts: RootedPoses) -> tuple[RootedPoses, np.ndarray]:
        fitted, cost = clip.descend(at, starts)
        leap = np.isin(at, (20, 21, 22, 23))
        return clip.other[at].where(leap, fitted), np.where(leap, 100.0, cost)

    backward = BackwardPass(misled, clip.linearise, clip.rooting, clip.points, RATE, clip.areas, [limb])
    assert clip.error(revised(backward, known)).max() < 0.02


@pytest.mark.parametrize("shows", [FRAMES - 1, FRAMES - 31], ids=["at the end", "only long before it"])
def test_limbs_that_no_frame_knows_are_looked_for_anew(shows):
    """From a frame that shows them they are followed both ways."""
    clip = TwoBasins(np.full(FRAMES, 1.2))
    asked = []

    def anew(frame: int, there: RootedPoses) -> RootedPoses:
        asked.append(frame)
        return (clip.truth if frame == shows else clip.other)[frame : frame + 1]

    assert revised(clip.backward, clip.other) is clip.other
    looking = BackwardPass(clip.descend, clip.linearise, clip.rooting, clip.points, RATE, clip.areas, [], anew)
    assert clip.error(revised(looking, clip.other)).max() < 0.02
    assert asked == list(range(FRAMES - 1, -1, -30))
    assert revised(looking, clip.truth) is clip.truth


class Uncovering:
    """Masks that show what the other fold leaves uncovered, by how much in each frame (frame,)."""

    def __init__(self, clip: TwoBasins, level: np.ndarray) -> None:
        self.clip, self.level = clip, level
        self.asked: list[int] = []

    def area(self, frame: int, rooted: RootedPoses) -> np.ndarray:
        return self.level[frame] * (self.clip.nearest(np.full(len(rooted), frame), rooted) == 1)

    def limbs_reaching(self, frame: int, there: RootedPoses) -> RootedPoses:
        self.asked.append(frame)
        return self.clip.truth[frame : frame + 1]


@pytest.mark.parametrize(
    ("level", "asked"),
    [
        (lambda frame: 2.0, [39]),
        (lambda frame: 0.9, []),
        (lambda frame: 2.0 * (frame == 27), []),
        (lambda frame: 2.0 * (frame <= 27), [27]),
        (lambda frame: 200.0 * (24 <= frame <= 28), [27]),
    ],
    ids=["in all frames", "little", "in one frame alone", "to a look", "for a moment"],
)
def test_limbs_that_masks_show_and_the_body_does_not_are_looked_for_there(level, asked):
    """Contours and areas of both folds cost the same, so that only what is left uncovered tells them apart."""
    clip, frames = TwoBasins(np.full(FRAMES, 1.2), 0.0), np.arange(FRAMES)
    uncovered = Uncovering(clip, np.array([level(frame) for frame in frames], float))
    backward = replace(clip.backward, uncovered=uncovered)
    poses = revised(backward, clip.other)
    assert uncovered.asked == asked
    if asked:
        assert clip.error(poses)[uncovered.level > 0].max() < 0.02
    else:
        assert poses is clip.other
    assert revised(clip.backward, clip.other) is clip.other
    assert revised(backward, clip.truth) is clip.truth


def test_a_limb_that_hides_is_not_recalled_and_not_kept_though_it_costs_less():
    """Contours see nothing of it, but it leaves a part of the masks uncovered."""
    clip, frames = TwoBasins(np.full(FRAMES, 1.2), -40.0), np.arange(FRAMES)
    known = clip.other.where(frames < 4, clip.truth)
    recalling = replace(clip.backward, limbs=[np.arange(BODY.skeleton.coordinates)[ELBOW]])
    assert clip.error(revised(recalling, known))[4:].max() > 0.15
    seeing = replace(recalling, uncovered=Uncovering(clip, np.full(FRAMES, 20.0)))
    assert clip.error(revised(seeing, known)).max() < 0.02


def test_what_costs_much_more_on_the_way_back_is_not_followed_further(lost):
    clip, known = lost
    clip.extra[1] = 40.0
    from_the_wrong_end = known.where(np.arange(FRAMES) < FRAMES - 1, clip.other)
    poses = revised(clip.backward, from_the_wrong_end)
    assert clip.error(poses)[:-1].max() < 0.02


def test_frames_that_show_nothing_are_not_asked(lost):
    clip, known = lost
    hidden = [18, 19]
    clip.planted.sigma = clip.planted.sigma.copy()
    clip.planted.sigma[hidden] = np.inf
    poses = revised(clip.backward, known)
    assert not set(hidden) & set(clip.asked)
    assert np.delete(clip.error(poses), hidden).max() < 0.02
    clip.planted.sigma[:] = np.inf
    assert revised(clip.backward, known) is known


@pytest.mark.parametrize("frames", [1, 2, 3, 6])
@pytest.mark.parametrize("answers", [2, 3])
def test_the_cheapest_of_all_choices_is_taken(answers, frames):
    rng = np.random.default_rng([answers, frames])
    cost, place = rng.uniform(0, 2, (answers, frames)), rng.normal(0, 1, (answers, frames, 4))

    def total(choice) -> float:
        way = place[list(choice), np.arange(frames)]
        return float(cost[list(choice), np.arange(frames)].sum() + 0.5 * (np.diff(way, 2, axis=0) ** 2).sum())

    cheapest = min(product(range(answers), repeat=frames), key=total)
    assert least_costly(cost, place).tolist() == list(cheapest)
