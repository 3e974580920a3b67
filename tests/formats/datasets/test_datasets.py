"""Data sets: a made twin of each, written by the formulas that its own tools use, becomes a scene that agrees."""

from __future__ import annotations

import json
from dataclasses import replace
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
    codec = "mp4v" if path.suffix == ".mp4" else "MJPG"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*codec), fps, size)
    for frame in range(frames):
        writer.write(np.full((*size[::-1], 3), 20 * frame, np.uint8))
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


def test_words_about_a_recording_stay_in_their_comment(tmp_path):
    write_panoptic(tmp_path / "made")
    with pytest.warns(UserWarning, match="the truth is person 7"):
        scene = mm.import_dataset("panoptic", tmp_path / "made", [], tmp_path / "scene")
    assert mm.load_scene(replace(scene, about=("a\nb",)).write(tmp_path / "scene")).name == "made"


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


# BioCV: z is up, millimetres, L is scaled.
LABELS = ("LEFT_SHO", "CLAV", "RIGHT_ANKLE")
TRACKS = np.random.default_rng(5).uniform(100, 1500, (FRAMES + 1, 3, 3))  # [mm]


def write_biocv(root: Path) -> dict[str, np.ndarray]:
    seen, trial = {}, root / "P03/P03_WALK_01"
    for k in range(3):
        R, t = looking_at_the_middle(k)
        name, L = f"0{k}", np.eye(4)
        L[:3] = 0.998 * np.column_stack([R, 1000 * t])
        write_video(trial / f"{name}.mp4", fps=200.0)
        rows = [f"{SIZE[0]}", f"{SIZE[1]}", *(" ".join(f"{v:.12g}" for v in row) for row in (*K, *L, LENS))]
        (root / f"P03/{name}.mp4-mocAligned.calib").write_text("\n".join(rows) + "\n")
        # mc_dev projects with K [s R | s t] and OpenCV's distortion; a scale of the whole has no effect.
        moved = np.column_stack([1000 * POINTS, np.ones(len(POINTS))]) @ L[:3].T
        seen[name] = cv2.projectPoints(moved, np.zeros(3), np.zeros(3), K, LENS)[0][:, 0]
    import ezc3d

    file = ezc3d.c3d()
    about = file["parameters"]["POINT"]
    about["UNITS"]["value"], about["RATE"]["value"], about["LABELS"]["value"] = ["mm"], [200.0], list(LABELS)
    file["data"]["points"] = np.concatenate([TRACKS.transpose(2, 1, 0), np.ones((1, 3, FRAMES + 1))])
    file.write(str(trial / "markers.c3d"))
    return seen


def test_biocv(tmp_path):
    seen = write_biocv(tmp_path / "made")
    made = mm.import_dataset("biocv", tmp_path / "made", ["P03_WALK_01"], tmp_path / "scene")
    assert repr(made) == f"P03_WALK_01: {FRAMES} frames, {FRAMES} with truth, 3 cameras"
    scene = check(tmp_path / "scene", seen, POINTS)
    assert (scene.calibrated.up, scene.frame_count, scene.fps) == ("+z", FRAMES, 200)
    truth = mm.load_truth(scene.truth)
    assert (truth.joint_names, truth.marker_names) == (("LShoulder", "RAnkle"), ("CLAV",))
    np.testing.assert_allclose(truth.joints, TRACKS[:FRAMES, ::2] / 1000, atol=METRE)
    np.testing.assert_allclose(truth.markers, TRACKS[:FRAMES, 1:2] / 1000, atol=METRE)


def test_faults_of_biocv(tmp_path):
    write_biocv(tmp_path)
    file = tmp_path / "P03/01.mp4-mocAligned.calib"
    text = file.read_text()
    for changed, message in (
        (text.replace(text.splitlines()[-1], ""), r"mocAligned\.calib: holds 27 numbers, not 32"),
        (text.replace(text.splitlines()[5].split()[0], "7", 1), r"L stretches lengths by"),
    ):
        file.write_text(changed)
        with pytest.raises(mm.InputError, match=message):
            mm.import_dataset("biocv", tmp_path, ["P03_WALK_01"], tmp_path / "scene")
    with pytest.raises(mm.InputError, match=r"'\.\./P03' cannot be the name of a file"):
        mm.import_dataset("biocv", tmp_path / "P03", ["../P03"], tmp_path / "scene")


# MPI-INF-3DHP: y is up, millimetres.
FROM_3DHP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
POSES = np.random.default_rng(6).uniform(-800, 800, (FRAMES + 1, 28, 3))  # [mm], in the world


