"""A person as other programs' rigs: names, rest pose, and the same motion."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from glb_file import Glb
from measured import answer
from synthetic import synthetic_result

from mmocap_warp.formats.exports.rigs import with_rig
from mmocap_warp.formats.motion.motion_clip import read_bvh
from mmocap_warp.formats.table import export
from mmocap_warp.formats.usd.usd_check import faults
from mmocap_warp.result.result import Result
from mmocap_warp.rigging.shipped import load_body

STRAIGHT = 1e-6  # a bone's direction
PLACE = 2e-6  # [m]
ARMS = ("LeftArm", "LeftForeArm", "LeftHand"), ("RightArm", "RightForeArm", "RightHand")
LEGS = ("LeftUpLeg", "LeftLeg", "LeftFoot"), ("RightUpLeg", "RightLeg", "RightFoot")


def shipped(up: str = "+y") -> Result:
    """A man of the shipped bodies, with soft skin, in motion."""
    result = synthetic_result(frames=5, up=up)
    return replace(result, subject=replace(result.subject, body=load_body("adult_man")))


@pytest.mark.parametrize("make", [synthetic_result, shipped])
def test_the_joints_are_where_they_were_and_the_rest_pose_is_a_t(make):
    result = make(up="+z")
    rig = with_rig(result, "mixamo")
    np.testing.assert_allclose(rig.joints(), result.joints(), rtol=0, atol=PLACE)
    names = [name.removeprefix("mixamorig") for name in rig.subject.body.skeleton.joints]
    place = dict(zip(names, rig.subject.body.joint_rest, strict=True))
    for chains, directions in ((ARMS, ([1, 0, 0], [-1, 0, 0])), (LEGS, ([0, -1, 0], [0, -1, 0]))):
        for chain, direction in zip(chains, directions, strict=True):
            for start, end in pairwise(chain):
                bone = place[end] - place[start]
                np.testing.assert_allclose(bone / np.linalg.norm(bone), direction, rtol=0, atol=STRAIGHT)


def test_the_skin_moves_alike():
    """All of it but what shoulders and hips blend, which the rest pose has moved: there by less than 3 cm."""
    result = shipped()
    rig = with_rig(result, "mixamo")
    off = np.linalg.norm(rig.vertices() - result.vertices(), axis=2)
    skin = result.subject.body.skin
    rigid = skin.weight.max(axis=1) > 1 - 1e-6
    assert rigid.mean() > 0.2
    assert off[:, rigid].max() < PLACE
    assert np.median(off) < 0.001
    assert off.max() < 0.03


def test_a_rig_is_written(tmp_path: Path):
    rig = with_rig(synthetic_result(), "mixamo")
    for suffix in (".glb", ".bvh", ".usda"):
        export(rig, tmp_path / f"a{suffix}")
    assert faults(tmp_path / "a.usda") == []
    assert Glb(tmp_path / "a.glb").faults() == []
    assert read_bvh(tmp_path / "a.bvh").joint_names[0] == "mixamorigHips"
    np.testing.assert_allclose(Glb(tmp_path / "a.glb").skin(), rig.vertices(), rtol=0, atol=PLACE)


def test_what_is_no_person_has_no_rig():
    result = synthetic_result()
    with pytest.raises(ValueError, match=r"rig must be one of \['mixamo', 'unity'\], got 'fuse'"):
        with_rig(result, "fuse")
    renamed = replace(result.subject.body.skeleton, joints=("Tail", *result.subject.body.skeleton.joints[1:]))
    body = replace(result.subject.body, skeleton=renamed)
    with pytest.raises(ValueError, match=r"differ from this body's by \['Root', 'Tail'\]"):
        with_rig(replace(result, subject=replace(result.subject, body=body)), "mixamo")
    hand = load_body("hand")
    held = answer(hand, np.zeros((2, hand.skeleton.coordinates)))
    with pytest.raises(ValueError, match=r"'LHip'\] and 37 more") as refused:
        with_rig(held, "mixamo")
    assert len(str(refused.value)) < 150
