"""A result's key follows the code that it comes from, however the package is installed."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from tiny_study import tasks_of

from mmocap_warp.study import code_hash as module
from mmocap_warp.study import store, tasks
from mmocap_warp.study.code_hash import code_hash
from mmocap_warp.study.definition import load_study
from mmocap_warp.study.job import Refusal, Worker
from mmocap_warp.study.store import content_key

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def installed(tmp_path_factory) -> Path:
    """The modules as a wheel installs them: kernels are a folder of the package."""
    site = tmp_path_factory.mktemp("site-packages")
    sources = {"mmocap_warp": "mmocap_warp", "kernels": "mmocap_warp/kernels"}
    for folder, target in sources.items():
        for file in (ROOT / folder).rglob("*.py"):
            copied = site / target / file.relative_to(ROOT / folder)
            copied.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(file, copied)
    (site / "mmocap_warp" / "scenes").mkdir(exist_ok=True)
    shutil.copy(ROOT / "scenes" / "__init__.py", site / "mmocap_warp" / "scenes" / "__init__.py")
    return site


def hash_of(site: Path) -> str:
    script = f"import sys; sys.path.insert(0, {str(site)!r}); from mmocap_warp.study import code_hash as c; "
    script += "assert c.__file__.startswith(sys.path[0]); print(c.code_hash())"
    return subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.strip()


def test_it_is_the_same_from_a_wheel(installed):
    assert hash_of(installed) == code_hash()


@pytest.mark.parametrize(
    ("file", "counts"),
    [
        ("kernels/optimizers/pso.py", True),
        ("kernels/body/skinning.py", True),
        ("tracking/tracker.py", True),
        ("study/metrics.py", True),
        ("a_new_room/__init__.py", True),
        ("kernels/benchmarks/timing.py", False),
        ("cli/track.py", False),
        ("study/statistics.py", False),
    ],
)
def test_it_follows_the_modules_that_results_depend_on(file, counts, installed):
    path = installed / "mmocap_warp" / file
    before = path.read_bytes() if path.exists() else None
    path.parent.mkdir(exist_ok=True)
    path.write_bytes((before or b"") + b"# changed\n")
    try:
        assert (hash_of(installed) != code_hash()) == counts
    finally:
        path.unlink() if before is None else path.write_bytes(before)


def test_what_it_names_exists():
    """A module that was renamed must not drop out, nor come in, unnoticed."""
    names = {name for root in module._ROOTS for name, _ in module._modules(root)}
    assert {f"mmocap_warp.study.{name}" for name in module._OF_STUDY} <= names
    names.add("mmocap_warp.scenes.__init__")  # in the package where it is installed from a wheel
    assert {f"mmocap_warp.{name}.__init__" for name in module._LEFT_OUT} <= names


def test_results_of_changed_code_have_files_of_their_own(study, monkeypatch):
    plan = load_study(study).plans[0]
    before = content_key(plan, "clip", "cpu")
    monkeypatch.setattr(store, "code_hash", lambda: "of a tracker that was changed")
    assert content_key(plan, "clip", "cpu") != before


def test_a_worker_with_other_code_refuses(study, tmp_path, monkeypatch):
    monkeypatch.setattr(tasks, "code_hash", lambda: "of the machine that started the study")
    job = tasks_of(study, tmp_path / "results")[0].job
    (told,) = Worker("cpu").work(job)
    assert isinstance(told, Refusal)
    assert "runs other code than that which the study was started with; give all machines the same" in told.problem
