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

_LEAST_AREA = 200  # of an area without a label that may be a person's [px]
_MOST_WRONG = 0.2  # share of where a body alone is seen that may have another's label; with more, labels are no help

Masks = list[np.ndarray]
"""Per camera (height, width) bool."""


def told_apart(scene: Scene, subjects: Sequence[Subject], config: TrackConfig) -> Iterator[tuple[list[Masks], Masks]]:
    """Each frame's masks of each person in a scene, and of what may be in front of them, at the scale of ``config``.

    Everybody is tracked at the same time, from the subjects' first poses, which are in the scene's order of people. A
    pixel that several people may own is that of whoever was nearest to it in the frame before. Where two bodies were,
    it may be either's.
    """
    rig, config = scene.rig(config.scale), replace(config, runs=1)
    trackers = [make_tracker(subject, rig, config, scene.rate) for subject in subjects]
    silhouettes_of = [body_silhouettes(subject, rig) for subject in subjects]
    for masks, several, things in _frames(scene, config.scale):
        drawn = [of(tracker.state.pose) for of, tracker in zip(silhouettes_of, trackers, strict=True)]
        views = [
            told_apart_in([each[k] for each in masks], several[k], [body[k] for body in drawn]) for k in range(len(rig))
        ]
        people = [[view[n] for view in views] for n in range(len(trackers))]
        unsure = [things[k] | several[k] & ~np.logical_or.reduce(view) for k, view in enumerate(views)]
        for tracker, observation in zip(trackers, _observations(people, unsure), strict=True):
            tracker.step(observation)
        yield people, unsure


def first_observations(scene: Scene, scale: float) -> list[Observation]:
    """What a scene's first frame shows of each person, in the scene's order; no pose is known yet.

    Labels and areas without a label of their own that have a common hull are one person.

    Raises:
        InputError: the views show fewer people apart.
    """
    masks, several, things = next(_frames(scene, scale))
    images = []
    for k, unsure in enumerate(several):
        unlabelled = unsure & ~np.logical_or.reduce([each[k] for each in masks])
        _, area, stats, _ = cv2.connectedComponentsWithStats(unlabelled.view(np.uint8))
        large = np.flatnonzero(stats[:, cv2.CC_STAT_AREA] >= _LEAST_AREA)
        image = np.zeros(unsure.shape, np.uint8)
        for label, number in enumerate(large[large > 0], 1 + len(masks)):
            image[area == number] = label
        for label, each in enumerate(masks, 1):
            image[each[k]] = label
        images.append(image)
    from scipy.optimize import linear_sum_assignment

    made, count = (people := People(scene.rig(scale)))(images), len(people.views)
    if count < len(masks):
        problem = f"frame {scene.first_frame} shows {count} of {len(masks)} people apart in enough views"
        raise InputError(scene.path, problem, "begin with another one (--frames), or name a subject for each of them")
    # Whoever shows most of a label is that label's; who has none takes what is left.
    seen = [[view == 1 + number for view in made] for number in range(count)]
    common = [[sum(np.count_nonzero(a & b) for a, b in zip(own, each, strict=True)) for each in seen] for own in masks]
    _, chosen = linear_sum_assignment(common, maximize=True)
    hides = [thing | (view == UNDECIDED) for thing, view in zip(things, made, strict=True)]
    return [*_observations([seen[number] for number in chosen], hides)]


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


def told_apart_in(masks: Masks, several: np.ndarray, bodies: Masks) -> Masks:
    """A view's masks of each person, without what is another's.

    Args:
        masks: of each person, the pixels of the person's own label, (height, width) bool.
        several: pixels that may be anybody's. Those with a person's label are, if labels contradict the bodies.
        bodies: each person's silhouette.
    """
    labelled = np.logical_or.reduce(masks)
    for n, (mask, body) in enumerate(zip(masks, bodies, strict=True)):
        alone = body & ~np.logical_or.reduce([*bodies[:n], *bodies[n + 1 :]])
        if np.count_nonzero(alone & labelled & ~mask) > _MOST_WRONG * np.count_nonzero(alone):
            break
    else:
        several = several & ~labelled
    if not several.any():
        return masks
    away = np.array([_distance(body) for body in bodies])
    nearest, decided = away.argmin(axis=0), np.count_nonzero(away == 0, axis=0) < 2
    return [(mask & ~several) | (several & decided & (nearest == n)) for n, mask in enumerate(masks)]


def _distance(body: np.ndarray) -> np.ndarray:
    """(height, width) how far each pixel is outside of a silhouette [px], infinite where there is none."""
    if not body.any():
        return np.full(body.shape, np.inf, np.float32)
    return np.asarray(cv2.distanceTransform(1 - body.view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE))
