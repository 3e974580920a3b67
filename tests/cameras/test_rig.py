"""Cameras against OpenCV, and the three calibration formats against each other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from calibration_files import write_easymocap
from synthetic import ring_rig

from mmocap_warp.cameras.rig import CameraRig, check_rig, describe_rig, draw_world_axes, project
from mmocap_warp.cameras.undistort import undistortion
from mmocap_warp.errors import InputError
from mmocap_warp.formats.calibration.opencv_yaml import read_opencv_yaml
from mmocap_warp.formats.calibration.qualisys import read_qualisys
from mmocap_warp.formats.calibration.toml_rig import read_toml_rig, write_toml_rig

PIXEL = 1e-9  # [px], float64 against float64
CENTROID = 0.003  # [px], of a disc 28 px wide at a quarter of the size
COVERAGE = 0.1  # of a pixel at the disc's edge; rays are sampled and OpenCV's remap rounds to 1/32 px
LENS = np.array([-0.15, 0.08, 0.002, -0.001, 0.01])


def distorted_rig() -> CameraRig:
    rig = ring_rig(4)
    return replace(rig, distortion=LENS * np.linspace(0.5, 1.5, 4)[:, None])


def test_projection_equals_opencv() -> None:
    rig = distorted_rig()
    points = np.random.default_rng(0).uniform([-0.8, 0, -0.8], [0.8, 1.8, 0.8], (50, 3))
    for k, pixels in enumerate(project(rig, points)):
        expected, _ = cv2.projectPoints(points, cv2.Rodrigues(rig.R[k])[0], rig.t[k], rig.K[k], rig.distortion[k])
        np.testing.assert_allclose(pixels, expected[:, 0], rtol=0, atol=PIXEL)


@pytest.mark.parametrize("lens", [LENS, np.zeros(5)])
def test_a_skew_is_undone_with_the_lens(lens: np.ndarray) -> None:
    rig = replace(ring_rig(1), distortion=lens[None])
    K = rig.K.copy()
    K[:, 0, 1] = 0.004 * K[:, 0, 0]
    skewed = replace(rig, K=K)
    points = np.random.default_rng(0).uniform([-0.8, 0, -0.8], [0.8, 1.8, 0.8], (50, 3))
    # The matrix of K and the skew, after OpenCV's distortion at focal length 1.
    turn = cv2.Rodrigues(rig.R[0])[0]
    plane = cv2.projectPoints(points, turn, rig.t[0], np.eye(3), lens)[0][:, 0]
    expected = np.column_stack([plane, np.ones(50)]) @ K[0].T
    np.testing.assert_allclose(project(skewed, points)[0], expected[:, :2], rtol=0, atol=PIXEL)
    np.testing.assert_array_equal(skewed.undistorted().K, rig.undistorted().K)
    # An image whose gray levels are its columns tells where each pixel of the pinhole was found.
    width, height = rig.size[0]
    columns = np.tile(np.arange(width, dtype=np.float32), (height, 1))
    found = undistortion(skewed, 0, 1.0).image(columns)
    seen = np.rint(project(skewed.undistorted(), points)[0])
    rays = np.column_stack([seen, np.ones(50)]) @ np.linalg.inv(rig.K[0]).T
    at = np.column_stack([cv2.projectPoints(rays, np.zeros(3), np.zeros(3), np.eye(3), lens)[0][:, 0], np.ones(50)])
    where = (at @ K[0].T)[:, 0]
    np.testing.assert_allclose(found[tuple(seen.astype(int).T[::-1])], where, rtol=0, atol=1 / 16)


def test_points_behind_a_camera_have_no_pixel() -> None:
    rig = ring_rig(2)
    behind = rig.centres[0] - rig.R[0][2]
    assert np.isnan(project(rig, behind[None])[0]).all()


def test_scaling_keeps_pixel_centres_in_place() -> None:
    rig = ring_rig(3)
    points = np.array([[0.1, 1.0, 0.2], [-0.4, 0.3, 0.1]])
    full, quarter = project(rig, points), project(rig.undistorted(0.25), points)
    np.testing.assert_allclose(quarter, (full + 0.5) * 0.25 - 0.5, rtol=0, atol=PIXEL)
    np.testing.assert_array_equal(rig.undistorted(0.25).size, rig.size // 4)
    with pytest.raises(ValueError, match="scale must be positive"):
        rig.undistorted(0.0)


def disc_image(rig: CameraRig, k: int, samples: int, recorded: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Coverage (height, width), 0 to 1, of a disc in the world, by rays through ``samples`` x ``samples`` per pixel.

    ``recorded`` takes recorded to calibrated pixels; OpenCV takes the lens out.
    """
    width, height = rig.size[k]
    u = (np.arange(width * samples) + 0.5) / samples - 0.5
    v = (np.arange(height * samples) + 0.5) / samples - 0.5
    pixels = recorded(np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 1, 2))
    plane = cv2.undistortPoints(pixels, rig.K[k], rig.distortion[k])[:, 0]
    rays = np.column_stack([plane, np.ones(len(plane))]) @ rig.R[k]
    centre, normal = np.array([0.25, 1.3, 0.1]), rig.R[k][2]
    eye = rig.centres[k]
    hit = eye + rays * ((centre - eye) @ normal / (rays @ normal))[:, None]
    inside = (np.linalg.norm(hit - centre, axis=1) < 0.25).reshape(height, samples, width, samples)
    return inside.mean(axis=(1, 3))


