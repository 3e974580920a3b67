"""Masks drawn around a tracked body, for ``mmocap mask --from-body``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mmocap_warp.errors import InputError

if TYPE_CHECKING:
    import numpy as np

    from mmocap_warp.cameras.rig import CameraRig
    from mmocap_warp.result.result import Result
    from mmocap_warp.scene.mask_writing import Refine
    from mmocap_warp.scene.recording import Scene


def masks_around_body(scene: Scene, path: Path, scale: float) -> Refine:
    """How a scene's masks are drawn around the body of a result, frame after frame.

    Raises:
        InputError: a file that is no result, a result of another recording or of a part of it, or a camera without
            video.
    """
    from mmocap_warp.commands.settings import start_warp
    from mmocap_warp.display.result_video import check_same_recording
    from mmocap_warp.formats.usd.usd_result import holds_result, read_result

    if not holds_result(path):
        raise InputError(path, "is no result", "name what mmocap track wrote; a subject has the first pose alone")
    result = read_result(path)
    check_same_recording(result, scene)
    if result.frame_numbers.tolist() != list(scene.frames):
        problem = f"has frames {_span(result.frame_numbers)}, not the {_span(scene.frames)} of the scene"
        raise InputError(path, problem, "track the same frames first, or name its frames with --frames")
    if any(source.video is None for source in scene.cameras):
        raise InputError(scene.path, "--from-body needs the video of every camera", "name them as video")
    start_warp()
    return _refine(result, scene.rig(scale))


def _span(frames: Sequence[int] | np.ndarray) -> str:
    return f"{frames[0]} to {frames[-1]} ({len(frames)})"


def _refine(result: Result, rig: CameraRig) -> Refine:
    """Takes the best run's frames in turn; a camera without an image keeps its mask."""
    from mmocap_warp.body.posing import Poser
    from mmocap_warp.cameras.silhouette import silhouettes
    from mmocap_warp.masks.around_body import mask_around_body

    poser, faces = Poser(result.subject.body, result.subject.root_base), result.subject.body.tracking_face
    poses = iter(result.pose[result.best_run])

    def refine(masks: list[np.ndarray], images: list[np.ndarray | None]) -> list[np.ndarray]:
        (vertices,) = poser.tracking_vertices(next(poses))
        depth = (rig.R @ vertices.mean(axis=0) + rig.t)[:, 2].clip(min=0.1)
        body = silhouettes(rig, vertices, faces)
        return [
            mask if image is None else mask_around_body(image, body[k], float(rig.K[k, 0, 0] / depth[k]))
            for k, (mask, image) in enumerate(zip(masks, images, strict=True))
        ]

    return refine
