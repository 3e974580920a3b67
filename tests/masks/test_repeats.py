"""Repeated images are noticed by motion that stops and goes on at once; standing still is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mmocap_warp.masks.observation import Observation
from mmocap_warp.masks.repeats import repeated_views

FRAMES, VIEWS = 48, 3


def course(speed=1.5):
    """(frame, view) where a bar stands [px]: it swings, each view sees another side of that."""
    swing = np.cumsum(np.repeat(speed * np.sin(np.arange(FRAMES) / 9) + 2 * speed, 1))
    return swing[:, None] * (1.0, 0.8, -0.9) + (20, 20, 170)


def seen(place):
    """Masks of a bar at places (frame, view), 200 x 40 px."""
    column = np.arange(200)
    return [
        Observation.from_masks([np.tile(np.abs(column - x) < 8, (40, 1)) for x in frame]) for frame in np.round(place)
    ]


@pytest.mark.parametrize("rate", [30, 24, 20])
def test_footage_of_a_lower_rate_in_a_file_of_sixty(rate):
    taken = (np.arange(FRAMES) * rate // 60) * 60 // rate
    again = np.append(False, np.diff(taken) == 0)
    repeated = repeated_views(seen(course()[taken]))
    assert (repeated == again[:, None]).mean() > 0.95
    assert not repeated[~again].any()


def test_masks_that_hardly_change_are_repeated_too():
    """Compressed video is never quite the same."""
    observations = seen(course()[np.arange(FRAMES) // 2 * 2])
    for i, observation in enumerate(observations):
        observation.words[:, 5, 3] ^= np.uint32(1 << i % 4)
    assert repeated_views(observations)[1::2].all()


def test_all_cameras_that_freeze_and_leap_on():
    place = course()
    place[20:30] = place[20]
    repeated = repeated_views(seen(place))
    assert np.flatnonzero(repeated.all(axis=1)).tolist() == list(range(21, 30))
    assert repeated.sum() == 9 * VIEWS


@pytest.mark.parametrize("end", [30, FRAMES])
def test_one_camera_that_freezes(end):
    place = course()
    place[20:end, 1] = place[20, 1]
    repeated = repeated_views(seen(place))
    assert np.flatnonzero(repeated[:, 1]).tolist() == list(range(21, end))
    assert not repeated[:, [0, 2]].any()


def test_a_view_whose_masks_flicker_for_a_while_is_not_frozen_after_that():
    observations, rng = seen(20 + np.tile(np.arange(FRAMES)[:, None], VIEWS)), np.random.default_rng(1)
    for observation in observations[4:20]:
        observation.words[1] |= rng.integers(0, 2**32, observation.words[1].shape, np.uint32)
    flickering = [replace(each, foreground=np.bitwise_count(each.words).sum(axis=(1, 2))) for each in observations]
    assert not repeated_views(flickering).any()


def test_a_camera_that_is_known_to_take_half_as_many_images_repeats_none():
    place, frame = course(), np.arange(FRAMES)
    place[:, 1] = place[frame // 2 * 2, 1]
    observations, late = seen(place), np.zeros((FRAMES, VIEWS))
    assert repeated_views(observations)[:, 1].sum() > 20
    late[:, 1] = -(frame % 2) / 60
    known = [replace(each, late=of if of.any() else None) for each, of in zip(observations, late, strict=True)]
    assert not repeated_views(known).any()


def test_somebody_who_leaves_a_view_freezes_nothing():
    place = course()
    place[20:35, 1] = -50
    assert not repeated_views(seen(place)).any()


def test_moving_and_standing_still_repeat_nothing():
    place = course()
    assert not repeated_views(seen(place)).any()
    # Somebody stops at once, stands, and goes on, several times, or all the time.
    pause = np.concatenate([np.repeat(place[:12], 1, axis=0), np.repeat(place[12:13], 15, axis=0), place[13:]])
    for first in (30, 40):
        pause = np.insert(pause, [first] * 6, pause[first], axis=0)
    assert not repeated_views(seen(pause)).any()
    assert not repeated_views(seen(np.repeat(place[:1], FRAMES, axis=0))).any()
    assert not repeated_views([]).any()