@pytest.mark.parametrize(
    ("scale", "offset"), [pytest.param(1.0, (0.0, 0.0), marks=pytest.mark.nightly), (0.99265, (0.1, 7.15))]
)
def test_undistorted_masks_lie_where_the_pinhole_sees_them(scale: float, offset: tuple[float, float]) -> None:
    rig = distorted_rig().select(("cam04",))
    recording = disc_image(rig, 0, 4, lambda pixel: (pixel - offset) / scale)
    resample = undistortion(rig, 0, 0.25, scale, offset)
    seen = resample.image(np.rint(255 * recording).astype(np.uint8)) / 255
    expected = disc_image(rig.undistorted(0.25), 0, 8, lambda pixel: pixel)
    np.testing.assert_allclose(seen, expected, rtol=0, atol=COVERAGE)
    row, column = np.indices(expected.shape)
    for axis in (row, column):
        np.testing.assert_allclose(
            (axis * seen).sum() / seen.sum(), (axis * expected).sum() / expected.sum(), atol=CENTROID
        )
    settled = np.abs(expected - 0.5) > COVERAGE
    np.testing.assert_array_equal(resample.mask(recording > 0.5)[settled], expected[settled] > 0.5)


def test_toml_reads_back(tmp_path: Path) -> None:
    rig = distorted_rig()
    write_toml_rig(tmp_path / "rig.toml", rig)
    again = read_toml_rig(tmp_path / "rig.toml", up="+y")
    assert again.names == rig.names
    for name in ("K", "R", "t", "size", "distortion"):
        np.testing.assert_allclose(getattr(again, name), getattr(rig, name), rtol=0, atol=1e-12)
    assert list(tmp_path.iterdir()) == [tmp_path / "rig.toml"]


@pytest.mark.parametrize("rotation", ["Rot", "R"])
def test_easymocap_yaml(tmp_path: Path, rotation: str) -> None:
    rig = distorted_rig()
    write_easymocap(tmp_path, rig, rotation, per_metre=1000.0)
    for path in (tmp_path, tmp_path / "intri.yml"):
        again = read_opencv_yaml(path, units="mm", up="+y")
        for name in ("K", "R", "t", "size", "distortion"):
            np.testing.assert_allclose(getattr(again, name), getattr(rig, name), rtol=0, atol=1e-12)


def test_easymocap_yaml_without_sizes(tmp_path: Path) -> None:
    rig = distorted_rig()
    write_easymocap(tmp_path, rig, size=False, per_metre=1000.0)
    sizes = dict.fromkeys(rig.names, (640, 480))
    np.testing.assert_array_equal(read_opencv_yaml(tmp_path, "mm", sizes=sizes).size, rig.size)
    with pytest.raises(InputError, match="W_cam01 and H_cam01 are missing; add the image size"):
        read_opencv_yaml(tmp_path, "mm")


def qualisys_xml(rig: CameraRig) -> str:
    cameras = []
    for k, name in enumerate(rig.names):
        r = np.diag([1, -1, -1]) @ rig.R[k]
        x, y, z = 1000 * rig.centres[k]
        turn = " ".join(f'r{i + 1}{j + 1}="{r[i, j]!r}"' for i in range(3) for j in range(3)).replace("np.float64", "")
        turn = turn.replace("(", "").replace(")", "")
        k1, k2, p1, p2, k3 = rig.distortion[k]
        (fx, _, cx), (_, fy, cy) = 64 * rig.K[k, :2]
        width, height = rig.size[k]
        cameras.append(
            f'<camera serial="{name}"><fov_video left="0" top="0" right="{width - 1}" bottom="{height - 1}"/>'
            f'<transform x="{x}" y="{y}" z="{z}" {turn}/><intrinsic focalLengthU="{fx}" focalLengthV="{fy}" '
            f'centerPointU="{cx}" centerPointV="{cy}" skew="0" radialDistortion1="{k1}" radialDistortion2="{k2}" '
            f'radialDistortion3="{k3}" tangentalDistortion1="{p1}" tangentalDistortion2="{p2}"/></camera>'
        )
    return f"<calibration><cameras>{''.join(cameras)}</cameras></calibration>"


