"""``import mmocap_warp as mm``: the names, lazily, and those that type checkers see."""

from __future__ import annotations

import ast
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from synthetic import synthetic_body, synthetic_result
from walk_scene import walking

import mmocap_warp as mm
from mmocap_warp.formats.usd.usd_body import read_subject
from mmocap_warp.scenes import ROOT
from mmocap_warp.silhouettes import COSTS, RENDERERS
from mmocap_warp.tracking.algorithms import ALGORITHMS, CONTOUR_TRACKERS, PRESETS


def test_every_name_is_there_documented_and_typed():
    for name in mm.__all__:
        assert getattr(mm, name).__doc__
    assert set(dir(mm)) == set(mm.__all__)
    stub = ast.parse(Path(mm.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    (stated,) = (each.value for each in stub.body if isinstance(each, ast.Assign))
    assert set(ast.literal_eval(stated)) == set(mm.__all__)


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
    for wrong in ({"threads": 0}, {"seed": -1}):
        with pytest.raises(ValueError, match=f"{next(iter(wrong))} must be"):
            mm.FitConfig(**wrong)
    with pytest.raises(ValueError, match="finalists must be at least 1"):
        mm.fit(walk, made.body, mm.FitConfig(), finalists=0)


class Listener(mm.Reporter):
    """Remembers notes and the stages of progress."""

    def __init__(self) -> None:
        self.notes: list[str] = []
        self.stages: dict[str, tuple[int, int]] = {}

    def note(self, line: str) -> None:
        """Remember it."""
        self.notes.append(line)

    def progress(self, stage: str, done: int, total: int) -> None:
        """Remember the last of each stage."""
        self.stages[stage] = done, total


def test_a_body_is_fitted_and_then_tracked(walk, tmp_path, monkeypatch):
    monkeypatch.setattr("mmocap_warp.fitting.subject_fit._ROUNDS", 1)
    quick = replace(walk, fit={"headings": 2, "evaluations": 48, "finalists": 1, "frames": 1, "scale": 0.25})
    listener, output = Listener(), tmp_path / "walk.usdc"
    settings = {"algorithm": "contour", "smooth": 0.0, "evaluations": 1, "device": "cpu"}
    result = mm.track(quick, synthetic_body(), output=output, reporter=listener, **settings)
    assert listener.stages == {"fit": (100, 100), "track": (2, 2)}
    assert [note.split(":")[0] for note in listener.notes] == ["fit", "track"]
    kept = read_subject(tmp_path / "walk.subject.usdc")
    assert kept.provenance["fit.evaluations"] == 48
    again = mm.track(quick, kept, **settings)
    np.testing.assert_array_equal(again.pose, result.pose)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["walk.subject.usdc", "walk.usdc"]
    in_memory, from_file = mm.evaluate(again), mm.evaluate(output)  # both find the scene and its truth
    assert all(in_memory[key] == from_file[key] for key in ("mean_iou", "mpjpe_mm", "marker_error_mm"))
    with pytest.warns(UserWarning, match=r"give the scene, or the result as a file"):
        assert "mpjpe_mm" not in mm.evaluate(result)
    with pytest.raises(mm.InputError, match=r"walk.usdc: exists already"):
        mm.track(quick, kept, output=output)


def test_what_is_neither_an_object_nor_a_path_is_told_so(walk):
    result = synthetic_result()
    with pytest.raises(TypeError, match=r"subject must be a Subject, .*, or a BodyModel, .*, not a Result"):
        mm.track(walk, result)
    with pytest.raises(TypeError, match="scene must be a Scene or the path of one, not a int"):
        mm.track(3)
    with pytest.raises(TypeError, match="body must be a BodyModel, the name of one or its path, not a Result"):
        mm.fit(replace(walk, fit={}), result)
    with pytest.raises(TypeError, match="result must be a Result or the path of one, not a Scene"):
        mm.evaluate(walk)


def test_wrong_arguments_are_named_as_in_python(walk):
    result = synthetic_result()
    with pytest.raises(mm.UsageError, match=r"^frames = 90:95 holds none of the result's frames, 10 to 15"):
        mm.measure(result, frames="90:95")
    with pytest.raises(mm.UsageError, match=r"^resume and force cannot both be given"):
        mm.track(walk, resume=True, force=True)
    with pytest.raises(mm.UsageError, match=r"^output is missing"):
        mm.show(result)
    with pytest.raises(IndexError, match="frame must be 0 to 5, for the recording's 10 to 15, got 999"):
        mm.overlay(result, frame=999)


def test_things_say_what_they_are_in_a_line_or_a_small_table(walk):
    result = synthetic_result(frames=2, cameras=5)
    assert repr(walk) == (
        "Scene walk: 2 frames, 0 to 1, at 60 a second; cameras cam1, cam2, cam3, cam4, cam5; foreground from masks; "
        f"{walk.path}"
    )
    assert repr(result.subject.body).startswith("BodyModel ")
    assert repr(result.subject).startswith(f"Subject {result.subject.body.name}, starts at (")
    assert repr(result).startswith(f"Result of {result.subject.body.name} by ")
    table = repr(walk.rig()).splitlines()
    assert table[0] == "CameraRig: 5 cameras, +z up"
    assert [row.split()[0] for row in table[1:]] == list(walk.rig().names)
    assert max(map(len, (repr(walk.rig()).splitlines()))) < 100


def test_a_configuration_says_what_its_settings_mean():
    for kind in (mm.TrackConfig, mm.FitConfig):
        for each in fields(kind):
            assert f"\n    {each.name}: {each.metadata['meaning']} [default: " in kind.__doc__
    for choices in (ALGORITHMS, CONTOUR_TRACKERS, PRESETS, COSTS, RENDERERS):
        assert all(name in mm.TrackConfig.__doc__ for name in choices)


def test_a_scene_is_drawn_below_its_result_alone(walk):
    result = synthetic_result(frames=2, cameras=5)
    late = replace(result, cameras=walk.rig(), frame_numbers=result.frame_numbers + 60)
    with pytest.raises(mm.InputError, match="has 64 frames, the result goes to frame 71"):
        mm.overlay(late, walk)
    with pytest.raises(mm.InputError, match="has the cameras cam1"):
        mm.overlay(result, walk)
