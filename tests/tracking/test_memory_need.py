"""What does not fit into memory is refused before it is tried, and what fits is told."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from synthetic import synthetic_subject
from tracked_motion import FPS, RIG, motion

from mmocap_warp.device.resolve import free_memory
from mmocap_warp.errors import InputError
from mmocap_warp.kernels.optimizers.populations import make_space
from mmocap_warp.optimizers.annealed_filter import AnnealedFilter
from mmocap_warp.optimizers.cma_es import CmaEs
from mmocap_warp.optimizers.de import De
from mmocap_warp.optimizers.pso import Pso
from mmocap_warp.silhouettes import RENDERERS
from mmocap_warp.tracking import smoothing
from mmocap_warp.tracking.algorithms import ALGORITHMS
from mmocap_warp.tracking.contour_tracker import ContourTracker
from mmocap_warp.tracking.frame_loop import collect, track_observations
from mmocap_warp.tracking.memory_need import arrays_of, fitting_tracker, memory_need
from mmocap_warp.tracking.pose_search import PoseSearch
from mmocap_warp.tracking.track_config import TrackConfig
from mmocap_warp.tracking.tracker import Tracker

MB = 10**6
FREE_MEMORY = "mmocap_warp.tracking.memory_need.free_memory"


def build(config: TrackConfig) -> Tracker:
    return Tracker(synthetic_subject(), RIG, config, FPS)


def check_fits(config: TrackConfig) -> None:
    fitting_tracker(synthetic_subject(), RIG, config, FPS)


def need(config: TrackConfig) -> int:
    return max(step.of(config.runs) for step in memory_need(synthetic_subject(), RIG, config, FPS))


def array_bytes(owner: object) -> int:
    return sum(array.capacity for array in arrays_of(owner))


@pytest.fixture
def nothing_is_built(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tracker with runs may not be built before it is known to fit."""
    init = Tracker.__init__

    def only_empty(self, subject, rig, config, fps, runs=None):
        if runs == 0:
            init(self, subject, rig, config, fps, runs)

    monkeypatch.setattr(Tracker, "__init__", only_empty)


@pytest.mark.parametrize("renderer", RENDERERS)
@pytest.mark.parametrize("algorithm", ALGORITHMS)
@pytest.mark.parametrize(("runs", "evaluations"), [(1, 3000), (5, 6000), (3, 77), (2, 3001)])
def test_the_need_is_what_a_search_holds(algorithm, runs, evaluations, renderer, device):
    config = TrackConfig(algorithm, device=device, runs=runs, evaluations=evaluations, renderer=renderer)
    assert need(config) == array_bytes(build(config))


@pytest.mark.parametrize(
    "settings",
    [{"algorithm": "search-contour"}, {"algorithm": "contour"}, {"algorithm": "h-de", "polish": True}],
    ids=str,
)
@pytest.mark.parametrize("runs", [1, 3])
def test_the_need_of_contours_is_what_tracking_and_smoothing_hold(settings, runs, device, monkeypatch):
    """But for masks that are larger than those of the subject's first pose."""
    held: list[object] = []
    for part in (smoothing._Masks, smoothing._Judge):
        init = part.__init__
        monkeypatch.setattr(part, "__init__", lambda self, *of, init=init: (held.append(self), init(self, *of))[1])
    _, seen = motion(device)
    fps = len(seen) / smoothing.WINDOW  # so that they are a window
    config = TrackConfig(device=device, runs=runs, **settings)
    tracker = ContourTracker(synthetic_subject(), RIG, config, fps)
    answers = [tracker.step(each) for each in seen]
    smoothing.smoothed(collect(synthetic_subject(), RIG, fps, config, answers), config, seen)
    told = [step.of(runs) for step in memory_need(synthetic_subject(), RIG, config, fps)]
    assert told == pytest.approx([array_bytes(tracker), array_bytes(held)], rel=0.25)


def test_contours_without_a_search_hold_none():
    tracker = ContourTracker(synthetic_subject(), RIG, TrackConfig("contour", device="cpu"), FPS)
    assert tracker.search is None
    assert not [each for each in vars(tracker).values() if isinstance(each, PoseSearch)]


def test_finding_the_need_takes_next_to_nothing():
    empty = Tracker(synthetic_subject(), RIG, TrackConfig("apf", device="cpu", evaluations=10**9), FPS, runs=0)
    assert array_bytes(empty) < MB


@pytest.mark.skipif(not wp.is_cuda_available(), reason="needs a GPU, whose memory pool counts")
def test_a_gpu_counts_the_same():
    """But for what it rounds up."""
    before = wp.get_mempool_used_mem_current("cuda:0")
    tracker = build(TrackConfig("h-cmaes", device="cuda:0", runs=50))
    taken = wp.get_mempool_used_mem_current("cuda:0") - before
    assert array_bytes(tracker) == pytest.approx(taken, rel=0.05)


