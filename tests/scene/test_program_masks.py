"""Masks by a program of anyone's: what it is given, what becomes of its masks, and what is said where it fails."""

from __future__ import annotations

import json
import os
import re
import shlex
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from disc_scene import FRAMES, SIZE, disc, edit, write_scene
from given_masks import palette_png
from synthetic import ring_rig

import mmocap_warp as mm
from mmocap_warp import cli
from mmocap_warp.cameras.rig import project
from mmocap_warp.cli import console
from mmocap_warp.commands import mask as mask_command
from mmocap_warp.errors import InputError, UsageError
from mmocap_warp.masks import mask_program
from mmocap_warp.scene.scene_toml import load_scene

DOCS = Path(__file__).parents[2] / "docs" / "masks.md"

# Copies the mask of each frame that has none; what comes before may spoil it. A line of the log for each start.
STAND_IN = """
import os, shutil, sys
from pathlib import Path
frames, masks = map(Path, sys.argv[1:])
here = Path(__file__).parent
wanted = [file for file in sorted(frames.iterdir()) if not (masks / f"{file.stem}.png").exists()]
with open(here / "starts.txt", "a") as log:
    print(frames.name, *(int(file.stem) for file in wanted), file=log)
for file in wanted:
    made = masks / f"{file.stem}.png"
    if (frames.name, file.stem) == ("cam02", "000002"):
        SPOILT
    shutil.copy(here / "given" / frames.name / f"{file.stem[-3:]}.png", made)
"""


def stand_in(folder: Path, spoilt: str = "pass") -> str:
    script = folder / "stand_in.py"
    script.write_text(STAND_IN.replace("SPOILT", spoilt))
    return shlex.join([sys.executable, "-S", "-E", str(script)])


def starts(folder: Path) -> list[str]:
    return (folder / "starts.txt").read_text().splitlines()


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    """Videos and calibration alone, the last camera late; masks lie beside it for the stand-in."""
    write_scene(tmp_path, "program", late=1)
    text = re.sub(r'(masks|clean_plate) = ".*\n', "", (tmp_path / "scene.toml").read_text())
    (tmp_path / "scene.toml").write_text(text)
    (tmp_path / "masks").rename(tmp_path / "given")
    return tmp_path


def test_it_is_started_once_for_each_camera(scene: Path) -> None:
    written = mm.mask(scene, scene / "made", with_=stand_in(scene))
    assert starts(scene) == ["cam01 0 1 2 3", "cam02 0 1 2 3", "cam03 0 1 2"]  # cam03 has no image at the end
    assert sorted(file.name for file in (scene / "made").iterdir() if not file.name.startswith(".")) == [
        *("cam01", "cam02", "cam03", "overlay.webm", "pinholes.toml", "scene.toml")
    ]
    made = list(load_scene(written.scene).masks())
    for frame, masks in enumerate(made):
        for k, mask in enumerate(masks[:2]):
            np.testing.assert_array_equal(mask, disc(load_scene(scene).calibrated, k, frame))
    assert not made[-1][2].any()
    with pytest.raises(InputError, match="not made yet; make them with mmocap mask"):
        next(load_scene(scene).masks())


