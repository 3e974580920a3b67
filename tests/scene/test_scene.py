"""Scenes: what is read from where, which frames there are, and one clear line for everything that can be wrong."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from ball_scene import FRAMES, HEIGHT, RIG, SCENE, WIDTH, ball_mask, ball_scene, edit, write_video

from mmocap_warp.errors import InputError
from mmocap_warp.formats.calibration.toml_rig import read_toml_rig
from mmocap_warp.scene.mask_writing import write_masks
from mmocap_warp.scene.recording import Scene
from mmocap_warp.scene.scene_toml import load_scene

__all__ = ["ball_scene"]


def test_what_a_scene_says(folder: Path) -> None:
    edit(folder, "up =", 'body = "adult_man"\nup =')
    (folder / "truth.trc").touch()
    edit(folder, "[track]", '[truth]\nfile = "truth.trc"\naxes = "zxy"\nfirst_frame = 1\n[fit]\nstarts = 4\n[track]')
    scene = load_scene(folder)
    assert (scene.name, scene.fps, scene.frame_count, scene.directory) == ("ball", 30.0, FRAMES, folder)
    assert (scene.body, scene.subject) == ("adult_man", None)
    assert (scene.truth, scene.truth_axes, scene.truth_first_frame) == (folder / "truth.trc", "zxy", 1)
    assert (scene.track, scene.fit) == ({"evaluations": 500}, {"starts": 4})
    assert scene.rig(0.5).names == RIG.names
    np.testing.assert_allclose(scene.rig(0.5).K, RIG.undistorted(0.5).K)


def test_masks_are_those_of_the_files(folder: Path) -> None:
    scene = load_scene(folder / "scene.toml")
    for frame, observation in enumerate(scene.observations(first=1, count=3), 1):
        np.testing.assert_array_equal(observation.foreground, [ball_mask(k, frame).sum() for k in range(3)])
    for masks in scene.masks(0.5):
        assert [mask.shape for mask in masks] == [(HEIGHT // 2, WIDTH // 2)] * 3
    images = next(scene.images(0.5))
    assert images[0] is not None
    assert images[0].shape == (HEIGHT // 2, WIDTH // 2, 3)
    with pytest.raises(ValueError, match="frames 3 to 5 are not in 0 to 4"):
        next(scene.masks(first=3, count=3))


@pytest.mark.parametrize("model", ["gaussian", "mog2", "knn"])
@pytest.mark.parametrize("source", ["clean_plate", "background_video"])
def test_subtracted_masks_are_those_of_the_files(folder: Path, source: str, model: str) -> None:
    write_video(folder / "empty.mkv", [cv2.imread(str(folder / "plate.png"))] * 3)
    edit(folder, 'clean_plate = "plate.png"', 'clean_plate = "plate.png"\nbackground = "empty.mkv"')
    edit(folder, '"masks"', f'"{source}"\nmodel = "{model}"\nmedian = 0\nclose = 0\nmin_area = 50')
    for frame, masks in enumerate(load_scene(folder).masks()):
        for k, mask in enumerate(masks):
            np.testing.assert_array_equal(mask, ball_mask(k, frame))


def test_what_a_scene_says_of_subtracted_masks_stays_however_small_its_images(folder: Path) -> None:
    edit(folder, '"masks"', '"clean_plate"\nclose = 20')
    made = load_scene(folder).foreground
    assert (made.close, made.median) == (20, 12 * WIDTH / 1920)


def test_a_mask_video_equals_a_mask_folder(folder: Path) -> None:
    frames = [np.dstack([ball_mask(1, frame).astype(np.uint8) * 255] * 3) for frame in range(FRAMES)]
    write_video(folder / "mask.mkv", frames)
    expected = [masks[1] for masks in load_scene(folder).masks()]
    edit(folder, "masks/cam02", "mask.mkv")
    for masks, mask in zip(load_scene(folder).masks(), expected, strict=True):
        np.testing.assert_array_equal(masks[1], mask)


def test_a_late_camera_is_shifted_and_lost_at_the_end(folder: Path) -> None:
    edit(folder, 'masks = "masks/cam03"', 'masks = "masks/cam03"\nframe_offset = 2')
    scene = load_scene(folder)
    assert scene.frame_count == FRAMES
    for frame, masks in enumerate(scene.masks()):
        np.testing.assert_array_equal(masks[0], ball_mask(0, frame))
        late = ball_mask(2, frame + 2) if frame + 2 < FRAMES else np.zeros((HEIGHT, WIDTH), bool)
        np.testing.assert_array_equal(masks[2], late)
    *_, last = scene.images()
    assert last[2] is None
    edit(folder, "frame_offset = 2", "frame_offset = -1")
    first = next(load_scene(folder).observations())
    assert first.foreground[2] == 0


@pytest.mark.parametrize("keep", ["all", "largest", "nearest"])
@pytest.mark.parametrize("model", ["gaussian", "mog2", "knn"])
def test_the_masks_of_a_frame_do_not_depend_on_where_reading_starts(model: str, keep: str, folder: Path) -> None:
    edit(folder, '"masks"', f'"clean_plate"\nmodel = "{model}"\nkeep = "{keep}"')
    scene = load_scene(folder)
    *_, last = scene.observations()
    np.testing.assert_array_equal(next(scene.observations(first=FRAMES - 1)).words, last.words)


def test_the_nearest_component_follows_the_body(folder: Path) -> None:
    path = folder / "masks" / "cam01" / "0002.png"
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    image[:, :40] = 255  # larger than the ball
    cv2.imwrite(str(path), image)
    edit(folder, '"masks"', '"masks"\nkeep = "nearest"\njoin = 2')
    scene = load_scene(folder)
    followed = [masks[0] for masks in scene.masks()]
    np.testing.assert_array_equal(followed[2], ball_mask(0, 2))
    told = next(scene.masks(first=2, body=lambda: [ball_mask(k, 1) for k in range(3)]))
    np.testing.assert_array_equal(told[0], ball_mask(0, 2))
    np.testing.assert_array_equal(next(scene.masks(first=2))[0], followed[2])  # as if read from the first frame on


def test_a_refined_centre_moves_the_pinhole_and_not_the_picture(folder: Path) -> None:
    plain = load_scene(folder)
    before = next(plain.masks())
    edit(folder, 'masks = "masks/cam02"', 'masks = "masks/cam02"\ncentre_shift = [3.0, -2.0]')
    refined = load_scene(folder)
    np.testing.assert_allclose(refined.rig().K[1, :2, 2] - plain.rig().K[1, :2, 2], [3.0, -2.0])
    np.testing.assert_array_equal(next(refined.masks())[1], before[1])


def test_few_frames_are_in_memory(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import mmocap_warp.scene.recording as module

    decoded = []
    original = module.decode_mask
    monkeypatch.setattr("mmocap_warp.scene.frame_choice._FRAMES_AHEAD", 1)
    monkeypatch.setattr(module, "decode_mask", lambda *image: decoded.append(0) or original(*image))
    stream = load_scene(folder).masks()
    for frame in range(3):
        next(stream)
        assert 3 * (frame + 1) <= len(decoded) <= 3 * (frame + 3)  # one is read, and one waits


def test_written_masks_are_a_scene_that_reads_back(folder: Path) -> None:
    scene = load_scene(folder)
    done: list[int] = []
    again = load_scene(write_masks(scene.of_frames(range(1, 4)), folder / "new", scale=0.5, progress=done.append))
    assert done == [1, 2, 3]
    for masks, expected in zip(again.masks(0.5), scene.masks(0.5, 1, 3), strict=True):
        for mask, same in zip(masks, expected, strict=True):
            np.testing.assert_array_equal(mask, same)
    np.testing.assert_allclose(again.rig(0.5).K, scene.rig(0.5).K, rtol=0, atol=1e-12)
    pinholes = read_toml_rig(folder / "new" / "pinholes.toml")
    np.testing.assert_allclose(pinholes.K, scene.rig(0.5).K, rtol=0, atol=1e-12)
    assert sorted(path.name for path in (folder / "new").iterdir()) == [
        *RIG.names,
        "overlay.webm",
        "pinholes.toml",
        "scene.toml",
    ]
    assert cv2.imread(str(folder / "new" / "cam01" / "000000.png"), cv2.IMREAD_UNCHANGED).ndim == 2
    assert (folder / "new" / "cam01" / "000000.png").read_bytes()[24] == 1  # bits per pixel


BALANCING = Path(__file__).parents[2] / "scenes" / "balancing"


@pytest.mark.parametrize("frame", [4, pytest.param(40, marks=pytest.mark.nightly)])
@pytest.mark.parametrize("name", ["scene.toml", "as_shipped.toml"])
def test_the_balancing_recording(shared_data: Path, name: str, frame: int) -> None:
    """All frames before the one that is asked for are read: the background's model remembers them."""
    scene = load_scene(BALANCING / name)
    assert scene.frame_count == 100
    assert scene.truth is not None
    observation = next(scene.observations(0.25, frame, 1))
    assert observation.words.shape == (4, 480, 9)
    assert (observation.foreground > 4000).all()


