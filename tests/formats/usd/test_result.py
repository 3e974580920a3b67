import dataclasses
from dataclasses import replace

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel, Vt
from synthetic import synthetic_body, synthetic_result

from mmocap_warp.body.posing import Poser
from mmocap_warp.cameras.rig import project
from mmocap_warp.errors import InputError
from mmocap_warp.formats.usd.usd_body import write_body
from mmocap_warp.formats.usd.usd_check import faults
from mmocap_warp.formats.usd.usd_file import read_stage
from mmocap_warp.formats.usd.usd_result import export_animation, read_result, write_result
from mmocap_warp.result.excerpt import stood_up
from mmocap_warp.result.result import STATUS

SKINNING_M = 1e-5


def told(result):
    """The result with all that a tracker may tell: other statuses a run, the raw track, and how sure it is."""
    rng = np.random.default_rng(2)
    status = np.arange(result.status.size).reshape(result.status.shape).astype(np.int8) % len(STATUS)
    joints = len(result.subject.body.skeleton.joints)
    sigma = rng.random((*result.cost.shape, joints, 3))
    sigma[:, -1] = np.nan  # of a lost frame nothing is known
    return replace(
        result,
        status=status,
        raw_pose=result.pose + rng.normal(0, 0.01, result.pose.shape),
        angle_sigma=rng.random(result.pose.shape),
        joint_sigma=sigma,
        view_shift=rng.random(result.iou.shape),
    )


def assert_same(left, right, where="result"):
    """Equal to the last bit, NaN where NaN."""
    if dataclasses.is_dataclass(left):
        for field in dataclasses.fields(left):
            assert_same(getattr(left, field.name), getattr(right, field.name), f"{where}.{field.name}")
    elif isinstance(left, np.ndarray):
        np.testing.assert_array_equal(right, left, err_msg=where)
        assert left.dtype.kind == right.dtype.kind, where
    elif isinstance(left, dict):
        assert list(left) == list(right), where
        for key in left:
            assert_same(left[key], right[key], f"{where}[{key}]")
    else:
        assert left == right, where


def usd_skinned(path, mesh, time):
    """A mesh's points in the stage's world, skinned by USD."""
    stage = read_stage(path)
    root = next(UsdSkel.Root(prim) for prim in stage.Traverse() if prim.IsA(UsdSkel.Root))
    cache = UsdSkel.Cache()
    cache.Populate(root, Usd.PrimDefaultPredicate)
    prim = root.GetPrim().GetChild(mesh)
    skeleton = cache.GetSkelQuery(UsdSkel.Skeleton(root.GetPrim().GetChild("Skeleton")))
    points = Vt.Vec3fArray(UsdGeom.Mesh(prim).GetPointsAttr().Get())
    assert cache.GetSkinningQuery(prim).ComputeSkinnedPoints(skeleton.ComputeSkinningTransforms(time), points, time)
    to_world = UsdGeom.XformCache(time).GetLocalToWorldTransform(root.GetPrim())
    return np.array([to_world.Transform(Gf.Vec3d(*point.tolist())) for point in np.array(points)])


def expected_vertices(result):
    subject = result.subject
    return Poser(subject.body, subject.root_base).vertices(result.pose[result.best_run])


@pytest.mark.parametrize("suffix", ["usda", "usdc"])
@pytest.mark.parametrize(("runs", "frames"), [(1, 1), (3, 6)])
@pytest.mark.parametrize("tell", [told, lambda result: result])
def test_a_result_reads_back_exactly(tmp_path, suffix, runs, frames, tell):
    result, path = tell(synthetic_result(frames, runs)), tmp_path / f"result.{suffix}"
    write_result(path, result)
    assert_same(result, read_result(path))
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


