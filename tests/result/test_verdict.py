"""What a result says of itself in words."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from synthetic import SKELETON, synthetic_result

from mmocap_warp.result.result import STATUS
from mmocap_warp.result.verdict import verdict

FRAMES, CAMERAS = 12, 4


def judged(**changes):
    """The verdict on a result that nothing speaks against but these changes; its frames are 10 to 21."""
    result = synthetic_result(FRAMES, runs=1, cameras=CAMERAS)
    whole = {"view_shift": np.full((1, FRAMES, CAMERAS), 0.004), "iou": np.full((1, FRAMES, CAMERAS), 0.4)}
    return verdict(replace(result, **whole | {"status": np.zeros((1, FRAMES), np.int8)} | changes), Path("s.toml"))


def statuses(name, frames):
    """(run, frame) of which some have a status."""
    status = np.zeros((1, FRAMES), np.int8)
    status[0, frames] = STATUS.index(name)
    return status


def far(*frames):
    """Joints' deviations with an elbow that may be anywhere in some frames."""
    sigma = np.full((1, FRAMES, len(SKELETON.joints), 3), 0.01)
    sigma[0, frames, SKELETON.index("LElbow")] = 0.1
    return sigma


def test_a_sound_result_is_trusted_whatever_its_overlap():
    told = judged()
    assert (told["trusted"], told["frames"], told["holds"]) == (12, 12, True)
    assert told["lines"] == ["12 of 12 frames trusted"]
    assert told["next"] is None
    assert judged(view_shift=None)["trusted"] == FRAMES  # as in results of earlier versions


@pytest.mark.parametrize(("name", "trusted"), [("lost", 5), ("interpolated", 5), ("partial", 12), ("rescued", 12)])
def test_frames_without_a_pose_of_their_own_are_not_trusted(name, trusted):
    told = judged(status=statuses(name, slice(5, None)))
    assert (told["trusted"], told["holds"]) == (trusted, trusted > 5)
    assert told["next"] == (None if told["holds"] else "mmocap calib check s.toml")


def test_a_fit_that_left_two_ways_open_is_not_trusted():
    subject = synthetic_result(FRAMES, runs=1, cameras=CAMERAS).subject
    for decided, trusted in (("yes", FRAMES), ("no", 0)):
        fitted = {"fit.decided": decided, "fit.alternative": "turned"}
        told = judged(subject=replace(subject, provenance=fitted))
        assert (told["trusted"], told["holds"]) == (trusted, bool(trusted))
    assert told["lines"][1] == (
        "the body may be turned round: that explains the first seconds as well; look at the overlay"
    )


@pytest.mark.parametrize(("departure", "unlike"), [(3.0, False), (4.0, True)])
def test_a_body_unlike_its_kind_is_named(departure, unlike):
    subject = synthetic_result(FRAMES, runs=1, cameras=CAMERAS).subject
    told = judged(subject=replace(subject, provenance={"fit.departure": departure}))
    assert (told["unlike"], told["trusted"]) == (unlike, FRAMES)
    assert any("unlike its kind" in line for line in told["lines"]) == unlike


def test_one_view_is_not_enough():
    iou = np.full((1, FRAMES, CAMERAS), 0.9)
    iou[0, :2, 1:] = np.nan
    assert judged(iou=iou)["trusted"] == FRAMES - 2


def test_a_camera_that_disagrees_is_named_with_what_to_do():
    shift = np.tile([0.006, 0.04, 0.005, np.nan], (1, FRAMES, 1))
    shift[0, :3, 0] = 0.2  # for a moment another one is far off
    shift[0, 6:, 1] = np.nan  # it sees somebody now and then
    told = judged(view_shift=shift)
    assert (told["trusted"], told["holds"], list(told["cameras"])) == (0, False, ["cam02"])
    assert told["lines"] == [
        "0 of 12 frames trusted",
        "cameras that disagree with the others: cam02 by 40 mm at the body",
    ]
    assert told["next"] == "mmocap calib refine s.toml -o calibration-refined.toml"


def test_a_camera_is_named_that_puts_the_whole_body_in_doubt():
    shift = np.tile([0.02, 0.009, 0.026, 0.003], (1, FRAMES, 1))
    doubtful = {"joint_sigma": np.full((1, FRAMES, len(SKELETON.joints), 3), 0.1), "view_shift": shift}
    told = judged(**doubtful)
    assert (told["trusted"], list(told["cameras"])) == (0, ["cam03", "cam01"])
    assert told["next"] == "mmocap calib refine s.toml -o calibration-refined.toml"
    assert judged(**doubtful, status=statuses("lost", slice(None)))["cameras"] == {}


def test_two_that_may_be_the_wrong_one_are_both_named():
    told = judged(view_shift=np.tile([0.011, 0.018, 0.004, 0.02], (1, FRAMES, 1)))
    assert "disagree with the others: cam04 by 20 mm, cam02 by 18 mm" in told["lines"][1]
    assert told["trusted"] == FRAMES  # so little does not spoil a result


def test_three_views_must_agree_better_than_four():
    """The body gives way to a camera that is far off."""
    result = synthetic_result(FRAMES, runs=1, cameras=3)
    shift = np.tile([0.011, 0.013, 0.018], (1, FRAMES, 1))
    told = verdict(replace(result, view_shift=shift, iou=np.full(shift.shape, 0.8)))
    assert (told["trusted"], list(told["cameras"])) == (0, ["cam03", "cam02", "cam01"])


