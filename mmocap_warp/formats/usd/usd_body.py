"""Bodies as USD: a UsdSkel body that any viewer opens, with the rest of a :class:`BodyModel` as ``mmocap:`` attributes.

Layout below the body's prim (a ``SkelRoot`` named after the body)::

    Skeleton             joints, bind and rest transforms, degrees of freedom (see ``skeleton``)
    Skin                 the full mesh; mmocap:markerNames, mmocap:markerVertices
    Skin/<shape target>  BlendShape; mmocap:jointOffsets, the joints' displacements [m]
    Tracking             the tracking mesh (purpose guide); mmocap:skinVertices, its vertices in Skin
    Motions/<motion>     a motion that came with the body; mmocap:name, mmocap:fps, mmocap:pose

and on the prim itself ``mmocap:attribution``, of a body whose shape is known ``mmocap:rigid``, and of one that carries
tables of further joint sets ``mmocap:jointSetNames`` and ``mmocap:jointSets``, their texts.

A :class:`Subject` adds ``Skeleton/FirstPose``, a one-frame animation that shows the body where the recording starts,
and on the prim ``mmocap:rootBase`` (for row vectors, as all in USD), ``mmocap:pose`` and ``mmocap:provenance`` (JSON).
"""

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from pxr import Gf, Kind, Sdf, Usd, UsdGeom, UsdSkel, Vt

from mmocap_warp.body import model
from mmocap_warp.body.mesh_pieces import is_closed
from mmocap_warp.errors import InputError
from mmocap_warp.formats.usd.usd_file import PrimReader, author, read_stage, reads_usd, set_world_up, write_stage
from mmocap_warp.formats.usd.usd_skeleton import define_freedom, is_rotation, joint_paths, read_skeleton

_REMEDY = "import the body again with `mmocap body import`, or start from one that comes with the project"
_MOTION_POSES = 32  # of all motions together, unless there are more motions
_WEIGHT_SUM_TOLERANCE = 1e-3  # Files by other programs round their weights.


def write_body(path: str | Path, body: model.BodyModel, motions: Mapping[str, model.BodyMotion] | None = None) -> None:
    """Write a body to a ``.usd``, ``.usda`` or ``.usdc`` file, Y up, in metres, with motions by their names."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    root = define_body(stage, f"/{body.name}", body)
    if motions:
        UsdGeom.Scope.Define(stage, f"/{body.name}/Motions")
    for number, (name, motion) in enumerate((motions or {}).items()):
        prim = UsdGeom.Scope.Define(stage, f"/{body.name}/Motions/Motion{number}").GetPrim()
        for key, value in {"name": name, "fps": float(motion.fps), "pose": np.asarray(motion.pose, float)}.items():
            author(prim, f"mmocap:{key}", value)
    stage.SetDefaultPrim(root.GetPrim())
    write_stage(path, stage)


@reads_usd
def read_motions(path: str | Path) -> dict[str, model.BodyMotion]:
    """The motions that came with a body, by name; none where it has none."""
    stage = read_stage(path)
    body = body_prim(stage, path)
    return _motions(body, body_from_prim(body, path).skeleton.coordinates, path)


def _motions(body: Usd.Prim, coordinates: int, path: object) -> dict[str, model.BodyMotion]:
    motions, above = {}, body.GetChild("Motions")
    for prim in above.GetChildren() if above else ():
        read = PrimReader(prim, path, _REMEDY)
        pose, fps = read.array("mmocap:pose", (None,), np.float64), read.typed("mmocap:fps", float)
        read.require(np.isfinite(pose).all(), "mmocap:pose is not finite")
        read.require(0 < fps < np.inf, f"mmocap:fps is {fps}")
        problem = f"mmocap:pose holds {len(pose)} values, which are no poses of {coordinates}"
        read.require(len(pose) > 0 and len(pose) % coordinates == 0, problem)
        motions[read.typed("mmocap:name", str)] = model.BodyMotion(fps, pose.reshape(-1, coordinates))
    return motions


@reads_usd
def read_body(path: str | Path) -> model.BodyModel:
    """Read a body that :func:`write_body` or anything that contains such a body wrote."""
    stage = read_stage(path)
    return body_from_prim(body_prim(stage, path), path)


def write_subject(path: str | Path, subject: model.Subject) -> None:
    """Write a subject to a ``.usd``, ``.usda`` or ``.usdc`` file: its body, standing as in the first frame."""
    stage = Usd.Stage.CreateInMemory()
    root = define_subject(stage, f"/{subject.body.name}", subject)
    set_world_up(stage, root, up_axis(subject.root_base))
    stage.SetDefaultPrim(root.GetPrim())
    # An animation of one frame shows the body where the recording starts.
    skeleton = root.GetPath().AppendChild("Skeleton")
    animation = UsdSkel.Animation.Define(stage, skeleton.AppendChild("FirstPose"))
    animation.CreateJointsAttr(joint_paths(subject.body.skeleton))
    set_pose(animation, model.joint_transforms(subject, subject.pose[None])[0][0], Usd.TimeCode(0))
    UsdSkel.BindingAPI(stage.GetPrimAtPath(skeleton)).CreateAnimationSourceRel().SetTargets([animation.GetPath()])
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(0)
    root.GetExtentAttr().Set(UsdGeom.Boundable.ComputeExtentFromPlugins(root, Usd.TimeCode(0)))
    write_stage(path, stage)


@reads_usd
def read_subject(path: str | Path) -> model.Subject:
    """Read a subject that :func:`write_subject` wrote."""
    stage = read_stage(path)
    prim = body_prim(stage, path)
    if not prim.HasAttribute("mmocap:rootBase"):
        problem = "holds a body, but not how it stands when a recording starts (mmocap:rootBase is missing)"
        raise InputError(path, problem, "fit it: `mmocap fit SCENE --body BODY -o subject.usdc`")
    return subject_from_prim(prim, path)


def define_subject(stage: Usd.Stage, path: str, subject: model.Subject) -> UsdSkel.Root:
    """Author the subject's body at ``path``, with where it starts as attributes; returns its ``SkelRoot``."""
    root = define_body(stage, path, subject.body)
    prim, base = root.GetPrim(), Gf.Matrix3d(np.asarray(subject.root_base, float).T)
    author(prim, "mmocap:rootBase", base, kind=Sdf.ValueTypeNames.Matrix3d)
    author(prim, "mmocap:pose", np.asarray(subject.pose, float))
    author(prim, "mmocap:provenance", json.dumps(subject.provenance))
    return root


