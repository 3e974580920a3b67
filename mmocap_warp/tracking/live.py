"""Tracking while frames still come: poses are final a few frames after they were seen, and nothing older is kept."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from mmocap_warp.body.model import Subject
from mmocap_warp.body.posing import Poser
from mmocap_warp.body.skeleton import ROOT_ANGLES
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.contour.clip.clip_problem import LAG, ClipProblem, FixedLag
from mmocap_warp.contour.clip.motion_points import MotionPoints
from mmocap_warp.contour.frame.normal_equations import NormalEquations
from mmocap_warp.contour.frame.rooted import RootedPoses, Rooting
from mmocap_warp.masks.observation import Observation
from mmocap_warp.result.result import STATUS, FrameAnswer
from mmocap_warp.tracking.frame_loop import track_frames
from mmocap_warp.tracking.from_settings import make_fitter, search_limits
from mmocap_warp.tracking.make_tracker import make_tracker
from mmocap_warp.tracking.track_config import TrackConfig

_LOST, _INTERPOLATED = STATUS.index("lost"), STATUS.index("interpolated")


@dataclass(frozen=True, eq=False)
class LiveFrame:
    """A frame's final answer.

    Attributes:
        number: of the frame, from 0.
        pose: (run, coordinate) float64, smoothed with the frames around it [m, rad].
        raw_pose: (run, coordinate), as it was tracked.
        joints: (run, joint, 3) float64, joint centres of ``pose`` in the world [m].
        iou: (run, camera) float64, overlap of ``raw_pose`` with the masks; NaN for a lost view.
        status: a name of ``STATUS`` for each run. A frame that was lost is ``interpolated`` if the body is seen both
            before and within the lag, and stays ``lost`` otherwise: its pose is where the motion led.
    """

    number: int
    pose: np.ndarray
    raw_pose: np.ndarray
    joints: np.ndarray
    iou: np.ndarray
    status: tuple[str, ...]


def track_live(
    subject: Subject,
    cameras: CameraRig,
    masks: Iterable[Sequence[np.ndarray]],
    fps: float,
    config: TrackConfig | None = None,
    **settings: Any,
) -> Iterator[LiveFrame]:
    """Track frames as they come, and give each as soon as it is final: at most nine frames after it was taken in.

    Ten frames are solved together whenever they are there, and the first four of them are final. No more than these
    are held, however long it runs. When ``masks`` ends, the frames that are left follow.

    Args:
        subject: the body, and the pose to start from.
        cameras: undistorted, at the masks' size: ``scene.rig(scale)``.
        masks: of each frame, a (height, width) bool mask of each camera.
        fps: frames a second.
        config: settings; None for the defaults.
        settings: fields of :class:`TrackConfig` to replace those of ``config``.

    Raises:
        ValueError, TypeError: a setting that cannot be, or is none; or ``smooth`` is 0.
        InputError: more than fits into the device's memory, or the tracking mesh is not closed.
    """
    config = replace(config or TrackConfig(), **settings)
    if not config.acceleration:
        raise ValueError(f"smooth must be more than 0 to track live, {config.algorithm} has {config.acceleration}")
    tracker = make_tracker(subject, cameras, config, fps)
    window = Window(subject, cameras, config, fps)
    observations = (Observation.from_masks(list(each)) for each in masks)
    for answer in track_frames(tracker, observations, keep=window.observe):
        yield from window.add(answer)
    yield from window.rest()


class Window:
    """The frames that are not final yet; ``first`` is the number of the first frame."""

    def __init__(self, subject: Subject, cameras: CameraRig, config: TrackConfig, fps: float, first: int = 0) -> None:
        skeleton = subject.body.skeleton
        searched, limits = skeleton.searched(config.dof), search_limits(subject, config)
        rooting = Rooting(skeleton, subject.root_base, searched, limits)
        points = MotionPoints(skeleton, subject.body.joint_rest, searched)
        self._fitter = make_fitter(subject, cameras, config, LAG, frames=LAG)
        self._poser = Poser(subject.body, subject.root_base)
        self._answers: list[FrameAnswer] = []
        self._first = first  # number of the first of these
        self._tracked_before = np.zeros(config.runs, bool)
        self._rooting = rooting
        self._last_angles = np.tile(subject.pose[ROOT_ANGLES], (config.runs, 1))
        self._lags = [
            FixedLag(ClipProblem(partial(self._linearise, run), rooting, points, fps), config.acceleration, first)
            for run in range(config.runs)
        ]

    def observe(self, observation: Observation) -> None:
        """Take the next frame's masks."""
        self._fitter.observe((self._first + len(self._answers)) % LAG, observation)

    def add(self, answer: FrameAnswer) -> Iterator[LiveFrame]:
        """Take the answer of the frame that was observed last; the frames that are final now."""
        self._answers.append(answer)
        solved = [lag.add(self._rooting.enter(pose[None])) for lag, pose in zip(self._lags, answer.pose, strict=True)]
        yield from self._final([each for each in solved if each is not None])

    def rest(self) -> Iterator[LiveFrame]:
        """The last frames."""
        yield from self._final([each for each in (lag.rest() for lag in self._lags) if each is not None])

    def _linearise(self, run: int, frames: np.ndarray, rooted: RootedPoses) -> NormalEquations:
        """What the contours say; nothing about frames that were lost."""
        contour = self._fitter.linearise(frames % LAG, rooted)
        return contour.of_seen(np.array([self._is_tracked(self._answers[f - self._first])[run] for f in frames]))

    def _is_tracked(self, answer: FrameAnswer) -> np.ndarray:
        """(run,) bool: the runs that are not lost."""
        is_tracked: np.ndarray = np.broadcast_to(answer.status, len(self._lags)) != _LOST
        return is_tracked

    def _final(self, solved: list[RootedPoses]) -> Iterator[LiveFrame]:
        """The oldest frames, with the poses that were solved for each run."""
        if not solved:
            return
        poses = np.stack([self._rooting.leave(*each) for each in zip(solved, self._last_angles, strict=True)])
        self._last_angles = poses[:, -1, ROOT_ANGLES]
        tracked = np.array([self._is_tracked(answer) for answer in self._answers])
        final = self._answers[: poses.shape[1]]
        self._answers = self._answers[poses.shape[1] :]
        for i, answer in enumerate(final):
            between = ~tracked[i] & self._tracked_before & tracked[i:].any(axis=0)
            self._tracked_before |= tracked[i]
            status = np.where(between, _INTERPOLATED, answer.status)
            yield LiveFrame(
                number=self._first,
                pose=poses[:, i],
                raw_pose=answer.pose.astype(float),
                joints=self._poser.joint_transforms(poses[:, i])[:, :, :3, 3].astype(float),
                iou=answer.iou,
                status=tuple(STATUS[each] for each in status),
            )
            self._first += 1
