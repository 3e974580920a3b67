"""Masks that were made once: they are known to be undistorted, of which camera, and with which calibration."""

from __future__ import annotations

import tarfile
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from disc_scene import FRAMES, bent_rig, edit, write_scene

from mmocap_warp.cameras.rig import CameraRig, project
from mmocap_warp.errors import InputError
from mmocap_warp.formats.calibration.toml_rig import write_toml_rig
from mmocap_warp.masks.subtraction import GaussianBackground
from mmocap_warp.scene.kept_masks import MARK_NAME
from mmocap_warp.scene.mask_writing import write_masks
from mmocap_warp.scene.scene_toml import load_scene


def fisheye_rig() -> CameraRig:
    """Three fisheyes that see 61 degrees to the sides; the first one is another lens."""
    rig = bent_rig()
    lens = np.array([[-0.1, 0.05, 0.001, -0.002, 0.0], [0.04, -0.01, 0.004, -0.001, 0.0], [0.04, 0.0, 0.0, 0.0, 0.0]])
    return replace(rig, K=rig.K * [[0.48, 1, 1], [1, 0.48, 1], [1, 1, 1]], distortion=lens, fisheye=rig.names[1:])


def name_made_masks(folder: Path) -> None:
    """Put the masks that were made into the user's own scene."""
    edit(folder / "scene.toml", 'masks = "masks/', 'masks = "made/')


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_made_masks_are_not_undistorted_again(scale: float, tmp_path: Path) -> None:
    """Named in the scene that they were made from, with its calibration and its lenses."""
    scene = load_scene(write_scene(tmp_path))
    write_masks(scene, tmp_path / "made", scale)
    name_made_masks(tmp_path)
    again = load_scene(tmp_path)
    for mine, theirs in zip(again.masks(scale), scene.masks(scale), strict=True):
        np.testing.assert_array_equal(mine, theirs)


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_masks_of_fisheyes_lie_where_their_pinholes_see(scale: float, tmp_path: Path) -> None:
    """Read, made and read again, images likewise: where the disc's middle is seen by the pinhole."""
    rig = fisheye_rig()
    scene = load_scene(write_scene(tmp_path, rig=rig))
    made = load_scene(write_masks(scene, tmp_path / "made", scale))
    pinholes = scene.rig(scale)
    assert (pinholes.size[1:] > 1.2 * scale * rig.size[1:]).any(axis=1).all()
    middle = project(pinholes, np.array([[0.9, 1.6, 0.3]]))[:, 0]
    streams = (scene.masks(scale), made.masks(scale), scene.images(scale))
    for k, (mask, again, image) in enumerate(zip(*map(next, streams), strict=True)):
        assert mask.shape == tuple(pinholes.size[k, ::-1])
        np.testing.assert_array_equal(again, mask)
        for seen in (mask, image[..., 2] > 200):
            row, column = np.nonzero(seen)
            np.testing.assert_allclose([column.mean(), row.mean()], middle[k], atol=4 * scale)  # a disc on the fisheye


def test_masks_made_small_are_read_at_any_scale(tmp_path: Path) -> None:
    scene = load_scene(write_scene(tmp_path))
    made = load_scene(write_masks(scene, tmp_path / "made", 0.5))
    for scale in (1.0, 0.25):
        for mine, theirs in zip(next(made.masks(scale)), next(scene.masks(scale)), strict=True):
            assert (mine & theirs).sum() / (mine | theirs).sum() > 0.9


def test_the_scene_of_made_masks_keeps_what_the_scene_says(tmp_path: Path) -> None:
    scene = load_scene(write_scene(tmp_path, late=1))
    made = load_scene(write_masks(scene, tmp_path / "made", 0.5))
    assert made.truth is not None
    assert made.truth.resolve() == scene.truth.resolve()
    assert (made.name, made.fps, made.truth_axes, made.truth_first_frame) == (scene.name, scene.fps, "zxy", 2)
    assert made.track == scene.track | {"scale": 0.5}  # what the masks hold, and no more
    for scale in (1.0, 0.5):
        for mine, theirs in zip(made.images(scale), scene.images(scale), strict=True):
            for image, same in zip(mine, theirs, strict=True):
                np.testing.assert_array_equal(image, same)
        assert made.rig(scale).names == scene.rig(scale).names
    *_, last = made.masks(0.5)
    assert not last[2].any()  # the late camera has no image for it