def subject_from_prim(prim: Usd.Prim, source: object) -> model.Subject:
    """The subject that :func:`define_subject` authored at ``prim``; ``source`` is named in errors."""
    read = PrimReader(prim, source, "fit the subject again with `mmocap fit`")
    root_base = read.array("mmocap:rootBase", (3, 3), np.float64).T
    body = body_from_prim(prim, source)
    pose = read.array("mmocap:pose", (body.skeleton.coordinates,), np.float64)
    read.require(is_rotation(root_base), "mmocap:rootBase is not a rotation")
    read.require(np.isfinite(pose).all(), "mmocap:pose is not finite")
    return model.Subject(body, root_base, pose, read.json_object("mmocap:provenance"))


def body_prim(stage: Usd.Stage, source: object) -> Usd.Prim:
    """The stage's first skinned body."""
    for prim in stage.Traverse():
        if prim.IsA(UsdSkel.Root) and prim.HasAttribute("mmocap:attribution"):
            return prim
    raise InputError(source, "holds no mmocap body (a SkelRoot with mmocap:attribution)", _REMEDY)


def define_body(stage: Usd.Stage, path: str, body: model.BodyModel) -> UsdSkel.Root:
    """Author the body in its bind pose at ``path``; returns its ``SkelRoot``."""
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    root = UsdSkel.Root.Define(stage, path)
    Usd.ModelAPI(root).SetKind(Kind.Tokens.component)
    author(root.GetPrim(), "mmocap:attribution", body.attribution)
    if body.rigid:
        author(root.GetPrim(), "mmocap:rigid", True)
    if body.joint_sets:
        author(root.GetPrim(), "mmocap:jointSetNames", list(body.joint_sets))
        author(root.GetPrim(), "mmocap:jointSets", list(body.joint_sets.values()))

    skeleton = UsdSkel.Skeleton.Define(stage, f"{path}/Skeleton")
    skeleton.CreateJointsAttr(joint_paths(body.skeleton))
    skeleton.CreateJointNamesAttr(list(body.skeleton.joints))
    skeleton.CreateBindTransformsAttr([Gf.Matrix4d(m.T) for m in model.bind_transforms(body)])
    skeleton.CreateRestTransformsAttr([Gf.Matrix4d(m.T) for m in body.rest_transforms])
    UsdSkel.BindingAPI.Apply(skeleton.GetPrim())
    define_freedom(skeleton.GetPrim(), body.skeleton)

    skin, numbers = _define_mesh(stage, f"{path}/Skin", body.skin, skeleton), Sdf.ValueTypeNames.IntArray
    author(skin.GetPrim(), "mmocap:markerNames", list(body.marker_names))
    author(skin.GetPrim(), "mmocap:markerVertices", Vt.IntArray.FromNumpy(body.marker_vertex), kind=numbers)
    _define_shapes(stage, skin, body)

    tracking = _define_mesh(stage, f"{path}/Tracking", body.tracking, skeleton)
    tracking.CreatePurposeAttr(UsdGeom.Tokens.guide)
    author(tracking.GetPrim(), "mmocap:skinVertices", Vt.IntArray.FromNumpy(body.tracking_vertex), kind=numbers)

    root.CreateExtentAttr(skin.GetExtentAttr().Get())
    return root


