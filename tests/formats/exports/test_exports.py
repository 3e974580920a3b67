"""Every format of the table is written and read back, by readers that do not share the writers' code."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from glb_file import Glb
from other_bodies import burdened
from pxr import Usd, UsdGeom, UsdSkel
from synthetic import synthetic_result

from mmocap_warp.biomechanics.measure_all import measure
from mmocap_warp.body.joint_sets import joint_set
from mmocap_warp.body.model import Subject
from mmocap_warp.body.posing import Poser
from mmocap_warp.errors import InputError
from mmocap_warp.formats.exports.glb import write_glb
from mmocap_warp.formats.motion.captured_points import read_c3d, read_trc
from mmocap_warp.formats.motion.motion_clip import read_bvh
from mmocap_warp.formats.table import EXPORTS, POINT_CACHES, export, format_of
from mmocap_warp.formats.usd.usd_check import faults
from mmocap_warp.result.excerpt import stood_up
from mmocap_warp.result.result import Result
from mmocap_warp.rigging.shipped import load_body

SAME = 2e-6  # [m]: text of six decimals, and single precision, of places some metres from the origin
SAME_TIME = 1e-6  # [s]

Motion = tuple[np.ndarray, np.ndarray]
"""Times (frame,) [s], and places of the joints in the body's order (frame, joint, 3) [m]."""


def usd_motion(path: Path, result: Result) -> Motion:
    stage = Usd.Stage.Open(str(path))
    root = next(UsdSkel.Root(prim) for prim in stage.Traverse() if prim.IsA(UsdSkel.Root))
    cache = UsdSkel.Cache()
    cache.Populate(root, Usd.PrimDefaultPredicate)
    skeleton = next(UsdSkel.Skeleton(prim) for prim in stage.Traverse() if prim.IsA(UsdSkel.Skeleton))
    query = cache.GetSkelQuery(skeleton)
    codes = UsdSkel.Animation(query.GetAnimQuery().GetPrim()).GetRotationsAttr().GetTimeSamples()
    places = []
    for code in codes:
        times = UsdGeom.XformCache(code)
        places.append([m.ExtractTranslation() for m in query.ComputeJointWorldTransforms(times)])
    return np.array(codes) / stage.GetTimeCodesPerSecond(), np.array(places)


def glb_motion(path: Path, result: Result) -> Motion:
    file = Glb(path)
    start = file.json["asset"]["extras"]["first_frame"] / result.fps
    return file.time() + start, file.joint_worlds()[..., :3, 3]


def bvh_motion(path: Path, result: Result) -> Motion:
    clip = read_bvh(path)
    order = [clip.joint_names.index(name) for name in result.subject.body.skeleton.joints]
    start = result.frame_numbers[0] / result.fps
    return start + np.arange(len(clip.place)) / clip.fps, clip.place[:, order] / 100


def track_motion(read: Callable) -> Callable[[Path, Result], Motion]:
    def motion(path: Path, result: Result) -> Motion:
        tracks = read(path)
        order = [tracks.names.index(name) for name in result.subject.body.skeleton.joints]
        return (tracks.frame_numbers - 1) / tracks.rate, tracks.positions[:, order]

    return motion


def mot_motion(path: Path, result: Result) -> Motion:
    lines = path.read_text().splitlines()
    end = lines.index("endheader")
    assert f"nRows={len(lines) - end - 2}" in lines[:end]
    assert "inDegrees=yes" in lines[:end]
    names = lines[end + 1].split("\t")
    assert f"nColumns={len(names)}" in lines[:end]
    values = np.array([[float(cell) for cell in line.split("\t")] for line in lines[end + 2 :]])
    assert [name.replace(".", "_") for name in result.subject.body.skeleton.coordinate_names] == names[1:]
    poser = Poser(result.subject.body, np.eye(3))
    pose = np.where(result.subject.body.skeleton.is_length, values[:, 1:], np.radians(values[:, 1:]))
    return values[:, 0], poser.joint_transforms(pose)[..., :3, 3]


def columns_motion(columns: dict[str, np.ndarray], result: Result) -> Motion:
    joints = result.subject.body.skeleton.joints
    places = [np.stack([columns[f"{name}.{axis}_m"] for axis in "xyz"], axis=-1) for name in joints]
    return columns["time_s"], np.stack(places, axis=1)


def csv_motion(path: Path, result: Result) -> Motion:
    table = np.atleast_1d(np.genfromtxt(path, delimiter=",", names=True, deletechars="", dtype=None, encoding="utf-8"))
    return columns_motion({name: table[name] for name in table.dtype.names}, result)


