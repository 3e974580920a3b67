"""A calibration to look at: the floor as a grid, the person's way over it, and the body's axis, in every view."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import cv2
import numpy as np

from mmocap_warp.cameras.rig import CameraRig, project
from mmocap_warp.display.overlay import MODEL_COLOUR, PAPER, Colour, write_text

_SQUARE = 0.5  # side of a square of the grid [m]
_AROUND = 0.75  # width of the floor around the person's way [m]
_PIECE = 0.05  # lines are drawn in pieces of this length, as far as they are seen [m]
_GRID: Colour = (150, 190, 90)
_WAY: Colour = (60, 60, 240)
_ROW_HEIGHT = 480  # height of a row of views [px]


def floor_picture(
    images: Sequence[np.ndarray], rig: CameraRig, heads: np.ndarray, frame: int, title: str
) -> np.ndarray:
    """The views of one frame side by side, BGR, with the floor, the person's way and the body's axis, below a title.

    Args:
        images: per camera, undistorted BGR, of the rig's sizes.
        rig: undistorted pinholes; the floor is at zero along ``up``.
        heads: (frame, 3), the top of the person's head [m]; NaN where not known. The images show that of ``frame``.
    """
    views = []
    for k, image in enumerate(images):
        canvas = image.copy()
        _draw(canvas, rig.select((rig.names[k],)), heads, frame)
        width = max(1, round(image.shape[1] * _ROW_HEIGHT / image.shape[0]))
        views.append(cv2.resize(canvas, (width, _ROW_HEIGHT), interpolation=cv2.INTER_AREA))
        write_text(views[-1], rig.names[k], (8, 8))
    columns = int(np.ceil(np.sqrt(len(views))))
    rows = [np.concatenate(views[at : at + columns], axis=1) for at in range(0, len(views), columns)]
    width = max(row.shape[1] for row in rows)
    banner = np.full((32, width, 3), PAPER, np.uint8)
    write_text(banner, title, (8, 6))
    padded = [np.pad(row, ((0, 0), (0, width - row.shape[1]), (0, 0))) for row in rows]
    return np.concatenate([banner, *padded])


def _draw(canvas: np.ndarray, camera: CameraRig, heads: np.ndarray, frame: int) -> None:
    up = camera.up_vector
    known = heads[np.isfinite(heads[:, 0])]
    feet = known - (known @ up)[:, None] * up
    for start, end in _grid(feet, up):
        _draw_line(canvas, camera, start, end, _GRID, 1)
    for start, end in pairwise(feet):
        _draw_line(canvas, camera, start, end, _WAY, 2)
    head = heads[frame]
    if np.isfinite(head[0]):
        _draw_line(canvas, camera, head - (head @ up) * up, head, MODEL_COLOUR, 2)


def _grid(feet: np.ndarray, up: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Ends of the lines of a grid on the floor around places (n, 3) on it."""
    a, b = (axis for axis in np.eye(3) if not np.any(axis[np.abs(up) > 0]))
    low = [np.floor(((feet @ axis).min() - _AROUND) / _SQUARE) for axis in (a, b)]
    high = [np.ceil(((feet @ axis).max() + _AROUND) / _SQUARE) for axis in (a, b)]
    x, y = (np.arange(first, last + 1) * _SQUARE for first, last in zip(low, high, strict=True))
    lines = [(a * each + b * y[0], a * each + b * y[-1]) for each in x]
    return lines + [(b * each + a * x[0], b * each + a * x[-1]) for each in y]


def _draw_line(
    canvas: np.ndarray, camera: CameraRig, start: np.ndarray, end: np.ndarray, colour: Colour, width: int
) -> None:
    pieces = max(2, int(np.ceil(np.linalg.norm(end - start) / _PIECE)) + 1)
    pixels = project(camera, np.linspace(start, end, pieces))[0]
    for one, other in pairwise(pixels):
        ends = np.array([one, other])
        if np.isfinite(ends).all() and np.abs(ends).max() < 1e5:
            (x, y), (to_x, to_y) = np.rint(ends).astype(int).tolist()
            cv2.line(canvas, (x, y), (to_x, to_y), colour, width, cv2.LINE_AA)
