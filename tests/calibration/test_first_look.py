"""Before the first frame: masks and calibration that fit no body are refused by name, and sound recordings never."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from mmocap_warp import cli
from mmocap_warp.body.model import BodyModel, BodyMotion
from mmocap_warp.calibration import first_look
from mmocap_warp.calibration.first_look import FirstLook, look
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.cli.console import BAD_INPUT
from mmocap_warp.commands import inputs
from mmocap_warp.commands.caller import Reporter
from mmocap_warp.errors import InputError
from mmocap_warp.formats.calibration.toml_rig import write_toml_rig
from mmocap_warp.formats.usd.usd_body import read_body, read_motions
from mmocap_warp.rigging.shipped import body_file
from mmocap_warp.scene.recording import Scene
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.scenes import ROOT
from mmocap_warp.synthesis.any_body import recorded

Frames = list[list[np.ndarray]]
"""Per frame and camera (height, width) bool."""
Fault = Callable[[CameraRig, Frames], tuple[CameraRig, Frames]]
WALK = ROOT / "walk" / "scene.toml"


@cache
def body(name: str = "adult_man") -> BodyModel:
    return read_body(body_file(name))


@cache
def walk() -> tuple[Scene, CameraRig, Frames]:
    """The shipped walk: five cameras, three frames."""
    scene = load_scene(WALK)
    few = scene.of_frames(range(0, 61, 30))
    return scene, few.rig(0.5), list(few.masks(0.5))


def looked(
    monkeypatch, rig: CameraRig, frames: Frames, of: BodyModel | None = None, *, to_be_mended: bool = False
) -> FirstLook:
    """What a look at a recording of these cameras and masks says."""
    monkeypatch.setattr(first_look, "few_masks", lambda *given: (rig, frames))
    return look(walk()[0], of or body(), to_be_mended=to_be_mended)


def of_four() -> tuple[CameraRig, Frames]:
    """Two frames of four cameras."""
    _, rig, frames = walk()
    return rig.select(rig.names[:4]), [masks[:4] for masks in frames[:2]]


def inverted(rig: CameraRig, frames: Frames) -> tuple[CameraRig, Frames]:
    R = rig.R.transpose(0, 2, 1)
    return replace(rig, R=R, t=-np.einsum("kij,kj->ki", R, rig.t)), frames


def graphics(rig: CameraRig, frames: Frames) -> tuple[CameraRig, Frames]:
    axes = np.diag([1.0, -1.0, -1.0])
    return replace(rig, R=axes @ rig.R, t=rig.t @ axes), frames


def places(rig: CameraRig, frames: Frames) -> tuple[CameraRig, Frames]:
    return replace(rig, t=rig.centres), frames


def swapped(rig: CameraRig, frames: Frames) -> tuple[CameraRig, Frames]:
    return rig, [[masks[0], masks[3], masks[2], masks[1]] for masks in frames]


def changed(change: Callable[[np.ndarray], np.ndarray], *which: int) -> Fault:
    """Masks of some cameras are changed, of all where none is named; images that were turned have another size."""

    def fault(rig: CameraRig, frames: Frames) -> tuple[CameraRig, Frames]:
        some = which or range(len(rig))
        made = [
            [np.ascontiguousarray(change(mask)) if k in some else mask for k, mask in enumerate(masks)]
            for masks in frames
        ]
        return replace(rig, size=np.array([mask.shape[::-1] for mask in made[0]])), made

    return fault


def scaled(factor: float) -> Fault:
    return lambda rig, frames: (replace(rig, t=factor * rig.t), frames)


def zoomed(factor: float, *which: int) -> Fault:
    def fault(rig: CameraRig, frames: Frames) -> tuple[CameraRig, Frames]:
        K = rig.K.copy()
        K[list(which or range(len(rig))), :2] *= factor
        return replace(rig, K=K), frames

    return fault


def turned(degrees: float) -> Fault:
    """The second camera looks elsewhere."""

    def fault(rig: CameraRig, frames: Frames) -> tuple[CameraRig, Frames]:
        R, t = rig.R.copy(), rig.t.copy()
        turn = cv2.Rodrigues(np.array([0.0, np.radians(degrees), 0.0]))[0]
        R[1], t[1] = turn @ R[1], turn @ t[1]
        return replace(rig, R=R, t=t), frames

    return fault


def two_people(rig: CameraRig, frames: Frames) -> tuple[CameraRig, Frames]:
    apart = [[mask | np.roll(mask, 90, axis=1) for mask in masks] for masks in frames]
    return rig, apart


FAULTS: dict[str, tuple[Fault, str]] = {
    "inverted extrinsics": (inverted, "all cameras: rotation and translation are camera to world"),
    "axes of computer graphics": (graphics, "all cameras: camera axes are those of computer graphics"),
    "places for translations": (places, "all cameras: translations are the cameras' places"),
    "swapped": (swapped, "cam2 and cam4: one has the other's masks"),
    "one mirrored": (changed(np.fliplr, 1), "cam2: pictures are mirrored,"),
    "all mirrored": (changed(np.fliplr), "all cameras: pictures are mirrored,"),
    "one upside down": (changed(lambda mask: np.rot90(mask, 2), 1), "cam2: pictures are turned by 180"),
    "all upside down": (changed(lambda mask: np.rot90(mask, 2)), "all cameras: pictures are turned by 180"),
    "one on its side": (changed(np.rot90, 1), "cam2: pictures are turned by 90 degrees counterclockwise"),
    "all on their side": (
        changed(lambda mask: np.rot90(mask, 3)),
        "all cameras: pictures are turned by 90 degrees clockwise",
    ),
    "feet": (scaled(3.281), "as if feet had been read as metres"),
    "inches": (scaled(39.37), "as if inches had been read as metres"),
    "centimetres": (scaled(100), "as if centimetres had been read as metres"),
    "millimetres": (scaled(1000), "as if millimetres had been read as metres"),
    "metres as millimetres": (scaled(0.001), "as if metres had been read as millimetres"),
    "size of all images": (zoomed(1.5), "all cameras: pictures are 0.667 times as large"),
    "size of one image": (zoomed(0.5, 1), "cam2: pictures are 2 times as large"),
    "one view": (lambda rig, frames: (rig.select(rig.names[:1]), [masks[:1] for masks in frames]), "has one view"),
    "all empty": (changed(np.zeros_like), "no two views show anybody"),
    "one full": (changed(np.ones_like, 1), "cam2's masks are 100 % foreground"),
    "black for white": (changed(np.invert), "cam1's masks are 9"),
    "two people": (two_people, "two people"),
    "another way": (turned(15), "cam2 shows something else than the others"),
    "nothing in common": (
        lambda rig, frames: changed(lambda mask: np.roll(mask, 70, 0), 2)(*turned(15)(rig, frames)),
        "no common hull",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_is_refused_by_name(monkeypatch, fault: str) -> None:
    plant, says = FAULTS[fault]
    found = looked(monkeypatch, *plant(*of_four()))
    assert found.problem is not None
    assert says in found.problem
    assert found.remedy


def test_two_people_are_named_where_each_view_keeps_one_of_them(monkeypatch) -> None:
    rig, frames = of_four()
    one = [[np.roll(mask, 90 * (k % 2), axis=1) for k, mask in enumerate(masks)] for masks in frames]
    both = two_people(rig, frames)[1]
    monkeypatch.setattr(
        first_look, "few_masks", lambda scene, *given: (rig, both if scene.foreground.keep == "all" else one)
    )
    found = look(walk()[0], body())
    assert "two people" in str(found.problem)
    assert "nearest" in found.remedy
    assert "track both ([labels] several)" in found.remedy


def test_a_background_from_the_recording_may_hold_the_subject(monkeypatch) -> None:
    rig, frames = turned(15)(*of_four())
    monkeypatch.setattr(first_look, "few_masks", lambda *given: (rig, frames))
    scene = walk()[0]
    learnt = replace(scene, foreground=replace(scene.foreground, source="recording", keep="nearest"))
    assert "name a clean_plate" in look(learnt, body()).remedy


def hidden(mask: np.ndarray) -> np.ndarray:
    """The lower half of somebody is behind a block."""
    rows = np.flatnonzero(mask.any(axis=1))
    kept = mask.copy()
    kept[(rows[0] + rows[-1]) // 2 :] = False
    return kept


def cropped(rig: CameraRig, frames: Frames) -> tuple[CameraRig, Frames]:
    """Two images end at somebody's knees."""
    ends = {k: int(np.quantile(np.nonzero(frames[1][k])[0], 0.75)) for k in (0, 2)}
    size = rig.size.copy()
    for k, end in ends.items():
        size[k, 1] = end
    return replace(rig, size=size), [[mask[: ends.get(k, 9999)] for k, mask in enumerate(masks)] for masks in frames]


