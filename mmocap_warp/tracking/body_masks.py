"""Where the tracked body is seen, which decides what ``keep = "nearest"`` keeps of the masks."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from mmocap_warp.body.model import Subject
from mmocap_warp.body.posing import Poser
from mmocap_warp.result.result import Result
from mmocap_warp.scene.recording import BodyMasks, Scene
from mmocap_warp.views.rig import CameraRig
from mmocap_warp.views.silhouette import silhouettes


def body_masks(subject: Subject, rig: CameraRig, last_poses: Callable[[], np.ndarray]) -> BodyMasks:
    """Says where the body was tracked last, all runs together.

    Args:
        subject: the tracked body.
        rig: undistorted cameras, at the masks' size.
        last_poses: called before each frame, returns the poses (run, 51) of the frame before.
    """
    poser, faces = Poser(subject.body, subject.root_base), subject.body.tracking_face

    def masks() -> list[np.ndarray]:
        runs = [silhouettes(rig, vertices, faces) for vertices in poser.tracking_vertices(last_poses())]
        return [np.logical_or.reduce(views) for views in zip(*runs, strict=True)]

    return masks


def tracked_masks(
    scene: Scene, result: Result, position: int = 0, count: int | None = None
) -> Iterator[list[np.ndarray]]:
    """The masks that a result was tracked from, made again: per frame of the result, per camera (height, width) bool.

    What ``keep = "nearest"`` kept depended on where the body was tracked, and so depends on the result here.

    Args:
        scene: the recording.
        result: what was tracked.
        position: in ``result.frame_numbers``, of the first frame.
        count: of frames; all to the last where omitted.

    Raises:
        ValueError: frames that the scene does not have.
        InputError: images that turn out unreadable.
    """
    scale = float(result.config.get("scale", 1.0))
    first, frames = int(result.frame_numbers[position]), len(result.frame_numbers) - position
    tracked = result.pose if result.raw_pose is None else result.raw_pose
    last_poses = iter([result.subject.pose[None], *np.moveaxis(tracked, 1, 0)][position:])
    follows = scene.foreground.keep == "nearest"
    body = body_masks(result.subject, scene.rig(scale), lambda: next(last_poses)) if follows else None
    return scene.masks(scale, first, count or frames, body)
