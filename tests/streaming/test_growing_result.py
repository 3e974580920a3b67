"""A result that grows survives a kill: what was appended is there, and what was half-written is left out."""

from __future__ import annotations

from contextlib import closing

import numpy as np
import pytest
from synthetic import ring_rig, synthetic_poses, synthetic_subject

from mmocap_warp.commands.inputs import result_from
from mmocap_warp.errors import InputError
from mmocap_warp.formats.usd.usd_result import read_result
from mmocap_warp.streaming.growing_result import GrowingResult, finish
from mmocap_warp.streaming.senders import Packet
from mmocap_warp.tracking.live_smoothing import LiveFrame
from mmocap_warp.tracking.track_config import TrackConfig

SUBJECT, RIG = synthetic_subject(), ring_rig(2)
POSES = synthetic_poses(4)


def packets() -> list[Packet]:
    iou = np.array([[0.9, np.nan]])
    frames = [
        LiveFrame(number, pose[None], pose[None] + 0.01, np.zeros((1, 1, 4, 4)), iou, ("partial",))
        for number, pose in zip((5, 6, 7, 9), POSES, strict=True)
    ]
    return [Packet(frame, SUBJECT, 0.0, smooth, 0) for frame in frames for smooth in (False, True)]


def grown(path) -> GrowingResult:
    return GrowingResult(path, SUBJECT, RIG, 60.0, TrackConfig(device="cpu"), range(10, 90, 2), {"person": "Anna"})


def check(path, count: int) -> None:
    result = read_result(path)
    assert result.frame_numbers.tolist() == [20, 22, 24, 28][:count]
    np.testing.assert_array_equal(result.pose[0], POSES[:count])
    np.testing.assert_array_equal(result.raw_pose[0], POSES[:count] + 0.01)
    np.testing.assert_array_equal(result.iou[0], [[0.9, np.nan]] * count)
    assert result.fps == 60
    assert result.rate == 30
    assert result.config["person"] == "Anna"
    assert not finish(path)  # there is nothing left to do


def test_what_was_added_is_the_result(tmp_path):
    path = tmp_path / "live.usdc"
    with closing(grown(path)) as result:
        for packet in packets():
            result.send(packet)
    check(path, 4)


def test_after_a_kill_all_whole_frames_are_recovered(tmp_path):
    path = tmp_path / "live.usdc"
    result = grown(path)
    for packet in packets():
        result.send(packet)
    beside = tmp_path / "live.usdc.frames"
    beside.write_bytes(beside.read_bytes()[:-5])  # the process is gone, and its last frame is half-written
    with pytest.raises(InputError, match=r"live\.usdc: is of a live session that goes on or was killed; end it, or"):
        result_from(path)
    assert finish(path)
    check(path, 3)


def test_without_a_frame_nothing_is_left(tmp_path):
    grown(tmp_path / "live.usdc").close()
    assert list(tmp_path.iterdir()) == []


def test_an_older_result_stays_until_there_is_a_frame(tmp_path):
    path = tmp_path / "live.usdc"
    path.write_bytes(b"older")
    grown(path).close()
    assert path.read_bytes() == b"older"
    with closing(grown(path)) as result:
        result.send(packets()[1])
    assert read_result(path).frame_numbers.tolist() == [20]
    assert [each.name for each in tmp_path.iterdir()] == ["live.usdc"]


def test_a_session_that_was_killed_before_a_frame_left_nothing(tmp_path):
    path = tmp_path / "live.usdc"
    path.write_bytes(b"older")
    grown(path)
    assert not finish(path)
    assert path.read_bytes() == b"older"
