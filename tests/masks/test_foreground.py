"""What counts as foreground: mask images, subtraction, clean-up, repair, and the visual hull they share."""

from __future__ import annotations

import itertools
import struct
import zlib
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from synthetic import ring_rig

from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.errors import InputError
from mmocap_warp.masks.cleanup import clean_mask
from mmocap_warp.masks.frames import open_frames, read_image, wrong_numbers
from mmocap_warp.masks.mask_image import decode_mask
from mmocap_warp.masks.mask_settings import GIVEN, SUBTRACTED, ForegroundSettings, subtracted
from mmocap_warp.masks.observation import Observation
from mmocap_warp.masks.subtraction import learn_background
from mmocap_warp.masks.visual_hull import repair_masks, visual_hull

MASK = np.zeros((6, 20), bool)
MASK[1:4, 3:12] = True


def png(depth: int, colour: int, rows: list[bytes], *chunks: tuple[bytes, bytes]) -> bytes:
    """A PNG of MASK's size, written by hand: OpenCV writes no palettes."""

    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    header = struct.pack(">IIBBBBB", 20, 6, depth, colour, 0, 0, 0)
    image = zlib.compress(b"".join(b"\0" + row for row in rows))
    parts = [(b"IHDR", header), *chunks, (b"IDAT", image), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*part) for part in parts)


BYTES = [row.tobytes() for row in MASK.astype(np.uint8)]
BITS = [np.packbits(row).tobytes() for row in MASK]
DARK_RED = (b"PLTE", bytes([0, 0, 0, 128, 0, 0]))
NOISE = np.random.default_rng(0).integers(1, 255, (6, 20, 3), np.uint8)
SOFT = np.where(MASK, 200, 90).astype(np.uint8)
KINDS = {
    "gray 0/255": cv2.imencode(".png", MASK.astype(np.uint8) * 255)[1].tobytes(),
    "gray 0/1": cv2.imencode(".png", MASK.astype(np.uint8))[1].tobytes(),
    "gray 16 bit": cv2.imencode(".png", MASK.astype(np.uint16) * 65535)[1].tobytes(),
    "soft gray": cv2.imencode(".png", SOFT)[1].tobytes(),
    "1 bit": png(1, 0, BITS),
    "palette of 8 bit": png(8, 3, BYTES, DARK_RED),
    "palette of 1 bit": png(1, 3, BITS, DARK_RED),
    "palette with transparency": png(8, 3, BYTES, DARK_RED, (b"tRNS", b"\x00\xff")),
    "colours": cv2.imencode(".png", MASK[..., None] * np.uint8([0, 0, 255]))[1].tobytes(),
    "RGBA, alpha decides": cv2.imencode(".png", np.dstack([NOISE, MASK * np.uint8(255)]))[1].tobytes(),
    "RGBA, all opaque": cv2.imencode(".png", np.dstack([*[MASK * np.uint8(255)] * 3, MASK * 0 + np.uint8(255)]))[1]
    .tobytes(),
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_mask_is_read_right(tmp_path: Path, kind: str) -> None:
    (tmp_path / "mask.png").write_bytes(KINDS[kind])
    np.testing.assert_array_equal(decode_mask(read_image(tmp_path / "mask.png")), MASK)


@pytest.mark.parametrize("value", [0, 255])
def test_even_images_are_all_background_or_all_foreground(value: int) -> None:
    assert (decode_mask(np.full((4, 4), value, np.uint8)) == (value > 0)).all()


def write_video(path: Path, frames: list[np.ndarray]) -> None:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"FFV1"), 25, frames[0].shape[1::-1])
    for frame in frames:
        writer.write(frame)
    writer.release()


def test_lossless_video_comes_back_in_order(tmp_path: Path) -> None:
    frames = [np.random.default_rng(i).integers(0, 256, (48, 64, 3), np.uint8) for i in range(7)]
    write_video(tmp_path / "some.mkv", frames)
    video = open_frames(tmp_path / "some.mkv")
    assert (len(video), video.size) == (7, (64, 48))
    for first in (0, 4):
        for image, frame in zip(video.read(first), frames[first:], strict=True):
            np.testing.assert_array_equal(image, frame)


