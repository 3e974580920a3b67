"""Tracking: observations in, poses out, one frame's answer starting the next."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from mmocap_warp.body.model import Subject
from mmocap_warp.body.posing import Poser
from mmocap_warp.errors import InputError
from mmocap_warp.formats.toml_table import config_from_table
from mmocap_warp.kernels.body.root_frame import enter, leave
from mmocap_warp.objective.objective import COSTS, Objective
from mmocap_warp.objective.renderers import RENDERERS
from mmocap_warp.optimizers.search import Search
from mmocap_warp.result.result import STATUS, FrameAnswer, Result
from mmocap_warp.tracking.algorithms import ALGORITHMS
from mmocap_warp.tracking.checkpoint import Checkpoint, FinishedFrame, fingerprint
from mmocap_warp.tracking.memory_need import check_fits
from mmocap_warp.tracking.presets import PRESETS
from mmocap_warp.tracking.strategy import hierarchical, holistic, share_budget
from mmocap_warp.versions import versions
from mmocap_warp.views.observation import Observation
from mmocap_warp.views.rig import CameraRig, project

if TYPE_CHECKING:
    from mmocap_warp.scene.recording import Scene


@dataclass(frozen=True)
class TrackConfig:
    """Settings of a tracking run.

    Attributes:
        algorithm: one of ``ALGORITHMS``.
        dof: degrees of freedom that are searched, by one of the body's models; None for its default. People have 39,
            28 and 51 (Table 1).
        evaluations: budget per frame; never exceeded.
        seed: of the first run; run r uses ``seed + r``.
        runs: independent runs, tracked at once.
        preset: where the radii come from.
        rotation_radius: [rad], over the preset's.
        translation_radius: [m], over the preset's.
        cost: ``paper`` (Eq. 4-5), ``xor`` or ``iou``.
        renderer: ``raycast`` or ``raster``; the counts, and so the results, are the same.
        limits: keep joints within their anatomical limits.
        scale: of masks and cameras, in (0, 1].
        device: ``auto``, ``cpu`` or a CUDA device.
        threads: CPU threads; None for all that this process may use.
    """

    algorithm: str = "h-cmaes"
    dof: int | None = None
    evaluations: int = 500
    seed: int = 0
    runs: int = 1
    preset: str = "recording"
    rotation_radius: float | None = None
    translation_radius: float | None = None
    cost: str = "paper"
    renderer: str = "raycast"
    limits: bool = True
    scale: float = 1.0
    device: str = "auto"
    threads: int | None = None

    def __post_init__(self) -> None:
        _one_of("algorithm", self.algorithm, ALGORITHMS)
        _one_of("preset", self.preset, PRESETS)
        _one_of("cost", self.cost, COSTS)
        _one_of("renderer", self.renderer, RENDERERS)
        for name in ("evaluations", "runs"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(self, name)}")
        if self.threads is not None and self.threads < 1:
            raise ValueError(f"threads must be at least 1, got {self.threads}")
        for name in ("rotation_radius", "translation_radius"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name} must be positive and finite, got {value}")
        if not 0.0 < self.scale <= 1.0:
            raise ValueError(f"scale must be in (0, 1], got {self.scale}")
        if not 0 <= self.seed < 2**31 - self.runs:
            raise ValueError(f"seed must be in 0 .. 2^31 - runs, got {self.seed}")

    def radii(self, fps: float) -> tuple[float, float]:
        """Rotation [rad] and translation [m] radius at a frame rate: the flags', or the preset's for it."""
        rotation, translation = PRESETS[self.preset].at(self.algorithm, fps)
        return self.rotation_radius or rotation, self.translation_radius or translation


def _one_of(name: str, value: object, allowed: Iterable[object]) -> None:
    if value not in allowed:
        raise ValueError(f"{name} must be one of {list(allowed)}, got {value!r}")


class Tracker:
    """Tracks a subject frame by frame; owns the objective, the optimizers and each run's last answer.

    Args:
        subject: where to start.
        rig: undistorted cameras at the masks' size.
        config: settings.
        fps: frame rate of the recording, for the preset's radii.

    Raises:
        ValueError: the body has no model with so many degrees of freedom.
    """

    def __init__(self, subject: Subject, rig: CameraRig, config: TrackConfig, fps: float) -> None:
        self.config = config
        self.device = resolve_device(config.device)
        skeleton = subject.body.skeleton
        algorithm = ALGORITHMS[config.algorithm]
        parts = (hierarchical if algorithm.hierarchical else holistic)(skeleton, config.dof)
        rotation, translation = config.radii(fps)
        seeds = np.arange(config.seed, config.seed + config.runs)
        seed = wp.array(seeds, dtype=wp.int32, device=self.device)
        self._draw = wp.zeros(config.runs, dtype=wp.int32, device=self.device)
        radii = [np.where(part.index < 3, translation, rotation) for part in parts]
        shares = share_budget(config.evaluations, len(parts))
        optimizers = [
            algorithm.optimizer(part.index, radius, config.runs, seed, self._draw, share)
            for part, radius, share in zip(parts, radii, shares, strict=True)
        ]
        self._objective = Objective(
            subject.body,
            subject.root_base,
            rig,
            config.runs * max(optimizer.particles for optimizer in optimizers),
            cost=config.cost,
            renderer=config.renderer,
            bases=config.runs,
            device=self.device,
            threads=config.threads or available_threads(),
        )
        self._home = wp.mat33(subject.root_base.astype(np.float32))
        self._root = wp.mat33(skeleton.frame[0].astype(np.float32))
        self._angles = wp.zeros(config.runs, dtype=wp.vec3, device=self.device)
        limits = skeleton.coordinate_limits if config.limits else np.tile([-np.inf, np.inf], (skeleton.coordinates, 1))
        self._turns_freely = bool(np.all(np.abs(limits[_ROOT_ANGLES]) >= np.pi))
        self._search = Search(self._objective, optimizers, config.evaluations, limits, replays=True)
        self._search.best_pose.assign(np.repeat(subject.pose[None].astype(np.float32), config.runs, axis=0))

    @property
    def state(self) -> tuple[np.ndarray, np.ndarray]:
        """All that the next frame depends on: last poses (run, coordinate) float32 and random counters (run,) int32."""
        return self._search.best_pose.numpy().copy(), self._draw.numpy().copy()

    @state.setter
    def state(self, value: tuple[np.ndarray, np.ndarray]) -> None:
        pose, draw = value
        self._search.best_pose.assign(pose)
        self._draw.assign(draw)

    def step(self, observation: Observation) -> FrameAnswer:
        """Find the pose of the next frame. Without any foreground the frame is lost and the pose is carried over."""
        seen = observation.foreground > 0
        runs, cameras = self.config.runs, len(seen)
        if not seen.any():
            pose = self._search.best_pose.numpy().copy()
            nothing = np.full(runs, np.nan, np.float32)
            return FrameAnswer(pose, nothing, np.full((runs, cameras), np.nan), 0, STATUS.index("lost"), 0.0)
        self._objective.observe(observation)
        started = time.perf_counter()
        self._run()
        pose = self._search.best_pose.numpy().copy()
        seconds = time.perf_counter() - started
        count = self._judge().astype(np.float64)
        union = count[..., 0] + observation.foreground - count[..., 1]
        iou = np.where(seen, count[..., 1] / np.maximum(union, 1), np.nan)
        status = STATUS.index("tracked" if seen.all() else "partial")
        return FrameAnswer(pose, self._search.best_cost.numpy().copy(), iou, self._search.evaluations, status, seconds)

    def _run(self) -> None:
        """Search, with the root's angles counted from where the last frame left them, unless they have limits."""
        if not self._turns_freely:
            self._search.run()
            return
        pose, base = self._search.best_pose, self._objective.body.root_base
        enter(self._home, self._root, pose, self._angles, base)
        self._search.run()
        leave(self._home, self._root, self._angles, pose, base)

    def _judge(self) -> np.ndarray:
        """Pixel counts of the answers, (run, camera, 2) int: |M| and |M and F|. Not an evaluation of the search.

        Where the answer is an estimate, this is also where its cost becomes known.
        """
        search, objective, runs = self._search, self._objective, self.config.runs
        wp.copy(objective.pose, search.best_pose, count=search.best_pose.size)
        wp.copy(search.best_cost, objective.evaluate(runs), count=runs)
        return objective.count.numpy()[:runs]


