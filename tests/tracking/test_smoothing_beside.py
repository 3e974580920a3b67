"""A track that is smoothed while it grows, in a thread or another process, has the bits of one smoothed afterwards."""

from __future__ import annotations

from concurrent.futures import wait
from contextlib import closing
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from recordings import write_recording
from swinging import CONFIG, FPS, FRAMES, rough_track, swinging

from mmocap_warp.contour.clip import clip_problem as clip
from mmocap_warp.formats.usd.usd_body import read_subject
from mmocap_warp.masks.observation import KeptObservations
from mmocap_warp.result.result import STATUS, FrameAnswer
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.tracking import smoothing, smoothing_beside
from mmocap_warp.tracking.frame_loop import track
from mmocap_warp.tracking.smoothing import smoothed
from mmocap_warp.tracking.smoothing_beside import SmoothingBeside, SmoothingElsewhere
from mmocap_warp.tracking.track_config import TrackConfig


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    """A recording whose masks follow the tracked body; with its true body and first pose."""
    folder = tmp_path_factory.mktemp("smoothing") / "walk"
    write_recording(folder)
    scene = load_scene(folder)
    follows = replace(scene.foreground, keep="nearest")
    return replace(scene, foreground=follows), read_subject(folder / "subject.usdc")


def test_interrupted_while_it_is_smoothed_a_run_ends_with_the_same_bits(walk, tmp_path, monkeypatch):
    scene, subject = walk
    config = TrackConfig("cmaes", evaluations=20, device="cpu", scale=0.5, smooth=10.8)
    whole = track(scene, subject, config)

    def interrupt(_):
        raise KeyboardInterrupt

    path = tmp_path / "checkpoint"
    with pytest.raises(KeyboardInterrupt):
        track(scene, subject, config, checkpoint=path, smooth_progress=interrupt)
    with monkeypatch.context() as patched:
        patched.setattr("mmocap_warp.tracking.tracker.Tracker.step", None)  # no frame is searched again
        again = track(scene, subject, config, checkpoint=path, resume=True)
    for name in ("pose", "raw_pose", "cost", "iou", "status", "angle_sigma", "joint_sigma"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(again, name), err_msg=name)


@pytest.mark.parametrize("frames", [FRAMES, 1, 2])
def test_smoothed_while_it_is_tracked_a_clip_has_the_same_bits(monkeypatch, frames):
    monkeypatch.setattr(clip, "WINDOW", 8 / FPS)
    for module in clip, smoothing:
        monkeypatch.setattr(module, "AHEAD", 2 / FPS)
    monkeypatch.setattr(clip, "OVERLAP", 3 / FPS)
    seen, config = swinging()[1][:frames], replace(CONFIG, threads=2)
    track = rough_track(lost=(5, 6, 20, 23) if frames > 2 else ())
    names = ("pose", "cost", "iou", "status")
    track = replace(
        track, frame_numbers=np.arange(frames), evaluations=track.evaluations[:, :frames],
        **{name: getattr(track, name)[:, :frames] for name in names},
    )  # fmt: skip
    whole = smoothed(track, config, seen)
    # What is read too early is wrong.
    blank = {name: np.full_like(getattr(track, name), np.nan) for name in names[:3]}
    room = replace(track, status=np.full_like(track.status, STATUS.index("lost")), **blank)
    with KeptObservations() as kept, closing(SmoothingBeside(kept, None)) as beside:
        beside.begin(room, config)
        for frame, observation in enumerate(seen):
            kept.add(observation)
            columns = (getattr(track, name)[:, frame] for name in names[:3])
            beside.add(frame, FrameAnswer(*columns, 1, track.status[:, frame], 0.0))
        result = beside.of(track)
    for name, array in whole.arrays.items():
        np.testing.assert_array_equal(getattr(result, name), array, err_msg=name)


def test_an_error_of_the_smoothing_stops_the_track_at_the_next_frame(monkeypatch):
    def broken(raw, config, observations, progress):
        next(observations)
        raise ZeroDivisionError

    monkeypatch.setattr(smoothing_beside, "smoothed", broken)
    seen, track = swinging()[1], rough_track()
    answers = [FrameAnswer(pose, *(np.ones(1),) * 2, 1, 0, 0.0) for pose in np.moveaxis(track.pose, 1, 0)]
    with KeptObservations() as kept, closing(SmoothingBeside(kept, None)) as beside:
        beside.begin(track, CONFIG)
        for frame in range(2):
            kept.add(seen[frame])
            beside.add(frame, answers[frame])
        wait([beside._smoothed])
        with pytest.raises(ZeroDivisionError):
            beside.add(2, answers[2])


