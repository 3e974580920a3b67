"""Lags planted in recordings come back, and the table says what became of them."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
from planted_lags import WAYS, Trial, errors, plant, row, trial

from mmocap_warp.calibration.sync.synchronise import Synchronisation, ViewOffset
from mmocap_warp.scene.recording import Scene
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.scenes import ROOT

MOTION, NEAR, CALIBRATED = WAYS


@pytest.fixture(scope="module")
def walk() -> Scene:
    return load_scene(ROOT / "walk")


def test_a_camera_that_lags_shows_what_others_showed_before(walk: Scene) -> None:
    lags = np.array([0, 3, 0, 0, -2])
    planted = plant(walk, lags, 10, 20)
    assert planted.recorded_frames == 20
    for k, lag in enumerate(lags):
        here = next(islice(planted.masks(0.25), 5, None))[k]
        there = next(walk.masks(0.25, 15 - int(lag), 1))[k]
        np.testing.assert_array_equal(here, there)
    with pytest.raises(ValueError, match="cam1' has 64 frames"):
        plant(walk, lags, 10, 60)


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.nightly) for seed in (2, 3))])
def test_a_second_of_a_walk_tells_its_lags_by_motion_alone(walk: Scene, seed: int) -> None:
    """By the head going up and down: without it two cameras were up to eight frames off, and said to be sure.

    The parts of so short a clip agree only to 2.2 to 3.1 frames, so that none of these is sure.
    """
    found = trial(walk, seed, MOTION)
    assert found.worst <= MOTION.exact
    assert not found.sure


def test_an_offset_that_all_have_in_common_is_no_error() -> None:
    views = {str(k): ViewOffset(frames, 0.1, 9, 1.0, True) for k, frames in enumerate([0, 4, 0])}
    off = errors(Synchronisation(60.0, views, None), np.array([2, 5, 2]))
    np.testing.assert_array_equal(off, [0, 1, 0])


def test_what_is_found_refused_and_wrong_is_counted(walk: Scene) -> None:
    right, unsure, wrong = Trial(np.array([0, 1]), True), Trial(np.array([0, 0]), False), Trial(np.array([0, -7]), True)
    line = row("walk", walk, [(MOTION, [right, unsure]), (CALIBRATED, [right, wrong, replace(wrong, sure=False)])])
    first, second = line.split(" | ")[2:]
    assert first == "1 found (worst 1), 1 not sure (1 right)"
    assert second == "1 found (worst 1), 1 not sure (0 right), **1 wrong** (7) |"
