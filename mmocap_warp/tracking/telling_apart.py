"""People whom masks do not tell apart: a pixel is given to whoever's pose explains it best, frame by frame."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import cv2
import numpy as np

from mmocap_warp.body.model import Subject
from mmocap_warp.masks.cleanup import around
from mmocap_warp.masks.observation import Observation
from mmocap_warp.result.result import STATUS, Result
from mmocap_warp.rigging.attaching import subject_carrying
from mmocap_warp.scene.recording import Scene
from mmocap_warp.tracking.body_masks import body_silhouettes
from mmocap_warp.tracking.from_settings import in_own_unit
from mmocap_warp.tracking.make_tracker import make_tracker
from mmocap_warp.tracking.track_config import TrackConfig

_TIE = 3  # a pixel that is nearer to one body than to the others by less may be of any [px]

Masks = list[np.ndarray]  # per camera (height, width) bool


def told_apart(scene: Scene, subjects: Sequence[Subject], config: TrackConfig) -> Iterator[tuple[list[Masks], Masks]]:
    """Each frame's masks of each person in a scene, and of what may be in front of them, at the scale of ``config``.

    All are tracked at once, from the first poses of subjects in the scene's order. Of pixels that may be anybody's each
    is that of whoever was clearly the nearest to it in the frame before, or stays in doubt.
    """
    rig, config = scene.rig(config.scale), replace(config, runs=1)
    scaled = [in_own_unit(subject_carrying(subject, scene.attached)[0], rig, config) for subject in subjects]
    trackers = [make_tracker(*each, scene.rate) for each in scaled]
    silhouettes_of = [body_silhouettes(subject, cameras) for subject, cameras, _ in scaled]
    own = zip(*(scene.of_person(name).masks(config.scale) for name in scene.people), strict=True)
    unsure_of = replace(scene, cameras=tuple(replace(each, in_front=each.several) for each in scene.cameras))
    streams = own, unsure_of.hidden(config.scale), scene.hidden(config.scale)
    for masks, several, things in zip(*streams, strict=True):
        drawn = [of(tracker.state.pose) for of, tracker in zip(silhouettes_of, trackers, strict=True)]
        people, hides = [list(each) for each in masks], list(things)
        for k in (number for number, unsure in enumerate(several) if unsure.any()):  # bodies take long to draw
            bodies = [views[k] for views in drawn]
            box = around(np.logical_or.reduce([several[k], *bodies]).view(np.uint8), 0)
            outside, unsure = (1 - body[box].view(np.uint8) for body in bodies), several[k][box]
            away = np.array([cv2.distanceTransform(each, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) for each in outside])
            nearest, second = np.sort(away, axis=0)[:2]
            decided = unsure & (second > nearest + _TIE)
            for n, person in enumerate(people):
                person[k] = person[k] & ~several[k]
                person[k][box] |= decided & (away[n] == nearest)
            hides[k] = things[k].copy()
            hides[k][box] |= unsure & ~decided
        for n, tracker in enumerate(trackers):
            others = zip(*people[:n], *people[n + 1 :], hides, strict=True)
            tracker.step(Observation.from_masks(people[n], None, [np.logical_or.reduce(each) for each in others]))
        yield people, hides


def doubted_together(results: Mapping[str, Result]) -> tuple[dict[str, Result], int]:
    """The results of people who were told apart, with all in doubt where one is, and the number of such frames.

    What one's pose does not explain was given to another.
    """
    tracked, partial = STATUS.index("tracked"), STATUS.index("partial")
    doubted = np.logical_or.reduce([each.status != tracked for each in results.values()])
    sigmas = {name: each.joint_sigma for name, each in results.items() if each.joint_sigma is not None}
    sizes = {name: np.square(sigma).sum(axis=3, keepdims=True) for name, sigma in sigmas.items()}
    worst = np.max([size.max(axis=2, keepdims=True) for size in sizes.values()], axis=0, initial=0.0)
    doubtful = {}
    for name, result in results.items():
        status = np.where(doubted & (result.status == tracked), partial, result.status).astype(result.status.dtype)
        sigma = sigmas.get(name)
        if sigma is not None:  # all joints are as unsure as the worst of anybody's; who is already keeps the bits
            missing = np.where(doubted[..., None, None], worst - sizes[name], 0.0)
            sigma = np.where(missing > 1e-6 * worst, np.sqrt(np.square(sigma) + missing / 3), sigma)
        doubtful[name] = replace(result, status=status, joint_sigma=sigma)
    return doubtful, int(doubted.any(axis=0).sum())
