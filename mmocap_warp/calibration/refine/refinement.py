"""Cameras and their times made better by the person before them.

Cameras, times, body and poses are adjusted, the person is followed again with what was found, and so on. Of all
parameters only those change that have to. Frames that had no part in it judge whether that is better than before.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mmocap_warp.body.model import BodyModel
from mmocap_warp.calibration.adjust.adjustment import AdjustConfig, Adjustment, Person, Progress, moved_subject
from mmocap_warp.calibration.adjust.camera_changes import CENTRE, OFFSET, RESPECT, changed
from mmocap_warp.calibration.refine.held_out import Explained, HeldOut
from mmocap_warp.calibration.refine.significance import selected
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.fitting.frame_fit import PRIOR
from mmocap_warp.scene.recording import Scene

_ROUNDS = 2
STATED = 0.5  # of what one frame leaves unsure: what all frames together do on made people, moving or standing


@dataclass(frozen=True, eq=False)
class Refinement:
    """Cameras as they were found.

    Attributes:
        rig: as calibrated, at full size, with what was found.
        change: (camera, parameter) by which they differ from the calibration, see
            :data:`~mmocap_warp.calibration.adjust.camera_changes.KINDS`; pixels are those of the calibrated images.
        sigma: (camera, parameter) standard deviations; of those that stayed, as they would be known.
        moved: (camera, parameter) bool: those that changed; all others are exactly what they were.
        undetermined: (camera, parameter) bool: those that the masks do not tell.
        fixed: number of the camera that stood still.
        before, after: how well frames that had no part are explained.
    """

    rig: CameraRig
    change: np.ndarray
    sigma: np.ndarray
    moved: np.ndarray
    undetermined: np.ndarray
    fixed: int
    before: Explained
    after: Explained

    @property
    def better(self) -> bool:
        """Whether frames that had no part are explained better, all views together and each by the others alone."""
        gains = [
            float(np.nanmean(after) - np.nanmean(before))
            for before, after in ((self.before.together, self.after.together), (self.before.apart, self.after.apart))
        ]
        return bool(self.moved.any()) and min(gains) > 0


def refine(
    scene: Scene, body: BodyModel, config: AdjustConfig | None = None, progress: Progress | None = None
) -> Refinement:
    """Refine a scene's cameras.

    Args:
        scene: the recording.
        body: the generic body that the person's is expected to be near to.
        config: settings.
        progress: told after every stage.

    Raises:
        ValueError: a camera that the scene does not have.
        InputError: masks that show nobody, too few frames in which the person could be followed.
    """
    adjustment = Adjustment(scene, body, config or AdjustConfig())
    told = progress or (lambda stage, done: None)
    change = adjustment.started()
    fixed = adjustment.stillest(change)
    change, _ = adjustment.seen_from(change, fixed)
    told("silhouettes", 0.05)
    subject = adjustment.fitted(change)
    told("body", 0.3)
    change, person = adjustment.with_lags(change, adjustment.followed(change, subject))
    for number in range(_ROUNDS):
        adjusted = adjustment.solved(change, person, adjustment.with_fixed(fixed), again=number > 0)
        fixed = adjustment.stillest(adjusted.change)
        change, motion = adjustment.seen_from(adjusted.change, fixed)
        body_found = replace(person.subject, body=adjustment.space.model(adjusted.beta), pose=adjusted.pose)
        person = adjustment.followed(change, moved_subject(body_found, *motion))
        told("cameras", 0.5 + 0.15 * number)
    found = _chosen(adjustment, change, person, fixed)
    told("judged", 1.0)
    return found


def _chosen(adjustment: Adjustment, change: np.ndarray, person: Person, fixed: int) -> Refinement:
    """Only what has to change, and what that is worth."""
    sigma = adjustment.with_fixed(fixed)
    adjusted = adjustment.solved(change, person, sigma, again=True)
    free = adjusted.free
    group = RESPECT + (RESPECT.max() + 1) * np.arange(len(free))[:, None]
    selection = selected(adjusted.change[free], adjusted.covariance, sigma[free], group[free])
    moved, determined, deviation = np.zeros(free.shape, bool), ~free, np.zeros(free.shape)
    moved[free], determined[free], deviation[free] = selection.moved, selection.determined, selection.sigma
    change, beta = np.where(moved, adjusted.change, 0.0), adjusted.beta
    if moved.any():
        adjusted = adjustment.solved(change, person, np.where(moved, sigma, 0.0), again=True)
        change, beta = adjusted.change, adjusted.beta
    before, after = _judged(adjustment, change, person, beta)
    full = np.ones(change.shape)
    full[:, CENTRE] = 1.0 / adjustment.footage.scale  # pixels of the calibrated images
    rig = changed(adjustment.scene.calibrated, full * change)
    return Refinement(rig, full * change, STATED * full * deviation, moved, ~determined, fixed, before, after)


def _judged(
    adjustment: Adjustment, change: np.ndarray, person: Person, beta: np.ndarray
) -> tuple[Explained, Explained]:
    frames = person.between(adjustment.config.judges, person.spread(adjustment.config.frames))
    judge = HeldOut(adjustment.space, person.motion.rooting, PRIOR, adjustment.device, adjustment.threads)
    explained = []
    for each in (np.zeros(change.shape), change):
        observations = adjustment.footage.observations(each[:, OFFSET])
        explained.append(
            judge.explained(
                changed(adjustment.given, each),
                adjustment.footage.rest(each[:, OFFSET]),
                [observations[frame] for frame in frames],
                person.motion.rooted[frames],
                beta,
                person.motion.velocity(frames),
            )
        )
    return explained[0], explained[1]