@pytest.mark.parametrize(("seconds", "late"), [([0, 0, 0, 0, 0], None), ([3, 4, 5, 6, 7], None), ([0, 1, 2, 5, 6], 3)])
def test_a_video_whose_rate_varies_is_refused(tmp_path: Path, monkeypatch, seconds: list[int], late: int) -> None:
    """Times may be unknown, and begin anywhere."""
    write_video(tmp_path / "some.mkv", [np.zeros((48, 64, 3), np.uint8)] * 5)
    video = replace(open_frames(tmp_path / "some.mkv"), fps=1.0)

    class Timed:
        """Five frames, and when each comes."""

        grabbed = -1

        def grab(self) -> bool:
            self.grabbed += 1
            return self.grabbed < len(seconds)

        def retrieve(self) -> tuple[bool, np.ndarray]:
            return True, np.zeros((48, 64, 3), np.uint8)

        def get(self, key: int) -> float:
            assert key == cv2.CAP_PROP_POS_MSEC
            return 1000.0 * seconds[self.grabbed]

        def release(self) -> None:
            pass

    monkeypatch.setattr("mmocap_warp.masks.frames.cv2.VideoCapture", lambda _: Timed())
    if late is None:
        assert len(list(video.read())) == 5
    else:
        with pytest.raises(InputError, match=rf"its rate varies: frame {late} is 2\.0 frames off its time; encode"):
            list(video.read())


def test_a_folder_is_read_in_the_order_of_its_numbers(tmp_path: Path) -> None:
    for i in range(12):
        cv2.imwrite(str(tmp_path / f"{i}.png"), np.full((2, 2), i, np.uint8))
    assert [int(image[0, 0]) for image in open_frames(tmp_path).read(2)] == list(range(2, 12))
    (tmp_path / "5.png").unlink()
    with pytest.raises(InputError, match="image 5 is missing; number each image once, without a gap"):
        open_frames(tmp_path)
    cv2.imwrite(str(tmp_path / "1.jpg"), np.zeros((2, 2), np.uint8))
    with pytest.raises(InputError, match="two images have number 1; number each image once"):
        open_frames(tmp_path)


@pytest.mark.parametrize(
    ("names", "wrong"),
    [
        (["C1_0001", "C1_0002", "C1_0004"], ""),  # half of the steps may be times
        (["C1_0001", "C1_0002", "C1_0003", "C1_0005"], "image 4 is missing"),
        (["C1_1", "C1_2", "C1_3", "C1_03"], "two images have number 3"),
        (["t_0000", "t_0033", "t_0066", "t_0100"], ""),
        (["t_0000", "t_0002", "t_0004"], ""),
        (["a1", "b3", "c7"], ""),
        (["first", "second"], ""),
        (["7", "9"], "image 8 is missing"),
        (["7"], ""),
    ],
)
def test_numbers_behind_a_text_count_where_they_follow_each_other(names, wrong) -> None:
    assert wrong_numbers(names) == wrong


def room(rng: np.random.Generator) -> np.ndarray:
    """A smooth colourful background (120, 160, 3), with neither black nor white in it."""
    coarse = rng.uniform(60, 200, (12, 16, 3)).astype(np.float32)
    return cv2.resize(coarse, (160, 120), interpolation=cv2.INTER_CUBIC)