@pytest.mark.nightly
def test_a_camera_of_the_balancing_recording_is_a_frame_late(shared_data: Path) -> None:
    assert next(load_scene(BALANCING / "scene.toml").observations(0.25, 99)).foreground[2] == 0


def without(scene: Path, *names: str) -> None:
    for name in names:
        (scene / name).unlink()


def replace_masks(folder: Path, value: int) -> None:
    for path in (folder / "masks" / "cam02").iterdir():
        cv2.imwrite(str(path), np.full((HEIGHT, WIDTH), value, np.uint8))


def truncate_video(folder: Path) -> None:
    path = folder / "cam01.mkv"
    frames = np.random.default_rng(0).integers(0, 255, (40, HEIGHT, WIDTH, 3), np.uint8)
    frames[:, HEIGHT // 2 :] = 0
    write_video(path, list(frames))
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 20])
    edit(folder, "masks/cam01", "cam01.mkv")
    edit(folder, "fps = 30", "fps = 30\nframes = 5")
    list(load_scene(folder).masks())


def repair_with_two(folder: Path) -> None:
    edit(folder, SCENE[SCENE.index("[cameras.cam03]") : SCENE.index("[foreground]")], "")
    edit(folder, '"masks"', '"masks"\nrepair = true')


def case(old: str, new: str, message: str, name: str = "scene.toml") -> tuple[Callable[[Path], object], str]:
    return (lambda folder: edit(folder, old, new, name), message)


