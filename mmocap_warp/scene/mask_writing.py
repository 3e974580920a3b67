"""Writing a scene's masks to a folder that is a scene itself: made once, read fast."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from mmocap_warp.errors import InputError
from mmocap_warp.formats.calibration.toml_rig import write_toml_rig
from mmocap_warp.formats.png import write_png
from mmocap_warp.formats.webm import WebmFile
from mmocap_warp.scene.mask_mark import MaskMark, calibration_hash
from mmocap_warp.scene.masked_scene import masked_scene
from mmocap_warp.scene.recording import Scene
from mmocap_warp.whole_file import write_whole

_TINT = np.array([0, 150, 255], np.uint8)  # BGR
_VIEW_HEIGHT = 480  # of the overlay's views, at most [px]


Refine = Callable[[list[np.ndarray], list[np.ndarray | None]], list[np.ndarray]]
"""From a frame's masks, per camera (height, width) bool, and its images to better masks."""


def write_masks(
    scene: Scene,
    folder: str | Path,
    scale: float = 1.0,
    first: int = 0,
    count: int | None = None,
    progress: Callable[[int], None] | None = None,
    look: Callable[[list[np.ndarray]], None] | None = None,
    refine: Refine | None = None,
) -> Path:
    """Write finished masks (undistorted, resampled, cleaned, repaired) and an overlay to look at.

    The folder gets ``<camera>/<frame>.png`` (1 bit), each camera's :class:`~mmocap_warp.scene.mask_mark.MaskMark`,
    ``overlay.webm``, ``pinholes.toml`` (the cameras that the masks belong to, for other programs) and last
    ``scene.toml``: the same scene, whose masks are made, read back exactly at ``scale``. Files of the same names are
    replaced.

    Args:
        scene: the recording.
        folder: made if it does not exist.
        scale: of the masks relative to the calibrated images.
        first: first frame; it becomes frame 0 of the new scene.
        count: number of frames; to the end without it.
        progress: called after each frame with the number of frames done.
        look: called with each frame's masks, per camera (height, width) bool.
        refine: makes a frame's masks of these and its images.

    Returns:
        Path of the new ``scene.toml``.

    Raises:
        InputError: images that turn out unreadable, or a folder that cannot be written to.
    """
    folder = Path(folder)
    rig = scene.rig(scale)
    try:
        for name in rig.names:
            (folder / name).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(folder, f"cannot be written to ({error})", "choose another folder") from None
    write_toml_rig(folder / "pinholes.toml", rig)
    for k, name in enumerate(rig.names):  # before any mask, so that none is ever without
        _mark(scene, k, scale, first).write(folder / name)
    done = 0
    with WebmFile(folder / "overlay.webm", scene.rate) as video:
        frames = zip(scene.masks(scale, first, count), scene.images(scale, first, count), strict=True)
        for f, (masks, images) in enumerate(frames):
            if refine is not None:
                masks = refine(masks, images)
            for name, mask in zip(rig.names, masks, strict=True):
                write_png(folder / name / f"{f:06d}.png", mask)
            video.write(draw_masks(masks, images))
            if look is not None:
                look(masks)
            done = f + 1
            if progress is not None:
                progress(done)
    write_whole(folder / "scene.toml", masked_scene(scene, folder, scale, first, done).encode())
    return folder / "scene.toml"


def _mark(scene: Scene, k: int, scale: float, first: int) -> MaskMark:
    source, rig, repaired = scene.cameras[k], scene.calibrated, scene.foreground.repair
    sizes = [tuple(int(length) for length in each.size[k]) for each in (rig.undistorted(scale), rig)]
    placed = source.recorded_scale, source.recorded_offset
    return MaskMark(
        camera=source.name,
        size=(sizes[0][0], sizes[0][1]),
        scale=scale,
        calibrated_size=(sizes[1][0], sizes[1][1]),
        first_frame=scene.frames[first],
        shift=source.shift,
        stride=scene.stride,
        repaired=repaired,
        calibration=calibration_hash(rig, k, *placed, repaired),
    )


def draw_masks(masks: list[np.ndarray], images: list[np.ndarray | None]) -> np.ndarray:
    """All views side by side: masks tinted and outlined over the images (BGR), or over gray where there is none."""
    height = min(_VIEW_HEIGHT, max(mask.shape[0] for mask in masks))
    views = []
    for mask, image in zip(masks, images, strict=True):
        view = np.full((*mask.shape, 3), 40, np.uint8) if image is None else image.copy()
        view[mask] = view[mask] // 2 + _TINT // 2
        contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(view, contours, -1, _TINT.tolist(), 1)
        size = (max(1, round(view.shape[1] * height / view.shape[0])), height)
        views.append(cv2.resize(view, size, interpolation=cv2.INTER_AREA))
    return np.concatenate(views, axis=1)
