"""How well cameras explain frames that had no part in finding them, each view also by what the others say alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mmocap_warp.body.posing import Poser
from mmocap_warp.body.rest_space import RestSpace
from mmocap_warp.calibration.adjust.camera_changes import KINDS
from mmocap_warp.calibration.adjust.camera_problem import CameraProblem, camera_fitter
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.cameras.silhouette import intersection_over_union, silhouettes
from mmocap_warp.contour.frame.fitter import WIDE, MatchingConfig
from mmocap_warp.contour.frame.rooted import RootedPoses, Rooting
from mmocap_warp.masks.observation import Observation, unpack_masks

_STEPS = (4, 8)  # with wide matching, then with the usual one


@dataclass(frozen=True, eq=False)
class Explained:
    """Intersection over union of masks and the body.

    Attributes:
        together: (camera,) means over the frames, with body and poses from all views.
        apart: (camera,) the same, of each view with body and poses from the other views alone.
    """

    together: np.ndarray
    apart: np.ndarray


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Frames that judge cameras.

    Attributes:
        space: bodies around the one that is expected.
        rooting: moves poses.
        share: of the space's standard deviations, how far from the expected body the person may be.
        device: a Warp device.
        threads: CPU threads.
    """

    space: RestSpace
    rooting: Rooting
    share: float
    device: str
    threads: int

    def explained(
        self,
        rig: CameraRig,
        lag: np.ndarray,
        observations: Sequence[Observation],
        start: RootedPoses,
        beta: np.ndarray,
        velocity: np.ndarray,
    ) -> Explained:
        """How well a rig explains frames, whose body and poses are solved with it.

        Args:
            rig: the cameras.
            lag: (camera,) how much later in its own frames each shows what happens [s].
            observations: the masks of the frames.
            start: poses to start from.
            beta: (parameter,) body to start from.
            velocity: (frame, dof) of the searched coordinates.
        """
        apart = np.full(len(rig), np.nan)
        for k in range(len(rig)):
            others = [_without(observation, k) for observation in observations]
            solved = self._solved(rig, lag, others, start, beta, velocity)
            apart[k] = self._overlap(rig, k, lag[k], observations, *solved, velocity)
        solved = self._solved(rig, lag, observations, start, beta, velocity)
        together = [self._overlap(rig, k, lag[k], observations, *solved, velocity) for k in range(len(rig))]
        return Explained(np.array(together), apart)

    def _solved(
        self,
        rig: CameraRig,
        lag: np.ndarray,
        observations: Sequence[Observation],
        rooted: RootedPoses,
        beta: np.ndarray,
        velocity: np.ndarray,
    ) -> tuple[RootedPoses, np.ndarray]:
        """Poses and the body's parameters."""
        frames = np.arange(len(rooted))
        for matching, steps in zip((WIDE, MatchingConfig()), _STEPS, strict=True):
            fitter = camera_fitter(self.space, rig, observations, matching, self.device, self.threads)
            held = np.zeros((len(rig), len(KINDS)))
            problem = CameraProblem(fitter, rig, lag, self.space, self.rooting, self.share, held, larger=0)
            solution = problem.problem(velocity).solved(frames, rooted, problem.start(beta, held), steps)
            rooted, beta = solution.rooted, solution.beta[: len(beta)]
        return rooted, beta

    def _overlap(
        self,
        rig: CameraRig,
        k: int,
        lag: float,
        observations: Sequence[Observation],
        rooted: RootedPoses,
        beta: np.ndarray,
        velocity: np.ndarray,
    ) -> float:
        """Mean overlap of a view's masks with the body; NaN where it sees nobody."""
        solved, camera = self.space.model(beta), rig.select((rig.names[k],))
        there = self.rooting.stepped(rooted, -lag * velocity)
        pose = self.rooting.leave(there, np.zeros(3))
        vertices = Poser(solved, self.rooting.root_base).tracking_vertices(pose)
        overlaps = []
        for observation, posed in zip(observations, vertices, strict=True):
            if observation.foreground[k]:
                drawn = silhouettes(camera, posed, solved.tracking_face)[0]
                mask = unpack_masks(observation.words[k : k + 1], camera.size)[0]
                overlaps.append(intersection_over_union(drawn, mask))
        return float(np.mean(overlaps)) if overlaps else float("nan")


def _without(observation: Observation, k: int) -> Observation:
    """The frame with a view of which nothing was seen."""
    words, foreground = observation.words.copy(), observation.foreground.copy()
    words[k], foreground[k] = 0, 0
    return replace(observation, words=words, foreground=foreground)
