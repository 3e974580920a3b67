"""Memory does not grow with a recording's length, but for the answers themselves.

What NumPy and Python hold is counted exactly; what Warp and USD hold shows only in the process, and only roughly.
"""

from __future__ import annotations

import ctypes
import gc
import itertools
import tracemalloc
import weakref
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from synthetic import ring_rig, synthetic_result, synthetic_subject
from tracked_motion import FPS, RIG, motion

from mmocap_warp.body.model import Subject
from mmocap_warp.display.result_video import show
from mmocap_warp.formats.usd.usd_body import read_body
from mmocap_warp.formats.usd.usd_result import export_animation, read_result, write_result
from mmocap_warp.masks.observation import Observation
from mmocap_warp.result.evaluation import evaluate
from mmocap_warp.result.result import Result
from mmocap_warp.result.truth import Truth
from mmocap_warp.scene.frame_choice import _FRAMES_AHEAD
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.scenes import ROOT
from mmocap_warp.tracking.frame_loop import track_observations
from mmocap_warp.tracking.track_config import TrackConfig

KB = 1024
SKIN = 160 * KB  # one frame's posed skin of a shipped body
STATUS = Path("/proc/self/status")
FORGET_PEAK = Path("/proc/self/clear_refs")
MMAP_THRESHOLD = -3  # number of the setting in glibc's malloc.h: what is larger is given back at once


def peak_growth(work: Callable[[], object]) -> int:
    """Bytes by which this process grew at its peak while ``work`` ran."""
    if not FORGET_PEAK.exists():
        pytest.skip("only Linux tells the peak of a process's memory")

    def resident(field: str) -> int:
        return int(next(line for line in STATUS.read_text().splitlines() if line.startswith(field)).split()[1]) * KB

    # Else glibc keeps skins that were freed in its heap, where what is small may lie between them: not memory in use.
    ctypes.CDLL(None).mallopt(MMAP_THRESHOLD, SKIN // 2)
    FORGET_PEAK.write_text("5")
    before = resident("VmRSS")
    work()
    return resident("VmHWM") - before


def long_result(frames: int) -> Result:
    """A made-up result of a body with as many vertices as real ones have."""
    body, start = read_body(ROOT / "bodies" / "adult_man.usdc"), synthetic_subject()
    subject = Subject(body, start.root_base, start.pose, {})
    return replace(synthetic_result(frames, runs=1), subject=subject, cameras=ring_rig(3, size=(64, 48)))


def truth_of(result: Result) -> Truth:
    """Markers somewhere near the body."""
    names = tuple("ABCDE")
    near = result.pose[0, :, None, :3] + np.random.default_rng(0).normal(0, 0.3, (len(names), 3))
    return Truth(result.fps, result.frame_numbers, names, near, ("LKnee", "RKnee"), near[:, :2])


@pytest.mark.parametrize(
    "work",
    [
        lambda result, folder: write_result(folder / "result.usdc", result),
        lambda result, folder: export_animation(result, folder / "animation.usdz"),
        lambda result, folder: show(result, None, None, sheet=folder / "sheet.png"),
        lambda result, folder: evaluate(result, truth_of(result)),
    ],
    ids=["result", "export", "show", "eval"],
)
def test_no_more_than_a_few_frames_are_posed_at_once(work, tmp_path):
    """Eighty times the frames of a first call, which warms up, take a fraction of what their skins would."""
    work(long_result(20), tmp_path)
    # The first long call grows the process by some 30 MB, however many its frames are.
    frames = 1600
    result = long_result(frames)
    assert peak_growth(lambda: work(result, tmp_path)) < frames * SKIN / 4


def test_reading_a_result_takes_about_what_it_holds(tmp_path):
    path, frames = tmp_path / "result.usdc", 400
    write_result(path, long_result(frames))
    read_result(path)
    assert peak_growth(lambda: read_result(path)) < frames * 20 * KB


def held() -> int:
    """Bytes that Python and NumPy hold now."""
    gc.collect()
    return tracemalloc.get_traced_memory()[0]


@pytest.fixture
def traced() -> Iterator[None]:
    tracemalloc.start()
    yield
    tracemalloc.stop()


def test_tracking_keeps_a_frame_s_answer_and_not_its_masks(traced):
    sizes, alive = {}, deque(maxlen=10)
    _, seen = motion("cpu")

    def stream(frames: int) -> Iterator[Observation]:
        for one in itertools.islice(itertools.cycle(seen), frames):
            observation = replace(one)
            alive.append(weakref.ref(observation))
            assert sum(reference() is not None for reference in alive) <= 2
            yield observation

    def progress(number: int, _: object) -> None:
        if number in (99, 299):
            sizes[number] = held()

    config = TrackConfig("h-cmaes", evaluations=1, device="cpu")
    track_observations(synthetic_subject(), RIG, stream(300), FPS, config, progress)
    assert (sizes[299] - sizes[99]) / 200 < 1.5 * KB


def test_a_scene_s_masks_are_read_a_few_frames_ahead(traced):
    """At any time those of the frames ahead and of two others at most."""
    masks = 5 * 640 * 480
    sizes = [held() for _ in itertools.islice(load_scene(ROOT / "walk").observations(), 20)]
    assert max(sizes) - min(sizes[1:]) < (_FRAMES_AHEAD + 2) * masks
