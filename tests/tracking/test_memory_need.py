"""What would clearly not fit into memory is refused before it is tried, and what fits is told."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest
import warp as wp
from synthetic import synthetic_subject
from tracked_motion import FPS, RIG, motion

from mmocap_warp.contour.clip.clip_problem import WINDOW
from mmocap_warp.device.resolve import free_memory
from mmocap_warp.errors import InputError
from mmocap_warp.silhouettes import RENDERERS
from mmocap_warp.tracking import smoothing
from mmocap_warp.tracking.algorithms import ALGORITHMS
from mmocap_warp.tracking.contour_tracker import ContourTracker
from mmocap_warp.tracking.frame_loop import collect, track_observations
from mmocap_warp.tracking.make_tracker import make_tracker, memory_need
from mmocap_warp.tracking.pose_search import PoseSearch
from mmocap_warp.tracking.track_config import TrackConfig
from mmocap_warp.tracking.tracker import Tracker

MB = 10**6
FREE_MEMORY = "mmocap_warp.tracking.make_tracker.free_memory"
NEAR = 0.35
"""How far the estimate may be off, as a share of what is held."""


def build(config: TrackConfig) -> Tracker:
    return Tracker(synthetic_subject(), RIG, config, FPS)


def check_fits(config: TrackConfig) -> None:
    make_tracker(synthetic_subject(), RIG, config, FPS)


def need(config: TrackConfig, fps: float = FPS) -> float:
    return memory_need(synthetic_subject(), RIG, config, fps)


def arrays_of(owner: object) -> Iterator[wp.array[Any]]:
    """The Warp arrays that an object of this project holds, in itself and in its parts, each once."""
    seen: set[int] = set()
    unseen = [owner]
    while unseen:
        thing = unseen.pop()
        if id(thing) in seen:
            continue
        seen.add(id(thing))
        is_struct = hasattr(thing, "__ctype__")
        if isinstance(thing, wp.array):
            yield thing
        elif isinstance(thing, dict):
            unseen += thing.values()
        elif isinstance(thing, list | tuple):
            unseen += thing
        elif is_struct or any(base.__module__.startswith("mmocap_warp") for base in type(thing).mro()):
            unseen += vars(thing).values() if hasattr(thing, "__dict__") else ()


def array_bytes(owner: object) -> int:
    return sum(array.capacity for array in arrays_of(owner))


@pytest.fixture
def nothing_is_built(monkeypatch: pytest.MonkeyPatch) -> None:
    """No search is made, so that what takes too much can be asked for."""
    monkeypatch.setattr(PoseSearch, "__init__", lambda self, *_: setattr(self, "device", "cpu"))
    monkeypatch.setattr(Tracker, "__init__", lambda self, *_: None)
    monkeypatch.setattr(ContourTracker, "__init__", lambda self, *_: None)


@pytest.mark.parametrize("renderer", RENDERERS)
@pytest.mark.parametrize("algorithm", ALGORITHMS)
@pytest.mark.parametrize(("runs", "evaluations"), [(1, 3000), (5, 6000), (3, 77), (2, 3001)])
def test_the_estimate_is_near_what_a_search_holds(algorithm, runs, evaluations, renderer, device):
    config = TrackConfig(algorithm, device=device, runs=runs, evaluations=evaluations, renderer=renderer)
    assert need(config) == pytest.approx(array_bytes(build(config)), rel=NEAR)


@pytest.mark.parametrize(
    ("settings", "runs"),
    [
        ({"algorithm": "search-contour"}, 3),
        ({"algorithm": "contour"}, 1),
        ({"algorithm": "h-de", "polish": True}, 1),
        pytest.param({"algorithm": "search-contour"}, 1, marks=pytest.mark.nightly),
        pytest.param({"algorithm": "contour"}, 3, marks=pytest.mark.nightly),
        pytest.param({"algorithm": "h-de", "polish": True}, 3, marks=pytest.mark.nightly),
    ],
    ids=str,
)
def test_the_estimate_is_near_what_contours_hold_when_they_track_and_smooth(settings, runs, device, monkeypatch):
    held: list[object] = []
    init = smoothing._MaskWindow.__init__
    monkeypatch.setattr(smoothing._MaskWindow, "__init__", lambda self, *of: (held.append(self), init(self, *of))[1])
    seen = motion(device)[1][:8]
    fps = len(seen) / WINDOW  # so that they are a window
    config = TrackConfig(device=device, runs=runs, **settings)
    tracker = ContourTracker(synthetic_subject(), RIG, config, fps)
    answers = [tracker.step(each) for each in seen]
    smoothing.smoothed(collect(synthetic_subject(), RIG, fps, config, answers), config, seen)
    assert need(config, fps) == pytest.approx(array_bytes(tracker) + array_bytes(held), rel=NEAR)


def test_contours_without_a_search_hold_none():
    tracker = ContourTracker(synthetic_subject(), RIG, TrackConfig("contour", device="cpu"), FPS)
    assert tracker.search is None
    assert not [each for each in vars(tracker).values() if isinstance(each, PoseSearch)]


@pytest.mark.skipif(not wp.is_cuda_available(), reason="needs a GPU, whose memory pool counts")
def test_a_gpu_counts_the_same():
    """But for what it rounds up."""
    before = wp.get_mempool_used_mem_current("cuda:0")
    tracker = build(TrackConfig("h-cmaes", device="cuda:0", runs=50))
    taken = wp.get_mempool_used_mem_current("cuda:0") - before
    assert array_bytes(tracker) == pytest.approx(taken, rel=0.05)


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


def test_an_open_mesh_is_refused_before_any_frame_is_tracked():
    subject = synthetic_subject()
    subject = replace(subject, body=replace(subject.body, tracking_face=subject.body.tracking_face[1:]))
    _, seen = motion("cpu")
    tracked: list[int] = []
    config = TrackConfig("h-de", device="cpu", evaluations=50)
    with pytest.raises(InputError, match=f"^{subject.body.name}: its tracking mesh is not closed; close the mesh"):
        track_observations(subject, RIG, seen[:2], FPS, config, progress=lambda frame, answer: tracked.append(frame))
    assert not tracked
