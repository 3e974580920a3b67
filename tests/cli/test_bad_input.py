"""Wrong input, one fault at a time, through the command line: exit 3 and one line that names the file and a remedy.

Each case starts from a small scene that is right, breaks one thing in it, and runs a command that must notice.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from calibration_files import write_easymocap
from small_scene import FRAMES, SIZE, make_scene
from synthetic import ring_rig, synthetic_body, synthetic_result, synthetic_subject

from mmocap_warp import cli
from mmocap_warp.cli.console import BAD_INPUT, OK
from mmocap_warp.formats.truth_file import write_truth
from mmocap_warp.formats.usd.usd_body import write_body, write_subject
from mmocap_warp.formats.usd.usd_result import write_result
from mmocap_warp.result.truth import Truth


def edit(name: str, old: str, new: str) -> Callable[[Path], None]:
    """Replace every ``old`` in a file of the scene by ``new``."""

    def broken(folder: Path) -> None:
        text = (folder / name).read_text()
        assert old in text
        (folder / name).write_text(text.replace(old, new))

    return broken


def rewrite(name: str, pattern: str, new: str) -> Callable[[Path], None]:
    """Replace the first match of ``pattern`` in a file of the scene by ``new``."""

    def broken(folder: Path) -> None:
        text, count = re.subn(pattern, new, (folder / name).read_text(), count=1, flags=re.M)
        assert count
        (folder / name).write_text(text)

    return broken


def write(name: str, content: bytes) -> Callable[[Path], None]:
    """Put ``content`` in the place of a file of the scene."""

    def broken(folder: Path) -> None:
        (folder / name).write_bytes(content)

    return broken


def remove(name: str) -> Callable[[Path], None]:
    """Take a file away."""
    return lambda folder: (folder / name).unlink()


def video(folder: Path, name: str, frames: int = FRAMES, size: tuple[int, int] = SIZE) -> Path:
    """A lossless video of noise."""
    writer = cv2.VideoWriter(str(folder / name), cv2.VideoWriter_fourcc(*"FFV1"), 60, size)
    for frame in range(frames):
        writer.write(np.random.default_rng(frame).integers(0, 255, (size[1], size[0], 3), np.uint8))
    writer.release()
    return folder / name


def wrong_video(name: str, **options) -> Callable[[Path], None]:
    """Let the first camera read a video."""

    def broken(folder: Path) -> None:
        video(folder, name, **options)
        edit("scene.toml", "masks/cam01", name)(folder)

    return broken


def truncated_video(folder: Path) -> None:
    path = video(folder, "cam01.mkv", frames=30, size=(320, 240))
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 10])
    edit("scene.toml", "masks/cam01", "cam01.mkv")(folder)


def image(camera: str, level: int) -> Callable[[Path], None]:
    """Let every mask of a camera be of one gray level."""

    def broken(folder: Path) -> None:
        for file in (folder / camera).iterdir():
            cv2.imwrite(str(file), np.full(SIZE[::-1], level, np.uint8))

    return broken


def real_masks(folder: Path) -> None:
    (folder / "real").mkdir()
    for frame in range(FRAMES):
        cv2.imwrite(str(folder / f"real/{frame:04d}.tif"), np.ones(SIZE[::-1], np.float32))
    edit("scene.toml", "masks/cam01", "real")(folder)


def mirrored_rotation(folder: Path) -> None:
    """Give the calibration as OpenCV YAML, the second camera's rotation with a row negated."""
    rig = ring_rig(3, SIZE)
    R = rig.R.copy()
    R[1] = np.diag([-1.0, 1.0, 1.0]) @ R[1]
    write_easymocap(folder, replace(rig, R=R), size=False)
    edit("scene.toml", "calibration.toml", "intri.yml")(folder)


def nothing(folder: Path) -> None:
    """The command line alone is at fault."""


def body_file(folder: Path) -> None:
    write_body(folder / "body.usda", synthetic_body())


