"""What every test may ask for: a Warp that keeps quiet, the devices of this machine, recordings beside the checkout.

The tests of a file run in one process, which makes its module's fixtures once, and the files that take longest come
first, so that no process is left with one of them at the end.

``MMOCAP_WARP_DEBUG=1`` compiles the kernels in Warp's debug mode, where an index out of bounds is an error, into a
kernel cache of their own.
"""

from __future__ import annotations

import gc
import importlib.metadata
import importlib.util
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

# As on the command line, before NumPy is imported: its threads would wait for work beside those of the other tests.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest
import warp as wp
from browser import find_browser

from mmocap_warp.device.cores import available_threads

# A shell's background jobs ignore Ctrl-C, and so would the processes that tests send it to: they would wait for ever.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

gc.disable()  # thousands of tests are collected, and none of them is garbage

# Tests start more than a hundred processes, each of which would compile the package's modules anew.
# Mutants are changed files of the same second and size.
if "MMOCAP_MUTATION" not in os.environ:
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    sys.dont_write_bytecode = False

# A browser is no package that the tests could ask for: without one, its tests are not collected. The header says so.
collect_ignore = [] if find_browser() else ["study/test_report_browser.py", "display/page/test_page_browser.py"]


def _has_gltf_validator() -> bool:
    """Whether node finds the package, in ``NODE_PATH`` or in a folder ``node_modules`` of the checkout."""
    find = ["node", "-e", "require.resolve('gltf-validator')"]
    return bool(shutil.which("node")) and subprocess.run(find, capture_output=True).returncode == 0


if not _has_gltf_validator():  # likewise
    collect_ignore.append("formats/exports/test_gltf_validator.py")

if not importlib.util.find_spec("rerun"):  # 170 MB for one file format
    collect_ignore.append("instruments/test_rerun_file.py")

if not importlib.util.find_spec("meshoptimizer"):  # which has to be compiled
    collect_ignore.append("formats/rigged/test_meshopt.py")

LONGEST = (
    "cli/test_pipeline.py",
    "calibration/test_refine.py",
    "test_tutorial.py",
    "study/test_ray.py",
    "calibration/test_solve.py",
    "tracking/test_fit.py",
    "cli/test_streams.py",
    "recipes/test_recipes.py",
    "tracking/test_frame_fit.py",
    "test_kill.py",
    "silhouettes/test_silhouettes.py",
    "tracking/test_other_bodies.py",
    "calibration/test_synchronise.py",
    "tracking/test_smoothing.py",
    "cli/test_startup.py",
    "display/page/test_page_browser.py",
    "study/test_report.py",
    "study/test_sequences.py",
    "calibration/test_first_look.py",
    "study/test_run.py",
)
"""Files that take seven seconds of a core or more, by how long they take."""

SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "nightly: takes minutes, and a sample of it is among the other tests")
    wp.config.log_level = wp.LOG_WARNING
    if os.environ.get("MMOCAP_WARP_DEBUG") == "1":
        wp.config.mode = "debug"
        # In the stack, tiles are found through a static pointer that debug code follows: CPU threads would share it.
        wp.config.enable_tiles_in_stack_memory = False
        wp.config.kernel_cache_dir = str(config.cache.mkdir("warp-debug"))


def pytest_xdist_auto_num_workers() -> int:
    """One process more than cores: some tests wait for other processes that they have started."""
    return available_threads() + 1


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--nightly", action="store_true", help="also run what .ci/nightly runs: minutes, not seconds")


@pytest.hookimpl(trylast=True)  # pytest itself sorts by session-wide parameters
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """The longest files first, in this order; all others as they were collected. Nightly tests only where asked for."""
    if not config.option.nightly:
        nightly = [item for item in items if item.get_closest_marker("nightly")]
        config.hook.pytest_deselected(items=nightly)
        items[:] = [item for item in items if item not in nightly]
    rank = {Path(__file__).parent / name: k for k, name in enumerate(LONGEST)}
    items.sort(key=lambda item: rank.get(item.path, len(rank)))


def pytest_collection_finish() -> None:
    """From here on, garbage is looked for among what the tests make: what was imported and collected stays."""
    gc.freeze()
    gc.enable()


def pytest_report_header() -> str:
    """Which browser shows the pages, and whether glTF is validated, and files of Rerun and of meshopt are read."""
    browser = find_browser() or "none found, so no page is shown in one"
    optional = {
        "glTF-Validator": "formats/exports/test_gltf_validator.py",
        "Rerun": "instruments/test_rerun_file.py",
        "meshoptimizer": "formats/rigged/test_meshopt.py",
    }
    said = [f"{name}: {'not found' if file in collect_ignore else 'found'}" for name, file in optional.items()]
    return "; ".join([f"browser: {browser}", *said])


def devices() -> list[str]:
    """Aliases of the devices that kernels are tested on: the CPU, and the first CUDA device where there is one."""
    return ["cpu", *(["cuda:0"] if wp.is_cuda_available() else [])]


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """A test with an argument ``device`` runs once on each of this machine's devices."""
    if "device" in metafunc.fixturenames:
        metafunc.parametrize("device", devices(), scope="session")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Directory of real recordings, ``../shared/data``; without it the test is skipped."""
    if not SHARED_DATA.is_dir():
        pytest.skip("needs the recordings in ../shared/data, which are not part of the project")
    return SHARED_DATA


@pytest.fixture
def no_distribution(monkeypatch):
    """The package lies on Python's path and was never installed."""
    distribution = importlib.metadata.distribution

    def found(name):
        if name == "mmocap-warp":
            raise importlib.metadata.PackageNotFoundError(name)
        return distribution(name)

    monkeypatch.setattr(importlib.metadata, "distribution", found)
