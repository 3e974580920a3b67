"""What is wrong with a USD file: OpenUSD's own validators, and what they let pass in skinned, animated bodies.

UsdValidation does not look at lengths, weights, orphan joints, indices, scales, numbers that are none, or files that
are needed and lie elsewhere; a file with such a fault opens without a word and shows the rest pose, nothing, or crashes
the viewer.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdSkel, UsdUtils, UsdValidation, Vt

from mmocap_warp.errors import InputError
from mmocap_warp.formats.usd.usd_body import read_body, read_subject
from mmocap_warp.formats.usd.usd_file import check_references, reads_usd
from mmocap_warp.formats.usd.usd_people import results_of
from mmocap_warp.formats.usd.usd_result import holds_result, read_result

_WEIGHT_SUM_TOLERANCE = 1e-4
_SINGULAR = 1e-9  # a determinant
_UNIT_QUATERNION_TOLERANCE = 1e-3
_STRETCH_TOLERANCE = 1e-3  # of a bone's length, by how much it may differ from the rest pose's


@reads_usd
def faults(path: str | Path) -> list[str]:
    """Every fault of a ``.usda``, ``.usdc`` or ``.usdz`` file, one line each; empty for a sound one."""
    path = Path(path)
    if not path.is_file():
        raise InputError(path, "is a folder" if path.is_dir() else "no such file", "name a file that is there")
    # Composing a stage opens all that it refers to: first, it must not be elsewhere.
    layer = Sdf.Layer.OpenAsAnonymous(str(path))
    try:
        if layer:
            check_references(layer, path)
    except InputError as error:
        return [error.problem]
    stage = Usd.Stage.Open(str(path))
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    errors = UsdValidation.ValidationContext(validators).Validate(stage)
    lines = [f"{error.GetName()}: {error.GetMessage()}" for error in errors]
    # Files that it refers to, whether they exist or not; what a .usdz packs is in it.
    layers, assets, unresolved = UsdUtils.ComputeAllDependencies(str(path))
    named = [*(layer.realPath for layer in layers), *map(str, assets)]
    own = {str(file.resolve()) for file in (path, *results_of(stage, path).values())}
    outside = [name for name in named if name.partition("[")[0] not in own]
    lines += [f"needs {name}, which is not in it" for name in [*outside, *map(str, unresolved)]]
    lines += body_faults(stage)
    # What keeps this program from reading a result, a subject or a body of its own.
    roots = [prim for prim in stage.Traverse() if prim.HasAttribute("mmocap:attribution")]
    if roots:
        is_subject = roots[0].HasAttribute("mmocap:rootBase")
        read = read_result if holds_result(path) else read_subject if is_subject else read_body
        try:
            read(path)
        except InputError as error:
            lines.append(error.problem)
    return lines


def body_faults(stage: Usd.Stage) -> list[str]:
    """The faults that UsdValidation misses, one line each, naming the prim."""
    lines = [
        f"{prim.GetPath()}: {attribute.GetName()} has a value of a type that USD does not know"
        for prim in stage.Traverse()
        for attribute in prim.GetAuthoredAttributes()
        if any(isinstance(value, Sdf.UnregisteredValue) for _, value in _samples(attribute))
    ]
    if lines:  # nothing more can be said of such values, nor of what refers to them
        return lines
    checks = {UsdSkel.Skeleton: _skeleton_faults, UsdSkel.Animation: _animation_faults, UsdGeom.Mesh: _mesh_faults}
    for prim in stage.Traverse():
        found = [_value_faults(prim), *(check(schema(prim)) for schema, check in checks.items() if prim.IsA(schema))]
        lines += (f"{prim.GetPath()}: {fault}" for each in found for fault in each)
    return lines


def _value_faults(prim: Usd.Prim) -> Iterator[str]:
    """Numbers that are none, and samples that no viewer plays; in the project's own attributes NaN has a meaning."""
    stage = prim.GetStage()
    first, last = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    for attribute in prim.GetAuthoredAttributes():
        name, times = attribute.GetName(), attribute.GetTimeSamples()
        if name.startswith("mmocap:"):
            continue
        for time, value in _samples(attribute):
            if not _is_finite(value):
                yield f"{name}{_time_phrase(time)} is not finite"
                break
        if times and not first <= times[0] <= times[-1] <= last:
            yield f"{name} has samples at {times[0]:g} to {times[-1]:g}, the stage plays {first:g} to {last:g}"


def _samples(attribute: Usd.Attribute) -> Iterator[tuple[float | None, object]]:
    """An attribute's time samples, or its one value, whose time is None."""
    for time in attribute.GetTimeSamples():
        yield time, attribute.Get(time)
    if not attribute.GetTimeSamples():
        yield None, attribute.Get()


def _time_phrase(time: float | None) -> str:
    return "" if time is None else f" at {time:g}"


def _is_finite(value: object) -> bool:
    if isinstance(value, str) or value is None:
        return True
    try:
        values = np.array(value, float)
    except (TypeError, ValueError):  # texts, paths, quaternions (which have a length)
        return True
    return bool(np.isfinite(values).all())


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
    for name in ("bindTransforms", "restTransforms"):
        matrices = np.array(skeleton.GetPrim().GetAttribute(name).Get() or ())
        if len(matrices) != len(joints):
            yield f"{name} has {len(matrices)} entries for {len(joints)} joints"
        elif joints and np.isfinite(matrices).all() and (np.abs(np.linalg.det(matrices)) < _SINGULAR).any():
            yield f"{name} has a matrix that flattens"
    names = skeleton.GetJointNamesAttr().Get()
    if names and len(names) != len(joints):
        yield f"jointNames has {len(names)} entries for {len(joints)} joints"
    source = UsdSkel.BindingAPI(skeleton).GetInheritedAnimationSource()
    if source and source.IsA(UsdSkel.Animation):
        strangers = set(UsdSkel.Animation(source).GetJointsAttr().Get() or ()) - set(joints)
        if strangers:
            yield f"its animation moves joints that it lacks: {sorted(strangers)}"
        sliding = set(skeleton.GetPrim().GetAttribute("mmocap:sliding").Get() or ())
        called = names if names and len(names) == len(joints) else [joint.rpartition("/")[2] for joint in joints]
        bones = [joint for joint, name in zip(joints, called, strict=True) if "/" in joint and name not in sliding]
        yield from _stretch_faults(UsdSkel.Animation(source), joints, bones, skeleton.GetRestTransformsAttr().Get())


