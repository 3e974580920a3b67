"""Data sets: a made twin of each, written by the formulas that its own tools use, becomes a scene that agrees."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

import mmocap_warp as mm
from mmocap_warp import cli
from mmocap_warp.cameras.rig import project
from mmocap_warp.cli.console import BAD_INPUT, OK, USAGE
from mmocap_warp.formats.table import DATASETS

PIXEL, METRE = 1e-3, 1e-6
FRAMES = 4
SIZE = (192, 108)
POINTS = np.random.default_rng(3).uniform((-0.5, -0.5, 0.1), (0.5, 0.5, 1.7), (40, 3))  # [m], z up


def write_video(path: Path, frames: int = FRAMES, size: tuple[int, int] = SIZE, fps: float = 25.0) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), fps, size)
    for frame in range(frames):
        writer.write(np.full((*size[::-1], 3), 60 * frame, np.uint8))
    writer.release()


def looking_at_the_middle(k: int) -> tuple[np.ndarray, np.ndarray]:
    """R and t [m], world to camera, of a camera that stands 4 m away, in a world whose z is up."""
    bearing = 0.4 + 2.1 * k
    centre = np.array([4 * np.cos(bearing), 4 * np.sin(bearing), 1.2 + 0.3 * k])
    forward = np.array([0, 0, 0.9]) - centre
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward])
    return R, -R @ centre


LENS = np.array([-0.21, 0.06, 0.002, -0.001, 0.01])
K = np.array([[210.0, 0, 96.3], [0, 212.0, 53.1], [0, 0, 1]])


def check(folder: Path, expected: dict[str, np.ndarray], points: np.ndarray, tolerance: float = PIXEL) -> mm.Scene:
    """The scene, whose cameras put points [m] where the data set's own formula did."""
    scene = load(folder)
    pixels = project(scene.calibrated, points)
    assert scene.calibrated.names == tuple(expected)
    for k, name in enumerate(expected):
        assert np.abs(pixels[k] - expected[name]).max() < tolerance, name
    return scene


def load(folder: Path) -> mm.Scene:
    from mmocap_warp.scene.scene_toml import load_scene

    return load_scene(folder, masks=False)


# CMU Panoptic: y is down, centimetres.
FROM_PANOPTIC = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # its world's axes in ours, z up
JOINTS = np.random.default_rng(4).uniform(-100, 100, (FRAMES, 19, 4)) * [1, 1, 1, 0.01]


def panoptic_pixels(X: np.ndarray, K: np.ndarray, R: np.ndarray, t: np.ndarray, Kd: np.ndarray) -> np.ndarray:
    """As panutils.projectPoints of the toolbox: points in columns."""
    x = R @ X + t
    x[:2] /= x[2]
    r = x[0] ** 2 + x[1] ** 2
    radial = 1 + Kd[0] * r + Kd[1] * r**2 + Kd[4] * r**3
    u = x[0] * radial + 2 * Kd[2] * x[0] * x[1] + Kd[3] * (r + 2 * x[0] ** 2)
    v = x[1] * radial + 2 * Kd[3] * x[0] * x[1] + Kd[2] * (r + 2 * x[1] ** 2)
    return np.stack([K[0, 0] * u + K[0, 1] * v + K[0, 2], K[1, 1] * v + K[1, 2]], axis=-1)


