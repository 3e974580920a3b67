"""A clip's damped steps and its deviations on a GPU, for which the host would take longer than for all the rest."""

from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from mmocap_warp.contour.clip.motion_penalty import HELD, MotionPenalty
from mmocap_warp.contour.clip.motion_points import POINTS_A_JOINT, MotionPoints
from mmocap_warp.contour.frame.normal_equations import NormalEquations
from mmocap_warp.contour.frame.rooted import RootedPoses
from mmocap_warp.device.transfers import Download, Replays, Upload
from mmocap_warp.kernels.contour import band as band_kernels
from mmocap_warp.kernels.contour.band import Band, Course, factor, invert, put_together, solve
from mmocap_warp.kernels.structs import allocated


class Motion:
    """Points that move, and what a penalty makes of them; frames ``seen`` (frame,) bool show anything."""

    def __init__(self, points: MotionPoints, rooted: RootedPoses, penalty: MotionPenalty, seen: np.ndarray) -> None:
        self.point, self.axes = points.with_axes(rooted)
        self.terms = penalty.terms(self.point, seen)


class DeviceBand:
    """Room for the systems of so many consecutive frames beside those that are held, and what solves them."""

    def __init__(self, points: MotionPoints, frames: int, device: str) -> None:
        joints, dof, blocks, rows = len(points.below), len(points.searched), (frames + 1) // 2, frames + HELD
        size, values = 2 * dof, 3 * POINTS_A_JOINT * joints
        self._course = allocated(
            Course, device,
            coordinate=np.array(points.searched), below=points.below.astype(int), slides=points.slides.astype(int),
            point=(rows, POINTS_A_JOINT * joints), axes=(rows, joints), weight=(rows, 3, joints),
            pull=(rows, values), slope=(rows, values, dof),
        )  # fmt: skip
        self._band = allocated(
            Band, device,
            own=(frames, dof, dof), right=(frames, dof), panel=(blocks, size, 3 * size + 1), solution=(blocks, size),
            given=(blocks, size, 3 * size + 1), covariance=(blocks, size, 3 * size),
        )  # fmt: skip
        wp.load_module(band_kernels, device=device)
        course, band = self._course, self._band
        self._sent = [Upload(a) for a in (course.point, course.axes, course.weight, course.pull, band.own, band.right)]
        self._solution, self._inverse, self._replays = Download([band.solution]), Download([band.own]), Replays(device)

    def solved(self, motion: Motion, held: int, equations: NormalEquations) -> np.ndarray:
        """The step (frame, dof) from poses of which the first are ``held``.

        ``equations`` (frame,) are what each frame that is not held says by itself. Raises a LinAlgError where the
        matrix is not positive definite.
        """
        self._set(motion, equations.matrix, equations.gradient)
        frames = len(motion.point) - held
        self._replays.run((held, frames), lambda: self._launch(held, frames, solve))
        step = self._solution.read((frames + 1) // 2)[0].reshape(-1, equations.gradient.shape[1])[:frames]
        return _finite(step)

    def inverse_diagonal(self, motion: Motion, own: np.ndarray) -> np.ndarray:
        """The inverse's blocks (frame, dof, dof) on the diagonal, for poses that each say ``own`` (frame, dof, dof).

        Raises:
            numpy.linalg.LinAlgError: the matrix is not positive definite.
        """
        self._set(motion, own, np.zeros(own.shape[:2]))
        frames = len(own)
        self._replays.run(frames, lambda: self._launch(0, frames, invert))
        return _finite(self._inverse.read(frames)[0])

    def _set(self, motion: Motion, own: np.ndarray, right: np.ndarray) -> None:
        terms = motion.terms
        weight, pull = np.swapaxes(terms.couplings, 0, 1), terms.pull.reshape(len(motion.point), -1)
        for upload, values in zip(self._sent, (motion.point, motion.axes, weight, pull, own, right), strict=True):
            upload.values[: len(values)] = values

    def _launch(self, held: int, frames: int, work: Callable[[int, Any], None]) -> None:
        """Put together and factor what was set, do the work, and have both kinds of answers on their way."""
        for upload in self._sent[:4]:
            upload.send(held + frames)
        for upload in self._sent[4:]:
            upload.send(frames)
        put_together(self._course, held, frames, self._band)
        factor(frames, self._band)
        work(frames, self._band)
        self._solution.fetch((frames + 1) // 2)
        self._inverse.fetch(frames)


def _finite(values: np.ndarray) -> np.ndarray:
    if not np.isfinite(values).all():
        raise np.linalg.LinAlgError("the matrix of a clip is not positive definite")
    return values