def set_pose(
    animation: UsdSkel.Animation, local: np.ndarray, time: Usd.TimeCode, before: np.ndarray | None = None
) -> np.ndarray:
    """Author joint transforms (joint, 4, 4), relative to their parents, at a time; returns the quaternions (joint, 4).

    Scales are written too: without them USD falls back to the rest pose and says nothing. Of a quaternion and its
    negative, which turn alike, the one nearer to ``before`` is written, so that every program interpolates the short
    way; pass what the frame before returned.
    """
    matrices = Vt.Matrix4dArray.FromNumpy(np.ascontiguousarray(local.transpose(0, 2, 1)))
    translations, rotations, scales = UsdSkel.DecomposeTransforms(matrices)
    quaternions = np.array(rotations)
    if before is not None:
        quaternions *= np.where((quaternions * before).sum(axis=1, keepdims=True) < 0, -1, 1)
    animation.CreateTranslationsAttr().Set(translations, time)
    animation.CreateRotationsAttr().Set(Vt.QuatfArray.FromNumpy(quaternions), time)
    animation.CreateScalesAttr().Set(scales, time)
    return quaternions


def up_axis(root_base: np.ndarray) -> str:
    """The world's axis, such as ``+z``, that is nearest to the up direction of a body that stands by ``root_base``."""
    up = root_base[:, 1]
    axis = int(np.abs(up).argmax())
    return "-+"[int(up[axis] > 0)] + "xyz"[axis]


def body_from_prim(prim: Usd.Prim, source: object) -> model.BodyModel:
    """The body that :func:`define_body` authored at ``prim``; ``source`` is named in errors."""
    read = PrimReader(prim, source, _REMEDY)
    unit = UsdGeom.GetStageMetersPerUnit(prim.GetStage())
    read.require(unit == 1.0, f"its lengths are in units of {unit:g} m, expected metres")
    skeleton, skin, tracking = read.child("Skeleton"), read.child("Skin"), read.child("Tracking")
    joints, joint_rest = read_skeleton(skeleton)

    mesh = _read_mesh(skin, len(joint_rest))
    marker_names = tuple(skin.texts("mmocap:markerNames"))
    marker_vertex = skin.array("mmocap:markerVertices", (len(marker_names),), np.int32)
    skin.require(_is_within(marker_vertex, len(mesh.rest)), "a marker's vertex does not exist")
    shape_names, shape_vertex, shape_joint = _read_shapes(skin, len(mesh.rest), len(joint_rest))

    tracking_vertex = tracking.array("mmocap:skinVertices", (None,), np.int32)
    tracking.require(_is_within(tracking_vertex, len(mesh.rest)), "mmocap:skinVertices names a vertex that Skin lacks")
    tracking_face = _read_faces(tracking, len(tracking_vertex), corners=(3,))
    tracking.require(is_closed(tracking_face), "the tracking mesh is not closed")
    motions = _motions(prim, joints.coordinates, source).values()
    count = max(1, _MOTION_POSES // max(1, len(motions)))
    sets, tables = (read.texts(f"mmocap:{name}", optional=True) for name in ("jointSetNames", "jointSets"))
    read.require(len(sets) == len(tables), "mmocap:jointSets has not one table for each of mmocap:jointSetNames")
    return model.BodyModel(
        name=prim.GetName(), skeleton=joints, joint_rest=joint_rest, skin=mesh, tracking_vertex=tracking_vertex,
        tracking_face=tracking_face, shape_names=shape_names, shape_vertex=shape_vertex, shape_joint=shape_joint,
        marker_names=marker_names, marker_vertex=marker_vertex, attribution=read.typed("mmocap:attribution", str),
        rigid=read.typed("mmocap:rigid", bool, unsaid=False), joint_sets=dict(zip(sets, tables, strict=True)),
        motion_poses=np.concatenate([motion.some_poses(count) for motion in motions]) if motions else None,
    )  # fmt: skip


def _define_mesh(stage: Usd.Stage, path: str, mesh: model.SkinMesh, skeleton: UsdSkel.Skeleton) -> UsdGeom.Mesh:
    prim = UsdGeom.Mesh.Define(stage, path)
    prim.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(mesh.rest))
    prim.CreateFaceVertexCountsAttr(Vt.IntArray(len(mesh.face), mesh.face.shape[1]))
    prim.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(mesh.face.ravel()))
    prim.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    prim.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(prim.GetPointsAttr().Get()))
    binding = UsdSkel.BindingAPI.Apply(prim.GetPrim())
    binding.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    binding.CreateGeomBindTransformAttr(Gf.Matrix4d(1.0))
    influences = mesh.joint.shape[1]
    binding.CreateJointIndicesPrimvar(False, influences).Set(Vt.IntArray.FromNumpy(mesh.joint.ravel()))
    binding.CreateJointWeightsPrimvar(False, influences).Set(Vt.FloatArray.FromNumpy(mesh.weight.ravel()))
    return prim


