"""The commands one after the other on a small made-up recording, as a user calls them."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from command_answer import answer
from moving_figure import FRAMES, PROMISED, PROMISED_WITH_TRUTH, SCENE
from person_skeleton import JOINTS
from pxr import Usd, UsdGeom

from mmocap_warp import cli
from mmocap_warp.cli import console
from mmocap_warp.formats.truth_file import read_truth
from mmocap_warp.formats.usd.usd_body import read_subject, write_subject
from mmocap_warp.formats.usd.usd_check import faults
from mmocap_warp.formats.usd.usd_result import read_result
from mmocap_warp.result.evaluation import evaluate
from mmocap_warp.scenes import ROOT

FEW = ("--frames", "0:3")
"""As many frames as show that a flag is taken."""

pytestmark = pytest.mark.usefixtures("no_network")


def same_bits(left: Path, right: Path) -> bool:
    """Equal poses, costs and overlaps; times and the wall clock aside."""
    a, b = read_result(left), read_result(right)
    names = ("pose", "cost", "iou", "evaluations", "status")
    return all(np.array_equal(getattr(a, name), getattr(b, name), equal_nan=True) for name in names)


def test_track_says_how_good_the_result_is(scene, tmp_path, capsys):
    report = answer(capsys, "track", scene, "-o", tmp_path / "r.usdc")
    assert all(report[key] is not None for key in (*PROMISED, *PROMISED_WITH_TRUTH))
    assert report["frames"] == FRAMES
    assert 0 < report["evaluations"] <= FRAMES * 60  # where a frame needed a search
    assert report["config"]["evaluations"] == 60  # from scene.toml
    assert [file.name for file in tmp_path.iterdir()] == ["r.usdc"]
    assert faults(tmp_path / "r.usdc") == []


def test_a_flag_wins_over_the_scene(scene, tmp_path, capsys):
    report = answer(capsys, "track", scene, "-o", tmp_path / "r.usdc", "--evaluations", 30, "--runs", 2, *FEW)
    assert report["config"]["evaluations"] == 30
    assert 0 < report["evaluations"] <= 2 * 3 * 30


def test_settings_are_shown_with_where_they_come_from(scene, tmp_path, capsys):
    assert cli.main(["track", str(scene), "-o", str(tmp_path / "r.usdc"), "--seed", "5", *FEW]) == console.OK
    shown = capsys.readouterr().err
    assert "evaluations 60 (scene.toml)" in shown
    assert "seed 5 (flag)" in shown
    assert "dof 39," in shown


def test_wrong_flags_are_wrong_usage(scene, tmp_path, capsys):
    for flags in (["--evaluations", "0"], ["--device", "tpu"], ["--algorithm", "sgd"], ["--resume", "--force"]):
        assert cli.main(["track", str(scene), "-o", str(tmp_path / "r.usdc"), *flags]) == console.USAGE
        shown = capsys.readouterr()
        assert flags[0] in shown.err
        assert shown.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_a_result_is_replaced_only_by_force(scene, tmp_path, capsys):
    command = ["track", str(scene), "-o", str(tmp_path / "r.usdc"), "--quiet", *FEW]
    assert cli.main(command) == console.OK
    before = (tmp_path / "r.usdc").stat().st_mtime_ns
    assert cli.main(command) == console.BAD_INPUT
    assert cli.main([*command, "--resume"]) == console.OK  # complete: nothing to do
    capsys.readouterr()
    subject = read_subject(scene.parent / "subject.usdc")
    write_subject(tmp_path / "other.usdc", replace(subject, pose=subject.pose + 0.001))
    for other in (["--evaluations", "9", *FEW], ["--frames", "0:2"], ["--subject", str(tmp_path / "other.usdc"), *FEW]):
        assert cli.main([*command[: -len(FEW)], *other, "--resume"]) == console.BAD_INPUT
        assert "is of other frames, settings, cameras or masks than are asked for now" in capsys.readouterr().err
    assert (tmp_path / "r.usdc").stat().st_mtime_ns == before
    result = str(tmp_path / "r.usdc")
    assert cli.main(["export", result, "-o", result, "--force"]) == console.BAD_INPUT  # an animation is less
    assert (tmp_path / "r.usdc").stat().st_mtime_ns == before
    assert cli.main([*command, "--force"]) == console.OK
    assert (tmp_path / "r.usdc").stat().st_mtime_ns > before


EAGER = """
import os, signal, sys
from mmocap_warp import cli
from mmocap_warp.tracking import checkpoint

