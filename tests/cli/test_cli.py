"""The command line's manners: exit codes, what goes to which stream, what help does not import."""

from __future__ import annotations

import dataclasses
import io
import json
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import rich.console
from cyclopts import App, Argument

from mmocap_warp import cli
from mmocap_warp.cli import console
from mmocap_warp.cli.console import Console, table
from mmocap_warp.cli.progress import Progress
from mmocap_warp.errors import InputError

COMMANDS = ("demo", "init", "track", "fit", "mask", "cameras", "eval", "show", "view", "export", "validate", "body")


def test_help_names_every_command():
    answer = subprocess.run([sys.executable, "-m", "mmocap_warp", "--help"], capture_output=True, text=True)
    assert answer.returncode == console.OK
    assert answer.stderr == ""
    assert all(f" {command} " in answer.stdout for command in COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_itself(command, capsys):
    assert cli.main([command, "--help"]) == console.OK
    assert f"mmocap {command}" in capsys.readouterr().out


def test_the_page_on_the_command_line_lists_every_command():
    page = (Path(__file__).resolve().parents[2] / "docs" / "cli.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\| `([a-z]+)", page.split("## Exit codes")[0], re.MULTILINE)
    assert set(listed) == {name for name in cli.app if not name.startswith("-")}


def options(app: App, *path: str) -> Iterator[tuple[str, Argument]]:
    """Every option of every command, after the command's name."""
    for name in app:
        command = app[name]
        if not name.startswith("-") and command.default_command is not None:
            for option in command.assemble_argument_collection(parse_docstring=True):
                yield " ".join((*path, name)), option
        if not name.startswith("-"):
            yield from options(command, *path, name)


def test_every_option_explains_itself():
    every = [(command, option.name, option.parameter.help) for command, option in options(cli.app) if option.show]
    assert len(every) > 100
    assert [(command, name) for command, name, help_text in every if not help_text] == []


def test_help_writes_values_as_they_are_typed():
    helps = {(command, option.name): option.parameter.help for command, option in options(cli.app)}
    for command, name, value in (
        ("batch", "engine", "local"),
        ("study run", "engine", "ray"),
        ("calib convert", "units", "m"),
    ):
        assert re.search(rf"\b{value}\b", str(helps[command, f"--{name}"]))


def test_no_command_imports_warp_usd_or_opencv_to_show_its_help():
    heavy = "{'warp', 'pxr', 'cv2', 'numpy'} & set(sys.modules)"
    lines = [f"cli.main([{command!r}, '--help'])" for command in COMMANDS]
    code = "\n".join(["import sys", "from mmocap_warp import cli", *lines, f"sys.exit(str({heavy}) if {heavy} else 0)"])
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert answer.returncode == 0, answer.stderr


def test_version_names_what_results_depend_on(capsys):
    assert cli.main(["--version"]) == console.OK
    shown = capsys.readouterr().out.splitlines()
    assert len(shown) == 6
    names = ("mmocap-warp", "warp-lang", "usd-core", "opencv-python", "numpy", "Python")
    assert all(line.startswith(name) for line, name in zip(shown, names, strict=True))


@pytest.mark.parametrize(
    "arguments", [["dance"], ["track"], ["track", "--evaluations", "many", "scene.toml"], ["export", "--shout"]]
)
def test_wrong_usage_is_one_line_and_exit_2(arguments, capsys):
    assert cli.main(arguments) == console.USAGE
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.startswith("mmocap: ")
    assert shown.err.count("\n") == 1


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (InputError("scene.toml", "no cameras", "add [cameras]"), console.BAD_INPUT, "scene.toml: no cameras; add"),
        (KeyboardInterrupt(), console.INTERRUPTED, "interrupted"),
        (RuntimeError("first\nsecond"), console.FAILURE, "unexpected RuntimeError: first second"),
        (PermissionError(13, "Permission denied", "elsewhere/x"), console.FAILURE, "Permission denied"),
    ],
)
def test_an_error_is_one_line_and_its_own_exit_code(error, code, words, monkeypatch, capsys):
    def broken(*_, **__):
        raise error

    monkeypatch.delenv("MMOCAP_DEBUG", raising=False)
    monkeypatch.setattr(cli, "app", broken)
    assert cli.main(["cameras", "scene.toml"]) == code
    shown = capsys.readouterr()
    assert shown.out == ""
    assert words in shown.err
    assert shown.err.count("\n") == 1


