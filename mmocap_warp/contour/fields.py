"""Signed distances to the contours of masks: how far, and which way, an outline is from where it should be."""

from __future__ import annotations

import math

import cv2
import numpy as np
import warp as wp

from mmocap_warp.kernels.contour.residuals import Fields
from mmocap_warp.kernels.structs import filled
from mmocap_warp.views.observation import Observation, unpack_masks
from mmocap_warp.views.rig import CameraRig

_MARGIN = 0.04  # of an image's longer side around the foreground's box: what is farther away is not looked for

_FEWEST = 50  # foreground pixels of a view; fewer show nobody
_BLUR = 1.0  # px: takes the stairs out of a contour of pixels


class DistanceFields:
    """Fields of as many frames as there is room for, as Warp arrays, and the ``struct`` of them that kernels take.

    Args:
        rig: undistorted cameras at the masks' size.
        frames: places for frames.
        candidates: poses that are judged at a time, each against the frame in ``frame``.
        device: a Warp device.
    """

    def __init__(self, rig: CameraRig, frames: int, candidates: int, device: str) -> None:
        self._rig, self._device = rig, device
        self._fields: list[list[np.ndarray | None]] = [[None] * len(rig) for _ in range(frames)]
        self._box = np.zeros((frames, len(rig), 4), np.int32)
        self._start = np.zeros((frames, len(rig)), np.int32)
        self._room = 0  # values of a frame
        self.seen = np.zeros((frames, len(rig)), bool)
        self.value = wp.zeros(1, dtype=wp.float32, device=device)
        self.box = wp.zeros((frames, len(rig)), dtype=wp.vec4i, device=device)
        self.start = wp.zeros((frames, len(rig)), dtype=wp.int32, device=device)
        self.frame = wp.zeros(candidates, dtype=wp.int32, device=device)
        self.struct = filled(Fields, value=self.value, box=self.box, start=self.start, frame=self.frame)

    def observe(self, place: int, observation: Observation) -> None:
        """Compute the fields of a frame's masks into one of the places."""
        masks = unpack_masks(observation.words, self._rig.size)
        fields = []
        for k, mask in enumerate(masks):
            box, field = signed_distance(mask) if observation.foreground[k] >= _FEWEST else (_NO_BOX, _NO_FIELD)
            self._box[place, k] = box
            fields.append(field)
        self.seen[place] = self._box[place, :, 2] > 0
        self._reserve(sum(field.size for field in fields))
        first = place * self._room
        self._start[place] = first + np.cumsum([0, *(field.size for field in fields[:-1])])
        values = np.concatenate([field.ravel() for field in fields])
        if len(values):
            wp.copy(self.value, wp.array(values, dtype=wp.float32, device=self._device), dest_offset=first)
        self.box.assign(self._box)
        self.start.assign(self._start)

    def _reserve(self, room: int) -> None:
        """Make room for frames of so many values; what there was is kept."""
        if room <= self._room:
            return
        wider = room + room // 4
        places = len(self._box)
        value = wp.zeros(places * wider, dtype=wp.float32, device=self._device)
        if self._room:
            for place in range(places):
                wp.copy(value, self.value, place * wider, place * self._room, self._room)
        self._start += ((wider - self._room) * np.arange(places, dtype=np.int32))[:, None]
        self._room = wider
        self.value = value
        self.struct.value = value


def signed_distance(mask: np.ndarray) -> tuple[tuple[int, int, int, int], np.ndarray]:
    """Distances to a mask's contour, negative inside, in a box around it.

    A pixel's centre is half a pixel from the contour that runs between it and a neighbour on the other side.

    Args:
        mask: (height, width) bool with a foreground.

    Returns:
        The box ``(x, y, width, height)`` and (height, width) float32 distances in it, slightly smoothed [px].
    """
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    margin = math.ceil(_MARGIN * max(mask.shape))
    top, bottom = max(rows[0] - margin, 0), min(rows[-1] + margin + 1, mask.shape[0])
    left, right = max(columns[0] - margin, 0), min(columns[-1] + margin + 1, mask.shape[1])
    inside = np.ascontiguousarray(mask[top:bottom, left:right], np.uint8)
    outside = 1 - inside
    distance = cv2.subtract(
        cv2.distanceTransform(outside, cv2.DIST_L2, 5), cv2.distanceTransform(inside, cv2.DIST_L2, 5)
    )
    distance += inside - np.float32(0.5)
    return (left, top, right - left, bottom - top), cv2.GaussianBlur(distance, (5, 5), _BLUR)


_NO_BOX = (0, 0, 0, 0)
_NO_FIELD = np.zeros((0, 0), np.float32)
