"""``mmocap calib solve`` on a made walk: cameras from scratch, and what is said where the recording does not tell."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from made_walks import walking_around

from mmocap_warp.calibration.solve import UnsolvableError
from mmocap_warp.calibration.solve.solution import SolvedCameras, solve_cameras, upright
from mmocap_warp.cameras.rig import CameraRig, project
from mmocap_warp.cli import console, main
from mmocap_warp.errors import InputError
from mmocap_warp.formats.calibration.opencv_yaml import write_opencv_yaml
from mmocap_warp.formats.calibration.toml_rig import read_toml_rig, write_toml_rig
from mmocap_warp.formats.truth_file import read_truth
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.study.sequences import SequencePlan, make_sequence
from mmocap_warp.synthesis.writing import write_made_scene

CAMERAS = ("C2", "C3", "BW2", "BW4")
HEIGHT = 1.749
EVERY = 10  # of the sequence's frames


@pytest.fixture(scope="module")
def walk(tmp_path_factory) -> Path:
    """The folder of a scene: five seconds in a circle, six frames a second, before four cameras."""
    plan = SequencePlan("S2", 300, walking_around(1.0, 1.10, 116.0), 2.1, 21, CAMERAS)
    made = make_sequence("walk", plan).recording
    thinned = replace(made, poses=made.poses[::EVERY], fps=made.fps / EVERY)
    folder = tmp_path_factory.mktemp("walk")
    write_made_scene(
        folder, thinned, thinned.truth(), name="walk", about="made", foreground='[foreground]\nkeep = "all"\n'
    )
    return folder


@pytest.fixture(scope="module")
def uncalibrated(walk) -> Path:
    """The same scene, which names no calibration."""
    text = (walk / "scene.toml").read_text()
    (walk / "uncalibrated.toml").write_text(text.replace('calibration = "calibration.toml"\n', ""))
    return walk / "uncalibrated.toml"


@pytest.fixture(scope="module")
def solved(walk) -> SolvedCameras:
    return solve_cameras(load_scene(walk, calibrated=False), HEIGHT)


@pytest.fixture(scope="module")
def guessed(uncalibrated) -> SolvedCameras:
    return solve_cameras(load_scene(uncalibrated, calibrated=False), HEIGHT)


def triangulated(rig: CameraRig, pixels: np.ndarray) -> np.ndarray:
    rows = []
    for k in range(len(rig)):
        x, y = ((pixels[k] - rig.K[k, :2, 2]) / rig.K[k, [0, 1], [0, 1]]).T[..., None]
        P = np.column_stack([rig.R[k], rig.t[k]])
        rows += [x * P[2] - P[0], y * P[2] - P[1]]
    point = np.linalg.svd(np.stack(rows, axis=1))[2][:, -1]
    return point[:, :3] / point[:, 3:]


def after_similarity(rig: CameraRig, true: CameraRig, markers: np.ndarray) -> tuple[np.ndarray, float, np.ndarray]:
    """Reprojection errors [px] of markers brought into the solved world, the similarity's scale, and its rotation."""
    pixels = project(true, markers)
    there = triangulated(rig, pixels)
    a, b = markers - markers.mean(axis=0), there - there.mean(axis=0)
    U, S, Vt = np.linalg.svd(b.T @ a)
    rotation = U @ Vt
    assert np.linalg.det(rotation) > 0
    scale = float(S.sum() / (a**2).sum())
    moved = scale * a @ rotation.T + there.mean(axis=0)
    return np.linalg.norm(project(rig, moved) - pixels, axis=-1), scale, rotation


def judged(found: SolvedCameras, walk: Path) -> tuple[np.ndarray, float, np.ndarray]:
    true = read_toml_rig(walk / "calibration.toml")
    return after_similarity(found.rig, true, read_truth(walk / "truth.usdc").markers[::5].reshape(-1, 3))


