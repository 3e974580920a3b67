"""``import mmocap_warp as mm``: the names, lazily, and those that type checkers see."""

from __future__ import annotations

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from synthetic import synthetic_result
from walk_scene import walking

import mmocap_warp as mm
from mmocap_warp.scenes import ROOT


def names_for_type_checkers() -> set[str]:
    """What the root imports under ``if TYPE_CHECKING``."""
    tree = ast.parse(Path(mm.__file__).read_text(encoding="utf-8"))
    (block,) = [node for node in tree.body if isinstance(node, ast.If)]
    return {alias.asname or alias.name for line in block.body for alias in line.names}


def test_every_name_is_there_documented_and_typed():
    for name in mm.__all__:
        assert getattr(mm, name).__doc__
    assert set(dir(mm)) == set(mm.__all__)
    assert names_for_type_checkers() == set(mm.__all__) - {"__version__"}


def test_a_name_that_is_not_there():
    with pytest.raises(AttributeError, match="'mmocap_warp' has no attribute 'trak'"):
        _ = mm.trak


def test_a_result_survives_its_file(tmp_path):
    result = synthetic_result()
    mm.write_result(tmp_path / "result.usdc", result)
    np.testing.assert_array_equal(mm.load_result(tmp_path / "result.usdc").joints(), result.joints())


def test_bodies_by_name_and_by_file():
    man = mm.load_body("adult_man")
    assert man.name == mm.load_body(ROOT / "bodies" / "adult_man.usdc").name
    with pytest.raises(mm.InputError, match=r"there is no body 'adult'.*adult_man"):
        mm.load_body("adult")


@pytest.fixture
def walk() -> mm.Scene:
    """Two frames of the built-in walk, with settings of its own."""
    track = {"evaluations": 40, "scale": 0.25, "seed": 5}
    return replace(mm.load_scene(ROOT / "walk"), frame_count=2, track=track, fit={"headings": 0})


def test_the_settings_are_the_callers_then_the_scenes(walk):
    made = walking()
    subject = mm.Subject(made.body, made.root_base, made.poses[0], {})
    result = mm.track(walk, subject, evaluations=30, device="cpu")
    assert [result.config[name] for name in ("evaluations", "scale", "seed", "runs")] == [30, 0.25, 5, 1]
    whole = mm.track(walk, subject, mm.TrackConfig("h-cmaes", scale=0.5, device="cpu"), evaluations=30)
    assert [whole.config[name] for name in ("evaluations", "scale", "seed", "runs")] == [30, 0.5, 0, 1]
    with pytest.raises(ValueError, match="evaluations must be"):
        mm.track(walk, subject, evaluations=0)
    with pytest.raises(TypeError, match="evaluation"):
        mm.track(walk, subject, evaluation=30)
    with pytest.raises(mm.InputError, match=r"scene.toml: \[fit\]: headings must be at least 1"):
        mm.fit(walk, made.body)
    with pytest.raises(ValueError, match="finalists must be at least 1"):
        mm.fit(walk, made.body, mm.FitConfig(), finalists=0)


def test_a_scene_is_drawn_below_its_result_alone(walk):
    result = synthetic_result(frames=2, cameras=5)
    late = replace(result, cameras=walk.rig(), frame_numbers=result.frame_numbers + 60)
    with pytest.raises(mm.InputError, match="has 64 frames, the result goes to frame 71"):
        mm.overlay(late, walk)
    with pytest.raises(mm.InputError, match="has the cameras cam1"):
        mm.overlay(result, walk)
