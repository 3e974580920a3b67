"""Bodies and subjects as USD: nothing is lost, USD agrees with us, and a wrong file is refused in one line."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from person_skeleton import JOINTS
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel, UsdValidation, Vt
from reference import joint_transforms, skin

from mmocap_warp.body.model import BodyModel, BodyMotion, SkinMesh, Subject
from mmocap_warp.body.skeleton import Skeleton
from mmocap_warp.errors import InputError
from mmocap_warp.formats.usd.usd_body import read_body, read_subject, write_body, write_subject
from mmocap_warp.scenes import ROOT

SHIPPED = sorted((Path(ROOT) / "bodies").glob("*.usdc"))
USD_SKINNING_TOLERANCE = 1e-6  # [m], USD skins in float32
Z_UP_FACING_X = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])


@pytest.fixture(scope="module")
def body() -> BodyModel:
    return read_body(SHIPPED[0])


@pytest.fixture(scope="module")
def subject(body: BodyModel) -> Subject:
    pose = np.random.default_rng(7).uniform(-0.5, 0.5, 51)
    pose[:3] = 1.0, 2.0, 0.95
    provenance = {"command": "mmocap fit", "cost": 0.125, "seed": 3}
    fitted = body.shaped({"height_decr": 0.2, "belly_incr": 0.5}, scale=1.01)
    return Subject(fitted, Z_UP_FACING_X, pose, provenance)


def assert_same(a: object, b: object) -> None:
    """Equal field by field, to the last bit and type."""
    for field in fields(a):
        x, y = getattr(a, field.name), getattr(b, field.name)
        if isinstance(x, np.ndarray):
            assert x.dtype == y.dtype, field.name
            np.testing.assert_array_equal(x, y, err_msg=field.name)
        elif isinstance(x, SkinMesh | BodyModel | Skeleton):
            assert_same(x, y)
        elif field.name == "models":
            assert list(x) == list(y)
            assert all(np.array_equal(x[dof], y[dof]) for dof in x)
        else:
            assert x == y, field.name


def validation_errors(path: Path) -> list[str]:
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    errors = UsdValidation.ValidationContext(validators).Validate(Usd.Stage.Open(str(path)))
    return [f"{error.GetName()}: {error.GetMessage()}" for error in errors]


@pytest.mark.parametrize("suffix", [".usdc", ".usda", ".usd"])
def test_body_round_trip(tmp_path: Path, body: BodyModel, suffix: str) -> None:
    path = tmp_path / f"body{suffix}"
    write_body(path, body)
    assert_same(read_body(path), body)
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


def test_body_without_shapes_and_markers(tmp_path: Path, body: BodyModel) -> None:
    bare = replace(
        body,
        shape_names=(),
        shape_vertex=body.shape_vertex[:0],
        shape_joint=body.shape_joint[:0],
        marker_names=(),
        marker_vertex=body.marker_vertex[:0],
    )
    write_body(tmp_path / "body.usdc", bare)
    assert_same(read_body(tmp_path / "body.usdc"), bare)


@pytest.mark.parametrize(("lengths", "counts"), [([200, 5], [16, 5]), ([50] * 40, [1] * 40)], ids=["two", "many"])
def test_some_poses_of_its_motions_come_with_a_body(
    tmp_path: Path, body: BodyModel, lengths: list[int], counts: list[int]
) -> None:
    motions = {
        f"m{i}": BodyMotion(30.0, i + np.linspace(0, 0.9, n)[:, None] * np.ones(51)) for i, n in enumerate(lengths)
    }
    write_body(tmp_path / "body.usdc", body, motions)
    poses = read_body(tmp_path / "body.usdc").motion_poses
    assert poses is not None
    assert np.unique(poses[:, 0].astype(int), return_counts=True)[1].tolist() == counts
    assert (np.diff(poses[:, 0]) > 0).all()
    assert body.motion_poses is None


def test_subject_round_trip(tmp_path: Path, subject: Subject) -> None:
    path = tmp_path / "subject.usdc"
    write_subject(path, subject)
    assert_same(read_subject(path), subject)
    assert_same(read_body(path), subject.body)


def test_writing_again_gives_the_same_bytes_and_is_read_anew(tmp_path: Path, body: BodyModel) -> None:
    path = tmp_path / "body.usdc"
    write_body(path, body)
    before = path.read_bytes()
    read_body(path)
    write_body(path, replace(body, attribution="another"))
    assert read_body(path).attribution == "another"
    write_body(path, body)
    assert path.read_bytes() == before


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_bodies_are_good_usd(path: Path) -> None:
    assert validation_errors(path) == []
    stage = Usd.Stage.Open(str(path))
    assert UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.y
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    root = stage.GetDefaultPrim()
    assert root.IsA(UsdSkel.Root)
    assert root.GetName() == path.stem
    assert Usd.ModelAPI(root).GetKind() == "component"
    assert UsdGeom.Imageable(root.GetChild("Tracking")).ComputePurpose() == UsdGeom.Tokens.guide


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_blend_shapes_deform_as_in_the_model(path: Path) -> None:
    body = read_body(path)
    stage = Usd.Stage.Open(str(path))
    mesh = stage.GetDefaultPrim().GetChild("Skin")
    weights = np.linspace(0.0, 1.0, len(body.shape_names), dtype=np.float32)
    query = UsdSkel.BlendShapeQuery(UsdSkel.BindingAPI(mesh))
    sub_weights, shapes, sub_shapes = query.ComputeSubShapeWeights(Vt.FloatArray.FromNumpy(weights))
    points = Vt.Vec3fArray(UsdGeom.Mesh(mesh).GetPointsAttr().Get())
    query.ComputeDeformedPoints(
        sub_weights,
        shapes,
        sub_shapes,
        query.ComputeBlendShapePointIndices(),
        query.ComputeSubShapePointOffsets(),
        points,
    )
    expected = body.shaped(dict(zip(body.shape_names, map(float, weights), strict=True))).skin.rest
    np.testing.assert_allclose(np.array(points), expected, atol=USD_SKINNING_TOLERANCE)


def test_subject_shows_its_first_pose(tmp_path: Path, subject: Subject) -> None:
    path = tmp_path / "subject.usda"
    write_subject(path, subject)
    assert validation_errors(path) == []
    stage = Usd.Stage.Open(str(path))
    assert UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z
    root = UsdSkel.Root(stage.GetDefaultPrim())
    mesh = root.GetPrim().GetChild("Skin")
    cache = UsdSkel.Cache()
    cache.Populate(root, Usd.PrimDefaultPredicate)
    skeleton = cache.GetSkelQuery(UsdSkel.Skeleton(root.GetPrim().GetChild("Skeleton")))
    points = UsdGeom.Mesh(mesh).GetPointsAttr().Get()
    assert cache.GetSkinningQuery(mesh).ComputeSkinnedPoints(skeleton.ComputeSkinningTransforms(0.0), points, 0.0)
    transforms = joint_transforms(subject.body, subject.root_base, subject.pose)
    expected = skin(subject.body.skin, subject.body, transforms)
    np.testing.assert_allclose(np.array(points), expected, atol=USD_SKINNING_TOLERANCE)
    low, high = np.array(root.GetExtentAttr().Get())
    assert (low <= expected.min(axis=0) + 0.25).all()
    assert (high >= expected.max(axis=0) - 0.25).all()


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [1, -1])
def test_subject_stands_upright_whatever_the_worlds_up_axis(
    tmp_path: Path, body: BodyModel, axis: int, sign: int
) -> None:
    up = sign * np.eye(3)[axis]
    front = np.roll(up, 1)
    pose = np.zeros(51)
    standing = Subject(body, np.stack([np.cross(up, front), up, front], axis=1), pose, {})
    write_subject(tmp_path / "subject.usda", standing)
    assert_same(read_subject(tmp_path / "subject.usda"), standing)
    stage = Usd.Stage.Open(str(tmp_path / "subject.usda"))
    root = UsdSkel.Root(stage.GetDefaultPrim())
    cache = UsdSkel.Cache()
    cache.Populate(root, Usd.PrimDefaultPredicate)
    joints = cache.GetSkelQuery(UsdSkel.Skeleton(root.GetPrim().GetChild("Skeleton"))).ComputeJointSkelTransforms(0.0)
    placed = root.ComputeLocalToWorldTransform(0.0)
    head, ankle = (
        placed.Transform(joints[JOINTS.index(name)].ExtractTranslation())["XYZ".index(UsdGeom.GetStageUpAxis(stage))]
        for name in ("Neck", "LAnkle")
    )
    assert head - ankle == pytest.approx(body.joint_rest[JOINTS.index("Neck"), 1] - body.joint_rest[12, 1], abs=1e-5)


def set_attribute(prim: str, name: str, change: Callable) -> Callable[[Usd.Stage], None]:
    """An edit that replaces an attribute's value by what ``change`` makes of it."""

    def edit(stage: Usd.Stage) -> None:
        attribute = stage.GetDefaultPrim().GetPrimAtPath(prim).GetAttribute(name)
        attribute.Set(change(attribute.Get()))

    return edit


