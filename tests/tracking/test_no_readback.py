"""Between a frame's observation and its answer, nothing waits for the host or passes through it."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from synthetic import synthetic_subject
from tracked_motion import FPS, RIG, motion, tracker_of

from mmocap_warp.tracking.algorithms import ALGORITHMS
from mmocap_warp.tracking.contour_tracker import ContourTracker
from mmocap_warp.tracking.track_config import TrackConfig

TRANSFERS = ("numpy", "list", "to", "assign", "__array__", "__array_interface__", "__dlpack__", "__str__")
WAITS = ("synchronize", "synchronize_device", "synchronize_event", "synchronize_stream")


def refuse(*_arguments, **_settings):
    raise AssertionError("the host touched the device's data")


@pytest.fixture
def no_readback(monkeypatch):
    """A function after which reading an array, writing one from the host, or waiting for the device is an error."""

    def forbid():
        for name in TRANSFERS:
            monkeypatch.setattr(wp.array, name, property(refuse) if name == "__array_interface__" else refuse)
        for name in WAITS:
            monkeypatch.setattr(wp, name, refuse)

    return forbid


def test_reading_back_is_noticed(device, no_readback):
    array = wp.zeros(3, dtype=wp.float32, device=device)
    no_readback()
    readings = [array.numpy, array.list, lambda: np.asarray(array), lambda: array.to("cpu"), lambda: print(array)]
    for reading in [*readings, lambda: array.assign([1.0, 2.0, 3.0]), wp.synchronize, wp.synchronize_device]:
        with pytest.raises(AssertionError, match="the host touched"):
            reading()


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_a_frames_search_reads_nothing_back(device, no_readback, monkeypatch, algorithm):
    tracker, calls = tracker_of(algorithm, device, runs=2)
    _truth, seen = motion(device)
    tracker.step(seen[0])
    tracker.search.objective.observe(seen[-1])
    before = tracker.state.pose
    calls.clear()
    no_readback()
    tracker.search._run()
    monkeypatch.undo()
    assert 450 <= sum(calls) / 2 <= 500
    assert not np.array_equal(tracker.state.pose, before)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_a_captured_frame_replays_to_the_same_bits(device, algorithm):
    """Capturing fails at the first thing that waits for the host. The third frame is a replay of the second's graph."""
    if device == "cpu":
        pytest.skip("graphs are captured on CUDA devices only")
    replayed, launched = (tracker_of(algorithm, device, runs=2)[0] for _ in range(2))
    launched.search._replays = False
    _truth, seen = motion(device)
    for frame, observation in enumerate(seen[:4]):
        again, once = replayed.step(observation), launched.step(observation)
        np.testing.assert_array_equal(again.pose, once.pose, err_msg=f"frame {frame}")
        np.testing.assert_array_equal(again.cost, once.cost, err_msg=f"frame {frame}")
    assert None not in replayed.search._replays._graphs.values()


def test_an_ordinary_frame_of_contours_waits_once(device, monkeypatch):
    if device == "cpu":
        pytest.skip("the CPU waits for nothing")
    subject, (_truth, seen) = synthetic_subject(), motion(device)
    tracker = ContourTracker(subject, RIG, TrackConfig("contour", device=device, runs=2), FPS)
    for observation in seen[:3]:
        tracker.step(observation)
    waits = []
    wait, read = wp.synchronize_stream, wp.array.numpy

    def counted_wait(*arguments):
        waits.append("wait")
        return wait(*arguments)

    def counted_read(array):
        if array.device.is_cuda:
            waits.append("read")
        return read(array)

    monkeypatch.setattr(wp, "synchronize_stream", counted_wait)
    monkeypatch.setattr(wp.array, "numpy", counted_read)
    tracker.step(seen[3])
    assert waits == ["wait"]


def test_a_captured_fit_replays_to_the_same_bits(device):
    """Each frame starts where the last one ended, so that a stale start, mask or answer would show."""
    if device == "cpu":
        pytest.skip("graphs are captured on CUDA devices only")
    config = TrackConfig("contour", device=device, runs=2)
    replayed, launched = (ContourTracker(synthetic_subject(), RIG, config, FPS) for _ in range(2))
    for part in (launched, launched._fitter, launched._fitter.fields):
        part._replays.run = lambda _kind, work: work()
    _truth, seen = motion(device)
    for frame, observation in enumerate(seen[:5]):
        again, once = replayed.step(observation), launched.step(observation)
        np.testing.assert_array_equal(again.pose, once.pose, err_msg=f"frame {frame}")
        np.testing.assert_array_equal(again.cost, once.cost, err_msg=f"frame {frame}")
        np.testing.assert_array_equal(again.iou, once.iou, err_msg=f"frame {frame}")