def test_a_result_with_one_status_a_frame_is_read(tmp_path):
    """As results were written when all runs shared it."""
    result, path = synthetic_result(runs=3), tmp_path / "result.usda"
    write_result(path, result)
    layer = Sdf.Layer.OpenAsAnonymous(str(path))
    tracking = layer.GetPrimAtPath("/World/Tracking")
    tracking.RemoveProperty(tracking.attributes["mmocap:status"])
    Sdf.AttributeSpec(tracking, "mmocap:status", Sdf.ValueTypeNames.String)
    for frame, status in zip(result.frame_numbers, result.status[0], strict=True):
        layer.SetTimeSample("/World/Tracking.mmocap:status", float(frame), STATUS[status])
    layer.Export(str(path))
    assert_same(result, read_result(path))


@pytest.mark.parametrize("up", ["+y", "+z", "-y", "+x"])
def test_a_result_is_sound_usd(tmp_path, up):
    path = tmp_path / "result.usdc"
    write_result(path, told(synthetic_result(up=up)))
    assert faults(path) == []


@pytest.mark.parametrize("up", ["+y", "+z"])
def test_usd_skins_the_result_as_the_project_does(tmp_path, up):
    result, path = synthetic_result(up=up), tmp_path / "result.usdc"
    write_result(path, result)
    expected = expected_vertices(result)
    for i, frame in enumerate(result.frame_numbers):
        assert np.abs(usd_skinned(path, "Skin", float(frame)) - expected[i]).max() < SKINNING_M
        tracking = expected[i][result.subject.body.tracking_vertex]
        assert np.abs(usd_skinned(path, "Tracking", float(frame)) - tracking).max() < SKINNING_M


@pytest.mark.parametrize("suffix", ["usda", "usdc", "usdz"])
def test_an_export_is_sound_and_holds_the_animation_alone(tmp_path, suffix):
    result, path = synthetic_result(up="+z"), tmp_path / f"anim.{suffix}"
    export_animation(result, path)
    assert faults(path) == []
    assert [file.name for file in tmp_path.iterdir()] == [path.name]
    stage = Usd.Stage.Open(str(path))
    kinds = {prim.GetTypeName() for prim in stage.Traverse()}
    assert kinds == {"Xform", "SkelRoot", "Skeleton", "SkelAnimation", "Mesh", "Scope", "Camera"}
    names = [name for prim in stage.Traverse() for name in prim.GetPropertyNames()]
    assert not [name for name in names if name.startswith("mmocap:")]
    assert stage.GetTimeCodesPerSecond() == result.fps
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (10, 15)


@pytest.mark.parametrize("up", ["+x", "-x", "+y", "-y", "+z", "-z"])
@pytest.mark.parametrize("asked", [None, "+y", "+z"])
def test_an_export_stands_upright(tmp_path, up, asked):
    result, path = synthetic_result(up=up), tmp_path / "anim.usdc"
    export_animation(stood_up(result, asked) if asked else result, path)
    axis = asked or (up if up in ("+y", "+z") else "+z")
    assert UsdGeom.GetStageUpAxis(read_stage(path)) == axis[1].upper()
    world = expected_vertices(result)[0] @ result.cameras.up_vector
    exported = usd_skinned(path, "Skin", 10)
    np.testing.assert_allclose(exported[:, "xyz".index(axis[1])], world, rtol=0, atol=SKINNING_M)
    edge = np.linalg.norm(np.diff(expected_vertices(result)[0], axis=0), axis=1)
    np.testing.assert_allclose(np.linalg.norm(np.diff(exported, axis=0), axis=1), edge, rtol=0, atol=SKINNING_M)


@pytest.mark.parametrize("up", ["+y", "+z"])
def test_an_export_keeps_the_world_and_its_cameras(tmp_path, up):
    result, path = synthetic_result(up=up), tmp_path / "anim.usdc"
    export_animation(result, path)
    assert np.abs(usd_skinned(path, "Skin", 10) - expected_vertices(result)[0]).max() < SKINNING_M
    stage = read_stage(path)
    for k, name in enumerate(result.cameras.names):
        camera = UsdGeom.Camera(stage.GetPrimAtPath(f"/World/Cameras/{name}"))
        centre = camera.ComputeLocalToWorldTransform(Usd.TimeCode(10)).ExtractTranslation()
        np.testing.assert_allclose(centre, result.cameras.centres[k], rtol=0, atol=1e-9)


