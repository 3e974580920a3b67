"""Signed distances to the contours of masks: how far, and which way, an outline is from where it should be."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.device.transfers import Replays, Upload
from mmocap_warp.kernels import block
from mmocap_warp.kernels.contour.distance import Masks, Workings, find_boxes, measure_distances, pixels_of, place_boxes
from mmocap_warp.kernels.contour.residuals import Fields
from mmocap_warp.kernels.structs import allocated, filled
from mmocap_warp.masks.observation import Observation, words_per_row

_LEAST_PIXELS = 50  # a view with fewer foreground pixels shows nobody
_TOGETHER = 64  # frames whose fields a GPU computes at a time
_WORKINGS = {"inside": wp.uint8, "across": wp.uint8, "rough": wp.float32}
_WORKING_BYTES, _VALUE_BYTES = 6, 4  # bytes of a pixel
MOST_WHOLE = 2**30  # bytes on a GPU up to which there is room for whole images: then boxes need not be read back


def whole_image_bytes(rig: CameraRig, frames: int) -> int:
    """Bytes that the fields of so many frames take where there is room for whole images."""
    per_pixel = _VALUE_BYTES * frames + _WORKING_BYTES * min(frames, _TOGETHER)
    return int(pixels_of(*rig.size.T).sum()) * per_pixel


class DistanceFields:
    """Fields of as many frames as there is room for, in the ``struct`` that kernels take.

    A pixel's centre is half a pixel from the contour that runs between it and a neighbour on the other side. Distances
    are slightly smoothed, and cut off a few pixels from a contour; see :mod:`mmocap_warp.kernels.contour.distance`.
    :meth:`judging` says against which frames candidates are judged.
    """

    def __init__(self, rig: CameraRig, frames: int, device: str) -> None:
        self._rig, self._device = rig, device
        view = (frames, len(rig))
        self.struct = allocated(
            Fields, device, value=1, box=view, start=view, frame=0, larger=len(rig), hidden=(0, 0, 0, 0)
        )
        self._scratch = block.scratch(device)
        self._hidden = wp.zeros((0, 0, 0, 0), dtype=wp.uint32, device=device)  # of frames that are observed together
        self._workings = allocated(Workings, device, room=0, **dict.fromkeys(_WORKINGS, 0))
        self._allocate(1)
        self._has_room = wp.get_device(device).is_cuda and whole_image_bytes(rig, frames) <= MOST_WHOLE
        if self._has_room:
            self._reserve(int(pixels_of(*rig.size.T).sum()), min(frames, _TOGETHER))

    def _allocate(self, frames: int) -> None:
        """Make what frames need that are observed at a time."""
        width, height = self._rig.size.max(axis=0).tolist()
        view = (frames, len(self._rig))
        words = (*view, height, words_per_row(width))
        self._masks = allocated(Masks, self._device, word=words, size=self._rig.size, place=frames)
        self._pixels = wp.zeros(view, dtype=wp.int32, device=self._device)
        self._word, self._foreground = Upload(self._masks.word), Upload(self._pixels)
        self._first: int | None = None  # place of the frames that were observed last
        self._boxes = wp.zeros(view, dtype=wp.vec4i, device=self._device)
        self._replays = Replays(self._device)

    def observe(self, observations: Sequence[Observation], first: int = 0) -> None:
        """Compute the fields of frames into as many places, from ``first`` on; on a GPU many frames at a time."""
        together = _TOGETHER if wp.get_device(self._device).is_cuda else 1
        for begin in range(0, len(observations), together):
            self._observe(observations[begin : begin + together], first + begin)

    def _observe(self, observations: Sequence[Observation], first: int) -> None:
        self._observe_hidden(observations, first)
        frames = len(observations)
        if frames != len(self._boxes):
            self._allocate(frames)
        if first != self._first:
            self._first = first
            self._masks.place.assign(np.arange(first, first + frames, dtype=np.int32))
        for number, observation in enumerate(observations):
            self._word.values[number] = observation.possible
            self._foreground.values[number] = observation.foreground
        if self._has_room:
            self._replays.run(frames, self._find_and_measure)
            self._word.sent()
            self._foreground.sent()
            return
        self._find()
        boxes = self._boxes.numpy()
        room = int(pixels_of(boxes[..., 2], boxes[..., 3]).sum(axis=1).max())
        self._reserve(room + room // 4 if room > self._workings.room else room, frames)
        self._measure()

    def _observe_hidden(self, observations: Sequence[Observation], first: int) -> None:
        """Say where something is in front in frames; room is made for it when there first is."""
        fields = self.struct
        if all(observation.hidden is None for observation in observations) and not fields.hidden.size:
            return
        words, frames = observations[0].words.shape, len(observations)
        if not fields.hidden.size:
            fields.hidden = wp.zeros((fields.box.shape[0], *words), dtype=wp.uint32, device=self._device)
        if self._hidden.shape[0] < frames:
            self._hidden = wp.zeros((frames, *words), dtype=wp.uint32, device=self._device)
            self._upload = Upload(self._hidden)
        for values, observation in zip(self._upload.values, observations, strict=False):
            values[...] = 0 if observation.hidden is None else observation.hidden
        self._upload.send(frames)
        wp.copy(fields.hidden[first : first + frames], self._hidden[:frames])

    def judging(self, frame: wp.array[wp.int32]) -> Fields:
        """What kernels take that judge candidates, against frames (candidate,)."""
        known: Any = Fields
        return filled(Fields, **{name: getattr(self.struct, name) for name in known.vars} | {"frame": frame})

    @property
    def addresses(self) -> tuple[int | None, ...]:
        """Of arrays that are made anew when more room is needed: a graph holds them."""
        return self.struct.value.ptr, self.struct.hidden.ptr

    def _find_and_measure(self) -> None:
        self._find()
        self._measure()

    def _find(self) -> None:
        self._word.send(len(self._boxes))
        self._foreground.send(len(self._boxes))
        find_boxes(self._masks, self._scratch, self._boxes)

    def _measure(self) -> None:
        place_boxes(self._masks, self._boxes, self._pixels, _LEAST_PIXELS, self._workings.room, self.struct)
        measure_distances(self._masks, self._workings, self.struct)

    def _reserve(self, room: int, frames: int) -> None:
        """Make room for frames of ``room`` values, and to work on some frames at a time; earlier fields stay."""
        old, fields = self._workings.room, self.struct
        if room > old:
            places = fields.box.shape[0]
            value = wp.empty(places * room, dtype=wp.float32, device=self._device)
            boxes = fields.box.numpy()
            used = pixels_of(boxes[..., 2], boxes[..., 3]).sum(axis=1).tolist()
            for place in np.flatnonzero(used).tolist():
                wp.copy(value, fields.value, place * room, place * old, used[place])
            fields.start.assign(fields.start.numpy() + ((room - old) * np.arange(places, dtype=np.int32))[:, None])
            fields.value = value
            self._workings.room = room
        if self._workings.rough.shape[0] < self._workings.room * frames:
            for name, dtype in _WORKINGS.items():
                setattr(self._workings, name, wp.empty(self._workings.room * frames, dtype=dtype, device=self._device))
