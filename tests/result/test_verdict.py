"""What a result says of itself in words."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from synthetic import SKELETON, synthetic_result

from mmocap_warp.result.result import STATUS

FRAMES, CAMERAS = 12, 4
PARTS = len(SKELETON.parts)


def sound(**changes):
    """A result that nothing speaks against, with changes; its frames are 10 to 21."""
    result = synthetic_result(FRAMES, runs=1, cameras=CAMERAS)
    nothing = {"view_shift": np.full((1, FRAMES, CAMERAS), 0.004), "part_doubt": np.zeros((1, FRAMES, PARTS))}
    whole = {"iou": np.full((1, FRAMES, CAMERAS), 0.4), "status": np.zeros((1, FRAMES), np.int8)}
    return replace(result, **nothing | whole | changes)


def test_a_sound_result_is_trusted_whatever_its_overlap():
    verdict = sound().verdict()
    assert (verdict.trusted, verdict.frames, verdict.holds) == (12, 12, True)
    assert verdict.lines(Path("s.toml")) == ["12 of 12 frames trusted"]


def test_what_nobody_looked_at_is_no_fault():
    assert sound(view_shift=None, part_doubt=None).verdict().trusted == FRAMES


@pytest.mark.parametrize(("name", "trusted"), [("lost", 5), ("interpolated", 5), ("partial", 12), ("rescued", 12)])
def test_frames_without_a_pose_of_their_own_are_not_trusted(name, trusted):
    status = np.zeros((1, FRAMES), np.int8)
    status[0, 5:] = STATUS.index(name)
    verdict = sound(status=status).verdict()
    assert (verdict.trusted, verdict.holds) == (trusted, trusted > 5)


def test_one_view_is_not_enough():
    iou = np.full((1, FRAMES, CAMERAS), 0.9)
    iou[0, :2, 1:] = np.nan
    assert sound(iou=iou).verdict().trusted == FRAMES - 2


def test_a_camera_that_disagrees_is_named_with_what_to_do():
    shift = np.tile([0.006, 0.04, 0.005, np.nan], (1, FRAMES, 1))
    shift[0, :3, 0] = 0.2  # for a moment another one is far off
    verdict = sound(view_shift=shift).verdict()
    assert (verdict.trusted, verdict.holds) == (0, False)
    expected = "cam02 disagrees with the others by 40 mm at the body; mend it with: mmocap calib refine s.toml"
    assert verdict.lines(Path("s.toml")) == ["0 of 12 frames trusted", expected]
    assert "calib check s.toml" in sound(view_shift=shift * 5).verdict().lines(Path("s.toml"))[1]


def test_two_that_may_be_the_wrong_one_are_both_named():
    verdict = sound(view_shift=np.tile([0.011, 0.018, 0.004, 0.02], (1, FRAMES, 1))).verdict()
    assert list(verdict.cameras) == ["cam04", "cam02"]
    assert "cam04 and cam02 disagree with the others by 20 and 18 mm" in verdict.lines()[1]


def test_parts_in_doubt_are_named_with_their_frames():
    doubt, arm = np.zeros((1, FRAMES, PARTS)), SKELETON.parts.index("left arm")
    doubt[0, [2, 3, 4, 8], arm] = 1
    sigma = np.full((1, FRAMES, len(SKELETON.joints), 3), 0.01)
    sigma[0, 9, SKELETON.index("RAnkle")] = 0.1  # nothing contradicts it, and it may be anywhere
    verdict = sound(part_doubt=doubt, joint_sigma=sigma).verdict()
    assert (verdict.trusted, verdict.holds) == (8, True)
    assert verdict.parts == {"left arm": [12, 13, 14, 18], "right leg": [19]}
    assert "in doubt: left arm in frames 12 to 14, 18 (4 in all)" in verdict.lines()


def test_what_was_trusted_against_the_first_look_is_not_trusted():
    verdict = sound(config={"trusted_cameras": "cam02: pictures are mirrored"}).verdict()
    assert not verdict.holds
    assert verdict.lines(Path("s"))[1] == "masks and calibration fit no body: cam02: pictures are mirrored"


def test_frames_that_repeat_do_not_count():
    status = np.zeros((1, FRAMES), np.int8)
    status[0, 1::2] = STATUS.index("repeated")
    verdict = sound(status=status, config={"frozen_views": {"cam03": [4, 12, 13]}}).verdict()
    assert (verdict.frames, verdict.trusted, verdict.repeated, verdict.holds) == (6, 6, 6, True)
    assert verdict.lines()[1:] == [
        "6 more frames repeat the one before, and count as not seen",
        "cam03 is frozen in frames 12 to 13 (2 in all), and left out there",
    ]