def remove(prim: str, name: str = "") -> Callable[[Usd.Stage], None]:
    def edit(stage: Usd.Stage) -> None:
        target = stage.GetDefaultPrim().GetPrimAtPath(prim)
        if name:
            target.RemoveProperty(name)
        else:
            stage.RemovePrim(target.GetPath())

    return edit


def change_item(index: int, value: object) -> Callable:
    def change(values):
        values = list(values)
        values[index] = value
        return values

    return change


WRONG_BODIES: dict[str, tuple[Callable[[Usd.Stage], None], str]] = {
    "no skeleton": (remove("Skeleton"), "has no Skeleton"),
    "no tracking mesh": (remove("Tracking"), "has no Tracking"),
    "no shape prim": (remove("Skin/height_incr"), "has no height_incr"),
    "no attribution": (remove(".", "mmocap:attribution"), "holds no mmocap body"),
    "no limits": (remove("Skeleton", "mmocap:limitsLower"), "mmocap:limitsLower is missing"),
    "no weights": (remove("Skin", "primvars:skel:jointWeights"), "primvars:skel:jointWeights is missing"),
    "centimetres": (lambda stage: UsdGeom.SetStageMetersPerUnit(stage, 0.01), "units of 0.01 m"),
    "orphan joint": (
        set_attribute("Skeleton", "joints", change_item(3, "Root/Tail")),
        "joint 'Root/BottomSpine/UpperSpine/LShoulder/LElbow' hangs on one that does not exist",
    ),
    "joint missing": (
        set_attribute("Skeleton", "joints", lambda v: v[:-1]),
        "bindTransforms has shape (16, 4, 4), expected 15 x 4 x 4",
    ),
    "joint twice": (
        set_attribute("Skeleton", "joints", change_item(15, "Root/LHip/LKnee/LAnkle")),
        "two joints share a name",
    ),
    "no models": (remove("Skeleton", "mmocap:models"), "mmocap:models is missing"),
    "model without names": (remove("Skeleton", "mmocap:dof28"), "mmocap:dof28 is missing"),
    "unknown coordinate": (
        set_attribute("Skeleton", "mmocap:dof39", change_item(7, "Tail.Rx")),
        "mmocap:dof39 names 'Tail.Rx', which is no coordinate",
    ),
    "model of another length": (
        set_attribute("Skeleton", "mmocap:dof39", lambda v: v[:-1]),
        "models: 39 must be that many coordinates",
    ),
    "joint of no part": (set_attribute("Skeleton", "mmocap:part", change_item(2, 9)), "part must give each joint"),
    "odd pair": (set_attribute("Skeleton", "mmocap:pairJoints", lambda v: v[:-1]), "11 joints for 6 pairs"),
    "pair of another body": (
        set_attribute("Skeleton", "mmocap:pairJoints", change_item(0, "LWing")),
        "pairs must be of different joints",
    ),
    "no spread": (set_attribute("Skeleton", "mmocap:spread", change_item(4, -1.0)), "spread must be positive"),
    "bind transform missing": (
        set_attribute("Skeleton", "bindTransforms", lambda v: v[:-1]),
        "bindTransforms has shape (15, 4, 4), expected 16 x 4 x 4",
    ),
    "bind transform scaled": (
        set_attribute("Skeleton", "bindTransforms", change_item(0, Gf.Matrix4d(2.0))),
        "not a rotation and a translation",
    ),
    "bind transform mirrored": (
        set_attribute("Skeleton", "bindTransforms", change_item(0, Gf.Matrix4d(Gf.Vec4d(-1, 1, 1, 1)))),
        "not a rotation and a translation",
    ),
    "limits crossed": (
        set_attribute("Skeleton", "mmocap:limitsLower", change_item(4, Gf.Vec3f(9))),
        "a lower joint limit lies above",
    ),
    "limit NaN": (
        set_attribute("Skeleton", "mmocap:limitsUpper", change_item(4, Gf.Vec3f(np.nan))),
        "mmocap:limitsUpper holds NaN",
    ),
    "point NaN": (set_attribute("Skin", "points", change_item(5, Gf.Vec3f(np.nan))), "points holds NaN"),
    "point infinite": (set_attribute("Skin", "points", change_item(5, Gf.Vec3f(np.inf))), "points are not finite"),
    "face beyond": (set_attribute("Skin", "faceVertexIndices", change_item(0, 99999)), "a face names a vertex"),
    "mixed faces": (
        set_attribute("Skin", "faceVertexCounts", change_item(0, 3)),
        "its faces must all have (3, 4) corners",
    ),
    "weights short": (
        set_attribute("Skin", "primvars:skel:jointWeights", lambda v: v[:-4]),
        "primvars:skel:jointWeights has shape",
    ),
    "weights do not sum to one": (
        set_attribute("Skin", "primvars:skel:jointWeights", change_item(8, 0.25)),
        "the weights of vertex 2 sum to",
    ),
    "weight negative": (
        set_attribute("Skin", "primvars:skel:jointWeights", change_item(8, -1.0)),
        "a skinning weight is negative",
    ),
    "influence beyond": (
        set_attribute("Skin", "primvars:skel:jointIndices", change_item(8, 16)),
        "a vertex names a joint",
    ),
    "marker beyond": (set_attribute("Skin", "mmocap:markerVertices", change_item(0, -1)), "a marker's vertex"),
    "marker unnamed": (
        set_attribute("Skin", "mmocap:markerNames", lambda v: v[:-1]),
        "mmocap:markerVertices has shape",
    ),
    "offsets short": (set_attribute("Skin/waist_incr", "offsets", lambda v: v[:-1]), "offsets has shape"),
    "offset of no vertex": (
        set_attribute("Skin/waist_incr", "pointIndices", change_item(0, 13380)),
        "pointIndices names a vertex",
    ),
    "joint offsets short": (
        set_attribute("Skin/waist_incr", "mmocap:jointOffsets", lambda v: v[:-1]),
        "mmocap:jointOffsets has shape (15, 3), expected 16 x 3",
    ),
    "tracking vertex beyond": (
        set_attribute("Tracking", "mmocap:skinVertices", change_item(0, 13380)),
        "mmocap:skinVertices names a vertex",
    ),
    "tracking mesh open": (
        lambda stage: [
            set_attribute("Tracking", "faceVertexCounts", lambda v: v[1:])(stage),
            set_attribute("Tracking", "faceVertexIndices", lambda v: v[3:])(stage),
        ],
        "the tracking mesh is not closed",
    ),
}