checkpoint._INTERVAL = 0
save, held = checkpoint.Checkpoint.save, []

def save_and_wait(self, *args):
    save(self, *args)
    if not held:
        held.append(True)
        os.kill(os.getpid(), signal.SIGSTOP)

checkpoint.Checkpoint.save = save_and_wait
sys.exit(cli.main(sys.argv[1:]))
"""
"""Runs the command line with a checkpoint after every frame, and stops at the first until it is told to go on."""


LONG = ("--quiet", "--evaluations", "120")
STOPS = {
    signal.SIGKILL: (-signal.SIGKILL, ""),
    signal.SIGINT: (console.INTERRUPTED, "mmocap: interrupted\n"),
    signal.SIGTERM: (console.TERMINATED, "mmocap: terminated\n"),
}
"""Each with the exit code and the words that it ends with."""


@pytest.fixture(scope="module")
def whole(scene) -> Path:
    """The result of a long run that nothing stopped."""
    path = scene.parent / "whole.usdc"
    assert cli.main(["track", str(scene), "-o", str(path), *LONG]) == console.OK
    return path


@pytest.mark.parametrize(
    "how", [pytest.param(signal.SIGKILL, marks=pytest.mark.nightly), signal.SIGINT, signal.SIGTERM]
)
def test_a_stopped_run_resumes_to_the_same_bits(how, scene, whole, tmp_path, capfd):
    stopped = tmp_path / "stopped.usdc"
    command = ["track", str(scene), "-o", str(stopped), *LONG]
    checkpoint = stopped.with_name("stopped.usdc.checkpoint")
    run = subprocess.Popen([sys.executable, "-c", EAGER, *command])
    os.waitpid(run.pid, os.WUNTRACED)  # until it stands at its first checkpoint
    assert cli.main([*command, "--resume"]) == console.BAD_INPUT
    assert "stopped.usdc: another mmocap is writing it" in capfd.readouterr().err
    run.send_signal(how)
    run.send_signal(signal.SIGCONT)
    assert (run.wait(), capfd.readouterr().err) == STOPS[how]
    assert checkpoint.exists()
    assert not stopped.exists()
    assert cli.main(command) == console.BAD_INPUT
    assert cli.main([*command, "--resume"]) == console.OK
    assert same_bits(whole, stopped)
    assert not checkpoint.exists()


def test_eval_repeats_what_track_said(scene, result, capsys):
    report = answer(capsys, "eval", result)
    assert all(report[key] is not None for key in (*PROMISED, *PROMISED_WITH_TRUTH))
    assert len(report["series"]["frame"]) == FRAMES
    named = answer(capsys, "eval", result, "--truth", scene.parent / "truth.usdc")
    assert named == report


def write_trc(path: Path, joints: np.ndarray, units: str = "m") -> Path:
    """Joints (frame, joint, 3) as OpenSim's format has them."""
    head = ["PathFileType\t4\t(X/Y/Z)\tt.trc", "DataRate\tNumMarkers\tUnits", f"60\t{len(JOINTS)}\t{units}"]
    rows = ["\t".join([f"{f + 1}", f"{f / 60}", *map(str, row.ravel())]) for f, row in enumerate(joints)]
    path.write_text("\n".join([*head, "Frame#\tTime\t" + "\t\t\t".join(JOINTS), "", *rows]))
    return path


@pytest.mark.parametrize(("order", "axes"), [([2, 0, 1], "yzx"), ([0, 2, 1], "xz-y")])
def test_eval_names_the_axes_of_a_truth_in_other_axes(result, scene, tmp_path, capsys, order, axes):
    joints = read_truth(scene.parent / "truth.usdc").joints[..., order] * ([1, -1, 1] if "-" in axes else 1)
    truth = write_trc(tmp_path / "t.trc", joints)
    assert cli.main(["eval", str(result), "--truth", str(truth), "--json"]) == console.CHECK_FAILED
    told = capsys.readouterr()
    report = json.loads(told.out)
    assert report["mpjpe_mm"] > 1000
    assert report["other_world"]["axes"] == axes
    assert f"has other axes than the result: give --truth-axes={axes} (joints are off by" in told.err
    right = answer(capsys, "eval", result, "--truth", truth, f"--truth-axes={axes}")
    assert right["mpjpe_mm"] == pytest.approx(report["other_world"]["mpjpe_mm"])
    assert right["other_world"] is None
    assert cli.main(["eval", str(result), "--truth", str(truth), "--truth-axes", "zxy"]) == console.CHECK_FAILED
    assert f"give --truth-axes={axes}" in capsys.readouterr().err  # of the file's own axes, whatever was given


