"""A command of the command line has the parameters of the function that does its work."""

from __future__ import annotations

import inspect
import json
import signal
from inspect import Parameter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mmocap_warp.cli.command import BY_FLAG, Answer, Given, _undisturbed, command
from mmocap_warp.cli.console import CHECK_FAILED, Console
from mmocap_warp.cli.scene_commands import _mask_step
from mmocap_warp.commands import new_scenes


@command("new_scenes:synthesize", motion=None, seed=Given(int, 3), note=str)
def made(call: Any, output: Path, note: str | None) -> Answer:
    return Answer({"made": call(cameras=2), "output": output, "note": note}, ["made", output], CHECK_FAILED)


def parameters() -> dict[str, Parameter]:
    return dict(inspect.signature(made).parameters)


def test_what_has_no_default_is_known_by_its_place_but_for_the_output():
    places = [name for name, each in parameters().items() if each.kind is Parameter.POSITIONAL_ONLY]
    assert places == ["body"]
    assert parameters()["output"].kind is BY_FLAG
    assert parameters()["output"].default is Parameter.empty


def test_defaults_are_the_functions_unless_others_are_given():
    assert parameters()["size"].default == (640, 480)
    assert parameters()["seed"].default == 3


def test_the_output_comes_first_and_force_last_of_the_flags():
    flags = [name for name, each in parameters().items() if each.kind is BY_FLAG]
    assert flags == ["output", "cameras", "size", "perfect", "seed", "note", "force", "console"]


def test_the_work_gets_what_was_given_and_the_console(monkeypatch, capsys):
    asked: dict[str, Any] = {}
    monkeypatch.setattr(new_scenes, "synthesize", lambda **arguments: asked.update(arguments) or "scene")
    console = Console(json=True)
    assert made("fox", output=Path("o"), note="n", console=console) == CHECK_FAILED
    assert json.loads(capsys.readouterr().out) == {"made": "scene", "output": "o", "note": "n"}
    assert asked == {
        "body": "fox", "output": Path("o"), "cameras": 2, "size": (640, 480), "perfect": False, "seed": 3,
        "force": False, "reporter": console,
    }  # fmt: skip


def test_for_people_there_are_lines(monkeypatch, capsys):
    monkeypatch.setattr(new_scenes, "synthesize", lambda **_: "scene")
    made("fox", output=Path("o"))
    assert capsys.readouterr().out == "made\no\n"


def test_the_help_is_the_docstring_with_capitals():
    assert "    motion: Which of its motions." in inspect.getdoc(made)


def test_a_function_that_is_not_there_is_an_error():
    with pytest.raises(ValueError, match="unpack"):
        command("new_scenes:nothing")


@pytest.mark.parametrize(
    ("size", "track", "options"),
    [
        ((640, 480), {}, ""),
        ((720, 960), {}, ""),
        ((1280, 720), {}, " --scale 0.5"),
        ((1920, 1080), {}, " --scale 0.5"),
        ((1080, 1920), {}, " --scale 0.25"),
        ((3840, 2160), {}, " --scale 0.25"),
        ((1920, 1080), {"scale": 0.5}, ""),
    ],
)
def test_the_next_command_scales_large_images(size, track, options):
    calibrated = SimpleNamespace(size=np.array([[480, 640], size]))
    step = _mask_step(SimpleNamespace(calibrated=calibrated, track=track, path=Path("scene.toml")))
    assert step == f"mmocap mask scene.toml -o masks{options}"


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="Windows has no masks of signals")
def test_a_signal_waits_until_all_is_imported():
    done = []

    def imported():
        with _undisturbed():
            signal.raise_signal(signal.SIGINT)
            done.append("imported")
        done.append("begun")

    with pytest.raises(KeyboardInterrupt):
        imported()
    assert done == ["imported"]