def test_made_masks_of_a_part_of_the_scene_keep_step_with_the_video(tmp_path: Path) -> None:
    scene = load_scene(write_scene(tmp_path, late=1))
    made = load_scene(write_masks(scene.of_frames(range(1, 3)), tmp_path / "made"))
    for mine, theirs in zip(made.masks(), scene.masks(first=1, count=2), strict=True):
        np.testing.assert_array_equal(mine, theirs)
    for mine, theirs in zip(made.images(), scene.images(first=1, count=2), strict=True):
        np.testing.assert_array_equal(mine, theirs)


def test_another_synchronisation_moves_made_masks_with_the_video(tmp_path: Path) -> None:
    scene = load_scene(write_scene(tmp_path, late=1))
    write_masks(scene, tmp_path / "made")
    name_made_masks(tmp_path)
    edit(tmp_path / "scene.toml", "frame_offset = 1", "frame_offset = 2")
    moved = load_scene(tmp_path)
    np.testing.assert_array_equal(next(moved.masks())[2], next(scene.masks(first=1))[2])


@pytest.mark.parametrize("named_in", ["scene.toml", "made/scene.toml"])
def test_a_changed_lens_is_noticed(named_in: str, tmp_path: Path) -> None:
    write_masks(load_scene(write_scene(tmp_path)), tmp_path / "made")
    name_made_masks(tmp_path)
    rig = bent_rig()
    K = rig.K.copy()
    K[1, 0, 0] += 1
    write_toml_rig(tmp_path / "calibration.toml", replace(rig, K=K))
    with pytest.raises(InputError, match=r"made/cam02: .* another calibration .*; make them again with mmocap mask"):
        load_scene(tmp_path / named_in)


def test_cameras_that_moved_are_used_as_they_now_stand(tmp_path: Path) -> None:
    """Plain masks do not depend on where the other cameras stand; repaired ones do."""
    folder = write_scene(tmp_path)
    scene = load_scene(folder)
    write_masks(scene, tmp_path / "made")
    write_masks(replace(scene, foreground=replace(scene.foreground, repair=True)), tmp_path / "repaired")
    rig = bent_rig()
    write_toml_rig(tmp_path / "calibration.toml", replace(rig, t=rig.t + 0.01))
    np.testing.assert_allclose(load_scene(tmp_path / "made").calibrated.t, rig.t + 0.01)
    with pytest.raises(InputError, match="another calibration"):
        load_scene(tmp_path / "repaired")


def test_swapped_folders_are_noticed(tmp_path: Path) -> None:
    write_masks(load_scene(write_scene(tmp_path)), tmp_path / "made")
    edit(tmp_path / "made" / "scene.toml", 'masks = "cam02"', 'masks = "cam03"')
    with pytest.raises(InputError, match=r"are of 'cam03', not of 'cam02'; correct masks"):
        load_scene(tmp_path / "made")


def test_a_damaged_mark_is_one_line(tmp_path: Path) -> None:
    write_masks(load_scene(write_scene(tmp_path)), tmp_path / "made")
    edit(tmp_path / "made" / "cam01" / MARK_NAME, "scale = 1.0", "scale = 0.0")
    with pytest.raises(InputError, match=r"masks\.toml: scale = 0 is not in \(0, 1\]; make the masks again"):
        load_scene(tmp_path / "made")