@pytest.mark.parametrize("up", ["+x", "-x", "-y", "-z"])
def test_what_no_stage_can_be_heads_as_it_does_when_it_is_stood_up(tmp_path, up):
    result = synthetic_result(up=up)
    export_animation(result, tmp_path / "own.usdc")
    export_animation(stood_up(result, "+z"), tmp_path / "turned.usdc")
    own, turned = (usd_skinned(tmp_path / f"{name}.usdc", "Skin", 10) for name in ("own", "turned"))
    np.testing.assert_allclose(own, turned, rtol=0, atol=SKINNING_M)


def test_an_export_that_is_turned_keeps_the_axis_that_it_is_turned_about(tmp_path):
    result, path = synthetic_result(up="+z"), tmp_path / "anim.usdc"
    export_animation(stood_up(result, "+y"), path)
    x, y, z = expected_vertices(result)[0].T
    assert np.abs(usd_skinned(path, "Skin", 10) - np.stack([x, z, -y], axis=1)).max() < SKINNING_M


@pytest.mark.parametrize("up", ["+x", "-x", "+y", "-y", "+z", "-z"])
@pytest.mark.parametrize("new", ["+x", "-x", "+y", "-y", "+z", "-z"])
def test_a_result_that_is_stood_up_is_seen_alike(up, new):
    """The cameras see the same, and turning back gives the same."""
    result = synthetic_result(up=up)
    turned = stood_up(result, new)
    joints = result.joints()[0]
    np.testing.assert_allclose(
        turned.joints()[0] @ turned.cameras.up_vector, joints @ result.cameras.up_vector, atol=1e-5
    )
    np.testing.assert_allclose(
        project(turned.cameras, turned.joints()[0, 0]), project(result.cameras, joints[0]), rtol=0, atol=1e-2
    )
    assert np.linalg.det(turned.subject.root_base) == pytest.approx(1)
    np.testing.assert_allclose(stood_up(turned, up).pose, result.pose, rtol=0, atol=1e-12)


def test_extents_hold_the_skin_at_every_frame(tmp_path):
    result, path = synthetic_result(), tmp_path / "anim.usdc"
    export_animation(result, path)
    stage = read_stage(path)
    root = next(UsdSkel.Root(prim) for prim in stage.Traverse() if prim.IsA(UsdSkel.Root))
    for i, points in enumerate(expected_vertices(result)):
        low, high = np.array(root.GetExtentAttr().Get(float(result.frame_numbers[i])))
        np.testing.assert_array_equal(low, points.min(axis=0))
        np.testing.assert_array_equal(high, points.max(axis=0))


def test_rotations_never_flip_sign(tmp_path):
    result, path = synthetic_result(frames=40, runs=1), tmp_path / "anim.usda"
    turning = result.pose.copy()
    turning[0, :, 4] = np.linspace(0, 4 * np.pi, 40)  # the root turns round and round
    export_animation(replace(result, pose=turning), path)
    stage = read_stage(path)
    prim = next(prim for prim in stage.Traverse() if prim.IsA(UsdSkel.Animation))
    samples = [np.array(UsdSkel.Animation(prim).GetRotationsAttr().Get(float(f))) for f in result.frame_numbers]
    assert ((np.array(samples[1:]) * np.array(samples[:-1])).sum(axis=2) > 0).all()


def test_a_rewritten_result_is_read_anew(tmp_path):
    path = tmp_path / "result.usdc"
    write_result(path, synthetic_result())
    read_result(path)
    write_result(path, replace(synthetic_result(), seconds=9.0))
    assert read_result(path).seconds == 9.0


def drop(path, name):
    return lambda layer: layer.GetPrimAtPath(path).RemoveProperty(layer.GetAttributeAtPath(f"{path}.{name}"))


def put(path, name, value):
    return lambda layer: setattr(layer.GetAttributeAtPath(f"{path}.{name}"), "default", value)


def sample(name, value):
    return lambda layer: layer.SetTimeSample(Sdf.Path(f"/World/Tracking.{name}"), 11.0, value)