def test_axes_that_are_given_win_over_those_of_the_scenes_own_truth(result, scene, tmp_path, capsys):
    shutil.copytree(scene.parent, tmp_path / "scene")
    truth = write_trc(tmp_path / "scene" / "t.trc", read_truth(scene.parent / "truth.usdc").joints[..., [2, 0, 1]])
    named = tmp_path / "scene" / "scene.toml"
    named.write_text(named.read_text().replace('file = "truth.usdc"', f'file = "{truth.name}"'))
    asked = ["eval", str(result), "--scene", str(named)]
    for axes in ([], ["--truth-axes=zxy"]):
        assert cli.main([*asked, *axes]) == console.CHECK_FAILED
    assert "give --truth-axes=yzx" in capsys.readouterr().err
    assert answer(capsys, *asked, "--truth-axes=yzx")["other_world"] is None
    named.write_text(named.read_text().replace(f'file = "{truth.name}"', ""))
    assert cli.main([*asked, "--truth-axes=yzx"]) == console.USAGE
    assert "give its file with --truth" in capsys.readouterr().err


def test_eval_says_how_many_frames_the_truth_has(result, tmp_path, capsys):
    truth = tmp_path / "t.trc"
    answer(capsys, "export", result, "-o", truth, "--frames", ":5")
    for part, row in (((), ["with", "truth", "5", "frames"]), (("--frames", ":5"), None)):
        cli.main(["eval", str(result), "--truth", str(truth), "--truth-axes=x-zy", *part])
        rows = map(str.split, capsys.readouterr().out.splitlines())
        assert [each for each in rows if each[:2] == ["with", "truth"]] == [row] * (row is not None)


def test_eval_names_other_origins_and_units(result, scene, tmp_path, capsys):
    joints = read_truth(scene.parent / "truth.usdc").joints
    for truth, words in (
        (
            write_trc(tmp_path / "a.trc", joints + np.array([3, 0, 4])),
            "than the result: 5.0 m away; give it in metres in",
        ),
        (
            write_trc(tmp_path / "b.trc", 1000 * joints),
            r"than the result: about 1000 times as large; give it in metres",
        ),
    ):
        assert cli.main(["eval", str(result), "--truth", str(truth)]) == console.CHECK_FAILED
        assert words in capsys.readouterr().err


def test_a_track_that_is_lost_is_not_blamed_on_the_truth(result, scene):
    truth, tracked = read_truth(scene.parent / "truth.usdc"), read_result(result)
    pose = tracked.pose.copy()
    pose[..., :3] += [3, 0, 0]
    pose[..., 6:] += np.random.default_rng(0).normal(0, 1, pose[..., 6:].shape)
    assert evaluate(replace(tracked, pose=pose), truth)["other_world"] is None
    turned = tracked.pose.copy()
    turned[..., 4] += np.pi  # back to front, where it stands
    assert evaluate(replace(tracked, pose=turned), truth)["other_world"] is None


