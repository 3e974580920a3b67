"""Frames as they come: from a scene's own files at their pace, a folder that grows, cameras, or a program's messages.

Whoever works on frames gets the newest one. One that still waits when the next comes is dropped, which the numbers of
frames tell.
"""

from __future__ import annotations

import json
import math
import os
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from mmocap_warp.device.cores import available_threads
from mmocap_warp.errors import InputError, missing_package
from mmocap_warp.masks.cleanup import clean_mask
from mmocap_warp.masks.frames import decode_image, images_in_order, read_file
from mmocap_warp.masks.mask_files import decode_mask_image
from mmocap_warp.masks.mask_settings import BACKGROUNDS
from mmocap_warp.masks.visual_hull import repair_masks
from mmocap_warp.scene.recording import Scene

_FRESH = 3.0  # periods after which a camera that sent nothing is lost
_RETRY = 0.5  # seconds before a camera is opened again
_FIRST_IMAGE = 15.0  # seconds that cameras may take to send their first images
_POLL = 0.004  # seconds between looks at a folder
_WAIT_MS = 200  # for a message [ms]


@dataclass(frozen=True, eq=False)
class Arrival:
    """A frame that came.

    Attributes:
        number: of the frame; a gap says that frames were dropped.
        time: when it was seen, in seconds since 1970.
        masks: (height, width) bool of each camera; None where a camera sent nothing.
    """

    number: int
    time: float
    masks: list[np.ndarray | None]


def arrivals(scene: Scene, scale: float, addresses: Sequence[str]) -> Iterator[Arrival]:
    """The frames of a scene as they come.

    Args:
        scene: whose settings say how masks are made.
        scale: of the masks.
        addresses: none for the scene's own files; a folder; a ZMQ address; or what OpenCV opens, for each camera.

    Raises:
        InputError: the number of addresses is wrong, a package is missing, or what comes is no image of these cameras.
    """
    if not addresses:
        return _own_files(scene, scale)
    settings, first = scene.foreground, addresses[0]
    if settings.source not in ("masks", *BACKGROUNDS):
        remedy = 'set [foreground] source to "clean_plate" or "background_video", or to "masks" where masks come'
        raise InputError(scene.path, f'source = "{settings.source}" cannot make masks as images come', remedy)
    if len(addresses) == 1 and first.startswith(("tcp://", "ipc://")):
        return _messages(scene, scale, first)
    if len(addresses) == 1 and os.path.isdir(first):
        return _growing(scene, scale, Path(first))
    names = scene.calibrated.names
    if len(addresses) != len(names):
        problem = f"{len(addresses)} addresses were given for {len(names)} cameras"
        raise InputError(scene.path, problem, f"give one --source for each of {', '.join(names)}, in this order")
    return _from_cameras(scene, scale, addresses)


class Newest:
    """The newest frame of a source, again and again; a thread reads the source, from the second frame on.

    The first frame takes long, because trackers search for it: what comes meanwhile is not asked for.

    Args:
        source: is closed in the end.
    """

    def __init__(self, source: Iterator[Arrival]) -> None:
        self._source = source
        self._changed = threading.Condition()
        self._frame: Arrival | None = None
        self._ended, self._error = False, None
        self._stop = threading.Event()

    def __iter__(self) -> Iterator[Arrival]:
        if (first := next(self._source, None)) is not None:
            yield first
            threading.Thread(target=self._read, daemon=True).start()
        while first is not None:
            with self._changed:
                self._changed.wait_for(lambda: self._frame is not None or self._ended)
                frame, self._frame = self._frame, None
            if frame is None:
                break
            yield frame
        if self._error is not None:
            raise self._error

    def close(self) -> None:
        """Let the thread end with the frame that it reads."""
        self._stop.set()

    def _read(self) -> None:
        try:
            for frame in self._source:
                with self._changed:
                    self._frame = frame
                    self._changed.notify()
                if self._stop.is_set():
                    break
        except Exception as error:
            self._error = error
        finally:
            self._source.close()
            with self._changed:
                self._ended = True
                self._changed.notify()