def one_bad_frame(rig: CameraRig, frames: Frames) -> tuple[CameraRig, Frames]:
    return rig, [frames[0], [np.roll(mask, 60, axis=1) for mask in frames[1]], frames[2]]


def some(*which: int) -> Fault:
    return lambda rig, frames: (
        rig.select(tuple(rig.names[k] for k in which)),
        [[masks[k] for k in which] for masks in frames],
    )


@pytest.mark.parametrize(
    ("change", "doubt"),
    [
        (some(0, 1, 2, 3, 4), None),
        (some(0, 1, 2), None),
        (some(0, 2), None),
        (lambda rig, frames: (rig, frames[:1]), None),
        (changed(hidden, 0, 2), "the views disagree"),
        (changed(hidden, 1), "cam2 disagrees with the other views"),
        (cropped, None),
        (one_bad_frame, None),
        (changed(np.zeros_like, 1), "cam2 shows nobody"),
        (turned(4), "cam2 disagrees with the other views"),
    ],
    ids=[
        "five views",
        "three views",
        "two views",
        "one frame",
        "legs hidden in two views",
        "legs hidden in one view",
        "partly out of two images",
        "one bad frame",
        "one view without anybody",
        "a camera somewhat off",
    ],
)
def test_sound_recordings_pass_and_doubts_name_the_camera(monkeypatch, change: Fault, doubt: str | None) -> None:
    _, rig, frames = walk()
    found = looked(monkeypatch, *change(rig, frames))
    assert found.problem is None
    assert len(found.doubts) == (doubt is not None)
    assert found.doubts == () or found.doubts[0].startswith(str(doubt))