@pytest.mark.parametrize(
    ("spoil", "problem"),
    [
        (drop("/World/Tracking", "mmocap:resultVersion"), "holds no tracking result"),
        (put("/World/Tracking", "mmocap:resultVersion", 1), "version 1, this program reads 2"),
        (put("/World/Tracking", "mmocap:runs", 3), "pose holds 102 values at frame 10, not"),
        (put("/World/Tracking", "mmocap:config", "{"), "config is not a JSON object"),
        (put("/World/Tracking", "mmocap:frames", [12, 11, 10]), "frame_numbers that ascend"),
        (put("/World/Tracking", "mmocap:frames", [10, 99]), "has no value at frame 99"),
        (sample("mmocap:status", Vt.StringArray(["lost", "asleep"])), "not .'asleep'"),
        (sample("mmocap:status", Vt.StringArray(["lost"])), "status names .1. runs in a frame, not 2"),
        (sample("mmocap:jointSigma", [0.5]), "jointSigma holds 1 values at frame 11"),
        (sample("mmocap:rawPose", [0.5]), "rawPose holds 1 values at frame 11"),
        (sample("mmocap:pose", [float("nan")] * 102), "pose is not finite"),
        (sample("mmocap:iou", [0.5]), "iou holds 1 values at frame 11"),
        (drop("/World/Cameras/cam02", "mmocap:intrinsics"), "/World/Cameras/cam02: attribute mmocap:intrinsics"),
        (drop("/World/Boxes", "mmocap:rootBase"), "/World/Boxes: attribute mmocap:rootBase"),
    ],
)
def test_a_spoilt_result_is_one_clear_line(tmp_path, spoil, problem):
    path = tmp_path / "result.usda"
    write_result(path, told(synthetic_result()))
    layer = Sdf.Layer.OpenAsAnonymous(str(path))
    spoil(layer)
    layer.Export(str(path))
    with pytest.raises(InputError, match=problem) as caught:
        read_result(path)
    assert caught.value.source == str(path)
    assert "\n" not in str(caught.value)


def test_what_is_no_result_is_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_result(tmp_path / "result.usdc")
    (tmp_path / "text.usdc").write_text("no USD")
    with pytest.raises(InputError, match="not a USD file"):
        read_result(tmp_path / "text.usdc")
    write_result(tmp_path / "cut.usdc", synthetic_result())
    (tmp_path / "cut.usdc").write_bytes((tmp_path / "cut.usdc").read_bytes()[:-200])
    with pytest.raises(InputError, match="not a USD file"):
        read_result(tmp_path / "cut.usdc")
    write_body(tmp_path / "body.usdc", synthetic_body())
    with pytest.raises(InputError, match="holds no tracking result"):
        read_result(tmp_path / "body.usdc")


@pytest.mark.parametrize("write", [lambda path: write_result(path, synthetic_result()), None])
def test_a_place_that_cannot_be_written_is_refused(tmp_path, write):
    write = write or (lambda path: export_animation(synthetic_result(), path))
    with pytest.raises(InputError, match="end it in"):
        write(tmp_path / "result.fbx")
    with pytest.raises(InputError, match="folder does not exist"):
        write(tmp_path / "nowhere" / "result.usdc")


def test_a_package_needs_a_folder(tmp_path):
    with pytest.raises(InputError, match="folder does not exist"):
        export_animation(synthetic_result(), tmp_path / "nowhere" / "anim.usdz")


def test_shapes_that_disagree_are_refused():
    result = synthetic_result()
    with pytest.raises(ValueError, match="iou must be"):
        replace(result, iou=result.iou[:, :, :2])
    with pytest.raises(ValueError, match=r"status must be \(2, 6\)"):
        replace(result, status=result.status[0])
    for name in ("raw_pose", "angle_sigma", "joint_sigma"):
        with pytest.raises(ValueError, match=f"{name} must be"):
            replace(result, **{name: result.pose[:, 1:]})
    with pytest.raises(ValueError, match="ascend"):
        replace(result, frame_numbers=result.frame_numbers[::-1])