def test_commands_take_some_frames(scene, result, tmp_path, capsys):
    """Numbers and times stay the recording's, so that the truth is found."""
    report = answer(capsys, "track", scene, "-o", tmp_path / "r.usdc", "--seed", 3, "--frames", "0:7:2")
    assert (report["frames"], report["truth_frames"]) == (4, 4)
    assert report["mpjpe_mm"] < 30
    part = read_result(tmp_path / "r.usdc")
    assert (part.frame_numbers.tolist(), part.fps, part.rate) == ([0, 2, 4, 6], 60, 30)
    stage = Usd.Stage.Open(str(tmp_path / "r.usdc"))
    assert (stage.GetTimeCodesPerSecond(), stage.GetEndTimeCode()) == (60, 6)
    assert answer(capsys, "eval", tmp_path / "r.usdc")["series"]["frame"] == [0, 2, 4, 6]
    some = answer(capsys, "eval", tmp_path / "r.usdc", "--frames", "3:")
    assert some["series"]["frame"] == [4, 6]
    assert some["eq20_as_printed_mm"] is None  # the first pose is that of frame 0
    drawn = answer(capsys, "show", tmp_path / "r.usdc", "--frames", 3)
    video = cv2.VideoCapture(drawn["video"])
    assert (video.get(cv2.CAP_PROP_FRAME_COUNT), video.get(cv2.CAP_PROP_FPS)) == (3, 30)


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["track", "SCENE", "-o", "r.usdc", "--frames", "4:9"], console.USAGE, "--frames = 4:9 is not in 0:8"),
        (["track", "SCENE", "-o", "r.usdc", "--frames", "first"], console.USAGE, "--frames = first is neither"),
        (
            ["track", "SCENE", "-o", "r.usdc", "--frames", "4:"],
            console.BAD_INPUT,
            "was fitted to frame 0, but tracking",
        ),
        (["fit", "SCENE", "-o", "r.usdc", "--frames", "9"], console.USAGE, "--frames = 9 is not in 1 to 8"),
        (["eval", "RESULT", "--frames", "9:12"], console.USAGE, "holds none of the result's frames, 0 to 7"),
        (["show", "RESULT", "--frames", "2:1"], console.USAGE, "--frames = 2:1 holds no frame"),
        (["show", "SUBJECT", "--frames", "2"], console.USAGE, "--strip need a result"),
        (
            ["track", "SCENE", "--again", "RESULT", "-o", "r.usdc", "--frames", ":8"],
            console.USAGE,
            "not all of the result's 0 to 7 (8)",
        ),
        (["track", "SCENE", "--again", "RESULT", "--frames", "2:4"], console.USAGE, "--again needs --output"),
        (["sync", "SCENE", "--frames", "::2"], console.USAGE, "--frames must be first:end or a count"),
        (["eval", "RESULT", "--scene", "WALK"], console.BAD_INPUT, "name the scene that was tracked"),
        (["eval", "FOLDER"], console.BAD_INPUT, "is a folder; name a USD file"),
        (["measure", "RESULT", "-o", "out", "--run", "9"], console.USAGE, "--run must be 0"),
        (["fit", "SCENE", "-o", "TRUTH", "--force"], console.BAD_INPUT, "is the truth that the scene names"),
        (["track", "SCENE", "-o", "TRUTH", "--force"], console.BAD_INPUT, "is the truth that the scene names"),
    ],
)
def test_frames_that_cannot_be(scene, result, tmp_path, capsys, monkeypatch, arguments, code, words):
    monkeypatch.chdir(tmp_path)
    files = {"SCENE": str(scene), "RESULT": str(result), "SUBJECT": str(scene.parent / "subject.usdc")}
    files |= {"WALK": str(ROOT / "walk"), "FOLDER": str(scene.parent), "TRUTH": str(scene.parent / "truth.usdc")}
    assert cli.main([files.get(word, word) for word in arguments]) == code
    assert words in capsys.readouterr().err
    assert not any(tmp_path.iterdir())


def test_an_export_is_turned_when_asked(result, tmp_path, capsys):
    for flags, axis in (((), "Y"), (("--up", "z"), "Z"), (("--up", "y"), "Y")):
        written = answer(capsys, "export", result, "-o", tmp_path / f"{len(flags)}{axis}.usda", *flags)
        assert UsdGeom.GetStageUpAxis(Usd.Stage.Open(written["file"])) == axis
        assert written["up"] == f"+{axis.lower()}"


def test_show_and_export_write_what_they_say(result, tmp_path, capsys):
    drawn = answer(capsys, "show", result, "-o", tmp_path / "r.webm")
    assert cv2.VideoCapture(drawn["video"]).get(cv2.CAP_PROP_FRAME_COUNT) == FRAMES
    assert cv2.imread(drawn["sheet"]) is not None
    for suffix in ("usda", "usdc", "usdz"):
        written = answer(capsys, "export", result, "-o", tmp_path / f"a.{suffix}")
        assert faults(written["file"]) == []


