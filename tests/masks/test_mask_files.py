"""Masks in the forms that people have them in, each made here by code, as the programs that write them do."""

from __future__ import annotations

import json
import tarfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from given_masks import packed, palette_png, plain_rle, rle, write_tar

from mmocap_warp.errors import InputError
from mmocap_warp.masks.mask_files import open_masks
from mmocap_warp.masks.mask_image import Labels, decode_mask
from mmocap_warp.masks.rle_masks import decode_rle

HEIGHT, WIDTH = 48, 64
ONE = np.zeros((HEIGHT, WIDTH), bool)
ONE[10:40, 8:20] = True
TWO = np.zeros_like(ONE)
TWO[8:44, 34:50] = True
DAVIS = np.array([[0, 0, 0], [128, 0, 0], [0, 128, 0], [128, 128, 0], [0, 0, 128], [64, 0, 0]], np.uint8)
LABELS = (ONE + 5 * TWO).astype(np.uint8)
"""Identities 1 and 5; the second one is dark in the palette."""


def write_folder(folder: Path, *images: bytes, suffix: str = ".png") -> Path:
    folder.mkdir()
    for frame, data in enumerate(images):
        (folder / f"{frame:05d}{suffix}").write_bytes(data)
    return folder


def encoded(image: np.ndarray, suffix: str = ".png") -> bytes:
    good, data = cv2.imencode(suffix, image)
    assert good
    return data.tobytes()


def first_mask(path: Path, identity: int = 0) -> np.ndarray:
    masks = open_masks(path)
    return decode_mask(next(masks.read()), identity, masks.soft)


@pytest.mark.parametrize("depth", [4, 8])
def test_sam_2_s_indexed_png_holds_objects_by_index(depth: int, tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "sam2", palette_png(LABELS, DAVIS, depth))
    np.testing.assert_array_equal(first_mask(folder), ONE | TWO)
    np.testing.assert_array_equal(first_mask(folder, 1), ONE)
    np.testing.assert_array_equal(first_mask(folder, 5), TWO)
    assert not first_mask(folder, 2).any()


def test_an_indexed_picture_of_grays_is_a_picture(tmp_path: Path) -> None:
    """A soft mask that was saved in little space: half the range decides, not the index."""
    grays = np.arange(0, 256, 51, dtype=np.uint8).repeat(3).reshape(-1, 3)
    index = np.where(ONE, 5, np.where(TWO, 1, 0)).astype(np.uint8)
    np.testing.assert_array_equal(first_mask(write_folder(tmp_path / "g", palette_png(index, grays))), ONE)


def test_an_indexed_picture_with_transparency_is_cut_out_by_it(tmp_path: Path) -> None:
    colours = np.array([[0, 0, 0], [200, 10, 10], [10, 10, 200]], np.uint8)
    index = np.where(ONE, 1, 2).astype(np.uint8)
    data = palette_png(index, colours, extra=bytes([0, 255, 0]))
    np.testing.assert_array_equal(first_mask(write_folder(tmp_path / "t", data)), ONE)


def test_gray_labels_are_chosen_by_their_level(tmp_path: Path) -> None:
    for bits in (np.uint8, np.uint16):
        folder = write_folder(tmp_path / bits.__name__, encoded(LABELS.astype(bits)))
        np.testing.assert_array_equal(first_mask(folder, 5), TWO)


def soft_alpha() -> np.ndarray:
    """An edge of three pixels around the object, 0 to 255."""
    return cv2.GaussianBlur(ONE.astype(np.uint8) * 255, (0, 0), 1.0)


def test_soft_alpha_counts_from_half(tmp_path: Path) -> None:
    """RVM's and MatAnyone's alpha, and rembg's cut-out, whose colours lie beneath it."""
    alpha = soft_alpha()
    expected = alpha > 127
    np.testing.assert_array_equal(first_mask(write_folder(tmp_path / "pha", encoded(alpha))), expected)
    cut_out = np.dstack([np.full((HEIGHT, WIDTH, 3), 240, np.uint8), alpha])
    np.testing.assert_array_equal(first_mask(write_folder(tmp_path / "rgba", encoded(cut_out))), expected)
    wide = alpha.astype(np.uint16) * 257
    np.testing.assert_array_equal(first_mask(write_folder(tmp_path / "deep", encoded(wide))), expected)


