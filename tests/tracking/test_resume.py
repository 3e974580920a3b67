"""An interrupted run continues and ends with the same bits, whatever moment it was stopped at."""

from __future__ import annotations

import io
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import fields, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from recordings import write_recording
from synthetic import COORDINATES

from mmocap_warp import cli
from mmocap_warp.body.model import Subject
from mmocap_warp.cli import console
from mmocap_warp.errors import InputError
from mmocap_warp.formats.usd.usd_body import read_subject
from mmocap_warp.formats.usd.usd_result import read_result
from mmocap_warp.result.result import FrameAnswer, Result
from mmocap_warp.scene.recording import Scene
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.tracking import checkpoint, frame_loop
from mmocap_warp.tracking.frame_loop import track
from mmocap_warp.tracking.track_config import TrackConfig
from mmocap_warp.tracking.tracker import Tracker, TrackState

FRAMES = 10
IDENTITY = {"seed": 1, "images": "a hash"}
FLAGS = ("--algorithm", "h-cmaes", "--scale", "0.5", "--evaluations", "60", "--device", "cpu", "--quiet")
CONFIG = TrackConfig("h-cmaes", scale=0.5, evaluations=20, device="cpu")
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
    """A figure before three cameras, with its true body and first pose as the subject."""
    folder = tmp_path_factory.mktemp("resume") / "made"
    write_recording(folder, FRAMES)
    return folder / "scene.toml"


@pytest.fixture(scope="module")
def loaded(scene) -> Scene:
    return load_scene(scene)


@pytest.fixture(scope="module")
def subject(scene) -> Subject:
    return read_subject(scene.with_name("subject.usdc"))


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


@pytest.mark.parametrize("after", [1, FRAMES + 4, 2 * FRAMES + 3])
def test_later_starts_are_reported_and_resumed(after, loaded, subject, tmp_path, monkeypatch):
    """Of a camera that froze, and one that was moved, whose views are left out then. Any start may be stopped."""
    frozen, moved, told, stepped, step = *np.zeros((2, FRAMES, 3), bool), [], [], Tracker.step
    frozen[2:6, 1] = moved[5:, 2] = True
    monkeypatch.setattr(frame_loop, "repeated_views", lambda seen: frozen)
    monkeypatch.setattr(frame_loop, "views_beside", lambda result: moved)
    monkeypatch.setattr(frame_loop, "_LEAST_VIEWS", 1)
    whole = track(loaded, subject, CONFIG, progress=lambda number, _: told.append(number))
    assert told == 3 * list(range(FRAMES))
    with monkeypatch.context() as patched:
        patched.setattr(Tracker, "step", stopping_step(after))
        with pytest.raises(KeyboardInterrupt):
            track(loaded, subject, CONFIG, checkpoint=tmp_path / "c")
    monkeypatch.setattr(Tracker, "step", lambda self, seen: stepped.append(1) or step(self, seen))
    result = track(loaded, subject, CONFIG, checkpoint=tmp_path / "c", resume=True)
    assert len(stepped) == 3 * FRAMES - after
    for name in ("pose", "cost", "iou", "status", "joint_sigma"):
        np.testing.assert_array_equal(getattr(result, name), getattr(whole, name), err_msg=name)
    assert np.isnan(result.iou[0][frozen | moved]).all()
    assert result.config["moved_views"] == {loaded.rig(1.0).names[2]: list(range(5, FRAMES))}


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
    one = TrackConfig("h-cmaes", scale=0.5, evaluations=20, device="cpu", threads=1)
    resumed = track(loaded, subject, one, checkpoint=interrupted, resume=True)
    np.testing.assert_array_equal(resumed.pose, whole.pose)
    np.testing.assert_array_equal(resumed.cost, whole.cost)


def answered(frames: int) -> list[FrameAnswer]:
    """Made-up answers of two runs before three cameras."""
    random = np.random.default_rng(1)
    done = []
    for _ in range(frames):
        pose, cost, iou = (random.random(shape) for shape in ((2, COORDINATES), 2, (2, 3)))
        done.append(FrameAnswer(pose.astype(np.float32), cost.astype(np.float32), iou, 9, np.array([1, 3]), 0.5))
    return done


def made_up_state(frames: int, *memory: np.ndarray) -> TrackState:
    """A state of two runs after so many frames."""
    return TrackState(np.zeros((2, COORDINATES), np.float32), np.array([frames, 2 * frames], np.int32), memory)


def made_up_checkpoint(path: Path) -> checkpoint.Checkpoint:
    return checkpoint.Checkpoint(path, IDENTITY, made_up_state(0), 3)


def save_up_to(store: checkpoint.Checkpoint, answers: list[FrameAnswer], first: int = 0) -> None:
    """Add answers, the first of which is that of frame ``first``, and save."""
    for frames, answer in enumerate(answers, first + 1):
        store.add(answer, made_up_state(frames))
    store.save()


def test_a_checkpoint_gives_back_what_was_saved_however_often(tmp_path):
    done = answered(7)
    done[3].cost[:], done[3].iou[:] = np.nan, np.nan  # a lost frame
    store = made_up_checkpoint(tmp_path / "c")
    for first, end in pairwise((0, 0, 2, 2, 3, 7)):
        save_up_to(store, done[first:end], first)
        loaded, state = made_up_checkpoint(tmp_path / "c").resumed()
        np.testing.assert_array_equal(state.counter, made_up_state(end).counter)
        np.testing.assert_array_equal(state.pose, done[end - 1].pose if end else made_up_state(0).pose)
    for mine, theirs in zip(loaded, done, strict=True):
        for field in fields(FrameAnswer):
            np.testing.assert_array_equal(getattr(mine, field.name), getattr(theirs, field.name))
    assert [file.name for file in tmp_path.iterdir()] == ["c"]


