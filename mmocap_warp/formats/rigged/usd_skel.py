"""Skinned characters in USD: a UsdSkel skeleton, meshes bound to it, its animation, limits of physics joints."""

from pathlib import Path

import numpy as np
from pxr import Gf, Usd, UsdGeom, UsdPhysics, UsdSkel

from mmocap_warp.errors import InputError, input_errors
from mmocap_warp.formats.rigged import rigged_mesh
from mmocap_warp.formats.usd.usd_file import read_stage, reads_usd

_REMEDY = "export the character with its UsdSkel skeleton and skin"
_MAX_FRAMES = 36000
_ATTRIBUTION = "mmocap:attribution"
_CAMERAS = "/World/Cameras"  # this program's tracks have their cameras here
_UPRIGHT = np.array([(1.0, 0, 0, 0), (0, 0, -1, 0), (0, 1, 0, 0), (0, 0, 0, 1)])  # +Y up, +Z ahead to +Z up, -Y ahead


@reads_usd
def read_usd_skel(path: str | Path, character: str | None = None) -> rigged_mesh.RiggedMesh:
    """Read a skeleton with its skin and animation; of several that of a name, which is its own or that above it.

    A ``PhysicsRevoluteJoint`` or ``PhysicsPrismaticJoint`` named like a joint of the skeleton gives that joint's axis
    and limits.
    """
    path = Path(path)
    stage = read_stage(path)
    bound: dict[str, list[UsdGeom.Mesh]] = {}
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        if prim.IsA(UsdGeom.Mesh) and UsdGeom.Imageable(prim).ComputePurpose() in ("default", "render"):
            skeleton = UsdSkel.BindingAPI(prim).GetInheritedSkeleton()
            if skeleton and UsdSkel.BindingAPI(prim).GetJointIndicesPrimvar().HasValue():
                bound.setdefault(str(skeleton.GetPath()), []).append(UsdGeom.Mesh(prim))
    if not bound:
        raise InputError(path, "holds no mesh that is bound to a UsdSkel skeleton", _REMEDY)
    names = [(place.split("/")[-2] or place[1:], place.split("/")[-1], place) for place in bound]
    chosen = list(bound)[rigged_mesh.chosen_character(names, character, path)]
    with input_errors(path, "its skeleton or skin is not whole ({error})", _REMEDY, ValueError, IndexError, TypeError):
        return _read_character(stage, UsdSkel.Skeleton.Get(stage, chosen), bound[chosen], path)


def _read_character(
    stage: Usd.Stage, skeleton: UsdSkel.Skeleton, meshes: list[UsdGeom.Mesh], path: Path
) -> rigged_mesh.RiggedMesh:
    # The joints, parents first, and where they are bound.
    paths = [str(joint) for joint in skeleton.GetJointsAttr().Get() or ()]
    number = {name: joint for joint, name in enumerate(paths)}
    if not paths or len(number) < len(paths):
        raise ValueError("it has no joints, or two of a name")
    parent = []
    for name in paths:  # the nearest joint above it, by its path
        above = name.rpartition("/")[0]
        while above and above not in number:
            above = above.rpartition("/")[0]
        parent.append(number.get(above, -1))
    bind = np.array(skeleton.GetBindTransformsAttr().Get(), float).reshape(-1, 4, 4).swapaxes(1, 2)
    if len(bind) != len(paths) or not np.isfinite(bind).all():
        raise ValueError("its bindTransforms are not one for each joint")
    # Joints are named as the file calls them, else by their own names, or by their paths where two share a name.
    called, own = map(str, skeleton.GetJointNamesAttr().Get() or ()), (name.rsplit("/", 1)[-1] for name in paths)
    choices = tuple(called), tuple(own), tuple(name.replace("/", "_") for name in paths)
    names = next((each for each in choices if len({*each}) == len(each) == len(paths)), choices[-1])

    # The skeleton's place in the stage, which may change with time, counts for joints and skin.
    place = UsdGeom.XformCache().GetLocalToWorldTransform
    placed = np.array(place(skeleton.GetPrim()), float).T
    up = "+y" if UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.y else "+z"
    # A track's body is bound with +Y up, whichever axis is up in its recording.
    is_track = skeleton.GetPath().HasPrefix("/World") and stage.GetPrimAtPath(skeleton.GetPath().ReplaceName("Skin"))
    if is_track and stage.GetPrimAtPath(_CAMERAS) and np.allclose(placed.T, place(stage.GetPrimAtPath("/World"))):
        placed = _UPRIGHT if up == "+z" else np.eye(4)
    bind = placed @ bind

    # All meshes that are bound to the skeleton, as one.
    parts = []
    for mesh in meshes:
        points, triangles = _read_mesh(mesh)
        points = points @ placed[:3, :3].T + placed[:3, 3]
        parts.append(rigged_mesh.Skin(points, triangles, *_read_weights(mesh, number, len(points))))
    stated = (prim.GetAttribute(_ATTRIBUTION) for prim in stage.Traverse() if prim.HasAttribute(_ATTRIBUTION))
    mesh = rigged_mesh.RiggedMesh(
        name=str(meshes[0].GetPrim().GetName()), joints=names, parent=tuple(parent), bind=bind,
        **rigged_mesh.joined_parts(parts)._asdict(), up=up, facing="+z" if up == "+y" else "-y",
        metres=float(UsdGeom.GetStageMetersPerUnit(stage)), axes=_read_axes(stage, names, bind),
        motions=_read_motions(stage, skeleton), attribution=next((str(attribute.Get()) for attribute in stated), ""),
    )  # fmt: skip
    return rigged_mesh.reorder(mesh)


