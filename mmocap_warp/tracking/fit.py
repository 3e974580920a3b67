"""A subject without hand work: where it stands and heads, its pose in the first frame, and its body, from the masks.

1. The visual hull gives the place and the size.
2. Several headings, evenly spread, are each fitted by a short search over pose, shape and scale together.
3. Contours take each to the bottom of its basin, body included. Of the best few, limbs are drawn anew until nothing
   is gained.
4. The first seconds of the clip are followed by contours, and some of their frames solved for the body together.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np

from mmocap_warp.bodies.attaching import carrying
from mmocap_warp.body.model import BodyModel, Subject
from mmocap_warp.body.posing import Poser
from mmocap_warp.body.rest_space import RestSpace
from mmocap_warp.body.shape_space import ShapeSpace
from mmocap_warp.device import available_threads, resolve_device
from mmocap_warp.errors import InputError
from mmocap_warp.formats.toml_table import config_from_table
from mmocap_warp.tracking.clip_body import frames_to_follow, solve_body_in_clip
from mmocap_warp.tracking.config import TrackConfig
from mmocap_warp.tracking.frame_fit import FrameFit, Guess
from mmocap_warp.tracking.standing_search import NoSubjectError, search_headings, standing_start
from mmocap_warp.views.observation import Observation
from mmocap_warp.views.rig import CameraRig

if TYPE_CHECKING:
    from mmocap_warp.scene.recording import Scene

_LONGEST = 480  # pixels
_WINNERS = 2  # finalists whose limbs are searched until nothing is gained
_ROUNDS = 6  # over the limbs, at most
_CLEAR = 0.03  # of the cost: a margin by which one frame decides
_TURNED = -0.2  # cosine between the ways that two bodies face
_ELSEWHERE = 0.1  # [m]: joints that are nearer to each other are in the same place
_UNDECIDED = 0.005  # of the cost: a margin that decides nothing
_UNDECIDED_CLIP = 0.02  # the same for contours over a clip, as a share of their cost
_HEADINGS_SHARE, _LIMBS_SHARE = 0.4, 0.6  # of the work, for the progress


@dataclass(frozen=True)
class FitConfig:
    """Settings of a fit.

    Attributes:
        seed: of the random numbers.
        scale: of masks and cameras; None makes the largest image 480 pixels long, which is plenty for a shape.
        headings: evenly spread starting directions.
        evaluations: spent on each.
        finalists: headings whose limbs are searched.
        frames: of the clip's first seconds that the body is solved from; 1 takes it from the first frame alone.
        rigid: whether bones' lengths, girths and scale are known; None for what the body says.
        device: ``auto``, ``cpu`` or a CUDA device.
        threads: CPU threads; None for all that this process may use.
    """

    seed: int = 0
    scale: float | None = None
    headings: int = 8
    evaluations: int = 1000
    finalists: int = 4
    frames: int = 16
    rigid: bool | None = None
    device: str = "auto"
    threads: int | None = None

    def __post_init__(self) -> None:
        if self.scale is not None and not 0.0 < self.scale <= 1.0:
            raise ValueError(f"scale must be in (0, 1], got {self.scale}")
        for name in ("headings", "evaluations", "finalists", "frames"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(self, name)}")


FitProgress = Callable[[str, float, float], None]
"""Called with the stage's name, the share of all work done, and the best cost so far."""


