"""Whether stated standard deviations are right, and factors that make them so: on made people whose truth is known.

``python instruments/deviations.py FOLDER PEOPLE`` makes so many people and tracks a little of each, which takes
about three seconds of one core a person; what each gives is kept in FOLDER. Factors are learnt on all of them and
written to ``FOLDER/adult_man.deviations.toml``. In the table every fifth of the people is judged by factors that were
learnt on the other four.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from made_people import made_clip

from mmocap_warp.body.mirroring import mirrored_joints
from mmocap_warp.body.model import BodyModel, Subject
from mmocap_warp.body.rest_space import RestSpace
from mmocap_warp.body.rotations import applied
from mmocap_warp.body.skeleton import ROOT_ANGLES, TRANSLATION, Skeleton
from mmocap_warp.contour import ACCELERATION
from mmocap_warp.contour.clip.clip_problem import ClipProblem, SolvedWindow
from mmocap_warp.contour.clip.motion_points import POINTS_A_JOINT, MotionPoints
from mmocap_warp.contour.clip.uncertainty import (
    BodyDeviations,
    Deviations,
    Uncertainty,
    body_axes,
    body_changes,
    combine,
    departure,
    misfit,
)
from mmocap_warp.contour.frame.normal_equations import ViewEquations
from mmocap_warp.contour.frame.rooted import RootedPoses, Rooting
from mmocap_warp.fitting.clip_body import Followed, solve_body
from mmocap_warp.rigging.shipped import DEFAULT_BODY, DeviationFactors, load_body
from mmocap_warp.study.sequences import SEQUENCES, StudySequence
from mmocap_warp.synthesis.exact_posing import ExactPoser
from mmocap_warp.tracking.from_settings import make_fitter
from mmocap_warp.tracking.track_config import TrackConfig

_BODY_FRAMES, _BODY_SPAN = 16, 120  # frames that a body is solved from, and over how many they are spread
_CLIP = 40  # frames that are solved together
_LOOKED_AT = slice(3, None, 8)  # of these
_LATER = 80  # where every other person's frames begin
_PIECES = (0, 60)  # where those of the nine sequences begin
_SHAPE_KNOWN = 0.5  # of a person's shape, where the body begins
_PLACE_OFF, _ANGLE_OFF = 0.008, 0.04  # standard deviations where poses begin [m, rad]
_SETTINGS = TrackConfig(algorithm="contour", device="cpu", threads=1)
_LEAST, _MOST, _WIDEST = 0.90, 0.98, 1.5  # what is asked for: coverage by 2 sigma, and median sigma over actual error
_TOO_NARROW, _TOO_WIDE = 0.955, 0.977  # coverage of the people learnt on below, and beyond, which a factor mends it
_LEAST_FACTOR = 0.35  # no factor is smaller: what is stated of a made person's root does not hold so well for others
_FOLDS = 5
_AROUND = np.array([-0.03, -0.015, 0.0, 0.01])  # quantiles that are averaged, for one alone jumps


@dataclass(frozen=True, eq=False)
class Stated:
    """What was off in some frames, and what was said of it.

    Attributes:
        error: (frame, quantity) float64: joints' centres along the body's axes [m], then the searched angles [rad].
        sigma: likewise.
    """

    error: np.ndarray
    sigma: np.ndarray

    def followed_by(self, *more: Stated) -> Stated:
        """These frames, then the others."""
        each = self, *more
        return Stated(np.concatenate([e.error for e in each]), np.concatenate([e.sigma for e in each]))

    def times(self, factor: np.ndarray) -> Stated:
        """With standard deviations multiplied (quantity,)."""
        return Stated(self.error, self.sigma * factor)

    @property
    def within(self) -> np.ndarray:
        """(quantity,) how often the truth is within 2 sigma."""
        within: np.ndarray = (np.abs(self.error) <= 2 * self.sigma).mean(axis=0)
        return within

    @property
    def median(self) -> np.ndarray:
        """(quantity,) the median sigma over the root mean square error."""
        median: np.ndarray = np.median(self.sigma, axis=0) / np.sqrt((self.error**2).mean(axis=0))
        return median

    @property
    def as_asked(self) -> np.ndarray:
        """(quantity,) bool."""
        asked: np.ndarray = (self.within >= _LEAST) & (self.within <= _MOST) & (self.median <= _WIDEST)
        return asked


def stated(sequence: StudySequence, first: int, generic: BodyModel) -> Stated:
    """Solve a body and forty frames of a sequence, from near the truth, and compare them with it.

    Args:
        sequence: with the truth.
        first: frame.
        generic: the body that is expected before anything is seen.
    """
    space, base = RestSpace(generic), sequence.subject.root_base
    frames = np.arange(first, first + _CLIP)
    spread = np.linspace(first, min(first + _BODY_SPAN, sequence.frame_count) - 1, _BODY_FRAMES).round().astype(int)
    true_body = sequence.recording.body
    near = true_body if np.array_equal(true_body.skin.face, generic.skin.face) else sequence.subject.body  # in a skirt
    begins = space.model(_SHAPE_KNOWN * space.nearest(near))
    rooting = Rooting(generic.skeleton, base, generic.skeleton.searched())
    poses = _near_truth(sequence, begins, spread)
    followed = Followed(
        np.array([sequence.observation(int(f)) for f in spread]), rooting.enter(poses), np.zeros(len(spread))
    )
    subject, _ = solve_body(Subject(begins, base, poses[0], {}), generic, sequence.rig, followed, "cpu", 1)
    clip = _Clip(sequence, subject, frames)
    window = next(clip.problem.windows(rooting.enter(_near_truth(sequence, begins, frames))))
    sigma = clip.deviations(window)
    rooted = window.rooted[_LOOKED_AT]
    joint = clip.problem.points.at(rooted)[:, ::POINTS_A_JOINT] - _true_joints(sequence, frames[_LOOKED_AT])
    angles = generic.skeleton.searched()[TRANSLATION:]
    true_pose = sequence.recording.poses[frames]
    pose = rooting.leave(window.rooted, true_pose[0, ROOT_ANGLES])[_LOOKED_AT]
    angle = pose[:, angles] - true_pose[_LOOKED_AT][:, angles]
    along = applied(body_axes(rooted), joint)
    return Stated(
        np.concatenate([along.reshape(len(along), -1), (angle + np.pi) % (2 * np.pi) - np.pi], axis=1),
        np.concatenate([sigma.joint[_LOOKED_AT].reshape(len(along), -1), sigma.pose[_LOOKED_AT][:, angles]], axis=1),
    )


def _near_truth(sequence: StudySequence, body: BodyModel, frames: np.ndarray) -> np.ndarray:
    """Poses (frame, coordinate) of a body whose joints lie about the true ones, with angles that are off."""
    skeleton, base = body.skeleton, sequence.subject.root_base
    pose, searched = sequence.recording.poses[frames].copy(), skeleton.searched()
    pose[:, np.setdiff1d(np.arange(TRANSLATION, skeleton.coordinates), searched)] = 0.0
    joints = ExactPoser(body, base).joint_transforms(pose)[:, :, :3, 3]
    pose[:, :TRANSLATION] += (_true_joints(sequence, frames) - joints).mean(axis=1)
    rng = np.random.default_rng(5)
    off = np.where(searched < TRANSLATION, _PLACE_OFF, _ANGLE_OFF)
    pose[:, searched] += off * rng.standard_normal((len(frames), len(searched)))
    within: np.ndarray = np.clip(pose, *skeleton.coordinate_limits.T)
    return within


def _true_joints(sequence: StudySequence, frames: np.ndarray) -> np.ndarray:
    truth = sequence.truth
    order = [truth.joint_names.index(name) for name in sequence.recording.body.skeleton.joints]
    joints: np.ndarray = truth.joints[frames][:, order]
    return joints


class _Clip:
    """Frames of a sequence as one problem."""

    def __init__(self, sequence: StudySequence, subject: Subject, frames: np.ndarray) -> None:
        self._seen = [sequence.observation(int(frame)) for frame in frames]
        self._fitter = make_fitter(subject, sequence.rig, _SETTINGS, len(frames), frames=len(frames))
        for place, observation in enumerate(self._seen):
            self._fitter.observe(place, observation)
        skeleton = subject.body.skeleton
        rooting = Rooting(skeleton, subject.root_base, skeleton.searched())
        points = MotionPoints(skeleton, subject.body.joint_rest, rooting.searched)
        self.problem = ClipProblem(self._fitter.linearise, rooting, points, sequence.fps)
        changes = body_changes(subject.body)
        self._of_body = make_fitter(subject, sequence.rig, _SETTINGS, 1, parameters=len(changes.sigma))
        self._of_body.set_change(changes.vertex, changes.joint)
        self._noise = Deviations(self.problem, ACCELERATION, body_axes)
        far = departure(subject.provenance)
        self._body = BodyDeviations(self.problem, self._linearise_body, changes, body_axes, far)

    def deviations(self, window: SolvedWindow) -> Uncertainty:
        """Standard deviations of all frames, along the body's axes."""
        searched = self.problem.rooting.searched
        widest = np.full(window.rooted.pose.shape[1], np.inf)
        widest[searched] = self.problem.rooting.anywhere
        return combine(self._noise.of(window), self._body.of(window), misfit(window.contour, searched), widest)

    def _linearise_body(self, frames: np.ndarray, rooted: RootedPoses) -> ViewEquations:
        each = []
        for i, frame in enumerate(frames):
            self._of_body.observe(0, self._seen[frame])
            each.append(self._of_body.linearise_views(np.zeros(1, int), rooted[i : i + 1]))
        return each[0].followed_by(*each[1:])


