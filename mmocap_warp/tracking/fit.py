"""The first frame without hand work: where the subject stands and heads, its shape, and its pose, from the masks.

1. The visual hull gives the place and the size.
2. Several headings, evenly spread, are each fitted with CMA-ES over pose, shape and scale together. A prior on the
   pose decides between them: without it a person seen from behind fits as one seen from the front, elbows and knees
   bent the wrong way.
3. The best few are refined in cycles, root and shape first and then the body's parts one after the other: where the
   whole-body search stands still, the parts go on. The prior fades, because by then the pose is nearly right.
4. The best of them goes on alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from itertools import chain, islice
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from mmocap_warp.body.model import BodyModel, Subject
from mmocap_warp.body.shape_space import ShapeSpace, upright_base
from mmocap_warp.body.skeleton import TRANSLATION
from mmocap_warp.device import available_threads, resolve_device
from mmocap_warp.errors import InputError
from mmocap_warp.formats.toml_table import config_from_table
from mmocap_warp.kernels.optimizers.populations import make_space
from mmocap_warp.objective.objective import Objective
from mmocap_warp.optimizers.cma_es import CmaEs, CmaEsConfig
from mmocap_warp.optimizers.search import Search
from mmocap_warp.tracking.clip_body import follow, frames_to_follow, solve_body
from mmocap_warp.tracking.strategy import hierarchical
from mmocap_warp.views.observation import Observation
from mmocap_warp.views.rig import CameraRig
from mmocap_warp.views.visual_hull import visual_hull

if TYPE_CHECKING:
    from mmocap_warp.scene.recording import Scene

_LONGEST = 480  # pixels
_BODY_FRAMES = 16
_SPREAD_TRANSLATION = 0.10  # [m]
_SPREAD_SLIDER = 0.3
_SPREAD_SCALE = 0.05  # of the logarithm
_WIDEST, _NARROWEST = 0.6, 0.1  # shares of the spread at which the first and the last cycle start
_HEADINGS_SHARE = 0.3  # of the work, for the progress


@dataclass(frozen=True)
class FitConfig:
    """Settings of the first-frame fit.

    Attributes:
        seed: of the random numbers.
        scale: of masks and cameras; None makes the largest image 480 pixels long, which is plenty for a shape.
        headings: evenly spread starting directions.
        start_evaluations: spent on each heading.
        finalists: headings that are refined.
        final_cycles: refinement cycles of all finalists.
        winner_cycles: further cycles of the best one.
        winner_runs: independent runs of these; the best is the answer.
        cycle_evaluations: spent in a cycle on each.
        pose_prior: pull to the rest pose at the start, per squared prior standard deviation.
        shape_prior: pull to the starting body, per squared slider.
        device: ``auto``, ``cpu`` or a CUDA device.
        threads: CPU threads; None for all that this process may use.
    """

    seed: int = 0
    scale: float | None = None
    headings: int = 8
    start_evaluations: int = 3000
    finalists: int = 3
    final_cycles: int = 3
    winner_cycles: int = 16
    winner_runs: int = 3
    cycle_evaluations: int = 4500
    pose_prior: float = 0.001
    shape_prior: float = 0.003
    device: str = "auto"
    threads: int | None = None

    def __post_init__(self) -> None:
        if self.scale is not None and not 0.0 < self.scale <= 1.0:
            raise ValueError(f"scale must be in (0, 1], got {self.scale}")
        names = (
            "headings", "start_evaluations", "finalists", "final_cycles", "winner_cycles", "winner_runs",
            "cycle_evaluations",
        )  # fmt: skip
        for name in names:
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(self, name)}")
        for name in ("pose_prior", "shape_prior"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) >= 0.0):
                raise ValueError(f"{name} must not be negative, got {getattr(self, name)}")

    @property
    def cycles(self) -> int:
        """All refinement cycles of the winner."""
        return self.final_cycles + self.winner_cycles


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
        body: where the shape starts; it needs shape targets.
        config: settings; None for those of the scene's [fit] table.
        progress: told after every stage.
        settings: fields of :class:`FitConfig` to replace those of ``config``, such as ``headings=4``.

    Raises:
        ValueError, TypeError: a setting that cannot be, or is none.
        InputError: the first frame's masks do not show one subject in at least two views.
    """
    config = replace(config or config_from_table(FitConfig, scene.settings("fit")), **settings)
    scale = config.scale or min(1.0, _LONGEST / float(scene.rig().size.max()))
    rig = scene.rig(scale)
    numbers = frames_to_follow(scene.fps, scene.frame_count)
    observations = iter(scene.observations(scale, count=numbers[-1] + 1))
    first = next(observations)
    try:
        subject = fit_observation(body, rig, first, config, progress)
    except NoSubjectError as error:
        remedy = "look at the masks (mmocap mask) and the calibration (mmocap cameras)"
        raise InputError(scene.path, f"frame 0: {error}", remedy) from None
    device, threads = resolve_device(config.device), config.threads or available_threads()
    clip = islice(chain([first], observations), 0, None, numbers.step)
    followed = follow(subject, rig, clip, device, threads).spread(_BODY_FRAMES)
    return solve_body(subject, body, rig, followed, device, threads)