def fit(
    scene: Scene,
    body: BodyModel,
    config: FitConfig | None = None,
    progress: FitProgress | None = None,
    **settings: Any,
) -> Subject:
    """Fit a body to a scene: its first frame finds the pose, its first seconds the shape.

    Args:
        scene: the recording.
        body: the generic body that the subject's is expected to be near to; it gets what the scene says is attached.
        config: settings; None for those of the scene's [fit] table.
        progress: told after every stage.
        settings: fields of :class:`FitConfig` to replace those of ``config``, such as ``headings=4``.

    Raises:
        ValueError, TypeError: a setting that cannot be, or is none.
        InputError: the first frame's masks do not show one subject in at least two views.
    """
    config = replace(config or config_from_table(FitConfig, scene.settings("fit")), **settings)
    body = carrying(body, scene.attached).body
    scale = config.scale or min(1.0, _LONGEST / float(scene.rig().size.max()))
    numbers = frames_to_follow(scene.rate, scene.frame_count if config.frames > 1 else 1)
    observations = islice(scene.observations(scale, count=numbers[-1] + 1), 0, None, numbers.step)
    try:
        subject = fit_clip(body, scene.rig(scale), scene.rate / numbers.step, observations, config, progress)
    except NoSubjectError as error:
        remedy = "look at the masks (mmocap mask) and the calibration (mmocap cameras)"
        raise InputError(scene.path, f"frame {scene.first_frame}: {error}", remedy) from None
    if scene.first_frame:
        subject = replace(subject, provenance=subject.provenance | {"fit.first_frame": scene.first_frame})
    return subject


def fit_clip(
    body: BodyModel,
    rig: CameraRig,
    fps: float,
    observations: Iterable[Observation],
    config: FitConfig | None = None,
    progress: FitProgress | None = None,
) -> Subject:
    """Fit a body to consecutive frames: the first finds the pose, all of them the shape.

    Args:
        body: the generic body that the subject's is expected to be near to.
        rig: undistorted cameras at the masks' size.
        fps: of these frames.
        observations: their masks, such as those of :func:`mmocap_warp.tracking.clip_body.frames_to_follow`; of more
            than one frame all are in memory.
        config: settings; its scale is not used.
        progress: told after every stage.

    Raises:
        NoSubjectError: the first frame's masks do not show one subject in at least two views.
    """
    task = _Task(body, rig, config or FitConfig(), progress or (lambda stage, done, cost: None))
    observations = iter(observations)
    first = next(observations)
    best, others = _first_frame(task, first)
    found = _found(best, others)
    close = [other for other in others.values() if other.cost < best.cost + _CLEAR]
    clip = [first, *observations]
    # Motion decides between ways to see the first frame that are nearly as good.
    ways = [_with_clip_body(task, clip, fps, task.subject(guess, found)) for guess in (best, *close)]
    (subject, cost), *behind = sorted(ways, key=lambda way: way[1])
    behind = [way for way in behind if _differ(subject, way[0])]  # some come to the same in the end
    decided = "yes"
    if behind:
        margin = behind[0][1] / cost - 1
        found["fit.clip_margin"] = margin
        decided = "no" if margin < _UNDECIDED_CLIP else "yes"
    task.progress("body", 1.0, best.cost)
    return replace(subject, provenance=subject.provenance | found | {"fit.decided": decided})


def _with_clip_body(task: _Task, clip: list[Observation], fps: float, subject: Subject) -> tuple[Subject, float]:
    """The subject with the body of the frames that it can be followed through, and their contours' mean cost."""
    settings = TrackConfig(seed=task.config.seed, device=task.device, threads=task.threads)
    return solve_body_in_clip(subject, task.body, task.rig, clip, fps, task.config.frames, settings)


def fit_observation(
    body: BodyModel,
    rig: CameraRig,
    observation: Observation,
    config: FitConfig | None = None,
    progress: FitProgress | None = None,
) -> Subject:
    """Fit a body to one frame's masks.

    Args:
        body: the generic body that the subject's is expected to be near to.
        rig: undistorted cameras at the masks' size.
        observation: the masks; at least two views must see the subject.
        config: settings.
        progress: told after every stage.

    Raises:
        NoSubjectError: fewer than two views see the subject, or they see different things.
    """
    task = _Task(body, rig, config or FitConfig(), progress or (lambda stage, done, cost: None))
    best, others = _first_frame(task, observation)
    found = _found(best, others)
    decided = "no" if any(other.cost < best.cost + _UNDECIDED for other in others.values()) else "yes"
    return task.subject(best, found | {"fit.decided": decided})