def test_a_save_writes_only_what_is_new(tmp_path, monkeypatch):
    """However long the recording, a save takes no longer and wears the disk no more."""
    written = []

    class WatchedFile(io.FileIO):
        def write(self, data):
            written.append(len(data))
            return super().write(data)

    monkeypatch.setattr(Path, "open", lambda path, mode="r", *_: WatchedFile(path, mode))
    monkeypatch.setattr(Path, "read_bytes", lambda path: WatchedFile(path).read())
    done, path = answered(9), tmp_path / "c"
    store = made_up_checkpoint(path)
    save_up_to(store, done[:4])
    size = path.stat().st_size
    save_up_to(store, done[4:6], 4)
    assert path.stat().st_size - size == (size - len(store._header)) // 2
    resumed = made_up_checkpoint(path)
    assert len(resumed.resumed()[0]) == 6
    save_up_to(resumed, done[6:], 6)
    frame = (size - len(store._header)) // 4
    assert [count for count in written if count] == [size, 2 * frame, 3 * frame]


def test_a_checkpoint_is_saved_at_most_every_few_seconds(tmp_path, monkeypatch):
    now = [100.0]
    monkeypatch.setattr(checkpoint.time, "monotonic", lambda: now[0])
    store, (answer, later) = made_up_checkpoint(tmp_path / "c"), answered(2)

    def saved_frames():
        store.save_if_due()
        return len(made_up_checkpoint(tmp_path / "c").resumed()[0])

    store.add(answer, made_up_state(1))
    assert saved_frames() == 0
    now[0] += 2.0
    assert saved_frames() == 1
    store.add(later, made_up_state(2))
    assert saved_frames() == 1
    now[0] += 2.0
    assert saved_frames() == 2


def test_a_checkpoint_that_cannot_be_written_is_wrong_input(tmp_path):
    store = made_up_checkpoint(tmp_path / "c")
    save_up_to(store, answered(1))
    (tmp_path / "c").unlink()
    with pytest.raises(InputError, match="cannot be written"):
        save_up_to(store, answered(1), 1)


@pytest.mark.parametrize("algorithm", [pytest.param("apf", marks=pytest.mark.nightly), "psapf"])
def test_a_filters_particles_are_saved_with_its_last_frame(algorithm, loaded, subject, tmp_path, monkeypatch):
    """The run is stopped twice; every frame is saved, and in between the frames saved do not grow by the particles."""
    monkeypatch.setattr(checkpoint, "_INTERVAL", 0)
    begun = replace(loaded, frame_count=7)
    config = TrackConfig(algorithm, scale=0.5, evaluations=240, runs=2, device="cpu")
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


def remembered(frames: int) -> TrackState:
    """A made-up state after so many frames: its memory are arrays of two runs."""
    return made_up_state(frames, np.full((2, 5, 3), frames, np.float32), np.full((2, 3), -frames, np.float32))


def spoilt(path: Path, content: bytes, times: int = 1) -> None:
    before = path.read_bytes()
    assert before.count(content) == times
    path.write_bytes(before.replace(content, bytes(len(content))))


def save_remembered(store: checkpoint.Checkpoint, frames: range) -> None:
    """Add the answers of frames, and save with the memory after the last of them."""
    for frame in frames:
        store.add(answered(9)[frame], remembered(frame + 1))
    store.save()


def test_the_last_memory_but_one_serves_where_a_crash_spoilt_the_last(tmp_path):
    """The frames after it are tracked again; it is the other one that the next save replaces."""

    def store():
        return checkpoint.Checkpoint(tmp_path / "c", IDENTITY, remembered(0), 3)

    def kept():
        done, state = store().resumed()
        for mine, expected in zip(state.search_memory, remembered(len(done)).search_memory, strict=True):
            np.testing.assert_array_equal(mine, expected)
        return len(done)

    first = store()
    assert kept() == 0
    for begin, end in pairwise((0, 2, 3, 5)):
        save_remembered(first, range(begin, end))
        assert kept() == end
    spoilt(tmp_path / "c", remembered(5).search_memory[0].tobytes())
    assert kept() == 3
    second = store()
    second.resumed()
    save_remembered(second, range(3, 4))
    assert kept() == 4
    spoilt(tmp_path / "c", remembered(4).search_memory[0].tobytes())
    assert kept() == 3
    spoilt(tmp_path / "c", remembered(3).search_memory[0].tobytes())
    assert kept() == 0


def test_a_memory_of_frames_that_a_crash_spoilt_is_not_used(tmp_path):
    store = checkpoint.Checkpoint(tmp_path / "c", IDENTITY, remembered(0), 3)
    save_remembered(store, range(2))
    save_remembered(store, range(2, 4))
    content = (tmp_path / "c").read_bytes()
    (tmp_path / "c").write_bytes(content[:-100])
    loaded, state = store.resumed()
    assert len(loaded) == 2
    np.testing.assert_array_equal(state.search_memory[0], remembered(2).search_memory[0])
