"""An interrupted run continues and ends with the same bits, whatever moment it was stopped at."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
import time
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from synthetic import COORDINATES
from walk_scene import walking

from mmocap_warp import cli
from mmocap_warp.body.model import Subject
from mmocap_warp.cli import console
from mmocap_warp.errors import InputError
from mmocap_warp.formats.usd.usd_body import write_subject
from mmocap_warp.formats.usd.usd_result import read_result
from mmocap_warp.result.result import FrameAnswer, Result
from mmocap_warp.scene.recording import Scene
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.scenes import ROOT
from mmocap_warp.tracking import checkpoint
from mmocap_warp.tracking.frame_loop import track
from mmocap_warp.tracking.track_config import TrackConfig
from mmocap_warp.tracking.tracker import Tracker

FRAMES = 10
IDENTITY = {"seed": 1, "images": "a hash"}
FLAGS = ("--algorithm", "h-cmaes", "--scale", "0.25", "--evaluations", "60", "--device", "cpu", "--quiet")
CONFIG = TrackConfig("h-cmaes", scale=0.25, evaluations=20, device="cpu")
DRIVER = """
import sys, time
from mmocap_warp import cli
from mmocap_warp.tracking import checkpoint, tracker

checkpoint._INTERVAL = 0
step, waits_in, begun = tracker.Tracker.step, int(sys.argv[1]), []

def announced(self, observation):
    print("frame", flush=True)
    begun.append(True)
    if len(begun) == waits_in:
        time.sleep(600)
    return step(self, observation)

tracker.Tracker.step = announced
sys.exit(cli.main(sys.argv[2:]))
"""
"""Runs the command line, says when a frame begins, may wait in one until it is stopped, and saves after every one."""


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> Path:
    """The beginning of the built-in walk, with its true body and first pose as the subject."""
    folder = tmp_path_factory.mktemp("resume") / "walk"
    shutil.copytree(ROOT / "walk", folder)
    made = walking()
    write_subject(folder / "subject.usdc", Subject(made.body, made.root_base, made.poses[0], {}))
    text = (folder / "scene.toml").read_text()
    (folder / "scene.toml").write_text(
        text.replace("[scene]\n", f'[scene]\nframes = {FRAMES}\nsubject = "subject.usdc"\n')
    )
    return folder / "scene.toml"


@pytest.fixture(scope="module")
def loaded(scene) -> Scene:
    return load_scene(scene)


@pytest.fixture(scope="module")
def subject() -> Subject:
    made = walking()
    return Subject(made.body, made.root_base, made.poses[0], {})


def same_bits(left: Path, right: Path) -> bool:
    """Equal poses, costs, overlaps and counts; times aside."""
    a, b = read_result(left), read_result(right)
    names = ("pose", "cost", "iou", "evaluations", "status", "frame_numbers")
    return all(np.array_equal(getattr(a, name), getattr(b, name), equal_nan=True) for name in names)


def started(scene: Path, output: Path, waits_in: int = 0) -> subprocess.Popen:
    """A run in a process of its own, which prints a line as a frame begins and waits in the ``waits_in``-th, if any."""
    command = [str(waits_in), "track", str(scene), "-o", str(output), *FLAGS, "--resume"]
    return subprocess.Popen([sys.executable, "-c", DRIVER, *command], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)


def test_stopped_amid_frames_it_ends_with_the_same_bits(scene, tmp_path):
    """Killed amid its third frame, and interrupted amid the second frame after."""
    whole, stopped = tmp_path / "whole.usdc", tmp_path / "stopped.usdc"
    left = stopped.with_name("stopped.usdc.checkpoint")
    assert cli.main(["track", str(scene), "-o", str(whole), *FLAGS]) == console.OK
    for frames, how in ((3, signal.SIGKILL), (2, signal.SIGINT)):
        run = started(scene, stopped, frames)
        for _ in range(frames):
            assert run.stdout.readline() == b"frame\n"
        run.send_signal(how)
        run.communicate()
        assert left.exists()
        assert not stopped.exists()
    run = started(scene, stopped)
    assert run.communicate()[0].count(b"frame\n") <= FRAMES - 3
    assert run.returncode == console.OK
    assert same_bits(whole, stopped)
    assert not left.exists()


@pytest.mark.nightly
def test_stopped_at_random_moments_it_ends_with_the_same_bits(scene, tmp_path):
    whole, stopped = tmp_path / "whole.usdc", tmp_path / "stopped.usdc"
    left = stopped.with_name("stopped.usdc.checkpoint")
    assert cli.main(["track", str(scene), "-o", str(whole), *FLAGS]) == console.OK

    timed = started(scene, tmp_path / "timed.usdc")
    timed.stdout.readline()  # the first frame begins
    begun = time.monotonic()
    timed.communicate()
    assert timed.returncode == console.OK
    longest = time.monotonic() - begun

    random = np.random.default_rng(0)
    stops = continued = 0
    while True:
        if stopped.exists():  # it was done before its moment came: the next one starts from nothing
            assert same_bits(whole, stopped)
            stopped.unlink()
        continued += left.exists()
        run = started(scene, stopped)
        run.stdout.readline()
        if stops >= 10 and continued >= 2:  # enough of the moments came while it tracked
            run.communicate()
            assert run.returncode == console.OK
            break
        # Most are stopped before they are done, as one that was done costs a start. What is resumed goes on from
        # anywhere, so all of a run is stopped at, its last frame and the writing of its result too.
        time.sleep(random.uniform(0.0, 0.4) * longest)
        if run.poll() is None:
            run.send_signal(signal.SIGINT if stops % 2 else signal.SIGKILL)
            stops += 1
        run.communicate()
    assert same_bits(whole, stopped)
    assert not left.exists()


def test_a_run_that_replaces_a_result_is_resumed_too(scene, tmp_path, monkeypatch):
    """The result that was there belongs to the run before."""
    command = ["track", str(scene), "-o", str(tmp_path / "r.usdc"), *FLAGS]
    other = [*command, "--seed", "1"]
    assert cli.main(command) == console.OK
    with monkeypatch.context() as patched:
        patched.setattr("mmocap_warp.tracking.tracker.Tracker.step", stopping_step(after=5))
        assert cli.main([*other, "--force"]) == console.INTERRUPTED
    assert cli.main([*other, "--resume"]) == console.OK
    assert read_result(tmp_path / "r.usdc").config["seed"] == 1
    assert cli.main(["track", str(scene), "-o", str(tmp_path / "whole.usdc"), *FLAGS, "--seed", "1"]) == console.OK
    assert same_bits(tmp_path / "whole.usdc", tmp_path / "r.usdc")


def stopping_step(after: int):
    """A tracker's step that Ctrl-C hits amid frame number ``after``."""
    step, left = Tracker.step, iter(range(after, -1, -1))

    def stopping(tracker, observation):
        answer = step(tracker, observation)  # the frame is searched, but its answer never arrives
        if next(left) == 0:
            raise KeyboardInterrupt
        return answer

    return stopping