@dataclass(frozen=True)
class _Task:
    """What all stages of a fit share."""

    generic: BodyModel
    rig: CameraRig
    config: FitConfig
    progress: FitProgress

    @cached_property
    def body(self) -> BodyModel:
        """The generic body, rigid or not."""
        rigid = self.config.rigid
        return self.generic if rigid is None else replace(self.generic, rigid=rigid)

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

    def subject(self, guess: Guess, found: dict[str, str | float | int]) -> Subject:
        """A guess with its provenance."""
        settings = {f"fit.{name}": value for name, value in asdict(self.config).items() if value is not None}
        return Subject(self.space.model(guess.beta), guess.root_base, guess.pose, settings | found)


def _first_frame(task: _Task, observation: Observation) -> tuple[Guess, dict[str, Guess]]:
    """The best guess at the first frame, and others by how they differ: turned round, or with sides swapped."""
    config, skeleton = task.config, task.body.skeleton
    frame = FrameFit(task.space, task.rig, observation, config.seed, task.device, task.threads)
    guesses = sorted((frame.polished(guess) for guess in _headings(task, observation)), key=_cost)
    task.progress("headings", _HEADINGS_SHARE, guesses[0].cost)
    finalists = sorted((frame.with_limbs_found(guess, 1) for guess in guesses[: config.finalists]), key=_cost)
    finalists = sorted((frame.with_limbs_found(guess, _ROUNDS) for guess in finalists[:_WINNERS]), key=_cost)
    best = finalists[0]
    anew, exchanged = frame.with_pairs_anew(best), frame.with_places_exchanged(best)
    better = min(anew + exchanged, key=_cost, default=best)
    if better.cost < best.cost:
        best = frame.with_limbs_found(better, _ROUNDS)
    task.progress("limbs", _LIMBS_SHARE, best.cost)
    ahead = best.facing(skeleton)
    turned = [guess for guess in finalists + guesses if guess.facing(skeleton) @ ahead < _TURNED]
    others: dict[str, Guess] = {}
    if turned:
        others["turned"] = frame.with_limbs_found(min(turned, key=_cost), _ROUNDS)
    there = task.subject(best, {})
    exchanged = [guess for guess in exchanged if guess.cost < best.cost + _UNDECIDED]
    swapped = [finalists[0], *anew, *exchanged, *frame.with_sides_swapped(best)]
    swapped = [guess for guess in swapped if _differ(there, task.subject(guess, {}))]
    if swapped:
        others["swapped"] = min(swapped, key=_cost)
    for name, other in others.items():
        if other.cost < best.cost:
            best, others[name] = other, best
    return best, others


def _differ(one: Subject, other: Subject) -> bool:
    """Whether a joint of two subjects is in another place."""
    places = [Poser(each.body, each.root_base).joint_transforms(each.pose)[0, :, :3, 3] for each in (one, other)]
    return bool(np.linalg.norm(places[0] - places[1], axis=1).max() > _ELSEWHERE)


def _found(best: Guess, others: dict[str, Guess]) -> dict[str, str | float | int]:
    """What the first frame says: the best cost, the next best way to see it, and how far that is behind."""
    if not others:
        return {"fit.cost": best.cost, "fit.margin": float("nan")}
    name = min(others, key=lambda name: others[name].cost)
    return {"fit.cost": best.cost, "fit.margin": others[name].cost - best.cost, "fit.alternative": name}


def _headings(task: _Task, observation: Observation) -> list[Guess]:
    """A guess for each heading; where the body carries something, two, of its own size and scaled to the hull's.

    A racket held high makes the hull taller, not the person.
    """
    config, shapes = task.config, ShapeSpace(task.body, task.rig.up)
    sizes = (True, False) if task.body.skeleton.attached and not task.body.rigid else (True,)
    found = np.concatenate([
        search_headings(
            shapes, task.rig, observation, standing_start(shapes, task.rig, observation, scaled=scaled),
            headings=config.headings, evaluations=config.evaluations, seed=config.seed,
            device=task.device, threads=task.threads,
        )
        for scaled in sizes
    ])  # fmt: skip
    subjects = [shapes.subject(coordinates.astype(np.float64), {}) for coordinates in found]
    return [Guess(task.space.nearest(subject.body), subject.root_base, subject.pose) for subject in subjects]


def _cost(guess: Guess) -> float:
    return guess.cost