def noisy(image: np.ndarray, rng: np.random.Generator, sigma: float = 2.0) -> np.ndarray:
    return np.clip(np.rint(image + rng.normal(0, sigma, image.shape)), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("model", ["gaussian", "mog2", "knn"])
def test_subtraction_finds_the_subject_and_not_its_shadow(model: str) -> None:
    rng = np.random.default_rng(1)
    empty = room(rng)
    settings = replace(SUBTRACTED, model=model)
    background = learn_background((noisy(empty, rng) for _ in range(20)), 20, settings)
    subject = np.zeros((120, 160), bool)
    subject[20:90, 60:90] = True
    shadow = np.zeros_like(subject)
    shadow[90:105, 50:110] = True
    scene = empty.copy()
    scene[shadow] *= 0.8
    scene[subject] = (20, 30, 240)
    for _ in range(2):  # judging changes nothing
        found = clean_mask(background.foreground(noisy(scene, rng)), settings, scale=0.25)
        assert (found & subject).sum() / (found | subject).sum() > 0.97


def test_gaussian_follows_a_change_of_exposure() -> None:
    rng = np.random.default_rng(2)
    empty = room(rng)
    background = learn_background([noisy(empty, rng)], 1, SUBTRACTED)
    assert background.foreground(noisy(0.85 * empty, rng)).mean() < 1e-3


def test_the_recording_itself_teaches_the_background() -> None:
    rng = np.random.default_rng(3)
    empty = room(rng)

    def frame(i: int) -> np.ndarray:
        image = empty.copy()
        image[30:90, 4 * i : 4 * i + 16] = (250, 20, 20)
        return noisy(image, rng)

    background = learn_background(map(frame, range(36)), 36, replace(SUBTRACTED, source="recording"))
    subject = np.zeros((120, 160), bool)
    subject[30:90, 40:56] = True
    found = background.foreground(frame(10))
    assert (found & subject).sum() / (found | subject).sum() > 0.97


def test_clean_plates_of_the_real_recording_give_the_shipped_masks(shared_data: Path) -> None:
    from mmocap_warp.scene.scene_toml import load_scene

    scene = load_scene(Path(__file__).parents[2] / "scenes" / "balancing")
    given = next(replace(scene, foreground=ForegroundSettings()).masks(0.25, 5, 1))
    found = next(replace(scene, foreground=SUBTRACTED).masks(0.25, 5, 1))
    for a, b in zip(given, found, strict=True):
        assert (a & b).sum() / (a | b).sum() > 0.9


def blobs() -> np.ndarray:
    """A body of 20x40 with a hole of 9, cut by a gap of 2 rows, a big thing far away, and a speck."""
    mask = np.zeros((80, 120), bool)
    mask[20:60, 10:30] = True
    mask[40:42] = False
    mask[30:33, 15:18] = False
    mask[10:70, 80:110] = True
    mask[5, 50] = True
    return mask


def test_clean_up_steps() -> None:
    mask = blobs()
    assert not clean_mask(mask, ForegroundSettings(median=3))[5, 50]
    assert not clean_mask(mask, ForegroundSettings(open=3))[5, 50]
    assert clean_mask(mask, ForegroundSettings(close=5))[41, 20]
    filled = clean_mask(mask, ForegroundSettings(fill_holes=10))
    assert filled[31, 16]
    assert not filled[0, 0]
    assert not clean_mask(mask, ForegroundSettings(fill_holes=5))[31, 16]
    assert not clean_mask(mask, ForegroundSettings(min_area=2))[5, 50]
    np.testing.assert_array_equal(clean_mask(mask, ForegroundSettings()), mask)


def test_sizes_shrink_with_the_scale() -> None:
    mask = blobs()
    settings = ForegroundSettings(fill_holes=9 * 16 + 1)
    assert clean_mask(mask, settings, scale=0.25)[31, 16]
    assert not clean_mask(mask, replace(settings, fill_holes=8 * 16), scale=0.25)[31, 16]


def test_keeping_the_subject() -> None:
    mask = blobs()
    large = clean_mask(mask, ForegroundSettings(keep="largest", join=6))
    assert large[40, 90]
    assert large.sum() == 60 * 30
    body = np.zeros_like(mask)
    body[25:35, 12:20] = True
    near = clean_mask(mask, ForegroundSettings(keep="nearest", join=6), body=body)
    assert near[25, 20]
    assert near[55, 20]  # below the gap: pieces within 6 px are one
    assert not near[40, 90]
    beside = np.zeros_like(mask)
    beside[30:50, 33:36] = True  # overlaps nothing
    np.testing.assert_array_equal(clean_mask(mask, ForegroundSettings(keep="nearest", join=6), body=beside), near)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"source": "camera"}, "source must be one of"),
        ({"model": "median"}, "model must be one of"),
        ({"close": -1.0}, r"close must be 0 or more and below 1e9, got -1"),
        ({"min_area": 1e9}, r"min_area must be 0 or more and below 1e9, got 1e\+09"),
        ({"noise": 0.0}, "threshold and noise must be positive"),
        ({"shadow_brightness": 1.5}, "shadow_brightness must be 0 to 1"),
    ],
)
def test_settings_are_checked(wrong: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        ForegroundSettings(**wrong)


# A standing figure: a trunk 0.36 m wide and 0.24 m deep, and an arm beside it, with 0.1 m of air between them.
TRUNK = (np.array([-0.18, 0.6, -0.12]), np.array([0.18, 1.5, 0.12]))
ARM = (np.array([0.28, 0.7, -0.05]), np.array([0.38, 1.4, 0.05]))


def figure_masks(rig: CameraRig) -> list[np.ndarray]:
    masks = []
    for k, (width, height) in enumerate(rig.size):
        mask = np.zeros((height, width), np.uint8)
        for low, high in (TRUNK, ARM):
            corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T
            seen = (corners @ rig.R[k].T + rig.t[k]) @ rig.K[k].T
            outline = cv2.convexHull(np.rint(seen[:, :2] / seen[:, 2:]).astype(np.int32))
            cv2.fillConvexPoly(mask, outline, 1)
        masks.append(mask.astype(bool))
    return masks


def figure_rig(cameras: int = 6) -> CameraRig:
    return ring_rig(cameras, distance=3.5).undistorted(0.5)


def test_visual_hull_holds_the_figure_and_little_else() -> None:
    rig = figure_rig()
    hull = visual_hull(rig, Observation.from_masks(figure_masks(rig)), 0.03)
    np.testing.assert_allclose(hull.min(axis=0)[1], TRUNK[0][1], atol=0.06)
    np.testing.assert_allclose(hull.max(axis=0)[1], TRUNK[1][1], atol=0.06)
    voxels = set(map(tuple, np.rint(hull / 0.03).astype(int)))
    for low, high in (TRUNK, ARM):  # all but the outermost voxels, where pixels decide
        within = (
            np.arange(np.ceil(a / 0.03 + 0.5), b / 0.03 - 0.5).astype(int) for a, b in zip(low, high, strict=True)
        )
        assert voxels.issuperset(itertools.product(*within))
    volume = sum(np.prod(high - low) for low, high in (TRUNK, ARM))
    assert volume < len(hull) * 0.03**3 < 1.8 * volume


def test_visual_hull_survives_a_bad_camera() -> None:
    rig = figure_rig()
    masks = figure_masks(rig)
    good = len(visual_hull(rig, Observation.from_masks(masks), 0.03))
    masks[2] = np.roll(masks[2], 60, axis=1)
    spoilt = Observation.from_masks(masks)
    assert len(visual_hull(rig, spoilt, 0.03)) < 0.3 * good
    assert good < len(visual_hull(rig, spoilt, 0.03, tolerate=1)) < 1.8 * good


def test_visual_hull_leaves_out_lost_views() -> None:
    rig = figure_rig()
    masks = figure_masks(rig)
    good = len(visual_hull(rig, Observation.from_masks(masks), 0.03))
    masks[1][:] = False
    assert good <= len(visual_hull(rig, Observation.from_masks(masks), 0.03)) < 1.5 * good
    masks[1:] = [np.zeros_like(mask) for mask in masks[1:]]
    assert visual_hull(rig, Observation.from_masks(masks), 0.03, tolerate=1).shape == (0, 3)


def test_repair_fills_the_trunk_and_leaves_true_gaps() -> None:
    rig = figure_rig()
    whole = figure_masks(rig)
    torn = [mask.copy() for mask in whole]
    row, column = (int(axis.mean()) for axis in np.nonzero(whole[0]))
    torn[0][row - 8 : row + 8, column - 12 : column + 4] = False  # a hole in the trunk
    trunk = slice(*np.flatnonzero(whole[3].sum(axis=0) > 80)[[0, -1]])
    torn[3][row + 20 : row + 26, trunk] = False  # a gap at the waist
    repaired = repair_masks(rig, torn)
    for k, (mask, true) in enumerate(zip(repaired, whole, strict=True)):
        assert (mask & torn[k]).sum() == torn[k].sum()  # only adds
        lacking, added = (true & ~torn[k]).sum(), (mask & ~true).sum()
        assert (true & ~mask).sum() <= 0.15 * lacking
        assert added <= 0.05 * true.sum()  # the slit of 2 px beside the arm in oblique views
    beside_arm = np.flatnonzero(whole[0][row] & ~np.roll(whole[0][row], 1))[1] - 3
    assert not whole[0][row, beside_arm]
    assert not repaired[0][row, beside_arm]


def test_repair_needs_three_views() -> None:
    rig = figure_rig(3)
    masks = figure_masks(rig)
    masks[0][40:50] = False
    masks[1][:] = False
    for mask, same in zip(repair_masks(rig, masks), masks, strict=True):
        np.testing.assert_array_equal(mask, same)


def test_people_who_cross_are_told_apart_by_where_the_body_is() -> None:
    """They pass through each other as one blob, and part again: what is kept goes with the body."""
    row, column = np.indices((60, 200))

    def person(at: float) -> np.ndarray:
        return np.hypot((column - at) / 8, (row - 30) / 20) < 1

    settings = replace(GIVEN, join=4.0)
    for frame in range(31):
        mine, theirs = person(20 + 5 * frame), person(180 - 5 * frame)
        kept = clean_mask(mine | theirs, settings, body=person(15 + 5 * frame))

        assert (kept & mine).sum() == mine.sum()
    assert not (kept & theirs).any()


def test_small_images_are_cleaned_in_proportion():
    assert subtracted(1920) == subtracted(4000) == SUBTRACTED
    small = subtracted(640)
    assert (small.median, small.close) == pytest.approx((4.0, 20 / 3))
    assert (small.fill_holes, small.min_area) == pytest.approx((1000 / 9, 2000 / 9))
