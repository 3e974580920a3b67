"""Where the tracked body is seen, which decides what ``keep = "nearest"`` keeps of the masks."""

from collections.abc import Callable, Iterator, Sequence
from itertools import compress

import numpy as np

from mmocap_warp.body.model import Subject
from mmocap_warp.body.posing import Poser
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.cameras.silhouette import silhouettes
from mmocap_warp.masks.observation import Observation
from mmocap_warp.result.result import Result
from mmocap_warp.scene.frame_choice import covering
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


def images_of(scene: Scene, numbers: list[int], scale: float) -> Iterator[list[np.ndarray | None]]:
    """A scene's images of some ascending frame numbers, read in one pass."""
    frames = covering(numbers)
    return compress(scene.of_frames(frames).images(scale), np.isin(frames, numbers).tolist())


def tracked_masks(scene: Scene, result: Result, positions: Sequence[int] | None = None) -> Iterator[list[np.ndarray]]:
    """The masks that a result was tracked from, made again: per frame of the result, per camera (height, width) bool.

    What ``keep = "nearest"`` kept depended on where the body was tracked, and so depends on the result here. Positions
    in ``result.frame_numbers`` are ascending; all are taken where they are omitted.

    Raises:
        InputError: images that turn out unreadable.
    """
    part, wanted, scale, body = _again(scene, result, positions)
    return compress(part.masks(scale, body=body), wanted)


def tracked_observations(scene: Scene, result: Result, positions: Sequence[int] | None = None) -> Iterator[Observation]:
    """As :func:`tracked_masks`, with what else a tracker is told."""
    part, wanted, scale, body = _again(scene, result, positions)
    return compress(part.observations(scale, body=body), wanted)


def _again(
    scene: Scene, result: Result, positions: Sequence[int] | None
) -> tuple[Scene, list[bool], float, BodyMasks | None]:
    """A scene of frames, which of them are those at ``positions``, the masks' scale, and where the body was before."""
    scale = float(result.config.get("scale", 1.0))
    chosen = np.arange(len(result.frame_numbers)) if positions is None else np.asarray(positions, int)
    numbers = result.frame_numbers[chosen]
    frames = covering(numbers.tolist())
    tracked = result.pose if result.raw_pose is None else result.raw_pose
    poses = [result.subject.pose[None], *np.moveaxis(tracked, 1, 0)]
    last = chosen[np.searchsorted(numbers, frames, side="right") - 1]  # a frame of a gap has the pose before it
    before = map(body_silhouettes(result.subject, result.cameras), (poses[position] for position in last))
    body = (lambda: next(before)) if scene.foreground.keep == "nearest" else None
    return scene.of_frames(frames), np.isin(frames, numbers).tolist(), scale, body