def result_file(folder: Path) -> None:
    write_result(folder / "result.usda", synthetic_result(3, 1))


def other_result(folder: Path) -> None:
    write_result(folder / "result.usda", synthetic_result(3, 1, cameras=2))


def truth_of_another_recording(folder: Path) -> None:
    result, joints = synthetic_result(3, 1), np.zeros((2, 1, 3))
    truth = Truth(result.fps, np.array([900, 901]), (), joints[:, :0], ("LKnee",), joints)
    write_truth(folder / "t.usda", truth, "+z")
    write_result(folder / "result.usda", result)


def truth_of_another_body(folder: Path) -> None:
    result = synthetic_result(3, 1)
    names, numbers = ("Snout", "Tail", "Paw", "Ear", "Whisker"), result.frame_numbers
    joints = np.zeros((len(numbers), len(names), 3))
    write_truth(folder / "t.usda", Truth(result.fps, numbers, (), joints[:, :0], names, joints), "+z")
    write_result(folder / "result.usda", result)


def damaged_checkpoint(folder: Path) -> None:
    write_subject(folder / "s.usdc", synthetic_subject())
    (folder / "r.usdc.checkpoint").write_bytes(b"PK\x03\x04 and no more")


def cut_result(folder: Path) -> None:
    write_result(folder / "result.usdc", synthetic_result(3, 1))
    content = (folder / "result.usdc").read_bytes()
    (folder / "result.usdc").write_bytes(content[: len(content) // 2])


def lost_scene(folder: Path) -> None:
    result = synthetic_result(3, 1)
    write_result(folder / "result.usda", replace(result, config={"scene": "gone/scene.toml"}))


TRACK = ("track", "{scene}", "-o", "{folder}/r.usdc", "--device", "cpu")
SHOW_OTHER = ("show", "{folder}/result.usda", "--scene", "{scene}")
RESUME = (*TRACK, "--quiet", "--resume", "--subject", "{folder}/s.usdc")
EVAL = ("eval", "{folder}/result.usda")
EVAL_TRUTH = (*EVAL, "--truth", "{folder}/t.usda")


@dataclass(frozen=True)
class Case:
    """A fault: what breaks, what the line must say, and the command that must notice."""

    name: str
    fault: Callable[[Path], None]
    says: str
    command: tuple[str, ...] = ("cameras", "{scene}")


CASES = (
    Case("scene missing", remove("scene.toml"), "scene.toml: no such file"),
    Case("scene not TOML", write("scene.toml", b"[scene\nfps = 60"), "scene.toml: is not valid TOML"),
    Case("scene not text", write("scene.toml", b"\xff\xfe\x00\x01"), "scene.toml: cannot be read"),
    Case("no frame rate", edit("scene.toml", "fps = 60\n", ""), "scene.toml: [scene]: 'fps' is missing"),
    Case("frame rate zero", edit("scene.toml", "fps = 60", "fps = 0"), "scene.toml: [scene]: fps = 0"),
    Case("frame rate NaN", edit("scene.toml", "fps = 60", "fps = nan"), "scene.toml: [scene]: fps is not finite"),
    Case("frame rate in words", edit("scene.toml", "fps = 60", 'fps = "sixty"'), "scene.toml: [scene]: fps = 'sixty'"),
    Case("unknown up", edit("scene.toml", '"+y"', '"up"'), "scene.toml: [scene]: up = 'up'"),
    Case("misspelt key", edit("scene.toml", "masks =", "mask ="), "did you mean 'masks'"),
    Case("unknown table", edit("scene.toml", "[track]", "[tracker]"), "scene.toml: unknown key 'tracker'"),
    Case("no cameras", write("scene.toml", b"[scene]\nfps = 60\n"), "scene.toml: [cameras]"),
    Case("unknown camera", edit("scene.toml", "[cameras.cam03]", "[cameras.cam9]"), "cam9"),
    Case("too many frames", edit("scene.toml", "fps = 60", "fps = 60\nframes = 9"), "frames"),
    Case("negative frames", edit("scene.toml", "fps = 60", "fps = 60\nframes = -1"), "frames = -1"),
    Case("calibration missing", remove("calibration.toml"), "calibration.toml: no such file"),
    Case(
        "calibration of unknown kind", edit("scene.toml", "calibration.toml", "scene.xyz"), "scene.xyz: ends in '.xyz'"
    ),
    Case(
        "NaN in the calibration",
        rewrite("calibration.toml", r"translation = \[ *[^,]+", "translation = [ nan"),
        "finite",
    ),
    Case(
        "translation in millimetres",
        rewrite("calibration.toml", r"translation = .*", "translation = [0, 0, 4000]"),
        "calibration.toml",
    ),
    Case("a size that is not the masks'", edit("calibration.toml", "64", "640"), "calibration.toml"),
    Case("mask folder missing", edit("scene.toml", "masks/cam02", "masks/cam7"), "cam7: no such file or folder"),
    Case(
        "mask folder empty",
        lambda folder: (folder / "masks/cam01").rename(folder / "x") and (folder / "masks/cam01").mkdir(),
        "cam01",
    ),
    Case("gap in the masks", remove("masks/cam01/0001.png"), "cam01"),
    Case(
        "cameras differ in length",
        remove("masks/cam01/0002.png"),
        "cameras differ in their number of frames",
    ),
    Case(
        "a video that is not one",
        lambda folder: (write("x.mp4", b"none")(folder), edit("scene.toml", "masks/cam01", "x.mp4")(folder)),
        "x.mp4: cannot be decoded as a video",
    ),
    Case("another picture size", wrong_video("cam01.mkv", size=(128, 96)), "128x96"),
    Case("truncated video", truncated_video, "cam01.mkv", ("mask", "{scene}", "-o", "{folder}/out", "--quiet")),
    Case("empty masks", image("masks/cam01", 0), "cam01: all masks are empty"),
    Case("inverted masks", image("masks/cam01", 255), "cam01: masks are 100 % foreground"),
    Case("masks of real numbers", real_masks, "0000.tif: has pixels of float32"),
    Case("mirrored rotation", mirrored_rotation, "mirror"),
    Case("output folder missing", nothing, "{folder}/a: no such folder", ("mask", "{scene}", "-o", "{folder}/a/b")),
    Case("output folder full", nothing, "masks: holds files already", ("mask", "{scene}", "-o", "{folder}/masks")),
    # track
    Case("misspelt setting", edit("scene.toml", "evaluations", "evaluation"), "did you mean 'evaluations'", TRACK),
    Case("setting in words", edit("scene.toml", "= 30", '= "many"'), "[track]: evaluations = 'many'", TRACK),
    Case("no evaluations", edit("scene.toml", "= 30", "= 0"), "[track]: evaluations must be at least 1", TRACK),
    Case("unknown algorithm", edit("scene.toml", "evaluations = 30", 'algorithm = "sgd"'), "[track]: algorithm", TRACK),
    Case("subject missing", edit("scene.toml", "fps", 'subject = "s.usdc"\nfps'), "s.usdc does not exist", TRACK),
    Case("subject of a flag missing", nothing, "s.usdc: no such file", (*TRACK, "--subject", "{folder}/s.usdc")),
    Case("subject is no USD", write("s.usdc", b"none"), "s.usdc", (*TRACK, "--subject", "{folder}/s.usdc")),
    Case(
        "body without a pose",
        body_file,
        "body.usda: holds a body, but not",
        (*TRACK, "--subject", "{folder}/body.usda"),
    ),
    Case("unknown body", nothing, "there is no body 'giant'", (*TRACK, "--body", "giant")),
    Case("result has another ending", nothing, "r.fbx: ends in '.fbx'", ("track", "{scene}", "-o", "{folder}/r.fbx")),
    Case(
        "result exists", result_file, "result.usda: exists already", ("track", "{scene}", "-o", "{folder}/result.usda")
    ),
    Case("no pixel left", nothing, "at scale 0.001 an image has no pixel left", (*TRACK, "--scale", "0.001")),
    Case("damaged checkpoint", damaged_checkpoint, "r.usdc.checkpoint: is damaged", RESUME),
    Case("interrupted run", write("r.usdc.checkpoint", b""), "r.usdc.checkpoint: an interrupted run", TRACK),
    # results
    Case("result missing", nothing, "none.usda: no such file", ("eval", "{folder}/none.usda")),
    Case("result is no USD", write("result.usda", b"none"), "result.usda", ("eval", "{folder}/result.usda")),
    Case("result is a body", body_file, "body.usda: holds no tracking result", ("eval", "{folder}/body.usda")),
    Case("result cut short", cut_result, "result.usdc", ("eval", "{folder}/result.usdc")),
    Case("truth missing", result_file, "t.trc: no such file", (*EVAL, "--truth", "{folder}/t.trc")),
    Case(
        "truth of another recording",
        truth_of_another_recording,
        "t.usda: has frames 900-901, of which the result",
        EVAL_TRUTH,
    ),
    Case(
        "truth of another body",
        truth_of_another_body,
        "of its joints (Snout, Tail, Paw, Ear, ...) is evaluated",
        EVAL_TRUTH,
    ),
    Case("truth of unknown kind", result_file, "scene.toml", (*EVAL, "--truth", "{scene}")),
    Case("scene of a result gone", lost_scene, "name the scene with --scene", ("show", "{folder}/result.usda")),
    Case("scene of another recording", other_result, "has the cameras cam01, cam02, cam03, the result", SHOW_OTHER),
    Case("scene shorter than the result", result_file, "has 3 frames, the result goes to frame 12", SHOW_OTHER),
    Case("animation of unknown kind", result_file, "a.fbx", ("export", "{folder}/result.usda", "-o", "{folder}/a.fbx")),
    Case("page of unknown kind", result_file, "a.htm", ("view", "{folder}/result.usda", "-o", "{folder}/a.htm")),
)


def run(case: Case, folder: Path) -> int:
    return cli.main([argument.format(scene=folder / "scene.toml", folder=folder) for argument in case.command])


def test_the_scene_is_right_before_it_is_broken(tmp_path, capsys):
    assert cli.main(["cameras", str(make_scene(tmp_path))]) == OK
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_wrong_input_is_one_clear_line(case, tmp_path, capsys, monkeypatch):
    monkeypatch.delenv("MMOCAP_DEBUG", raising=False)
    folder = make_scene(tmp_path)
    case.fault(folder)
    code = run(case, folder)
    shown = capsys.readouterr()
    assert code == BAD_INPUT, shown.err
    assert shown.out == ""
    assert shown.err.count("\n") == 1
    assert "Traceback" not in shown.err
    assert case.says.format(folder=folder) in shown.err
    assert "; " in shown.err  # what is wrong; what to do


def test_a_truth_that_does_not_fit_leaves_what_was_tracked(tmp_path, capsys, monkeypatch):
    folder = make_scene(tmp_path)
    truth_of_another_body(folder)
    scene = folder / "scene.toml"
    scene.write_text(f'{scene.read_text()}\n[truth]\nfile = "t.usda"\n')
    write_subject(folder / "s.usdc", synthetic_subject())
    monkeypatch.setattr("mmocap_warp.commands.track._tracked", lambda *_, **__: synthetic_result(3, 1))
    command = ["track", str(scene), "--subject", str(folder / "s.usdc"), "-o", str(folder / "r.usdc"), "--quiet"]
    assert cli.main(command) == BAD_INPUT
    written, wrong = capsys.readouterr().err.splitlines()
    assert written.startswith(f"{folder / 'r.usdc'} is written")
    assert wrong.startswith(f"mmocap: {folder / 't.usda'}: no markers")
