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

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from mmocap_warp.body import FULL_DOF, FULL_NAMES, BodyModel, Subject, degrees_of_freedom
from mmocap_warp.cameras import CameraRig
from mmocap_warp.errors import InputError
from mmocap_warp.hull import visual_hull
from mmocap_warp.objective import Objective
from mmocap_warp.observation import Observation
from mmocap_warp.optimizers.cma_es import CmaEs, CmaEsConfig
from mmocap_warp.search import Search
from mmocap_warp.shape_space import ShapeSpace, upright_base
from mmocap_warp.strategy import hierarchical
from mmocap_warp.tracker import available_threads, coordinate_limits, resolve_device

if TYPE_CHECKING:
    from mmocap_warp.scene import Scene

_LONGEST = 480  # pixels
_SPREAD = {"Root": 0.15, "Hip": 0.3, "Shoulder": 0.4, "Elbow": 0.4, "Knee": 0.3}
_SPREAD_ELSE = 0.15  # spine, neck, wrists, ankles [rad]
_SPREAD_TRANSLATION = 0.10  # [m]
_SPREAD_SLIDER = 0.3
_SPREAD_SCALE = 0.05  # of the logarithm


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
    cycle_evaluations: int = 4500
    pose_prior: float = 0.001
    shape_prior: float = 0.002
    device: str = "auto"
    threads: int | None = None

    def __post_init__(self) -> None:
        if self.scale is not None and not 0.0 < self.scale <= 1.0:
            raise ValueError(f"scale must be in (0, 1], got {self.scale}")
        for name in ("headings", "start_evaluations", "finalists", "cycle_evaluations"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(self, name)}")
        for name in ("final_cycles", "winner_cycles"):
            if getattr(self, name) < 0:
                raise ValueError(f"{name} must not be negative, got {getattr(self, name)}")


FitProgress = Callable[[str, float, float], None]
"""Called with the stage's name, the share of all work done, and the best cost so far."""


def fit(scene: Scene, body: BodyModel, config: FitConfig | None = None, progress: FitProgress | None = None) -> Subject:
    """Fit a body to a scene's first frame.

    Args:
        scene: the recording.
        body: where the shape starts; it needs shape targets.
        config: settings.
        progress: told after every stage.

    Raises:
        InputError: the first frame's masks do not show one subject in at least two views.
    """
    config = config or FitConfig()
    scale = config.scale or min(1.0, _LONGEST / float(scene.rig().size.max()))
    rig = scene.rig(scale)
    observation = next(iter(scene.observations(scale, count=1)))
    try:
        return fit_observation(body, rig, observation, config, progress)
    except NoSubjectError as error:
        remedy = "look at the masks (mmocap mask) and the calibration (mmocap cameras)"
        raise InputError(scene.path, f"frame 0: {error}", remedy) from None


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
    space = ShapeSpace(body, rig.up)
    start = _standing_start(space, rig, observation)
    fit = _Fit(space, rig, observation, config, progress)
    coordinates, costs = fit.headings(start)
    best = np.argsort(costs, kind="stable")[: config.finalists]
    coordinates, costs = fit.refine(coordinates[best], range(config.final_cycles))
    ranked = np.argsort(costs, kind="stable")
    margin = float(costs[ranked[1]] - costs[ranked[0]]) if len(costs) > 1 else float("nan")
    coordinates, costs = fit.refine(coordinates[ranked[:1]], range(config.final_cycles, fit.cycles))
    provenance = {f"fit.{name}": value for name, value in asdict(config).items() if value is not None}
    return space.subject(
        coordinates[0].astype(np.float64), provenance | {"fit.cost": float(costs[0]), "fit.margin": margin}
    )


def _standing_start(space: ShapeSpace, rig: CameraRig, observation: Observation) -> np.ndarray:
    """Coordinates of the rest pose where the visual hull stands, scaled to its height."""
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


