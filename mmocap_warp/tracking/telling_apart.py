"""People whom masks do not tell apart: a pixel is given to whoever's pose explains it best, frame by frame."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import cv2
import numpy as np

from mmocap_warp.body.model import Subject
from mmocap_warp.errors import InputError
from mmocap_warp.masks.observation import Observation
from mmocap_warp.masks.people import UNDECIDED, People
from mmocap_warp.scene.recording import Scene
from mmocap_warp.tracking.body_masks import body_silhouettes
from mmocap_warp.tracking.make_tracker import make_tracker
from mmocap_warp.tracking.track_config import TrackConfig

_LEAST_AREA = 200  # of a blob that may be a person [px]
_TIE = 3  # a pixel that is nearer to one body than to the others by less may be of any [px]

Masks = list[np.ndarray]
"""Per camera (height, width) bool."""


def told_apart(scene: Scene, subjects: Sequence[Subject], config: TrackConfig) -> Iterator[tuple[list[Masks], Masks]]:
    """Each frame's masks of each person in a scene, and of what may be in front of them, at the scale of ``config``.

    All are tracked at once, from the first poses of subjects in the scene's order. Of pixels that may be anybody's each
    is that of whoever was clearly the nearest to it in the frame before, or stays in doubt.
    """
    rig, config = scene.rig(config.scale), replace(config, runs=1)
    trackers = [make_tracker(subject, rig, config, scene.rate) for subject in subjects]
    silhouettes_of = [body_silhouettes(subject, rig) for subject in subjects]
    for masks, several, things in _frames(scene, config.scale):
        drawn = [of(tracker.state.pose) for of, tracker in zip(silhouettes_of, trackers, strict=True)]
        people, hides = [list(each) for each in masks], list(things)
        for k, unsure in enumerate(several):
            away = np.array([_distance(views[k]) for views in drawn])
            nearest, second = np.sort(away, axis=0)[:2]
            decided = unsure & (second > nearest + _TIE)
            for n, person in enumerate(people):
                person[k] = (person[k] & ~unsure) | (decided & (away[n] == nearest))
            hides[k] = things[k] | (unsure & ~decided)
        for tracker, observation in zip(trackers, _observations(people, hides), strict=True):
            tracker.step(observation)
        yield people, hides


def first_observations(scene: Scene, scale: float) -> list[Observation]:
    """What a scene's first frame shows of each person, in the scene's order: blobs that have a common hull.

    Raises:
        InputError: the views show fewer people apart.
    """
    from scipy.optimize import linear_sum_assignment

    masks, several, things = next(_frames(scene, scale))
    images = []
    for unsure, *own in zip(several, *masks, strict=True):
        _, image, stats, _ = cv2.connectedComponentsWithStats(unsure.view(np.uint8))
        image[stats[image, cv2.CC_STAT_AREA] < _LEAST_AREA] = 0
        for label, mask in enumerate(own, len(stats)):
            image[mask & (image == 0)] = label
        images.append(image)
    made, count = (people := People(scene.rig(scale)))(images), len(people.views)
    if count < len(masks):
        problem = f"frame {scene.first_frame} shows {count} of {len(masks)} people apart in enough views"
        raise InputError(scene.path, problem, "begin with another one (--frames), or name a subject for each of them")
    # Whoever shows most of a label is that label's; who has none takes what is left.
    seen = [[view == 1 + number for view in made] for number in range(count)]
    common = [[np.sum([(a & b).sum() for a, b in zip(own, each, strict=True)]) for each in seen] for own in masks]
    chosen = [seen[number] for number in linear_sum_assignment(common, maximize=True)[1]]
    hides = [thing | (view == UNDECIDED) for thing, view in zip(things, made, strict=True)]
    return [*_observations(chosen, hides)]


def _frames(scene: Scene, scale: float) -> Iterator[tuple[tuple[Masks, ...], Masks, Masks]]:
    """Of each frame the masks of people's own labels, of what may be anybody's, and of things in front of people."""
    unsure = replace(scene, cameras=tuple(replace(each, in_front=each.several) for each in scene.cameras))
    own = zip(*(scene.of_person(name).masks(scale) for name in scene.people), strict=True)
    return zip(own, unsure.hidden(scale), scene.hidden(scale), strict=True)


def _observations(people: Sequence[Masks], things: Masks) -> Iterator[Observation]:
    """What each person's tracker is told of masks of all."""
    for n, own in enumerate(people):
        others = zip(*people[:n], *people[n + 1 :], things, strict=True)
        yield Observation.from_masks(own, None, [np.logical_or.reduce(each) for each in others])


def _distance(body: np.ndarray) -> np.ndarray:
    """(height, width) how far each pixel is outside of a silhouette [px]; very far where there is none."""
    return np.asarray(cv2.distanceTransform(1 - body.view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE))