def test_cameras_from_known_intrinsics(solved, walk):
    missed, scale, rotation = judged(solved, walk)
    assert missed.mean() < 1.0
    assert scale == pytest.approx(1.0, abs=0.015)
    assert np.degrees(np.arccos(rotation[2, 2])) < 1.0
    assert solved.focal == ("given",) * 4
    np.testing.assert_array_equal(solved.rig.K, read_toml_rig(walk / "calibration.toml").K)
    heights = read_toml_rig(walk / "calibration.toml").centres[:, 2]
    np.testing.assert_allclose(solved.rig.centres[:, 2], heights, atol=0.05)
    assert (solved.centre_sigma < 0.1).all()
    assert (solved.focal_sigma == 0).all()


def test_focal_lengths_are_found_from_a_guess(guessed, walk):
    missed, scale, _ = judged(guessed, walk)
    assert missed.mean() < 2.0
    assert scale == pytest.approx(1.0, abs=0.02)
    assert guessed.focal == ("found",) * 4
    true = read_toml_rig(walk / "calibration.toml")
    np.testing.assert_allclose(guessed.rig.K[:, 0, 0], true.K[:, 0, 0], rtol=0.05)  # the guess is 14 to 22 % off
    assert (guessed.focal_sigma > 0).all()


def test_heads_are_over_the_floor(solved):
    heads = solved.heads[np.isfinite(solved.heads[:, 0])]
    assert len(heads) > 0.9 * len(solved.heads)
    assert np.median(heads[:, 2]) == pytest.approx(0.986 * HEIGHT, abs=0.005)
    assert np.linalg.norm(np.median(heads[:, :2], axis=0)) < 0.2


def lens_file(kind: str, rig: CameraRig, folder: Path) -> str:
    """A calibration without places, as its maker's program writes it, and what a scene calls it."""
    if kind == "opencv":
        write_opencv_yaml(folder / "intri.yml", rig)
        (folder / "extri.yml").unlink()
        return "intri.yml"
    if kind == "multical":
        lenses = {
            name: {"K": rig.K[k].tolist(), "dist": [rig.distortion[k].tolist()], "image_size": rig.size[k].tolist()}
            for k, name in enumerate(rig.names)
        }
        (folder / "intrinsic.json").write_text(json.dumps({"cameras": lenses}))
        return "intrinsic.json"
    write_toml_rig(folder / "lenses.toml", rig)
    lines = (folder / "lenses.toml").read_text().splitlines()
    kept = [line for line in lines if not line.startswith(("rotation", "translation"))]
    (folder / "lenses.toml").write_text("\n".join(kept))
    return "lenses.toml"


@pytest.mark.parametrize("kind", ["toml", "opencv", "multical"])
def test_a_file_of_lenses_alone_is_read(walk, tmp_path, kind):
    rig = read_toml_rig(walk / "calibration.toml")
    folder = tmp_path / "lenses"
    shutil.copytree(walk, folder)
    called = lens_file(kind, rig, folder)
    text = (folder / "scene.toml").read_text()
    (folder / "scene.toml").write_text(text.replace('"calibration.toml"', f'"{called}"'))
    scene = load_scene(folder, calibrated=False)
    assert not scene.calibrated.placed
    for name in ("K", "size", "distortion"):
        np.testing.assert_array_equal(getattr(scene.calibrated, name), getattr(rig, name))
    with pytest.raises(InputError, match=r"has lenses, but not where the cameras stand; .*calib solve"):
        load_scene(folder)


def test_lenses_alone_are_enough(walk, solved, tmp_path, capsys):
    folder = tmp_path / "lenses"
    shutil.copytree(walk, folder)
    lens_file("toml", read_toml_rig(walk / "calibration.toml"), folder)
    (folder / "lenses.toml").replace(folder / "calibration.toml")
    assert main(["calib", "solve", str(folder), "--height", str(HEIGHT), "-o", str(tmp_path / "found.toml")]) == 0
    assert "calibration.toml, which has no places" in capsys.readouterr().out
    np.testing.assert_allclose(read_toml_rig(tmp_path / "found.toml").centres, solved.rig.centres, atol=1e-9)


