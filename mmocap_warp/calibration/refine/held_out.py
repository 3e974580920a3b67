"""How well cameras explain frames that had no part in finding them, each view also by what the others say alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mmocap_warp.body.posing import Poser
from mmocap_warp.calibration.adjust.adjustment import Adjustment
from mmocap_warp.calibration.adjust.camera_changes import KINDS, OFFSET, changed
from mmocap_warp.calibration.adjust.camera_problem import CameraProblem, camera_fitter
from mmocap_warp.calibration.adjust.person_motion import Motion, Person
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.cameras.silhouette import intersection_over_union, silhouettes
from mmocap_warp.contour.frame.fitter import WIDE, MatchingConfig
from mmocap_warp.contour.frame.rooted import RootedPoses
from mmocap_warp.fitting.frame_fit import PRIOR
from mmocap_warp.masks.observation import Observation, unpack_masks

_STAGES = ((WIDE, 4), (MatchingConfig(), 8))  # how contours are matched, and the steps of each stage


@dataclass(frozen=True, eq=False)
class Overlaps:
    """Intersection over union of masks and the body.

    Attributes:
        together: (camera,) means over the frames, with body and poses from all views.
        apart: (camera,) the same, of each view with body and poses from the other views alone.
    """

    together: np.ndarray
    apart: np.ndarray


class HeldOutFrames:
    """Frames that judge cameras.

    Args:
        adjustment: of the cameras.
        person: whose frames that the cameras are solved from are left out.
        beta: (parameter,) body to start from.
    """

    def __init__(self, adjustment: Adjustment, person: Person, beta: np.ndarray) -> None:
        config = adjustment.config
        self._adjustment, self._beta = adjustment, beta
        self._frames = person.between(config.judges, person.spread(config.frames))
        motion: Motion = person.motion
        self._rooting, self._start = motion.rooting, motion.rooted[self._frames]
        self._velocity = motion.velocity(self._frames)

    def overlaps(self, change: np.ndarray) -> Overlaps:
        """How well cameras changed by (camera, parameter) explain the frames; body and poses are solved with them."""
        footage = self._adjustment.footage
        rig, lag = changed(self._adjustment.given, change), footage.rest(change[:, OFFSET])
        read = footage.observations(change[:, OFFSET])
        observations = [read[frame] for frame in self._frames]
        # Each view is judged by a body and poses that it had no part in.
        apart = np.full(len(rig), np.nan)
        for k in range(len(rig)):
            solution = self._solve(rig, lag, [_without_view(observation, k) for observation in observations])
            apart[k] = self._mean_overlap(rig, k, lag[k], observations, *solution)
        solution = self._solve(rig, lag, observations)
        together = [self._mean_overlap(rig, k, lag[k], observations, *solution) for k in range(len(rig))]
        return Overlaps(np.array(together), apart)

    def _solve(
        self, rig: CameraRig, lag: np.ndarray, observations: Sequence[Observation]
    ) -> tuple[RootedPoses, np.ndarray]:
        """Poses and the body's parameters, with cameras held."""
        rooted, beta, space = self._start, self._beta, self._adjustment.space
        held = np.zeros((len(rig), len(KINDS)))
        for matching, steps in _STAGES:
            fitter = camera_fitter(
                space, rig, observations, matching, self._adjustment.device, self._adjustment.threads
            )
            problem = CameraProblem(fitter, rig, lag, space, self._rooting, PRIOR, held, larger=0)
            start = problem.start(beta, held)
            solution = problem.problem(self._velocity).solved(np.arange(len(rooted)), rooted, start, steps)
            rooted, beta = solution.rooted, solution.beta[: len(beta)]
        return rooted, beta

    def _mean_overlap(
        self,
        rig: CameraRig,
        k: int,
        lag: float,
        observations: Sequence[Observation],
        rooted: RootedPoses,
        beta: np.ndarray,
    ) -> float:
        """Mean overlap of a view's masks with the body; NaN where it sees nobody."""
        # The body as it was when the view's images were taken.
        body, camera = self._adjustment.space.model(beta), rig.select((rig.names[k],))
        pose = self._rooting.leave(self._rooting.stepped(rooted, -lag * self._velocity), np.zeros(3))
        vertices = Poser(body, self._rooting.root_base).tracking_vertices(pose)
        overlaps = []
        for observation, posed in zip(observations, vertices, strict=True):
            if observation.foreground[k]:
                drawn = silhouettes(camera, posed, body.tracking_face)[0]
                mask = unpack_masks(observation.words[k : k + 1], camera.size)[0]
                overlaps.append(intersection_over_union(drawn, mask))
        return float(np.mean(overlaps)) if overlaps else float("nan")


def _without_view(observation: Observation, k: int) -> Observation:
    """The frame as if one view had seen nothing."""
    words, foreground = observation.words.copy(), observation.foreground.copy()
    words[k], foreground[k] = 0, 0
    return replace(observation, words=words, foreground=foreground)