_ROOT_ANGLES = slice(3, 6)


def resolve_device(name: str) -> str:
    """``auto`` is the first CUDA device, or the CPU where there is none.

    Raises:
        ValueError: no such device here.
    """
    if name == "auto":
        return "cuda:0" if wp.is_cuda_available() else "cpu"
    known = [device.alias for device in wp.get_devices()]
    if name not in known and name != "cuda":
        raise ValueError(f"device must be auto or one of {known}, got {name!r}")
    return "cuda:0" if name == "cuda" else name


def available_threads() -> int:
    """CPU cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def fitting_tracker(subject: Subject, rig: CameraRig, config: TrackConfig, fps: float) -> Tracker:
    """A :class:`Tracker`, or an error where the device has not the memory for it.

    Raises:
        InputError: too many runs, or too large a budget; says what fits.
    """

    def tracker(config: TrackConfig) -> Tracker:
        return Tracker(subject, rig, config, fps)

    check_fits(tracker, config, resolve_device(config.device))
    return tracker(config)


FrameReport = Callable[[int, FrameAnswer], None]
"""Called after every frame with its position and answer."""


def collect(
    subject: Subject,
    rig: CameraRig,
    fps: float,
    config: TrackConfig,
    answers: list[FrameAnswer],
    first: int = 0,
) -> Result:
    """Gather the answers of consecutive frames, starting with frame number ``first``."""
    rotation, translation = config.radii(fps)
    device = resolve_device(config.device)
    dof = len(subject.body.skeleton.searched(config.dof))
    effective = {"dof": dof, "rotation_radius": rotation, "translation_radius": translation, "device": device}
    return Result(
        subject=subject,
        cameras=rig,
        fps=fps,
        frame_numbers=np.arange(first, first + len(answers)),
        pose=np.stack([answer.pose for answer in answers], axis=1).astype(np.float64),
        cost=np.stack([answer.cost for answer in answers], axis=1).astype(np.float64),
        iou=np.stack([answer.iou for answer in answers], axis=1),
        evaluations=np.repeat([[answer.evaluations for answer in answers]], config.runs, axis=0).astype(np.int64),
        status=np.array([answer.status for answer in answers], np.int8),
        seconds=float(sum(answer.seconds for answer in answers)),
        config=asdict(config) | effective,
        versions=versions(device),
    )


def track(
    scene: Scene,
    subject: Subject,
    config: TrackConfig | None = None,
    *,
    checkpoint: Path | None = None,
    resume: bool = False,
    progress: FrameReport | None = None,
    **settings: Any,
) -> Result:
    """Track a scene from its first frame to its last.

    Args:
        scene: the recording; its masks are streamed.
        subject: where to start.
        config: settings; None for those of the scene's [track] table.
        checkpoint: file that progress is saved to, every few seconds and when the run is interrupted.
        resume: continue from ``checkpoint`` where it exists; the result has the same bits as an uninterrupted run's.
        progress: called after every frame, also once for each frame that was already done.
        settings: fields of :class:`TrackConfig` to replace those of ``config``, such as ``evaluations=200``.

    Raises:
        ValueError, TypeError: a setting that cannot be, or is none.
        InputError: unreadable images, a checkpoint that is damaged or another run's, or more than fits into the
            device's memory.
    """
    config = replace(config or config_from_table(TrackConfig, scene.settings("track")), **settings)
    rig = scene.rig(config.scale)
    tracker = fitting_tracker(subject, rig, config, scene.fps)
    done: list[FinishedFrame] = []  # in pairs, so that no interruption finds one without the other
    store = None
    if checkpoint is not None:
        recorded = {"fps": scene.fps, "foreground": asdict(scene.foreground)}
        key = fingerprint(subject, rig, _bits(config, subject) | recorded)
        store = Checkpoint(checkpoint, key, config.runs, subject.body.skeleton.coordinates, len(rig))
        done = store.load() if resume else []
    if len(done) > scene.frame_count:
        problem = f"it has {scene.frame_count} frames, {len(done)} were tracked before"
        raise InputError(scene.path, problem, "restore [scene] frames, or start anew with --force")
    for number, (answer, _) in enumerate(done):
        if progress:
            progress(number, answer)
    if done:
        answer, draw = done[-1]
        tracker.state = (answer.pose, draw)
    try:
        body = _body_masks(tracker, subject, rig) if scene.foreground.keep == "nearest" else None
        for observation in scene.observations(config.scale, first=len(done), body=body):
            answer = tracker.step(observation)
            _, draw = tracker.state
            done.append((answer, draw))
            if progress:
                progress(len(done) - 1, answer)
            if store and store.due:
                store.save(done)
    except BaseException:
        if store:
            store.save(done)
        raise
    return collect(subject, rig, scene.fps, config, [answer for answer, _ in done])


def _body_masks(tracker: Tracker, subject: Subject, rig: CameraRig) -> Callable[[], list[np.ndarray]]:
    """Says where the body was tracked last: per camera (height, width) bool, all runs together."""
    from mmocap_warp.drawing.overlay import silhouette

    poser, faces = Poser(subject.body, subject.root_base), subject.body.tracking_face

    def masks() -> list[np.ndarray]:
        pose, _ = tracker.state
        seen = [project(rig, vertices) for vertices in poser.tracking_vertices(pose)]
        return [
            np.any([silhouette(pixels[k], faces, tuple(size)) > 0 for pixels in seen], axis=0)
            for k, size in enumerate(rig.size.tolist())
        ]

    return masks


def _bits(config: TrackConfig, subject: Subject) -> dict:
    """The settings that a run's bits depend on; the number of threads and the renderer are none of them."""
    dof = len(subject.body.skeleton.searched(config.dof))
    settings = asdict(config) | {"device": resolve_device(config.device), "dof": dof}
    del settings["threads"], settings["renderer"]
    return settings


def track_observations(
    subject: Subject,
    rig: CameraRig,
    observations: Iterable[Observation],
    fps: float,
    config: TrackConfig,
    progress: FrameReport | None = None,
) -> Result:
    """Track consecutive observations in memory or from any stream.

    Raises:
        InputError: more than fits into the device's memory.
    """
    tracker = fitting_tracker(subject, rig, config, fps)
    answers = []
    for number, observation in enumerate(observations):
        answers.append(tracker.step(observation))
        if progress:
            progress(number, answers[-1])
    return collect(subject, rig, fps, config, answers)
