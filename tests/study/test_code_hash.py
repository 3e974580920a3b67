"""A result's key follows the code that it comes from, however the package is installed."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from tiny_study import tasks_of

from mmocap_warp import code_hash as module
from mmocap_warp.jobs.engine import Refusal
from mmocap_warp.study import store
from mmocap_warp.study.definition import load_study
from mmocap_warp.study.job import Worker
from mmocap_warp.study.store import content_key

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def installed(tmp_path_factory) -> Path:
    """The modules as a wheel installs them: kernels are a folder of the package."""
    site = tmp_path_factory.mktemp("site-packages")
    sources = {"mmocap_warp": "mmocap_warp", "kernels": "mmocap_warp/kernels"}
    for folder, target in sources.items():
        for file in (each for ending in ("py", "pyi", "cu", "toml") for each in (ROOT / folder).rglob(f"*.{ending}")):
            copied = site / target / file.relative_to(ROOT / folder)
            copied.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(file, copied)
    (site / "mmocap_warp" / "scenes").mkdir(exist_ok=True)
    shutil.copy(ROOT / "scenes" / "__init__.py", site / "mmocap_warp" / "scenes" / "__init__.py")
    return site


KINDS = ("search", "contours", "recorded", "both")
"""The paper's trackers and those of contours on shipped sequences, then both on recordings."""


HASHES = """
from mmocap_warp import code_hash as module
facets = {"search": (False, False), "contours": (True, False), "recorded": (False, True), "both": (True, True)}
hashes = {kind: module.code_hash("study.job", contours=facet[0], recorded=facet[1]) for kind, facet in facets.items()}
"""


def hashes() -> dict[str, str]:
    """The code's hash for each kind of cell."""
    names = {}
    exec(HASHES, names)
    return names["hashes"]


def hashes_of(site: Path) -> dict[str, str]:
    script = f"import json, sys; sys.path.insert(0, {str(site)!r})\n{HASHES}\n"
    script += "assert module.__file__.startswith(sys.path[0]); print(json.dumps(hashes))"
    return json.loads(subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout)


def test_it_is_the_same_from_a_wheel(installed):
    assert hashes_of(installed) == hashes()


COUNTED = [
    ("kernels/optimizers/pso.py", KINDS),
    ("kernels/body/skinning.py", KINDS),
    ("kernels/block.cu", KINDS),
    ("tracking/tracker.py", KINDS),
    ("study/metrics.py", KINDS),
    ("synthesis/motion/stored_poses.py", KINDS),
    ("synthesis/walkers.toml", KINDS),
    ("contour/frame/fitter.py", ("contours", "both")),
    ("kernels/contour/descent.py", ("contours", "both")),
    ("tracking/contour_tracker.py", ("contours", "both")),
    ("fitting/clip_body.py", ("contours", "both")),
    ("scene/recording.py", ("recorded", "both")),
    ("masks/subtraction.py", ("recorded", "both")),
    ("formats/truth_file.py", ("recorded", "both")),
    ("formats/calibration/opencv.py", ()),
    ("tracking/checkpoint.py", ()),
    ("kernels/benchmarks/timing.py", ()),
    ("cli/result_commands.py", ()),
    ("display/page/__init__.py", ()),
    ("study/statistics.py", ()),
    ("a_new_room/__init__.py", ()),
    ("version.py", ()),
]
"""Files, and the kinds of cells whose results depend on them."""

HASHES_OF_CHANGES = f"""
import functools, json, sys
from pathlib import Path
site, *files = sys.argv[1:]
sys.path.insert(0, site)
{HASHES}
assert module.__file__.startswith(site)
reduced = module._code = functools.cache(module._code)  # of the same text it is the same
found = {{"": hashes}}
for file in files:
    path = Path(site, "mmocap_warp", file)
    before = path.read_bytes() if path.exists() else None
    path.parent.mkdir(exist_ok=True)
    path.write_bytes((before or b"") + b"CHANGED = 1\\n")
    for function in vars(module).values():
        if hasattr(function, "cache_clear") and function is not reduced:
            function.cache_clear()
    exec({HASHES!r})
    found[file] = hashes
    path.unlink() if before is None else path.write_bytes(before)
print(json.dumps(found))
"""


@pytest.fixture(scope="module")
def hashes_of_changes(installed) -> dict[str, dict[str, str]]:
    """The installed code's hashes by the file that was changed; of the whole, by no name. One process finds them."""
    command = [sys.executable, "-c", HASHES_OF_CHANGES, str(installed), *(file for file, _ in COUNTED)]
    return json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


