"""Frames of a camera, read in order: a folder of numbered images or a video."""

import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice, pairwise
from pathlib import Path

import cv2
import numpy as np

from mmocap_warp.errors import InputError, input_errors
from mmocap_warp.whole_file import native_path, read_bytes

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".pbm", ".pgm")


@dataclass(frozen=True)
class ImageFolder:
    """Images of one folder, in natural order of their names."""

    path: Path  # the folder
    files: tuple[Path, ...]  # one per frame
    size: tuple[int, int]  # width and height [px] of the first; the others must be alike
    soft = False

    def __len__(self) -> int:
        return len(self.files)

    def read(self, first: int = 0) -> Iterator[np.ndarray]:
        """Frames from ``first`` on, unchanged (palettes are expanded to BGR)."""
        for file in self.files[first:]:
            image = read_image(file)
            check_size(image.shape, self.size, file)
            yield image

    def sample(self, count: int) -> Iterator[np.ndarray]:
        """At most ``count`` frames, evenly spread."""
        return (read_image(self.files[i]) for i in evenly_spread(len(self), count))


_MOST_LATE = 1.5  # frames by which one may miss the time that an even rate gives it


@dataclass(frozen=True)
class VideoFile:
    """A video, decoded from its start because seeking is inexact. Its grays are ``soft``: compression blurs them."""

    path: Path  # the file
    count: int  # frames that the file says it has
    size: tuple[int, int]  # width and height [px]
    fps: float  # frames per second that the file says it has
    channel: int | None = None  # the one of blue, green and red, 0 to 2, that is read; None for all
    turned: int = 0  # degrees by which its images are turned clockwise when they are read: the file says so
    soft = True

    def __len__(self) -> int:
        return self.count

    @property
    def files(self) -> tuple[Path, ...]:
        """The one file, as an :class:`ImageFolder` has them."""
        return (self.path,)

    def read(self, first: int = 0) -> Iterator[np.ndarray]:
        """Frames from ``first`` on, (height, width, 3) BGR uint8, or (height, width) of one channel."""
        capture, begun = cv2.VideoCapture(str(self.path)), 0.0
        try:
            for frame in range(self.count):
                good, image = _next_frame(capture, frame >= first)
                if not good:
                    remedy = f"copy or encode it again, or let [scene] frames end before this camera's frame {frame}"
                    raise InputError(self.path, f"ends after {frame} of its {self.count} frames", remedy)
                seconds = capture.get(cv2.CAP_PROP_POS_MSEC) / 1000  # 0 where the file does not say it
                begun = begun if frame else seconds
                late = (seconds - begun) * self.fps - frame
                if seconds > 0 and self.fps > 0 and abs(late) > _MOST_LATE:
                    problem = f"its rate varies: frame {frame} is {abs(late):.1f} frames off its time"
                    remedy = f"encode it evenly: ffmpeg -i OLD -fps_mode cfr -r {self.fps:g} NEW.mp4"
                    raise InputError(self.path, problem, remedy)
                if image is None:
                    continue
                if image.shape[1::-1] != self.size:
                    found, stated = "{1}x{0}".format(*image.shape), "{}x{}".format(*self.size)
                    raise InputError(self.path, f"frame {frame} is {found}, the file says {stated}", "copy it again")
                yield image if self.channel is None else image[..., self.channel]
        finally:
            capture.release()

    def sample(self, count: int) -> Iterator[np.ndarray]:
        """The first ``count`` frames: others cannot be had without decoding the video up to them."""
        return islice(self.read(), count)


Frames = ImageFolder | VideoFile


def check_size(shape: tuple[int, ...], size: tuple[int, int], source: object) -> None:
    """Raise InputError for an image of another (width, height) than the first one of its camera."""
    if shape[1::-1] != size:
        problem = f"is {shape[1]}x{shape[0]}, the first image is {size[0]}x{size[1]}"
        raise InputError(source, problem, "images of one camera must have one size")


def evenly_spread(total: int, count: int) -> list[int]:
    """At most ``count`` of ``total`` numbers from 0, the first and the last among them."""
    return np.unique(np.linspace(0, total - 1, count).round().astype(int)).tolist()  # type: ignore[no-any-return]


def open_frames(path: Path) -> Frames:
    """A folder of images or a video."""
    if not os.path.isdir(path):
        return open_video(path)
    with input_errors(path, "cannot be read ({error})", "check its permissions", OSError):
        by_name = {file.name: file for file in path.iterdir()}
    files = tuple(by_name[name] for name in images_in_order(list(by_name), path))
    height, width = read_image(files[0]).shape[:2]
    return ImageFolder(path, files, (width, height))