def test_debug_shows_the_traceback(monkeypatch):
    def broken(*_, **__):
        raise RuntimeError("here")

    monkeypatch.setattr(cli, "app", broken)
    with pytest.raises(RuntimeError, match="here"):
        cli.main(["cameras", "scene.toml", "--debug"])
    monkeypatch.setenv("MMOCAP_DEBUG", "1")
    with pytest.raises(RuntimeError, match="here"):
        cli.main(["cameras", "scene.toml"])


def test_json_is_one_object_in_plain_types(capsys):
    values = {"a": np.float32(1.5), "b": np.array([1, 2]), "c": float("nan"), "d": (True, None), "e": {"f": np.inf}}
    Console(json=True).result(values, "for people")
    assert json.loads(capsys.readouterr().out) == {
        "a": 1.5,
        "b": [1, 2],
        "c": None,
        "d": [True, None],
        "e": {"f": None},
    }


def test_quiet_keeps_notes_to_itself(capsys):
    Console(quiet=True).note("working")
    Console().note("still working")
    assert capsys.readouterr().err == "still working\n"


def test_progress_off_a_terminal_writes_plain_lines():
    stream = io.StringIO()
    with Progress("tracking", stream=stream) as progress:
        progress(5, 10, 1000)
        time.sleep(0.01)
        progress(10, 10, 6000)
    shown = stream.getvalue()
    assert shown.startswith("tracking: 10/10 frames, ")
    assert "frames/s" in shown
    assert "evaluations/s" in shown
    assert shown.count("\n") == 1
    assert "\x1b" not in shown


def test_progress_on_a_terminal_draws_a_bar():
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    stream = Terminal()
    with Progress("tracking", stream=stream) as progress:
        progress(0, 10)
        time.sleep(0.01)
        progress(5, 10, 2500)
    assert "tracking" in stream.getvalue()


def test_table_aligns_its_values():
    assert table([("a", "1"), ("long", "2")]) == "a     1\nlong  2"


def test_every_setting_of_a_run_is_a_flag_and_every_flag_of_a_fit_a_setting():
    from mmocap_warp.cli.result_commands import FitFlags, TrackFlags
    from mmocap_warp.fitting.subject_fit import FitConfig
    from mmocap_warp.tracking.track_config import TrackConfig

    def names(kind: type) -> set[str]:
        return {field.name for field in dataclasses.fields(kind)}

    assert names(TrackFlags) == names(TrackConfig)
    assert names(FitFlags) < names(FitConfig)


def test_help_names_every_algorithm(capsys):
    from mmocap_warp.tracking.algorithms import ALGORITHMS

    assert cli.main(["track", "--help"]) == console.OK
    shown = capsys.readouterr().out
    assert all(name in shown for name in ALGORITHMS)


ALL_COMMANDS = (
    *COMMANDS[:-1], "batch", "sync", "measure", "synth", "bench",
    *(f"calib {name}" for name in ("convert", "check", "refine", "solve")),
    *(f"body {name}" for name in ("import", "export", "learn", "show")),
    *(f"study {name}" for name in ("make", "run", "show", "report")),
)  # fmt: skip


@pytest.mark.parametrize("command", ALL_COMMANDS)
def test_help_is_whole(command, monkeypatch, capsys):
    """Every option says what it is, on one line where the terminal is wide enough, and none is the parser's own."""
    monkeypatch.setattr(cli.app, "console", rich.console.Console(width=2000))  # one made before has its own width
    assert cli.main([*command.split(), "--help"]) == console.OK
    shown = capsys.readouterr().out
    rows = [line.strip("│ *") for line in shown.splitlines() if line.startswith("│")]
    assert rows
    assert [row for row in rows if len(row.split("  ", 1)) < 2] == []
    assert not any("--empty" in row for row in rows)


def test_help_names_every_preset(capsys):
    from mmocap_warp.tracking.algorithms import PRESETS

    assert cli.main(["track", "--help"]) == console.OK
    shown = capsys.readouterr().out
    assert all(name in shown for name in PRESETS)