@pytest.mark.parametrize(("file", "kinds"), COUNTED)
def test_it_follows_the_modules_that_results_depend_on(file, kinds, hashes_of_changes):
    changed, unchanged = hashes_of_changes[file], hashes()
    assert hashes_of_changes[""] == unchanged
    assert tuple(kind for kind in KINDS if changed[kind] != unchanged[kind]) == kinds


def test_comments_docstrings_and_blank_lines_do_not_count():
    code = "def area(r):\n    return 3 * r * r\n"
    commented = (
        '"""Areas."""\n# of discs\n\ndef area(r):  # [m]\n    """The \\"area\\"."""\n\n    return 3 * r * r  # "pi"\n'
    )
    assert module._code(commented) == module._code(code)
    for changed in (code.replace("3", "4"), code.replace("    return", "  return"), f"{code}x = 1\n"):
        assert module._code(changed) != module._code(code)


def test_strings_that_are_used_count():
    native = 'f = wp.func_native(\n    """\n    return 1; // one\n    """\n)\ncode = "# no comment"\n'
    assert module._code(native).count("return 1; // one") == module._code(native).count("# no comment") == 1


def test_a_new_module_counts_as_soon_as_one_that_counts_imports_it(installed):
    new, user = installed / "mmocap_warp/silhouettes/new.py", installed / "mmocap_warp/silhouettes/silhouettes.py"
    before = user.read_text()
    new.write_text("")
    user.write_text(before + "from mmocap_warp.silhouettes import new\n")
    try:
        importing = hashes_of(installed)
        new.write_text("VALUE = 1\n")
        assert all(
            mine != theirs for mine, theirs in zip(hashes_of(installed).values(), importing.values(), strict=True)
        )
    finally:
        new.unlink()
        user.write_text(before)


def test_what_it_names_exists():
    """A module that was renamed must not drop out, nor come in, unnoticed."""
    names = set(module._files())
    assert {*module._UNCOUNTED, *module._CONTOUR_MODULES, *module._RECORDING_MODULES} - {"scenes"} <= names


@pytest.mark.parametrize("cell", [pytest.param("search", marks=pytest.mark.nightly), "solved"])
def test_what_a_cell_runs_counts(cell, tmp_path):
    """Every module whose functions a cell of a shipped sequence calls, but for those that say why they do not."""
    script = f"""
import json, sys
from pathlib import Path
from mmocap_warp.study.cell import Cell
from mmocap_warp.study.job import Job, Worker, code_of
from mmocap_warp.study.source import Clip, clip_facts
from mmocap_warp.tracking.track_config import TrackConfig
from mmocap_warp import code_hash as module

solved = {cell == "solved"}
clip = Clip("S1/Box", frames=2)
config = TrackConfig("contour" if solved else "h-de", 39, None if solved else 12, runs=2)
code = code_of(config, clip, solved)
cell = Cell("S1/Box", config.algorithm, 39, config.budget)
job = Job(cell, clip, clip_facts(clip).identity, config, "", code, solved)
run = set()
sys.settrace(lambda frame, *_: run.add(frame.f_code.co_filename))
*_, result = Worker("cpu", 1).work(job)
sys.settrace(None)
files = {{str(Path(str(file)).resolve()): name for name, file in module._files().items()}}
names = {{files[str(Path(file).resolve())] for file in run if str(Path(file).resolve()) in files}}
print(json.dumps(sorted(names - module.counted("study.job", contours=solved, recorded=False))))
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=tmp_path)
    called = json.loads(done.stdout.splitlines()[-1])
    # Of formats, what reads the shipped bodies; of contours, how much memory they would take.
    known = (*module._UNCOUNTED, "formats", "contour.frame.fitter_arrays")
    assert [name for name in called if not name.startswith(known)] == []


def test_results_of_changed_code_have_files_of_their_own(study, monkeypatch):
    plan = load_study(study).plans[0]
    before = content_key(plan, "clip", "cpu")
    monkeypatch.setattr(store, "code_of", lambda *_: "of a tracker that was changed")
    assert content_key(plan, "clip", "cpu") != before


def test_a_worker_with_other_code_refuses(study, tmp_path, monkeypatch):
    monkeypatch.setattr(store, "code_of", lambda *_: "of the machine that started the study")
    job = tasks_of(study, tmp_path / "results")[0].job
    (told,) = Worker("cpu").work(job)
    assert isinstance(told, Refusal)
    assert "runs other code than the study was started with; give all machines the same" in told.problem