class _Fit:
    """One fit: the shared settings of its two stages."""

    def __init__(
        self,
        space: ShapeSpace,
        rig: CameraRig,
        observation: Observation,
        config: FitConfig,
        progress: FitProgress | None,
    ) -> None:
        self._space, self._rig, self._observation, self._config = space, rig, observation, config
        self._progress = progress or (lambda stage, done, cost: None)
        self._device = resolve_device(config.device)
        self._limits = space.limits(coordinate_limits(space.body))
        self._spread = _spread(space)

    def headings(self, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Fit every heading on its own, whole body, shape and scale at once: coordinates and costs."""
        config, space = self._config, self._space
        starts = np.repeat(start[None], config.headings, axis=0)
        starts[:, space.heading_index] = 2 * np.pi * np.arange(config.headings) / config.headings
        index = np.concatenate([_dofs(), space.slider_index, [space.scale_index]])
        search = self._search(starts, [index], config.start_evaluations, population=24)
        search.objective.prior.assign(self._prior(1.0))
        search.run()
        found = search.best()
        self._progress("headings", 0.3, float(found[1].min()))
        return found

    @property
    def cycles(self) -> int:
        """All refinement cycles."""
        return self._config.final_cycles + self._config.winner_cycles

    def refine(self, starts: np.ndarray, cycles: range) -> tuple[np.ndarray, np.ndarray]:
        """Cycles over root and shape, then the parts, ever narrower: coordinates and costs."""
        space = self._space
        root_and_shape = np.concatenate([np.arange(6), space.slider_index, [space.scale_index]])
        parts = [root_and_shape, *(part.index for part in hierarchical(degrees_of_freedom(39)))]
        search = self._search(starts, parts, self._config.cycle_evaluations, population=12)
        for cycle in cycles:
            left = 1.0 - cycle / self.cycles
            search.objective.prior.assign(self._prior(max(left, 0.1)))
            search.shrink(max(0.6 * left, 0.1))
            search.run()
            self._progress("refinement", 0.3 + 0.7 * (cycle + 1) / self.cycles, float(search.best()[1].min()))
        return search.best()

    def _prior(self, strength: float) -> np.ndarray:
        """(coordinate,) quadratic pull: to the rest pose in units of the spread, and to the starting shape."""
        prior = np.zeros(len(self._space))
        prior[3:FULL_DOF] = strength * self._config.pose_prior / self._spread[3:FULL_DOF] ** 2
        prior[self._space.slider_index] = self._config.shape_prior
        return prior

    def _search(self, starts: np.ndarray, parts: list[np.ndarray], evaluations: int, population: int) -> _ShapeSearch:
        return _ShapeSearch(
            self._space,
            self._rig,
            self._observation,
            starts,
            parts,
            self._spread,
            self._limits,
            evaluations,
            CmaEsConfig(population),
            self._config,
            self._device,
        )


def _dofs() -> np.ndarray:
    return degrees_of_freedom(39).index


def _spread(space: ShapeSpace) -> np.ndarray:
    """(coordinate,) how far each coordinate may be from the start: the scale of the search and of the prior."""
    spread = np.full(len(space), _SPREAD_ELSE)
    spread[:3] = _SPREAD_TRANSLATION
    for i, name in enumerate(FULL_NAMES):
        for part, value in _SPREAD.items():
            if part in name:
                spread[i] = value
    spread[space.slider_index] = _SPREAD_SLIDER
    spread[space.scale_index] = _SPREAD_SCALE
    return spread


class _ShapeSearch:
    """A frame search whose coordinates include shape, scale and heading; one run per start."""

    def __init__(
        self,
        space: ShapeSpace,
        rig: CameraRig,
        observation: Observation,
        starts: np.ndarray,
        parts: list[np.ndarray],
        spread: np.ndarray,
        limits: np.ndarray,
        evaluations: int,
        cma_es: CmaEsConfig,
        config: FitConfig,
        device: str,
    ) -> None:
        runs = len(starts)
        seed = wp.array(config.seed + np.arange(runs), dtype=wp.int32, device=device)
        draw = wp.zeros(runs, dtype=wp.int32, device=device)
        self._spreads = [spread[part] for part in parts]
        self._optimizers = [
            CmaEs(part, scale, runs, seed, draw, evaluations, cma_es)
            for part, scale in zip(parts, self._spreads, strict=True)
        ]
        self.objective = Objective(
            space.body,
            upright_base(space.up),
            rig,
            runs * max(optimizer.particles for optimizer in self._optimizers),
            shapes=space,
            device=device,
            threads=config.threads or available_threads(),
        )
        self.objective.observe(observation)
        self._search = Search(self.objective, self._optimizers, evaluations, limits)
        self._search.best_pose.assign(starts.astype(np.float32))

    def run(self) -> None:
        self._search.run()

    def shrink(self, factor: float) -> None:
        """Start the next searches at this share of the spread."""
        for optimizer, spread in zip(self._optimizers, self._spreads, strict=True):
            optimizer.scale.assign((factor * spread).astype(np.float32))

    def best(self) -> tuple[np.ndarray, np.ndarray]:
        return self._search.best_pose.numpy().copy(), self._search.best_cost.numpy().copy()