@pytest.fixture(scope="module")
def first_interrupted(loaded, subject, tmp_path_factory) -> Path:
    """The checkpoint of a run stopped amid its sixth frame."""
    path = tmp_path_factory.mktemp("interrupted") / "r.checkpoint"
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("mmocap_warp.tracking.tracker.Tracker.step", stopping_step(after=5))
        with pytest.raises(KeyboardInterrupt):
            track(loaded, subject, CONFIG, checkpoint=path)
    return path


@pytest.fixture
def interrupted(first_interrupted, tmp_path) -> Path:
    """This checkpoint in a folder of one's own."""
    return Path(shutil.copy(first_interrupted, tmp_path))


@pytest.fixture(scope="module")
def whole(loaded, subject) -> Result:
    """The result of a run that nothing stopped."""
    return track(loaded, subject, CONFIG)


def test_progress_reports_what_was_done_before(loaded, subject, interrupted):
    told = []
    track(loaded, subject, CONFIG, checkpoint=interrupted, resume=True, progress=lambda number, _: told.append(number))
    assert told == list(range(FRAMES))


def test_without_a_checkpoint_resuming_starts_from_the_first_frame(loaded, subject, tmp_path):
    result = track(loaded, subject, CONFIG, checkpoint=tmp_path / "none", resume=True)
    assert len(result.frame_numbers) == FRAMES


