"""Who is told what a command does, and how a wrong argument is told."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

import mmocap_warp as mm
from mmocap_warp import cli
from mmocap_warp.cli import console
from mmocap_warp.commands.caller import Reporter, arguments_checked
from mmocap_warp.errors import InputError, UsageError
from mmocap_warp.scenes import ROOT


class Listener(Reporter):
    """Remembers progress."""

    def __init__(self) -> None:
        self.heard: list[tuple[str, int, int]] = []

    def progress(self, stage: str, done: int, total: int) -> None:
        """Remember it."""
        self.heard.append((stage, done, total))


def test_by_default_a_warning_is_pythons_and_names_the_callers_line():
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        reporter = Reporter()
        reporter.note("nobody hears this")
        reporter.warn("the truth is in another world")
    (warning,) = heard
    assert str(warning.message) == "the truth is in another world"
    assert Path(warning.filename) == Path(__file__)


def test_progress_is_heard_stage_by_stage():
    listener = Listener()
    with listener.stage("track") as progress:
        progress(1, 2, 500)
    with listener.stage("fit", None) as progress:
        progress(40, 100)
    assert listener.heard == [("track", 1, 2), ("fit", 40, 100)]


def test_a_wrong_argument_is_named_as_in_python_and_as_on_the_command_line():
    error = UsageError("--truth-axes needs a .trc; give --truth=FILE")
    assert str(error) == "truth_axes needs a .trc; give truth=FILE"
    assert error.flags == "--truth-axes needs a .trc; give --truth=FILE"
    assert isinstance(error, ValueError)


def test_a_settings_error_becomes_one_of_usage_and_others_stay():
    with pytest.raises(UsageError) as caught, arguments_checked():
        raise ValueError("rotation_radius must be positive")
    assert caught.value.flags == "--rotation-radius must be positive"
    for error in (InputError("scene.toml", "is missing", "make it"), UsageError("--fps 3")):
        with pytest.raises(type(error)) as same, arguments_checked():
            raise error
        assert same.value is error


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"runs": 1.5}, "runs must be a whole number, got 1.5"),
        ({"seed": True}, "seed must be a whole number, got True"),
        ({"limits": "no"}, "limits must be true or false, got 'no'"),
        ({"smooth": "2"}, "smooth must be a number, got '2'"),
        ({"seed": 2**31}, r"seed must be in 0"),
    ],
)
def test_settings_of_another_kind_are_named(settings, message):
    with pytest.raises(ValueError, match=message):
        mm.TrackConfig(**settings)
    assert mm.TrackConfig(seed=np.int64(3), smooth=2, threads=None, limits=True).seed == 3


def test_a_fraction_is_no_whole_number(capsys):
    assert cli.main(["track", str(ROOT / "walk"), "--runs", "2.5", "--resume", "--frames", "2"]) == console.USAGE
    assert "whole number" in capsys.readouterr().err