def write_panoptic(root: Path) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """The twin; where its cameras see ``POINTS``, and these in its world [m]."""
    cameras, seen = [], {}
    world = POINTS @ FROM_PANOPTIC
    for k in range(3):
        R, t = looking_at_the_middle(k)
        R, t = R @ FROM_PANOPTIC, 100 * t
        name = f"00_0{k + 1}"
        values = {"K": K.tolist(), "distCoef": LENS.tolist(), "R": R.tolist(), "t": t[:, None].tolist()}
        cameras.append({"name": name, "type": "hd", "resolution": list(SIZE), "panel": 0, "node": k + 1, **values})
        seen[name] = panoptic_pixels(100 * world.T, K, R, t[:, None], LENS)
        write_video(root / f"hdVideos/hd_{name}.mp4", fps=29.97)
    cameras += [{**cameras[0], "type": "vga", "name": "01_01"}, {**cameras[0], "name": "00_00"}]  # without videos
    (root / "calibration_made.json").write_text(json.dumps({"cameras": cameras}))
    poses = root / "hdPose3d_stage1_coco19"
    poses.mkdir()
    for frame in range(1, FRAMES + 2):  # annotations go on after the videos
        bodies = [{"id": 7, "joints19": JOINTS[frame % FRAMES].ravel().tolist()}]
        bodies += [{"id": 2, "joints19": [0.0] * 76}] if frame == 2 else []
        (poses / f"body3DScene_{frame:08d}.json").write_text(json.dumps({"fpsType": "hd_29_97", "bodies": bodies}))
    return seen, world


def test_panoptic(tmp_path, capsys):
    seen, world = write_panoptic(tmp_path / "made")
    assert cli.main(["dataset", "panoptic", str(tmp_path / "made"), "-o", str(tmp_path / "scene"), "--json"]) == OK
    printed = capsys.readouterr()
    assert json.loads(printed.out)["cameras"] == list(seen)
    assert "the truth is person 7; there are 7 in 3 frames, 2 in 1 frames" in printed.err
    scene = check(tmp_path / "scene", seen, world)
    assert (scene.calibrated.up, scene.frame_count, scene.fps) == ("-y", FRAMES, 29.97)
    truth = mm.load_truth(scene.truth)
    assert truth.frame_numbers.tolist() == [1, 2, 3]
    trusted = JOINTS[1:, :, 3] > 0.1
    np.testing.assert_allclose(truth.joints[trusted], JOINTS[1:, :, :3][trusted] / 100, atol=METRE)
    assert np.isnan(truth.joints[~trusted]).all()
    assert [truth.joint_names[i] for i in (0, 2, 5, 14)] == ["Neck", "Root", "LWrist", "RAnkle"]


@pytest.mark.parametrize(
    ("file", "change", "message"),
    [
        ("calibration_made.json", lambda text: text[:100], r"calibration_made\.json: is not valid JSON"),
        ("calibration_made.json", lambda text: text.replace('"K"', '"L"'), r"cameras\[0\]: K is not 3x3 numbers"),
        ("calibration_made.json", lambda text: text.replace("210.0", "NaN"), r"K holds a number that is not finite"),
        ("calibration_made.json", lambda text: text.replace("hd", "dh"), r"has no camera of type hd .*same sequence"),
        ("hdPose3d_stage1_coco19/body3DScene_00000001.json", lambda text: "[]", r"00001\.json: is not a JSON object"),
        (
            "hdPose3d_stage1_coco19/body3DScene_00000001.json",
            lambda text: text.replace("joints19", "joints15"),
            r"bodies\[0\]: joints19 is not 19x4 numbers; copy it again",
        ),
    ],
)
def test_faults_of_panoptic(tmp_path, file, change, message):
    write_panoptic(tmp_path)
    (tmp_path / file).write_text(change((tmp_path / file).read_text()))
    with pytest.raises(mm.InputError, match=message):
        mm.import_dataset("panoptic", tmp_path, [], tmp_path / "scene")


def test_wrong_arguments(tmp_path, capsys):
    for arguments in (["nothing", "x"], ["panoptic", "x", "1", "2"]):
        assert cli.main(["dataset", *arguments, "-o", str(tmp_path / "scene")]) == USAGE
    assert "mmocap dataset panoptic ROOT [PERSON]" in capsys.readouterr().err
    assert cli.main(["dataset", "panoptic", str(tmp_path / "none"), "-o", str(tmp_path / "scene")]) == BAD_INPUT
    assert cli.main(["dataset", "--help"]) == OK
    printed = capsys.readouterr().out
    assert all(name in printed for name in DATASETS)
