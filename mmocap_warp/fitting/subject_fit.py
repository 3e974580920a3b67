"""A subject without hand work: where it stands and heads, its pose in the first frame, and its body, from the masks.

1. The visual hull gives the place and the size.
2. Several headings, evenly spread, are each fitted by a short search over pose, shape and scale together. A body
   that need not stand as in its bind pose, such as a hand or a robot, is turned and bent in many ways instead, and the
   best of these are fitted. So is a person whom no heading fits: somebody who lies.
3. Contours take each to the bottom of its basin, body included. The limbs of the best few are drawn at random
   until nothing is gained.
4. The first seconds of the clip, and later ones of a long clip, are followed by contours. Some of their frames are
   solved for the body together.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from itertools import chain, islice
from operator import attrgetter

import numpy as np

from mmocap_warp.body.model import BodyModel, Subject
from mmocap_warp.body.posing import Poser
from mmocap_warp.body.rest_space import RestSpace
from mmocap_warp.body.shape_space import ShapeSpace
from mmocap_warp.body.skeleton import Skeleton
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.device.cores import available_threads
from mmocap_warp.device.resolve import resolve_device
from mmocap_warp.errors import InputError
from mmocap_warp.fitting.clip_body import InClip, follow, frames_to_follow, on_its_base, solve_body, solve_body_in_clip
from mmocap_warp.fitting.fit_config import KNOWN, LONGEST_IMAGE, FitConfig
from mmocap_warp.fitting.frame_fit import PATIENCE, FrameFit, Guess, by_turns
from mmocap_warp.fitting.screening import screened_starts, usual_poses
from mmocap_warp.fitting.standing_search import (
    FirstFrame,
    NoSubjectError,
    search_headings,
    search_starts,
    standing_start,
    subject_hull,
)
from mmocap_warp.masks.observation import Observation
from mmocap_warp.rigging.attaching import carrying
from mmocap_warp.scene.recording import Scene
from mmocap_warp.tracking.track_config import TrackConfig

_FITS = 4  # guesses that CPU threads work on at a time: each takes some 50 MB
_WINNERS = 2  # finalists whose limbs are searched until nothing is gained
_ROUNDS = 6  # rounds over the limbs, at most
_CLEAR_MARGIN = 0.03  # one frame decides by this difference of costs
_CLEAR_SHARE = 0.25  # of a given body: or by this share of the cost, if that is less
_HOPELESS = 2.0  # what costs so many times as much is not searched further, of a given body
_FAR_BEHIND = 0.06  # what costs so much more after a round over the limbs is not searched further: it gains .02 at most
_TURNED_COSINE = -0.2  # two bodies face apart if the cosine of the angle between them is smaller
_SAME_PLACE = 0.1  # joints that are nearer to each other are in the same place [m]
_MEETING_SHARE = 0.25  # of a clip's frames: two ways to see the first one that are apart in fewer are one
_NEAR, _FAR = 0.2, 0.4  # spreads of joints that begin near rest, and of a person's farthest: others begin far [rad]
_FAR_SHARE = 3  # times as many evaluations as usual find joints that begin far
_LYING_SHARE = 2  # times as many starts as usual find how a body lies that may lie any way
_LEAST_MARGIN = 0.005  # a smaller difference of costs decides nothing
_LEAST_CLIP_MARGIN = 0.02  # a smaller difference over a clip decides nothing, as a share of the contours' cost
_MOST_PARTS, _PART_SECONDS, _SPAN_SECONDS = 3, 4.0, 24.0  # at most 3, of 4 s each, begin in the first 24 s
_FAILED = 1.5  # a part that costs so many times as much as the first was not followed
_HEADINGS_SHARE, _LIMBS_SHARE = 0.4, 0.6  # shares of the work that are done after these stages, for the progress


MAX_COST = 0.12
"""Sound first frames cost .035 to .105 where nothing is hidden; what costs more is searched with any side up."""

_cost = attrgetter("cost")

FitProgress = Callable[[str, float, float], None]
"""Called with the stage's name, the share of all work done, and the best cost so far."""