@pytest.mark.parametrize("optimizer", [CmaEs, De, Pso, AnnealedFilter])
def test_the_arrays_of_structs_are_counted(optimizer):
    seed, counter = (wp.zeros(3, dtype=wp.int32, device="cpu") for _ in range(2))
    made = optimizer(make_space(np.arange(39), np.ones(39), seed, counter), 500)
    arrays = [value for value in vars(made.state).values() if isinstance(value, wp.array)]
    assert len(arrays) >= 9
    assert array_bytes(made) >= sum(array.capacity for array in arrays)


def test_an_array_is_counted_once_however_often_it_is_held():
    tracker = build(TrackConfig("h-cmaes", device="cpu", runs=2))
    tracker.again = [tracker.search.counter, {"counter": tracker.search.counter}]
    assert array_bytes(tracker) == array_bytes(build(TrackConfig("h-cmaes", device="cpu", runs=2)))


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"runs": 10**6}, "runs"),
        ({"runs": 10**6, "algorithm": "psapf"}, "runs"),
        ({"evaluations": 10**9, "algorithm": "apf"}, "evaluations"),
        ({"evaluations": 10**6, "runs": 20, "algorithm": "apf"}, "evaluations"),
        ({"runs": 10**6, "algorithm": "search-contour"}, "runs"),
    ],
    ids=["runs", "runs of a filter", "budget", "budget of runs", "runs of contours"],
)
def test_what_does_not_fit_is_refused_and_what_fits_is_told(settings, told, monkeypatch, nothing_is_built):
    monkeypatch.setattr(FREE_MEMORY, lambda device: 200 * MB)
    config = TrackConfig(**({"algorithm": "h-cmaes", "device": "cpu"} | settings))
    with pytest.raises(InputError, match=r"^cpu: .* GB of memory, 0\.2 GB are free; the most that fits is") as caught:
        check_fits(config)
    most = int(re.search(rf"{told} = (\d+)", caught.value.remedy)[1])
    check_fits(replace(config, **{told: most}))
    with pytest.raises(InputError):
        check_fits(replace(config, **{told: most + 1}))


def test_both_ways_out_are_told():
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(FREE_MEMORY, lambda device: 200 * MB)
        with pytest.raises(InputError, match=r"the most that fits is runs = \d+ or evaluations = \d+$"):
            check_fits(TrackConfig("apf", device="cpu", runs=10, evaluations=10**4))


def test_where_nothing_fits_the_scale_is_too_large(monkeypatch):
    monkeypatch.setattr(FREE_MEMORY, lambda device: 1000)
    with pytest.raises(InputError, match="choose fewer runs, a smaller budget and a smaller scale"):
        check_fits(TrackConfig("h-cmaes", device="cpu"))


def test_where_nothing_tells_the_memory_nothing_is_refused(monkeypatch, nothing_is_built):
    monkeypatch.setattr(FREE_MEMORY, lambda device: None)
    check_fits(TrackConfig("h-cmaes", device="cpu", runs=10**6))


def test_the_free_memory_of_a_device_is_told(device):
    assert 10 * MB < free_memory(device) < 10**14


def test_tracking_refuses_what_does_not_fit():
    _, seen = motion("cpu")
    with pytest.raises(InputError, match=r"the most that fits is runs = \d+$"):
        track_observations(synthetic_subject(), RIG, seen, FPS, TrackConfig("h-cmaes", device="cpu", runs=10**8))


@pytest.mark.parametrize(
    ("settings", "user"),
    [
        ({"algorithm": "contour"}, "contour"),
        ({"algorithm": "h-de", "polish": True}, "polish"),
        ({"algorithm": "h-de", "smooth": 10.8}, "smooth"),
    ],
)
def test_an_open_mesh_is_refused_before_any_frame_is_tracked(settings, user):
    subject = synthetic_subject()
    subject = replace(subject, body=replace(subject.body, tracking_face=subject.body.tracking_face[1:]))
    _, seen = motion("cpu")
    tracked: list[int] = []
    config = TrackConfig(device="cpu", evaluations=50, **settings)
    with pytest.raises(InputError, match=f"^{subject.body.name}: .* not closed, which {user} needs; close the mesh"):
        track_observations(subject, RIG, seen[:2], FPS, config, progress=lambda frame, answer: tracked.append(frame))
    assert not tracked
    track_observations(subject, RIG, seen[:2], FPS, TrackConfig("h-de", device="cpu", evaluations=50))
