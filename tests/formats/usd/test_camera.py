from dataclasses import replace

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom
from synthetic import ring_rig

from mmocap_warp.cameras.rig import project
from mmocap_warp.errors import InputError
from mmocap_warp.formats.usd.usd_camera import cameras_from_prim, define_cameras

REPROJECTION_PX = 1e-3


def stage_with(rig):
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.Xform.Define(stage, "/World")
    define_cameras(stage, "/World/Cameras", rig)
    return stage


def rig_of(stage):
    return cameras_from_prim(stage.GetPrimAtPath("/World/Cameras"), "a.usdc")


def usd_pixels(stage, name, size, points):
    """Pixels of world points through USD's own frustum; pixel centres at integers."""
    prim = stage.GetPrimAtPath(f"/World/Cameras/{name}")
    frustum = UsdGeom.Camera(prim).GetCamera(Usd.TimeCode.Default()).frustum
    onto_image = frustum.ComputeViewMatrix() * frustum.ComputeProjectionMatrix()
    normal = np.array([onto_image.Transform(Gf.Vec3d(*point)) for point in points])
    width, height = size
    return np.stack([(normal[:, 0] + 1) / 2 * width, (1 - normal[:, 1]) / 2 * height], 1) - 0.5


@pytest.mark.parametrize("up", ["+y", "+z"])
def test_usd_sees_what_the_rig_sees(up):
    rig = ring_rig(cameras=3, size=(1088, 1920), up=up)
    stage = stage_with(rig)
    points = np.random.default_rng(0).uniform(-0.7, 0.7, (50, 3))
    expected = project(rig, points)
    for k, name in enumerate(rig.names):
        assert np.abs(usd_pixels(stage, name, rig.size[k], points) - expected[k]).max() < REPROJECTION_PX


def test_a_rig_reads_back_exactly():
    rig = replace(
        ring_rig(cameras=3, up="-x"),
        names=("cam 1", "cam-1", "1"),
        distortion=np.random.default_rng(1).normal(0, 0.1, (3, 5)),
    )
    again = rig_of(stage_with(rig))
    assert (again.names, again.up) == (rig.names, rig.up)
    for name in ("K", "R", "t", "size", "distortion"):
        np.testing.assert_array_equal(getattr(again, name), getattr(rig, name))


def test_a_missing_rig_or_value_is_named():
    stage = stage_with(ring_rig())
    with pytest.raises(InputError, match=r"a\.usdc: /World: attribute mmocap:cameras is missing"):
        cameras_from_prim(stage.GetPrimAtPath("/World"), "a.usdc")
    scope = stage.GetPrimAtPath("/World/Cameras").GetAttribute("mmocap:cameras")
    named = scope.Get()
    scope.Set([])
    with pytest.raises(InputError, match=r"/World/Cameras: mmocap:cameras names none"):
        rig_of(stage)
    scope.Set(named)
    stage.GetPrimAtPath("/World/Cameras/cam02").RemoveProperty("mmocap:rotation")
    with pytest.raises(InputError, match=r"a\.usdc: /World/Cameras/cam02: attribute mmocap:rotation is missing"):
        rig_of(stage)
