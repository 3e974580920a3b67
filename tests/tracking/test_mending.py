"""A limb that was lost and is clicked in three frames comes back; what was clicked wrongly is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from walk_scene import walking

import mmocap_warp as mm
from mmocap_warp.body.skeleton import TRANSLATION
from mmocap_warp.cameras.rig import project
from mmocap_warp.errors import InputError, UsageError
from mmocap_warp.formats.usd.usd_result import write_result
from mmocap_warp.result.result import STATUS
from mmocap_warp.scenes import ROOT
from mmocap_warp.tracking import mending
from mmocap_warp.tracking.pins import read_pins

LOST = slice(8, 20)


@pytest.fixture(scope="module")
def scene():
    return mm.load_scene(ROOT / "walk", "0:30")


@pytest.fixture(scope="module")
def sound(scene):
    made = walking()
    subject = mm.Subject(made.body, made.root_base, made.poses[0], {})
    return mm.track(scene, subject, algorithm="contour", scale=0.25, device="cpu", threads=1)


@pytest.fixture(scope="module")
def faulty(sound):
    """The result with the left arm elsewhere in some frames."""
    skeleton, pose = sound.subject.body.skeleton, sound.pose.copy()
    for joint, turn in {"LShoulder": (0.9, 0.5, -0.6), "LElbow": (1.2, -0.5, 1.2)}.items():
        first = TRANSLATION + 3 * skeleton.joints.index(joint)
        pose[:, LOST, first : first + 3] += turn
    return replace(sound, pose=np.clip(pose, *skeleton.coordinate_limits.T))


def clicked(scene, result, frame, joint, cameras=2):
    """A pin where a result has a joint."""
    pixels = project(scene.calibrated, result.joints()[0, frame])[:, result.subject.body.skeleton.joints.index(joint)]
    views = zip(scene.calibrated.names[:cameras], pixels.round(1).tolist(), strict=False)
    return {"frame": int(result.frame_numbers[frame]), "joint": joint} | dict(views)


def off(result, other):
    """(frame,) how far the joint is that is farthest from where another result has it [m]."""
    return np.linalg.norm(result.joints()[0] - other.joints()[0], axis=-1).max(axis=-1)


def test_frames_without_masks_stay_lost_or_partial(scene, sound, faulty, monkeypatch):
    observations = mending._observations

    def some_empty(*of):
        seen = observations(*of)
        first = int(np.flatnonzero(sound.frame_numbers == of[2])[0])
        for frame, views in ((12, slice(None)), (13, 0)):
            empty = np.zeros(len(scene.calibrated), bool)
            empty[views] = True
            seen[frame - first] = seen[frame - first].without(empty)
        return seen

    monkeypatch.setattr(mending, "_observations", some_empty)
    pins = [clicked(scene, sound, frame, joint) for frame in (10, 14, 18) for joint in ("LElbow", "LWrist")]
    mended = mm.track(scene, again=faulty, pins=pins, device="cpu", threads=1)
    assert [STATUS[status] for status in mended.status[0, 11:15]] == ["tracked", "interpolated", "partial", "partial"]


def test_a_lost_limb_that_is_clicked_comes_back_and_other_frames_keep_their_bits(scene, sound, faulty):
    assert (off(faulty, sound)[LOST] > 0.2).all()
    pins = [clicked(scene, sound, frame, joint) for frame in (10, 14, 18) for joint in ("LElbow", "LWrist")]
    mended = mm.track(scene, again=faulty, pins=pins, device="cpu", threads=1)
    assert off(mended, sound).max() < 0.05
    (note,) = mended.config["mended"]
    assert note["pins"] == pins
    others = ~np.isin(mended.frame_numbers, range(note["frames"][0], note["frames"][1] + 1))
    assert others.any()
    for name, array in mended.arrays.items():
        np.testing.assert_array_equal(array[:, others], faulty.arrays[name][:, others])


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"frame": 99}, r"pins: \[pin 2\]: frame = 99 is not in the result; give one of the result's frames, 0 to 29"),
        ({"joint": "Hand"}, r"\[pin 2\]: joint = 'Hand' is not known; give one of Root, "),
        ({"cam9": [1, 2]}, r"\[pin 2\]: 'cam9' is no camera"),
        ({"second": [-9, 3]}, r"\[pin 2\]: \w+ = \[-9.0, 3.0\] is outside the image"),
        ({"second": None}, r"\[pin 2\]: names 1 camera; click the joint in two"),
        ({"second": [1, 1]}, r"\[pin 2\]: LWrist in frame 10: the pixels of .* contradict each other by \d+ mm"),
    ],
)
def test_a_pin_that_cannot_be_is_named(scene, sound, change, line):
    pin, second = clicked(scene, sound, 10, "LWrist"), scene.calibrated.names[1]
    wrong = pin | {second if key == "second" else key: value for key, value in change.items()}
    wrong = {key: value for key, value in wrong.items() if value is not None}
    with pytest.raises(InputError, match=line):
        read_pins([pin, wrong], sound, scene.calibrated)


def test_what_is_solved_again_must_be_said(scene, sound):
    with pytest.raises(UsageError, match="again needs pins, or frames first:end"):
        mm.track(scene, again=sound)
    with pytest.raises(UsageError, match="pins needs again"):
        mm.track(scene, pins=[])
    with pytest.raises(UsageError, match="scale cannot be given with again"):
        mm.track(scene, again=sound, frames="3:5", scale=0.5)
    with pytest.raises(UsageError, match="frames cannot be given with pins"):
        mm.track(scene, again=sound, frames="3:5", pins=[clicked(scene, sound, 4, "LWrist")])


def test_a_result_of_other_cameras_is_refused(scene, sound):
    names = tuple(f"other{k}" for k in range(len(sound.cameras)))
    other = replace(sound, cameras=replace(sound.cameras, names=names))
    listed = ", ".join(names)
    with pytest.raises(InputError, match=f"has the cameras cam1, .*, the result {listed}; name the scene that was"):
        mm.track(scene, again=other, frames="3:9")


def test_a_result_of_somebody_else_is_refused(scene, sound):
    other = replace(sound, config=sound.config | {"person": "anna"})
    with pytest.raises(InputError, match="is of anna, not of somebody without a name; give its own scene and --person"):
        mm.track(scene, again=other, frames="3:9")


def test_a_scene_that_has_changed_since_is_refused(scene, sound, tmp_path):
    turned = replace(scene.calibrated, K=scene.calibrated.K + np.array([[0, 0, 25.0], [0, 0, 0], [0, 0, 0]]))
    with pytest.raises(InputError, match="its cameras are not those of the result; give the calibration of then"):
        mm.track(replace(scene, calibrated=turned), again=sound, frames="3:9")
    later = replace(sound, frame_numbers=sound.frame_numbers + 60)
    with pytest.raises(InputError, match=r"has \d+ frames, the result goes to frame 89"):
        mm.track(scene, again=later, frames="3:9")
    with pytest.raises(InputError, match="is of the identity 3 in the masks; give the same --identity"):
        mm.track(scene, again=replace(sound, config=sound.config | {"identity": 3}), frames="3:9")
    refined = replace(sound, config=sound.config | {"refined_cameras": "r.calibration.toml"})
    with pytest.raises(InputError, match=r"\(r\.calibration\.toml\) are not beside it; give its file"):
        mm.track(scene, again=refined, frames="3:9")
    write_result(tmp_path / "r.usdc", refined)
    with pytest.raises(InputError, match=r"r\.usdc: its refined cameras .* are not beside it; copy them there"):
        mm.track(scene, again=tmp_path / "r.usdc", frames="3:9")


def test_pins_alone_say_which_frames_are_solved(scene, sound, monkeypatch):
    asked = []
    monkeypatch.setattr(mending, "mended", lambda scene, result, config, pins, span: asked.append(span) or result)
    mm.track(scene.of_frames(range(14)), again=sound, pins=[clicked(scene, sound, 4, "LWrist")])
    assert asked == [None]