@pytest.mark.parametrize(
    "damage",
    [
        lambda content: b"",
        lambda content: b"not a checkpoint",
        lambda content: content[:40],
        lambda content: content[:40] + bytes(1000) + content[1040:],
    ],
    ids=["empty", "other content", "cut in its header", "overwritten header"],
)
def test_a_damaged_checkpoint_is_wrong_input(damage, loaded, subject, interrupted):
    interrupted.write_bytes(damage(interrupted.read_bytes()))
    with pytest.raises(InputError, match="is damaged, or no checkpoint; start anew with --force"):
        track(loaded, subject, CONFIG, checkpoint=interrupted, resume=True)


@pytest.mark.parametrize(
    ("damage", "kept"),
    [
        (lambda frames: frames[:-1], 4),
        (lambda frames: frames[: len(frames) // 2], 2),
        (lambda frames: frames[:-300] + bytes(300), 3),
        (lambda frames: frames[:100] + bytes(200) + frames[300:], 0),
        (lambda frames: frames + frames[-300:], 5),
    ],
    ids=["cut short", "cut in half", "zeros at its end", "overwritten", "half a frame too many"],
)
def test_frames_that_a_crash_spoilt_are_tracked_again(damage, kept, loaded, subject, interrupted, whole):
    magic, identity, frames = interrupted.read_bytes().split(b"\n", 2)
    interrupted.write_bytes(b"\n".join((magic, identity, damage(frames))))
    stepped, step = [], Tracker.step
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(Tracker, "step", lambda self, seen: stepped.append(1) or step(self, seen))
        resumed = track(loaded, subject, CONFIG, checkpoint=interrupted, resume=True)
    assert len(stepped) == FRAMES - kept
    np.testing.assert_array_equal(resumed.pose, whole.pose)
    np.testing.assert_array_equal(resumed.cost, whole.cost)


def test_the_number_of_threads_may_change(loaded, subject, interrupted, whole):
    one = TrackConfig("h-cmaes", scale=0.25, evaluations=20, device="cpu", threads=1)
    resumed = track(loaded, subject, one, checkpoint=interrupted, resume=True)
    np.testing.assert_array_equal(resumed.pose, whole.pose)
    np.testing.assert_array_equal(resumed.cost, whole.cost)


def answered(frames: int) -> list[checkpoint.FinishedFrame]:
    """Made-up answers of two runs before three cameras."""
    random = np.random.default_rng(1)
    done = []
    for _ in range(frames):
        pose, cost, iou = (random.random(shape) for shape in ((2, COORDINATES), 2, (2, 3)))
        answer = FrameAnswer(pose.astype(np.float32), cost.astype(np.float32), iou, 9, np.array([1, 3]), 0.5)
        done.append(checkpoint.FinishedFrame(answer, random.integers(0, 99, 2, np.int32)))
    return done


def test_a_checkpoint_gives_back_what_was_saved_however_often(tmp_path):
    done = answered(7)
    done[3].answer.cost[:], done[3].answer.iou[:] = np.nan, np.nan  # a lost frame
    store = checkpoint.Checkpoint(tmp_path / "c", IDENTITY, 2, COORDINATES, 3)
    for frames in (0, 2, 2, 3, 7):
        store.save(done[:frames])
    loaded, _memory = checkpoint.Checkpoint(tmp_path / "c", IDENTITY, 2, COORDINATES, 3).load()
    for mine, theirs in zip(loaded, done, strict=True):
        np.testing.assert_array_equal(mine.counter, theirs.counter)
        for field in fields(FrameAnswer):
            np.testing.assert_array_equal(getattr(mine.answer, field.name), getattr(theirs.answer, field.name))
    assert [file.name for file in tmp_path.iterdir()] == ["c"]


def test_a_save_writes_only_what_is_new(tmp_path, monkeypatch):
    """However long the recording, a save takes no longer and wears the disk no more."""
    packed, pack = [], checkpoint.Checkpoint._packed
    monkeypatch.setattr(checkpoint.Checkpoint, "_packed", lambda self, new: packed.append(len(new)) or pack(self, new))
    done, path = answered(9), tmp_path / "c"
    store = checkpoint.Checkpoint(path, IDENTITY, 2, COORDINATES, 3)
    store.save(done[:4])
    size = path.stat().st_size
    store.save(done[:6])
    assert path.stat().st_size - size == (size - len(store._header)) // 2
    resumed = checkpoint.Checkpoint(path, IDENTITY, 2, COORDINATES, 3)
    assert len(resumed.load()[0]) == 6
    resumed.save(done)
    assert packed == [4, 2, 3]


def test_a_checkpoint_is_saved_at_most_every_few_seconds(tmp_path, monkeypatch):
    now = [100.0]
    monkeypatch.setattr(checkpoint.time, "monotonic", lambda: now[0])
    store = checkpoint.Checkpoint(tmp_path / "c", IDENTITY, 2, COORDINATES, 3)
    assert not store.due
    now[0] += 2.0
    assert store.due
    store.save(answered(1))
    assert not store.due


def test_a_checkpoint_that_cannot_be_written_is_wrong_input(tmp_path):
    store = checkpoint.Checkpoint(tmp_path / "c", IDENTITY, 2, COORDINATES, 3)
    store.save(answered(1))
    (tmp_path / "c").unlink()
    with pytest.raises(InputError, match="cannot be written"):
        store.save(answered(2))


@pytest.mark.parametrize("algorithm", [pytest.param("apf", marks=pytest.mark.nightly), "psapf"])
def test_a_filters_particles_are_saved_with_its_last_frame(algorithm, loaded, subject, tmp_path, monkeypatch):
    """The run is stopped twice; every frame is saved, and in between the frames saved do not grow by the particles."""
    monkeypatch.setattr(checkpoint, "_INTERVAL", 0)
    begun = replace(loaded, frame_count=7)
    config = TrackConfig(algorithm, scale=0.1, evaluations=240, runs=2, device="cpu")
    path, sizes = tmp_path / "r.checkpoint", []
    for after in (2, 3):
        with monkeypatch.context() as patched:
            patched.setattr("mmocap_warp.tracking.tracker.Tracker.step", stopping_step(after))
            with pytest.raises(KeyboardInterrupt):
                track(begun, subject, config, checkpoint=path, resume=True)
        sizes.append(path.stat().st_size)
    assert sizes[1] - sizes[0] < 3 * 2 * 4 * (COORDINATES + 40)
    resumed = track(begun, subject, config, checkpoint=path, resume=True)
    whole = track(begun, subject, config)
    np.testing.assert_array_equal(resumed.pose, whole.pose)
    np.testing.assert_array_equal(resumed.cost, whole.cost)


def remembered(frames: int) -> dict[str, np.ndarray]:
    """A made-up memory after so many frames: arrays of two runs."""
    return {"particles": np.full((2, 5, 3), frames, np.float32), "mean": np.full((2, 3), -frames, np.float32)}


def spoilt(path: Path, found: bytes, times: int = 1) -> None:
    content = path.read_bytes()
    assert content.count(found) == times
    path.write_bytes(content.replace(found, bytes(len(found))))


def test_the_last_memory_but_one_serves_where_a_crash_spoilt_the_last(tmp_path):
    """The frames after it are tracked again; it is the other one that the next save replaces."""

    def store():
        return checkpoint.Checkpoint(tmp_path / "c", IDENTITY, 2, COORDINATES, 3, remembered(0))

    def kept():
        done, memory = store().load()
        for name, expected in remembered(len(done)).items() if done else ():
            np.testing.assert_array_equal(memory[name], expected)
        return len(done)

    done, first = answered(9), store()
    assert kept() == 0
    for frames in (2, 3, 5):
        first.save(done[:frames], remembered(frames))
        assert kept() == frames
    spoilt(tmp_path / "c", remembered(5)["particles"].tobytes())
    assert kept() == 3
    second = store()
    second.load()
    second.save(done[:4], remembered(4))
    assert kept() == 4
    spoilt(tmp_path / "c", remembered(4)["particles"].tobytes())
    assert kept() == 3
    spoilt(tmp_path / "c", remembered(3)["particles"].tobytes())
    assert kept() == 0


def test_a_memory_of_frames_that_a_crash_spoilt_is_not_used(tmp_path):
    store = checkpoint.Checkpoint(tmp_path / "c", IDENTITY, 2, COORDINATES, 3, remembered(0))
    done = answered(4)
    store.save(done[:2], remembered(2))
    store.save(done, remembered(4))
    content = (tmp_path / "c").read_bytes()
    (tmp_path / "c").write_bytes(content[:-100])
    loaded, memory = store.load()
    assert len(loaded) == 2
    np.testing.assert_array_equal(memory["particles"], remembered(2)["particles"])