@pytest.mark.parametrize("wrong", WRONG_BODIES)
def test_a_wrong_body_is_refused(tmp_path: Path, wrong: str) -> None:
    edit, message = WRONG_BODIES[wrong]
    path = tmp_path / "body.usdc"
    stage = Usd.Stage.Open(Sdf.Layer.OpenAsAnonymous(str(SHIPPED[0])))
    edit(stage)
    stage.GetRootLayer().Export(str(path))
    with pytest.raises(InputError) as raised:
        read_body(path)
    assert message in raised.value.problem
    assert raised.value.source == str(path)
    assert "\n" not in str(raised.value)


WRONG_FILES: dict[str, tuple[bytes | None, str]] = {
    "missing.usdc": (None, "no such file"),
    "text.usdc": (b"not a crate", "is not a USD file"),
    "garbage.usda": (b"#usda 1.0\ndef Xform {{{", "is not a USD file"),
    "empty.usda": (b"#usda 1.0\n", "holds no mmocap body"),
    "body.txt": (b"hello", "is not a USD file"),
}


@pytest.mark.parametrize("name", WRONG_FILES)
def test_a_wrong_file_is_refused(tmp_path: Path, name: str) -> None:
    content, message = WRONG_FILES[name]
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError) as raised:
        read_body(tmp_path / name)
    assert message in raised.value.problem