def write_3dhp(root: Path) -> tuple[dict[str, np.ndarray], np.ndarray]:
    from scipy.io import savemat

    folder = root / "S1/Seq1"
    seen, cells, world = {}, np.empty((14, 1), object), POINTS @ FROM_3DHP
    lines = ["Skeletool Camera Calibration File V1.0"]
    for k in range(14):
        R, t = looking_at_the_middle(k)
        E = np.eye(4)
        E[:3] = np.column_stack([R @ FROM_3DHP, 1000 * t])
        P = np.eye(4)
        P[:3, :3] = K
        numbers = [" ".join(f"{value:.7g}" for value in matrix.ravel()) for matrix in (P, E)]
        lines += [f"name          {k}", "  sensor      10 10", f"  size        {SIZE[0]} {SIZE[1]}"]
        lines += ["  animated    0", f"  intrinsic   {numbers[0]} ", f"  extrinsic   {numbers[1]} ", "  radial      0"]
        cells[k, 0] = (POSES @ E[:3, :3].T + E[:3, 3]).reshape(FRAMES + 1, -1)
        if k not in (0, 2, 8):
            continue
        x = P @ E @ np.vstack([1000 * world.T, np.ones(len(world))])
        seen[f"video_{k}"] = (x[:2] / x[2]).T
        write_video(folder / f"imageSequence/video_{k}.avi")
        write_masks(folder / f"FGmasks/video_{k}.avi")
    (folder / "camera.calibration").write_text("\n".join(lines) + "\n")
    savemat(folder / "annot.mat", {"annot3": cells, "frames": np.arange(FRAMES + 1)[:, None]})
    return seen, world


def write_masks(path: Path) -> None:
    """The person is red; green and blue are white wherever there are no clothes."""
    path.parent.mkdir(parents=True, exist_ok=True)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 25.0, SIZE)
    image = np.full((*SIZE[::-1], 3), (255, 255, 0), np.uint8)
    image[32:80, 64:128] = (0, 0, 255)
    for _ in range(FRAMES):
        writer.write(image)
    writer.release()


def test_mpi_inf_3dhp(tmp_path):
    seen, world = write_3dhp(tmp_path / "made")
    mm.import_dataset("mpi-inf-3dhp", tmp_path / "made", ["S1", "Seq1"], tmp_path / "scene")
    check(tmp_path / "scene", seen, world)
    scene = mm.load_scene(tmp_path / "scene")
    assert (scene.calibrated.up, scene.frame_count, scene.fps) == ("+y", FRAMES, 25)
    for mask in next(iter(scene.masks())):
        assert abs(int(mask.sum()) - 48 * 64) < 200
        assert mask[40:70, 70:120].all()
    truth = mm.load_truth(scene.truth)
    np.testing.assert_allclose(truth.joints, POSES[:FRAMES] / 1000, atol=METRE)
    assert [truth.joint_names[i] for i in (4, 7, 9, 11, 20, 23)] == [
        *("Root", "HeadTop", "LShoulder", "LWrist", "LAnkle", "RHip")
    ]


def test_faults_of_mpi_inf_3dhp(tmp_path):
    write_3dhp(tmp_path)
    annotations, calibration = tmp_path / "S1/Seq1/annot.mat", tmp_path / "S1/Seq1/camera.calibration"
    text = calibration.read_text()
    for file, data, message in (
        (
            annotations,
            b"MATLAB 7.3 MAT-file, Platform",
            r"annot\.mat: is a \.mat file of version 7\.3.*save\(\.\.\., '-v7'",
        ),
        (annotations, annotations.read_bytes()[:700], r"annot\.mat: cannot be read as a \.mat file"),
        (calibration, text.replace("extrinsic", "outside").encode(), r"camera video_0: extrinsic is not 4x4 numbers"),
        (calibration, text.replace("radial      0", "radial 1 -0.2").encode(), r"has a radial distortion"),
    ):
        kept = file.read_bytes()
        file.write_bytes(data)
        with pytest.raises(mm.InputError, match=message):
            mm.import_dataset("mpi-inf-3dhp", tmp_path, ["S1", "Seq1"], tmp_path / "scene")
        file.write_bytes(kept)


@pytest.mark.parametrize("name", ["a", "-1", "14"])
def test_a_camera_of_mpi_inf_3dhp_of_which_there_is_no_truth(tmp_path, capsys, name):
    write_3dhp(tmp_path)
    folder = tmp_path / "S1/Seq1"
    (folder / "imageSequence/video_0.avi").rename(folder / f"imageSequence/video_{name}.avi")
    calibration = folder / "camera.calibration"
    calibration.write_text(calibration.read_text().replace("name          0\n", f"name          {name}\n"))
    given = ["dataset", "mpi-inf-3dhp", str(tmp_path), "S1", "Seq1", "-o", str(tmp_path / "scene")]
    assert cli.main(given) == BAD_INPUT
    told = f"{folder / 'annot.mat'}: has no annot3 of camera {name}; copy it again from the data set"
    assert told in capsys.readouterr().err