MASKS = 'masks = "masks/cam02"'
THING = '[[attach]]\nname = "Bat"\nmesh = "calibration.toml"\n'
WRONG: dict[str, tuple[Callable[[Path], object], str]] = {
    "no scene": (lambda f: without(f, "scene.toml"), r"scene\.toml: no such file; check the path"),
    "not TOML": case("fps = 30", "fps = ", r"is not valid TOML: .*line 4"),
    "not text": (lambda f: (f / "scene.toml").write_bytes(b"\xff\xfe\x00"), r"cannot be read .* give a TOML text file"),
    "unknown table": case("[track]", "[tracker]", r"unknown key 'tracker'; did you mean 'track'\?"),
    "unknown key": case("fps = 30", "fps = 30\nnmae = 1", r"\[scene\]: unknown key 'nmae'; did you mean 'name'\?"),
    "unknown camera key": case('video = "cam01', 'vidoe = "cam01', r"\[cameras\.cam01\]: unknown key 'vidoe'; did you"),
    "fps a word": case("fps = 30", 'fps = "30"', r"fps = '30' is not a number; give a number"),
    "fps zero": case("fps = 30", "fps = 0", r"fps = 0 is not a frame rate"),
    "fps negative": case("fps = 30", "fps = -30", r"fps = -30 is not a frame rate"),
    "fps NaN": case("fps = 30", "fps = nan", r"fps is not finite"),
    "up": case('"+y"', '"y"', r"up = 'y' is not known; use one of '\+x'"),
    "no calibration": (lambda f: without(f, "calibration.toml"), r"calibration\.toml: no such file"),
    "unknown calibration format": case(
        "calibration.toml",
        "plate.png",
        r"plate\.png: ends in '\.png', which is none of the known formats; give Pose2Sim.* TOML \(\.toml\) or Qualisys",
    ),
    "calibration not named": case("calibration =", "units =", r"\[cameras\]: 'calibration' is missing"),
    "units": case(
        "[cameras.cam01]", 'units = "inch"\n[cameras.cam01]', r"units = 'inch' is not known; use one of 'm', 'mm'"
    ),
    "wrong units": case(
        "[cameras.cam01]", 'units = "mm"\n[cameras.cam01]', r"within .* mm of each other; check the transl"
    ),
    "camera not calibrated": case(
        "[cameras.cam01]", "[cameras.cam1]", r"'cam1' is not in calibration\.toml; .* did you mean 'cam01'"
    ),
    "camera twice": case("[cameras.cam02]", "[cameras.cam01]", r"is not valid TOML: .*cam01"),
    "camera name twice": case(
        'name = "cam02"', 'name = "cam01"', r"camera name 'cam01' is used twice", "calibration.toml"
    ),
    "NaN calibration": case(
        "translation = [", "translation = [nan, 0, 0]\nx = [", r"translation holds a value", "calibration.toml"
    ),
    "no masks named": case(f"{MASKS}\n", "", r"\[cameras\.cam02\]: 'masks' is missing, which .* needs; add masks"),
    "no mask folder": case("masks/cam02", "masks/cam9", r"cam9: no such file or folder; check the path"),
    "no images": (lambda f: without(f, *(f"masks/cam02/000{i}.png" for i in range(5))), r"cam02: holds no images"),
    "missing image": (lambda f: without(f, "masks/cam02/0002.png"), r"cam02: image 2 is missing"),
    "counts differ": (
        lambda f: without(f, "masks/cam02/0004.png"),
        r"differ in their number of frames: .*cam02 4.*; set frames = 4",
    ),
    "too many frames": case("fps = 30", "fps = 30\nframes = 6", r"frames = 6 is not in 1 to 5"),
    "no frames": case("fps = 30", "fps = 30\nframes = 0", r"frames = 0 is not in 1 to 5"),
    "not an image": (
        lambda f: (f / "masks/cam02/0000.png").write_text("no"),
        r"0000\.png: cannot be decoded as an image",
    ),
    "empty masks": (lambda f: replace_masks(f, 0), r"cam02: all masks are empty"),
    "inverted masks": (lambda f: replace_masks(f, 255), r"cam02: masks are 100 % foreground; invert them"),
    "wrong size": case(
        "size = [160.0", "size = [170.0", r"cam01\.mkv is 160x120, but the calibration says 170x120", "calibration.toml"
    ),
    "a picture of another size than its video": (
        lambda f: cv2.imwrite(str(f / "plate.png"), np.zeros((30, 40), np.uint8)),
        r"plate\.png is 40x30, and .*cam01\.mkv is 160x120; give images of the video's size",
    ),
    "misplaced video": case(
        MASKS, f"{MASKS}\nvideo_from_calibrated = {{ offset = [900, 0] }}", r"puts the calibrated image at \[900"
    ),
    "no scale": case(MASKS, f"{MASKS}\nvideo_from_calibrated = {{ scale = 0 }}", r"scale = 0 is not a scale"),
    "offset too large": case(MASKS, f"{MASKS}\nframe_offset = 5", r"frame_offset = 5 in 5 frames"),
    "offset a fraction": case(MASKS, f"{MASKS}\nframe_offset = 0.5", r"is not a whole number"),
    "a single image as a video": case("masks/cam02", "plate.png", r"plate\.png: is a single image; name the folder"),
    "not a video": (lambda f: (f / "cam02.mkv").write_text("no"), r"cam02\.mkv: cannot be decoded as a video"),
    "truncated video": (
        truncate_video,
        r"cam01\.mkv: ends after \d+ of its \d+ frames; .* let \[scene\] frames end before this camera's frame \d+",
    ),
    "unknown source": case(
        'source = "masks"', 'source = "magic"', r"\[foreground\]: source = 'magic' is not known; use one of"
    ),
    "no background": case('source = "masks"', 'source = "background_video"', r"'background' is missing, which"),
    "no clean plate": case("plate.png", "plates.png", r"plates\.png: no such file"),
    "repair with two": (repair_with_two, r"repair needs at least 3 cameras, this scene has 2; set repair = false"),
    "bad setting": case(
        'source = "masks"', 'source = "masks"\nclose = -2', r"close must be 0 or more and below 1e9, got -2"
    ),
    "no subject": case("fps = 30", 'fps = 30\nsubject = "me.usdc"', r"me\.usdc does not exist"),
    "body of another kind": case("fps = 30", 'fps = 30\nbody = "me.glb"', r"/me\.glb does not exist"),
    "no body": case("fps = 30", 'fps = 30\nbody = "me.usdc"', r"me\.usdc does not exist"),
    "a thing without a mesh": case("[track]", '[[attach]]\nname = "Bat"\n[track]', r"\[attach 1\]: 'mesh' is missing"),
    "a misspelt mesh": case(
        "[track]", '[[attach]]\nname = "Bat"\nmesch = "bat.obj"\n[track]', r"'mesh' is missing; is it 'mesch'\?"
    ),
    "no such mesh": case(
        "[track]", '[[attach]]\nname = "Bat"\nmesh = "bat.obj"\n[track]', r"\[attach 1\]: .*bat\.obj does not exist"
    ),
    "a thing's name": case("[track]", '[[attach]]\nname = "a bat"\n[track]', r"name = 'a bat' is no plain name"),
    "unknown freedom": case("[track]", THING + 'free = "up"\n[track]', r"free = 'up' is not known; use one of"),
    "a hinge on nothing": case("[track]", THING + 'free = "x"\n[track]', r'free = "x" needs a joint .*; add joint'),
    "a thing of no size": case("[track]", THING + "scale = 0\n[track]", r"scale = 0 is not positive; give the"),
    "two of a name": case("[track]", THING + THING + "[track]", r"\[attach 2\]: there are two things named 'Bat'"),
    "attach no table": case("[scene]", "attach = 3\n[scene]", r"attach = 3 is not a list"),
    "unknown of a thing": case("[track]", THING + "joints = 1\n[track]", r"unknown key 'joints'; did you mean 'joint'"),
    "no truth": case("[track]", '[truth]\nfile = "t.trc"\n[track]', r"\[truth\]: .*t\.trc does not exist"),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_wrong_scenes_are_refused_in_one_line(folder: Path, wrong: str) -> None:
    spoil, message = WRONG[wrong]

    def loaded() -> Scene:
        spoil(folder)
        return load_scene(folder)

    with pytest.raises(InputError) as caught:
        loaded()
    assert re.search(message, str(caught.value)), str(caught.value)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(str(folder))
    assert "; " in str(caught.value)
