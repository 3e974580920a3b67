"""``mmocap track`` of a scene's folder: a second run with refined cameras where those that were given disagree."""

from __future__ import annotations

import os
import shutil
from dataclasses import replace

import pytest
from command_answer import answer

from mmocap_warp import cli
from mmocap_warp.cli import console
from mmocap_warp.errors import InputError
from mmocap_warp.formats.usd.usd_result import read_result

pytestmark = pytest.mark.usefixtures("no_network")


def test_cameras_that_disagree_are_refined_for_a_second_run(scene, result, capsys, monkeypatch):
    kept, asked = read_result(result), []

    def track(**given):
        asked.append(given.get("cameras"))
        assert not (given.get("resume") and given.get("force"))
        return replace(kept, config=kept.config | {"cameras": given.get("cameras", "as given")})

    monkeypatch.setattr("mmocap_warp.commands.track.track", track)
    monkeypatch.setattr("mmocap_warp.commands.show.show_all", lambda *_: {})
    for disagree, flags, runs in (
        ({"cam01": 20.0}, (), [None, "refine"]),
        ({"cam01": 20.0}, ("--resume",), [None, "refine"]),
        ({"cam01": 20.0}, ("--cameras", "as given"), ["as given"]),
        ({}, (), [None]),
    ):
        asked.clear()
        monkeypatch.setattr("mmocap_warp.result.verdict.verdict", lambda _, off=disagree: {"cameras": off})
        answer(capsys, "track", scene, *flags)
        assert asked == runs

    # What nobody has asked for may fail: the first run's result is told.
    def refined(**given):
        if given.get("cameras"):
            raise InputError("scene.toml", "tracked in 3 frames only", "choose other frames")
        return track(**given)

    monkeypatch.setattr("mmocap_warp.result.verdict.verdict", lambda _: {"cameras": {"cam01": 20.0}})
    monkeypatch.setattr("mmocap_warp.commands.track.track", refined)
    assert cli.main(["track", str(scene)]) == console.OK
    shown = capsys.readouterr()
    assert "cameras stay as they are: scene.toml: tracked in 3 frames only" in shown.err
    assert "mean IoU" in shown.out
    monkeypatch.setattr("mmocap_warp.commands.track.track", track)
    monkeypatch.setattr("mmocap_warp.result.verdict.verdict", lambda _: {"cameras": {}})

    # A second run that was interrupted goes on: its cameras are newer than the result of the first.
    first = scene.parent / "result.usdc"
    files = [first.with_name(f"result{end}") for end in (".usdc", ".usdc.checkpoint", ".calibration.toml")]
    shutil.copy(result, first) if first != result else None
    for file in files[1:]:
        file.touch()
    for age, runs in ((-10, ["refine"]), (10, [None])):
        asked.clear()
        now = files[-1].stat().st_mtime
        os.utime(first, (now + age, now + age))
        answer(capsys, "track", scene)
        assert asked == runs
    for file in files[1:]:
        file.unlink()


def test_a_result_that_was_mended_is_not_replaced_though_cameras_disagree(scene, result, capsys, monkeypatch):
    kept, asked = read_result(result), []
    mended = replace(kept, config=kept.config | {"mended": [{"frames": [2, 3]}]})
    monkeypatch.setattr("mmocap_warp.commands.track.track", lambda **given: asked.append(given) or mended)
    monkeypatch.setattr("mmocap_warp.commands.show.show_all", lambda *_: {})
    monkeypatch.setattr("mmocap_warp.result.verdict.verdict", lambda _: {"cameras": {"cam01": 20.0}})
    answer(capsys, "track", scene)
    assert [given.get("cameras") for given in asked] == [None]