def test_an_alpha_video_is_soft_where_it_is_empty(tmp_path: Path) -> None:
    """What compression leaves of nothing, levels 0 and 3, is no label."""
    path = tmp_path / "pha.mkv"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"FFV1"), 30, (WIDTH, HEIGHT))
    for image in (soft_alpha(), np.where(TWO, 3, 0).astype(np.uint8)):
        writer.write(np.dstack([image] * 3))
    writer.release()
    masks = open_masks(path)
    seen, empty = (decode_mask(image, soft=masks.soft) for image in masks.read())
    np.testing.assert_array_equal(seen, soft_alpha() > 127)
    assert not empty.any()


@pytest.mark.parametrize("suffix", [".pbm", ".pgm"])
def test_netpbm_is_read_as_it_looks(suffix: str, tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "n", encoded(ONE.astype(np.uint8) * 255, suffix), suffix=suffix)
    np.testing.assert_array_equal(first_mask(folder), ONE)


def test_a_tar_is_read_where_it_lies_in_the_order_of_its_names(tmp_path: Path) -> None:
    images = {f"cam/{i}.png": encoded((ONE if i % 2 else TWO).astype(np.uint8) * 255) for i in range(12)}
    shuffled = sorted(images.items(), key=lambda item: item[0][::-1])
    path = write_tar(tmp_path / "cam.tar", *shuffled, ("cam/.DS_Store", b"x"), ("cam/notes.txt", b"x"))
    masks = open_masks(path)
    assert (len(masks), masks.size, masks.files) == (12, (WIDTH, HEIGHT), (path,))
    for i, image in enumerate(masks.read(3), 3):
        np.testing.assert_array_equal(decode_mask(image), ONE if i % 2 else TWO)
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("name", "kind", "problem"),
    [
        ("../0.png", tarfile.REGTYPE, "leads out of it"),
        ("/0.png", tarfile.REGTYPE, "leads out of it"),
        ("0.png", tarfile.SYMTYPE, "is no plain image file"),
        ("0.png", tarfile.LNKTYPE, "is no plain image file"),
        ("0.png", tarfile.FIFOTYPE, "is no plain image file"),
    ],
)
def test_a_tar_with_more_than_files_in_it_is_refused(name: str, kind: bytes, problem: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=problem):
        open_masks(write_tar(tmp_path / "bad.tar", (name, b""), kind=kind))


def test_a_tar_that_is_none_or_ends_early_is_refused(tmp_path: Path) -> None:
    (tmp_path / "none.tar").write_bytes(b"no" * 600)
    with pytest.raises(InputError, match="cannot be read as a tar archive"):
        open_masks(tmp_path / "none.tar")
    path = write_tar(tmp_path / "short.tar", ("0.png", encoded(ONE.astype(np.uint8))), ("1.png", bytes(5000)))
    path.write_bytes(path.read_bytes()[:2300])
    with pytest.raises(InputError, match=r"short\.tar"):
        list(open_masks(path).read())


def test_run_lengths_come_back_for_any_mask() -> None:
    rng = np.random.default_rng(5)
    for _ in range(300):
        height, width = rng.integers(1, 40, 2).tolist()
        mask = cv2.resize(rng.random((5, 5)).astype(np.float32), (width, height)) < rng.random()
        mask ^= rng.random(mask.shape) < rng.choice([0.0, 0.02, 0.5])
        lengths = plain_rle(mask)
        np.testing.assert_array_equal(decode_rle(lengths, height, width), mask)
        np.testing.assert_array_equal(decode_rle(packed(lengths), height, width), mask)


PYCOCOTOOLS = "m8i0?00000000000000000000000000000000000000000000000000000000000000000S;"


def test_a_string_that_pycocotools_wrote() -> None:
    """pycocotools 2.0, encode() of a 40x50 mask with rows 5 to 29 of columns 7 to 40 set."""
    mask = np.zeros((40, 50), bool)
    mask[5:30, 7:41] = True
    np.testing.assert_array_equal(decode_rle(PYCOCOTOOLS, 40, 50), mask)
    assert packed(plain_rle(mask)) == PYCOCOTOOLS