def test_a_camera_that_can_be_mended_is_only_a_doubt(monkeypatch) -> None:
    found = looked(monkeypatch, *turned(15)(*of_four()), to_be_mended=True)
    assert found.problem is None
    assert found.doubts[0].startswith("cam2 shows something else")
    assert looked(monkeypatch, *swapped(*of_four()), to_be_mended=True).problem is not None


def test_of_a_small_subject_larger_images_are_compared(monkeypatch) -> None:
    """By every command that compares views: ``calib check`` names what the look refused."""
    _, rig, frames = walk()
    asked: list[int] = []

    def few_masks(scene: Scene, side: int, *start: object) -> tuple[CameraRig, Frames]:
        asked.append(side)
        far = [[cv2.erode(mask.astype(np.uint8), np.ones((9, 9))).astype(bool) for mask in masks] for masks in frames]
        return rig, far if len(asked) == 1 else frames

    monkeypatch.setattr(first_look, "few_masks", few_masks)
    views = first_look.few_views(walk()[0])
    assert asked[1] > asked[0]
    assert views.large_enough
    assert views.mistake()[1] is None


def of_recording(of: BodyModel, motion: BodyMotion, cameras: int) -> tuple[CameraRig, Frames]:
    made = recorded(of, motion, cameras, size=(320, 240))
    frames = np.linspace(0, len(made) - 1, 3).round().astype(int)
    return made.rig, [made.masks(int(frame)) for frame in frames]


def test_a_handstand_passes(monkeypatch) -> None:
    man = body()
    pose = np.zeros((1, man.skeleton.coordinates))
    pose[:, 5] = np.pi  # about the axis along which the body faces
    assert looked(monkeypatch, *of_recording(man, BodyMotion(30.0, pose), 4)) == FirstLook()


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["fox", "hand", "anymal", "panda"])
@pytest.mark.parametrize("cameras", [2, 3, 5])
def test_animals_and_robots_pass_in_every_motion(monkeypatch, name: str, cameras: int) -> None:
    for motion in read_motions(body_file(name)).values():
        found = looked(monkeypatch, *of_recording(body(name), motion, cameras), body(name))
        assert found == FirstLook()


def test_track_refuses_with_exit_3_and_goes_on_where_cameras_are_trusted(tmp_path: Path, capsys) -> None:
    scene = walk()[0]
    rig, _ = inverted(scene.calibrated, [])
    write_toml_rig(tmp_path / "calibration.toml", rig)
    text = WALK.read_text().replace('"masks/', f'"{WALK.parent.as_posix()}/masks/').replace('file = "truth.usdc"', "")
    (tmp_path / "scene.toml").write_text(text.replace("[truth]", ""))
    arguments = ["track", str(tmp_path), "-o", str(tmp_path / "result.usdc"), "--device", "cpu", "--frames", "3"]
    assert cli.main(arguments) == BAD_INPUT
    said = capsys.readouterr().err
    assert "camera to world" in said
    assert "mmocap calib check" in said
    assert "--trust-cameras" in said
    # The problem is passed on instead.
    wrong = load_scene(tmp_path)
    with pytest.raises(InputError, match="camera to world"):
        inputs.look_first(wrong, body(), Reporter(), trust=False)
    assert "camera to world" in inputs.look_first(wrong, body(), Reporter(), trust=True)["trusted_cameras"]
