"""Videos: every frame at its time, of a size that a network carries, and as others read them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from mmocap_warp.formats.image_files import WebmFile

MOST = 0.4  # bits a pixel of a frame
KEY = 12  # frames from one that can be jumped to, to the next
_BITS = 6  # of a frame's number
SEGMENT, CLUSTER, SIMPLE_BLOCK = b"\x18\x53\x80\x67", b"\x1f\x43\xb6\x75", 0xA3


def busy(frames: int, size: tuple[int, int]) -> list[np.ndarray]:
    """Pictures of a room, with a camera's noise and the frame's number in black and white squares."""
    width, height = size
    random = np.random.default_rng(0)
    coarse = random.integers(0, 200, (height // 8, width // 8, 3), np.uint8)
    room = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC).astype(int)
    pictures = []
    for frame in range(frames):
        picture = np.clip(room + random.integers(-8, 9, room.shape), 0, 255).astype(np.uint8)
        for bit in range(_BITS):
            picture[10:30, 20 * bit : 20 * bit + 20] = 255 * (frame >> bit & 1)
        pictures.append(picture)
    return pictures


def number(picture: np.ndarray) -> int:
    """The frame that a picture says it is."""
    return sum(int(picture[15:25, 20 * bit + 5 : 20 * bit + 15].mean() > 128) << bit for bit in range(_BITS))


def read(path: Path) -> list[np.ndarray]:
    video, pictures = cv2.VideoCapture(str(path)), []
    while (found := video.read())[0]:
        pictures.append(found[1])
    return pictures


@pytest.mark.parametrize(("fps", "size"), [(60.0, (320, 240)), (59.94, (176, 144)), (25.0, (161, 121))])
def test_a_video_has_its_frames_in_order_at_their_rate(tmp_path, fps, size):
    shown = busy(40, size)
    with WebmFile(tmp_path / "v.webm", fps) as video:
        for picture in shown:
            video.write(picture)
    opened = cv2.VideoCapture(str(tmp_path / "v.webm"))
    assert opened.get(cv2.CAP_PROP_FPS) == pytest.approx(fps, rel=1e-4)
    assert opened.get(cv2.CAP_PROP_FRAME_COUNT) == len(shown)
    found = read(tmp_path / "v.webm")
    assert len(found) == len(shown)
    assert {picture.shape for picture in found} == {(size[1] // 2 * 2, size[0] // 2 * 2, 3)}
    assert [number(picture) for picture in found] == list(range(len(shown)))


def test_a_video_of_a_noisy_camera_takes_less_than_half_a_bit_a_pixel(tmp_path):
    with WebmFile(tmp_path / "v.webm", 60) as video:
        for picture in busy(2 * KEY, (480, 320)):
            video.write(picture)
    assert (tmp_path / "v.webm").stat().st_size < MOST * 480 * 320 * 2 * KEY / 8


def test_a_player_can_jump_to_a_frame(tmp_path):
    with WebmFile(tmp_path / "v.webm", 30) as video:
        for picture in busy(4 * KEY, (176, 144)):
            video.write(picture)
    opened = cv2.VideoCapture(str(tmp_path / "v.webm"))
    assert opened.set(cv2.CAP_PROP_POS_MSEC, 1000.0)
    assert number(opened.read()[1]) == 30


def blocks(data: bytes, at: int = 0, end: int | None = None) -> Iterator[bytes]:
    """What a WebM file holds of each frame: the track, the time and flags in four bytes, then the frame."""
    while at < (len(data) if end is None else end):
        name = 8 - data[at].bit_length()  # further bytes of the element's name, then of its length
        more = 8 - data[at + name + 1].bit_length()
        begin = at + name + more + 2
        length = int.from_bytes(data[at + name + 1 : begin], "big") & (1 << 7 * (more + 1)) - 1
        if data[at : at + name + 1] in (SEGMENT, CLUSTER):
            yield from blocks(data, begin, begin + length)
        elif data[at] == SIMPLE_BLOCK:
            yield data[begin : begin + length]
        at = begin + length


def test_frames_that_can_be_jumped_to_are_marked_and_no_others(tmp_path):
    """A browser shows nothing of a video in which all are."""
    with WebmFile(tmp_path / "v.webm", 30) as video:
        for picture in busy(4 * KEY + 5, (176, 144)):
            video.write(picture)
    found = list(blocks((tmp_path / "v.webm").read_bytes()))
    assert [bool(block[3] & 0x80) for block in found] == [frame % KEY == 0 for frame in range(4 * KEY + 5)]
    assert [not block[4] & 1 for block in found] == [frame % KEY == 0 for frame in range(4 * KEY + 5)]


def test_the_same_video_is_the_same_bytes(tmp_path):
    for name in ("one.webm", "other.webm"):
        with WebmFile(tmp_path / name, 30) as video:
            for picture in busy(5, (160, 120)):
                video.write(picture)
    assert (tmp_path / "one.webm").read_bytes() == (tmp_path / "other.webm").read_bytes()


def test_a_slow_video_keeps_its_times(tmp_path):
    """Frames that are further apart than a cluster may be long."""
    with WebmFile(tmp_path / "v.webm", 0.05) as video:
        for picture in busy(5, (160, 120)):
            video.write(picture)
    opened, times = cv2.VideoCapture(str(tmp_path / "v.webm")), []
    while opened.read()[0]:
        times.append(opened.get(cv2.CAP_PROP_POS_MSEC))
    assert times == [0, 20_000, 40_000, 60_000, 80_000]
