"""How soon the program works: what is imported, and what is compiled on a machine that has no kernels yet.

Times are of the processor, so that a busy machine does not spoil them.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

IMPORT_SECONDS = 1.0
FIRST_SECONDS, LATER_SECONDS = 60.0, 5.0
TESTS = Path(__file__).parents[1]

TRACK = f"""
import sys, time
sys.path.insert(0, {str(TESTS)!r})
import warp as wp
wp.config.log_level = wp.LOG_WARNING
import numpy as np
from synthetic import synthetic_subject
from tracked_motion import FPS, RIG
from mmocap_warp.views.observation import Observation
from mmocap_warp.tracking.tracker import TrackConfig, track_observations

seen = Observation.from_masks([np.eye(120, 160, dtype=bool)] * len(RIG))
track_observations(synthetic_subject(), RIG, [seen] * 2, FPS, TrackConfig(evaluations=20, device="cpu", threads=2))
print(time.process_time())
"""
"""Tracks two frames in a process of its own and prints what it took, imports included [s]."""


def seconds_of(code: str, **environment: str) -> float:
    """What a Python program prints."""
    answer = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=os.environ | environment, check=True
    )
    return float(answer.stdout)


def test_the_tracker_is_imported_within_a_second():
    assert seconds_of("import time, mmocap_warp.tracking.tracker; print(time.process_time())") < IMPORT_SECONDS


def test_the_package_alone_imports_nothing_heavy():
    heavy = "{'warp', 'pxr', 'cv2', 'numpy'} & set(sys.modules)"
    assert seconds_of(f"import sys, mmocap_warp; print(len({heavy}))") == 0


@pytest.fixture(scope="module")
def cache(tmp_path_factory) -> tuple[Path, float]:
    """A kernel cache that one run with CMA-ES has filled, and what that run took [s]."""
    folder = tmp_path_factory.mktemp("cache")
    return folder, seconds_of(TRACK, WARP_CACHE_PATH=str(folder))


def test_a_first_run_compiles_only_the_kernels_it_uses(cache):
    folder, seconds = cache
    modules = {path.name.split(".")[-1].rsplit("_", 1)[0] for path in folder.glob("**/wp_mmocap_warp*")}
    assert "cma_es" in modules
    assert not {"de", "pso", "annealed_filter"} & modules
    assert seconds < FIRST_SECONDS


def test_a_later_start_compiles_nothing(cache):
    folder, _ = cache
    before = sorted(folder.rglob("*"))
    assert seconds_of(TRACK, WARP_CACHE_PATH=str(folder)) < LATER_SECONDS
    assert sorted(folder.rglob("*")) == before