def test_a_track_goes_on_without_what_smooths_it_where_the_disk_is_full(monkeypatch):
    seen, track = swinging()[1], rough_track()
    answers = [FrameAnswer(pose, *(np.ones(1),) * 2, 1, 0, 0.0) for pose in np.moveaxis(track.pose, 1, 0)]
    with KeptObservations() as kept, closing(SmoothingBeside(kept, None)) as beside:
        beside.begin(track, CONFIG)
        kept.add(seen[0])
        beside.add(0, answers[0])
        monkeypatch.setattr(kept, "_file", SimpleNamespace(seek=full, close=lambda: None))
        for frame in (1, 2):
            kept.add(seen[frame])
            beside.add(frame, answers[frame])
        wait([beside._smoothed])
        beside.add(3, answers[3])
    assert len(kept) == 0


def full(*_: object) -> None:
    raise OSError(28, "No space left on device")


def test_an_interrupted_track_leaves_no_thread_waiting():
    seen, track = swinging()[1], rough_track()
    with KeptObservations() as kept, closing(SmoothingBeside(kept, None)) as beside:
        beside.begin(track, CONFIG)
        kept.add(seen[0])
    with pytest.raises(InterruptedError):
        beside._smoothed.result(timeout=60)


def test_another_process_smooths_a_growing_track_to_the_same_bits():
    seen, track, done = swinging()[1], rough_track(lost=(5, 6)), []
    whole = smoothed(track, CONFIG, seen)
    room = replace(track, pose=np.full_like(track.pose, np.nan))
    with KeptObservations() as kept, closing(SmoothingElsewhere(kept, done.append)) as beside:
        beside.begin(room, CONFIG)
        for frame, observation in enumerate(seen):
            kept.add(observation)
            columns = (getattr(track, name)[:, frame] for name in ("pose", "cost", "iou"))
            beside.add(frame, FrameAnswer(*columns, 1, track.status[:, frame], 0.0))
        result = beside.of(track)
    assert done[-1:] in ([], [FRAMES])  # what was done before the last frame came is not told
    assert beside._process.returncode is not None
    beside.close()  # again, as after frames that repeat
    for name, array in whole.arrays.items():
        np.testing.assert_array_equal(getattr(result, name), array, err_msg=name)


@pytest.mark.parametrize("fails", [True, False])
def test_a_long_track_is_smoothed_by_another_process_or_else_afterwards(monkeypatch, walk, fails):
    scene, subject = walk
    config = TrackConfig(device="cpu", scale=0.5, threads=2)
    whole = track(scene, subject, config)
    monkeypatch.setattr(smoothing_beside, "_LEAST_FRAMES", 1)
    answers = []

    def of(self, tracked, of=SmoothingElsewhere.of):
        if fails:
            self._process.kill()
        answers.append(of(self, tracked))
        return answers[-1]

    monkeypatch.setattr(SmoothingElsewhere, "of", of)
    again = track(scene, subject, config)
    assert [answer is None for answer in answers] == [fails]
    for name in ("pose", "raw_pose", "cost", "iou", "status", "angle_sigma", "joint_sigma"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(again, name), err_msg=name)


def test_what_cannot_be_handed_on_lets_no_track_wait():
    seen, track = swinging()[1], rough_track()
    with KeptObservations() as kept, closing(SmoothingElsewhere(kept, None)) as beside:
        beside.begin(track, CONFIG)
        kept.add(seen[0])
        beside.add(0, lambda: None)  # no process can be told of a function without a name
        assert beside.of(track) is None


@pytest.mark.parametrize(
    ("frames", "settings", "kind"),
    [
        (240, {}, SmoothingElsewhere),
        (239, {}, SmoothingBeside),
        (240, {"threads": 1}, type(None)),
        (240, {"smooth": 0.0}, type(None)),
    ],
)
def test_what_smooths_a_track_beside_it(frames, settings, kind):
    config = TrackConfig(**{"device": "cpu", "threads": 2} | settings)
    with KeptObservations() as kept, smoothing_beside.smoothing_beside(frames, config, kept, None) as beside:
        assert type(beside) is kind


def test_a_track_that_fails_leaves_no_process(monkeypatch, walk):
    monkeypatch.setattr(smoothing_beside, "_LEAST_FRAMES", 1)
    processes = []
    begin = SmoothingElsewhere.begin
    monkeypatch.setattr(SmoothingElsewhere, "begin", lambda self, *room: (processes.append(self), begin(self, *room)))

    def interrupt(*_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        track(*walk, TrackConfig(device="cpu", scale=0.5, threads=2), progress=interrupt)
    assert [each._process.returncode is not None for each in processes] == [True]
