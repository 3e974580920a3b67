"""``mmocap demo``: its own check, the files that it names, and other bodies."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from moving_figure import PROMISED, PROMISED_WITH_TRUTH, write_moving_figure

from mmocap_warp import cli
from mmocap_warp.cli import console
from mmocap_warp.commands.demo import EXAMPLES, Example
from mmocap_warp.formats.usd.usd_body import read_body, read_motions, write_body
from mmocap_warp.formats.usd.usd_result import read_result
from mmocap_warp.rigging.shipped import body_file

pytestmark = pytest.mark.usefixtures("no_network")


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> Path:
    return write_moving_figure(tmp_path_factory.mktemp("recording"))


@pytest.mark.parametrize(("most", "code"), [(1000.0, console.OK), (1e-6, console.CHECK_FAILED)])
def test_demo_checks_itself_and_writes_all_it_names(most, code, scene, tmp_path, monkeypatch, capsys):
    shipped = tmp_path / "scenes"
    shipped.mkdir()
    (shipped / "walk").symlink_to(scene.parent)
    monkeypatch.setattr("mmocap_warp.commands.demo.ROOT", shipped)
    monkeypatch.setattr("mmocap_warp.commands.demo.MOST_ERROR_MM", most)
    assert cli.main(["demo", "-o", str(tmp_path / "out"), "--json", "--quiet"]) == code
    report = json.loads(capsys.readouterr().out)
    assert all(report[key] is not None for key in (*PROMISED, *PROMISED_WITH_TRUTH))
    assert sorted(os.listdir(tmp_path / "out")) == ["walk-error.svg", "walk.png", "walk.usdc", "walk.webm"]
    assert all(Path(report[name]).is_file() for name in ("result", "overlay", "sheet", "plot"))


def test_demo_of_another_body_makes_its_scene(tmp_path, monkeypatch, capsys):
    hand, motions = body_file("hand"), read_motions(body_file("hand"))
    short = replace(motions["Opening"], pose=motions["Opening"].pose[:2])
    write_body(tmp_path / "hand.usdc", read_body(hand), {"Short": short})
    monkeypatch.setitem(EXAMPLES, "hand", Example(str(tmp_path / "hand.usdc"), "Short", 3))
    assert cli.main(["demo", "hand", "-o", str(tmp_path / "out"), "--json", "--quiet"]) == console.OK
    report = json.loads(capsys.readouterr().out)
    assert report["mpjpe_share"] < 0.01
    assert report["size_m"] == pytest.approx(0.212, abs=1e-3)
    assert report["median_angle_deg"] < 3
    files = {"hand-error.svg", "hand.png", "hand.usdc", "hand.webm"}
    assert set(os.listdir(tmp_path / "out")) == files | {"hand-scene"}
    assert cli.main(["demo", "hand", "-o", str(tmp_path / "out"), "--paper", "--quiet"]) == console.USAGE


def test_demo_puts_the_papers_tracker_beside_it(scene, tmp_path, monkeypatch, capsys):
    shipped = tmp_path / "scenes"
    shipped.mkdir()
    (shipped / "walk").symlink_to(scene.parent)
    monkeypatch.setattr("mmocap_warp.commands.demo.ROOT", shipped)
    assert cli.main(["demo", "-o", str(tmp_path / "out"), "--paper", "--quiet"]) in (
        console.OK,
        console.CHECK_FAILED,
    )
    told = capsys.readouterr().out
    rows = [line.split() for line in told.splitlines() if line.startswith(("search-contour", "h-cmaes"))]
    assert [row[0] for row in rows] == ["search-contour", "h-cmaes"]
    own, papers = (read_result(tmp_path / "out" / f"{name}.usdc") for name in ("walk", "walk-h-cmaes"))
    assert (own.config["algorithm"], papers.config["algorithm"]) == ("search-contour", "h-cmaes")
    np.testing.assert_array_equal(own.subject.pose, papers.subject.pose)
    drawn = {"walk-h-cmaes-error.svg", "walk-h-cmaes.png", "walk-h-cmaes.usdc", "walk-h-cmaes.webm"}
    assert drawn <= set(os.listdir(tmp_path / "out"))
    assert all(str(tmp_path / "out" / name) in told for name in drawn)
