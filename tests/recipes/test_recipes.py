"""The recipes of CONTRIBUTING.md: what they add works from the command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from recipe import Recipe

from mmocap_warp.body.posing import Poser
from mmocap_warp.formats.usd.usd_result import read_result
from mmocap_warp.scene.scene_toml import load_scene

EVERY_RECIPE = (
    "tests/test_architecture.py",
    "tests/test_public_face.py",
    *("--deselect", "tests/test_public_face.py::test_a_body_is_fitted_and_then_tracked"),
    *("--deselect", "tests/test_public_face.py::test_the_settings_are_the_callers_then_the_scenes"),
)
"""Tests that hold of any change; each recipe has those of what it touches too.

Those left out take most of the time, and track with what is there without the recipe."""

MINIMISE = """
import sys, numpy
from mmocap_warp.optimizers.minimize import minimize
from mmocap_warp.optimizers.random_walk import RandomWalk

def sphere(x, out):
    out.assign(((x.numpy() - 0.1) ** 2).sum(axis=1))

settings = {"start": [0.0] * 2, "radius": 0.05, "evaluations": 307, "optimizer": RandomWalk, "device": sys.argv[1]}
batch = minimize(sphere, **settings, runs=3, seed=7)
alone = [minimize(sphere, **settings, seed=7 + run) for run in range(3)]
assert batch.evaluations == 307
assert max(batch.cost) < 0.01, batch.cost
assert all((batch.x[run] == alone[run].x[0]).all() for run in range(3))
"""


def test_an_optimizer(tmp_path: Path, device: str) -> None:
    recipe = Recipe("An optimizer", tmp_path)
    recipe.run_commands()
    result = read_result(tmp_path / "walked.usdc")
    assert result.config["algorithm"] == "h-walk"
    assert (result.evaluations == 60).all()
    assert result.iou.mean() > 0.7
    recipe.run("python", "-c", MINIMISE, device)
    recipe.run("pytest", *EVERY_RECIPE, "tests/tracking/test_presets.py", "tests/cli/test_cli.py")


def test_a_calibration_format(tmp_path: Path) -> None:
    recipe = Recipe("A calibration format", tmp_path)
    rig = load_scene(tmp_path).calibrated
    expected = json.loads(recipe.run("mmocap", "cameras", "scene.toml", "--json"))
    values = zip(rig.names, rig.K, rig.R, rig.t, rig.size, strict=True)
    cameras = {
        name: dict(zip(("K", "R", "t", "size"), (v.tolist() for v in row), strict=True)) for name, *row in values
    }
    (tmp_path / "cameras.rig").write_text(json.dumps(cameras))
    scene = tmp_path / "scene.toml"
    scene.write_text(scene.read_text().replace('"calibration.toml"', '"cameras.rig"\nunits = "m"'))
    (shown,) = recipe.run_commands()
    assert json.loads(shown) == expected
    recipe.run("pytest", *EVERY_RECIPE, "tests/formats/test_table.py", "tests/cameras/test_rig.py")


def test_a_cost(tmp_path: Path) -> None:
    recipe = Recipe("A cost", tmp_path)
    tested, _ = recipe.run_commands()
    assert " passed" in tested
    result = read_result(tmp_path / "dice.usdc")
    assert result.config["cost"] == "dice"
    expected = (1 - 2 * result.iou / (1 + result.iou)).mean(axis=2)  # Dice from intersection over union
    np.testing.assert_allclose(result.cost, expected, rtol=0, atol=1e-6)
    recipe.run("pytest", *EVERY_RECIPE, "tests/cli/test_cli.py")


def test_an_export_format(tmp_path: Path) -> None:
    recipe = Recipe("An export format", tmp_path)
    recipe.run_commands()
    result = read_result(tmp_path / "result.usdc")
    table = np.genfromtxt(tmp_path / "markers.tsv", delimiter="\t", names=True, deletechars="")
    subject = result.subject
    markers = Poser(subject.body, subject.root_base).vertices(result.pose[0])[:, subject.body.marker_vertex]
    for name, expected in zip(subject.body.marker_names, markers.swapaxes(0, 1), strict=True):
        found = np.stack([table[f"{name}.{axis}"] for axis in "xyz"], axis=1)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)
    assert ".tsv" in recipe.run("mmocap", "export", "--help")
    recipe.run("pytest", *EVERY_RECIPE, "tests/formats/test_table.py", "tests/formats/exports/test_exports.py")
