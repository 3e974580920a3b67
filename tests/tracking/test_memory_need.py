"""What does not fit into memory is refused before it is tried, and what fits is told."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
import warp as wp
from synthetic import synthetic_subject
from tracked_motion import FPS, RIG, motion

from mmocap_warp.device import free_memory
from mmocap_warp.errors import InputError
from mmocap_warp.tracking import memory_need
from mmocap_warp.tracking.algorithms import ALGORITHMS
from mmocap_warp.tracking.config import TrackConfig
from mmocap_warp.tracking.memory_need import array_bytes, check_fits, measure_need
from mmocap_warp.tracking.track import track_observations
from mmocap_warp.tracking.tracker import Tracker

MB = 10**6


def build(config: TrackConfig) -> Tracker:
    return Tracker(synthetic_subject(), RIG, config, FPS)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
@pytest.mark.parametrize(("runs", "evaluations"), [(1, 3000), (5, 6000), (3, 77)])
def test_the_need_is_what_a_search_holds(algorithm, runs, evaluations):
    config = TrackConfig(algorithm, device="cpu", runs=runs, evaluations=evaluations)
    assert measure_need(build, config).of(runs, evaluations) == array_bytes(build(config))


@pytest.mark.skipif(not wp.is_cuda_available(), reason="needs a GPU, whose memory pool counts")
def test_a_gpu_counts_the_same():
    """But for what it rounds up."""
    before = wp.get_mempool_used_mem_current("cuda:0")
    tracker = build(TrackConfig(device="cuda:0", runs=50))
    taken = wp.get_mempool_used_mem_current("cuda:0") - before
    assert array_bytes(tracker) == pytest.approx(taken, rel=0.05)


def test_an_array_is_counted_once_however_often_it_is_held():
    tracker = build(TrackConfig(device="cpu", runs=2))
    tracker.again, tracker.views = [tracker._draw, {"draw": tracker._draw}], [tracker._search.best_pose[1:]]
    assert array_bytes(tracker) == array_bytes(build(TrackConfig(device="cpu", runs=2)))


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"runs": 10**6}, "runs"),
        ({"runs": 10**6, "algorithm": "psapf"}, "runs"),
        ({"evaluations": 10**9, "algorithm": "apf"}, "evaluations"),
        ({"evaluations": 10**6, "runs": 20, "algorithm": "apf"}, "evaluations"),
    ],
    ids=["runs", "runs of a filter", "budget", "budget of runs"],
)
def test_what_does_not_fit_is_refused_and_what_fits_is_told(settings, told, monkeypatch):
    monkeypatch.setattr(memory_need, "free_memory", lambda device: 200 * MB)
    config = TrackConfig(device="cpu", **settings)
    with pytest.raises(InputError, match=r"^cpu: .* GB of memory, 0\.2 GB are free; the most that fits is") as caught:
        check_fits(build, config, "cpu")
    most = int(re.search(rf"{told} = (\d+)", caught.value.remedy)[1])
    check_fits(build, replace(config, **{told: most}), "cpu")
    with pytest.raises(InputError):
        check_fits(build, replace(config, **{told: most + 1}), "cpu")


def test_both_ways_out_are_told():
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(memory_need, "free_memory", lambda device: 200 * MB)
        with pytest.raises(InputError, match=r"the most that fits is runs = \d+ or evaluations = \d+$"):
            check_fits(build, TrackConfig("apf", device="cpu", runs=10, evaluations=10**4), "cpu")


def test_where_nothing_fits_the_scale_is_too_large(monkeypatch):
    monkeypatch.setattr(memory_need, "free_memory", lambda device: 1000)
    with pytest.raises(InputError, match="choose fewer runs, a smaller budget and a smaller scale"):
        check_fits(build, TrackConfig(device="cpu"), "cpu")


def test_where_nothing_tells_the_memory_nothing_is_refused(monkeypatch):
    monkeypatch.setattr(memory_need, "free_memory", lambda device: None)
    check_fits(build, TrackConfig(device="cpu", runs=10**6), "cpu")


def test_the_free_memory_of_a_device_is_told(device):
    assert 10 * MB < free_memory(device) < 10**14


def test_tracking_refuses_what_does_not_fit():
    _, seen = motion("cpu")
    with pytest.raises(InputError, match=r"the most that fits is runs = \d+$"):
        track_observations(synthetic_subject(), RIG, seen, FPS, TrackConfig(device="cpu", runs=10**8))
