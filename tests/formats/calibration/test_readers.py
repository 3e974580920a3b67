"""Calibrations of other programs: each reads back as the rig that it was written from, and projects as OpenCV does."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from calibration_files import caliscope, humaneva, multical, write_colmap_model
from pxr import Gf, Usd, UsdGeom
from synthetic import ring_rig

from mmocap_warp.cameras.rig import CameraRig, project
from mmocap_warp.errors import InputError
from mmocap_warp.formats.table import CALIBRATION_EXPORTS, read_calibration, read_lenses, write_calibration
from mmocap_warp.formats.usd.usd_camera import write_usd_cameras

PIXEL = 1e-9  # [px], float64 against float64
SINGLE = 1e-3  # [px], of a lens in single precision
BROWN = np.array([[-0.15, 0.08, 0.002, -0.001, 0.01], [0.1, -0.02, 0.0, 0.001, 0.0], [0.0] * 5, [0.05, 0, 0, 0, -0.01]])
BENT = np.array([[0.05, 0.01, -0.003, 0.001, 0.0], [0.0] * 5, [-0.02, 0.004, 0.0, 0.0, 0.0], [0.1, 0.02, 0, 0, 0.0]])
POINTS = np.random.default_rng(0).uniform([-0.8, 0, -0.8], [0.8, 1.8, 0.8], (50, 3))


def brown_rig() -> CameraRig:
    return replace(ring_rig(4), distortion=BROWN)


def fisheye_rig() -> CameraRig:
    """All but the second camera are fisheyes of about 120 degrees."""
    rig = ring_rig(4)
    distortion = np.where([[True], [False], [True], [True]], BENT, BROWN)
    return replace(rig, K=rig.K * [[0.5, 1, 1], [1, 0.5, 1], [1, 1, 1]], distortion=distortion, fisheye=FISHEYES)


FISHEYES = ("cam01", "cam03", "cam04")


def opencv_pixels(rig: CameraRig, k: int) -> np.ndarray:
    """(n, 2) of ``POINTS``."""
    turn, t, K = cv2.Rodrigues(rig.R[k])[0], rig.t[k], rig.K[k]
    if rig.names[k] in rig.fisheye:
        return cv2.fisheye.projectPoints(POINTS[:, None], turn, t[:, None], K, rig.distortion[k, :4])[0][:, 0]
    return cv2.projectPoints(POINTS, turn, t, K, rig.distortion[k])[0][:, 0]


def assert_sees(read: CameraRig, rig: CameraRig, within: float = PIXEL) -> None:
    np.testing.assert_array_equal(read.size, rig.size)
    expected = np.stack([opencv_pixels(rig, k) for k in range(len(rig))])
    np.testing.assert_allclose(project(read, POINTS), expected, rtol=0, atol=within)


@pytest.mark.parametrize("rig", [brown_rig(), fisheye_rig()], ids=["brown", "fisheye"])
def test_projection_equals_opencv(rig: CameraRig) -> None:
    assert_sees(rig, rig)


@pytest.mark.parametrize("rig", [brown_rig(), fisheye_rig()], ids=["brown", "fisheye"])
@pytest.mark.parametrize("name", ["rig.toml", "cameras.txt", "rig.usda", "rig.usdc"])
def test_what_is_written_reads_back(tmp_path: Path, rig: CameraRig, name: str) -> None:
    write_calibration(tmp_path / name, rig)
    again = read_calibration(tmp_path / name, "m", rig.up)
    assert (again.names, again.fisheye, again.up) == (rig.names, rig.fisheye, rig.up)
    for key in ("K", "R", "t", "size", "distortion"):
        np.testing.assert_allclose(getattr(again, key), getattr(rig, key), rtol=0, atol=1e-12)


def test_opencv_reads_the_yaml_that_is_written(tmp_path: Path) -> None:
    rig = brown_rig()
    write_calibration(tmp_path / "intri.yml", rig)
    assert_sees(read_calibration(tmp_path, None, "+y"), rig)
    inside, outside = (cv2.FileStorage(str(tmp_path / name), 0) for name in ("intri.yml", "extri.yml"))
    for k, name in enumerate(rig.names):
        assert inside.getNode("names").at(k).string() == name
        np.testing.assert_array_equal(inside.getNode(f"K_{name}").mat(), rig.K[k])
        np.testing.assert_array_equal(inside.getNode(f"dist_{name}").mat(), rig.distortion[k : k + 1])
        np.testing.assert_array_equal(outside.getNode(f"Rot_{name}").mat(), rig.R[k])
        np.testing.assert_array_equal(outside.getNode(f"T_{name}").mat(), rig.t[k][:, None])


def test_yaml_has_no_fisheye(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"cannot say that 'cam01' is a fisheye; write \.toml, cameras\.txt or USD"):
        write_calibration(tmp_path / "intri.yml", fisheye_rig())
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("rig", [brown_rig(), fisheye_rig()], ids=["brown", "fisheye"])
def test_caliscope(tmp_path: Path, rig: CameraRig) -> None:
    """Metres, whatever the scene says; a camera without a place and one that is ignored are left out."""
    (tmp_path / "camera_array.toml").write_text(caliscope(rig))
    again = read_calibration(tmp_path / "camera_array.toml", "mm", "+y")
    assert again.names == ("cam_1", "cam_2", "cam_3", "cam_4")
    assert_sees(again, rig)


def test_caliscope_with_rotations_and_distortions_as_matrices(tmp_path: Path) -> None:
    rig = brown_rig()
    turn, lens = cv2.Rodrigues(rig.R[0])[0].ravel().tolist(), rig.distortion[0].tolist()
    text = caliscope(rig).replace(str(turn), str(rig.R[0].tolist())).replace(str(lens), str([[v] for v in lens]))
    (tmp_path / "camera_array.toml").write_text(text)
    assert_sees(read_calibration(tmp_path / "camera_array.toml"), rig)


@pytest.mark.parametrize("rig", [brown_rig(), fisheye_rig()], ids=["brown", "fisheye"])
def test_multical(tmp_path: Path, rig: CameraRig) -> None:
    """The world is the first camera's; the last one is led back to it over the second."""
    (tmp_path / "calibration.json").write_text(multical(rig))
    again = read_calibration(tmp_path / "calibration.json", "m")
    assert (again.names, again.fisheye) == (rig.names, rig.fisheye)
    back = replace(again, R=again.R @ rig.R[0], t=again.t + again.R @ rig.t[0])
    assert_sees(back, rig)


