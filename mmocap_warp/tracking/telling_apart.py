"""People whom masks do not tell apart: a pixel is given to whoever's pose explains it best, frame by frame."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import cv2
import numpy as np

from mmocap_warp.body.model import Subject
from mmocap_warp.masks.observation import Observation
from mmocap_warp.scene.recording import Scene, ViewMasks
from mmocap_warp.tracking.body_masks import body_silhouettes
from mmocap_warp.tracking.make_tracker import make_tracker
from mmocap_warp.tracking.track_config import TrackConfig

_TIE = 3  # a pixel that is nearer to one body than to the others by less may be of any [px]

Masks = list[np.ndarray]
"""Per camera (height, width) bool."""


def told_apart(scene: Scene, subjects: Sequence[Subject], config: TrackConfig) -> Iterator[tuple[list[Masks], Masks]]:
    """Each frame's masks of each person in a scene, and of what may be in front of them, at the scale of ``config``.

    All are tracked at once, from the first poses of subjects in the scene's order, by what the poses of the frame
    before make each person's. What is returned is by the poses of the frame itself.
    """
    rig, config = scene.rig(config.scale), replace(config, runs=1)
    trackers = [make_tracker(subject, rig, config, scene.rate) for subject in subjects]
    silhouettes_of = [body_silhouettes(subject, rig) for subject in subjects]
    own = zip(*(scene.of_person(name).masks(config.scale) for name in scene.people), strict=True)
    unsure_of = replace(scene, cameras=tuple(replace(each, in_front=each.several) for each in scene.cameras))
    streams = own, unsure_of.hidden(config.scale), scene.hidden(config.scale)

    def bodies() -> list[ViewMasks]:
        return [of(tracker.state.pose) for of, tracker in zip(silhouettes_of, trackers, strict=True)]

    for seen in zip(*streams, strict=True):
        people, hides = _by_bodies(*seen, bodies())
        for n, tracker in enumerate(trackers):
            others = zip(*people[:n], *people[n + 1 :], hides, strict=True)
            tracker.step(Observation.from_masks(people[n], None, [np.logical_or.reduce(each) for each in others]))
        yield _by_bodies(*seen, bodies())


def _by_bodies(
    masks: Sequence[Masks], several: Masks, things: Masks, bodies: Sequence[ViewMasks]
) -> tuple[list[Masks], Masks]:
    """Masks with the pixels that may be of ``several`` people: each is whose body is clearly the nearest, or hides."""
    people, hides = [list(each) for each in masks], list(things)
    for k, unsure in enumerate(several):
        outside = (1 - views[k].view(np.uint8) for views in bodies)
        away = np.array([cv2.distanceTransform(each, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) for each in outside])
        nearest, second = np.sort(away, axis=0)[:2]
        decided = unsure & (second > nearest + _TIE)
        for n, person in enumerate(people):
            person[k] = (person[k] & ~unsure) | (decided & (away[n] == nearest))
        hides[k] = things[k] | (unsure & ~decided)
    return people, hides
