"""Faults that are planted in a scene's cameras, and what is said to be left of them."""

from __future__ import annotations

import numpy as np
import pytest
from moving_person import RIG, write_scene
from planted_cameras import FAULTS, Planted, left_over, line, planted

from mmocap_warp.calibration.adjust.adjustment import AdjustConfig
from mmocap_warp.calibration.adjust.camera_changes import FOCAL, KINDS, OFFSET, POSITION, ROTATION, changed, difference
from mmocap_warp.calibration.refine.refinement import Overlaps, Refinement

OTHERS = np.arange(1, len(RIG))


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return write_scene(tmp_path_factory.mktemp("scene"), frames=2)


def refined(case: Planted, change: np.ndarray) -> Refinement:
    """As if so much had been found and nothing else."""
    explained = Overlaps(np.full(len(RIG), 0.9), np.full(len(RIG), 0.8))
    rig = changed(case.scene.calibrated, np.where(np.arange(len(KINDS)) == OFFSET, 0.0, change))
    sigma = np.full(change.shape, 1e-3)
    return Refinement(rig, change, sigma, change != 0, np.zeros(change.shape, bool), 0, explained, explained)


@pytest.mark.parametrize("fault", FAULTS)
def test_all_but_the_first_camera_are_off_by_as_much_as_is_said(scene, fault):
    case = planted(scene, fault, OTHERS, AdjustConfig())
    columns, size = FAULTS[fault]
    off = difference(RIG, case.scene.calibrated)
    later = [
        after.frame_offset - now.frame_offset for now, after in zip(scene.cameras, case.scene.cameras, strict=True)
    ]
    if fault == "time":
        np.testing.assert_array_equal(np.abs(later), [0, 5, 5, 5])
    else:
        np.testing.assert_allclose(np.linalg.norm(off[1:, columns], axis=1), size, rtol=1e-6)
        assert not any(later)
    assert not np.abs(off[0]).max() > 1e-9
    assert case.config.fixed == RIG.names[0]
    assert (case.config.distance is not None) == (fault == "position")


def test_nothing_is_left_where_all_of_it_was_found(scene):
    for fault in FAULTS:
        case = planted(scene, fault, OTHERS, AdjustConfig())
        back = difference(case.scene.calibrated, RIG)
        back[:, OFFSET] = -case.change[:, OFFSET]
        left = left_over(RIG, case.change, refined(case, back))
        assert np.abs(left).max() < 1e-6


def test_what_is_left_is_told_in_degrees_millimetres_percent_and_frames(scene):
    case = planted(scene, "focal", OTHERS[:1], AdjustConfig())
    found = refined(case, np.zeros((len(RIG), len(KINDS))))
    left = left_over(RIG, case.change, found)
    assert abs(left[1, FOCAL]) == pytest.approx(0.03)
    left[1, ROTATION], left[2, POSITION], left[3, OFFSET] = [0, 0, np.radians(0.5)], [0.003, 0, 0.004], 0.5 / scene.fps
    assert line(case, left, found) == (
        "| focal, one camera | 0.500 | 5.0 | 3.00 | 0.00 | 0.50 | 0 of 0 | 0.900 to 0.900, 0.800 to 0.800 |"
    )