MODELS = {"SIMPLE_PINHOLE": 0, "PINHOLE": 0, "SIMPLE_RADIAL": 1, "RADIAL": 2, "OPENCV": 4, "OPENCV_FISHEYE": 4}


@pytest.mark.parametrize("model", MODELS)
def test_colmap(tmp_path: Path, model: str) -> None:
    rig = brown_rig()
    K, lens = rig.K.copy(), rig.distortion * (np.arange(5) < MODELS[model])
    if model.startswith("SIMPLE") or model == "RADIAL":
        K[:, 1, 1] = K[:, 0, 0]
    rig = replace(rig, K=K, distortion=lens, fisheye=rig.names if model.endswith("FISHEYE") else ())
    write_colmap_model(tmp_path, rig, model)
    for path in (tmp_path, tmp_path / "cameras.txt", tmp_path / "images.txt"):
        again = read_calibration(path, "m")
        assert (again.names, again.fisheye) == (rig.names, rig.fisheye)
        assert_sees(again, rig)


def test_colmap_cameras_are_named_by_their_folders(tmp_path: Path) -> None:
    write_colmap_model(tmp_path, brown_rig())
    text = (tmp_path / "images.txt").read_text()
    (tmp_path / "images.txt").write_text(text.replace(".jpg", "/0001.jpg"))
    assert read_calibration(tmp_path, "m").names == ("cam01", "cam02", "cam03", "cam04")
    (tmp_path / "images.txt").write_text(text.replace(" cam", " rig1/cam").replace(".jpg", "/0001.jpg"))
    assert read_calibration(tmp_path, "m").names == ("cam01", "cam02", "cam03", "cam04")


def test_what_freemocap_adds_follows_from_the_rest(tmp_path: Path) -> None:
    write_calibration(tmp_path / "rig.toml", brown_rig())
    text = (tmp_path / "rig.toml").read_text()
    added = (
        "world_position = [1.0, 2.0, 3.0]\nworld_orientation = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]\n"
    )
    (tmp_path / "rig.toml").write_text(text.replace("matrix =", f"{added}matrix ="))
    assert_sees(read_calibration(tmp_path / "rig.toml"), brown_rig())


def test_humaneva(tmp_path: Path) -> None:
    """Millimetres, whatever the scene says; sizes are the recording's."""
    rig = brown_rig()
    for k, name in enumerate(rig.names):
        (tmp_path / f"{name}.cal").write_text(humaneva(rig, k))
    for path in (tmp_path, tmp_path / "cam02.cal"):
        again = read_calibration(path, "m", "+y", dict.fromkeys(rig.names, (640, 480)))
        assert again.names == rig.names
        assert_sees(again, rig)
    with pytest.raises(InputError, match=r"cam01\.cal: HumanEva's \.cal does not say how large"):
        read_calibration(tmp_path, sizes={"cam02": (640, 480)})


