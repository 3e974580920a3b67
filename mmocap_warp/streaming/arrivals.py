"""Frames as they come: a scene's own files at their pace, a folder that grows, cameras, or a program's messages."""

import json
import math
import os
import queue
import threading
import time
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from mmocap_warp.device.cores import available_threads
from mmocap_warp.errors import InputError, input_errors, needs_package
from mmocap_warp.masks.cleanup import clean_mask
from mmocap_warp.masks.frames import IMAGE_SUFFIXES, decode_image, natural_order, read_file
from mmocap_warp.masks.mask_files import decode_mask_image
from mmocap_warp.masks.mask_settings import BACKGROUNDS
from mmocap_warp.masks.observation import Observation
from mmocap_warp.masks.visual_hull import repair_masks
from mmocap_warp.scene.recording import Scene

_STALE = 3.0  # periods after which a camera that sent nothing is lost
_RETRY = 0.5  # seconds before a camera is opened again
_FIRST_IMAGE = 15.0  # seconds that cameras may take to send their first images
_POLL = 0.004  # seconds between looks at a folder
_LEFT_OUT = 30  # images after the next one that are looked for where that does not come
_SILENCE = 1.0  # seconds without any of these after which a folder is listed anew: it may hold a hundred thousand


class Arrival(NamedTuple):
    """A frame that came."""

    number: int  # of the frame; a gap says that frames were dropped
    time: float  # when it was seen, in seconds since 1970
    seen: Sequence[Observation]  # of each person; a camera that sent nothing sees nobody
    silent: Sequence[int] = ()  # the cameras that sent nothing


Arrivals = Generator[Arrival, None, None]


def arrivals(scenes: Sequence[Scene], scale: float, addresses: Sequence[str]) -> Arrivals:
    """The frames of a scene as they come.

    Args:
        scenes: of each person who is tracked, the scene as :meth:`Scene.of_person` gives it: how masks are made.
        scale: of the masks.
        addresses: none for the scene's own files; a folder; a ZMQ address; or what OpenCV opens, for each camera.

    Raises:
        InputError: the number of addresses is wrong, a package is missing, or what comes is no image of these cameras.
    """
    scene, names = scenes[0], scenes[0].calibrated.names
    if not addresses:
        return _own_files(scenes, scale)
    if scene.foreground.source not in ("masks", *BACKGROUNDS):
        remedy = f"set it to one of {', '.join(BACKGROUNDS)}, or to masks where masks come"
        raise InputError(scene.path, f"[foreground] source = {scene.foreground.source} cannot be live", remedy)
    if files := [each for each in addresses if os.path.isfile(each)]:
        remedy = "name it in the scene as its camera's video or masks, and leave --source out"
        raise InputError(files[0], "is a file, and no camera", remedy)
    if len(addresses) == 1 and addresses[0].startswith(("tcp://", "ipc://")):
        return _messages(scenes, scale, addresses[0])
    if len(addresses) == 1 and os.path.isdir(addresses[0]):
        return _growing(scenes, scale, Path(addresses[0]))
    if len(addresses) != len(names):
        remedy = f"give --source once for each of {', '.join(names)}, in this order, or one folder or ZMQ address"
        raise InputError(addresses[0], f"is one of {len(addresses)} sources for {len(names)} cameras", remedy)
    return _from_cameras(scenes, scale, addresses)


def newest(source: Arrivals, *, awake: bool = False) -> Arrivals:
    """The newest frame, again and again: one that still waits when the next comes is dropped.

    A thread reads the source from the second frame on: trackers search for the first one, and what comes meanwhile is
    not asked for. Who waits ``awake`` keeps a core busy, see :func:`~mmocap_warp.device.cores.waits_awake`.
    """
    yield from islice(source, 1)
    waiting: queue.Queue[Arrival | Exception | None] = queue.Queue(1)
    stopped = threading.Event()

    def read() -> None:
        end = None
        try:
            for frame in source:
                if stopped.is_set():
                    break
                with suppress(queue.Empty):
                    waiting.get_nowait()
                waiting.put(frame)
        except Exception as error:
            end = error
        source.close()
        waiting.put(end)

    threading.Thread(target=read, daemon=True).start()
    try:
        while True:
            while awake and waiting.empty():
                time.sleep(0)  # other threads may run
            if (frame := waiting.get()) is None:
                return
            if isinstance(frame, Exception):
                raise frame
            yield frame
    finally:
        stopped.set()