class NoSubjectError(ValueError):
    """The masks do not show one subject."""


def fit_observation(
    body: BodyModel,
    rig: CameraRig,
    observation: Observation,
    config: FitConfig | None = None,
    progress: FitProgress | None = None,
) -> Subject:
    """Fit a body to one frame's masks.

    Args:
        body: where the shape starts; it needs shape targets.
        rig: undistorted cameras at the masks' size.
        observation: the masks; at least two views must see the subject.
        config: settings.
        progress: told after every stage.

    Raises:
        NoSubjectError: fewer than two views see the subject, or they see different things.
    """
    config = config or FitConfig()
    task = _Task(ShapeSpace(body, rig.up), rig, observation, config, progress or (lambda stage, done, cost: None))
    coordinates, costs = _fit_headings(task, _standing_start(task))
    finalists = np.argsort(costs, kind="stable")[: config.finalists]
    coordinates, costs = _refine(task, coordinates[finalists], range(config.final_cycles))
    ranked = np.argsort(costs, kind="stable")
    margin = float(costs[ranked[1]] - costs[ranked[0]]) if len(costs) > 1 else float("nan")
    winner = np.repeat(coordinates[ranked[:1]], config.winner_runs, axis=0)
    coordinates, costs = _refine(task, winner, range(config.final_cycles, config.cycles))
    best = int(np.argmin(costs))
    provenance = {f"fit.{name}": value for name, value in asdict(config).items() if value is not None}
    found = {"fit.cost": float(costs[best]), "fit.margin": margin}
    return task.space.subject(coordinates[best].astype(np.float64), provenance | found)


@dataclass(frozen=True)
class _Task:
    """What all stages of a fit share."""

    space: ShapeSpace
    rig: CameraRig
    observation: Observation
    config: FitConfig
    progress: FitProgress

    @cached_property
    def spread(self) -> np.ndarray:
        """(coordinate,) how far each may be from the start: the scale of the search and of the prior."""
        space = self.space
        spread = np.full(len(space), np.inf)  # the heading's is not used
        spread[:TRANSLATION] = _SPREAD_TRANSLATION
        spread[TRANSLATION : space.body.skeleton.coordinates] = np.repeat(space.body.skeleton.spread, 3)
        spread[space.slider_index] = _SPREAD_SLIDER
        spread[space.scale_index] = _SPREAD_SCALE
        return spread

    def prior(self, strength: float) -> np.ndarray:
        """(coordinate,) quadratic pull: to the rest pose in units of the spread, and to the starting shape."""
        prior = np.zeros(len(self.space))
        angles = slice(TRANSLATION, self.space.body.skeleton.coordinates)
        prior[angles] = strength * self.config.pose_prior / self.spread[angles] ** 2
        prior[self.space.slider_index] = self.config.shape_prior
        return prior


