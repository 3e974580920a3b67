"""``mmocap bench``, and beside it other programs and growth: what is timed is right, and what is said of it too.

Sizes are tiny; nobody looks at the times.
"""

from __future__ import annotations

import io
import json
import re
import time
import xml.etree.ElementTree as ElementTree
from contextlib import redirect_stderr
from pathlib import Path

import bench_growth as growth_module
import bench_optimizers as peers_module
import bench_report
import bench_searches as searches_module
import numpy as np
import pytest
import warp as wp
from bench_growth import Line, growth_lines, with_triangles
from bench_optimizers import ENGINES, FUNCTIONS, optimizer_peers
from bench_peers import peers
from bench_report import full_report, main, missing

import mmocap_warp
from mmocap_warp import cli
from mmocap_warp.bench import suite as suite_module
from mmocap_warp.bench.report_file import OURS, digits, duration, rendered, report_tables, to_text, write_report
from mmocap_warp.bench.suite import Plan, run_suite
from mmocap_warp.bench.workload import workload
from mmocap_warp.body.mesh_pieces import is_closed
from mmocap_warp.cli import console
from mmocap_warp.kernels.benchmarks import timing
from mmocap_warp.kernels.benchmarks.timing import Case, Check, time_together
from mmocap_warp.optimizers.cma_es import CmaEs

SMALL = {"cameras": 2, "size": (64, 48)}


@pytest.fixture(scope="module")
def small():
    return workload(**SMALL)


