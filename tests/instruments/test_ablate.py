"""Ablations: every cell once, the right masks to every tracker, and numbers that say when a frame is wrong."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from ablate import REPORTING, TUNING, AblationCell, main, measures, purpose, run_ablation
from synthetic import synthetic_result

from mmocap_warp.cli import main as mmocap
from mmocap_warp.result.result import STATUS
from mmocap_warp.study.sequences import CLIP_PLANS, CLIPS
from mmocap_warp.study.source import Clip
from mmocap_warp.tracking.track_config import TrackConfig

NAME, FRAMES = "S1/Gestures", 9


@pytest.fixture(autouse=True)
def short(monkeypatch):
    """One sequence is a clip of nine frames."""
    monkeypatch.setitem(CLIP_PLANS, NAME, replace(CLIP_PLANS[NAME], frames=FRAMES))


def result(subject, rig, fps, pose, status=0):
    """Of one run with poses (frame, 51), from frame 0 on."""
    made = synthetic_result(frames=len(pose), runs=1, cameras=len(rig))
    statuses = np.broadcast_to(np.asarray(status, np.int8), len(pose)).reshape(made.status.shape)
    numbers = np.arange(len(pose))
    return replace(made, subject=subject, cameras=rig, fps=fps, frame_numbers=numbers, pose=pose[None], status=statuses)


class Tracker:
    """Stands still, and remembers what it was given."""

    def __init__(self):
        self.calls, self.skins = [], []

    def __call__(self, subject, rig, observations, fps, settings, seed):
        seen = list(observations)
        self.skins.append(subject.body.skin.rest)
        self.calls.append((settings.algorithm, len(rig), len(seen), fps, seed, rig.K[0, 0, 2]))
        return result(subject, rig, fps, np.tile(subject.pose, (len(seen), 1)))


def cells(degradations=("none",), algorithms=("h-cmaes",), seeds=1):
    return [
        AblationCell(Clip(NAME), way, name, TrackConfig(name, device="cpu"), seed)
        for way in degradations
        for seed in range(seeds)
        for name in algorithms
    ]


def ran(folder, asked, tracker):
    return run_ablation(folder, asked, lambda cell, measures: None, tracker)


# Which clips are for what


def test_half_of_the_clips_are_for_tuning_and_none_is_for_both():
    assert TUNING == ("S1/Gestures", "S2/Walking", "S2/Box", "S3/Gestures", "S2/Spin")
    assert not set(TUNING) & set(REPORTING)
    assert set(TUNING) | set(REPORTING) == set(CLIPS)
    assert {"S1/Spin", "Uneven/Walking", "Skirt/Walking", "Child/Walking"} <= set(REPORTING)
    assert purpose(Clip("S2/Box")) == "tuning"
    assert purpose(Clip("S1/Box")) == "reporting"
    assert purpose(Clip("mine")) == ""


# Cells


def test_every_tracker_gets_every_clip_made_worse(tmp_path):
    tracker = Tracker()
    rows = ran(tmp_path, cells(("none", "views=3+fps=30"), ("h-cmaes", "pso"), seeds=2), tracker)
    assert [call[:5] for call in tracker.calls] == [
        (name, views, frames, fps, seed)
        for views, frames, fps in ((7, 9, 60.0), (3, 5, 30.0))
        for seed in range(2)
        for name in ("h-cmaes", "pso")
    ]
    assert rows[-1]["cell"] == {
        "clip": NAME, "purpose": "tuning", "degradation": "views=3+fps=30", "start": "given", "tracker": "pso",
        "seed": 1, "frames": 5, "scale": 1.0,
    }  # fmt: skip
    assert rows[0]["measures"]["mpjpe_mm"] > 5


def test_a_wrong_calibration_differs_from_seed_to_seed(tmp_path):
    tracker = Tracker()
    ran(tmp_path, cells(("calibration=10",), ("h-cmaes", "pso"), seeds=2), tracker)
    principal = [call[-1] for call in tracker.calls]
    assert principal[0] == principal[1]
    assert principal[2] == principal[3]
    assert abs(principal[0] - principal[2]) > 0.1


def test_cells_that_are_there_are_read_and_what_is_new_is_tracked(tmp_path):
    first, second = Tracker(), Tracker()
    before = ran(tmp_path, cells(seeds=2), first)
    after = ran(tmp_path, cells(seeds=3), second)
    assert (len(first.calls), len(second.calls)) == (2, 1)
    assert after[:2] == before
    ran(tmp_path, [replace(cells()[0], settings=TrackConfig("h-cmaes", evaluations=7, device="cpu"))], second)
    ran(tmp_path, [replace(cells()[0], clip=Clip(NAME, frames=5))], second)
    ran(tmp_path, [replace(cells()[0], settings=TrackConfig("h-cmaes", threads=1, seed=5, device="cpu"))], second)
    assert len(second.calls) == 3  # threads and the settings' own seed are no other cell


def test_a_body_is_solved_once_for_all_trackers_from_the_masks_as_they_were_made_worse(tmp_path, monkeypatch):
    monkeypatch.setitem(CLIP_PLANS, NAME, replace(CLIP_PLANS[NAME], frames=4))
    tracker = Tracker()
    asked = [replace(cell, start="solved") for cell in cells(("none", "views=3"), ("h-cmaes", "pso"))]
    rows = ran(tmp_path, asked + cells(), tracker)
    assert [row["cell"]["start"] for row in rows] == ["solved"] * 4 + ["given"]
    one, same, other, _, given = tracker.skins
    assert one is same
    lengths = [np.ptp(skin[:, 1]) for skin in (one, other, given)]
    assert len({round(length, 6) for length in lengths}) == 3
    assert np.ptp(lengths) < 0.05


def test_a_start_that_is_none_is_refused():
    with pytest.raises(ValueError, match="given"):
        replace(cells()[0], start="there")


# Measures


def tracked(pose, status=0):
    """A result of the true body on the clip, and the clip's truth."""
    sequence = CLIPS[NAME]
    truth = sequence.truth
    subject = replace(sequence.subject, body=sequence.recording.body, root_base=truth.root_base)
    return result(subject, sequence.rig, sequence.fps, pose, status), truth


