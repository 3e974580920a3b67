"""What the documents show works."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
from bench_report import report_page
from synthetic import synthetic_result
from tracked_motion import FRAMES, TRACKED, standing_still, track_motion
from walk_scene import walking

import mmocap_warp
from mmocap_warp.formats.usd.usd_result import write_result
from mmocap_warp.optimizers.minimize import minimize
from mmocap_warp.tracking.algorithms import ALGORITHMS

ROOT = Path(__file__).resolve().parents[1]


def example(page: str, of: int = 0) -> str:
    """A page's Python example."""
    return re.findall(r"```python\n(.*?)```", (ROOT / "docs" / page).read_text(encoding="utf-8"), re.S)[of]


def test_the_optimizers_example_finds_the_minimum(tmp_path):
    script = tmp_path / "example.py"
    script.write_text(example("algorithms.md"))
    answer = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=True)
    costs = [float(cost) for cost in answer.stdout.splitlines()[-1].strip("[]").split()]
    assert len(costs) == 5
    assert min(costs) < 1e-6


PYTHON_EXAMPLE = example("python.md") + "print(joints.shape, skin.shape, picture.shape)\n" + example("python.md", 1)


def check_python_example(output: str, frames: int) -> None:
    """What the example of the page on Python prints: live frames last, before them the shapes and the errors."""
    lines = output.splitlines()
    assert all(re.match(rf" *{i} tracked  hands at", line) for i, line in enumerate(lines[-frames:]))
    *_, numbers, shapes = lines[:-frames]
    overlap, error = map(float, re.findall(r"\d[\d.]*", numbers))
    assert overlap > 0.75
    assert error < 20
    assert shapes == f"(1, {frames}, 16, 3) (2, 13380, 3) (240, 320, 3)"


@pytest.mark.nightly
def test_the_public_face_goes_from_masks_to_a_picture(tmp_path):
    (tmp_path / "example.py").write_text(PYTHON_EXAMPLE)
    command = [sys.executable, "example.py"]
    answer = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    check_python_example(answer.stdout, 64)
    assert (tmp_path / "walk.usdc").is_file()


def test_the_public_face_goes_from_a_subject_to_a_picture(tmp_path, monkeypatch, capsys):
    """The same example of fewer frames, with the walk's own subject: tests/tracking has fits of it."""
    made = walking()

    def fit(scene, body, **settings):
        assert isinstance(body, mmocap_warp.BodyModel)
        mmocap_warp.FitConfig(**settings)
        return mmocap_warp.Subject(made.body, made.root_base, made.poses[0], {"body.height": 1.75})

    monkeypatch.setattr(mmocap_warp, "fit", fit)
    monkeypatch.chdir(tmp_path)
    assert PYTHON_EXAMPLE.count('ROOT / "walk")') == 1
    exec(PYTHON_EXAMPLE.replace('ROOT / "walk")', 'ROOT / "walk", frames="0:11")'), {})
    check_python_example(capsys.readouterr().out, 11)
    assert (tmp_path / "walk.usdc").is_file()


def test_a_result_stands_in_its_bind_pose_for_opensim(tmp_path):
    result = synthetic_result(frames=9)
    write_result(tmp_path / "walk.usdc", result)
    (tmp_path / "still.py").write_text(example("measures.md"))
    subprocess.run([sys.executable, "still.py"], cwd=tmp_path, capture_output=True, check=True)
    still = mmocap_warp.load_result(tmp_path / "still.usdc")
    assert still.pose.shape == (2, 8, result.pose.shape[2])
    assert not still.pose.any()


def test_the_page_on_python_names_the_whole_face():
    page = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
    named = set(re.findall(r"mm\.(\w+)|`(\w+)[`(]", page))
    assert set(mmocap_warp.__all__) - {"__version__"} <= {name for pair in named for name in pair}


def test_documents_that_the_code_names_exist():
    named = set()
    for file in [*ROOT.glob("kernels/**/*.py"), *ROOT.glob("mmocap_warp/**/*.py")]:
        named.update(re.findall(r"docs/\w+\.md", file.read_text(encoding="utf-8")))
    assert named
    assert [name for name in sorted(named) if not (ROOT / name).is_file()] == []