@pytest.fixture(scope="module")
def report(small):
    """All that is measured, as it comes back from JSON."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(timing, "_SAMPLE_SECONDS", {"cpu": 0.0, "cuda": 0.0})  # a work is called once in a sample
        patch.setattr(searches_module, "_BUDGET", 90)
        patch.setattr(peers_module, "_DOFS", 10)
        patch.setattr(bench_report, "_RUNS", 2)
        patch.setattr(growth_module, "_CANDIDATES", {"cpu": (1, 4), "cuda": (1, 4)})
        patch.setattr(growth_module, "BATCH", {"cpu": 2, "cuda": 2})
        patch.setattr(growth_module, "_CAMERAS", (1, 2))
        patch.setattr(growth_module, "SIZE", (64, 48))
        patch.setattr(growth_module, "_SCALES", (0.5, 1.0))
        patch.setattr(growth_module, "_TRIANGLES", (1300, None))
        patch.setattr(growth_module, "_RUNS", {"cpu": (1, 2), "cuda": (1, 2)})
        against = () if missing(["embree"]) else ("embree", "trimesh")
        against += tuple(name for name in ("cmaes",) if not missing([name]))
        plan = Plan("cpu", 2, (8,), (2,), seconds=0.0)
        with redirect_stderr(io.StringIO()) as printed:
            report = full_report(plan, (*against, "opencv"), True, small)
    steps = printed.getvalue().splitlines()
    assert len(steps) == len(set(steps)) == len({row["group"] for row in report["measurements"]})
    return json.loads(json.dumps(report, allow_nan=False))


def test_the_measure_is_what_the_documents_say():
    load = workload()
    assert load.sizes == {"cameras": 7, "pixels": 640 * 480, "triangles": 2600}
    assert load.height == pytest.approx(280, abs=5)


@pytest.mark.parametrize("triangles", [1300, 10400])
def test_a_mesh_of_other_triangles_is_closed_and_shows_the_same(triangles):
    own = workload(**SMALL)
    load = with_triangles(own, triangles)
    assert load.sizes["triangles"] == triangles
    assert is_closed(load.body.tracking_face)
    np.testing.assert_allclose(load.body.tracking.weight.sum(axis=1), 1.0, rtol=0, atol=1e-5)
    np.testing.assert_allclose(load.observation.foreground, own.observation.foreground, rtol=0.05)


def test_every_answer_was_right_and_every_time_is_one(report):
    assert report["ok"]
    for row in report["measurements"]:
        assert row["ok"], row
        assert row["rounds"] >= 5
        assert row["compiling"] >= 0.0
        if row["group"] != "a generation":  # the difference of two times
            assert 0.0 < row["lowest"] <= row["quartiles"][0] <= row["median"] <= row["quartiles"][1], row


def test_everything_is_measured_once(report):
    keys = [json.dumps([row["group"], row["name"], row["sizes"]]) for row in report["measurements"]]
    assert len(keys) == len(set(keys))
    names = {(row["group"], row["name"]) for row in report["measurements"]}
    for kernel in ("posing and skinning", "raycast", "raster", "freeze", "cost"):
        assert ("kernels", kernel) in names
    for optimizer in ("cmaes", "de", "pso", "apf"):
        assert ("ask and tell", optimizer) in names
    assert {("a generation", "h-cmaes: mean of the parts"), ("a generation", "cmaes: whole body")} <= names
    assert {("contour", "fields"), ("contour", "4 steps"), ("contour", "frame"), ("contour", "search-contour")} <= names
    assert {("a frame", "h-cmaes"), ("peers", "opencv")} <= names


@pytest.fixture
def bench_one_case(monkeypatch, small):
    """Runs the suite on a case with this check and nothing else; returns its report."""

    def bench(check):
        case = Case("kernels", "raster", {}, lambda: None, lambda: check)
        monkeypatch.setattr(suite_module, "stages", lambda *_: iter([[case]]))
        return run_suite(Plan("cpu", 1, (), (2,), seconds=0.0), lambda _: None, small)

    return bench


def test_a_wrong_answer_is_reported(bench_one_case):
    report = bench_one_case(Check("1 of 98 counts differ", False))
    assert not report["ok"]
    text = to_text(rendered(report), colours=False)
    assert "✗" in text
    assert "wrong: raster" in text
    assert "1 of 98 counts differ" in text


def test_it_needs_no_installed_distribution(bench_one_case, no_distribution):
    report = bench_one_case(Check("", True))
    assert f"mmocap-warp {mmocap_warp.__version__}" in to_text(rendered(report), colours=False)


def test_times_are_of_the_work_and_compiling_is_apart():
    class Sleeper:
        first = True

        def __call__(self):
            time.sleep(0.05 if self.first else 0.003)
            self.first = False

    slow, quick = time_together([Sleeper(), lambda: None], "cpu", seconds=0.0)
    assert 0.003 <= slow.lowest <= slow.median < 0.03
    assert 0.02 < slow.compiling < 0.2
    assert quick.median < 1e-4
    assert len(slow.samples) == len(quick.samples) == 5


def test_a_peer_that_differs_is_noticed(small, monkeypatch):
    (cases,) = peers(small, ["opencv"])
    opencv = cases[-1]
    assert opencv.name == "opencv"
    opencv.work()
    assert opencv.check().ok
    monkeypatch.setattr("bench_peers.cv2.fillConvexPoly", lambda *_: None)
    assert not opencv.check().ok


def test_tables_have_a_word_for_every_column(report):
    for table in report_tables(report, report, answers=True):
        assert all(len(row) == len(table.columns) for row in table.rows)
    text = to_text(rendered(report, report), colours=False)
    assert "…" not in text
    assert "1.00x" in text
    assert "2 runs at once do" in text
    assert "threads are" in text


def test_no_number_is_cut_off_where_a_busy_machine_spreads_times(report):
    busy = json.loads(json.dumps(report))
    for row in busy["measurements"]:
        row["median"], row["quartiles"] = 2e-4, [2e-4, 3.0]
    assert "…" not in to_text(rendered(busy, busy), colours=False)


def test_an_older_report_gives_ratios(report):
    old = json.loads(json.dumps(report))
    for row in old["measurements"]:
        row["median"] *= 3.0
    old["measurements"] = [row for row in old["measurements"] if row["name"] != "cost"]
    kernels = report_tables(report, old)[0]
    ratio = {row[0]: row[kernels.columns.index("speed-up")] for row in kernels.rows}
    assert ratio["raster"] == "3.00x"
    assert ratio["cost"] == ""


def test_pages_show_growth(report, tmp_path, capsys):
    gpu = json.loads(json.dumps(report))
    gpu["kind"], gpu["device"] = "cuda", "A GPU"
    for name, each in (("cpu.json", report), ("gpu.json", gpu)):
        write_report(tmp_path / name, each)
    assert main(["--pages", str(tmp_path / "pages"), str(tmp_path / "cpu.json"), str(tmp_path / "gpu.json")]) == 0
    files = [Path(line) for line in capsys.readouterr().out.splitlines()]
    assert {path.name for path in files} == {"results.md", *(f"growth-{axis}.svg" for axis in growth_module.AXES)}
    page = (tmp_path / "pages" / "results.md").read_text()
    assert set(re.findall(r"\]\((growth-\w+\.svg)\)", page)) == {path.name for path in files[1:]}
    for path in files[1:]:
        root = ElementTree.parse(path).getroot()
        words = [element.text for element in root.iter("{http://www.w3.org/2000/svg}text")]
        assert {"CPU, raycast", "CPU, raster", "GPU, raycast", "GPU, raster"} <= set(words)


def test_a_slope_is_the_power_of_growth():
    assert Line("A CPU", "raster", False, [(1.0, 7.0), (16.0, 4.0), (64.0, 8.0)]).slope == pytest.approx(0.5)


def test_growth_is_ordered_by_size(report):
    for axis in growth_module.AXES:
        for line in growth_lines([report], axis):
            assert line.points == sorted(line.points)


@pytest.mark.parametrize(
    ("seconds", "words"), [(2.5, "2.50 s"), (0.0123, "12.3 ms"), (4.56e-4, "456 µs"), (3e-7, "0.30 µs"), (None, "")]
)
def test_durations_have_the_unit_that_suits(seconds, words):
    assert duration(seconds) == words


def test_digits_are_in_the_unit_of_another_duration():
    assert digits(9e-4, 1.2e-3) == "0.90"


def test_the_command_writes_a_report_and_compares(monkeypatch, report, tmp_path, capsys):
    monkeypatch.setattr("mmocap_warp.bench.suite.run_suite", lambda plan, tell, load: report)
    path = tmp_path / "report.json"
    assert cli.main(["bench", "--device", "cpu", "-o", str(path)]) == console.OK
    assert json.loads(path.read_text()) == report
    assert cli.main(["bench", "--device", "cpu", "--json", "--compare", str(path)]) == console.OK
    shown = capsys.readouterr().out
    assert "whole evaluation" in shown
    assert json.loads(shown[shown.index("\n{\n") :]) == report
    monkeypatch.setattr("mmocap_warp.bench.suite.run_suite", lambda plan, tell, load: report | {"ok": False})
    assert cli.main(["bench", "--device", "cpu"]) == console.CHECK_FAILED


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["--threads", "0"], console.USAGE, "--threads must be at least 1"),
        (["--device", "cuda:99"], console.USAGE, "--device must be auto or one of"),
        (["--compare", "absent.json"], console.BAD_INPUT, "absent.json: no such file"),
        (["-o", "report.txt"], console.BAD_INPUT, "end it in .json"),
    ],
)
def test_wrong_use_is_said_in_a_line(arguments, code, words, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["bench", *arguments]) == code
    shown = capsys.readouterr()
    assert words in shown.err
    assert shown.err.count("\n") == 1


@pytest.mark.parametrize("name", [*ENGINES])
def test_every_cma_es_samples_learns_and_begins_anew(name):
    if name != OURS and missing([name]):
        pytest.skip(f"{name} is not installed: pip install 'mmocap-warp[peers]'")
    engine = ENGINES[name](4, 8, 2)
    lowest = []
    for _ in range(2):
        engine.begin()
        costs = []
        for _ in range(60):
            x = engine.ask()
            assert x.shape == (2, 8, 4)
            cost = np.sum(x**2, axis=-1).astype(np.float32)
            engine.tell(cost)
            costs.append(cost.min())
        lowest.append(min(costs))
        engine.generation(cost)()
    assert costs[0] > 0.05
    assert lowest[0] == lowest[1] < 1e-3


def test_an_optimizer_that_stands_still_is_noticed(monkeypatch):
    monkeypatch.setattr(CmaEs, "tell", lambda self, cost: None)
    for cases in optimizer_peers([OURS], (1,)):
        for case in cases:
            case.work()
            assert not case.check().ok


def test_functions_are_lowest_where_they_say():
    for function, at in (("sphere", 0.0), ("Rosenbrock", 2.0), ("Rastrigin", 0.0)):
        costs_of, _allowed = FUNCTIONS[function]
        assert costs_of(np.full(10, at)) == 0.0
        assert costs_of(np.full(10, at) + 0.01) > 0.0


@pytest.mark.parametrize("name", ["embree", "povray"])
def test_a_peer_that_is_unknown_or_not_installed_is_named(name, monkeypatch, capsys):
    monkeypatch.setattr("bench_report.find_spec", lambda name: None)
    with pytest.raises(SystemExit):
        main(["report.json", "--against", name])
    assert f"--against {name}: unknown, or not installed" in capsys.readouterr().err


def test_a_graph_replays_what_was_launched():
    if not wp.is_cuda_available():
        pytest.skip("graphs are captured on CUDA devices only")
    array = wp.zeros(1, dtype=wp.float32, device="cuda:0")
    counted = wp.zeros(1, dtype=wp.int32, device="cuda:0")
    from mmocap_warp.kernels.optimizers.populations import advance

    (measured,) = time_together([lambda: advance(counted, 1)], "cuda:0", seconds=0.0)
    assert measured.launched is not None
    assert counted.numpy()[0] > len(measured.samples)
    assert array.numpy()[0] == 0.0