def parquet_motion(path: Path, result: Result) -> Motion:
    parquet = pytest.importorskip("pyarrow.parquet")
    return columns_motion(
        {name: np.array(column) for name, column in parquet.read_table(path).to_pydict().items()}, result
    )


def npz_motion(path: Path, result: Result) -> Motion:
    with np.load(path, allow_pickle=False) as arrays:
        assert tuple(arrays["joint_names"]) == result.subject.body.skeleton.joints
        np.testing.assert_array_equal(arrays["world"][..., :3, 3], arrays["joints"])
        return arrays["time"], arrays["joints"]


READERS: dict[str, Callable[[Path, Result], Motion]] = {
    ".usda": usd_motion,
    ".usdc": usd_motion,
    ".usdz": usd_motion,
    ".glb": glb_motion,
    ".bvh": bvh_motion,
    ".trc": track_motion(read_trc),
    ".mot": mot_motion,
    ".c3d": track_motion(read_c3d),
    ".csv": csv_motion,
    ".parquet": parquet_motion,
    ".npz": npz_motion,
}


def written(folder: Path, result: Result, suffix: str) -> Path:
    if suffix == ".parquet":
        pytest.importorskip("pyarrow")
    path = folder / f"walk{suffix}"
    export(result, path)
    assert [file.name for file in folder.iterdir()] == [path.name]
    return path


@pytest.mark.parametrize("suffix", READERS)
@pytest.mark.parametrize("up", ["+y", "+z", "-x"])
def test_the_joints_are_read_back(tmp_path: Path, suffix: str, up: str) -> None:
    result = synthetic_result(frames=7, up=up)
    time, joints = READERS[suffix](written(tmp_path, result, suffix), result)
    np.testing.assert_allclose(time, result.frame_numbers / result.fps, rtol=0, atol=SAME_TIME)
    if suffix.startswith(".usd") and up == "-x":  # a world that no stage can say is turned upright
        joints, expected = np.diff(joints, axis=1), np.diff(result.joints()[result.best_run], axis=1)
        joints, expected = np.linalg.norm(joints, axis=2), np.linalg.norm(expected, axis=2)
    else:
        expected = stood_up(result, format_of(EXPORTS, tmp_path / f"a{suffix}").up or up).joints()[result.best_run]
    np.testing.assert_allclose(joints, expected, rtol=0, atol=SAME)


@pytest.mark.parametrize("suffix", READERS)
def test_a_thing_that_slides_is_read_back(tmp_path: Path, suffix: str) -> None:
    plain, body = synthetic_result(frames=7, up="+y"), burdened()
    pose = np.random.default_rng(1).normal(0, 0.2, (2, 7, body.skeleton.coordinates))
    result = replace(plain, subject=Subject(body, np.eye(3), pose[0, 0], {}), pose=pose)
    result = replace(result, raw_pose=None, angle_sigma=None, joint_sigma=None)
    time, places = READERS[suffix](written(tmp_path, result, suffix), result)
    np.testing.assert_allclose(time, result.frame_numbers / result.fps, atol=SAME_TIME)
    np.testing.assert_allclose(places, result.joints()[result.best_run], atol=SAME)


@pytest.mark.parametrize("suffix", READERS)
def test_a_turn_through_every_pole_is_read_back(tmp_path: Path, suffix: str) -> None:
    """Angles about Y of 90 degrees, exactly and nearly, where the other two are one."""
    result = synthetic_result(frames=17, runs=1)
    pose = result.pose.copy()
    pose[0, :, 4] = np.radians(np.linspace(0, 360, 17))  # the root turns once: 90 degrees at frame 4
    pose[0, :, result.subject.body.skeleton.angles("LShoulder")] = np.radians([10.0, 90.0, 35.0])
    pose[0, :, result.subject.body.skeleton.angles("RHip")] = np.radians([10.0, -90.0, 35.0])
    result = replace(result, pose=pose)
    _, joints = READERS[suffix](written(tmp_path, result, suffix), result)
    np.testing.assert_allclose(joints, result.joints()[0], rtol=0, atol=SAME)


@pytest.mark.parametrize("suffix", READERS)
def test_a_single_frame_and_one_in_five(tmp_path: Path, suffix: str) -> None:
    result = synthetic_result(frames=16)
    for positions in ([3], range(0, 16, 5)):
        part = result.at(positions)
        folder = tmp_path / str(len(part.frame_numbers))
        folder.mkdir()
        time, joints = READERS[suffix](written(folder, part, suffix), part)
        np.testing.assert_allclose(joints, part.joints()[part.best_run], rtol=0, atol=SAME)
        np.testing.assert_allclose(time[-1] - time[0], np.ptp(part.frame_numbers) / part.fps, rtol=0, atol=SAME_TIME)