# DANNCE and Rat7M: MATLAB's rows, pixels from 1, millimetres, z up, a skew.
MATLAB_K = np.array([[210.0, 0, 0], [0.7, 212.0, 0], [97.3, 54.1, 1]])
RADIAL, TANGENTIAL = LENS[[0, 1, 4]], LENS[2:4]
LEAD = (0, 2, 1)  # frames by which cameras lead the first


def matlab_pixels(points: np.ndarray, r: np.ndarray, t: np.ndarray) -> np.ndarray:
    """As project_to2d and distortPoints of dannce.engine.ops, counted from 0: rows times matrices; t is a row."""
    projected = np.column_stack([points, np.ones(len(points))]) @ np.concatenate([r, t]) @ MATLAB_K
    centred = projected[:, :2] / projected[:, 2:] - MATLAB_K[2, :2]
    y = centred[:, 1] / MATLAB_K[1, 1]
    x = (centred[:, 0] - MATLAB_K[1, 0] * y) / MATLAB_K[0, 0]
    r2 = x * x + y * y
    alpha = RADIAL[0] * r2 + RADIAL[1] * r2**2 + RADIAL[2] * r2**3
    (p1, p2), xy = TANGENTIAL, x * y
    u, v = x + x * alpha + 2 * p1 * xy + p2 * (r2 + 2 * x * x), y + y * alpha + p1 * (r2 + 2 * y * y) + 2 * p2 * xy
    u = u * MATLAB_K[0, 0] + MATLAB_K[2, 0] + MATLAB_K[1, 0] * v
    return np.stack([u, v * MATLAB_K[1, 1] + MATLAB_K[2, 1]], axis=-1) - 1


def write_rat7m(root: Path, first: int = 3500) -> dict[str, np.ndarray]:
    from scipy.io import savemat

    seen, cameras = {}, {}
    moments = np.arange(first - 3, first + FRAMES)
    for k in range(3):
        R, t = looking_at_the_middle(k)
        r, t = R.T, 1000 * t[None]
        keys = ("IntrinsicMatrix", "rotationMatrix", "translationVector", "RadialDistortion", "TangentialDistortion")
        name, values = f"Camera{k + 1}", (MATLAB_K, r, t, RADIAL[None], TANGENTIAL[None])
        cameras[name] = dict(zip(keys, values, strict=True)) | {"frame": moments[None] + LEAD[k]}
        seen[name] = matlab_pixels(1000 * POINTS, r, t)
        write_video(root / f"clips/s1-d1-camera{k + 1}-{first}.mp4", frames=FRAMES + 2)
    mocap = {"HeadF": 1000 * POINTS[: len(moments)], "SpineM": np.full((len(moments), 3), np.nan)}
    savemat(root / "mocap-s1-d1.mat", {"cameras": cameras, "mocap": mocap})
    return seen


def test_rat7m(tmp_path):
    seen = write_rat7m(tmp_path / "made")
    made = mm.import_dataset("dannce", tmp_path / "made", ["3500"], tmp_path / "scene")
    scene = check(tmp_path / "scene", seen, POINTS)
    assert [source.frame_offset for source in scene.cameras] == list(LEAD)
    assert (scene.calibrated.up, scene.frame_count, made.notes) == ("+z", FRAMES, ())
    truth = mm.load_truth(scene.truth)
    assert truth.marker_names == ("HeadF", "SpineM")
    np.testing.assert_allclose(truth.markers[:, 0], POINTS[3 : 3 + FRAMES], atol=METRE)
    assert np.isnan(truth.markers[:, 1]).all()
    with pytest.raises(mm.InputError, match=r"holds no \*\*/s1-d1-camera1-0\.mp4"):
        mm.import_dataset("dannce", tmp_path / "made", [], tmp_path / "other")


def write_dannce(root: Path) -> dict[str, np.ndarray]:
    from scipy.io import savemat

    seen, columns = {}, {key: np.empty((3, 1), object) for key in ("params", "sync", "labelData", "camnames")}
    for k in range(3):
        R, t = looking_at_the_middle(k)
        r, t = R.T, 1000 * t[None]
        lens = {"K": MATLAB_K, "r": r, "t": t, "RDistort": RADIAL[None], "TDistort": TANGENTIAL[None]}
        columns["params"][k, 0] = lens
        columns["sync"][k, 0] = {"data_frame": np.arange(FRAMES)[:, None]}
        columns["labelData"][k, 0] = {"data_frame": [[1, 3, 9]], "data_3d": 1000 * POINTS[:6].reshape(3, 6)}
        columns["camnames"][k, 0] = f"Camera{k + 1}"
        seen[f"Camera{k + 1}"] = matlab_pixels(1000 * POINTS, r, t)
        write_video(root / f"videos/Camera{k + 1}/0.mp4")
    savemat(root / "label3d_dannce.mat", columns)
    return seen


