"""What is planted in a recording is there, and nothing else changes; motions for the instruments are as they say."""

from __future__ import annotations

import planted_faults
import pytest
from flip_and_punch import flip_and_punch
from planted_faults import FAULTS, Outcome, Recorded, opened

from mmocap_warp.rigging.shipped import load_body
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.scenes import ROOT


@pytest.fixture
def walk(monkeypatch) -> Recorded:
    monkeypatch.setattr(planted_faults, "_COUNT", 4)
    return opened(ROOT / "walk" / "scene.toml")


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_changes_the_calibration_or_the_images(walk: Recorded, fault: str) -> None:
    planted = FAULTS[fault](walk)
    of_calibration = any((getattr(planted.rig, name) != getattr(walk.rig, name)).any() for name in ("K", "R", "t"))
    others = ("calibration", "extrinsics", "px off", "degree off", "degrees off")
    assert of_calibration == any(word in fault for word in others)
    same = all(
        len(now) == len(before)
        and all(one.shape == other.shape and (one == other).all() for one, other in zip(now, before, strict=True))
        for now, before in zip(planted.frames, walk.frames, strict=True)
    )
    assert same == (of_calibration or fault == "one view")
    assert (planted.text != walk.text) == (fault in {"one view", "no clean plate"})


def test_a_recording_is_written_as_a_scene(walk: Recorded, tmp_path) -> None:
    scene = load_scene(walk.write(tmp_path / "walk"))
    assert scene.frame_count == 4
    assert scene.truth is not None
    assert scene.subject is None
    assert len(load_scene(FAULTS["one view"](walk).write(tmp_path / "one")).cameras) == 1


def test_a_row_says_what_became_of_the_frames() -> None:
    refused = Outcome(3, "no", {}, None, None, 1.0)
    assert refused.row("a fault") == "| a fault | 3 | no |  |  |  | 1.00 |"
    done = Outcome(0, "40 of 40 frames trusted", {"lost": 0, "partial": 2}, 0.0, 3.71, 0.5)
    assert done.row("b") == "| b | 0 | 40 of 40 frames trusted | 2 partial | 0 | 3.7 | 0.50 |"


@pytest.mark.parametrize("in_air", ["knees", "pressed"])
def test_a_flip_turns_once_and_keeps_the_limits(in_air: str) -> None:
    body, motion = load_body("adult_man"), flip_and_punch(in_air)
    low, high = body.skeleton.coordinate_limits.T
    assert ((motion.pose >= low - 1e-6) & (motion.pose <= high + 1e-6)).all()
    turned = motion.pose[:, body.skeleton.coordinate_names.index("Root.Rx")]
    assert turned[-1] - turned[0] == pytest.approx(-6.2832, abs=1e-3)
