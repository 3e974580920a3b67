"""UsdSkel characters: a body that this program wrote is read as any other program's file would be."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from other_bodies import quadruped
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics, UsdUtils
from synthetic import synthetic_result

from mmocap_warp.errors import InputError
from mmocap_warp.formats.rigged.usd_skel import read_usd_skel
from mmocap_warp.formats.usd.usd_body import write_body
from mmocap_warp.formats.usd.usd_result import export_animation


def test_joints_skin_and_units(tmp_path: Path) -> None:
    dog, path = quadruped(), tmp_path / "dog.usda"
    write_body(path, dog)
    stage = Usd.Stage.Open(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    stage.Save()
    read = read_usd_skel(path)
    assert read.joints == dog.skeleton.joints
    assert read.parent == dog.skeleton.parent
    assert (read.up, read.facing, read.metres) == ("+z", "-y", 0.01)
    np.testing.assert_allclose(read.bind[:, :3, 3], dog.joint_rest, atol=1e-6)
    np.testing.assert_allclose(read.vertex, dog.skin.rest, atol=1e-6)
    np.testing.assert_array_equal(read.influence[:, 0], dog.skin.joint[:, 0])
    assert len(read.face) == 2 * len(dog.skin.face)


def read_with_knee(path: Path, kind: type, axis: str, lower: float, upper: float, turn: Gf.Quatf | None = None):
    """A dog whose left fore knee has a physics joint."""
    write_body(path, quadruped())
    stage = Usd.Stage.Open(str(path))
    knee = kind.Define(stage, Sdf.Path("/Dog/LForeKnee"))
    knee.CreateAxisAttr(axis)
    knee.CreateLowerLimitAttr(lower)
    knee.CreateUpperLimitAttr(upper)
    if turn is not None:
        knee.CreateLocalRot1Attr(turn)
    stage.Save()
    return read_usd_skel(path)


def test_limits_of_physics_joints(tmp_path: Path) -> None:
    read = read_with_knee(tmp_path / "dog.usda", UsdPhysics.RevoluteJoint, "X", -10.0, 90.0)
    (joint,) = read.axes
    assert read.joints[joint] == "LForeKnee"
    assert not read.axes[joint].slides
    np.testing.assert_allclose(read.axes[joint].axis, (1, 0, 0))
    np.testing.assert_allclose((read.axes[joint].lower, read.axes[joint].upper), np.radians([-10, 90]), rtol=1e-6)


def test_a_physics_axis_lies_in_a_frame_that_may_be_turned(tmp_path: Path) -> None:
    z_to_x = Gf.Quatf(0.5**0.5, 0.0, 0.5**0.5, 0.0)
    read = read_with_knee(tmp_path / "dog.usda", UsdPhysics.RevoluteJoint, "Z", -10.0, 90.0, z_to_x)
    (how,) = read.axes.values()
    np.testing.assert_allclose(how.axis, (1, 0, 0), atol=1e-6)


def test_travel_of_a_prismatic_physics_joint(tmp_path: Path) -> None:
    read = read_with_knee(tmp_path / "dog.usda", UsdPhysics.PrismaticJoint, "Y", -0.5, 0.25)
    (how,) = read.axes.values()
    np.testing.assert_allclose(how.axis, (0, 1, 0))
    assert (how.lower, how.upper, how.slides) == (-0.5, 0.25, True)


def test_a_file_without_a_skin_is_told(tmp_path: Path) -> None:
    stage = Usd.Stage.CreateNew(str(tmp_path / "empty.usda"))
    UsdGeom.Mesh.Define(stage, "/Mesh")
    stage.Save()
    with pytest.raises(InputError, match="holds no mesh that is bound"):
        read_usd_skel(tmp_path / "empty.usda")


def test_a_skeleton_that_is_placed_in_the_stage_an_instance_and_a_package(tmp_path: Path) -> None:
    dog, path = quadruped(), tmp_path / "dog.usda"
    write_body(path, dog)
    shown = tmp_path / "shown.usda"
    stage = Usd.Stage.CreateNew(str(shown))
    prim = stage.DefinePrim("/Shown", "Xform")
    prim.GetReferences().AddReference("./dog.usda")
    prim.SetInstanceable(True)
    place = UsdGeom.Xformable(prim)
    place.AddTranslateOp().Set((1.0, 2.0, 3.0))
    place.AddRotateXOp().Set(90.0)
    stage.Save()
    whole, package = tmp_path / "whole.usdc", tmp_path / "shown.usdz"
    stage.Flatten().Export(str(whole))
    assert UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(whole)), str(package))
    turn = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    for file in (shown, package):
        read = read_usd_skel(file)
        np.testing.assert_allclose(read.bind[:, :3, 3], dog.joint_rest @ turn.T + (1, 2, 3), atol=1e-6)
        np.testing.assert_allclose(read.vertex, dog.skin.rest @ turn.T + (1, 2, 3), atol=1e-6)
        np.testing.assert_allclose(read.bind[0, :3, :3], turn @ read_usd_skel(path).bind[0, :3, :3], atol=1e-6)


def test_a_track_in_a_world_whose_z_is_up_is_bound_standing(tmp_path: Path) -> None:
    result, body, track = synthetic_result(up="+z"), tmp_path / "body.usda", tmp_path / "track.usda"
    write_body(body, result.subject.body)
    export_animation(result, track)
    read = read_usd_skel(track)
    turn = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    assert read.up == "+z"
    np.testing.assert_allclose(read.bind[:, :3, 3], read_usd_skel(body).bind[:, :3, 3] @ turn.T, atol=1e-6)


@pytest.mark.parametrize("up", ["-z", "+x", "-x", "-y"])
def test_a_track_of_any_world_is_bound_standing(tmp_path: Path, up: str) -> None:
    result, track = synthetic_result(up=up), tmp_path / "track.usda"
    export_animation(result, track)
    read = read_usd_skel(track)
    height = np.ptp(result.subject.body.skin.rest[:, 1])
    assert np.ptp(read.vertex[:, "xyz".index(read.up[1])]) == pytest.approx(height, rel=1e-5)


def test_cameras_in_somebody_elses_stage_lay_nobody_down(tmp_path: Path) -> None:
    dog, path = quadruped(), tmp_path / "dog.usda"
    write_body(path, dog)
    stage = Usd.Stage.Open(str(path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.Scope.Define(stage, "/World/Cameras")
    stage.Save()
    np.testing.assert_allclose(read_usd_skel(path).vertex, dog.skin.rest, atol=1e-6)


def test_of_two_characters_in_a_strange_file_one_is_named(tmp_path: Path) -> None:
    write_body(tmp_path / "dog.usda", quadruped())
    stage = Usd.Stage.CreateNew(str(tmp_path / "shown.usda"))
    for name in ("Rex", "Laika"):
        stage.DefinePrim(f"/{name}", "Xform").GetReferences().AddReference("./dog.usda")
    stage.Flatten().Export(str(tmp_path / "both.usda"))  # which the sandbox reads first
    with pytest.raises(InputError, match="holds 2 characters; choose one with --character: Rex, Laika"):
        read_usd_skel(tmp_path / "both.usda")
    with pytest.raises(InputError, match="not one that is called 'Fido'"):
        read_usd_skel(tmp_path / "both.usda", "Fido")
    assert read_usd_skel(tmp_path / "both.usda", "Laika").joints == quadruped().skeleton.joints
    (tmp_path / "both.usda").rename(tmp_path / "again.usda")
    assert read_usd_skel(tmp_path / "again.usda", character="Rex").joints == quadruped().skeleton.joints