def _standing_start(task: _Task) -> np.ndarray:
    """Coordinates of the rest pose where the visual hull stands, scaled to its height."""
    space, rig, observation = task.space, task.rig, task.observation
    hull = visual_hull(rig, observation, spacing=0.03)
    if len(hull) < 100:
        hull = visual_hull(rig, observation, spacing=0.03, tolerate=1)
    if len(hull) < 100:
        raise NoSubjectError("the silhouettes of at least two views do not meet anywhere in space")
    up = upright_base(rig.up)[:, 1]
    low, high = np.percentile(hull @ up, [0.5, 99.5])
    body = space.body
    scale = np.clip((high - low) / np.ptp(body.skin.rest[:, 1]), 0.6, 1.4)
    centre = np.median(hull, axis=0)
    coordinates = np.zeros(len(space))
    root_height = low + scale * (body.joint_rest[0, 1] - body.skin.rest[:, 1].min())
    coordinates[:3] = centre + (root_height - centre @ up) * up
    coordinates[space.scale_index] = np.log(scale)
    return coordinates


def _fit_headings(task: _Task, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Fit every heading on its own, whole body, shape and scale at once: coordinates and costs."""
    config, space = task.config, task.space
    starts = np.repeat(start[None], config.headings, axis=0)
    starts[:, space.heading_index] = 2 * np.pi * np.arange(config.headings) / config.headings
    everything = np.concatenate([space.body.skeleton.searched(), space.slider_index, [space.scale_index]])
    search = _ShapeSearch(task, starts, [everything], config.start_evaluations, population=24)
    search.run(prior=task.prior(1.0), narrowing=1.0)
    coordinates, costs = search.best()
    task.progress("headings", _HEADINGS_SHARE, float(costs.min()))
    return coordinates, costs


def _refine(task: _Task, starts: np.ndarray, cycles: range) -> tuple[np.ndarray, np.ndarray]:
    """Cycles over root and shape, then the parts, ever narrower and less held: coordinates and costs."""
    config, space = task.config, task.space
    root_and_shape = np.concatenate([np.arange(6), space.slider_index, [space.scale_index]])
    parts = [root_and_shape, *(part.index for part in hierarchical(space.body.skeleton))]
    search = _ShapeSearch(task, starts, parts, config.cycle_evaluations, population=12)
    for cycle in cycles:
        left = 1.0 - cycle / config.cycles
        search.run(prior=task.prior(max(left, 0.1)), narrowing=max(_WIDEST * left, _NARROWEST))
        done = _HEADINGS_SHARE + (1.0 - _HEADINGS_SHARE) * (cycle + 1) / config.cycles
        task.progress("refinement", done, float(search.best()[1].min()))
    return search.best()


class _ShapeSearch:
    """A search whose coordinates include shape, scale and heading; one run per start."""

    def __init__(
        self, task: _Task, starts: np.ndarray, parts: list[np.ndarray], evaluations: int, population: int
    ) -> None:
        config, space, runs = task.config, task.space, len(starts)
        device = resolve_device(config.device)
        seed = wp.array(config.seed + np.arange(runs), dtype=wp.int32, device=device)
        counter = wp.zeros(runs, dtype=wp.int32, device=device)
        self._spreads = [task.spread[part] for part in parts]
        self._optimizers = [
            CmaEs(make_space(part, radius, seed, counter), evaluations, CmaEsConfig(population))
            for part, radius in zip(parts, self._spreads, strict=True)
        ]
        self._objective = Objective(
            space.body,
            upright_base(space.up),
            task.rig,
            runs * max(optimizer.particles for optimizer in self._optimizers),
            renderer="raster",
            shapes=space,
            device=device,
            threads=config.threads or available_threads(),
        )
        self._objective.observe(task.observation)
        limits = space.limits(space.body.skeleton.coordinate_limits)
        self._search = Search(self._objective, self._optimizers, evaluations, limits)
        self._search.best_pose.assign(starts.astype(np.float32))

    def run(self, prior: np.ndarray, narrowing: float) -> None:
        """Search once more from the best so far, starting at a share of the spread."""
        self._objective.prior.assign(prior)
        for optimizer, spread in zip(self._optimizers, self._spreads, strict=True):
            optimizer.space.radius.assign((narrowing * spread).astype(np.float32))
        self._search.run()

    def best(self) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates (run, coordinate) and costs (run,), prior included."""
        return self._search.best_pose.numpy().copy(), self._search.best_cost.numpy().copy()
