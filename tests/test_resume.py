"""An interrupted run continues and ends with the same bits, whatever moment it was stopped at."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from mmocap_warp import checkpoint, cli
from mmocap_warp.body import Subject
from mmocap_warp.cli import exit_codes
from mmocap_warp.errors import InputError
from mmocap_warp.formats.usd_body import write_subject
from mmocap_warp.formats.usd_result import read_result
from mmocap_warp.scene import Scene, load_scene
from mmocap_warp.scenes import ROOT
from mmocap_warp.synthesis.recording import walking
from mmocap_warp.tracker import TrackConfig, track

FRAMES = 16
STOPS = 10
FLAGS = ("--scale", "0.25", "--evaluations", "60", "--device", "cpu", "--quiet")
CONFIG = TrackConfig(scale=0.25, evaluations=20, device="cpu")
DRIVER = """
import sys
from mmocap_warp import checkpoint, cli, tracker

checkpoint._INTERVAL = 0
step = tracker.Tracker.step

def announced(self, observation):
    print("frame", flush=True)
    return step(self, observation)

tracker.Tracker.step = announced
sys.exit(cli.main(sys.argv[1:]))
"""
"""Runs the command line, says when a frame begins, and saves as often as saving takes little of the time."""


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


def test_stopped_at_ten_random_moments_it_ends_with_the_same_bits(scene, tmp_path):
    whole, stopped = tmp_path / "whole.usdc", tmp_path / "stopped.usdc"
    left = stopped.with_name("stopped.usdc.checkpoint")
    assert cli.main(["track", str(scene), "-o", str(whole), *FLAGS]) == exit_codes.OK

    def started(output: Path) -> subprocess.Popen:
        command = ["track", str(scene), "-o", str(output), *FLAGS, "--resume"]
        run = subprocess.Popen(
            [sys.executable, "-c", DRIVER, *command], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        )
        run.stdout.readline()  # the first frame begins
        return run

    timed = started(tmp_path / "timed.usdc")
    begun = time.monotonic()
    timed.communicate()
    assert timed.returncode == exit_codes.OK
    longest = time.monotonic() - begun

    random = np.random.default_rng(0)
    stops = continued = 0
    while True:
        if stopped.exists():  # it was done before its moment came: the next one starts from nothing
            assert same_bits(whole, stopped)
            stopped.unlink()
        continued += left.exists()
        run = started(stopped)
        if stops >= STOPS and continued >= STOPS // 4:  # enough of the moments came while it tracked
            run.communicate()
            assert run.returncode == exit_codes.OK
            break
        time.sleep(random.uniform(0.0, 1.0) * longest)
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
    assert cli.main(command) == exit_codes.OK
    with monkeypatch.context() as patched:
        patched.setattr("mmocap_warp.tracker.Tracker.step", stopping_step(after=5))
        assert cli.main([*other, "--force"]) == exit_codes.INTERRUPTED
    assert cli.main([*other, "--resume"]) == exit_codes.OK
    assert read_result(tmp_path / "r.usdc").config["seed"] == 1
    assert cli.main(["track", str(scene), "-o", str(tmp_path / "whole.usdc"), *FLAGS, "--seed", "1"]) == exit_codes.OK
    assert same_bits(tmp_path / "whole.usdc", tmp_path / "r.usdc")


def stopping_step(after: int):
    """A tracker's step that Ctrl-C hits amid frame number ``after``."""
    from mmocap_warp.tracker import Tracker

    step, left = Tracker.step, iter(range(after, -1, -1))

    def stopping(tracker, observation):
        answer = step(tracker, observation)  # the frame is searched, but its answer never arrives
        if next(left) == 0:
            raise KeyboardInterrupt
        return answer

    return stopping


@pytest.fixture
def interrupted(loaded, subject, tmp_path, monkeypatch) -> Path:
    """The checkpoint of a run stopped amid its sixth frame."""
    path = tmp_path / "r.checkpoint"
    with monkeypatch.context() as patched:
        patched.setattr("mmocap_warp.tracker.Tracker.step", stopping_step(after=5))
        with pytest.raises(KeyboardInterrupt):
            track(loaded, subject, CONFIG, checkpoint=path)
    return path


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
        lambda content: content[: len(content) // 2],
        lambda content: content[:200] + bytes(200) + content[400:],
    ],
    ids=["empty", "other content", "cut short", "overwritten"],
)
def test_a_damaged_checkpoint_is_wrong_input(damage, loaded, subject, interrupted):
    interrupted.write_bytes(damage(interrupted.read_bytes()))
    with pytest.raises(InputError, match="is damaged, or no checkpoint; start anew with --force"):
        track(loaded, subject, CONFIG, checkpoint=interrupted, resume=True)


def test_a_checkpoint_without_its_arrays_is_wrong_input(loaded, subject, interrupted):
    with interrupted.open("wb") as file:
        np.savez(file, key=np.array("other"))
    with pytest.raises(InputError, match="is damaged, or no checkpoint"):
        track(loaded, subject, CONFIG, checkpoint=interrupted, resume=True)


@pytest.mark.parametrize(
    "settings",
    [{"seed": 1}, {"evaluations": 21}, {"algorithm": "cmaes"}, {"dof": 28}, {"scale": 0.3}, {"limits": False}],
    ids=lambda settings: next(iter(settings)),
)
def test_a_checkpoint_of_other_settings_is_wrong_input(settings, loaded, subject, interrupted):
    other = TrackConfig(**{"scale": 0.25, "evaluations": 20, "device": "cpu"} | settings)
    with pytest.raises(InputError, match="another subject, cameras or settings"):
        track(loaded, subject, other, checkpoint=interrupted, resume=True)


def test_a_checkpoint_of_another_subject_is_wrong_input(loaded, subject, interrupted):
    other = Subject(subject.body, subject.root_base, subject.pose + 1e-3, {})
    with pytest.raises(InputError, match="another subject, cameras or settings"):
        track(loaded, other, CONFIG, checkpoint=interrupted, resume=True)


def test_the_number_of_threads_may_change(loaded, subject, interrupted):
    one = TrackConfig(scale=0.25, evaluations=20, device="cpu", threads=1)
    resumed = track(loaded, subject, one, checkpoint=interrupted, resume=True)
    whole = track(loaded, subject, CONFIG)
    np.testing.assert_array_equal(resumed.pose, whole.pose)
    np.testing.assert_array_equal(resumed.cost, whole.cost)


def test_a_checkpoint_is_saved_at_most_every_few_seconds(tmp_path, monkeypatch):
    """And so seldom that saving takes little of the time."""
    now = [100.0]
    monkeypatch.setattr(checkpoint.time, "monotonic", lambda: now[0])
    store = checkpoint.Checkpoint(tmp_path / "c", "key")
    assert not store.due
    now[0] += 2.0
    assert store.due
    nothing = np.zeros((0, 1))
    store.save(checkpoint.Progress(*[nothing] * 8))
    assert not store.due