def test_cameras_on_their_side_are_found(walk, tmp_path):
    """One lies on its left side, another on its right."""
    rig = read_toml_rig(walk / "calibration.toml")
    folder = tmp_path / "lying"
    shutil.copytree(walk, folder)
    for name, turn in (("C3", cv2.ROTATE_90_CLOCKWISE), ("BW2", cv2.ROTATE_90_COUNTERCLOCKWISE)):
        rig = lying(rig, rig.names.index(name), turn)
        for file in (folder / "masks" / name).glob("*.png"):
            cv2.imwrite(str(file), cv2.rotate(cv2.imread(str(file), cv2.IMREAD_UNCHANGED), turn))
    write_toml_rig(folder / "calibration.toml", rig)
    missed, scale, _ = judged(solve_cameras(load_scene(folder, calibrated=False), HEIGHT), folder)
    assert missed.mean() < 1.0
    assert scale == pytest.approx(1.0, abs=0.015)


def lying(rig: CameraRig, k: int, turn: int) -> CameraRig:
    """The rig with a camera whose images are turned by a quarter."""
    K, R, t, size = (np.array(each) for each in (rig.K, rig.R, rig.t, rig.size))
    (width, height), (cx, cy) = size[k], K[k, :2, 2]
    clockwise = turn == cv2.ROTATE_90_CLOCKWISE
    axes = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]] if clockwise else [[0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    K[k] = [
        [K[k, 1, 1], 0, height - 1 - cy if clockwise else cy],
        [0, K[k, 0, 0], cx if clockwise else width - 1 - cx],
        [0, 0, 1],
    ]
    R[k], t[k], size[k] = axes @ R[k], axes @ t[k], size[k, ::-1]
    return replace(rig, K=K, R=R, t=t, size=size)


def test_the_vertical_is_the_scene_s(walk, solved):
    turned = replace(
        load_scene(walk, calibrated=False), calibrated=replace(read_toml_rig(walk / "calibration.toml"), up="-y")
    )
    found = solve_cameras(turned, HEIGHT)
    assert found.rig.up == "-y"
    np.testing.assert_allclose(-found.rig.centres[:, 1], solved.rig.centres[:, 2], atol=1e-9)
    np.testing.assert_allclose(np.linalg.det(found.rig.R), 1.0)
    np.testing.assert_allclose(found.rig.R[1] @ found.rig.R[0].T, solved.rig.R[1] @ solved.rig.R[0].T, atol=1e-9)
    np.testing.assert_allclose(found.heads @ found.rig.up_vector, solved.heads[:, 2], atol=1e-9)


def test_a_view_that_does_not_agree_is_told(walk, tmp_path):
    """One camera's masks in another order: nobody walked so."""
    shutil.copytree(walk, tmp_path, dirs_exist_ok=True)
    images = sorted((walk / "masks" / "C3").iterdir())
    for place, image in zip(np.random.default_rng(1).permutation(len(images)), images, strict=True):
        shutil.copyfile(image, tmp_path / "masks" / "C3" / images[place].name)
    with pytest.raises(UnsolvableError, match=r"% of the outlines' tangents of camera 'C3' agree .*mmocap sync"):
        solve_cameras(load_scene(tmp_path, calibrated=False), HEIGHT)


@pytest.mark.parametrize("height", [0.0, 17.8, float("nan")])
def test_a_height_that_is_none(walk, height):
    with pytest.raises(ValueError, match="height must be a person's"):
        solve_cameras(load_scene(walk, calibrated=False), height)


def test_a_lone_camera(walk):
    scene = load_scene(walk, calibrated=False)
    with pytest.raises(InputError, match="names one camera"):
        solve_cameras(replace(scene, cameras=scene.cameras[:1]), HEIGHT)


SOLVE = "mmocap_warp.calibration.solve.solution.solve_cameras"


def test_the_command_writes_a_calibration_and_a_picture(uncalibrated, guessed, tmp_path, capsys, monkeypatch):
    """Of cameras that are solved already; lenses alone are solved by the command itself."""
    asked = []
    monkeypatch.setattr(SOLVE, lambda scene, height: asked.append((scene.path, height)) or guessed)
    output, picture = tmp_path / "found.toml", tmp_path / "floor.png"
    arguments = [
        "calib",
        "solve",
        str(uncalibrated),
        "--height",
        str(HEIGHT),
        "-o",
        str(output),
        "--picture",
        str(picture),
    ]
    assert main([*arguments, "--json"]) == console.OK
    values = json.loads(capsys.readouterr().out)
    assert (values["solved"], values["intrinsics"], values["up"]) == (True, "guessed", "+z")
    assert [camera["focal"] for camera in values["cameras"]] == ["found"] * 4
    rig = read_toml_rig(output)
    assert rig.names == CAMERAS
    np.testing.assert_allclose(rig.centres, guessed.rig.centres, atol=1e-9)
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert main(arguments) == console.BAD_INPUT  # they are there now
    assert main([*arguments, "--force"]) == console.OK
    assert asked == [(uncalibrated, HEIGHT)] * 2
    out = capsys.readouterr().out
    for words in ("over the floor", "focal lengths guessed", "px, found +-", "next: set calibration", "calib refine"):
        assert words in out


def test_the_command_writes_nothing_where_nobody_walks(walk, tmp_path, capsys, monkeypatch):
    still = tmp_path / "still"
    shutil.copytree(walk, still)
    for folder in (still / "masks").iterdir():
        for image in folder.iterdir():
            if image.name != "0000.png":
                shutil.copyfile(folder / "0000.png", image)
    output = tmp_path / "found.toml"
    assert main(["calib", "solve", str(still), "--height", "1.75", "-o", str(output)]) == console.CHECK_FAILED
    out = capsys.readouterr().out
    assert out.count("\n") == 1
    assert out.startswith("check failed: ")
    assert not output.exists()

    def unsolvable(*_):
        raise UnsolvableError("as before")

    monkeypatch.setattr(SOLVE, unsolvable)
    assert main(["calib", "solve", str(still), "--height", "1.75", "-o", str(output), "--json"]) == console.CHECK_FAILED
    assert json.loads(capsys.readouterr().out)["solved"] is False


def test_the_command_refuses_a_height_in_centimetres(walk, tmp_path, capsys):
    output = tmp_path / "found.toml"
    assert main(["calib", "solve", str(walk), "--height", "178", "-o", str(output)]) == console.USAGE
    assert "--height must be a person's in metres, got 178" in capsys.readouterr().err


def test_a_person_shows_where_the_floor_of_placed_cameras_is(walk) -> None:
    """Cameras in the first one's world, as a board gives them, stand over the floor as the true ones do."""
    true, scene = read_toml_rig(walk / "calibration.toml"), load_scene(walk, calibrated=False)
    R = true.R @ true.R[0].T
    rig = upright(replace(true, R=R, t=true.t - R @ true.t[0], up="-y"), scene)
    assert rig.up == "+z"
    np.testing.assert_allclose(rig.centres[:, 2], true.centres[:, 2], atol=0.04)
    np.testing.assert_allclose(rig.R[:, :, 2], true.R[:, :, 2], atol=0.01)  # where the vertical is in each camera
    apart = np.linalg.norm(rig.centres - rig.centres[0], axis=1)
    np.testing.assert_allclose(apart, np.linalg.norm(true.centres - true.centres[0], axis=1), atol=1e-9)
    with pytest.raises(InputError, match="camera 'C3' is not among C2, BW2"):
        upright(rig.select(("C2", "BW2")), scene)
