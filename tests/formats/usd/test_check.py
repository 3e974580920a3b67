import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdSkel, Vt
from synthetic import synthetic_result

from mmocap_warp.errors import InputError
from mmocap_warp.formats.usd.animation import export_animation
from mmocap_warp.formats.usd.check import body_faults, faults

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
    "a point that is no number": (put(SKIN, "points", no_number), "points are not finite"),
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
    (tmp_path / "a.usda").write_text("no USD")
    with pytest.raises(InputError, match="not a USD file"):
        faults(tmp_path / "a.usda")