def test_the_truth_is_right_and_honest():
    known = measures(*tracked(CLIPS[NAME].truth.pose))
    assert known["mpjpe_mm"] < 0.1
    assert (known["off_frames"], known["longest_off"], known["wrongly_tracked"], known["near_tracked"]) == (
        0,
        0,
        0,
        1.0,
    )
    assert known["marker_error_mm"] < 5
    assert known["ms_per_frame"] > 0


def test_frames_that_are_off_are_counted_and_are_wrong_where_they_are_said_to_be_tracked():
    pose = CLIPS[NAME].truth.pose.copy()
    pose[[2, 5, 6, 7], 0] += 0.3
    status = np.zeros(FRAMES)
    status[6] = STATUS.index("lost")
    status[0], status[1] = STATUS.index("rescued"), STATUS.index("partial")
    known = measures(*tracked(pose, status))
    assert (known["off_frames"], known["longest_off"], known["wrongly_tracked"]) == (4, 3, 3)
    assert known["near_tracked"] == pytest.approx(4 / 5)
    assert known["growth"] == pytest.approx(2.0, rel=0.1)  # two of the last three frames against one of the first


def test_without_truth_nothing_is_said_of_errors():
    known = measures(tracked(CLIPS[NAME].truth.pose)[0], None)
    assert known["mpjpe_mm"] is known["wrongly_tracked"] is known["near_tracked"] is known["growth"] is None
    assert known["mean_iou"] is not None


# The script


def test_the_script_tracks_prints_and_goes_on(tmp_path, capsys):
    flags = [str(tmp_path / "made"), "--clip", NAME, "--frames", "2", "--device", "cpu"]
    flags += ["--degrade", "none", "--degrade", "views=2", "--tracker", "pso,evaluations=3,cost=iou", "--seeds", "2"]
    assert main(flags) == 0
    out, err = capsys.readouterr()
    assert err.count("pso,evaluations=3,cost=iou seed") == 4
    lines = out.splitlines()
    assert lines[0].split()[:6] == ["clip", "for", "degradation", "start", "tracker", "seeds"]
    assert [line.split()[:6] for line in lines[1:3]] == [
        [NAME, "tuning", way, "given", "pso,evaluations=3,cost=iou", "2"] for way in ("none", "views=2")
    ]
    table = (tmp_path / "made" / "ablation.csv").read_text().splitlines()
    assert table[0].startswith("clip,purpose,degradation,start,tracker,seed,frames,scale,marker_error_mm,")
    assert len(table) == 5
    files = {path: path.stat().st_mtime_ns for path in (tmp_path / "made").glob("*.json")}
    assert main([*flags, "--json", "--quiet"]) == 0
    again = json.loads(capsys.readouterr().out)
    assert [cell["settings"]["cost"] for cell in again["cells"]] == ["iou"] * 4
    assert {path: path.stat().st_mtime_ns for path in files} == files


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (["--clip", "S4/Jog"], "tuning, reporting, S1/Walking"),
        (["--degrade", "fog"], "views=COUNT"),
        (["--start", "there"], "'fitted'"),
        (["--tracker", "magic"], "h-cmaes"),
        (["--tracker", "pso,evaluation=3"], "evaluations"),
        (["--tracker", "pso,seed=3"], "seed holds for all trackers; use --seeds"),
        (["--seeds", "0"], "at least 1"),
        (["--frames", "0"], "at least 1"),
        (["--clip", NAME, "--degrade", "views=8", "--seeds", "1"], "1 to 7"),
    ],
)
def test_the_script_says_which_flag_is_wrong(tmp_path, capsys, flags, says):
    with pytest.raises(SystemExit, match="2"):
        main([str(tmp_path / "made"), *flags])
    assert says in capsys.readouterr().err


def test_a_clip_may_be_a_scene_with_a_subject_of_its_own(tmp_path, capsys):
    made = tmp_path / "made"
    assert mmocap(["study", "make", str(made), "--sequence", NAME, "--quiet"]) == 0
    scene = made / NAME / "scene.toml"
    text = scene.read_text()
    subject = scene.parent / "subject.usdc"
    scene.write_text("\n".join(line for line in text.splitlines() if not line.startswith("subject")))
    tracker = Tracker()
    clip = Clip("mine", scene, 3, 0.5, subject)
    (row,) = ran(tmp_path, [replace(cells()[0], clip=clip)], tracker)
    assert tracker.calls[0][1:3] == (7, 3)
    assert row["cell"]["purpose"] == ""
    assert row["measures"]["mpjpe_mm"] > 5