WRONG_SUBJECTS: dict[str, tuple[Callable[[Usd.Stage], None], str]] = {
    "a body": (remove(".", "mmocap:rootBase"), "mmocap:rootBase is missing"),
    "mirrored base": (
        set_attribute(".", "mmocap:rootBase", lambda v: Gf.Matrix3d(Gf.Vec3d(-1, 1, 1))),
        "mmocap:rootBase is not a rotation",
    ),
    "short pose": (set_attribute(".", "mmocap:pose", lambda v: v[:-1]), "mmocap:pose has shape (50,), expected 51"),
    "pose NaN": (set_attribute(".", "mmocap:pose", change_item(9, np.nan)), "mmocap:pose holds NaN"),
    "provenance": (set_attribute(".", "mmocap:provenance", lambda v: "{"), "mmocap:provenance is not a JSON object"),
}


@pytest.mark.parametrize("wrong", WRONG_SUBJECTS)
def test_a_wrong_subject_is_refused(tmp_path: Path, subject: Subject, wrong: str) -> None:
    edit, message = WRONG_SUBJECTS[wrong]
    path = tmp_path / "subject.usdc"
    write_subject(path, subject)
    stage = Usd.Stage.Open(Sdf.Layer.OpenAsAnonymous(str(path)))
    edit(stage)
    stage.GetRootLayer().Export(str(path))
    with pytest.raises(InputError) as raised:
        read_subject(path)
    assert message in raised.value.problem


@pytest.mark.parametrize(("name", "message"), [("body.obj", "is not a USD file name"), ("no/body.usdc", "its folder")])
def test_writing_to_a_wrong_place(tmp_path: Path, body: BodyModel, name: str, message: str) -> None:
    with pytest.raises(InputError) as raised:
        write_body(tmp_path / name, body)
    assert message in raised.value.problem


def test_joint_names_are_unique_last_elements(body: BodyModel, tmp_path: Path) -> None:
    # Blender and others name bones by the last element alone.
    write_body(tmp_path / "body.usda", body)
    stage = Usd.Stage.Open(str(tmp_path / "body.usda"))
    joints = UsdSkel.Skeleton(stage.GetDefaultPrim().GetChild("Skeleton")).GetJointsAttr().Get()
    assert tuple(path.split("/")[-1] for path in joints) == JOINTS
