"""The recipes of CONTRIBUTING.md: what they add works from the command line."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from recipe import Recipe, copy_tree

from mmocap_warp.body.posing import Poser
from mmocap_warp.formats.usd.usd_result import read_result
from mmocap_warp.scene.scene_toml import load_scene

EVERY_RECIPE = (
    "tests/test_architecture.py",
    "tests/test_public_face.py",
    *("--deselect", "tests/test_public_face.py::test_a_body_is_fitted_and_then_tracked"),
    *("--deselect", "tests/test_public_face.py::test_the_settings_are_the_callers_then_the_scenes"),
    *("--deselect", "tests/cameras/test_rig.py::test_undistorted_masks_lie_where_the_pinhole_sees_them"),
)
"""Tests that hold of any change.

Those left out take most of the time, and use what is there without the recipe."""

TESTS = {
    "An optimizer": ("tests/tracking/test_presets.py", "tests/cli/test_cli.py"),
    "A calibration format": ("tests/formats/test_table.py", "tests/cameras/test_rig.py"),
    "A cost": ("tests/cli/test_cli.py",),
    "An export format": ("tests/formats/test_table.py", "tests/formats/exports/test_exports.py"),
}
"""The tests of what a recipe touches, by its title."""

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


@pytest.fixture(scope="module")
def changed_by_all(tmp_path_factory) -> Path:
    """A copy of the tree to which all recipes are applied."""
    folder = tmp_path_factory.mktemp("recipes")
    copy_tree(folder)
    for title in TESTS:
        Recipe(title, folder).apply()
    return folder


@pytest.fixture(params=["together", pytest.param("alone", marks=pytest.mark.nightly)])
def follow(request, tmp_path) -> Callable[[str], Recipe]:
    """A recipe that is applied: in one copy beside all others, or alone, where the suite's tests run too."""
    if request.param == "together":
        folder = request.getfixturevalue("changed_by_all")
        return lambda title: Recipe(title, folder)

    def alone(title: str) -> Recipe:
        copy_tree(tmp_path)
        recipe = Recipe(title, tmp_path)
        recipe.apply()
        recipe.run("pytest", *EVERY_RECIPE, *TESTS[title])
        return recipe

    return alone


@pytest.mark.nightly
def test_the_suite_passes_where_all_recipes_are_applied(changed_by_all: Path) -> None:
    tests = dict.fromkeys(name for names in TESTS.values() for name in names)
    assert " passed" in Recipe("An optimizer", changed_by_all).run("pytest", *EVERY_RECIPE, *tests)


def test_an_optimizer(follow: Callable[[str], Recipe], device: str) -> None:
    recipe = follow("An optimizer")
    (recipe.folder / "walked.usdc").unlink(missing_ok=True)  # of another device
    recipe.run_commands()
    result = read_result(recipe.folder / "walked.usdc")
    assert result.config["algorithm"] == "h-walk"
    assert (result.evaluations == 60).all()
    assert result.iou.mean() > 0.7
    recipe.run("python", "-c", MINIMISE, device)


def test_a_calibration_format(follow: Callable[[str], Recipe]) -> None:
    recipe = follow("A calibration format")
    rig = load_scene(recipe.folder).calibrated
    expected = json.loads(recipe.run("mmocap", "cameras", "scene.toml", "--json"))
    values = zip(rig.names, rig.K, rig.R, rig.t, rig.size, strict=True)
    cameras = {
        name: dict(zip(("K", "R", "t", "size"), (v.tolist() for v in row), strict=True)) for name, *row in values
    }
    (recipe.folder / "cameras.rig").write_text(json.dumps(cameras))
    scene = recipe.folder / "scene.toml"
    before = scene.read_text()
    scene.write_text(before.replace('"calibration.toml"', '"cameras.rig"\nunits = "m"'))
    (shown,) = recipe.run_commands()
    scene.write_text(before)  # the other recipes' tests read it too
    assert json.loads(shown) == expected


def test_a_cost(follow: Callable[[str], Recipe]) -> None:
    recipe = follow("A cost")
    tested, _ = recipe.run_commands()
    assert " passed" in tested
    result = read_result(recipe.folder / "dice.usdc")
    assert result.config["cost"] == "dice"
    expected = (1 - 2 * result.iou / (1 + result.iou)).mean(axis=2)  # Dice from intersection over union
    np.testing.assert_allclose(result.cost, expected, rtol=0, atol=1e-6)


def test_an_export_format(follow: Callable[[str], Recipe]) -> None:
    recipe = follow("An export format")
    recipe.run_commands()
    result = read_result(recipe.folder / "result.usdc")
    table = np.genfromtxt(recipe.folder / "markers.tsv", delimiter="\t", names=True, deletechars="")
    subject = result.subject
    markers = Poser(subject.body, subject.root_base).vertices(result.pose[0])[:, subject.body.marker_vertex]
    for name, expected in zip(subject.body.marker_names, markers.swapaxes(0, 1), strict=True):
        found = np.stack([table[f"{name}.{axis}"] for axis in "xyz"], axis=1)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)
    assert ".tsv" in recipe.run("mmocap", "export", "--help")