@pytest.mark.parametrize("suffix", [".glb", ".npz", ".usdc", ".usda", ".usdz"])
def test_the_skin_is_read_back(tmp_path: Path, suffix: str) -> None:
    result = synthetic_result()
    path = tmp_path / f"walk{suffix}"
    if suffix == ".npz":
        export(result, path)
        with np.load(path) as a:
            matrix = a["world"] @ np.linalg.inv(a["bind"])
            rest = np.concatenate([a["rest"], np.ones((len(a["rest"]), 1))], axis=1)
            blended = np.einsum("vk,fvkij,vj->fvi", a["skin_weight"], matrix[:, a["skin_joint"]], rest)
            skin, face = blended[..., :3], a["face"]
            np.testing.assert_allclose(a["markers"], skin[:, result.subject.body.marker_vertex], rtol=0, atol=SAME)
    elif suffix == ".glb":
        export(result, path)
        skin, face = Glb(path).skin(), result.subject.body.skin.face
    else:
        export(result, path, POINT_CACHES)
        assert faults(path) == []
        stage = Usd.Stage.Open(str(path))
        (mesh,) = (UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh))
        assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (10, 15)
        assert stage.GetTimeCodesPerSecond() == result.fps
        skin = np.array([mesh.GetPointsAttr().Get(number) for number in result.frame_numbers.tolist()])
        face = np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 4)
        low, high = np.array(mesh.GetExtentAttr().Get(12.0))
        assert (low == skin[2].min(axis=0)).all()
        assert (high == skin[2].max(axis=0)).all()
    np.testing.assert_allclose(skin, result.vertices(), rtol=0, atol=SAME)
    np.testing.assert_array_equal(face, result.subject.body.skin.face)


def test_a_glb_is_sound(tmp_path: Path) -> None:
    file = Glb(written(tmp_path, synthetic_result(frames=1, runs=1), ".glb"))
    assert file.faults() == []
    (tmp_path / "walk.glb").unlink()
    result = synthetic_result(frames=40, runs=1)
    turning = result.pose.copy()
    turning[0, :, 4] = np.linspace(0, 4 * np.pi, 40)
    file = Glb(written(tmp_path, replace(result, pose=turning), ".glb"))
    assert file.faults() == []
    assert [node["name"] for node in file.json["nodes"]] == [*result.subject.body.skeleton.joints, "Boxes"]
    assert "Made up for tests." in file.json["asset"]["copyright"]
    for sampler in file.json["animations"][0]["samplers"][1:]:
        quaternion = file.array(sampler["output"])
        assert (quaternion[1:] * quaternion[:-1]).sum(axis=1).min() > 0, "a program would interpolate the long way"


def test_the_root_of_a_bvh_has_its_place_in_the_channels_alone(tmp_path: Path) -> None:
    lines = written(tmp_path, synthetic_result(), ".bvh").read_text().splitlines()
    assert lines[1].startswith("ROOT")
    assert [float(word) for word in lines[3].split()[1:]] == [0.0, 0.0, 0.0]


def test_angles_of_a_bvh_never_jump(tmp_path: Path) -> None:
    result = synthetic_result(frames=80, runs=1)
    turning = result.pose.copy()
    turning[0, :, 4] = np.linspace(0, 7 * np.pi, 80)
    path = written(tmp_path, replace(result, pose=turning), ".bvh")
    rows = path.read_text().splitlines()
    values = np.array([row.split() for row in rows[-80:]], float)[:, 3:]
    assert np.abs(np.diff(values, axis=0)).max() < 100  # degrees; the root passes a pole at most half a turn away


def test_a_marker_named_like_a_joint_gets_another_name(tmp_path: Path) -> None:
    result = synthetic_result()
    body = replace(result.subject.body, marker_names=("Neck", *result.subject.body.marker_names[1:]))
    path = written(tmp_path, replace(result, subject=replace(result.subject, body=body)), ".trc")
    assert len(set(read_trc(path).names)) == len(body.skeleton.joints) + len(body.marker_names)
    assert "Neck_marker" in read_trc(path).names


def test_a_table_holds_any_name_or_says_that_it_cannot(tmp_path: Path) -> None:
    result = synthetic_result()
    names = ('a,"b"', "c\td", *result.subject.body.marker_names[2:])
    named = replace(result, subject=replace(result.subject, body=replace(result.subject.body, marker_names=names)))
    with written(tmp_path, named, ".csv").open(newline="") as file:
        head, *rows = csv.reader(file)
    assert {len(row) for row in rows} == {len(head)}
    assert 'a,"b".x_m' in head
    with pytest.raises(InputError, match=r"cannot hold the name 'c\\td'"):
        export(named, tmp_path / "walk.trc")


