"""Acclaim's clips as BVH: a tiny one made by hand, with places worked out on paper."""

from __future__ import annotations

import numpy as np
import pytest
from acclaim_to_bvh import bvh_of_amc

from mmocap_warp.body.rotations import turn
from mmocap_warp.errors import InputError
from mmocap_warp.formats.motion.motion_clip import read_bvh

ASF = """\
# a root and two bones
:version 1.10
:root
   order TX TY TZ RX RY RZ
   axis XYZ
   position 0 0 0
   orientation 0 0 0
:bonedata
  begin
    id 1
    name lfemur
    direction 0 -1 0
    length 4
    axis 0 0 90 XYZ
    dof rx ry rz
    limits (-160.0 20.0)
           (-70.0 70.0)
           (-60.0 70.0)
  end
  begin
    id 2
    name ltibia
    direction 0 -2 0
    length 3
    axis 0 0 0 XYZ
  end
:hierarchy
  begin
    root lfemur
    lfemur ltibia
  end
"""
AMC = """\
#!OML:ASF
:FULLY-SPECIFIED
:DEGREES
1
root 0 7 0 0 0 0
lfemur 0 0 0
2
root 1 7 0 0 0 0
lfemur 0 90 0
"""


@pytest.fixture
def asf(tmp_path):
    (tmp_path / "07.asf").write_text(ASF)
    (tmp_path / "07_02.amc").write_text(AMC)
    return tmp_path / "07_02.amc"


def test_amc_turns_about_the_bones_own_axes(asf, tmp_path):
    (tmp_path / "x.bvh").write_text(bvh_of_amc(asf))
    clip = read_bvh(tmp_path / "x.bvh")
    assert clip.joint_names == ("root", "lfemur", "ltibia")
    assert clip.fps == pytest.approx(120.0)
    np.testing.assert_allclose(clip.rest, [[0, 0, 0], [0, 0, 0], [0, -4, 0]])
    np.testing.assert_allclose(clip.place[0], [[0, 7, 0], [0, 7, 0], [0, 3, 0]], atol=1e-7)
    # The femur's axes are turned by 90 degrees about z, so its y is the world's -x, about which -y turns to +z.
    np.testing.assert_allclose(clip.place[1], [[1, 7, 0], [1, 7, 0], [1, 7, 4]], atol=1e-7)
    np.testing.assert_allclose(clip.rotation[1, 2], turn("x", -np.pi / 2), atol=1e-7)


@pytest.mark.parametrize(
    ("file", "old", "new", "says"),
    [
        ("07.asf", "length 4", "", "lfemur.*length"),
        ("07.asf", "order TX TY TZ RX RY RZ", "", "no root"),
        ("07.asf", "lfemur ltibia\n  end", "lfemur lfoot\n  end", "lfoot"),
        ("07.asf", "    root lfemur\n", "", "before its parent"),
        ("07.asf", "dof rx ry rz", "dof l", "dof l"),
        ("07_02.amc", "lfemur 0 90 0", "lfemur 0 90", "line 9.*lfemur"),
        ("07_02.amc", "lfemur 0 90 0", "lhand 0 90 0", "line 9.*lhand"),
        ("07_02.amc", "root 1 7 0 0 0 0\n", "", "without a root"),
        ("07_02.amc", "0 90 0", "0 ninety 0", "line 9.*ninety"),
    ],
)
def test_wrong_acclaim_files_say_where(asf, file, old, new, says):
    path = asf.with_name(file)
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(InputError, match=says):
        bvh_of_amc(asf)


def test_a_direction_of_two_numbers(tmp_path):
    bone = "begin\nname a\ndirection 0 1\nlength 1\naxis 0 0 0 XYZ\nend\n"
    (tmp_path / "a.asf").write_text(f":root\norder tx ty tz rx ry rz\n:bonedata\n{bone}:hierarchy\nroot a\n")
    (tmp_path / "a_1.amc").write_text("1\nroot 0 0 0 0 0 0\n")
    with pytest.raises(InputError, match=r"bone a is not complete .direction 0 1 is not three numbers"):
        bvh_of_amc(tmp_path / "a_1.amc")


def test_a_missing_skeleton_is_named(asf, tmp_path):
    with pytest.raises(InputError, match=r"other\.asf"):
        bvh_of_amc(asf, tmp_path / "other.asf")