class _MaskMaking:
    """What images of each camera show of one person, by a scene's settings, undistorted and cleaned."""

    def __init__(self, scene: Scene, scale: float) -> None:
        self._scene, self._scale, self._rig = scene, scale, scene.rig(scale)
        self._make = [scene.mask_maker(k, scale) for k in range(len(scene.cameras))]
        hiding = [source.in_front for source in scene.cameras]
        self._hide = [scene.mask_maker(k, scale, labels) if labels else None for k, labels in enumerate(hiding)]
        self._nothing = [np.zeros((height, width), bool) for width, height in self._rig.size]
        self._kept = self._nothing
        self._pool = ThreadPoolExecutor(min(len(self._make), available_threads()))  # OpenCV lets other threads run

    def __call__(self, images: Sequence[Any]) -> Observation:
        """The masks, and what may be in front of the person; nothing of a camera whose image is None."""
        came = [image is not None for image in images]
        pairs = self._pool.map(self._view, range(len(self._make)), images)
        masks, in_front = ([*each] for each in zip(*pairs, strict=True))
        self._kept = [new if is_new else old for new, old, is_new in zip(masks, self._kept, came, strict=True)]
        if self._scene.foreground.repair and all(came):
            masks = repair_masks(self._rig, masks)
        return Observation.from_masks(masks, None, in_front if self._scene.has_others else None)

    def _view(self, k: int, image: Any) -> tuple[np.ndarray, np.ndarray]:
        """Camera ``k``'s mask, and what may be in front of the person in it."""
        if image is None:
            return self._nothing[k], self._nothing[k]
        source, (width, height) = self._scene.cameras[k], self._scene.calibrated.size[k]
        as_calibrated = source.mask_mark is None and source.recorded_scale == 1 and not any(source.recorded_offset)
        if as_calibrated and image.shape[:2] != (height, width):
            problem = f"sends {image.shape[1]}x{image.shape[0]}, the calibration says {width}x{height}"
            raise InputError(source.name, problem, "set the camera to that size, or calibrate this one")
        mask, hide = clean_mask(self._make[k](image), self._scene.foreground, self._scale, self._kept[k]), self._hide[k]
        return mask, hide(image) if hide else self._nothing[k]


class _Seeing:
    """What images of each camera show of each person."""

    def __init__(self, scenes: Sequence[Scene], scale: float) -> None:
        self._makers = [_MaskMaking(scene, scale) for scene in scenes]
        self._decode = decode_mask_image if scenes[0].foreground.source == "masks" else decode_image

    def __call__(self, number: int, seen: float, images: Sequence[Any]) -> Arrival:
        """A frame that was ``seen`` at a time; an image is None where its camera sent nothing."""
        silent = [k for k, image in enumerate(images) if image is None]
        return Arrival(number, seen, [make(images) for make in self._makers], silent)

    def decoded(self, data: bytes, origin: object) -> Any:
        """The content of an image file, or of a mask's; None where it is not whole: then the camera sent nothing."""
        with suppress(InputError):
            return self._decode(data, origin)


def _own_files(scenes: Sequence[Scene], scale: float) -> Arrivals:
    """The recording at its pace, or as fast as masks are read; the clock starts once the first frame is done."""
    due = 0.0
    for number, seen in enumerate(zip(*(scene.observations(scale) for scene in scenes), strict=True)):
        time.sleep(max(0.0, due - time.monotonic()))
        due = max(due, time.monotonic()) + 1.0 / scenes[0].rate if number else 0.0
        yield Arrival(number, time.time(), seen)


def _growing(scenes: Sequence[Scene], scale: float, folder: Path) -> Arrivals:
    """Numbered images in a folder for each camera, from the last that is there, without an end.

    A frame is there when all cameras have it. Where the next one has come, cameras that lack it sent nothing. One that
    is two behind is dropped.
    """
    see, folders = _Seeing(scenes, scale), [folder / name for name in scenes[0].calibrated.names]
    if missing := [each for each in folders if not each.is_dir()]:
        raise InputError(missing[0], "no such folder", "make a folder of each camera's name, for its numbered images")

    def last_of(folder: Path) -> str:
        return max((name for name in os.listdir(folder) if Path(name).stem.isdecimal()), key=natural_order, default="")

    def is_done(file: Path) -> bool:  # it may have another name while it is written
        return file.suffix.lower() in IMAGE_SUFFIXES and file.exists() and time.time() - file.stat().st_mtime > _SILENCE

    while not all(names := [last_of(each) for each in folders]):
        without = (each for each, last in zip(folders, names, strict=True) if not last)
        others = (each / name for each in without for name in os.listdir(each))
        if other := next(filter(is_done, others), None):
            raise InputError(other, "has a name that is no number", "name images 0001.png and so on")
        time.sleep(_POLL)
    ends = [each / name for each, name in zip(folders, names, strict=True)]
    number = max(int(end.stem) for end in ends)

    def files(of: int) -> list[Path | None]:
        named = (end.with_stem(f"{of:0{len(end.stem)}d}") for end in ends)
        return [file if file.exists() else None for file in named]

    while True:
        waited = 0.0
        while not (all(files(number)) or any(files(number + 1))):
            time.sleep(_POLL)
            waited += _POLL
            if waited > _STALE / scenes[0].fps and int(waited / _POLL) % 10 == 0:  # numbers may have been left out
                number = next((after for after in range(number, number + _LEFT_OUT) if any(files(after))), number)
            if waited > _SILENCE:
                number, waited = max(number, *(int(Path(last_of(each)).stem or 0) for each in folders)), 0.0
        while all(files(number + 2)):
            number += 1
        images = [file and see.decoded(read_file(file), file) for file in files(number)]
        yield see(number, time.time(), images)
        number += 1


