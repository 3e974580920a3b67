"""``mmocap measure`` as a user calls it."""

import json
from dataclasses import replace

import numpy as np
import pytest
from measured import answer, made_walk
from other_bodies import quadruped

import mmocap_warp as mm
from mmocap_warp import cli
from mmocap_warp.cli import console
from mmocap_warp.formats.usd.usd_result import write_result
from mmocap_warp.rigging.shipped import load_body


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder, body = tmp_path_factory.mktemp("measure"), load_body("adult_man")
    result = answer(body, made_walk(body, cycles=1.3, fps=60.0)[0], runs=2, up="+z")
    write_result(folder / "walk.usdc", replace(result, raw_pose=result.pose + 0.01))
    dog = quadruped()
    write_result(folder / "dog.usdc", answer(dog, np.zeros((3, dog.skeleton.coordinates))))
    return folder


def test_a_table_for_people(results, capsys):
    assert cli.main(["measure", str(results / "walk.usdc")]) == console.OK
    out = capsys.readouterr().out
    for words in ("RKnee", "internal rotation", "heel strikes", "cadence: 11", "centre of mass [m]", "LHip to LKnee"):
        assert words in out
    assert "left out" not in out


def test_one_object_for_programs_and_files_in_a_folder(results, tmp_path, capsys):
    arguments = ["measure", str(results / "walk.usdc"), "-o", str(tmp_path / "m"), "--json", "--sex", "male"]
    assert cli.main(arguments) == console.OK
    values = json.loads(capsys.readouterr().out)
    assert [run["run"] for run in values["per_run"]] == [0, 1]
    assert values["shares_of_mass"] == "male"
    assert values["lengths_mm"]["LHip to LKnee"]["sigma"] is None
    names = {"angles", "joints", "centre_of_mass", "contacts", "events", "lengths"}
    expected = {f"{name}.csv" for name in names} | {"angles.svg", "feet.svg"}
    assert {path.name for path in (tmp_path / "m").iterdir()} == expected
    assert {path.rsplit("/", 1)[1] for path in values["files"]} == expected
    assert cli.main(arguments) == console.BAD_INPUT  # it holds files now
    assert cli.main([*arguments, "--force"]) == console.OK


def test_one_run_the_raw_track_some_frames(results, capsys):
    walk = str(results / "walk.usdc")
    assert cli.main(["measure", walk, "--run", "1", "--raw", "--frames", "10:30", "--json"]) == console.OK
    values = json.loads(capsys.readouterr().out)
    assert [run["run"] for run in values["per_run"]] == [1]
    assert (values["frames"], values["track"]) == (20, "raw")


def test_a_sex_that_there_is_not(results):
    with pytest.raises(mm.UsageError, match="sex must be female or male, got Female"):
        mm.measure(results / "walk.usdc", sex="Female")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [(["--run", "2"], "--run must be 0 to 1, got 2"), (["--frames", "900:910"], "holds none of the result's frames")],
)
def test_wrong_usage(results, capsys, arguments, words):
    assert cli.main(["measure", str(results / "walk.usdc"), *arguments]) == console.USAGE
    assert words in capsys.readouterr().err


def test_a_track_that_was_not_smoothed_has_no_raw_one(results, capsys):
    assert cli.main(["measure", str(results / "dog.usdc"), "--raw"]) == console.USAGE
    assert "--raw needs a result that was smoothed" in capsys.readouterr().err


def test_a_dog_has_its_own_angles_and_feet(results, tmp_path, capsys):
    assert cli.main(["measure", str(results / "dog.usdc"), "-o", str(tmp_path)]) == console.OK
    out = capsys.readouterr().out
    assert "left out, because the body lacks their joints: centre of mass" in out
    assert all(f"{end}{joint}" in out for end in ("LFore", "RHind") for joint in ("Hip", "Knee"))
    names = {"angles.csv", "angles.svg", "contacts.csv", "feet.svg", "joints.csv", "lengths.csv"}
    assert {path.name for path in tmp_path.iterdir()} == names
