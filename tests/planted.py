"""Problems whose answer is known: each frame says where the points on its joints should be, and how surely."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mmocap_warp.body.model import BodyModel
from mmocap_warp.contour.clip.block_band import BlockBand
from mmocap_warp.contour.clip.clip_problem import ClipProblem, Pass, coarse_then_fine
from mmocap_warp.contour.clip.motion_points import MotionPoints
from mmocap_warp.contour.frame.normal_equations import NormalEquations
from mmocap_warp.contour.frame.rooted import RootedPoses, Rooting


class Planted:
    """Normal equations of the distances to planted points.

    Args:
        body: whose joints carry the points.
        rooting: of its poses.
        target: (frame, point, 3) where the points are said to be [m].
        sigma: (frame,) standard deviation of that [m]; infinite where a frame shows nothing.
    """

    def __init__(self, body: BodyModel, rooting: Rooting, target: np.ndarray, sigma: np.ndarray | float) -> None:
        self.points = MotionPoints(body.skeleton, body.joint_rest, rooting.searched)
        self.target = target
        self.sigma = np.broadcast_to(sigma, len(target))
        self.calls: list[np.ndarray] = []

    def __call__(self, frames: np.ndarray, rooted: RootedPoses) -> NormalEquations:
        self.calls.append(frames)
        points, derivative = self.points.linearised(rooted)
        rows = derivative.reshape(len(frames), -1, derivative.shape[-1]) / self.sigma[frames, None, None]
        error = (self.target[frames] - points).reshape(len(frames), -1) / self.sigma[frames, None]
        across = np.swapaxes(rows, 1, 2)
        return NormalEquations(across @ rows, (across @ error[..., None])[..., 0], 0.5 * (error**2).sum(axis=1))


def swung(body: BodyModel, frames: int, rate: float, seed: int = 0) -> np.ndarray:
    """Poses (frame, coordinate) of every joint swinging at its own pace, and of a root that walks and turns round."""
    rng = np.random.default_rng(seed)
    skeleton = body.skeleton
    time = np.arange(frames)[:, None] / rate
    low, high = np.clip(skeleton.coordinate_limits.T, -0.5, 0.5)
    phase, pace = rng.uniform(0, 2 * np.pi, skeleton.coordinates), rng.uniform(0.3, 0.8, skeleton.coordinates)
    wide = np.where(np.arange(skeleton.coordinates) < 3, 0.1, 0.4) * (high - low)
    pose = (low + high) / 2 + wide * np.sin(phase + 2 * np.pi * pace * time)
    held = np.setdiff1d(np.arange(skeleton.coordinates), skeleton.searched())
    pose[:, held] = 0.0
    if skeleton.searched()[0] == 0:
        pose[:, 0] += 1.3 * time[:, 0]
        pose[:, 4] += 1.5 * time[:, 0]
    return pose


def dense(band: BlockBand) -> np.ndarray:
    """The whole matrix of a band."""
    n = band.size
    matrix = np.zeros((band.frames * n, band.frames * n))
    for apart, blocks in enumerate(band.blocks):
        for frame, block in enumerate(blocks):
            row, column = (frame + apart) * n, frame * n
            matrix[row : row + n, column : column + n] = block
            matrix[column : column + n, row : row + n] = block.T
    return matrix


class ClipSolution(NamedTuple):
    """Poses of consecutive frames, whether each showed anything, and what the contours cost (frame,)."""

    rooted: RootedPoses
    observed: np.ndarray
    cost: np.ndarray


def solved_clip(
    problem: ClipProblem, rooted: RootedPoses, passes: tuple[Pass, ...] = coarse_then_fine()
) -> ClipSolution:
    """The final frames of all of a clip's windows."""
    windows = list(problem.windows(rooted, passes))
    poses, contours = zip(*((each.rooted[: each.final], each.contour[: each.final]) for each in windows), strict=True)
    contour = contours[0].followed_by(*contours[1:])
    return ClipSolution(poses[0].followed_by(*poses[1:]), contour.observed, contour.cost)