@pytest.mark.parametrize(
    ("spoilt", "problem"),
    [
        ("print('no memory'); sys.exit(7)", "failed with exit code 7; it said: no memory"),
        ("continue", "has no mask; it said: nothing"),
        ("made.write_bytes(b'garbage'); continue", "cannot be decoded as an image"),
        ("shutil.copy(here / 'plate.png', made); os.truncate(made, 60); continue", "cannot be decoded as an image"),
        ("shutil.copy(here / 'small.png', made); continue", "its mask is 80x60, the frame is 160x120"),
        ("import time; time.sleep(60)", "made no mask and said nothing for 0 s"),
        ("os.kill(os.getpid(), 9)", "failed with exit code -9"),
    ],
)
def test_what_fails_names_program_camera_and_frame(
    scene: Path, spoilt: str, problem: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    cv2.imwrite(str(scene / "small.png"), np.zeros((60, 80), np.uint8))
    if "sleep" in spoilt:
        monkeypatch.setattr(mask_program, "_PATIENCE", 0.3)
    with pytest.raises(InputError) as raised:
        mm.mask(scene, scene / "made", with_=stand_in(scene, spoilt))
    assert raised.value.problem.startswith(problem)
    assert re.fullmatch(r"--with .*stand_in.py, camera cam02, frame 2", raised.value.source)
    assert "go on with the same command" in raised.value.remedy


def test_a_run_that_was_stopped_goes_on(scene: Path) -> None:
    with pytest.raises(InputError, match="exit code 1"):
        mm.mask(scene, scene / "made", with_=stand_in(scene, "sys.exit(1)"))
    (scene / "made" / "unfinished" / "masks" / "cam02" / "000001.png").write_bytes(b"half a fi")
    (scene / "starts.txt").unlink()
    mm.mask(scene, scene / "made", with_=stand_in(scene))
    assert starts(scene) == ["cam02 1 2 3", "cam03 0 1 2"]
    assert not (scene / "made" / "unfinished").exists()


COLOURS = np.uint8([[0, 0, 0], [200, 0, 0], [0, 200, 0], [0, 0, 200]])


def give_labels(folder: Path, places: list[tuple[float, float, float]], labels: dict[str, list[int]]) -> None:
    """Discs about places in the world, with their labels in each camera and frame; a palette's index is the label."""
    rig = load_scene(folder).calibrated
    for k, name in enumerate(rig.names):
        for frame in range(FRAMES):
            image = np.zeros(SIZE[::-1], np.uint8)
            row, column = np.indices(image.shape)
            for place, label in zip(places, labels[name][2 * frame :], strict=False):
                u, v = project(rig, np.array([place]))[k, 0]
                image[(np.hypot(column - u, row - v) < 12) & (label > 0)] = label
            (folder / "given" / name / f"{frame:03d}.png").write_bytes(palette_png(image, COLOURS))


@pytest.fixture
def two(tmp_path: Path) -> Path:
    """Videos of two people, whom cam02 calls otherwise than the others, and cam01 in a frame too."""
    write_scene(tmp_path, "program", rig=ring_rig(3, SIZE))
    text = re.sub(r'(masks|clean_plate) = ".*\n', "", (tmp_path / "scene.toml").read_text())
    (tmp_path / "scene.toml").write_text(text)
    (tmp_path / "masks").rename(tmp_path / "given")
    labels = {"cam01": [1, 2, 2, 1, 1, 2, 1, 2], "cam02": [3, 1] * FRAMES, "cam03": [1, 2] * FRAMES}
    give_labels(tmp_path, [(0.5, 1.5, 0.3), (-0.5, 1.2, -0.4)], labels)
    return tmp_path


def test_people_of_label_images_have_a_name_and_one_label(two: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["mask", str(two), "-o", str(two / "made"), "--with", stand_in(two)]
    assert cli.main(command) in (console.OK, console.CHECK_FAILED)
    said = capsys.readouterr().err
    assert f"people: person1 in {3 * FRAMES}, person2 in {3 * FRAMES} of {3 * FRAMES} masks; 4 swapped" in said
    assert "person1 is tracked" in said
    made = load_scene(two / "made")
    assert (list(made.people), made.person) == (["person1", "person2"], "person1")
    assert [made.people["person1"].truth, made.people["person2"].truth] == [two / "made" / ".." / "truth.trc", None]
    first, second = (list(made.of_person(name).masks()) for name in made.people)
    for frame, views in enumerate(zip(first, second, strict=True)):
        for k, name in enumerate(("cam01", "cam02", "cam03")):
            given = cv2.imread(str(two / "given" / name / f"{frame:03d}.png")).any(axis=2)
            one, other = views[0][k], views[1][k]
            np.testing.assert_array_equal(one | other, given)
            assert not (one & other).any()
            left = np.nonzero(one)[1].mean() < np.nonzero(other)[1].mean()
            assert left == (np.nonzero(first[0][k])[1].mean() < np.nonzero(second[0][k])[1].mean())
    again = load_scene(mm.mask(two / "made", two / "again").scene)  # labels stay labels
    assert again.people.keys() == made.people.keys()
    for masks, same in zip(again.masks(), first, strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(masks, same, strict=True))
    edit(two / "made" / "scene.toml", 'person = "person1"', 'person = "person3"')
    with pytest.raises(InputError, match=r'person = "person3" has no table; add \[people.person3\]'):
        load_scene(two / "made")


def test_a_ghost_in_one_view_changes_nothing(two: Path) -> None:
    ghost = {name: [1, 0] * FRAMES for name in ("cam02", "cam03")} | {"cam01": [1, 0, 1, 3, 1, 0, 1, 0]}
    give_labels(two, [(0.5, 1.5, 0.3), (-0.5, 1.2, -0.4)], ghost)
    made = load_scene(mm.mask(two, two / "made", with_=stand_in(two)).scene)
    assert not made.people
    give_labels(two, [(0.5, 1.5, 0.3)], {name: [1] * 2 * FRAMES for name in ("cam01", "cam02", "cam03")})
    alone = load_scene(mm.mask(two, two / "alone", with_=stand_in(two)).scene)
    for masks, same in zip(made.masks(), alone.masks(), strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(masks, same, strict=True))


@pytest.mark.filterwarnings("ignore")  # discs fit no body
def test_a_track_makes_the_masks_first_and_once(scene: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = mask_program.MaskProgram("mediapipe", tuple(shlex.split(stand_in(scene))))
    monkeypatch.setattr(mask_command, "find_program", lambda text, note: program)
    for frames in (None, "1:3"):
        asked = load_scene(scene, frames)
        made = mask_command.with_masks(asked, mm.Reporter(), mm.TrackConfig())
        assert (made.path, made.frames) == (scene / "masks" / "scene.toml", asked.frames)
    assert len(starts(scene)) == 3
    os.utime(scene / "masks" / "scene.toml", (0, 0))  # the videos are others now
    with pytest.warns(UserWarning, match="masks: is older than the recording; remove it"):
        mask_command.with_masks(asked, mm.Reporter(), mm.TrackConfig())


def test_made_masks_that_are_older_than_what_the_scene_says_are_named(scene: Path, monkeypatch) -> None:
    program = mask_program.MaskProgram("mediapipe", tuple(shlex.split(stand_in(scene))))
    monkeypatch.setattr(mask_command, "find_program", lambda text, note: program)
    mask_command.with_masks(load_scene(scene), mm.Reporter(), mm.TrackConfig())
    edit(scene / "scene.toml", "evaluations = 60", "evaluations = 61")
    later = (scene / "masks" / "scene.toml").stat().st_mtime + 5
    os.utime(scene / "scene.toml", (later, later))
    with pytest.warns(UserWarning, match=r"scene\.toml: is tracked, and older than .*; edit it too, or remove"):
        made = mask_command.with_masks(load_scene(scene), mm.Reporter(), mm.TrackConfig())
    assert made.track["evaluations"] == 60
    assert len(starts(scene)) == 3


def test_unfinished_masks_of_another_scale_are_refused(scene: Path) -> None:
    with pytest.raises(InputError, match="exit code 1"):
        mm.mask(scene, scene / "made", with_=stand_in(scene, "sys.exit(1)"))
    with pytest.raises(InputError, match=r"unfinished: holds unfinished masks of other videos .* remove it"):
        mm.mask(scene, scene / "made", with_=stand_in(scene), scale=0.5)


def test_a_command_that_is_none(scene: Path) -> None:
    with pytest.raises(InputError, match="frame 0: cannot be started: no-such-program: No such file"):
        mm.mask(scene, scene / "made", with_="no-such-program --flag")
    for text, problem in (("", "names no program"), ("'open", "is no command")):
        with pytest.raises(UsageError, match=problem):
            mm.mask(scene, scene / "other", with_=text)


def test_a_scene_in_memory_may_ask_for_subtraction(tmp_path: Path) -> None:
    """As the plan of a batch does; it takes the clean plate, and not the masks that are there."""
    folder = write_scene(tmp_path)
    made = mm.load_scene(mm.mask(mm.load_scene(folder), folder / "made", with_="subtraction").scene)
    subtracted = mm.mask(folder, folder / "subtracted", with_="subtraction").scene
    given = mm.load_scene(folder).masks()
    for views, again, others in zip(made.masks(), mm.load_scene(subtracted).masks(), given, strict=True):
        np.testing.assert_array_equal(views, again)
        assert any((one != other).any() for one, other in zip(views, others, strict=True))


def test_subtraction_takes_the_best_background(tmp_path: Path) -> None:
    write_scene(tmp_path)
    edit(tmp_path / "scene.toml", '"masks"\n', '"masks"\nmin_area = 0\nclose = 0\nmedian = 0\n')
    made = load_scene(mm.mask(tmp_path, tmp_path / "made", with_="subtraction").scene)
    edit(tmp_path / "scene.toml", '"masks"\n', '"clean_plate"\n')
    for masks, same in zip(made.masks(), load_scene(tmp_path).masks(), strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(masks, same, strict=True))


def test_mediapipe_without_uv_or_network_says_what_to_run(
    scene: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["mask", str(scene), "-o", str(scene / "made"), "--with", "mediapipe"]
    uv = scene / "uv"
    uv.write_text("#!/bin/sh\necho no network >&2\nexit 2\n")
    for path, problem in (
        (scene, "uv cannot install it: no network"),
        (scene / "given", "needs uv, which is not inst"),
    ):
        monkeypatch.setenv("PATH", str(path))
        monkeypatch.setattr(mask_program.sys, "executable", str(path / "python"))
        uv.chmod(0o755)
        assert cli.main(command) == console.BAD_INPUT
        said = capsys.readouterr().err
        assert problem in said
        assert "-m venv mp" in said
        assert "mediapipe_pose.py" in said
    assert not (scene / "made").exists()


def test_the_shipped_script_makes_its_environment_without_arguments() -> None:
    assert mask_program.MEDIAPIPE_SCRIPT.read_text().startswith("# /// script\n# requires-python")


def blocks(language: str) -> list[str]:
    """The code of a language on the page."""
    return re.findall(rf"```{language}\n(.*?)```", DOCS.read_text(), re.DOTALL)


TORCH = """
class autocast:
    def __init__(self, *given, **named): pass
    def __enter__(self): pass
    def __exit__(self, *raised): pass
inference_mode, bfloat16 = autocast, None
"""
SAM2 = """
import cv2, numpy as np
from pathlib import Path
class Logits(np.ndarray):
    def __gt__(self, other): return np.asarray(self).__gt__(other).view(Logits)
    def cpu(self): return self
    def numpy(self): return np.asarray(self)
class Predictor:
    def init_state(self, folder): self.files = sorted(Path(folder).iterdir()); self.people = []; return folder
    def add_new_points_or_box(self, state, frame_idx, obj_id, points, labels): self.people.append(obj_id)
    def propagate_in_video(self, state):
        for frame, file in enumerate(self.files):
            seen = cv2.imread(str(file))[..., 2] > 180
            nobody = np.full((1, *seen.shape), -1.0)
            logits = [seen[None] - 0.5 if person == 1 else nobody for person in self.people]
            yield frame, self.people, np.stack(logits).view(Logits)
def build_sam2_video_predictor(*names): return Predictor()
"""
REMBG = """#!{python}
import sys, cv2, numpy as np
from pathlib import Path
assert sys.argv[1:4] == ["p", "-m", "u2net_human_seg"]
for file in Path(sys.argv[4]).iterdir():
    image = cv2.imread(str(file))
    alpha = np.where(image[..., 2] > 180, 255, 0).astype(np.uint8)
    cv2.imwrite(str(Path(sys.argv[5]) / f"{{file.stem}}.png"), np.dstack([image, alpha]))
"""


@pytest.mark.parametrize("name", ["rembg", "segment.py"])
def test_the_page_s_own_commands(name: str, scene: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    """With stand-ins for rembg and SAM 2: what is red is a person."""
    (scene / "rembg").write_text(REMBG.format(python=sys.executable))
    (scene / "rembg").chmod(0o755)
    (scene / "sam2").mkdir()
    (scene / "sam2" / "build_sam.py").write_text(SAM2)
    (scene / "torch.py").write_text(TORCH)
    (script,) = (block for block in blocks("python") if "sam2" in block)
    (scene / "segment.py").write_text(script)
    (line,) = (line for block in blocks("sh") for line in block.splitlines() if "--with" in line and name in line)
    monkeypatch.chdir(scene)
    monkeypatch.setenv("PYTHONPATH", str(scene))
    monkeypatch.setenv("PATH", f"{scene}:{Path(sys.executable).parent}:/usr/bin:/bin")
    words = shlex.split(line.replace("SCENE", str(scene)), comments=True)[1:]
    assert cli.main([*words, "--json"]) in (console.OK, console.CHECK_FAILED)
    report = json.loads(capsys.readouterr().out)
    area = np.pi * 12**2
    assert all(0.8 * area < px < 1.3 * area for px in report["views"]["cam01"]["area_px"])
    assert list(cv2.imread(str(scene / "masks" / "cam01" / "000000.png")).shape[1::-1]) == list(SIZE)
    assert report["frames"] == FRAMES