def learnt(people: Stated, body: BodyModel) -> np.ndarray:
    """(quantity,) factors, the same on both sides of the body.

    A factor is no larger a change than it needs to be: enough that 95.5 % are within 2 sigma where fewer are, and that
    no more than 97.7 % are where more are. Shipped people differ from made ones, and too wide misleads less.
    """
    ratio = np.abs(people.error / people.sigma) / 2
    factor = np.ones(ratio.shape[1])
    for group in _mirrored_quantities(body):
        narrow, wide = (_quantile(ratio[:, group].ravel(), share) for share in (_TOO_NARROW, _TOO_WIDE))
        factor[group] = max(np.clip(1.0, narrow, wide), _LEAST_FACTOR)
    return factor.round(2)


def cross_judged(people: Sequence[Stated], body: BodyModel) -> Stated:
    """All people, each with factors that were learnt on others: those of the other four fifths."""
    fifth = [number * _FOLDS // len(people) for number in range(len(people))]
    judged = []
    for number in range(_FOLDS):
        others = [each for each, fold in zip(people, fifth, strict=True) if fold != number]
        factor = learnt(others[0].followed_by(*others[1:]), body)
        judged += [each.times(factor) for each, fold in zip(people, fifth, strict=True) if fold == number]
    return judged[0].followed_by(*judged[1:])


def _quantile(ratio: np.ndarray, share: float) -> float:
    """What so large a share of ratios is below, of several quantiles as a normal distribution would connect them."""
    from scipy.special import ndtri

    shares = np.minimum(share + _AROUND, 0.995)
    normal = ndtri((1 + shares) / 2) / ndtri((1 + share) / 2)
    return float(np.exp(np.mean(np.log(np.quantile(ratio, shares) / normal))))


def _quantities(body: BodyModel) -> list[tuple[int, int, str]]:
    """Joint, axis, and ``joint`` or ``angle`` of each."""
    angles = [divmod(int(c) - TRANSLATION, 3) for c in body.skeleton.searched()[TRANSLATION:]]
    centres = [(joint, axis, "joint") for joint in range(len(body.skeleton.joints)) for axis in range(3)]
    return centres + [(joint, axis, "angle") for joint, axis in angles]


def _mirrored_quantities(body: BodyModel) -> list[list[int]]:
    """Numbers of those that are each other's mirror image."""
    of_joint = {joint: name for name, group in mirrored_joints(body).items() for joint in group}
    groups: dict[tuple[str, int, str], list[int]] = {}
    for number, (joint, axis, kind) in enumerate(_quantities(body)):
        groups.setdefault((of_joint[joint], axis, kind), []).append(number)
    return list(groups.values())


def as_factors(factor: np.ndarray, body: BodyModel) -> DeviationFactors:
    """Factors (quantity,) by joint and axis, as they are written; one for what is not searched."""
    joints = len(body.skeleton.joints)
    found = DeviationFactors(np.ones((joints, 3)), np.ones((joints, 3)))
    for (joint, axis, kind), value in zip(_quantities(body), factor, strict=True):
        getattr(found, kind)[joint, axis] = value
    return found


def table(people: Stated, body: BodyModel) -> str:
    """Coverage by 2 sigma and the median sigma over the actual error, in Markdown; bold is what is not as asked."""
    lines = ["| | joint x | joint y | joint z | angle Rx | angle Ry | angle Rz |", "|---|---|---|---|---|---|---|"]
    within, median, asked = people.within, people.median, people.as_asked
    number = {quantity: i for i, quantity in enumerate(_quantities(body))}
    for group in mirrored_joints(body).values():
        name = body.skeleton.joints[group[0]]
        cells = [name[1:] + ", left and right" if len(group) > 1 else name]
        for kind in ("joint", "angle"):
            for axis in range(3):
                found = [number[joint, axis, kind] for joint in group if (joint, axis, kind) in number]
                told = [f"{100 * within[i]:.0f} %, {median[i]:.2f}" for i in found]
                marked = [text if asked[i] else f"**{text}**" for i, text in zip(found, told, strict=True)]
                cells.append("; ".join(marked))
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def summary(people: Stated, body: BodyModel) -> str:
    """A line of counts."""
    joints = 3 * len(body.skeleton.joints)
    inside = np.abs(people.error) <= 2 * people.sigma
    within = people.within
    return (
        f"{people.as_asked.sum()} of {len(within)} as asked, {(within < _LEAST).sum()} below {_LEAST:.0%}, "
        f"{(within > _MOST).sum()} above {_MOST:.0%}, {(people.median > _WIDEST).sum()} medians above {_WIDEST}; "
        f"joints {inside[:, :joints].mean():.1%}, angles {inside[:, joints:].mean():.1%}; "
        f"from {within.min():.1%} to {within.max():.1%}"
    )


def _kept(path: Path, sequence: Callable[[], StudySequence], first: int, body: BodyModel) -> Stated:
    """What a person or a sequence gives, made unless its file is there."""
    if not path.is_file():
        made = stated(sequence(), first, body)
        np.savez(path, error=made.error, sigma=made.sigma)
    with np.load(path) as file:
        return Stated(file["error"], file["sigma"])


def factors_toml(skeleton: Skeleton, factors: DeviationFactors, made_with: str) -> str:
    """The text of a file of factors; ``made_with`` is its first line, a comment."""
    lines = [f"# {made_with}"]
    for name, values, what in (
        ("joint", factors.joint, "of the centres, along the body's axes: to its left, up, ahead"),
        ("angle", factors.angle, "of Rx, Ry, Rz"),
    ):
        lines += ["", f"[{name}] # {what}"]
        lines += [
            f"{joint} = [{', '.join(f'{value:.2f}' for value in of_joint)}]"
            for joint, of_joint in zip(skeleton.joints, values, strict=True)
        ]
    return "\n".join(lines) + "\n"


def _main(folder: Path, people: int) -> None:
    body = load_body(DEFAULT_BODY)
    folder.mkdir(parents=True, exist_ok=True)
    each = [
        _kept(folder / f"person-{number:03d}.npz", partial(made_clip, number), _LATER * (number % 2), body)
        for number in range(people)
    ]
    everybody, judged = each[0].followed_by(*each[1:]), cross_judged(each, body)
    factor = learnt(everybody, body)
    made_with = f"Made by `python instruments/deviations.py FOLDER {people}`."
    file = folder / f"{body.name}.deviations.toml"
    file.write_text(factors_toml(body.skeleton, as_factors(factor, body), made_with), encoding="utf-8")
    print(f"{people} people, without factors: {summary(everybody, body)}")
    print(f"with factors of their own: {summary(everybody.times(factor), body)}")
    print(f"with those of the other four fifths: {summary(judged, body)}\n\n{table(judged, body)}\n")
    for name in SEQUENCES:
        path, sequence = folder / name.replace("/", "-"), partial(SEQUENCES.__getitem__, name)
        found = [_kept(Path(f"{path}-{first}.npz"), sequence, first, body) for first in _PIECES]
        without = found[0].followed_by(*found[1:])
        print(f"{name}, without factors: {summary(without, body)}")
        print(f"{name}, with: {summary(without.times(factor), body)}")


if __name__ == "__main__":
    if len(sys.argv) != 3 or not sys.argv[2].isdigit() or int(sys.argv[2]) < _FOLDS:
        raise SystemExit("usage: python instruments/deviations.py FOLDER PEOPLE")
    _main(Path(sys.argv[1]), int(sys.argv[2]))