def other_usd_cameras(path: Path, rig: CameraRig, metres: float = 0.01, up: str = "Y") -> Usd.Stage:
    """As another program writes them: nothing but lens and place, in its own unit, below a place that is turned."""
    write_usd_cameras(path, rig)
    stage = Usd.Stage.Open(str(path))
    for prim in stage.Traverse():
        for name in [name for name in prim.GetPropertyNames() if name.startswith("mmocap:")]:
            prim.RemoveProperty(name)
    UsdGeom.SetStageMetersPerUnit(stage, metres)
    UsdGeom.SetStageUpAxis(stage, up)
    UsdGeom.Xformable(stage.GetPrimAtPath("/World")).AddScaleOp().Set(Gf.Vec3f(1 / metres))
    return stage


@pytest.mark.parametrize("up", ["Y", "Z"])
def test_usd_of_another_program(tmp_path: Path, up: str) -> None:
    """Unit and vertical are the file's, sizes the recording's."""
    rig = ring_rig(4)
    rig = replace(rig, K=np.stack([np.diag([1, 1 / 0.995, 1]) @ K for K in rig.K]))
    stage = other_usd_cameras(tmp_path / "c.usda", rig, up=up)
    stage.GetRootLayer().Save()
    again = read_calibration(tmp_path / "c.usda", None, "-x", dict.fromkeys(rig.names, (640, 480)))
    assert (again.names, again.up) == (rig.names, f"+{up.lower()}")
    assert_sees(again, rig, SINGLE)
    with pytest.raises(InputError, match="does not say how large the images of camera 'cam01' are; add the image size"):
        read_calibration(tmp_path / "c.usda")
    with pytest.raises(InputError, match=r"'cam01' has not the shape of its images, 640x360"):
        read_calibration(tmp_path / "c.usda", sizes=dict.fromkeys(rig.names, (640, 360)))


@pytest.mark.parametrize("name", ["focalLength", "horizontalAperture"])
def test_usd_cameras_that_zoom_are_refused(tmp_path: Path, name: str) -> None:
    stage = other_usd_cameras(tmp_path / "c.usda", ring_rig(2))
    for time in (0, 1):
        stage.GetPrimAtPath("/World/Cameras/cam01").GetAttribute(name).Set(20.0 + time, time)
    stage.GetRootLayer().Save()
    with pytest.raises(InputError, match=r"/World/Cameras/cam01 zooms; export the cameras again"):
        read_calibration(tmp_path / "c.usda")


def test_usd_cameras_that_move_are_refused(tmp_path: Path) -> None:
    stage = other_usd_cameras(tmp_path / "c.usda", ring_rig(2))
    place = UsdGeom.Xformable(stage.GetPrimAtPath("/World")).AddTranslateOp()
    place.Set(Gf.Vec3d(0, 0, 1), 2.0)
    place.Set(Gf.Vec3d(0, 0, 0), 1.0)
    stage.GetRootLayer().Save()
    with pytest.raises(InputError, match=r"/World/Cameras/cam01 moves; export the cameras again, standing still"):
        read_calibration(tmp_path / "c.usda", sizes={"cam01": (640, 480)})


def changed_json(change: Callable[[dict], object]) -> Callable[[str], str]:
    def changed(text: str) -> str:
        values = json.loads(text)
        change(values)
        return json.dumps(values)

    return changed


def replaced(old: str, new: str) -> Callable[[str], str]:
    return lambda text: text.replace(old, new)


