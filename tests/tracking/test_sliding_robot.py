"""A crane whose hook slides, from a URDF file: found in its first frame, followed, judged, measured and exported."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from least_jerk import through_poses
from made_up_rigs import ROBOT

from mmocap_warp import cli
from mmocap_warp.body.model import BodyMotion
from mmocap_warp.formats.rigged.urdf import read_urdf
from mmocap_warp.formats.usd.usd_body import read_subject, write_body
from mmocap_warp.formats.usd.usd_result import read_result
from mmocap_warp.rigging.importing.imported import imported

FRAMES, CAMERAS = 12, 4
HOIST = "hoist.Tx"


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("crane")
    (folder / "crane.urdf").write_text(ROBOT)
    body = imported(read_urdf(folder / "crane.urdf"), "crane").body
    keys = ((0.0, {"slew.Rx": 40, "luff.Rx": 20, HOIST: 0.02}), (0.4, {"slew.Rx": 55, "luff.Rx": 35, HOIST: 0.22}))
    motion = through_poses(body.skeleton, keys, 30.0)
    write_body(folder / "crane.usdc", body, {"Hoist": BodyMotion(30.0, motion.pose[:FRAMES])})
    made = ["synth", folder / "crane.usdc", "-o", folder / "scene", "--cameras", CAMERAS, "--size", 320, 240]
    assert cli.main(list(map(str, made))) == 0
    return folder / "scene"


@pytest.fixture(scope="module")
def result(scene: Path) -> Path:
    assert cli.main(["track", str(scene), "-o", str(scene / "result.usdc"), "--device", "cpu"]) == 0
    return scene / "result.usdc"


def told(capsys: pytest.CaptureFixture[str], *arguments: object) -> dict:
    capsys.readouterr()
    assert cli.main([*map(str, arguments), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_the_slider_is_followed(result: Path, capsys: pytest.CaptureFixture[str]) -> None:
    report = told(capsys, "eval", result)
    assert list(report["median_mm_by_shift"]) == [HOIST]
    assert report["median_mm_by_shift"][HOIST] < 5.0  # measured: 2.3, in images of 320x240
    assert 1.0 < report["sigma_mm_by_shift"][HOIST] < 10.0
    assert HOIST not in report["median_deg_by_angle"]
    assert cli.main(["eval", str(result)]) == 0
    assert HOIST in capsys.readouterr().out


def test_the_slider_is_found_in_the_first_frame(scene: Path, result: Path) -> None:
    found = scene / "found.usdc"
    body = str(scene.parent / "crane.usdc")
    assert cli.main(["fit", str(scene), "--body", body, "-o", str(found), "--device", "cpu"]) == 0
    subject = read_subject(found)
    at = subject.body.skeleton.coordinate_names.index(HOIST)
    assert subject.pose[at] == pytest.approx(0.02, abs=0.005)


def test_it_is_measured_and_exported_in_metres(
    result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tracked = read_result(result)
    at = tracked.subject.body.skeleton.coordinate_names.index(HOIST)
    shift = tracked.pose[tracked.best_run][:, at]
    measured = told(capsys, "measure", result, "-o", tmp_path / "measures")["per_run"][0]["shifts_mm"]
    assert measured["hoist"]["x"]["max"] == pytest.approx(1000 * shift.max())
    rows = list(csv.DictReader((tmp_path / "measures" / "shifts.csv").open()))
    np.testing.assert_allclose([float(row["hoist.x_m"]) for row in rows], shift, atol=1e-7)
    assert cli.main(["export", str(result), "-o", str(tmp_path / "crane.csv")]) == 0
    rows = list(csv.DictReader((tmp_path / "crane.csv").open()))
    np.testing.assert_allclose([float(row["hoist.Tx_m"]) for row in rows], shift, atol=2e-6)
    for suffix in (".bvh", ".glb", ".usda"):
        assert cli.main(["export", str(result), "-o", str(tmp_path / f"crane{suffix}")]) == 0