class _MaskMaking:
    """Masks of images, as they are read, by a scene's settings."""

    def __init__(self, scene: Scene, scale: float) -> None:
        self._scene, self._scale, self._rig = scene, scale, scene.rig(scale)
        cameras = range(len(scene.cameras))
        self._make = [scene.mask_maker(k, scale) for k in cameras]
        self._sizes = [_image_size(scene, k) for k in cameras]
        self._kept = [np.zeros((height, width), bool) for width, height in self._rig.size]
        self._pool = ThreadPoolExecutor(min(len(cameras), available_threads()))  # OpenCV lets other threads run

    def __call__(self, images: Sequence[Any]) -> list[np.ndarray | None]:
        """Of each camera's image; None remains None."""
        masks = list(self._pool.map(self._mask, range(len(images)), images))
        self._kept = [old if new is None else new for old, new in zip(self._kept, masks, strict=True)]
        if self._scene.foreground.repair and not any(mask is None for mask in masks):
            return list(repair_masks(self._rig, masks))
        return masks

    def _mask(self, k: int, image: Any) -> np.ndarray | None:
        if image is None:
            return None
        if self._sizes[k] not in (None, image.shape[1::-1]):
            found, stated = ("{}x{}".format(*size) for size in (image.shape[1::-1], self._sizes[k]))
            name = self._scene.cameras[k].name
            raise InputError(self._scene.path, f"camera '{name}' sends {found}, not {stated}", "set the camera to it")
        return clean_mask(self._make[k](image), self._scene.foreground, self._scale, self._kept[k])

    def decoded(self, data: bytes, source: object) -> Any:
        """An image file's content."""
        decode = decode_mask_image if self._scene.foreground.source == "masks" else decode_image
        return decode(data, source)


def _image_size(scene: Scene, k: int) -> tuple[int, ...] | None:
    """Width and height of the images that a camera must send; None where nothing tells."""
    source = scene.cameras[k]
    given = [source.masks] if scene.foreground.source == "masks" else [source.clean_plate, source.background]
    as_calibrated = source.recorded_scale == 1 and source.recorded_offset == (0.0, 0.0)
    otherwise = tuple(scene.calibrated.size[k].tolist()) if as_calibrated else None
    return next((each.size for each in given if each is not None), otherwise)


def _own_files(scene: Scene, scale: float) -> Iterator[Arrival]:
    """The recording at its own pace; what would be late by a frame is passed over."""
    period, begin = 1.0 / scene.rate, 0.0
    for number, masks in enumerate(scene.masks(scale)):
        if number <= 1:
            begin = time.monotonic() - (number - 1) * period  # the clock starts once the first frame is done
        late = time.monotonic() - begin - number * period
        if number > 1 and late > period:
            continue
        time.sleep(max(0.0, -late) if number else 0.0)
        yield Arrival(number, time.time(), list(masks))


def _growing(scene: Scene, scale: float, folder: Path) -> Iterator[Arrival]:
    """Numbered images in a folder for each camera, from the first on that is not there yet, without an end.

    A frame is there when all cameras have it. Where another one has come after it, cameras that lack it sent nothing.
    """
    make, names = _MaskMaking(scene, scale), scene.calibrated.names
    while not all(listed := [_images_in(folder / name) for name in names]):
        time.sleep(_POLL)
    ends = [names_of[-1] for names_of in listed]
    number = max(int(Path(name).stem) for name in ends)
    patterns = [(folder / name, len(Path(end).stem), Path(end).suffix) for name, end in zip(names, ends, strict=True)]

    def files(of: int) -> list[Path]:
        return [place / f"{of:0{digits}d}{suffix}" for place, digits, suffix in patterns]

    while True:
        there = [file.exists() for file in files(number)]
        if all(there) or any(file.exists() for file in files(number + 1)):
            images = []
            for file, is_there in zip(files(number), there, strict=True):
                try:
                    images.append(make.decoded(read_file(file), file) if is_there else None)
                except InputError:  # half-written: a program should rename what it has written
                    images.append(None)
            yield Arrival(number, time.time(), make(images))
            number += 1
        else:
            time.sleep(_POLL)