def _messages(scenes: Sequence[Scene], scale: float, address: str) -> Arrivals:
    """Frames that a program publishes by ZMQ: ``{"frame": number, "time": seconds}``, then an image of each camera.

    An image is an image file's content; an empty one says that the camera sent nothing. ``{"end": true}`` ends.
    """
    with needs_package(address, "pyzmq", "read", "live", "give a folder that grows"):
        import zmq
    see, names, number = _Seeing(scenes, scale), ", ".join(scenes[0].calibrated.names), -1
    remedy = f'send {{"frame": number, "time": seconds}} and an image of each of {names}'
    with zmq.Context() as context, context.socket(zmq.SUB) as socket:
        socket.subscribe(b"")
        with input_errors(address, "cannot be opened ({error})", "name it as tcp://HOST:PORT", zmq.ZMQError):
            socket.connect(address)
        while True:
            parts = socket.recv_multipart()
            while socket.poll(0):  # only the newest counts
                parts = socket.recv_multipart()
            kinds = ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError
            with input_errors(address, "sent what is no frame ({error})", remedy, *kinds):
                about = json.loads(parts[0])
                if about.get("end"):
                    return
                # A program that begins anew counts from zero again.
                number, seen = max(int(about["frame"]), number + 1), float(about["time"])
                if not (math.isfinite(seen) and number < 2**31):
                    raise ValueError(f"frame {number} at {seen} s")
                if len(images := parts[1:]) != len(scenes[0].cameras):
                    raise ValueError(f"images: {len(images)}, cameras: {len(scenes[0].cameras)}")
                arrival = see(number, seen, [see.decoded(image, address) for image in images])
            yield arrival


def _camera(address: str, stopped: threading.Event) -> Callable[[float], np.ndarray | None]:
    """What gives the newest image of a camera, unless it came before a time of the monotonic clock.

    A thread opens the camera, and opens it again where it stops.
    """
    newest_image: tuple[float, np.ndarray | None] = (-math.inf, None)

    def read() -> None:
        nonlocal newest_image
        while not stopped.is_set():
            capture = cv2.VideoCapture(int(address) if address.isdecimal() else address)
            while not stopped.is_set() and (got := capture.read())[0]:
                newest_image = time.monotonic(), got[1]
            capture.release()
            stopped.wait(_RETRY)

    threading.Thread(target=read, daemon=True).start()
    return lambda oldest: newest_image[1] if newest_image[0] >= oldest else None


def _from_cameras(scenes: Sequence[Scene], scale: float, addresses: Sequence[str]) -> Arrivals:
    """What cameras show at even times, by the scene's frame rate."""
    see, period, stopped = _Seeing(scenes, scale), 1.0 / scenes[0].fps, threading.Event()
    cameras = [_camera(address, stopped) for address in addresses]
    try:
        patience = time.monotonic() + _FIRST_IMAGE
        for address, image in zip(addresses, cameras, strict=True):
            while image(0.0) is None:
                if time.monotonic() > patience:
                    raise InputError(address, "OpenCV gets no image from it", "check the address or the number")
                time.sleep(_POLL)
        begin, number = 0.0, 0
        while True:
            oldest = time.monotonic() - _STALE * period
            yield see(number, time.time(), [image(oldest) for image in cameras])
            begin = begin or time.monotonic()  # the clock starts once the first frame is done
            number = max(number + 1, math.ceil((time.monotonic() - begin) / period))
            time.sleep(max(0.0, begin + number * period - time.monotonic()))
    finally:
        stopped.set()