def test_view_writes_a_page_with_masks_and_the_errors_of_the_scenes_truth(result, tmp_path, capsys):
    written = answer(capsys, "view", result, "-o", tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert (written["frames"], written["bytes"]) == (FRAMES, len(page.encode()))
    assert "Joint error, mean" in page
    (cameras,) = re.findall(r'"cameras":(\[.*?\]),"up"', page)
    assert all(len(camera["masks"]) == FRAMES and not camera["images"] for camera in json.loads(cameras))


def test_a_result_of_small_masks_is_drawn_over_larger_images(scene, tmp_path, capsys, monkeypatch):
    from mmocap_warp.scene.recording import Scene

    # So few pixels leave most of the body in doubt.
    few = ["--scale", "0.5", "--evaluations", "12", *map(str, FEW)]
    assert cli.main(["track", str(scene), "-o", str(tmp_path / "r.usdc"), *few]) == console.CHECK_FAILED
    drawn, images = [], Scene.images
    monkeypatch.setattr(Scene, "images", lambda self, scale, *rest: drawn.append(scale) or images(self, scale, *rest))
    answer(capsys, "show", tmp_path / "r.usdc")
    assert drawn == [1.0]  # 160 pixels are all that the recording has


def test_masks_are_a_scene_that_tracks_alike(scene, result, tmp_path, capsys):
    written = answer(capsys, "mask", scene, "-o", tmp_path / "masks")
    flags = ("--evaluations", 60, "--seed", 3, "--device", "cpu")  # as the scene's own [track] says
    again = answer(capsys, "track", written["scene"], "-o", tmp_path / "r.usdc", *flags)
    assert again["frames"] == FRAMES
    assert same_bits(result, tmp_path / "r.usdc")


@pytest.mark.nightly
def test_without_an_output_all_that_is_not_there_is_made(scene, tmp_path, capsys):
    shutil.copytree(scene.parent, tmp_path / "all", ignore=shutil.ignore_patterns("result*"))
    command = ("track", tmp_path / "all", "--evaluations", 12, "--frames", 2)
    files = {name: Path(answer(capsys, *command)[name]) for name in ("result", "video", "page")}
    assert [file.name for file in files.values()] == ["result.usdc", "result.webm", "result.html"]
    assert answer(capsys, *command)["next"].startswith("mmocap export ")  # the video is there already
    files["video"].unlink()
    made = {file: file.stat().st_mtime_ns for file in (files["result"], files["page"])}
    assert cli.main([*map(str, command), "--json"]) == console.OK
    assert files["video"].exists()
    assert {file: file.stat().st_mtime_ns for file in made} == made


@pytest.fixture
def quickly_fitted(monkeypatch) -> None:
    """A fit searches the limbs once; how well it does is tested elsewhere."""
    monkeypatch.setattr("mmocap_warp.fitting.subject_fit._ROUNDS", 1)


@pytest.mark.usefixtures("quickly_fitted")
def test_fit_writes_a_subject_that_can_be_tracked(scene, tmp_path, capsys):
    quick = scene.with_name("quick.toml")
    fit = "[fit]\nevaluations = 48\nfinalists = 1\nframes = 3\n"
    quick.write_text(SCENE.replace("[scene]", '[scene]\nbody = "boxes.usdc"') + fit)
    fitted = answer(capsys, "fit", quick, "-o", tmp_path / "s.usdc", "--headings", 2, "--device", "cpu")
    assert fitted["fit.headings"] == 2
    assert fitted["fit.frames"] == 3
    assert fitted["fit.decided"] in ("yes", "no")
    assert 0 < fitted["body.height.sigma"] < 0.1
    picture = answer(capsys, "show", tmp_path / "s.usdc")["sheet"]
    assert Path(picture).name == "s.png"
    assert cv2.imread(picture).max() > 0
    report = answer(capsys, "track", quick, "-o", tmp_path / "r.usdc", "--subject", tmp_path / "s.usdc")
    assert report["frames"] == FRAMES


@pytest.mark.usefixtures("quickly_fitted")
@pytest.mark.parametrize(
    ("body", "name"), [("boxes.usdc", "Boxes"), pytest.param(*["adult_woman"] * 2, marks=pytest.mark.nightly)]
)
def test_track_fits_first_where_no_subject_is_named(body, name, scene, tmp_path, capsys):
    quick = scene.with_name("unfitted.toml")
    fit = "[fit]\nheadings = 2\nevaluations = 48\nfinalists = 1\nframes = 3\n"
    quick.write_text(SCENE.replace('subject = "subject.usdc"', f'body = "{body}"') + fit)
    code = console.OK if name == "Boxes" else console.CHECK_FAILED  # it shows no woman
    answer(capsys, "track", quick, "-o", tmp_path / "r.usdc", "--evaluations", 12, code=code)
    assert sorted(os.listdir(tmp_path)) == ["r.subject.usdc", "r.usdc"]
    assert read_result(tmp_path / "r.usdc").subject.body.name == name
