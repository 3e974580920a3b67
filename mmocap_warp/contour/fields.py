"""Signed distances to the contours of masks: how far, and which way, an outline is from where it should be."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from mmocap_warp.kernels import block
from mmocap_warp.kernels.contour.distance import Masks, Workings, find_boxes, measure_distances, pixels_of
from mmocap_warp.kernels.contour.residuals import Fields
from mmocap_warp.kernels.structs import filled
from mmocap_warp.views.observation import Observation, words_per_row
from mmocap_warp.views.rig import CameraRig

_FEWEST = 50  # foreground pixels of a view; fewer show nobody
_TOGETHER = 64  # frames whose fields a GPU computes at a time


class DistanceFields:
    """Fields of as many frames as there is room for, as Warp arrays, and the ``struct`` of them that kernels take.

    A pixel's centre is half a pixel from the contour that runs between it and a neighbour on the other side. Distances
    are slightly smoothed, and cut off a few pixels from a contour; see :mod:`mmocap_warp.kernels.contour.distance`.

    Args:
        rig: undistorted cameras at the masks' size.
        frames: places for frames.
        candidates: poses that are judged at a time, each against the frame in ``frame``.
        device: a Warp device.
    """

    def __init__(self, rig: CameraRig, frames: int, candidates: int, device: str) -> None:
        self._rig, self._device = rig, device
        self._box = np.zeros((frames, len(rig), 4), np.int32)
        self._start = np.zeros((frames, len(rig)), np.int32)
        self.seen = np.zeros((frames, len(rig)), bool)
        self.value = wp.zeros(1, dtype=wp.float32, device=device)
        self.box = wp.zeros((frames, len(rig)), dtype=wp.vec4i, device=device)
        self.start = wp.zeros((frames, len(rig)), dtype=wp.int32, device=device)
        self.frame = wp.zeros(candidates, dtype=wp.int32, device=device)
        self.struct = filled(Fields, value=self.value, box=self.box, start=self.start, frame=self.frame)
        self._scratch = block.scratch(device)
        self._size = wp.array(rig.size, dtype=wp.vec2i, device=device)
        self._workings: Workings = filled(Workings, room=0, **_workings(0, device))
        self._take(1)

    def observe(self, place: int, observation: Observation) -> None:
        """Compute the fields of a frame's masks into one of the places."""
        self.observe_all([observation], place)

    def observe_all(self, observations: Sequence[Observation], first: int = 0) -> None:
        """Compute the fields of frames into as many places, from ``first`` on; on a GPU many frames at a time."""
        together = _TOGETHER if wp.get_device(self._device).is_cuda else 1
        for begin in range(0, len(observations), together):
            self._observe(observations[begin : begin + together], first + begin)

    def _observe(self, observations: Sequence[Observation], first: int) -> None:
        frames = len(observations)
        if frames != self._word.shape[0]:
            self._take(frames)
        places = slice(first, first + frames)
        self._place.assign(np.arange(first, first + frames, dtype=np.int32))
        for words, observation in zip(self._host.numpy(), observations, strict=True):
            words[...] = observation.words
        if self._host is not self._word:
            wp.copy(self._word, self._host)
        find_boxes(self._masks, self._scratch, self._found)
        shown = np.array([observation.foreground for observation in observations]) >= _FEWEST
        self._box[places] = self._found.numpy() * shown[..., None]
        self.seen[places] = self._box[places, :, 2] > 0
        pixels = pixels_of(self._box[places, :, 2], self._box[places, :, 3])
        self._reserve(int(pixels.sum(axis=1).max()), frames)
        before = np.cumsum(pixels, axis=1) - pixels
        self._start[places] = before + self._workings.room * np.arange(first, first + frames)[:, None]
        self.box.assign(self._box)
        self.start.assign(self._start)
        measure_distances(self._masks, self._workings, self.struct)

    def _take(self, frames: int) -> None:
        """Be ready for so many frames at a time."""
        width, height = self._rig.size.max(axis=0).tolist()
        shape = (frames, len(self._rig), height, words_per_row(width))
        word = wp.zeros(shape, dtype=wp.uint32, device=self._device)
        # What is copied from pinned memory is copied beside other work.
        self._host = (
            word if wp.get_device(self._device).is_cpu else wp.zeros(shape, dtype=wp.uint32, device="cpu", pinned=True)
        )
        self._word = word
        self._place = wp.zeros(frames, dtype=wp.int32, device=self._device)
        self._masks: Masks = filled(Masks, word=word, size=self._size, place=self._place)
        self._found = wp.zeros(shape[:2], dtype=wp.vec4i, device=self._device)

    def _reserve(self, room: int, frames: int) -> None:
        """Make room for frames of so many values, and to work on some at a time; what there was is kept."""
        old = self._workings.room
        if room > old:
            room += room // 4
            places = len(self._box)
            value = wp.zeros(places * room, dtype=wp.float32, device=self._device)
            for place in range(places if old else 0):
                wp.copy(value, self.value, place * room, place * old, old)
            self._start += ((room - old) * np.arange(places, dtype=np.int32))[:, None]
            self.value = self.struct.value = value
            self._workings.room = room
        if self._workings.rough.shape[0] < self._workings.room * frames:
            for name, array in _workings(self._workings.room * frames, self._device).items():
                setattr(self._workings, name, array)


def _workings(pixels: int, device: str) -> dict[str, wp.array[Any]]:
    types = {"inside": wp.uint8, "across": wp.uint8, "rough": wp.float32}
    return {name: wp.empty(pixels, dtype=dtype, device=device) for name, dtype in types.items()}