def _stretch_faults(
    animation: UsdSkel.Animation, joints: list[str], of_bones: list[str], rest: Vt.Matrix4dArray | None
) -> Iterator[str]:
    """Bones, by the joints at their ends, that are longer or shorter than in the rest pose."""
    moved = list(animation.GetJointsAttr().Get() or ())
    if rest is None or len(rest) != len(joints):
        return
    length = {joint: matrix.ExtractTranslation().GetLength() for joint, matrix in zip(joints, rest, strict=True)}
    bones = [i for i, joint in enumerate(moved) if joint in of_bones]
    expected = np.array([length[moved[i]] for i in bones])
    for time, sample in _samples(animation.GetTranslationsAttr()):
        if sample is None or len(sample) != len(moved):  # type: ignore[arg-type]
            continue
        distance = np.linalg.norm(np.array(sample).reshape(-1, 3)[bones], axis=1)
        wrong = np.flatnonzero(np.abs(distance - expected) > _STRETCH_TOLERANCE * np.maximum(expected, 1e-3))
        if len(wrong):
            joint, actual = moved[bones[wrong[0]]], distance[wrong[0]]
            when = _time_phrase(time)
            yield f"{joint} is {actual:.4g} from its parent{when}, and {length[joint]:.4g} in the rest pose"
            return


def _animation_faults(animation: UsdSkel.Animation) -> Iterator[str]:
    joints = len(animation.GetJointsAttr().Get() or ())
    times = animation.GetRotationsAttr().GetTimeSamples()
    for name in ("translations", "rotations", "scales"):
        attribute = animation.GetPrim().GetAttribute(name)
        if not attribute.HasAuthoredValue():
            yield f"has no {name}, so it shows the rest pose"
            continue
        if attribute.GetTimeSamples() not in ([], times):
            yield f"{name} has other time samples than rotations"
        before = None
        for time, sample in _samples(attribute):
            fault = _sample_fault(name, sample, joints)
            if name == "rotations" and fault is None:
                quaternions = np.array(sample, float)
                if before is not None and ((quaternions * before).sum(axis=1) < 0).any():
                    fault = "a quaternion is on the other side than before, so it is interpolated the long way"
                before = quaternions
            if fault:
                yield f"{name}{_time_phrase(time)}: {fault}"


def _sample_fault(name: str, sample: object, joints: int) -> str | None:
    if sample is None or len(sample) != joints:  # type: ignore[arg-type]
        return f"{0 if sample is None else len(sample)} entries for {joints} joints"  # type: ignore[arg-type]
    if name == "rotations":
        off = np.abs(np.linalg.norm(np.array(sample, float), axis=1) - 1.0)
        if not (off <= _UNIT_QUATERNION_TOLERANCE).all():
            return "a quaternion is not of unit length"
    if name == "scales" and not (np.array(sample, float) > 0).all():
        return "a scale is not positive, which flattens or mirrors the skin"
    return None


def _mesh_faults(mesh: UsdGeom.Mesh) -> Iterator[str]:
    lengths = {len(sample or ()) for _, sample in _samples(mesh.GetPointsAttr())}  # type: ignore[arg-type]
    if len(lengths) > 1:
        yield f"points has {min(lengths)} to {max(lengths)} entries over time"
    points = min(lengths)
    counts = mesh.GetFaceVertexCountsAttr().Get() or Vt.IntArray()
    indices = mesh.GetFaceVertexIndicesAttr().Get() or Vt.IntArray()
    sound, reason = UsdGeom.Mesh.ValidateTopology(indices, counts, points)
    if not sound:
        yield reason
    if mesh.GetPrim().HasAPI(UsdSkel.BindingAPI):
        yield from _skin_faults(UsdSkel.BindingAPI(mesh), points)


def _skin_faults(binding: UsdSkel.BindingAPI, points: int) -> Iterator[str]:
    skeleton = binding.GetInheritedSkeleton()
    if not skeleton:
        yield "is bound to no skeleton"
        return
    index, weight = binding.GetJointIndicesPrimvar(), binding.GetJointWeightsPrimvar()
    joint, share = np.array(index.Get() or (), int), np.array(weight.Get() or (), float)
    influences = weight.GetElementSize()
    if index.GetElementSize() != influences or not len(joint) == len(share) == points * influences:
        yield f"{len(joint)} joint indices and {len(share)} weights for {points} points of {influences} influences"
        return
    own = binding.GetJointsAttr().Get()
    names = set(skeleton.GetJointsAttr().Get() or ())
    if own and set(own) - names:
        yield f"it follows joints that its skeleton lacks: {sorted(set(own) - names)}"
    joints = len(own or names)
    if ((joint < 0) | (joint >= joints)).any():
        yield f"a joint index is not below {joints}"
    off = np.abs(share.reshape(points, influences).sum(1) - 1.0)
    if (share < 0).any() or not (off < _WEIGHT_SUM_TOLERANCE).all():
        yield f"the weights of {int((off >= _WEIGHT_SUM_TOLERANCE).sum())} points do not sum to one, or are negative"