def _define_shapes(stage: Usd.Stage, skin: UsdGeom.Mesh, body: model.BodyModel) -> None:
    targets = []
    for name, vertex, joint in zip(body.shape_names, body.shape_vertex, body.shape_joint, strict=True):
        shape = UsdSkel.BlendShape.Define(stage, skin.GetPath().AppendChild(name))
        moved = np.flatnonzero(vertex.any(axis=1))
        shape.CreateOffsetsAttr(Vt.Vec3fArray.FromNumpy(vertex[moved]))
        shape.CreatePointIndicesAttr(Vt.IntArray.FromNumpy(moved.astype(np.int32)))
        offsets = Vt.Vec3fArray.FromNumpy(joint)
        author(shape.GetPrim(), "mmocap:jointOffsets", offsets, kind=Sdf.ValueTypeNames.Vector3fArray)
        targets.append(shape.GetPath())
    binding = UsdSkel.BindingAPI(skin.GetPrim())
    binding.CreateBlendShapesAttr(list(body.shape_names))
    binding.CreateBlendShapeTargetsRel().SetTargets(targets)


def _is_within(index: np.ndarray, count: int) -> bool:
    return bool(((index >= 0) & (index < count)).all())


def _read_faces(mesh: PrimReader, vertices: int, corners: tuple[int, ...]) -> np.ndarray:
    counts = mesh.array("faceVertexCounts", (None,), np.int32)
    sizes = np.unique(counts)
    mesh.require(len(sizes) == 1 and sizes[0] in corners, f"its faces must all have {corners} corners, not {sizes}")
    index = mesh.array("faceVertexIndices", (int(counts.sum()),), np.int32)
    mesh.require(_is_within(index, vertices), "a face names a vertex that does not exist")
    return index.reshape(-1, sizes[0])


def _read_mesh(mesh: PrimReader, joints: int) -> model.SkinMesh:
    rest = mesh.array("points", (None, 3))
    mesh.require(np.isfinite(rest).all(), "points are not finite")
    joint = mesh.array("primvars:skel:jointIndices", (4 * len(rest),), np.int32).reshape(-1, 4)
    weight = mesh.array("primvars:skel:jointWeights", (4 * len(rest),)).reshape(-1, 4)
    mesh.require(_is_within(joint, joints), "a vertex names a joint that does not exist")
    mesh.require((weight >= 0).all(), "a skinning weight is negative")
    off = np.abs(weight.sum(1) - 1.0)
    worst = int(off.argmax())
    problem = f"the weights of vertex {worst} sum to {weight[worst].sum():.4g}, not 1"
    mesh.require(off[worst] < _WEIGHT_SUM_TOLERANCE, problem)
    return model.SkinMesh(rest, _read_faces(mesh, len(rest), corners=(3, 4)), joint, weight)


def _read_shapes(skin: PrimReader, vertices: int, joints: int) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    names = tuple(skin.texts("skel:blendShapes"))
    vertex = np.zeros((len(names), vertices, 3), np.float32)
    joint = np.zeros((len(names), joints, 3), np.float32)
    for s, name in enumerate(names):
        shape = skin.child(name)
        moved = shape.array("pointIndices", (None,), np.int32)
        shape.require(_is_within(moved, vertices), "pointIndices names a vertex that Skin lacks")
        vertex[s, moved] = shape.array("offsets", (len(moved), 3))
        joint[s] = shape.array("mmocap:jointOffsets", (joints, 3))
    return names, vertex, joint