def _unheard(stage: str, done: float, cost: float) -> None:
    """Progress that nobody is told of."""


def fit(
    scene: Scene,
    body: BodyModel,
    config: FitConfig,
    progress: FitProgress | None = None,
    start_poses: np.ndarray | None = None,
) -> Subject:
    """Fit a body to a scene: its first frame finds the pose, its first seconds the shape.

    Args:
        scene: the recording.
        body: the generic body that the subject's is expected to be near to; it gets what the scene says is attached.
        config: settings.
        progress: called after every stage.
        start_poses: (pose, coordinate); the recording starts in about one of them. None for the body's usual ones.
            Their place and heading are searched.

    Raises:
        InputError: the first frame's masks do not show one subject in at least two views.
    """
    body, _ = carrying(body, scene.attached)
    scale = config.scale or min(1.0, LONGEST_IMAGE / float(scene.rig().size.max()))
    numbers = frames_to_follow(scene.rate, scene.frame_count if config.frames > 1 else 1)
    span = min(scene.frame_count, round(_SPAN_SECONDS * scene.rate))  # videos are decoded up to the last part
    several = config.frames > 1 and not scene.foreground.model_remembers
    count = max(1, min(_MOST_PARTS, int(span / scene.rate / _PART_SECONDS))) if several else 1
    parts = (scene.of_frames(scene.frames[span * part // count :]) for part in range(count))
    first, *later = (islice(part.observations(scale, count=numbers[-1] + 1), 0, None, numbers.step) for part in parts)
    rig, rate = scene.rig(scale), scene.rate / numbers.step
    try:
        subject = fit_clip(body, rig, rate, first, config, progress, start_poses, later)
    except NoSubjectError as error:
        remedy = "look at masks (mmocap mask) and calibration (mmocap cameras), or begin with a later frame (--frames)"
        if scene.of_several:
            remedy = "fit each person in frames (--frames) in which labels tell them apart, or from masks of one alone"
        raise InputError(scene.path, f"frame {scene.first_frame}: {error}", remedy) from None
    begun = {"fit.first_frame": scene.first_frame} if scene.first_frame else {}
    return replace(subject, provenance=subject.provenance | begun)


def fit_clip(
    body: BodyModel,
    rig: CameraRig,
    fps: float,
    observations: Iterable[Observation],
    config: FitConfig | None = None,
    progress: FitProgress | None = None,
    start_poses: np.ndarray | None = None,
    later: Iterable[Iterable[Observation]] = (),
) -> Subject:
    """Fit a body to consecutive frames: the first finds the pose, all of them, and ``later`` such frames, the shape.

    See :func:`fit`. The cameras are undistorted, at the masks' size. Of more than one frame, such as those of
    :func:`mmocap_warp.fitting.clip_body.frames_to_follow`, all are in memory. The scale of ``config`` is not used.
    Raises a NoSubjectError where the first frame's masks do not show one subject in at least two views.
    """
    unit = body.unit
    if unit != 1:  # what is in metres below holds for people
        starts = None if start_poses is None else start_poses / body.skeleton.units(unit)
        own = body.in_unit(unit), rig.in_unit(unit)
        return fit_clip(*own, fps, observations, config, progress, starts, later).in_unit(1 / unit)
    task = _Task(body, rig, config or FitConfig(), progress or _unheard, start_poses)
    observations = iter(observations)
    first = next(observations)
    best, others = _first_frame(task, first)
    if best.cost > MAX_COST and (task_lying := task.lying):
        task.progress("lying", _LIMBS_SHARE, best.cost)
        lying, others_lying = _first_frame(task_lying, first)
        if lying.cost < best.cost - _CLEAR_MARGIN:
            best, others = lying, others_lying
    verdict = _verdict(best, others)
    margin = min(_CLEAR_MARGIN, _CLEAR_SHARE * best.cost) if task.body_is_given else _CLEAR_MARGIN
    close = [other for other in others.values() if other.cost < best.cost + margin]
    # To a person whose body is given, and who is seen in one way, the clip has nothing to add.
    clip = [first] if task.body_is_given and not close else [first, *observations]
    # Motion decides between ways to see the first frame that are nearly as good.
    ways = _with_clip_bodies(task, clip, fps, [task.subject(guess, verdict) for guess in (best, *close)])
    way, *others_in_clip = sorted(ways, key=_cost)
    others_in_clip = [other for other in others_in_clip if _stay_apart(way.places, other.places, body.relative_size)]
    decided = "yes"
    if others_in_clip:
        verdict["fit.clip_margin"] = margin = others_in_clip[0].cost / way.cost - 1
        decided = "no" if margin < _LEAST_CLIP_MARGIN else "yes"
    subject = way.subject if task.body.rigid else _with_later_frames(task, way, fps, later)
    task.progress("body", 1.0, best.cost)
    return replace(subject, provenance=subject.provenance | verdict | {"fit.decided": decided})


def _with_clip_bodies(task: _Task, clip: list[Observation], fps: float, subjects: list[Subject]) -> list[InClip]:
    """Each subject with the body of the frames that it can be followed through: :func:`solve_body_in_clip`'s."""
    count, threads = task.at_a_time(len(subjects))
    settings = TrackConfig(seed=task.config.seed, device=task.device, threads=threads)

    def solved(subject: Subject) -> InClip:
        return solve_body_in_clip(subject, task.expected, task.rig, clip, fps, task.config.frames, settings)

    with ThreadPoolExecutor(count) as pool:
        return list(pool.map(solved, subjects))


def _with_later_frames(task: _Task, way: InClip, fps: float, later: Iterable[Iterable[Observation]]) -> Subject:
    """A subject whose body later parts of a long recording show too: a body in other poses is seen better."""
    known = _Task(way.subject.body, task.rig, replace(task.config, **KNOWN), _unheard)
    settings = TrackConfig(seed=task.config.seed, device=task.device, threads=task.threads)
    parts = []
    for frames in later:
        with suppress(NoSubjectError, InputError):  # what cannot be read is named where it is tracked
            clip = list(frames)
            part = follow(known.subject(_first_frame(known, clip[0])[0], {}), task.rig, clip, fps, settings)
            if part.neighbours and part.cost.mean() < _FAILED * way.followed.cost.mean():
                parts.append(part.spread(task.config.frames))
    if not parts:
        return way.subject
    together = way.followed.spread(task.config.frames).followed_by(*parts)
    return solve_body(way.subject, task.expected, task.rig, together, task.device, task.threads)[0]


@dataclass(frozen=True)
class _Task:
    """What all stages of a fit share."""

    generic: BodyModel
    rig: CameraRig
    config: FitConfig
    progress: FitProgress
    start_poses: np.ndarray | None = None

    @cached_property
    def body(self) -> BodyModel:
        """The generic body, rigid or not; a base that stands still has to be found too."""
        generic, rigid = self.generic, self.config.rigid
        skeleton = generic.skeleton.with_free_root() if generic.skeleton.root_is_fixed else generic.skeleton
        return replace(generic, skeleton=skeleton, rigid=generic.rigid if rigid is None else rigid)

    @property
    def lying(self) -> _Task | None:
        """The task for a body that lies any way up; None where that is known, or has been searched."""
        skeleton = self.generic.skeleton
        if self.generic.rigid or not skeleton.stands or self.start_poses is not None:
            return None
        generic = replace(self.generic, skeleton=replace(skeleton, stands=False))
        return replace(self, generic=generic, progress=_unheard)

    @property
    def expected(self) -> BodyModel:
        """What a clip's body is expected to be: the generic one, with its own skeleton."""
        return replace(self.body, skeleton=self.generic.skeleton)

    @property
    def body_is_given(self) -> bool:
        """Whether the body is a person's own, as said: a robot's is by nature, and has joints that hide."""
        return self.body.rigid and not self.generic.rigid

    @cached_property
    def space(self) -> RestSpace:
        """Bodies around the generic one."""
        return RestSpace(self.body)

    @cached_property
    def device(self) -> str:
        return resolve_device(self.config.device)

    @cached_property
    def threads(self) -> int:
        return self.config.threads or available_threads()

    def at_a_time(self, most: int) -> tuple[int, int]:
        """How many of ``most`` pieces of work are done at a time, and with how many threads each; one on a GPU."""
        count = min(most, self.threads) if self.device == "cpu" else 1
        return count, -(-self.threads // count)

    def subject(self, guess: Guess, found: dict[str, str | float | int]) -> Subject:
        """A guess with its provenance."""
        settings = {f"fit.{name}": value for name, value in asdict(self.config).items() if value is not None}
        subject = Subject(self.space.model(guess.beta), guess.root_base, guess.pose, settings | found)
        return on_its_base(subject, self.generic.skeleton) if self.generic.skeleton.root_is_fixed else subject


def _first_frame(task: _Task, observation: Observation) -> tuple[Guess, dict[str, Guess]]:
    """The best guess at the first frame, and others by how they differ: turned round, or with sides swapped."""
    config, skeleton = task.config, task.body.skeleton
    # All headings to the bottom of their basins, then the limbs of the best few.
    seen = FirstFrame(task.rig, observation, config.seed, task.device, task.threads)
    patience = 1 if task.body_is_given else PATIENCE
    frame = FrameFit(task.space, seen, patience)
    count, threads = task.at_a_time(_FITS)
    alone = replace(seen, threads=threads)
    fits = [frame, *(FrameFit(task.space, alone, patience) for _ in range(count - 1))]
    kinds = [sorted(by_turns(fits, FrameFit.polished, begun), key=_cost) for begun in _headings(task, seen)]
    guesses = sorted(chain(*kinds), key=_cost)
    task.progress("headings", _HEADINGS_SHARE, guesses[0].cost)
    finalists = [*chain(*(kind[: config.finalists] for kind in kinds))]
    rounds = [(1, frame.split_random()) for _ in finalists]
    finalists = sorted(by_turns(fits, FrameFit.with_limbs_found, finalists, *zip(*rounds, strict=True)), key=_cost)
    finalists = sorted((frame.with_limbs_found(guess, _ROUNDS) for guess in finalists[:_WINNERS]), key=_cost)
    best = finalists[0]
    # Limbs that explain each other's masks: both from rest, or each from the other's place.
    anew, exchanged = frame.with_pairs_anew(best), frame.with_places_exchanged(best)
    better = min(anew + exchanged, key=_cost, default=best)
    if better.cost < best.cost:
        best = frame.with_limbs_found(better, _ROUNDS)
    task.progress("limbs", _LIMBS_SHARE, best.cost)
    # Other ways to see the frame: the best that faces the other way, and the best with two limbs exchanged.
    turned = [guess for guess in finalists + guesses if _turned(skeleton, best, guess)]
    others: dict[str, Guess] = {}
    there = task.subject(best, {})
    if turned:
        other = min(turned, key=_cost)
        if not (task.body_is_given and other.cost > _HOPELESS * best.cost):
            other = frame.with_limbs_found(other, _ROUNDS, most=best.cost + _FAR_BEHIND)
        if _differ(there, task.subject(other, {})):  # else it has turned back
            others["turned"] = other
    exchanged = [guess for guess in exchanged if guess.cost < best.cost + _LEAST_MARGIN]
    swapped = [finalists[0], *anew, *exchanged, *frame.with_sides_swapped(best)]
    swapped = [guess for guess in swapped if _differ(there, task.subject(guess, {}))]
    if swapped:
        others["swapped"] = min(swapped, key=_cost)
    # One of them may be the best in the end.
    for name, other in others.items():
        if other.cost < best.cost:
            best, others[name] = other, best
    return best, others


def _turned(skeleton: Skeleton, one: Guess, other: Guess) -> bool:
    """Whether one faces away from the other. Bodies that may lie any way up are compared by the turn between them."""
    here, there = one.orientation(skeleton), other.orientation(skeleton)
    cosine = there[:, 2] @ here[:, 2] if skeleton.stands else (np.trace(here.T @ there) - 1) / 2
    return bool(cosine < _TURNED_COSINE)


def _differ(one: Subject, other: Subject) -> bool:
    """Whether a joint of two subjects is in another place."""
    places = [Poser(each.body, each.root_base).joint_transforms(each.pose)[0, :, :3, 3] for each in (one, other)]
    return bool(np.linalg.norm(places[0] - places[1], axis=1).max() > _SAME_PLACE * one.body.relative_size)


def _stay_apart(one: np.ndarray, other: np.ndarray, size: float) -> bool:
    """Whether a joint is elsewhere in many frames, of joints' places (frame, joint, 3): some ways meet soon."""
    apart = [np.linalg.norm(here - there, axis=1).max() for here, there in zip(one, other, strict=False)]
    return bool(np.mean(np.array(apart) > _SAME_PLACE * size) > _MEETING_SHARE)


def _verdict(best: Guess, others: dict[str, Guess]) -> dict[str, str | float | int]:
    """What the first frame says: the best cost, the next best way to see it, and how far that is behind."""
    if not others:
        return {"fit.cost": best.cost, "fit.margin": float("nan")}
    name = min(others, key=lambda name: others[name].cost)
    return {"fit.cost": best.cost, "fit.margin": others[name].cost - best.cost, "fit.alternative": name}


def _headings(task: _Task, frame: FirstFrame) -> list[list[Guess]]:
    """A guess for each heading, or for each of the best ways to turn and bend a body that has no usual ones.

    A body whose motions lead far from its rest pose may also begin in one of their poses: then there are both kinds.

    Where the body carries something, two for each heading, of its own size and scaled to the hull's: a racket held high
    makes the hull taller, not the person.
    """
    config, shapes, body, given = task.config, ShapeSpace(task.body, task.rig.up), task.body, task.start_poses
    far = bool(body.skeleton.spread[~body.skeleton.is_attached].max() > _FAR)

    def turned_about(poses: np.ndarray, most: int, near_rest: bool) -> np.ndarray:
        starts = screened_starts(shapes, frame, subject_hull(body, frame), poses, most)
        return search_starts(shapes, frame, starts, config.evaluations, near_rest=near_rest)

    if given is not None:
        kinds = [turned_about(given, config.headings, False)]
    elif body.skeleton.stands and not body.rigid:
        sizes = (True, False) if body.skeleton.attached else (True,)
        starts = [standing_start(shapes, frame, scaled=scaled) for scaled in sizes]
        # Where joints may begin far from the rest pose, more is spent, and all are also searched near to it.
        near = replace(body.skeleton, spread=np.minimum(body.skeleton.spread, _NEAR))
        spaces = [shapes, ShapeSpace(replace(body, skeleton=near), task.rig.up)][: 1 + far]
        spent = config.headings, config.evaluations * (_FAR_SHARE if far else 1)
        searched = [search_headings(space, frame, start, *spent) for space in spaces for start in starts]
        kinds = [np.concatenate(searched)]
    else:
        most = config.headings * (1 if body.skeleton.stands else _LYING_SHARE)
        kinds = [turned_about(usual_poses(body.skeleton, body.rigid, config.seed), most, True)]
    if given is None and far and not body.rigid and body.motion_poses is not None:
        kinds.append(turned_about(body.motion_poses, config.headings, False))
    subjects = ((shapes.subject(coordinates.astype(np.float64), {}) for coordinates in kind) for kind in kinds)
    return [[Guess(task.space.nearest(each.body), each.root_base, each.pose) for each in kind] for kind in subjects]