def test_qualisys(tmp_path: Path) -> None:
    rig = distorted_rig()
    path = tmp_path / "rig.qca.txt"
    path.write_text(qualisys_xml(rig))
    again = read_qualisys(path, up="+y")
    for name in ("K", "R", "t", "size", "distortion"):
        np.testing.assert_allclose(getattr(again, name), getattr(rig, name), rtol=0, atol=1e-9)


def test_qualisys_states_centres_on_the_whole_sensor(tmp_path: Path) -> None:
    rig, path = distorted_rig(), tmp_path / "rig.qca.txt"
    text = qualisys_xml(rig).replace('left="0" top="0"', 'left="100" top="40"')
    for k in range(len(rig)):
        width, height = rig.size[k]
        text = text.replace(
            f'right="{width - 1}" bottom="{height - 1}"', f'right="{width + 99}" bottom="{height + 39}"'
        )
    path.write_text(text)
    again = read_qualisys(path, up="+y")
    np.testing.assert_array_equal(again.size, rig.size)
    np.testing.assert_allclose(again.K[:, :2, 2], rig.K[:, :2, 2] - (100, 40), rtol=0, atol=1e-9)


def test_qualisys_of_the_real_recording(shared_data: Path) -> None:
    rig = read_qualisys(shared_data / "pose2sim_single" / "calibration" / "Calib.qca.txt")
    assert rig.names == ("cam01", "cam02", "cam03", "cam04")
    assert (rig.size == (1088, 1920)).all()
    np.testing.assert_allclose(rig.K[0, 0, 0], 107599.671875 / 64)
    np.testing.assert_allclose(rig.centres[0], [1.4602324, -1.9091590, 1.8965059], rtol=0, atol=1e-6)
    middle = project(rig, np.array([[-1.0, 0.0, 1.0]]))[:, 0]  # where the man stands
    assert ((middle > 0) & (middle < rig.size)).all()


def test_summary() -> None:
    first, second, *_ = describe_rig(ring_rig(4, distance=4.0))
    assert first.name == "cam01"
    assert first.height == pytest.approx(1.4)
    assert first.nearest == pytest.approx(4.0 * np.sqrt(2))
    assert first.field_of_view[0] == pytest.approx(2 * np.degrees(np.arctan(0.5)))
    assert second.field_of_view[0] < first.field_of_view[0]
    assert describe_rig(ring_rig(1))[0].nearest == np.inf


@pytest.mark.parametrize("up", ["+x", "-y", "+z", "-z"])
def test_height_is_along_the_up_axis(up: str) -> None:
    assert [row.height for row in describe_rig(ring_rig(3, up=up))] == pytest.approx([1.4] * 3)


def test_world_axes_start_at_the_origin() -> None:
    rig = distorted_rig()
    blank = np.zeros((480, 640, 3), np.uint8)
    drawn = draw_world_axes(blank, rig, 1)
    u, v = np.rint(project(rig, np.zeros((1, 3)))[1, 0]).astype(int)
    assert drawn[v - 2 : v + 3, u - 2 : u + 3].any()
    assert not blank.any()


def changed(**arrays: tuple) -> CameraRig:
    """The ring with one entry of some arrays replaced, given as (index, value)."""
    rig = ring_rig(3)
    new = {}
    for name, (index, value) in arrays.items():
        new[name] = getattr(rig, name).astype(float)
        new[name][index] = value
    return replace(rig, **new)