@pytest.mark.parametrize(("third", "trusted"), [(0.014, FRAMES), (0.016, 0)])
def test_a_body_that_most_cameras_disagree_with_is_not_trusted(third: float, trusted: int):
    """Each is less than a wrong camera is off, but the body lies between all of them: with half it holds."""
    told = judged(view_shift=np.tile([0.024, 0.023, third, 0.007], (1, FRAMES, 1)))
    assert (told["trusted"], len(told["cameras"])) == (trusted, 2 if trusted else 3)
    unseen = judged(view_shift=np.tile([0.024, 0.023, third, np.nan], (1, FRAMES, 1)))
    assert unseen["trusted"] == 0  # a camera that sees nobody holds nothing


MOVED = np.tile([0.006, 0.005, 0.005, 0.006], (1, FRAMES, 1))
"""A view lies beside the body from the eighth frame on; at 4 frames a second that is more than a second."""
MOVED[0, 7:, 1] = 0.04


def test_a_camera_that_was_moved_is_named_from_that_frame_on():
    told = judged(view_shift=MOVED, fps=4.0)
    assert (told["trusted"], told["cameras"], told["moved"]) == (7, {}, {"cam02": [17, 18, 19, 20, 21]})
    assert told["lines"] == [
        "7 of 12 frames trusted",
        "cam02 lies beside the body in frames 17 to 21 (5 in all): was it moved, or did it drop frames?",
    ]
    assert told["next"] == "mmocap calib refine s.toml -o calibration-refined.toml --frames 17:22"
    assert judged(view_shift=None)["moved"] == {}


def test_a_moved_camera_that_was_left_out_spoils_nothing():
    shift = np.where(MOVED > 0.03, np.nan, MOVED)
    told = judged(view_shift=shift, fps=4.0, config={"moved_views": {"cam01": [8], "cam02": [9, *range(17, 30)]}})
    assert (told["trusted"], told["next"]) == (FRAMES, None)
    assert "cam02 lies beside the body in frames 17 to 21 (5 in all), and is left out there" in told["lines"][1]


@pytest.mark.parametrize(
    "beside",
    [
        lambda shift: shift[0, :, 1:3].__setitem__(slice(7, None), 0.04),  # as many as agree: the pose is wrong
        lambda shift: shift[0, :, 1].__setitem__(slice(None), 0.011 + 0.01 * (np.arange(FRAMES) > 6)),  # never fitted
        lambda shift: shift[0, 7:, 1].__setitem__(slice(1, 3), 0.005),  # for a moment
        lambda shift: shift[0, :, 1].__setitem__(slice(None), np.nan),  # shows nobody
    ],
)
def test_what_is_no_moved_camera(beside):
    shift = MOVED.copy()
    shift[0, 9:, 1] = 0.005
    beside(shift)
    assert judged(view_shift=shift, fps=4.0)["moved"] == {}


def test_parts_in_doubt_are_named_with_their_frames():
    told = judged(joint_sigma=far(2, 3, 4, 8), status=statuses("partial", [3, 9]))
    assert told["parts"] == {SKELETON.parts[SKELETON.part[SKELETON.index("LElbow")]]: [12, 13, 14, 18]}
    assert "in doubt: left arm in frames 12 to 14, 18 (4 in all)" in told["lines"]
    assert told["trusted"] == FRAMES - 1  # a partial frame is trusted if all that it lacks is a view


def test_a_single_frame_is_one():
    assert "in doubt: left arm in frame 13" in judged(joint_sigma=far(3), status=statuses("partial", [3]))["lines"]


def test_frames_are_ranges_with_any_stride_and_parts_of_the_same_ranges_are_one_line():
    sigma = far(2, 3, 4, 8)
    sigma[..., SKELETON.index("RElbow"), :] = sigma[..., SKELETON.index("LElbow"), :]
    result = synthetic_result(FRAMES, runs=1)
    told = verdict(replace(result, joint_sigma=sigma, frame_numbers=3 * result.frame_numbers))
    assert "in doubt: left arm, right arm in frames 36 to 42, 54 (4 in all)" in told["lines"]


def test_a_frame_with_most_of_the_body_in_doubt_is_not_trusted_whatever_its_status():
    sigma = far()
    sigma[0, :4] = 0.1
    told = judged(joint_sigma=sigma)
    assert len(told["parts"]) == len(SKELETON.parts)
    assert told["trusted"] == FRAMES - 4


def test_what_was_trusted_against_the_first_look_is_not_trusted():
    told = judged(config={"trusted_cameras": "cam02: pictures are mirrored"}, joint_sigma=far(1))
    assert not told["holds"]
    assert told["lines"][1:] == ["masks and calibration fit no body: cam02: pictures are mirrored"]


def test_frames_that_repeat_do_not_count():
    told = judged(
        status=statuses("repeated", slice(1, None, 2)), config={"frozen_views": {"cam03": [4, 12, 13], "cam01": [5]}}
    )
    assert (told["frames"], told["trusted"], told["repeated"], told["holds"]) == (6, 6, 6, True)
    assert told["lines"][1:] == [
        "6 more frames repeat the one before, and count as not seen",
        "cam03 is frozen in frames 12 to 13 (2 in all), and left out there",
    ]


def test_a_view_lies_beside_nobody_where_it_shows_nobody():
    shift = MOVED.copy()
    shift[0, 10, 1] = np.nan
    assert judged(view_shift=shift, fps=4.0)["moved"] == {"cam02": [17, 18, 19, 21]}
