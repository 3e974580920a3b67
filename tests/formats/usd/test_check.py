import shutil

import numpy as np
import pytest
from pxr import Gf, Tf, Usd, UsdGeom, UsdSkel, Vt
from synthetic import synthetic_body, synthetic_result, synthetic_subject

from mmocap_warp.errors import InputError
from mmocap_warp.formats.usd.usd_body import write_body, write_subject
from mmocap_warp.formats.usd.usd_check import body_faults, faults
from mmocap_warp.formats.usd.usd_result import export_animation, write_result

SKIN, SKELETON, ANIMATION = "/World/Boxes/Skin", "/World/Boxes/Skeleton", "/World/Boxes/Animation"


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    path = tmp_path_factory.mktemp("export") / "anim.usda"
    export_animation(synthetic_result(frames=3, runs=1), path)
    return path


def put(path, name, change):
    def spoil(stage):
        attribute = stage.GetPrimAtPath(path).GetAttribute(name)
        attribute.Set(change(attribute.Get()))

    return spoil


def put_sample(name, change):
    def spoil(stage):
        attribute = stage.GetPrimAtPath(ANIMATION).GetAttribute(name)
        attribute.Set(change(attribute.Get(11.0)), 11.0)

    return spoil


def clear(name):
    return lambda stage: stage.GetPrimAtPath(ANIMATION).RemoveProperty(name)


def unbind(stage):
    stage.GetPrimAtPath(SKIN).GetRelationship("skel:skeleton").SetTargets([])


def orphan(joints):
    return [joint.replace("LHip/LKnee", "LKnee/LHip") for joint in joints]


def halved(weights):
    return Vt.FloatArray.FromNumpy(np.array(weights) / 2)


def nothing(values):
    return Vt.Vec3hArray([Gf.Vec3h(0, 1, 1)] * len(values))


def mirrored(values):
    return Vt.Vec3hArray([Gf.Vec3h(1, 1, -1)] * len(values))


def no_scale(values):
    return Vt.Vec3hArray([Gf.Vec3h(float("nan"), 1, 1)] * len(values))


def flipped(rotations):
    return Vt.QuatfArray([-q for q in rotations])


def stretched(places):
    return Vt.Vec3fArray.FromNumpy(np.array(places) * np.float32(1.1))


def flat(matrices):
    return Vt.Matrix4dArray([Gf.Matrix4d().SetScale(Gf.Vec3d(1, 1, 0))] * len(matrices))


def fewer_points_later(stage):
    points = stage.GetPrimAtPath(SKIN).GetAttribute("points")
    whole = points.Get()
    points.Set(whole, 10.0)
    points.Set(whole[:-1], 11.0)


def late_sample(stage):
    translations = stage.GetPrimAtPath(ANIMATION).GetAttribute("translations")
    translations.Set(translations.Get(11.0), 99.0)


def other_joints(stage):
    UsdSkel.BindingAPI(stage.GetPrimAtPath(SKIN)).CreateJointsAttr(["Root", "Tail"])


def lost_camera(stage):
    camera = UsdGeom.Xformable(stage.GetPrimAtPath("/World/Cameras/cam01"))
    camera.ClearXformOpOrder()
    camera.AddTranslateOp().Set(Gf.Vec3d(0, float("nan"), 0))


def no_number(points):
    return Vt.Vec3fArray.FromNumpy(np.full_like(np.array(points), np.nan))


SPOILT = {
    "a bind transform too few": (put(SKELETON, "bindTransforms", lambda m: m[:-1]), "15 entries for 16 joints"),
    "a rest transform too few": (put(SKELETON, "restTransforms", lambda m: m[:-1]), "15 entries for 16 joints"),
    "an orphan joint": (put(SKELETON, "joints", orphan), "has no parent before it"),
    "a joint twice": (put(SKELETON, "joints", lambda j: [*list(j)[:-1], j[0]]), "names a joint twice"),
    "no joints": (put(SKELETON, "joints", lambda _: []), "has no joints"),
    "an unknown joint moved": (put(ANIMATION, "joints", lambda j: [*list(j)[:-1], "Tail"]), "lacks: ['Tail']"),
    "no scales": (clear("scales"), "has no scales, so it shows the rest pose"),
    "no rotations": (clear("rotations"), "has no rotations"),
    "a translation too few": (put_sample("translations", lambda t: t[:-1]), "15 entries for 16 joints"),
    "a long quaternion": (
        put_sample("rotations", lambda q: Vt.QuatfArray([Gf.Quatf(2.0)] * len(q))),
        "not of unit length",
    ),
    "a translation that is no number": (put_sample("translations", no_number), "is not finite"),
    "weights too few": (put(SKIN, "primvars:skel:jointWeights", lambda w: w[:-4]), "joint indices and"),
    "weights that sum to a half": (put(SKIN, "primvars:skel:jointWeights", halved), "do not sum to one"),
    "a joint out of range": (put(SKIN, "primvars:skel:jointIndices", lambda i: [99] * len(i)), "is not below 16"),
    "a point out of range": (put(SKIN, "faceVertexIndices", lambda i: [9999] * len(i)), SKIN),
    "a point that is no number": (put(SKIN, "points", no_number), "points is not finite"),
    "a scale of nothing": (put_sample("scales", nothing), "scales at 11: a scale is not positive"),
    "a mirroring scale": (put_sample("scales", mirrored), "scales at 11: a scale is not positive"),
    "a scale that is no number": (put_sample("scales", no_scale), "scales at 11 is not finite"),
    "a quaternion of the other sign": (put_sample("rotations", flipped), "is interpolated the long way"),
    "longer bones": (put_sample("translations", stretched), "in the rest pose"),
    "a bind transform that flattens": (put(SKELETON, "bindTransforms", flat), "has a matrix that flattens"),
    "joint names too few": (put(SKELETON, "jointNames", lambda names: names[:-1]), "15 entries for 16 joints"),
    "points that get fewer": (fewer_points_later, "339 to 340 entries over time"),
    "a frame that is not played": (late_sample, "translations has samples at 10 to 99, the stage plays 10 to 12"),
    "a skin of another skeleton": (other_joints, "follows joints that its skeleton lacks: ['Tail']"),
    "a camera that is nowhere": (lost_camera, "xformOp:translate is not finite"),
    "no skeleton bound": (unbind, "is bound to no skeleton"),
}