WRONG_RIGS = {
    "NaN in K": (changed(K=((1, 0, 0), np.nan)), r"camera 'cam02': K holds a value that is not finite; calibrate"),
    "infinite t": (changed(t=((0, 2), np.inf)), r"camera 'cam01': t holds a value that is not finite"),
    "mirrored": (changed(R=(2, ring_rig(3).R[2] * [[1], [1], [-1]])), r"cam03': R is mirrored \(determinant -1\)"),
    "not orthonormal": (changed(R=(0, 1.01 * ring_rig(3).R[0])), r"cam01': R is not orthonormal"),
    "focal length in mm": (changed(K=((0, 0, 0), 8.0)), r"focal lengths 8, .* do not suit a 640x480 image"),
    "skew": (changed(K=((0, 0, 1), 40.0)), r"skew is 40 px"),
    "centre far outside": (changed(K=((0, 1, 2), 9000.0)), r"principal point .* is far outside 640x480"),
    "no size": (changed(size=(1, (0, 480))), r"cam02': size is 0"),
    "millimetres as metres": (replace(ring_rig(3), t=1000 * ring_rig(3).t), r'units = "mm"'),
    "metres as millimetres": (replace(ring_rig(3), t=ring_rig(3).t / 1000), r"within 6\.93 mm of each other"),
    "name twice": (replace(ring_rig(3), names=("a", "b", "a")), r"camera name 'a' is used twice; give every"),
}


@pytest.mark.parametrize("wrong", WRONG_RIGS)
def test_wrong_rigs_are_refused(wrong: str) -> None:
    rig, message = WRONG_RIGS[wrong]
    with pytest.raises(InputError, match=message) as caught:
        check_rig(rig, "calibration.toml")
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("calibration.toml: ")


GOOD_CAMERA = """
[cam_0]
name = "cam_0"
size = [640.0, 480.0]
matrix = [[600.0, 0.0, 320.0], [0.0, 600.0, 240.0], [0.0, 0.0, 1.0]]
distortions = [0.1, 0.0, 0.0, 0.0]
rotation = [0.1, 0.2, 0.3]
translation = [0.0, 1.0, 4.0]
fisheye = false
[metadata]
error = 0.2
"""
GOOD_XML = qualisys_xml(ring_rig(2))
WRONG_FILES = {
    "no TOML": ("calib.toml", "[cam]\nsize = 1 2\n", r"is not valid TOML: .*line 2"),
    "no camera": ("calib.toml", "[metadata]\nerror = 0.1", r"no camera found"),
    "five of a fisheye": (
        "calib.toml",
        GOOD_CAMERA.replace("false", "true").replace("[0.1, 0.0,", "[0.1, 0.0, 0.0,"),
        r"\[cam_0\]: distortions = .* is not 4 numbers",
    ),
    "folded fisheye": (
        "calib.toml",
        GOOD_CAMERA.replace("false", "true").replace("[0.1, 0.0,", "[-0.9, 0.0,"),
        r"camera 'cam_0': the fisheye distortion folds the image over itself; see that these are k1 k2 k3 k4",
    ),
    "missing key": ("calib.toml", GOOD_CAMERA.replace("translation", "T"), r"'translation' is missing; add"),
    "unknown key": ("calib.toml", GOOD_CAMERA.replace("fisheye", "fish_eye"), r"'fish_eye'; did you mean 'fisheye'"),
    "three coefficients": ("calib.toml", GOOD_CAMERA.replace("[0.1, 0.0,", "[0.1,"), r"distortions = .* is not 4 or 5"),
    "matrix": ("calib.toml", GOOD_CAMERA.replace(", [0.0, 0.0, 1.0]]", "]"), r"matrix is not 3 rows of 3 numbers"),
    "NaN in TOML": ("calib.toml", GOOD_CAMERA.replace("0.3]", "nan]"), r"rotation holds a value that is not finite"),
    "no XML": ("rig.qca.txt", "serial=cam01", r"is not valid XML: .*line 1"),
    "entities": ("rig.qca.txt", '<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>', r"is not valid XML: Entit"),
    "no encoding": ("rig.qca.txt", '<?xml version="1.0" encoding="foo"?><a/>', r"is not valid XML: unknown encoding"),
    "no transform": ("rig.qca.txt", GOOD_XML.replace("transform", "t"), r"<transform r11=...> is missing"),
    "a word": ("rig.qca.txt", GOOD_XML.replace('skew="0"', 'skew="no"'), r"skew = 'no' is not a number"),
    "no extri.yml": ("intri.yml", "%YAML:1.0\n---\nnames: []\n", r"extri.yml: no such file"),
    "no OpenCV YAML": ("extri.yml", "a: [", r"intri.yml: no such file"),
}


@pytest.mark.parametrize("wrong", WRONG_FILES)
def test_wrong_files_are_refused(tmp_path: Path, wrong: str) -> None:
    name, text, message = WRONG_FILES[wrong]
    read = {"l": read_opencv_yaml, "t": read_qualisys}[name[-1]] if not name.endswith("toml") else read_toml_rig
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        read(tmp_path / name)
    assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match="no such file"):
        read(tmp_path / "elsewhere" / name)
