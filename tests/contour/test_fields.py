"""Fields of many frames: each in its place, kept when room grows, the same one by one and all at once."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic import ring_rig

from mmocap_warp.contour.frame.fields import DistanceFields
from mmocap_warp.masks.observation import Observation

SIZE = (160, 120)
RIG = ring_rig(2, size=SIZE)


def frame(radius: float, shift: int = 0) -> Observation:
    """A disc in each view."""
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    discs = [(x - 70 - shift - 9 * k) ** 2 + (y - 60) ** 2 < radius**2 for k in range(2)]
    return Observation.from_masks(discs)


def field(fields: DistanceFields, place: int, k: int) -> np.ndarray:
    _x, _y, width, height = fields.struct.box.numpy()[place, k]
    start = fields.struct.start.numpy()[place, k]
    return fields.struct.value.numpy()[start : start + width * height].reshape(height, width).copy()


def of_frames(frames: list[Observation], device: str) -> DistanceFields:
    fields = DistanceFields(RIG, len(frames), device)
    fields.observe(frames)
    return fields


def test_growing_room_keeps_what_there_was(device, monkeypatch):
    monkeypatch.setattr("mmocap_warp.contour.frame.fields.MOST_WHOLE", 0)
    frames = [frame(radius, shift) for radius, shift in ((9, 0), (10, 20), (30, -7), (48, 3), (12, 30))]
    fields = DistanceFields(RIG, 5, device)
    arrays = set()
    for place, observation in enumerate(frames):
        fields.observe([observation], place)
        arrays.add(fields.struct.value.ptr)
    assert len(arrays) > 2
    for place, observation in enumerate(frames):
        alone = of_frames([observation], device)
        assert (fields.struct.box.numpy()[place, :, 2] > 0).all()
        for k in range(2):
            np.testing.assert_array_equal(fields.struct.box.numpy()[place, k], alone.struct.box.numpy()[0, k])
            np.testing.assert_array_equal(field(fields, place, k), field(alone, 0, k))


def test_whole_images_have_room_on_a_gpu(device):
    if device == "cpu":
        pytest.skip("the CPU knows how much room is needed")
    fields = DistanceFields(RIG, 3, device)
    value = fields.struct.value.ptr
    for place, radius in ((0, 9), (2, 50), (1, 30), (1, 12)):
        fields.observe([frame(radius)], place)
        for k in range(2):
            np.testing.assert_array_equal(field(fields, place, k), field(of_frames([frame(radius)], device), 0, k))
    assert fields.struct.value.ptr == value


def test_frames_one_by_one_are_those_all_at_once(device):
    """More frames than a GPU takes together, in places after some that stay, in any order."""
    rng = np.random.default_rng(0)
    frames = [frame(rng.uniform(5, 40), int(rng.integers(-20, 20))) for _ in range(70)]
    fields = DistanceFields(RIG, 72, device)
    fields.observe([frames[3]], 0)
    fields.observe([frames[4]], 71)
    fields.observe(frames, first=1)
    fields.observe([frames[5]], 1)
    fields.observe(frames[:2], first=10)
    for place, number in ((0, 3), (71, 4), (1, 5), (2, 1), (10, 0), (11, 1), (12, 11), (70, 69)):
        alone = of_frames([frames[number]], device)
        for k in range(2):
            np.testing.assert_array_equal(field(fields, place, k), field(alone, 0, k))


def test_a_place_takes_another_frame(device):
    fields = of_frames([frame(40), frame(12)], device)
    fields.observe([frame(12)], 0)
    for k in range(2):
        np.testing.assert_array_equal(field(fields, 0, k), field(fields, 1, k))


@pytest.mark.parametrize(("pixels", "seen"), [(49, False), (50, True)])
def test_a_few_pixels_show_nobody(device, pixels, seen):
    mask = np.zeros(SIZE[::-1], bool)
    mask.ravel()[5000 : 5000 + pixels] = True
    fields = of_frames([Observation.from_masks([mask, np.zeros_like(mask)])], device)
    assert (fields.struct.box.numpy()[0, :, 2] > 0).tolist() == [seen, False]