@pytest.mark.parametrize(("spoil", "fault"), SPOILT.values(), ids=SPOILT.keys())
def test_a_spoilt_body_is_found_out(sound, spoil, fault):
    stage = Usd.Stage.Open(Usd.Stage.Open(str(sound)).Flatten())
    assert body_faults(stage) == []
    spoil(stage)
    assert any(fault in line for line in body_faults(stage)), body_faults(stage)


def test_usds_own_validators_run_too(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    mesh = UsdGeom.Mesh.Define(stage, "/Mesh")
    UsdSkel.BindingAPI(mesh).CreateSkeletonRel()  # without applying the schema
    stage.Save()
    assert any("upAxis" in fault for fault in faults(tmp_path / "a.usda"))


def test_what_is_no_usd_is_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        faults(tmp_path / "a.usda")
    with pytest.raises(InputError, match="is a folder"):
        faults(tmp_path)
    (tmp_path / "a.usda").write_text("no USD")
    with pytest.raises(InputError, match="not a USD file"):
        faults(tmp_path / "a.usda")


def test_scales_that_never_change_need_no_times(sound):
    stage = Usd.Stage.Open(Usd.Stage.Open(str(sound)).Flatten())
    scales = stage.GetPrimAtPath(ANIMATION).GetAttribute("scales")
    value = scales.Get(10.0)
    scales.Clear()
    scales.Set(value)
    assert body_faults(stage) == []


def test_files_that_lie_elsewhere_are_named(sound, tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    body = UsdGeom.Xform.Define(stage, "/Body")
    stage.SetDefaultPrim(body.GetPrim())
    beside = shutil.copy(sound, tmp_path / sound.name)
    body.GetPrim().GetReferences().AddReference(str(beside))
    stage.SetTimeCodesPerSecond(59.94)
    stage.SetStartTimeCode(10)
    stage.SetEndTimeCode(12)
    stage.Save()
    assert faults(tmp_path / "a.usda") == [f"needs {beside}, which is not in it"]


def test_own_data_that_cannot_be_read_is_told(tmp_path):
    path = tmp_path / "result.usda"
    write_result(path, synthetic_result())
    assert faults(path) == []
    path.write_text(path.read_text().replace("mmocap:runs = 2", "mmocap:runs = 3"))
    assert len(faults(path)) == 1
    assert "mmocap:pose" in faults(path)[0]
    write_subject(tmp_path / "subject.usda", synthetic_subject())
    assert faults(tmp_path / "subject.usda") == []
    write_body(tmp_path / "body.usda", synthetic_body())
    assert faults(tmp_path / "body.usda") == []


def test_damage_that_shows_when_values_are_read_is_told(tmp_path, monkeypatch):
    write_body(tmp_path / "b.usdc", synthetic_body())

    def damaged(stage):
        Tf.RaiseRuntimeError("Corrupt path index in crate file")

    monkeypatch.setattr("mmocap_warp.formats.usd.usd_check.body_faults", damaged)
    with pytest.raises(InputError, match="is not a USD file that can be read"):
        faults(tmp_path / "b.usdc")


@pytest.mark.parametrize("name", ["uniform token[] joints", "int[] primvars:skel:jointIndices"])
def test_values_of_types_that_usd_does_not_know_are_told(tmp_path, name):
    """In a body's skin and skeleton, which are read together."""
    path = tmp_path / "walk.usda"
    write_result(path, synthetic_result())
    text = path.read_text()
    assert f"{name} = " in text
    path.write_text(text.replace(f"{name} = ", f"{name.replace(name.split('[')[0].split()[-1], 'zoo')} = "))
    found = faults(path)
    assert sum("has a value of a type that USD does not know" in fault for fault in found) == text.count(f"{name} = ")