def open_image(path: Path) -> ImageFolder:
    """A single image as a sequence of one."""
    height, width = read_image(path).shape[:2]
    return ImageFolder(path.parent, (path,), (width, height))


def open_video(path: Path) -> VideoFile:
    """A video file."""
    if not os.path.isfile(path):
        raise InputError(path, "no such file or folder", "check the path; it is relative to the scene file")
    if path.suffix.lower() in IMAGE_SUFFIXES:  # of numbered ones OpenCV would make a video
        raise InputError(path, "is a single image", "name the folder of the images, one for each frame")
    if not os.access(path, os.R_OK):
        raise InputError(path, "cannot be read", "check its permissions")
    capture = cv2.VideoCapture(native_path(path))
    try:
        if not capture.isOpened() or not _next_frame(capture, False)[0]:
            raise InputError(path, "cannot be decoded as a video", "convert it to .mp4 (H.264) or .mkv (FFV1)")
        size = (int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)), int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT)))
        fps, count = float(capture.get(cv2.CAP_PROP_FPS)), int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
        turned = int(capture.get(cv2.CAP_PROP_ORIENTATION_META))
        if count <= 0:  # a container without an index: count by decoding
            count = 1
            while _next_frame(capture, False)[0]:
                count += 1
    finally:
        capture.release()
    return VideoFile(path, count, size, fps, turned=turned)


def _next_frame(capture: cv2.VideoCapture, decoded: bool) -> tuple[bool, np.ndarray | None]:
    """Whether there is another frame, and its image if that is wanted."""
    try:
        if not capture.grab():
            return False, None
        return capture.retrieve() if decoded else (True, None)
    except cv2.error:  # a frame that states a size beyond all bounds
        return False, None


def read_image(path: Path) -> np.ndarray:
    """An image file, unchanged."""
    return decode_image(read_file(path), path)


def read_file(path: Path) -> bytes:
    """A file's content."""
    return read_bytes(path, "check its permissions", missing="check the path; it is relative to the scene file")


def decode_image(data: bytes, source: object) -> np.ndarray:
    """An image file's content, unchanged; ``source`` names it in messages."""
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None
    except cv2.error:  # its header states a size beyond all bounds
        image = None
    if image is None:
        raise InputError(source, "cannot be decoded as an image", "convert it to PNG")
    if image.dtype not in (np.uint8, np.uint16):
        raise InputError(source, f"has pixels of {image.dtype}", "convert it to 8 bits")
    return image


def as_colour(image: np.ndarray) -> np.ndarray:
    """(height, width, 3) BGR uint8 of an image read unchanged: gray, 16-bit or with alpha."""
    if image.dtype == np.uint16:
        image = (image >> 8).astype(np.uint8)
    if image.ndim == 2:
        return np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))
    return np.ascontiguousarray(image[..., :3])


def images_in_order(names: list[str], source: Path) -> list[str]:
    """The images among files' names, in natural order; an InputError for none, or where numbered ones leave one out."""
    # macOS puts a hidden file of the same ending beside each.
    split = {name: os.path.splitext(os.path.basename(name)) for name in names}
    of_images = [name for name in names if split[name][1].lower() in IMAGE_SUFFIXES]
    images = sorted((name for name in of_images if not split[name][0].startswith(".")), key=natural_order)
    if not images:
        raise InputError(source, "holds no images", f"put one image per frame there ({', '.join(IMAGE_SUFFIXES)})")
    stems = [split[name][0] for name in images]
    if stems[0].isdecimal() and (wrong := wrong_numbers(stems)):
        raise InputError(source, wrong, "number each image once, without a gap")
    return images


def wrong_numbers(stems: Sequence[str]) -> str:
    """What is wrong with the numbers at the end of images' names, which are in order; empty where nothing is.

    Behind a text, such as ``C1_0003``, numbers count where most follow each other: they may be times.
    """
    ends = [end for stem in stems if (end := re.fullmatch(r"(.*?)(\d+)", stem))]
    if len(ends) < len(stems) or len({end[1] for end in ends}) > 1:
        return ""
    steps = [(int(end[2]), int(end[2]) - int(before[2])) for before, end in pairwise(ends)]
    others = [(number, step) for number, step in steps if step != 1]
    if not others or (ends[0][1] and 2 * len(others) >= len(steps)):
        return ""
    number, step = others[0]
    return f"two images have number {number}" if step == 0 else f"image {number - step + 1} is missing"


def natural_order(name: str) -> list[tuple[int, str]]:
    """A key that sorts names by the numbers in them."""
    return [(int(part), "") if part.isdecimal() else (0, part) for part in re.split(r"(\d+)", name)]