def test_dannce(tmp_path):
    """Its label file of a mouse, which is public but not ours to ship, agrees within 5e-13 px with its own labels."""
    seen = write_dannce(tmp_path / "made")
    mm.import_dataset("dannce", tmp_path / "made", [], tmp_path / "scene")
    scene = check(tmp_path / "scene", seen, POINTS)
    truth = mm.load_truth(scene.truth)
    assert (truth.frame_numbers.tolist(), truth.marker_names) == ([1, 3], ("point01", "point02"))
    np.testing.assert_allclose(truth.markers, POINTS[:4].reshape(2, 2, 3), atol=METRE)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("params", np.zeros(3), r"params: holds something else than structs"),
        ("sync", 5.0, r"sync: holds something else than structs"),
        ("camnames", np.array(["Camera1"], object), r"has 3 params, 3 sync and 1 camnames"),
        ("camnames", np.array(["../../x", "b", "c"], object), r"'../../x' cannot be the name of a file"),
        ("sync", np.array([{"data_frame": np.arange(n)} for n in (4, 4, 3)], object), r"another number of moments"),
    ],
)
def test_faults_of_dannce(tmp_path, key, value, message):
    from scipy.io import loadmat, savemat

    write_dannce(tmp_path)
    file = tmp_path / "label3d_dannce.mat"
    content = {name: values for name, values in loadmat(file).items() if not name.startswith("__")}
    savemat(file, content | {key: value})
    with pytest.raises(mm.InputError, match=message):
        mm.import_dataset("dannce", tmp_path, [], tmp_path / "scene")


def test_wrong_arguments(tmp_path, capsys):
    for arguments in (["nothing", "x"], ["panoptic", "x", "1", "2"]):
        assert cli.main(["dataset", *arguments, "-o", str(tmp_path / "scene")]) == USAGE
    assert "mmocap dataset panoptic ROOT [PERSON]" in capsys.readouterr().err
    assert cli.main(["dataset", "panoptic", str(tmp_path / "none"), "-o", str(tmp_path / "scene")]) == BAD_INPUT
    assert cli.main(["dataset", "--help"]) == OK
    printed = capsys.readouterr().out
    assert all(name in printed for name in DATASETS)


def test_the_docs_list_every_data_set():
    page = (Path(__file__).parents[3] / "docs/sequences.md").read_text(encoding="utf-8")
    for name, dataset in DATASETS.items():
        row = next(line for line in page.splitlines() if line.startswith(f"| {dataset.title} |"))
        assert f"`{dataset.usage(name)}`" in row
        assert row.endswith(f"| {dataset.tried_on} |")


def test_a_skew_is_kept_by_formats_that_have_one(tmp_path):
    write_rat7m(tmp_path / "made")
    rig = mm.import_dataset("dannce", tmp_path / "made", ["3500"], tmp_path / "scene").rig
    calibration = tmp_path / "scene/calibration.toml"
    for name in ("some.toml", "intri.yml"):
        mm.convert_cameras(calibration, tmp_path / name)
        written = mm.convert_cameras(tmp_path / name, tmp_path / f"again-{name.replace('intri', 'x')}.toml")
        written = getattr(written, "rig", written)
        np.testing.assert_allclose(written.K, rig.K, atol=1e-9)
    with pytest.raises(mm.InputError, match=r"cameras\.usda: cannot hold the skew"):
        mm.convert_cameras(calibration, tmp_path / "cameras.usda")


def test_a_channel_is_for_videos_of_masks(tmp_path):
    write_3dhp(tmp_path / "made")
    mm.import_dataset("mpi-inf-3dhp", tmp_path / "made", ["S1", "Seq1"], tmp_path / "scene")
    file = tmp_path / "scene/scene.toml"
    text = file.read_text()
    file.write_text(text.replace('"red"', '"pink"', 1))
    with pytest.raises(mm.InputError, match=r"mask_channel"):
        mm.load_scene(file)
    file.write_text("\n".join(line for line in text.splitlines() if not line.startswith("masks =")))
    with pytest.raises(mm.InputError, match=r"mask_channel is for masks that are a video; leave it out"):
        mm.load_scene(file)