@pytest.mark.parametrize("counts", ["3333", "o", "\n", "32", [3, 3], [3, -3, 9], [9.0], None, "o" * 100])
def test_wrong_run_lengths_are_refused(counts: Any) -> None:
    with pytest.raises(ValueError, match="run lengths"):
        decode_rle(counts, 3, 3)


NOTHING = np.zeros_like(ONE)
COCO = {
    "images": [{"id": 7, "file_name": "10.jpg"}, {"id": 9, "file_name": "9.jpg"}],
    "annotations": [
        {"id": 1, "image_id": 7, "category_id": 1, "track_id": 1, "segmentation": rle(ONE)},
        {"id": 2, "image_id": 9, "category_id": 1, "track_id": 5, "segmentation": rle(TWO, pack=False)},
    ],
}
VIDEO = {
    "annotations": [
        {"id": 1, "segmentations": [None, rle(ONE)]},
        {"id": 5, "segmentations": [rle(TWO), None]},
    ]
}
LISTED = [[None, None, None, None, rle(TWO)], rle(ONE)]


@pytest.mark.parametrize("content", [COCO, VIDEO, LISTED], ids=["coco", "video", "listed"])
def test_run_lengths_in_json(content: Any, tmp_path: Path) -> None:
    (tmp_path / "masks.json").write_text(json.dumps(content))
    masks = open_masks(tmp_path / "masks.json")
    assert (len(masks), masks.size) == (2, (WIDTH, HEIGHT))
    for identity, expected in ((0, (TWO, ONE)), (1, (NOTHING, ONE)), (5, (TWO, NOTHING))):
        for image, mask in zip(masks.read(), expected, strict=True):
            np.testing.assert_array_equal(decode_mask(image, identity), mask)
    (last,) = masks.read(1)
    np.testing.assert_array_equal(decode_mask(last), ONE)


def test_the_smaller_of_overlapping_objects_is_in_front(tmp_path: Path) -> None:
    part = ONE.copy()
    part[20:] = False
    (tmp_path / "masks.json").write_text(json.dumps([[rle(part), rle(ONE)]]))
    (labels,) = open_masks(tmp_path / "masks.json").read()
    assert isinstance(labels, Labels)
    assert labels.identities == {1: part.sum(), 2: (ONE & ~part).sum()}


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ("[", "cannot be read as JSON"),
        ("[" * 100_000, "cannot be read as JSON"),
        ("[]", "holds no masks"),
        ("{}", r"not in COCO's form \(KeyError: 'annotations'\)"),
        ('{"annotations": 3}', "not in COCO's form"),
        ("[1]", "not in COCO's form"),
        ('[{"size": [4, 4]}]', "not in COCO's form"),
        ('[{"size": [4, -4], "counts": []}]', "is not a height and a width"),
        ('[{"size": [4, 4, 3], "counts": []}]', r"size = \[4, 4, 3\] is not a height and a width; write it with"),
        ('[{"size": [16], "counts": []}]', r"size = \[16\] is not a height and a width"),
        ('[{"size": 16, "counts": []}]', "size = 16 is not a height and a width"),
        ('[{"size": [400000, 400000], "counts": []}]', "is not a height and a width"),
        ('[{"size": [4, 4], "counts": "x"}, {"size": [4, 5], "counts": "x"}]', "masks of different sizes"),
        ('{"images": [{"id": 1}], "annotations": [{"image_id": 1, "segmentation": [[1, 2]]}]}', "holds polygons"),
        (
            '{"images": [{"id": 1, "file_name": "a_1.jpg"}, {"id": 2, "file_name": "a_2.jpg"},'
            ' {"id": 3, "file_name": "a_3.jpg"}, {"id": 4, "file_name": "a_5.jpg"}], "annotations": []}',
            "image 4 is missing: list each image once",
        ),
        ('{"annotations": [{"id": 0, "segmentations": [{"size": [1, 1], "counts": "01"}]}]}', "is not a whole number"),
    ],
)
def test_wrong_json_is_one_line(content: str, problem: str, tmp_path: Path) -> None:
    (tmp_path / "masks.json").write_text(content)
    with pytest.raises(InputError, match=problem) as caught:
        open_masks(tmp_path / "masks.json")
    assert "\n" not in str(caught.value)