@pytest.mark.parametrize("named", ["", 'name = ""\n'])
def test_a_scene_has_a_name(named: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where it is opened from within its own folder."""
    edit(write_scene(tmp_path) / "scene.toml", "fps = 30", f"{named}fps = 30")
    monkeypatch.chdir(tmp_path)
    assert load_scene("scene.toml").name == tmp_path.name
    assert load_scene(write_masks(load_scene("scene.toml"), "made")).name == tmp_path.name


@pytest.fixture
def subtractions(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Counts the images that a background is subtracted from."""
    counted, judge = [], GaussianBackground.foreground
    monkeypatch.setattr(GaussianBackground, "foreground", lambda self, image: counted.append(0) or judge(self, image))
    return counted


def all_masks(folder: Path, scale: float = 1.0) -> list[np.ndarray]:
    return [mask for masks in load_scene(folder).masks(scale) for mask in masks]


def kept_files(folder: Path) -> list[str]:
    return sorted(path.name for path in (folder / ".mmocap").rglob("*") if path.is_file())


def test_a_background_is_subtracted_once(subtractions: list[int], tmp_path: Path) -> None:
    scene = load_scene(write_scene(tmp_path, "clean_plate", late=1))
    first = all_masks(tmp_path)
    assert len(subtractions) == 3 * FRAMES - 1
    assert kept_files(tmp_path) == [f"cam0{k}@1.tar" for k in (1, 2, 3)]
    np.testing.assert_array_equal(all_masks(tmp_path), first)
    for masks, same in zip(scene.masks(first=2), [first[6:9], first[9:]], strict=True):
        np.testing.assert_array_equal(masks, same)
    assert len(subtractions) == 3 * FRAMES - 1
    all_masks(tmp_path, 0.5)
    assert len(subtractions) == 2 * (3 * FRAMES - 1)
    all_masks(tmp_path)
    assert len(subtractions) == 2 * (3 * FRAMES - 1)  # each scale is kept


@pytest.mark.parametrize("model", ["gaussian", "mog2", "knn"])
def test_kept_masks_are_those_that_were_made(model: str, tmp_path: Path) -> None:
    edit(
        write_scene(tmp_path, "clean_plate") / "scene.toml", "[track]", f'model = "{model}"\nkeep = "nearest"\n[track]'
    )
    first = all_masks(tmp_path)
    assert len(kept_files(tmp_path)) == 3
    np.testing.assert_array_equal(all_masks(tmp_path), first)


def other_plate(folder: Path) -> None:
    plate = cv2.imread(str(folder / "plate.png"))
    plate[0, 0] += 1
    cv2.imwrite(str(folder / "plate.png"), plate)


def other_lens(folder: Path) -> None:
    rig = bent_rig()
    write_toml_rig(folder / "calibration.toml", replace(rig, distortion=0.9 * rig.distortion))


def other_image(folder: Path) -> None:
    for k in (1, 2, 3):
        path = str(folder / "video" / f"cam0{k}" / "001.png")
        cv2.imwrite(path, cv2.imread(path) ^ 1)


def damaged(folder: Path) -> None:
    for file in (folder / ".mmocap").rglob("*.tar"):
        file.write_bytes(file.read_bytes()[:100])


def misnamed(folder: Path) -> None:
    for file in (folder / ".mmocap").rglob("*.tar"):
        with tarfile.open(file, "a") as archive:
            archive.addfile(tarfile.TarInfo("cover.png"))


@pytest.mark.parametrize(
    "change",
    [
        other_plate,
        other_lens,
        other_image,
        damaged,
        misnamed,
        lambda folder: edit(folder / "scene.toml", "[track]", "threshold = 8.0\n[track]"),
        lambda folder: edit(folder / "scene.toml", "fps = 30", "fps = 30\nframes = 3"),
    ],
)
def test_masks_of_something_else_are_made_again(change, subtractions: list[int], tmp_path: Path) -> None:
    write_scene(tmp_path, "clean_plate")
    all_masks(tmp_path)
    change(tmp_path)
    subtractions.clear()
    again = all_masks(tmp_path)
    assert len(subtractions) == len(again)
    np.testing.assert_array_equal(all_masks(tmp_path), again)
    assert len(subtractions) == len(again)
    assert len(kept_files(tmp_path)) == 3  # in the place of the others


def test_how_masks_are_cleaned_needs_no_subtraction(subtractions: list[int], tmp_path: Path) -> None:
    write_scene(tmp_path, "clean_plate")
    all_masks(tmp_path)
    subtractions.clear()
    edit(tmp_path / "scene.toml", "[track]", "close = 3.0\n[track]")
    all_masks(tmp_path)
    assert not subtractions


def test_masks_are_kept_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "mmocap_warp.scene.frame_choice._FRAMES_AHEAD", 1
    )  # else all are read when the first is asked for
    stream = load_scene(write_scene(tmp_path, "clean_plate")).masks()
    next(stream)
    stream.close()
    assert kept_files(tmp_path) == []


def test_where_nothing_can_be_kept_masks_are_made_each_time(subtractions: list[int], tmp_path: Path) -> None:
    write_scene(tmp_path, "clean_plate")
    (tmp_path / ".mmocap").write_text("in the way")
    np.testing.assert_array_equal(all_masks(tmp_path), all_masks(tmp_path))
    assert len(subtractions) == 2 * 3 * FRAMES


def test_a_full_disk_does_not_stop_a_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(self, *_):
        raise OSError(28, "No space left on device")

    expected = all_masks(write_scene(tmp_path, "clean_plate"))
    for file in (tmp_path / ".mmocap").rglob("*.tar"):
        file.unlink()
    monkeypatch.setattr("tarfile.TarFile.addfile", full)
    np.testing.assert_array_equal(all_masks(tmp_path), expected)
    assert kept_files(tmp_path) == []