def _read_mesh(mesh: UsdGeom.Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Vertices in the skeleton's space as they are bound, and triangles."""
    points = np.array(mesh.GetPointsAttr().Get(), float).reshape(-1, 3)
    counts = np.array(mesh.GetFaceVertexCountsAttr().Get(), int)
    index = np.array(mesh.GetFaceVertexIndicesAttr().Get(), int)
    if counts.sum() != len(index) or (counts < 3).any() or not np.isfinite(points).all():
        raise ValueError(f"{mesh.GetPath()} has faces that do not fit its vertices")
    if len(index) and not 0 <= index.min() <= index.max() < len(points):
        raise ValueError(f"{mesh.GetPath()} has a face that names a vertex it lacks")
    first = np.repeat(np.cumsum(counts) - counts, counts - 2)
    step = np.concatenate([np.arange(1, n - 1) for n in counts]) if len(counts) else np.zeros(0, int)
    triangles = index[np.stack([first, first + step, first + step + 1], axis=1)]
    if mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded:
        triangles = triangles[:, ::-1]
    transform = np.array(UsdSkel.BindingAPI(mesh).GetGeomBindTransformAttr().Get() or np.eye(4), float)
    return points @ transform[:3, :3] + transform[3, :3], triangles


def _read_weights(mesh: UsdGeom.Mesh, number: dict[str, int], points: int) -> tuple[np.ndarray, np.ndarray]:
    """Influencing joints and weights (vertex, influence)."""
    binding = UsdSkel.BindingAPI(mesh)
    index, weight = binding.GetJointIndicesPrimvar(), binding.GetJointWeightsPrimvar()
    width = index.GetElementSize()
    joint = np.array(index.Get(), int).reshape(-1, width)
    share = np.array(weight.Get(), float).reshape(-1, width)
    if len(joint) == 1:  # a rigid mesh has one row for all
        joint, share = np.tile(joint, (points, 1)), np.tile(share, (points, 1))
    own = binding.GetJointsAttr().Get()
    names = [str(name) for name in own] if own else list(number)
    if len(joint) != points or joint.shape != share.shape or not 0 <= joint.min() <= joint.max() < len(names):
        raise ValueError(f"{mesh.GetPath()} has weights that do not fit its vertices or joints")
    if not np.isfinite(share).all() or (share < 0).any():
        raise ValueError(f"{mesh.GetPath()} has a weight that is negative or not finite")
    if any(name not in number for name in names):
        raise ValueError(f"{mesh.GetPath()} follows a joint that its skeleton lacks")
    return np.array([number[name] for name in names])[joint], share


def _read_motions(stage: Usd.Stage, skeleton: UsdSkel.Skeleton) -> dict[str, rigged_mesh.RiggedMotion]:
    """The bound animation, if it has more than one time; a frame for each time code."""
    source = UsdSkel.BindingAPI(skeleton).GetInheritedAnimationSource()
    if not source or not source.IsA(UsdSkel.Animation):
        return {}
    query = UsdSkel.Cache().GetSkelQuery(skeleton)
    times = query.GetAnimQuery().GetJointTransformTimeSamples() if query and query.GetAnimQuery() else []
    if len(times) < 2:
        return {}
    frames = np.arange(times[0], times[-1] + 0.5)
    if len(frames) > _MAX_FRAMES:
        raise ValueError(f"its animation has {len(frames)} frames")
    in_skeleton = np.array([query.ComputeJointSkelTransforms(Usd.TimeCode(time)) for time in frames], float)
    placed = [UsdGeom.XformCache(Usd.TimeCode(time)).GetLocalToWorldTransform(skeleton.GetPrim()) for time in frames]
    world = in_skeleton @ np.array(placed, float)[:, None]  # of row vectors
    fps = float(stage.GetTimeCodesPerSecond())
    return {str(source.GetName()): rigged_mesh.RiggedMotion(fps, world.swapaxes(-1, -2))}


def _read_axes(stage: Usd.Stage, joints: tuple[str, ...], bind: np.ndarray) -> dict[int, rigged_mesh.JointAxis]:
    """Axes and limits of joints after which a physics joint is named; its axis is in the joint's frame."""
    axes = {}
    for prim in stage.Traverse():
        slides = prim.IsA(UsdPhysics.PrismaticJoint)
        if not (slides or prim.IsA(UsdPhysics.RevoluteJoint)) or prim.GetName() not in joints:
            continue
        physics = UsdPhysics.PrismaticJoint(prim) if slides else UsdPhysics.RevoluteJoint(prim)
        joint = joints.index(prim.GetName())
        axis = np.eye(3)["XYZ".index(str(physics.GetAxisAttr().Get()))]  # in a frame that may be turned in the joint's
        along = bind[joint, :3, :3] @ physics.GetLocalRot1Attr().Get().Transform(Gf.Vec3f(*axis))
        lower, upper = (float(limit.Get()) for limit in (physics.GetLowerLimitAttr(), physics.GetUpperLimitAttr()))
        if lower > upper:
            raise ValueError(f"{prim.GetPath()} has a lower limit above the upper one")
        if not slides:
            lower, upper = float(np.radians(lower)), float(np.radians(upper))
        axes[joint] = rigged_mesh.JointAxis(along / np.linalg.norm(along), lower, upper, slides)
    return axes