def test_a_c3d_counts_to_65535(tmp_path: Path) -> None:
    pytest.importorskip("ezc3d")
    result = synthetic_result()
    late = replace(result, frame_numbers=result.frame_numbers - result.frame_numbers[0] + 65_534)
    assert read_c3d(written(tmp_path, late, ".c3d")).frame_numbers[0] == 65_535
    with pytest.raises(InputError, match="counts to 65,535 frames"):
        export(replace(late, frame_numbers=late.frame_numbers + 1), tmp_path / "later.c3d")


def test_a_c3d_says_which_way_is_up(tmp_path: Path) -> None:
    import ezc3d

    file = ezc3d.c3d(str(written(tmp_path, synthetic_result(up="+z"), ".c3d")))
    about = file["parameters"]["POINT"]
    assert (about["X_SCREEN"]["value"], about["Y_SCREEN"]["value"]) == (["+X"], ["+Z"])
    assert file["data"]["analogs"].size == 0


@pytest.mark.parametrize(("package", "suffix"), [("ezc3d", ".c3d"), ("pyarrow", ".parquet")])
def test_a_package_that_is_missing_is_named(tmp_path: Path, monkeypatch, package: str, suffix: str) -> None:
    monkeypatch.setitem(__import__("sys").modules, package, None)
    with pytest.raises(InputError, match=rf"needs the package {package} .*mmocap-warp\[formats\]"):
        export(synthetic_result(), tmp_path / f"a{suffix}")
    assert not any(tmp_path.iterdir())


def test_a_trc_says_where_the_recording_begins(tmp_path: Path) -> None:
    """The recording's frame 0 is frame 1, and the result begins with its frame 10."""
    _, names, values = [
        line.split("\t") for line in written(tmp_path, synthetic_result(), ".trc").read_text().split("\n")[:3]
    ]
    about = dict(zip(names, values, strict=True))
    assert (about["OrigDataStartFrame"], about["OrigNumFrames"], about["NumFrames"]) == ("11", "6", "6")
    assert about["OrigDataRate"] == about["DataRate"] == "59.940000"


def test_the_root_of_a_mot_counts_from_its_own_bind_frame(tmp_path: Path) -> None:
    result = synthetic_result(frames=7, up="+y")
    frame = result.subject.body.skeleton.frame.copy()
    frame[0] = [[0.6, 0.0, 0.8], [0.0, 1.0, 0.0], [-0.8, 0.0, 0.6]]
    body = replace(result.subject.body, skeleton=replace(result.subject.body.skeleton, frame=frame))
    result = replace(result, subject=replace(result.subject, body=body))
    _, joints = mot_motion(written(tmp_path, result, ".mot"), result)
    np.testing.assert_allclose(joints, result.joints()[result.best_run], rtol=0, atol=SAME)


def test_a_mot_by_a_joint_set_has_the_angles_that_are_measured_by_its_centres(tmp_path: Path) -> None:
    result = synthetic_result(frames=3)
    man = load_body("adult_man")
    result = replace(result, subject=replace(result.subject, body=man))
    isb = joint_set("isb", man)
    export(result, tmp_path / "walk.mot", joint_set=isb)
    names, *rows = (line.split("\t") for line in (tmp_path / "walk.mot").read_text().splitlines()[6:])
    found = dict(zip(names, np.array(rows, float).T, strict=True))
    measured, own = (measure(result, result.best_run, joint_set=by).shown.angles for by in (isb, None))
    expected = {f"{joint}_{name}": each for joint, angles in measured.items() for name, each in angles.items()}
    assert names == ["time", *expected]
    for name, angle in expected.items():
        np.testing.assert_allclose(found[name], angle, rtol=0, atol=1e-6)
    assert np.abs(found["LKnee_flexion"] - own["LKnee"]["flexion"]).min() > 1


def test_people_in_a_glb_keep_their_times(tmp_path: Path) -> None:
    result = synthetic_result(frames=6, runs=1)
    write_glb({"late": result.at(range(3, 6)), "whole": result}, tmp_path / "two.glb")
    file = Glb(tmp_path / "two.glb")
    inputs = [sampler["input"] for each in file.json["animations"] for sampler in each["samplers"]]
    assert {round(float(file.array(each)[0, 0]), 6) for each in inputs} == {0.0, round(3 / result.fps, 6)}
    assert file.json["asset"]["extras"]["first_frame"] == 10
