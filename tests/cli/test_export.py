"""``mmocap export`` and ``mmocap validate`` from the command line: which part of a result, and in which format."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd
from synthetic import synthetic_result

import mmocap_warp as mm
from mmocap_warp import cli
from mmocap_warp.cli import console
from mmocap_warp.formats.exports.rigs import RIGS
from mmocap_warp.formats.motion.captured_points import read_c3d, read_trc
from mmocap_warp.formats.motion.motion_clip import read_bvh
from mmocap_warp.formats.usd.usd_result import write_result
from mmocap_warp.result.excerpt import stood_up
from mmocap_warp.result.result import Result

SAME = 2e-6  # [m]


@pytest.fixture(scope="module")
def smoothed() -> Result:
    result = synthetic_result(frames=12, up="+z")
    return replace(result, raw_pose=result.pose + 0.05 * np.sin(np.arange(12))[:, None])


@pytest.fixture
def file(smoothed: Result, tmp_path: Path) -> Path:
    write_result(tmp_path / "walk.usdc", smoothed)
    return tmp_path / "walk.usdc"


def export(capsys, file: Path, name: str, *flags: str) -> dict:
    arguments = ["export", str(file), "-o", str(file.with_name(name)), *flags, "--json"]
    assert cli.main(arguments) == console.OK
    return json.loads(capsys.readouterr().out)


def places(file: Path, result: Result) -> np.ndarray:
    tracks = read_trc(file)
    return tracks.positions[:, [tracks.names.index(name) for name in result.subject.body.skeleton.joints]]


def joints(result: Result) -> np.ndarray:
    """(run, frame, joint, 3), Y up."""
    return stood_up(result, "+y").joints()


def test_the_best_run_by_default_another_or_all(file, smoothed, capsys):
    assert smoothed.best_run == 1
    for flags, run in (((), 1), (("--run", "0"), 0)):
        written = export(capsys, file, "a.trc", *flags, "--force")
        assert (written["frames"], written["up"]) == (12, "+y")
        np.testing.assert_allclose(places(Path(written["file"]), smoothed), joints(smoothed)[run], rtol=0, atol=SAME)
    written = export(capsys, file, "a.trc", "--run", "all")
    both = written["files"]
    assert written["file"] is None
    assert [Path(name).name for name in both] == ["a-run0.trc", "a-run1.trc"]
    for run, name in enumerate(both):
        np.testing.assert_allclose(places(Path(name), smoothed), joints(smoothed)[run], rtol=0, atol=SAME)


def test_the_track_before_it_was_smoothed(file, smoothed, capsys):
    export(capsys, file, "a.trc", "--raw")
    expected = joints(replace(smoothed, pose=smoothed.raw_pose))[1]
    np.testing.assert_allclose(places(file.with_name("a.trc"), smoothed), expected, rtol=0, atol=SAME)


def test_some_frames_at_another_rate(file, smoothed, capsys):
    written = export(capsys, file, "a.trc", "--frames", "12:20:2")
    assert (written["frames"], written["fps"]) == (4, pytest.approx(smoothed.fps / 2))
    np.testing.assert_allclose(
        places(file.with_name("a.trc"), smoothed), joints(smoothed)[1, 2:10:2], rtol=0, atol=SAME
    )
    assert read_trc(file.with_name("a.trc")).rate == pytest.approx(smoothed.fps / 2)
    written = export(capsys, file, "b.trc", "--fps", str(2 * smoothed.fps))
    assert written["frames"] == 23
    np.testing.assert_allclose(places(file.with_name("b.trc"), smoothed)[::2], joints(smoothed)[1], rtol=0, atol=SAME)


@pytest.mark.parametrize(("flags", "up"), [((), "Z"), (("--up", "y"), "Y"), (("--bake", "--up", "y"), "Y")])
def test_a_format_that_knows_its_vertical_keeps_the_world(file, capsys, flags, up):
    assert export(capsys, file, "a.usda", *flags)["up"] == f"+{up.lower()}"
    stage = Usd.Stage.Open(str(file.with_name("a.usda")))
    assert stage.GetMetadata("upAxis") == up
    assert any(prim.GetTypeName() == "Skeleton" for prim in stage.Traverse()) != ("--bake" in flags)


def test_a_c3d_keeps_the_world(file, smoothed, capsys):
    assert export(capsys, file, "a.c3d")["up"] == "+z"
    tracks = read_c3d(file.with_name("a.c3d"))
    np.testing.assert_allclose(tracks.positions[:, : len(smoothed.joints()[1, 0])], smoothed.joints()[1], atol=SAME)
    assert tracks.frame_numbers.tolist() == list(range(11, 23))
    assert export(capsys, file, "a.bvh", "--up", "y")["up"] == "+y"
    assert len(read_bvh(file.with_name("a.bvh")).place) == 12


@pytest.mark.parametrize("rig", RIGS)
def test_a_rig_has_its_own_names_and_the_same_motion(rig, file, smoothed, capsys):
    export(capsys, file, "a.trc", "--rig", rig)
    tracks = read_trc(file.with_name("a.trc"))
    assert tracks.names[0] == RIGS[rig].names["Root"]
    count = len(smoothed.subject.body.skeleton.joints)
    np.testing.assert_allclose(tracks.positions[:, :count], joints(smoothed)[1], rtol=0, atol=SAME)


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (["-o", "a.bvh", "--up", "z"], "--up z cannot be: BVH (.bvh) is always y up"),
        (
            ["-o", "a.csv", "--rig", "mixamo", "--joint-set", "isb"],
            "--joint-set goes by the body's own joints and skin",
        ),
        (["-o", "a.bvh", "--bake"], "--bake cannot write .bvh; end the output in USD point cache (.usda, .usdc"),
        (["-o", "a.bvh", "--run", "2"], '--run = 2 is neither "all" nor a run of this result, 0 to 1'),
        (["-o", "a.bvh", "--fps", "0"], "--fps must be positive and at most 5994, got 0"),
        (["-o", "a.bvh", "--fps", "1", "--frames", "11:12"], "has no frame in the 0 s of the result"),
        (["-o", "a.bvh", "--frames", "90:95"], "holds none of the result's frames, 10 to 21"),
    ],
)
def test_what_cannot_be_exported(file, capsys, monkeypatch, flags, words):
    monkeypatch.chdir(file.parent)
    assert cli.main(["export", str(file), *flags]) == console.USAGE
    assert words in capsys.readouterr().err
    assert [path.name for path in file.parent.iterdir()] == [file.name]


@pytest.mark.parametrize(
    ("up", "name", "frames", "told"),
    [("-y", "a.usda", 5, "+z"), ("+y", "a.usda", 5, "+y"), ("-y", "a.csv", 10, "-y")],
)
def test_what_was_written_is_told(up, name, frames, told, tmp_path, smoothed):
    uneven = stood_up(smoothed, up).at([0, 1, 3, 4, 9])
    written = mm.export(uneven, tmp_path / name)
    assert (written.frames, written.up) == (frames, told)
    if name == "a.usda":
        assert f'upAxis = "{told[1].upper()}"' in (tmp_path / name).read_text()
    with pytest.raises(mm.UsageError, match="up must be y or z, got x"):
        mm.export(uneven, tmp_path / "b.usda", up="x")


def test_a_track_that_was_not_smoothed_has_no_other(tmp_path, capsys):
    write_result(tmp_path / "walk.usdc", synthetic_result())
    flags = ["-o", str(tmp_path / "a.bvh"), "--raw"]
    assert cli.main(["export", str(tmp_path / "walk.usdc"), *flags]) == console.USAGE
    assert "--raw needs a result that was smoothed" in capsys.readouterr().err


def test_no_run_of_all_is_replaced_unasked(file, capsys):
    file.with_name("a-run1.bvh").write_text("mine")
    assert cli.main(["export", str(file), "-o", str(file.with_name("a.bvh")), "--run", "all"]) == console.BAD_INPUT
    assert "a-run1.bvh: exists already" in capsys.readouterr().err
    assert not file.with_name("a-run0.bvh").exists()


def test_check_says_what_is_wrong_and_exits_with_4(file, capsys):
    assert cli.main(["validate", str(file)]) == console.OK
    assert capsys.readouterr().out == f"{file}: nothing wrong\n"
    stage = Usd.Stage.Open(str(file))
    stage.GetPrimAtPath("/World/Boxes/Animation").RemoveProperty("scales")
    stage.Export(str(file.with_name("spoilt.usdc")))
    assert cli.main(["validate", str(file.with_name("spoilt.usdc")), "--json"]) == console.CHECK_FAILED
    found = json.loads(capsys.readouterr().out)["faults"]
    assert found == ["/World/Boxes/Animation: has no scales, so it shows the rest pose"]
    assert cli.main(["validate", str(file.with_name("none.usda"))]) == console.BAD_INPUT