WRONG = {
    "no unit of COLMAP": (
        "images.txt",
        replaced("", ""),
        r'images\.txt: does not state the unit .*say which: units = "m"',
    ),
    "lens model": (
        "cameras.txt",
        replaced("OPENCV", "FOV"),
        r"lens model 'FOV' is not known; known are SIMPLE_PINHOLE",
    ),
    "parameters": ("cameras.txt", replaced("OPENCV", "RADIAL"), r"camera 7: RADIAL has 8 parameters, not 5"),
    "short line": ("cameras.txt", lambda text: "7 OPENCV\n", r"camera 7: OPENCV has 0 parameters, not 8"),
    "lens number": ("images.txt", replaced(" 8 cam02", " 80 cam02"), r"image 'cam02\.jpg' is of camera 80, which"),
    "two images": ("images.txt", replaced("cam02.jpg", "cam01.png"), r"2 images are named 'cam01'; keep one image"),
    "same image": ("images.txt", replaced("cam02.jpg", "cam01.jpg"), r"'cam01\.jpg' is there twice"),
    "quaternion": ("images.txt", replaced("\n1 ", "\n1 7"), r"image 1: the quaternion has length 7"),
    "no pose": ("images.txt", lambda text: "1 1 0 0 0\n\n", r"image 1: the line has 5 values, not 10"),
    "points missing": ("images.txt", lambda text: text.replace("\n\n", "\n"), r"image|camera"),
    "no images": ("images.txt", lambda text: "# none\n", r"no camera found"),
    "a word": ("cameras.txt", replaced(" 640 ", " wide "), r"could not convert string to float: 'wide'"),
    "no JSON": ("m.json", lambda text: text[:-9], r"is not valid JSON \("),
    "other JSON": ("m.json", lambda text: "[1]", r"m\.json: is not a JSON object"),
    "other object": ("m.json", lambda text: "{}", r"has no 'cameras' and 'camera_poses', by which MultiCal's"),
    "no unit of MultiCal": ("m.json", replaced("", ""), r"does not state the unit of its lengths"),
    "camera without a pose": (
        "m.json",
        changed_json(lambda values: values["camera_poses"].pop("cam02_to_cam01")),
        r"camera 'cam02' has no pose",
    ),
    "pose of nobody": ("m.json", replaced("cam03_to_", "cam3_to_"), r"camera_poses 'cam3_to_cam01': names no camera"),
    "four in a row": (
        "m.json",
        changed_json(lambda values: values["cameras"]["cam01"].update(dist=[0.1, 0.0, 0.0, 0.0])),
        r"camera 'cam01': its lens is neither MultiCal's standard one \(5 coefficients\) nor its fisheye",
    ),
    "rational lens": (
        "m.json",
        changed_json(lambda values: values["cameras"]["cam01"].update(dist=[[0.1] * 8])),
        r"camera 'cam01': its lens is neither",
    ),
    "NaN": (
        "m.json",
        changed_json(lambda values: values["cameras"]["cam01"].update(K=[[float("nan")] * 3] * 3)),
        r"K holds a value that is not finite",
    ),
    "no place at all": (
        "c.toml",
        lambda text: text.split("[cameras.1]")[0],
        r"\[cameras\]: no camera has a rotation and a translation; calibrate where the cameras stand",
    ),
    "unknown key": ("c.toml", replaced("grid_count", "grids"), r"\[cameras\.1\]: unknown key 'grids'"),
    "K in another order": ("c.toml", replaced("[0.0, 0.0, 1.0]]", "[0.0, 0.0, 2.0]]"), r"K is not \[\[fx, 0, cx\]"),
    "huge": ("c.toml", lambda text: text + "#" * 2**22, r"has over 4 MB; give a TOML text file"),
    "huge JSON": ("m.json", lambda text: text + " " * 2**20, r"has over 1 MB; give the calibration.json"),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_wrong_files_are_refused_in_a_line(tmp_path: Path, wrong: str) -> None:
    name, change, message = WRONG[wrong]
    rig = brown_rig()
    write_colmap_model(tmp_path, rig)
    (tmp_path / "m.json").write_text(multical(rig))
    (tmp_path / "c.toml").write_text(caliscope(rig))
    (tmp_path / name).write_text(change((tmp_path / name).read_text()))
    with pytest.raises(InputError, match=message) as caught:
        read_calibration(tmp_path / name, None if "unit" in wrong else "m")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["cam 1", "a/b", ""])
def test_names_that_a_format_cannot_have(tmp_path: Path, name: str) -> None:
    rig = replace(brown_rig(), names=(name, "b", "c", "d"))
    for file in ("cameras.txt", "intri.yml"):
        with pytest.raises(InputError, match=f"allows no camera name '{name}'"):
            write_calibration(tmp_path / file, rig)


def test_an_output_of_no_known_name(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        write_calibration(tmp_path / "rig.json", brown_rig())
    assert all(str(format) in str(caught.value) for format in CALIBRATION_EXPORTS)


def test_caliscope_that_knows_lenses_alone(tmp_path: Path) -> None:
    rig = brown_rig()
    text = caliscope(rig)
    kept = [line for line in text.splitlines() if not line.startswith(("rotation =", "translation"))]
    (tmp_path / "camera_array.toml").write_text("\n".join(kept))
    lenses = read_lenses(tmp_path / "camera_array.toml", "+z", {})
    assert lenses is not None
    assert not lenses.placed
    np.testing.assert_array_equal(lenses.K[:4], rig.K)
    (tmp_path / "camera_array.toml").write_text(text)
    assert read_lenses(tmp_path / "camera_array.toml", "+z", {}) is None


def test_cameras_that_all_stand_at_the_origin_are_still_refused(tmp_path: Path) -> None:
    write_calibration(tmp_path / "c.toml", replace(brown_rig(), t=np.zeros((4, 3))))
    with pytest.raises(InputError, match="all cameras lie within"):
        read_calibration(tmp_path / "c.toml")
