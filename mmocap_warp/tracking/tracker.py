"""A frame's step: an observation in, poses out, one frame's answer starting the next."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np

from mmocap_warp.body.model import Subject
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.masks.observation import Observation
from mmocap_warp.result.result import STATUS, FrameAnswer
from mmocap_warp.tracking.algorithms import PRESETS
from mmocap_warp.tracking.pose_search import PoseSearch
from mmocap_warp.tracking.track_config import TrackConfig

_LEAST_VIEWS = 4  # that see anything, for one of them to be left out
_INSTEAD = 0.3  # overlap below which a view may show another instead of the body
_CROWDED = 0.3  # mask beside the body over the body's own area from which on somebody else is in a view too
_COVERED = 0.8  # share of the body that such a mask shows: it is the body's as well
_USUALLY_BESIDE = 0.05  # mask beside the body over the body's own area where it is alone
CROWDED_OVERLAP = 1 / (1 + _CROWDED)  # views with a larger overlap show nobody else


@dataclass(frozen=True, eq=False)
class TrackState:
    """All that the next frame depends on."""

    pose: np.ndarray  # (run, coordinate) float32, the last poses
    counter: np.ndarray  # (run,) int32, the states of the random numbers
    # float32 arrays that a search starts from besides; of a particle filter its particles (run, particle, dof) and
    # their mean (run, dof). Without them a filter begins anew at the poses
    search_memory: tuple[np.ndarray, ...] = ()

    @property
    def memory(self) -> dict[str, np.ndarray]:
        """By name, all arrays but ``pose`` and ``counter``."""
        named = {field.name: getattr(self, field.name) for field in fields(self)[2:] if field.name != "search_memory"}
        return named | {f"search {number}": array for number, array in enumerate(self.search_memory)}

    def restored(self, pose: np.ndarray, counter: np.ndarray, memory: Mapping[str, np.ndarray]) -> Self:
        """A state with a ``memory`` that another state of the same tracker gave."""
        named = {name: array for name, array in memory.items() if not name.startswith("search ")}
        of_search = tuple(array for name, array in memory.items() if name.startswith("search "))
        return replace(self, pose=pose, counter=counter, search_memory=of_search, **named)


class Tracker:
    """Tracks a subject frame by frame with one of the paper's algorithms, and keeps each run's last answer.

    The cameras are undistorted, at the masks' size; the preset's radii are for a frame rate of ``fps``.

    Attributes:
        device: the Warp device.
        search: what finds each frame's poses.

    Raises:
        ValueError: the body has no model with so many degrees of freedom.
    """

    def __init__(self, subject: Subject, rig: CameraRig, config: TrackConfig, fps: float) -> None:
        self.config = config
        self.search = PoseSearch(subject, rig, config, PRESETS[config.preset].algorithm(config.algorithm), fps)
        self.device = self.search.device
        self.search.best_pose.assign(np.repeat(subject.pose[None].astype(np.float32), config.runs, axis=0))

    @property
    def state(self) -> TrackState:
        """All that the next frame depends on."""
        memory = tuple(array.numpy().copy() for array in self.search.memory)
        return TrackState(self.search.best_pose.numpy().copy(), self.search.counter.numpy().copy(), memory)

    @state.setter
    def state(self, state: TrackState) -> None:
        self.search.best_pose.assign(state.pose)
        self.search.counter.assign(state.counter)
        self.search.remember(state.search_memory)

    def step(self, observation: Observation) -> FrameAnswer:
        """Find the pose of the next frame. Without any foreground the frame is lost and keeps the last pose."""
        if not observation.foreground.any():
            return lost_frame(self.search.best_pose.numpy().copy(), len(observation.foreground))
        search = self.search
        search.objective.observe(observation)
        started = time.perf_counter()
        search.run()
        pose = search.best_pose.numpy().copy()
        seconds = time.perf_counter() - started
        iou = overlap(search.judge(), observation)
        status = STATUS.index("tracked" if observation.foreground.all() else "partial")
        return FrameAnswer(pose, search.best_cost.numpy().copy(), iou, search.evaluations, status, seconds)


def lost_frame(pose: np.ndarray, cameras: int) -> FrameAnswer:
    """The answer where so many cameras see nothing: the last poses (run, coordinate)."""
    iou, cost = np.full((len(pose), cameras), np.nan), np.full(len(pose), np.nan, np.float32)
    return FrameAnswer(pose, cost, iou, 0, STATUS.index("lost"), 0.0)


def overlap(count: np.ndarray, observation: Observation, others: np.ndarray | int = 0) -> np.ndarray:
    """Intersection over union (n, camera) of pixel counts (n, camera, 2), |M| and |M and F|; NaN for a lost view.

    Pixels of F that are ``others``' (n, camera) do not count.
    """
    count = count.astype(np.float64)
    union = count[..., 0] + observation.foreground - count[..., 1] - others
    return np.where(observation.foreground > 0, count[..., 1] / np.maximum(union, 1), np.nan)


def others_in(count: np.ndarray, foreground: np.ndarray) -> np.ndarray:
    """Pixels (n, camera) of masks F that are somebody else's, by ``count`` (n, camera, 2) of |M| and |M and F|.

    A mask that shows the whole body and far more shows others. Of one that shows another instead, nothing is known.
    """
    body, beside = np.maximum(count[..., 0], 1), foreground - count[..., 1]
    crowded = (beside > _CROWDED * body) & (count[..., 1] > _COVERED * body)
    return np.where(crowded, beside - (_USUALLY_BESIDE * body).astype(int), 0)


def without_stranger(iou: np.ndarray) -> np.ndarray:
    """(n,) mean overlap of views (n, camera) that see anything; of four and more one may show another instead."""
    least, most = (of.reduce(iou, axis=1, keepdims=True) for of in (np.fmin, np.fmax))
    lowest = (iou == least) & (iou < _INSTEAD) & (least < most)
    many = np.isfinite(iou).sum(axis=1, keepdims=True) >= _LEAST_VIEWS
    return np.asarray(np.nanmean(np.where(many & lowest, np.nan, iou), axis=1))