def test_the_page_on_the_api_has_the_whole_face():
    page = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
    told = set(re.findall(r"^\.\. auto(?:function|class):: mmocap_warp\.(\w+)$", page, re.M))
    assert told == set(mmocap_warp.__all__) - {"__version__"}


def test_every_page_stands_in_the_sites_navigation():
    """Else the strict build ends at it."""
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    entries = [line for block in re.findall(r"```\{toctree\}\n(.*?)```", index, re.S) for line in block.splitlines()]
    listed = {re.sub(r".+ <(.+)>", r"\1", entry) for entry in entries}  # with a title of its own, or without
    pages = [*(ROOT / "docs").glob("**/*.md"), *(ROOT / "docs").glob("*.ipynb")]
    names = {page.relative_to(ROOT / "docs").with_suffix("").as_posix() for page in pages} - {"index"}
    assert names - listed == set()


def test_the_sites_page_of_times_is_made_from_the_reports_beside_it():
    folder = ROOT / "docs" / "benchmarks"
    reports = [json.loads((folder / name).read_bytes()) for name in ("cpu.json", "h200.json")]
    page = report_page(reports)
    for report in reports:
        assert f"## {report['device']}\n" in page
    plots = re.findall(r"\]\((growth-\w+\.svg)\)", page)
    assert plots
    assert [plot for plot in plots if not (folder / plot).is_file()] == []


@pytest.mark.parametrize("notebook", ["notebook.ipynb", "functions.ipynb"])
def test_a_notebook_is_stored_without_what_it_prints(notebook):
    """It is run when the site is built."""
    cells = json.loads((ROOT / "docs" / notebook).read_text(encoding="utf-8"))["cells"]
    ran = [cell for cell in cells if cell["cell_type"] == "code"]
    assert ran
    assert [cell["source"] for cell in ran if cell["outputs"] or cell["execution_count"] is not None] == []


@pytest.mark.parametrize(
    "asks",
    [
        '<script src="https://cdn.example/a.js"></script>',
        '<link rel="stylesheet" href="//fonts.example/b.css">',
        '<img srcset="https://example.org/c.png 2x">',
        "<style>@font-face { src: url(https://fonts.example/d.woff2) }</style>",
        '<script type="module">import { x } from "https://cdn.example/e.js"</script>',
        '<iframe srcdoc="&lt;script src=&#34;http://cdn.example/f.js&#34;&gt;&lt;/script&gt;"></iframe>',
        None,
    ],
)
def test_a_page_that_asks_elsewhere_for_something_is_found(tmp_path, asks):
    page = '<a href="https://example.org">a link is none</a><script src="here.js"></script>'
    (tmp_path / "page.html").write_text(page + (asks or ""))
    told = subprocess.run([sys.executable, ROOT / ".ci" / "offline", tmp_path], capture_output=True, text=True)
    assert told.returncode == (asks is not None), told.stdout


@pytest.fixture
def ninth(monkeypatch):
    """A random search that names itself as a tracker, as the page on optimizers says, in a module just imported."""
    monkeypatch.setitem(ALGORITHMS, "h-random", None)  # removed again afterwards
    yield import_module("random_search")
    sys.modules.pop("random_search")


def test_the_ninth_optimizer_minimises_and_its_runs_are_independent(device, ninth):
    def sphere(x, out):
        out.assign(((x.numpy() - 0.5) ** 2).sum(axis=1))

    settings = {"start": [0.0] * 4, "radius": 0.5, "evaluations": 507, "optimizer": ninth.RandomSearch}
    batch = minimize(sphere, **settings, runs=3, seed=7, device=device)
    assert batch.evaluations == 507
    assert max(batch.cost) < 0.01
    for run in range(3):
        single = minimize(sphere, **settings, seed=7 + run, device=device)
        assert single.x[0].tolist() == batch.x[run].tolist()


def test_the_ninth_tracker_tracks(device, ninth):
    """By parts, within the budget, from the preset's radius."""
    result, errors = track_motion("h-random", device, FRAMES, runs=2)
    assert all(error < TRACKED * standing_still(FRAMES) for error in errors)
    assert (result.evaluations == 500).all()
