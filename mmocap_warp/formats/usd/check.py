"""What is wrong with a USD file: OpenUSD's own validators, and what they let pass in skinned, animated bodies.

UsdValidation does not look at lengths, weights, orphan joints, indices or missing scales; a file with such a fault
opens without a word and shows the rest pose, nothing, or crashes the viewer.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from pxr import Tf, Usd, UsdGeom, UsdSkel, UsdValidation, Vt

from mmocap_warp.errors import InputError

_WEIGHT_SUM_TOLERANCE = 1e-4
_UNIT_QUATERNION_TOLERANCE = 1e-3


def faults(path: str | Path) -> list[str]:
    """Every fault of a ``.usda``, ``.usdc`` or ``.usdz`` file, one line each; empty for a sound one.

    Raises:
        InputError: no such file, or not USD.
    """
    if not Path(path).is_file():
        raise InputError(path, "no such file", "check the path")
    try:
        stage = Usd.Stage.Open(str(path))
    except Tf.ErrorException as error:
        raise InputError(path, "is not a USD file that can be read", "write it again") from error
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    errors = UsdValidation.ValidationContext(validators).Validate(stage)
    return [f"{error.GetName()}: {error.GetMessage()}" for error in errors] + body_faults(stage)


def body_faults(stage: Usd.Stage) -> list[str]:
    """The faults that UsdValidation misses, one line each, naming the prim."""
    found: list[str] = []
    for prim in stage.Traverse():
        if prim.IsA(UsdSkel.Skeleton):
            found += (f"{prim.GetPath()}: {fault}" for fault in _skeleton_faults(UsdSkel.Skeleton(prim)))
        elif prim.IsA(UsdSkel.Animation):
            found += (f"{prim.GetPath()}: {fault}" for fault in _animation_faults(UsdSkel.Animation(prim)))
        elif prim.IsA(UsdGeom.Mesh):
            found += (f"{prim.GetPath()}: {fault}" for fault in _mesh_faults(UsdGeom.Mesh(prim)))
    return found


def _skeleton_faults(skeleton: UsdSkel.Skeleton) -> Iterator[str]:
    joints = list(skeleton.GetJointsAttr().Get() or ())
    if not joints:
        yield "has no joints"
    if len(set(joints)) < len(joints):
        yield "names a joint twice"
    for joint in joints:
        parent = joint.rpartition("/")[0]
        if parent and parent not in joints[: joints.index(joint)]:
            yield f"joint {joint} has no parent before it"
    for name, attribute in (
        ("bindTransforms", skeleton.GetBindTransformsAttr()),
        ("restTransforms", skeleton.GetRestTransformsAttr()),
    ):
        matrices = np.array(attribute.Get() or ())
        if len(matrices) != len(joints):
            yield f"{name} has {len(matrices)} entries for {len(joints)} joints"
        elif not np.isfinite(matrices).all():
            yield f"{name} is not finite"
    source = UsdSkel.BindingAPI(skeleton).GetInheritedAnimationSource()
    if source and source.IsA(UsdSkel.Animation):
        strangers = set(UsdSkel.Animation(source).GetJointsAttr().Get() or ()) - set(joints)
        if strangers:
            yield f"its animation moves joints that it lacks: {sorted(strangers)}"


def _animation_faults(animation: UsdSkel.Animation) -> Iterator[str]:
    joints = len(animation.GetJointsAttr().Get() or ())
    times = animation.GetRotationsAttr().GetTimeSamples()
    for name, attribute in (
        ("translations", animation.GetTranslationsAttr()),
        ("rotations", animation.GetRotationsAttr()),
        ("scales", animation.GetScalesAttr()),
    ):
        if not attribute.HasAuthoredValue():
            yield f"has no {name}, so it shows the rest pose"
            continue
        if attribute.GetTimeSamples() != times:
            yield f"{name} has not the times of rotations"
        for time in attribute.GetTimeSamples() or [Usd.TimeCode.Default()]:
            fault = _sample_fault(name, attribute.Get(time), joints)
            if fault:
                yield f"{name} at {time}: {fault}"


def _sample_fault(name: str, sample: object, joints: int) -> str | None:
    if sample is None or len(sample) != joints:  # type: ignore[arg-type]
        return f"{0 if sample is None else len(sample)} entries for {joints} joints"  # type: ignore[arg-type]
    if name == "rotations":
        values = np.array([[q.GetReal(), *q.GetImaginary()] for q in sample])  # type: ignore[attr-defined]
        if np.abs(np.linalg.norm(values, axis=1) - 1.0).max(initial=0.0) > _UNIT_QUATERNION_TOLERANCE:
            return "a quaternion is not of unit length"
    return None if np.isfinite(np.array(sample, float if name != "rotations" else None)).all() else "is not finite"


def _mesh_faults(mesh: UsdGeom.Mesh) -> Iterator[str]:
    points = np.array(mesh.GetPointsAttr().Get() or ())
    counts = mesh.GetFaceVertexCountsAttr().Get() or Vt.IntArray()
    indices = mesh.GetFaceVertexIndicesAttr().Get() or Vt.IntArray()
    sound, reason = UsdGeom.Mesh.ValidateTopology(indices, counts, len(points))
    if not sound:
        yield reason
    if not np.isfinite(points).all():
        yield "points are not finite"
    if mesh.GetPrim().HasAPI(UsdSkel.BindingAPI):
        yield from _skin_faults(UsdSkel.BindingAPI(mesh), len(points))


def _skin_faults(binding: UsdSkel.BindingAPI, points: int) -> Iterator[str]:
    skeleton = binding.GetInheritedSkeleton()
    if not skeleton:
        yield "is bound to no skeleton"
        return
    index, weight = binding.GetJointIndicesPrimvar(), binding.GetJointWeightsPrimvar()
    joint = np.array(index.Get() or (), int)
    share = np.array(weight.Get() or (), float)
    influences = weight.GetElementSize()
    if index.GetElementSize() != influences or not len(joint) == len(share) == points * influences:
        yield f"{len(joint)} joint indices and {len(share)} weights for {points} points of {influences} influences"
        return
    joints = len(skeleton.GetJointsAttr().Get() or ())
    if ((joint < 0) | (joint >= joints)).any():
        yield f"a joint index is not below {joints}"
    off = np.abs(share.reshape(points, influences).sum(1) - 1.0)
    if (share < 0).any() or not (off < _WEIGHT_SUM_TOLERANCE).all():
        yield f"the weights of {int((off >= _WEIGHT_SUM_TOLERANCE).sum())} points do not sum to one, or are negative"
