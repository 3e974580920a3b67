"""What is imported, and which kernels a run loads; docs/performance.md has the times."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]

TRACK = f"""
import sys
sys.path[:0] = [{str(TESTS)!r}, {str(TESTS.parent / "instruments")!r}]
import numpy as np
from synthetic import synthetic_subject
from tracked_motion import FPS, RIG
from mmocap_warp.masks.observation import Observation
from mmocap_warp.tracking.track_config import TrackConfig
from mmocap_warp.tracking.frame_loop import track_observations

seen = Observation.from_masks([np.eye(120, 160, dtype=bool)] * len(RIG))
settings = TrackConfig("h-cmaes", evaluations=20, renderer="raster", device="cpu", threads=2)
track_observations(synthetic_subject(), RIG, [seen] * 2, FPS, settings)
"""
"""Tracks two frames in a process of its own."""


def run(code: str, **environment: str) -> str:
    """What a Python program prints."""
    answer = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=os.environ | environment, check=True
    )
    return answer.stdout.strip()


@pytest.mark.parametrize(
    ("module", "absent"),
    [
        ("mmocap_warp", {"warp", "pxr", "cv2", "numpy", "scipy", "ray", "trimesh", "rich", "cyclopts"}),
        ("mmocap_warp.cli", {"warp", "pxr", "cv2", "numpy", "scipy", "ray", "trimesh"}),
        ("mmocap_warp.cli.result_commands", {"warp", "pxr", "cv2", "numpy", "scipy", "ray", "trimesh"}),
        ("mmocap_warp.tracking.frame_loop", {"scipy", "ray", "trimesh", "rich", "cyclopts"}),
    ],
)
def test_what_is_heavy_is_imported_where_it_is_used(module, absent):
    assert run(f"import sys, {module}; print({absent} & set(sys.modules))") == "set()"


def test_the_package_alone_imports_nothing_but_itself():
    """Python's own modules apart: that takes a few milliseconds."""
    imported = "{name for name in set(sys.modules) - before if name.split('.')[0] not in sys.stdlib_module_names}"
    program = f"import sys; before = set(sys.modules); import mmocap_warp as mm; dir(mm); print(sorted({imported}))"
    assert run(program) == str(["mmocap_warp", "mmocap_warp.version"])


@pytest.mark.parametrize(
    ("name", "heavy"),
    [("load_scene", "warp"), ("load_scene", "pxr"), ("load_body", "cv2"), ("Result", "warp"), ("minimize", "pxr")],
)
def test_a_public_name_imports_only_what_it_needs(name, heavy):
    assert run(f"import sys, mmocap_warp as mm; mm.{name}; print({heavy!r} in sys.modules)") == "False"


def loaded_modules() -> dict[str, bool]:
    """The kernel modules that the run loads, as Warp's log has them, and whether they lay in the cache."""
    lines = re.findall(r"^Module mmocap_warp\.kernels\.(\S+) \w+ load on device 'cpu' (.*)$", run(TRACK), re.M)
    return {name: "(cached)" in line for name, line in lines}


@pytest.fixture(scope="module")
def first() -> dict[str, bool]:
    """What a run with CMA-ES loads; afterwards all of it lies in this machine's cache."""
    return loaded_modules()


def test_a_run_loads_only_the_kernels_it_uses(first):
    """What is not loaded is not compiled either, where the cache is empty."""
    assert "optimizers.cma_es" in first
    assert not {"optimizers.de", "optimizers.pso", "optimizers.annealed_filter"} & first.keys()


def test_a_later_start_compiles_nothing(first):
    later = loaded_modules()
    assert later.keys() == first.keys()
    assert all(later.values())


@pytest.mark.parametrize(("given", "held"), [({}, "1"), ({"OPENBLAS_NUM_THREADS": "2"}, "2")])
def test_numpy_multiplies_with_one_thread(given, held, monkeypatch):
    """Unless somebody wants otherwise: its bits would depend on the machine's cores."""
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    code = (
        "import os, sys\n"
        "from mmocap_warp import cli\n"
        "assert 'numpy' not in sys.modules\n"
        "cli.main(['--version'])\n"
        "print(os.environ['OPENBLAS_NUM_THREADS'])"
    )
    assert run(code, **given).splitlines()[-1] == held
