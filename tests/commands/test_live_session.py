"""Live sessions: what comes is tracked and told, the result grows, and what cannot be is refused at once."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from concurrent.futures import Future

import cv2
import numpy as np
import pytest
from small_scene import CAMERAS, FRAMES, SCENE, SIZE, make_scene
from synthetic import synthetic_subject
from walk_scene import walking

import mmocap_warp as mm
from mmocap_warp.formats.usd.usd_body import write_subject
from mmocap_warp.formats.usd.usd_people import results_in
from mmocap_warp.scenes import ROOT
from mmocap_warp.tracking.live_smoothing import LiveFrame

WALK = ROOT / "walk"
SETTINGS = {"device": "cpu", "scale": 0.25, "algorithm": "contour"}


@pytest.fixture(scope="module")
def subject() -> mm.Subject:
    """The walker, at the first frame."""
    made = walking()
    return mm.Subject(made.body, made.root_base, made.poses[0], {"fit.first_frame": 0})


def test_what_cannot_be_is_refused_before_anything_starts(subject, tmp_path):
    with pytest.raises(mm.UsageError, match="runs must be 1 to track live, got 2"):
        mm.live(WALK, subject, runs=2)
    with pytest.raises(mm.UsageError, match="frames are of the scene's own files: leave it or source out"):
        mm.live(WALK, subject, source=("0", "1"), frames=3)
    with pytest.raises(mm.UsageError, match="to udp://here is no address; give one of tcp://HOST:PORT"):
        mm.live(WALK, subject, to=("udp://here",), device="cpu")
    with pytest.raises(mm.InputError, match=r"live\.txt: ends in '\.txt'"):
        mm.live(WALK, subject, record=tmp_path / "live.txt")
    (tmp_path / "old.usdc").touch()
    with pytest.raises(mm.InputError, match=r"old\.usdc: exists already"):
        mm.live(WALK, subject, record=tmp_path / "old.usdc")
    folder = make_scene(tmp_path)
    (folder / "scene.toml").write_text(SCENE.replace(CAMERAS, CAMERAS.replace("masks = ", "# ")))
    with pytest.raises(mm.InputError, match="names no subject, and live frames cannot be fitted"):
        mm.live(folder, source=("0", "1", "2"), device="cpu")


def test_a_background_that_is_learnt_from_the_recording_needs_it_live_too(tmp_path):
    folder = make_scene(tmp_path)
    (folder / "scene.toml").write_text(SCENE + '[foreground]\nsource = "recording"\n')
    with pytest.raises(mm.InputError, match="video"):
        mm.live(folder, synthetic_subject(), source=("0", "1", "2"), device="cpu")


class Listener(mm.Reporter):
    """Remembers notes."""

    def __init__(self) -> None:
        self.notes: list[str] = []

    def note(self, line: str) -> None:
        """Remember it."""
        self.notes.append(line)


class Standing:
    """Instead of trackers, people who stay where they are; what is said at once is said again in the end."""

    def __init__(self, *people) -> None:
        self.people, self.count, self.frames = people, len(people), [[] for _ in people]

    def wait(self) -> None:
        """Nothing is being made."""

    def step(self, number, seen) -> Future:
        """The same poses again."""
        found = Future()
        for (subject, *_), observation, frames in zip(self.people, seen, self.frames, strict=True):
            pose, world = subject.pose[None], np.zeros((1, len(subject.body.skeleton.joints), 4, 4))
            iou = observation.foreground[None] / 1000.0  # tells who was seen
            frames.append(LiveFrame(number, pose, pose, world, iou, ("tracked",)))
        found.set_result(([frames[-1] for frames in self.frames], [[] for _ in self.people]))
        return found

    def rest(self) -> list[list[LiveFrame]]:
        """All frames."""
        return self.frames

    def close(self) -> None:
        """Nothing is open."""


def test_several_people_have_a_file_each_and_one_of_all(tmp_path, monkeypatch):
    folder, labels = make_scene(tmp_path), np.zeros(SIZE[::-1], np.uint8)
    labels[10:40, 10:24], labels[10:40, 30:40] = 1, 2
    for file in (folder / "masks").glob("*/*.png"):
        cv2.imwrite(str(file), labels)
    tables = "".join(f'[people.{name}]\nlabel = {n}\nsubject = "me.usdc"\n' for n, name in ((1, "anna"), (2, "ben")))
    (folder / "scene.toml").write_text(SCENE + tables)
    write_subject(folder / "me.usdc", synthetic_subject())
    monkeypatch.setattr("mmocap_warp.commands.live_session.newest", lambda frames, **_: frames)
    monkeypatch.setattr("mmocap_warp.commands.live_session.make_live", lambda _, people: [Standing(*people)])
    record = tmp_path / "live.usdc"
    assert mm.live(folder, record=record, device="cpu").frames == FRAMES
    files = results_in(record)
    assert files == {name: tmp_path / f"live.{name}.usdc" for name in ("anna", "ben")}
    for name, pixels in (("anna", 30 * 14), ("ben", 30 * 10)):
        result = mm.load_result(files[name])
        assert result.frame_numbers.tolist() == list(range(FRAMES))
        np.testing.assert_allclose(result.iou, pixels / 1000.0)
        assert (result.config["person"], result.config["scene"]) == (name, "scene.toml")
    with pytest.raises(mm.InputError, match=r"live\.usdc: exists already"):
        mm.live(folder, record=record, device="cpu")
    assert mm.live(folder, record=tmp_path / "ben.usdc", person="ben", device="cpu").frames == FRAMES
    assert mm.load_result(tmp_path / "ben.usdc").iou.max() == 0.3
    with pytest.raises(mm.UsageError, match="subject is of one person"):
        mm.live(folder, folder / "me.usdc", device="cpu")
    with pytest.raises(mm.UsageError, match="person eve is not one of anna, ben"):
        mm.live(folder, person="eve", device="cpu")
    (folder / "scene.toml").write_text(SCENE + tables + "[labels]\nseveral = 3\n")
    with pytest.raises(mm.InputError, match="who is one blob with others cannot be told apart live"):
        mm.live(folder, device="cpu")


def test_a_subject_of_another_frame_needs_a_search(tmp_path):
    folder = make_scene(tmp_path)
    with pytest.raises(mm.InputError, match="the subject was fitted to frame 0, but tracking begins with frame 1"):
        mm.live(folder, synthetic_subject(), frames="1:", device="cpu", algorithm="contour")


def test_frames_of_a_killed_session_are_not_replaced_by_force(tmp_path, monkeypatch):
    folder, record = make_scene(tmp_path), tmp_path / "live.usdc"
    monkeypatch.setattr("mmocap_warp.commands.live_session.newest", lambda frames, **_: frames)
    monkeypatch.setattr("mmocap_warp.commands.live_session.make_live", lambda _, people: [Standing(*people)])
    monkeypatch.setattr("mmocap_warp.streaming.growing_result.finish", lambda path: None)  # it is killed
    mm.live(folder, synthetic_subject(), record=record, device="cpu")
    monkeypatch.undo()
    with pytest.raises(mm.InputError, match=r"live\.usdc: exists already"):
        mm.live(folder, synthetic_subject(), record=record, device="cpu", force=True)
    assert mm.load_result(record).frame_numbers.tolist() == list(range(FRAMES))


@pytest.mark.nightly
def test_a_session_is_told_and_kept(subject, tmp_path, monkeypatch):
    monkeypatch.setattr(
        "mmocap_warp.commands.live_session.newest", lambda frames, **_: frames
    )  # however slow this machine
    path = tmp_path / "live.usdc"
    report = mm.live(WALK, subject, frames="::2", record=path, **SETTINGS)
    assert (report.frames, report.dropped, report.lost) == (32, 0, 0)
    assert report.delay_ms[0] <= report.delay_ms[1] <= report.delay_ms[2]
    result = mm.load_result(path)
    assert result.frame_numbers.tolist() == list(range(0, 64, 2))
    assert np.linalg.norm(result.pose[0, :, :3] - walking().poses[::2, :3], axis=1).max() < 0.03


@pytest.mark.nightly
def test_a_session_that_is_killed_keeps_its_frames(subject, tmp_path):
    write_subject(tmp_path / "subject.usdc", subject)
    path = tmp_path / "live.usdc"
    flags = ["--subject", "subject.usdc", "--record", "live.usdc", "--device", "cpu", "--algorithm", "contour"]
    command = [sys.executable, "-m", "mmocap_warp", "live", str(WALK), *flags, "--scale", "0.25", "--json"]
    killed = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    beside = tmp_path / "live.usdc.frames"
    while not (beside.exists() and beside.stat().st_size):
        assert killed.poll() is None
        time.sleep(0.01)
    killed.send_signal(signal.SIGKILL)
    killed.wait()
    listener = Listener()
    with pytest.raises(mm.InputError, match=r"live\.usdc: exists already"):
        mm.live(WALK, subject, record=path, reporter=listener)
    assert listener.notes == [f"{path}: holds the frames of a session that was killed"]
    assert mm.load_result(path).frame_numbers[0] == 0
    assert not beside.exists()


@pytest.mark.nightly
def test_ctrl_c_ends_a_session_as_its_end_does(subject, tmp_path):
    write_subject(tmp_path / "subject.usdc", subject)
    names = mm.load_scene(WALK).calibrated.names
    for camera in names:
        (tmp_path / "growing" / camera).mkdir(parents=True)
    flags = ["--subject", "subject.usdc", "--record", "live.usdc", "--source", "growing", "--device", "cpu"]
    command = [sys.executable, "-m", "mmocap_warp", "live", str(WALK), *flags, "--scale", "0.25", "--json"]
    running = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    beside, number = tmp_path / "live.usdc.frames", 0
    while not (beside.exists() and beside.stat().st_size):  # until some are smoothed
        assert running.poll() is None
        for camera in names:
            mask = (WALK / "masks" / camera / f"{min(number // 20, 63):04d}.png").read_bytes()
            (tmp_path / "growing" / camera / f"{number:06d}.png").write_bytes(mask)
        number += 1
        time.sleep(0.02)
    running.send_signal(signal.SIGINT)
    output, _ = running.communicate(timeout=60)
    assert running.returncode == 0
    tracked, kept = json.loads(output)["frames"], mm.load_result(tmp_path / "live.usdc").frame_numbers
    assert tracked > 4
    assert len(kept) >= tracked
