"""The body from many frames: a clip's beginning is followed by contours, and some of its frames are solved together.

One frame says little of a body: a short thigh looks like a long one that points at the camera. Over frames in
different poses that is settled. The body is pulled to the generic one that a fit starts from, not to what the first
frame alone made of it.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple, Self

import numpy as np

from mmocap_warp.body.model import BodyModel, Subject
from mmocap_warp.body.rest_space import RestSpace
from mmocap_warp.body.skeleton import ROOT_ANGLES, Skeleton
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.contour.body_problem import BodyProblem, BodySolution, body_problem, space_fitter
from mmocap_warp.contour.clip.motion_points import POINTS_A_JOINT, MotionPoints
from mmocap_warp.contour.frame.rooted import FrameArrays, Neighbours, RootedPoses, Rooting
from mmocap_warp.device.cores import available_threads
from mmocap_warp.device.resolve import resolve_device
from mmocap_warp.fitting.frame_fit import PRIOR
from mmocap_warp.masks.observation import Observation
from mmocap_warp.result.result import STATUS, FrameAnswer
from mmocap_warp.result.verdict import MAX_DEPARTURE
from mmocap_warp.tracking.contour_tracker import ContourTracker
from mmocap_warp.tracking.frame_loop import track_frames
from mmocap_warp.tracking.loose_clothes import LOOSE, LooseClothes, loose_joints, with_hidden
from mmocap_warp.tracking.track_config import TrackConfig

_DURATION = 2.0  # how much of a clip is followed [s]
_RATE = 30.0  # frames a second that are enough to follow a person
_LEAST_GAIN = 0.03  # share of a frame's cost by which the answer on the way back must be better
_BODY_STEPS = 15  # steps that solve the body
# Loose clothes are found beside a body, which is solved without them a few times.
_CLOTHED_TURNS = 3
_USUAL = 3.0  # a parameter further from the family begins there anew [standard deviations]
_HELD, _HELD_STEPS = 0.05, 8  # share of these that the body gives way by, while poses follow it
_CLOTHED = 0.5  # how much nearer to its family a body is expected under them
_GAIN, _MOST_COST = 0.75, 1.05  # shares of its departure, and of its cost, that may be left without them
_OUTLINE = 0.012  # standard deviation that all outlines have in common, of shadows, hair and shoes [m]


@dataclass(frozen=True, eq=False)
class Followed(FrameArrays):
    """Frames and their poses."""

    observation: np.ndarray  # (frame,), an Observation each
    rooted: RootedPoses  # the poses
    cost: np.ndarray  # (frame,) float64, of the tracker's answers
    # the poses before and after each, for late views. The body moves on a straight line between them: they stay while
    # it is solved, and a curved motion would pull a frame that moves back to them
    neighbours: Neighbours | None = None

    def spread(self, count: int) -> Self:
        """At most ``count`` of the frames, evenly spread, with the first."""
        return self[np.unique(np.linspace(0, len(self.rooted) - 1, count).round().astype(int))]


class InClip(NamedTuple):
    """A subject that was followed through a clip."""

    subject: Subject  # with the body that some of the frames show, in the first frame's pose
    cost: float  # of contours in a frame; more, the sooner a frame was lost
    places: np.ndarray  # (frame, joint, 3), where the joints were meanwhile [m]
    followed: Followed  # the frames


def frames_to_follow(fps: float, available: int) -> range:
    """The frames of a recording that are worth following from its first one."""
    stride = max(1, int(fps / _RATE))
    return range(0, min(available, max(1, round(_DURATION * fps))), stride)


def solve_body_in_clip(
    subject: Subject,
    generic: BodyModel,
    rig: CameraRig,
    clip: Iterable[Observation],
    fps: float,
    frames: int,
    config: TrackConfig,
) -> InClip:
    """Follow a subject through a clip and solve its body from some of the frames.

    The subject has the pose of the first frame, and its body is expected to be the generic one. The clip's frames, such
    as those of :func:`frames_to_follow`, are ``fps`` a second; the body is solved from so many ``frames``, at most.
    """
    clip, skeleton = list(clip), subject.body.skeleton
    followed = follow(subject, rig, clip, fps, config)
    device, threads = resolve_device(config.device), config.threads or available_threads()
    solved, cost = solve_body(subject, generic, rig, followed.spread(frames), device, threads)
    cost *= len(clip) / len(followed.rooted)
    if loose_joints(solved) and not loose_joints(subject):  # taken for skin, clothes may have cost a leg
        followed = follow(solved, rig, clip, fps, config)
        solved, _ = solve_body(solved, generic, rig, followed.spread(frames), device, threads)
    places = MotionPoints(skeleton, subject.body.joint_rest, skeleton.searched()).at(followed.rooted)
    return InClip(solved, cost, places[:, ::POINTS_A_JOINT], followed)


def follow(subject: Subject, rig: CameraRig, clip: list[Observation], fps: float, config: TrackConfig) -> Followed:
    """Follow a subject in its first pose through consecutive frames until one is lost, and back again.

    A limb that the first frame did not show is found when it moves; on the way back it is known where it comes from.
    """
    skeleton = subject.body.skeleton
    rooting = Rooting(skeleton, subject.root_base, skeleton.searched())
    if len(clip) == 1:
        return Followed(np.array(clip), rooting.enter(subject.pose[None].astype(float)), np.zeros(1))
    # Forwards, until the subject is lost.
    observed: list[Observation] = []
    answers: list[FrameAnswer] = []
    tracker = ContourTracker(subject, rig, config, fps)
    observations = with_hidden(clip, subject, rig, fps, lambda _: tracker.state.pose)
    for answer in track_frames(tracker, observations, keep=observed.append):
        if answers and np.ravel(answer.status)[0] == STATUS.index("lost"):
            break
        answers.append(answer)
    # Backwards from the last frame before that, by contours alone: the better answer of each frame is taken.
    last = len(answers) - 1
    subject_there = replace(subject, pose=answers[last].pose[0])
    back = ContourTracker(subject_there, rig, replace(config, algorithm="contour"), -fps)
    for step, answer in enumerate(track_frames(back, reversed(observed[:last])), 1):
        if answer.cost[0] < (1 - _LEAST_GAIN) * answers[last - step].cost[0]:
            answers[last - step] = answer
    rooted = [rooting.enter(answer.pose.astype(float)) for answer in answers]
    course = rooted[0].followed_by(*rooted[1:])
    neighbours = Neighbours.of(course, np.arange(len(course)), fps, curved=False)
    costs = np.array([float(answer.cost[0]) for answer in answers])
    return Followed(np.array(observed[: last + 1]), course, costs, neighbours)


def solve_body(
    subject: Subject, generic: BodyModel, rig: CameraRig, followed: Followed, device: str, threads: int
) -> tuple[Subject, float]:
    """The subject's body and the poses of frames as one problem; of a body on a base, where that stands too.

    The body starts as the subject's and is expected to be the generic one. The first of the frames is the subject's.

    Returns:
        The solved body in the first frame's pose, and what contours cost in a frame.
    """
    own = generic.skeleton
    skeleton, still = (own.with_free_root(), ROOT_ANGLES.stop) if own.root_is_fixed else (own, 0)
    space = RestSpace(replace(generic, skeleton=skeleton))
    fitter, count = space_fitter(space, rig, list(followed.observation), device, threads), len(followed.rooted)
    worn = loose_joints(subject)
    share = _CLOTHED * PRIOR if worn else PRIOR
    problem, rooted = body_problem(fitter, space, subject.root_base, share, followed.neighbours, still), followed.rooted

    def hide_clothes(joints: list[str], rooted: RootedPoses, beta: np.ndarray) -> None:
        clothes = LooseClothes(replace(subject, body=space.model(beta)), rig, joints, known=True)
        poses = problem.rooting.leave(rooted, subject.pose[ROOT_ANGLES])
        for place, seen in enumerate(followed.observation):
            fitter.observe(place, clothes.hidden_in(seen, poses[place : place + 1]))

    beta = space.nearest(subject.body)
    if worn:
        hide_clothes(worn, rooted, beta)
    solution = problem.solved(np.arange(count), rooted, beta, _BODY_STEPS)
    departure, cost = _departure(space, solution.beta), float(solution.cost.mean())
    # A body far from its family, and thicker, may be in loose clothes: if it comes nearer without them, it is.
    if not worn and departure > MAX_DEPARTURE and (thick := _thick_joints(space, solution.beta)):
        without = _solved_without(partial(hide_clothes, thick), problem, solution)
        if _departure(space, without.beta) < _GAIN * departure and without.cost.mean() < _MOST_COST * cost:
            solution, worn, departure = without, thick, _departure(space, without.beta)
    pose = problem.rooting.leave(solution.rooted[:1], subject.pose[ROOT_ANGLES])[0]
    kept = {name: value for name, value in subject.provenance.items() if name.startswith("fit.")}
    shape = {f"shape.{name}": float(value) for name, value in zip(space.names, solution.beta, strict=True)}
    provenance = kept | {"fit.frames": count} | measurements(space, solution) | shape
    provenance |= ({"fit.departure": departure} if departure else {}) | ({LOOSE: "+".join(worn)} if worn else {})
    solved = replace(subject, body=space.model(solution.beta), pose=pose, provenance=provenance)
    return on_its_base(solved, own) if still else solved, cost


def _departure(space: RestSpace, beta: np.ndarray) -> float:
    """How far a body is from its family, as the root mean square of its parameters in standard deviations."""
    departs = (beta / (PRIOR * space.sigma))[~space.changes_kind]
    return float(np.sqrt(np.mean(departs**2))) if len(departs) else 0.0


def _thick_joints(space: RestSpace, beta: np.ndarray) -> list[str]:
    """The joints whose girth is beyond that of the family."""
    far = zip(space.names, beta / (PRIOR * space.sigma) > MAX_DEPARTURE, strict=True)
    pairs = [name.removeprefix("girth.").split("+") for name, is_far in far if is_far and name.startswith("girth.")]
    return [joint for pair in pairs for joint in pair]


def _solved_without(
    hide_clothes: Callable[[RootedPoses, np.ndarray], None], problem: BodyProblem, solution: BodySolution
) -> BodySolution:
    """The body without loose clothes: they are hidden beside a body that is usual where the solution is not."""
    frames, near = np.arange(len(solution.rooted)), replace(problem, sigma=_CLOTHED * problem.sigma)
    for _ in range(_CLOTHED_TURNS):
        usual = np.where(np.abs(solution.beta) > _USUAL * problem.sigma, problem.generic, solution.beta)
        held = replace(problem, generic=usual, sigma=_HELD * problem.sigma)
        solution = held.solved(frames, solution.rooted, usual, _HELD_STEPS)
        hide_clothes(solution.rooted, solution.beta)
        solution = near.solved(frames, solution.rooted, solution.beta, _BODY_STEPS)
    return solution


def on_its_base(subject: Subject, skeleton: Skeleton) -> Subject:
    """The subject with a skeleton whose root stands still: where it lies is in the root base, and no more in angles."""
    free = subject.body.skeleton
    there = Rooting(free, subject.root_base, free.searched()).enter(subject.pose[None])
    body = replace(subject.body, skeleton=skeleton)
    return replace(subject, body=body, root_base=there.base[0], pose=there.pose[0])


def measurements(space: RestSpace, solution: BodySolution) -> dict[str, float]:
    """Height and bones' lengths with their standard deviations [m]; of some bodies the length too.

    A body has a length if it is longer than tall, or may lie any way up. What the masks and the family of bodies are
    off by is the same in all frames: more frames do not average it out.
    """
    covariance = len(solution.cost) * solution.covariance
    rest, joint = space.at(solution.beta)
    d_rest, d_joint = space.basis(solution.beta)
    own = np.flatnonzero(space.body.own_vertex)
    top, bottom = own[rest[own, 1].argmax()], own[rest[own, 1].argmin()]
    lengths = {"height": (rest[top, 1] - rest[bottom, 1], d_rest[:, top, 1] - d_rest[:, bottom, 1])}
    across, skeleton = np.ptp(rest[own], axis=0), space.body.skeleton
    if across[2] > across[1] or not skeleton.stands:
        axis = 2 if skeleton.stands else int(across.argmax())
        front, back = own[rest[own, axis].argmax()], own[rest[own, axis].argmin()]
        lengths["length"] = rest[front, axis] - rest[back, axis], d_rest[:, front, axis] - d_rest[:, back, axis]
    for name in space.names:
        if name.startswith("bone."):
            end = skeleton.index(name.removeprefix("bone.").split("+")[0])
            bone, change = (each[..., end, :] - each[..., skeleton.parent[end], :] for each in (joint, d_joint))
            length = float(np.linalg.norm(bone))
            lengths[name] = length, change @ bone / length
    values: dict[str, float] = {}
    for name, (value, by_parameter) in lengths.items():
        values[f"body.{name}"] = float(value)
        of_outline = 0.0 if name.startswith("bone.") or space.body.rigid else _OUTLINE * space.body.relative_size
        values[f"body.{name}.sigma"] = float(np.sqrt(by_parameter @ covariance @ by_parameter + of_outline**2))
    return values