def _images_in(folder: Path) -> list[str]:
    """Names of numbered images in their order."""
    if not folder.is_dir():
        raise InputError(folder, "no such folder", "make a folder for each camera, with the camera's name")
    names = [name for name in os.listdir(folder) if Path(name).stem.isdecimal()]
    return images_in_order(names, folder) if names else []


def _messages(scene: Scene, scale: float, address: str) -> Iterator[Arrival]:
    """Frames that a program publishes by ZMQ: ``{"frame": number, "time": seconds}``, then an image of each camera.

    An image is an image file's content; an empty one says that the camera sent nothing. ``{"end": true}`` ends.
    """
    try:
        import zmq
    except ImportError:
        raise missing_package(address, "pyzmq", "read", "live", "give a folder that grows") from None
    make = _MaskMaking(scene, scale)
    with zmq.Context() as context, context.socket(zmq.SUB) as socket:
        socket.setsockopt(zmq.SUBSCRIBE, b"")
        socket.connect(address)
        while True:
            if not socket.poll(_WAIT_MS):
                continue
            parts = socket.recv_multipart()
            while socket.poll(0):  # only the newest counts
                parts = socket.recv_multipart()
            try:
                about = json.loads(parts[0])
                if about.get("end"):
                    return
                number, seen = int(about["frame"]), float(about.get("time", time.time()))
                images = [make.decoded(part, address) if part else None for part in parts[1:]]
            except (ValueError, KeyError, TypeError, AttributeError) as error:
                remedy = 'send {"frame": number, "time": seconds} and an image file of each camera'
                raise InputError(address, f"sent what is no frame ({error})", remedy) from None
            if len(images) != len(scene.cameras):
                remedy = f"send one for each of {', '.join(scene.calibrated.names)}"
                raise InputError(address, f"sent {len(images)} images", remedy)
            yield Arrival(number, seen, make(images))


class _Camera:
    """The newest image of a camera that OpenCV opens; opened again where it stops."""

    def __init__(self, address: str) -> None:
        self._address: str | int = int(address) if address.isdecimal() else address
        self._newest: tuple[float, np.ndarray | None] = (-math.inf, None)
        self._stop = threading.Event()
        threading.Thread(target=self._read, daemon=True).start()

    def image(self, oldest: float) -> np.ndarray | None:
        """The newest image, unless it came before a time of the monotonic clock."""
        came, image = self._newest
        return image if came >= oldest else None

    def close(self) -> None:
        """Stop after the image that is being read."""
        self._stop.set()

    def _read(self) -> None:
        while not self._stop.is_set():
            capture = cv2.VideoCapture(self._address)
            while not self._stop.is_set():
                good, image = capture.read()
                if not good:
                    break
                self._newest = (time.monotonic(), image)
            capture.release()
            self._stop.wait(_RETRY)


def _from_cameras(scene: Scene, scale: float, addresses: Sequence[str]) -> Iterator[Arrival]:
    """What cameras show at even times, by the recording's frame rate."""
    make, period = _MaskMaking(scene, scale), 1.0 / scene.fps
    cameras = [_Camera(address) for address in addresses]
    try:
        patience = time.monotonic() + _FIRST_IMAGE
        while any(camera.image(-math.inf) is None for camera in cameras):
            if time.monotonic() > patience:
                silent = next(
                    a for a, camera in zip(addresses, cameras, strict=True) if camera.image(-math.inf) is None
                )
                raise InputError(silent, "OpenCV gets no image from it", "check the address, or the camera's number")
            time.sleep(_POLL)
        begin, number = time.monotonic(), 0
        while True:
            oldest = time.monotonic() - _FRESH * period
            yield Arrival(number, time.time(), make([camera.image(oldest) for camera in cameras]))
            if number == 0:
                begin = time.monotonic() - period  # the clock starts once the first frame is done
            number = max(number + 1, math.ceil((time.monotonic() - begin) / period))
            time.sleep(max(0.0, begin + number * period - time.monotonic()))
    finally:
        for camera in cameras:
            camera.close()
