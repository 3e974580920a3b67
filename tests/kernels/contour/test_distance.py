"""Distances are scipy's exact ones in float64, cut off and blurred; boxes hold the foreground and what is near it."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from poisoned import poisoned
from scipy import ndimage
from synthetic import ring_rig, synthetic_poses, synthetic_subject

from mmocap_warp.cameras.silhouette import silhouettes
from mmocap_warp.kernels.block import scratch
from mmocap_warp.kernels.contour.distance import (
    Masks,
    Workings,
    find_boxes,
    measure_distances,
    pixels_of,
)
from mmocap_warp.kernels.contour.residuals import FARTHEST, Fields
from mmocap_warp.kernels.structs import filled
from mmocap_warp.masks.observation import pack_masks
from mmocap_warp.synthesis.exact_posing import ExactPoser

SIZES = ((97, 61), (64, 48), (33, 75), (129, 20), (31, 40))  # width, height
APART = 1e-4  # [px]
GAP = 7  # values between two frames


def twin(mask: np.ndarray) -> np.ndarray:
    """(height, width) float64 [px]; beyond the image the mask goes on as at its border."""
    wide = np.pad(mask, 20, mode="edge")
    distance = np.full(wide.shape, -np.inf) if wide.all() else -ndimage.distance_transform_edt(wide)
    outside = np.full(wide.shape, np.inf) if not wide.any() else ndimage.distance_transform_edt(~wide)
    signed = np.where(wide, distance + 0.5, outside - 0.5)
    signed = np.clip(signed, 0.5 - FARTHEST, FARTHEST - 0.5)
    weight = np.exp(-0.5 * np.arange(-2, 3) ** 2)
    weight /= weight.sum()
    for axis in (0, 1):
        signed = ndimage.convolve1d(signed, weight, axis=axis, mode="nearest")
    return signed[20:-20, 20:-20]


def boxes_of(masks: list[list[np.ndarray]]) -> np.ndarray:
    """(frame, camera, 4) by the definition."""
    boxes = np.zeros((len(masks), len(masks[0]), 4), int)
    for f, views in enumerate(masks):
        for k, mask in enumerate(views):
            if mask.any():
                y, x = np.nonzero(mask)
                left, top = max(x.min() - FARTHEST, 0), max(y.min() - FARTHEST, 0)
                right, bottom = np.minimum((x.max(), y.max()), np.array(mask.shape[::-1]) - 1 - FARTHEST) + FARTHEST + 1
                boxes[f, k] = left, top, right - left, bottom - top
    return boxes


class Measured:
    """Boxes and fields of frames of masks, in places that are the frames' in backward order."""

    def __init__(self, masks: list[list[np.ndarray]], device: str):
        frames, cameras = len(masks), len(masks[0])
        size = np.array([mask.shape[::-1] for mask in masks[0]])
        word = wp.array(np.stack([pack_masks(views) for views in masks]), dtype=wp.uint32, device=device)
        place = np.arange(frames)[::-1].copy()
        self.masks = filled(
            Masks,
            word=word,
            size=wp.array(size, dtype=wp.vec2i, device=device),
            place=wp.array(place, dtype=wp.int32, device=device),
        )
        found = poisoned((frames, cameras), wp.vec4i, device)
        find_boxes(self.masks, scratch(device), found)
        self.box = found.numpy().copy()
        pixels = pixels_of(self.box[..., 2], self.box[..., 3])
        room = int(pixels.sum(axis=1).max()) + GAP
        self.start = (np.cumsum(pixels, axis=1) - pixels + room * place[:, None])[np.argsort(place)]
        workings = filled(
            Workings,
            room=room,
            inside=wp.full(frames * room, 77, dtype=wp.uint8, device=device),
            across=wp.full(frames * room, 77, dtype=wp.uint8, device=device),
            rough=poisoned(frames * room, wp.float32, device),
        )
        self.fields = filled(
            Fields,
            value=poisoned(frames * room, wp.float32, device),
            box=wp.array(self.box[np.argsort(place)], dtype=wp.vec4i, device=device),
            start=wp.array(self.start, dtype=wp.int32, device=device),
            frame=wp.zeros(1, dtype=wp.int32, device=device),
            larger=wp.zeros(cameras, dtype=wp.float32, device=device),
            hidden=wp.zeros((0, 0, 0, 0), dtype=wp.uint32, device=device),
        )
        measure_distances(self.masks, workings, self.fields)
        self.place = place

    def field(self, f: int, k: int) -> np.ndarray:
        _x, _y, width, height = self.box[f, k]
        start = self.start[self.place[f], k]
        return self.fields.value.numpy()[start : start + width * height].reshape(height, width)


def check(masks: list[list[np.ndarray]], device: str) -> None:
    measured = Measured(masks, device)
    np.testing.assert_array_equal(measured.box, boxes_of(masks))
    for f, views in enumerate(masks):
        for k, mask in enumerate(views):
            x, y, width, height = measured.box[f, k]
            if width:
                expected = twin(mask)[y : y + height, x : x + width]
                np.testing.assert_allclose(measured.field(f, k), expected, rtol=0, atol=APART)


@pytest.mark.parametrize("filled_share", [0.02, 0.5, 0.97])
def test_noise(device, filled_share):
    rng = np.random.default_rng(3)
    check([[rng.random((h, w)) < filled_share for w, h in SIZES] for _ in range(3)], device)


def test_blobs_and_borders(device):
    """Smooth shapes, some of them cut by the border, in corners, of one pixel, everywhere, nowhere."""
    rng = np.random.default_rng(4)
    frames = []
    for _ in range(4):
        noise = [ndimage.gaussian_filter(rng.normal(size=(h, w)), 6.0) for w, h in SIZES]
        frames.append([field > np.quantile(field, 0.8) for field in noise])
    for mask in frames[1]:
        mask[:] = False
    for mask, (y, x) in zip(frames[1], ((0, 0), (-1, -1), (0, -1), (-1, 0), (7, 9)), strict=True):
        mask[y, x] = True
    frames[2][0][:] = False
    frames[2][1][:] = True
    check(frames, device)


def test_a_person(device):
    subject, rig = synthetic_subject(), ring_rig(2, size=(320, 240))
    poser = ExactPoser(subject.body, subject.root_base)
    vertices = poser.vertices(synthetic_poses(9)[::4])[:, subject.body.tracking_vertex]
    check([silhouettes(rig, one, subject.body.tracking_face) for one in vertices], device)


def test_a_field_says_how_far_a_straight_contour_is(device):
    """Half a pixel from the last pixel's centre, to either side."""
    mask = np.zeros((60, 80), bool)
    mask[20:40, 30:50] = True
    measured = Measured([[mask]], device)
    x, _y, _w, height = measured.box[0, 0]
    row = measured.field(0, 0)[height // 2]
    columns = np.arange(x, x + len(row))
    expected = np.abs(columns - 39.5) - 10.0
    near = np.abs(expected) < FARTHEST - 3
    np.testing.assert_allclose(row[near], expected[near], atol=APART)
    assert np.abs(row).max() <= FARTHEST - 0.5 + APART
