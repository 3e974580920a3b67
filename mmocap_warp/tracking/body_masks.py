"""Where the tracked body is seen, which decides what ``keep = "nearest"`` keeps of the masks."""

from collections.abc import Callable, Iterator, Sequence
from itertools import chain

import numpy as np

from mmocap_warp.body.model import Subject
from mmocap_warp.body.posing import Poser
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.cameras.silhouette import silhouettes
from mmocap_warp.masks.observation import Observation
from mmocap_warp.result.result import Result
from mmocap_warp.scene.frame_choice import stretches
from mmocap_warp.scene.recording import BodyMasks, Scene, ViewMasks


def body_silhouettes(subject: Subject, rig: CameraRig) -> Callable[[np.ndarray], ViewMasks]:
    """From poses (run, coordinate) of a subject, per camera (height, width) bool where it is seen in any of them.

    The cameras are undistorted, at the masks' size.
    """
    poser, faces = Poser(subject.body, subject.root_base), subject.body.tracking_face

    return lambda poses: _Views(rig, poser.tracking_vertices(poses), faces)


class _Views:
    """Where bodies (run, vertex, 3) are seen by a camera that is asked for, which few are: that takes a while."""

    def __init__(self, rig: CameraRig, bodies: np.ndarray, faces: np.ndarray) -> None:
        self._rig, self._bodies, self._faces = rig, bodies, faces

    def __getitem__(self, k: int) -> np.ndarray:
        camera = self._rig.select((self._rig.names[k],))
        return np.asarray(np.logical_or.reduce([silhouettes(camera, each, self._faces)[0] for each in self._bodies]))


def tracked_masks(scene: Scene, result: Result, positions: Sequence[int] | None = None) -> Iterator[list[np.ndarray]]:
    """The masks that a result was tracked from, made again: per frame of the result, per camera (height, width) bool.

    What ``keep = "nearest"`` kept depended on where the body was tracked, and so depends on the result here. Positions
    in ``result.frame_numbers`` are ascending; all are taken where they are omitted.

    Raises:
        InputError: images that turn out unreadable.
    """
    parts, scale, body = _again(scene, result, positions)
    return chain.from_iterable(part.masks(scale, body=body) for part in parts)


def tracked_observations(scene: Scene, result: Result, positions: Sequence[int] | None = None) -> Iterator[Observation]:
    """As :func:`tracked_masks`, with what else a tracker is told."""
    parts, scale, body = _again(scene, result, positions)
    return chain.from_iterable(part.observations(scale, body=body) for part in parts)


def _again(
    scene: Scene, result: Result, positions: Sequence[int] | None
) -> tuple[list[Scene], float, BodyMasks | None]:
    """The frames at ``positions`` as scenes, the masks' scale, and where the body was before each of them."""
    scale = float(result.config.get("scale", 1.0))
    positions = range(len(result.frame_numbers)) if positions is None else positions
    tracked = result.pose if result.raw_pose is None else result.raw_pose
    poses = [result.subject.pose[None], *np.moveaxis(tracked, 1, 0)]
    before = map(body_silhouettes(result.subject, result.cameras), (poses[position] for position in positions))
    body = (lambda: next(before)) if scene.foreground.keep == "nearest" else None
    return [scene.of_frames(each) for each in stretches(result.frame_numbers[list(positions)].tolist())], scale, body
