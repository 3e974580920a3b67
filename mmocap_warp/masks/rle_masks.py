"""Masks as run lengths in a JSON file, as pycocotools, SAM and video instance segmentation write them."""

import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mmocap_warp.errors import InputError, input_errors
from mmocap_warp.masks.frames import evenly_spread, natural_order, wrong_numbers
from mmocap_warp.masks.mask_image import Labels
from mmocap_warp.whole_file import read_text

_MAX_PIXELS = 1 << 28
_REMEDY = "write it with pycocotools, segmentation = {size = [height, width], counts = ...}"


@dataclass(frozen=True)
class RleMasks:
    """Masks of all frames, decoded one at a time."""

    path: Path  # the file
    frames: tuple[dict[int, Any], ...]  # per frame the run lengths of each identity, as they stand in the file
    size: tuple[int, int]  # width and height [px]
    soft = False

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def files(self) -> tuple[Path, ...]:
        """The one file."""
        return (self.path,)

    def read(self, first: int = 0) -> Iterator[Labels]:
        """Frames from ``first`` on; where objects overlap, the smaller one is in front."""
        return map(self._frame, range(first, len(self.frames)))

    def sample(self, count: int) -> Iterator[Labels]:
        """At most ``count`` frames, evenly spread."""
        return map(self._frame, evenly_spread(len(self), count))

    def _frame(self, number: int) -> Labels:
        width, height = self.size
        image, masks = np.zeros((height, width), np.uint32), {}
        for identity, rle in self.frames[number].items():
            with input_errors(f"{self.path}: frame {number}", "{error}", _REMEDY, ValueError):
                masks[identity] = decode_rle(rle["counts"], height, width)
        for identity in sorted(masks, key=lambda i: -int(masks[i].sum())):
            image[masks[identity]] = identity
        return Labels(image)


def open_rle(path: Path) -> RleMasks:
    """Read a JSON file of run lengths.

    It is COCO's (``images`` and ``annotations``; the identity of an annotation is its ``track_id``, else its
    ``category_id``), video instance segmentation's (``annotations`` with ``segmentations``, a frame each; the identity
    is the annotation's ``id``), or a list with a frame each: run lengths, a list of them (identities 1, 2, ... in
    order), or null.
    """
    text = read_text(path, _REMEDY, missing="check the path; it is relative to the scene file")
    with input_errors(path, "cannot be read as JSON ({error})", _REMEDY, ValueError, RecursionError):
        content = json.loads(text)
    try:
        frames = _read_frames(content)
    except (KeyError, TypeError, AttributeError, IndexError) as error:
        raise InputError(path, f"is not in COCO's form ({type(error).__name__}: {str(error)[:80]})", _REMEDY) from None
    except ValueError as error:
        raise InputError(path, str(error), _REMEDY) from None
    sizes = {tuple(rle["size"]) for frame in frames for rle in frame.values()}
    if len(sizes) != 1:
        problem = f"has masks of different sizes: {sorted(sizes)[:3]}" if sizes else "holds no masks"
        raise InputError(path, problem, _REMEDY)
    height, width = sizes.pop()
    return RleMasks(path, tuple(frames), (width, height))


def decode_rle(counts: Any, height: int, width: int) -> np.ndarray:
    """(height, width) bool of COCO's run lengths, or pycocotools' string of them: background first, down the columns.

    Raises:
        ValueError: lengths that are not the image's.
    """
    lengths = _unpack_string(counts) if isinstance(counts, str) else counts
    if not isinstance(lengths, list) or any(type(length) is not int or length < 0 for length in lengths):
        raise ValueError("its run lengths are not whole numbers")
    if sum(lengths) != height * width:
        raise ValueError(f"its run lengths add up to {sum(lengths)}, not to {height} x {width} pixels")
    return np.repeat(np.arange(len(lengths)) % 2 == 1, lengths).reshape(width, height).T


def _unpack_string(text: str) -> list[int]:
    """Run lengths of pycocotools' string: five bits a character, least first; from the fourth on as differences."""
    lengths: list[int] = []
    value = shift = 0
    for character in text:
        bits = ord(character) - 48
        if not 0 <= bits < 64 or shift > 60:
            raise ValueError("its run lengths are not a string of pycocotools")
        value |= (bits & 31) << shift
        shift += 5
        if bits & 32:
            continue
        if bits & 16:
            value -= 1 << shift
        lengths.append(value + lengths[-2] if len(lengths) > 2 else value)
        value = shift = 0
    if shift:
        raise ValueError("its run lengths end amid a number")
    return lengths


def _read_frames(content: Any) -> list[dict[int, Any]]:
    if isinstance(content, list):
        of_frames = (frame if isinstance(frame, list) else [frame] for frame in content)
        return [{i: _check_rle(rle) for i, rle in enumerate(objects, 1) if rle is not None} for objects in of_frames]
    annotations = content["annotations"]
    if any("segmentations" in one for one in annotations):
        count = max(len(one["segmentations"]) for one in annotations)
        frames: list[dict[int, Any]] = [{} for _ in range(count)]
        for one in annotations:
            for frame, rle in zip(frames, one["segmentations"], strict=False):
                if rle is not None:
                    frame[_check_identity(one["id"])] = _check_rle(rle)
        return frames
    images = sorted(content["images"], key=lambda image: (natural_order(str(image.get("file_name", ""))), image["id"]))
    stems = [os.path.splitext(str(image.get("file_name", "")))[0] for image in images]
    if (wrong := wrong_numbers(stems)) and not stems[0].isdecimal():
        raise ValueError(f"{wrong}: list each image once, without a gap")
    by_image: dict[Any, dict[int, Any]] = {image["id"]: {} for image in images}
    for one in annotations:
        identity = _check_identity(one.get("track_id", one.get("category_id", 1)))
        frame = by_image[one["image_id"]]
        if identity in frame:
            raise ValueError(f"an image has two masks of identity {identity}: give each annotation a track_id")
        frame[identity] = _check_rle(one["segmentation"])
    return list(by_image.values())


def _check_identity(value: Any) -> int:
    if type(value) is not int or not 0 < value < 1 << 16:
        raise ValueError(f"identity {value!r} is not a whole number from 1 to 65535")
    return value


def _check_rle(rle: Any) -> dict[str, Any]:
    if isinstance(rle, list):
        raise ValueError("holds polygons")
    height, width = size if isinstance(size := rle["size"], list) and len(size) == 2 else (0, 0)
    if type(height) is not int or type(width) is not int or not 0 < height * width <= _MAX_PIXELS or height < 0:
        raise ValueError(f"size = {size} is not a height and a width")
    return {"size": (height, width), "counts": rle["counts"]}
