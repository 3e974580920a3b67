"""What a preset gives a tracker."""

import numpy as np
import pytest
from synthetic import synthetic_subject
from tracked_motion import FPS, RIG, motion

from mmocap_warp.tracking.algorithms import ALGORITHMS, PRESETS
from mmocap_warp.tracking.contour_tracker import ContourTracker
from mmocap_warp.tracking.track_config import TrackConfig
from mmocap_warp.tracking.tracker import Tracker

RECORDING = {
    "cmaes": (0.01, 0.0067),
    "h-cmaes": (0.02, 0.0133),
    "de": (0.08, 0.053),
    "h-de": (0.06, 0.04),
    "pso": (0.02, 0.0133),
    "h-pso": (0.03, 0.02),
    "apf": (0.03, 0.02),
    "psapf": (0.03, 0.02),
}


@pytest.mark.parametrize("preset", ["recording", "recording-restart"])
def test_a_recordings_radii_are_each_algorithms_own_and_grow_with_the_frame_interval(preset):
    assert set(RECORDING) <= set(ALGORITHMS)
    for algorithm, radii in RECORDING.items():
        assert PRESETS[preset].at(algorithm, 60.0) == radii
        assert PRESETS[preset].at(algorithm, 30.0) == (2 * radii[0], 2 * radii[1])


def test_only_apf_differs_between_the_recordings_presets():
    plain, restart = PRESETS["recording"], PRESETS["recording-restart"]
    assert [name for name in ALGORITHMS if restart.algorithm(name) != plain.algorithm(name)] == ["apf"]
    assert all(plain.algorithm(name) is algorithm for name, algorithm in ALGORITHMS.items())


def apf(device, preset):
    config = TrackConfig("apf", evaluations=100, preset=preset, device=device)
    return Tracker(synthetic_subject(), RIG, config, FPS)


def test_apf_that_restarts_carries_its_answer_alone(device):
    """The frame after depends on the last answer and the random counter, and on no particles."""
    _truth, seen = motion(device)
    first, other = (apf(device, "recording-restart") for _ in range(2))
    first.step(seen[0])
    other.step(seen[3])
    assert not first.state.search_memory
    other.state = first.state
    np.testing.assert_array_equal(first.step(seen[1]).pose, other.step(seen[1]).pose)
    assert len(apf(device, "recording").state.search_memory) == 2


@pytest.mark.parametrize(("preset", "carried"), [("recording", 2), ("recording-restart", 0)])
def test_a_search_before_contours_has_the_presets_settings_too(preset, carried):
    config = TrackConfig("apf", evaluations=100, preset=preset, polish=True, device="cpu")
    assert len(ContourTracker(synthetic_subject(), RIG, config, FPS).state.search_memory) == carried
