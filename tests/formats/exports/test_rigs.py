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

import mmocap_warp as mm
from mmocap_warp.body.model import joint_transforms
from mmocap_warp.body.rotations import transposed
from mmocap_warp.errors import UsageError
from mmocap_warp.formats.exports.rigs import RIGS, with_rig
from mmocap_warp.formats.motion.motion_clip import read_bvh
from mmocap_warp.formats.table import export
from mmocap_warp.formats.usd.usd_check import faults
from mmocap_warp.result.result import Result
from mmocap_warp.rigging.shipped import load_body

STRAIGHT = 1e-6  # a bone's direction
PLACE = 2e-6  # [m]
READ_BACK, TURNED = 0.5e-3, 0.2  # [m], [degrees] that a file may be off
LIMBS = ("UpperLeg", "LowerLeg", "Foot", "UpperArm", "LowerArm", "Hand")
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


def body_motion(result: Result) -> tuple[np.ndarray, np.ndarray]:
    """Of the best run: places (frame, joint, 3) [m] and turns since the first frame (frame, joint, 3, 3)."""
    world = joint_transforms(result.subject, result.pose[result.best_run])[1]
    return world[..., :3, 3], world[..., :3, :3] @ transposed(world[0, :, :3, :3])


@pytest.mark.parametrize("rig", RIGS)
def test_a_rig_is_read_back_as_its_programs_read_it(rig, tmp_path):
    """From the rest pose that a file has, by the turns that it has, to the joints that were tracked."""
    result = shipped()
    known = RIGS[rig]
    names = [known.names[joint] for joint in result.subject.body.skeleton.joints]
    place, turned = body_motion(result)
    named = with_rig(result, rig)
    export(named, tmp_path / "a.glb")
    glb = Glb(tmp_path / "a.glb")
    worlds = glb.joint_worlds()
    assert [glb.json["nodes"][number]["name"] for number in glb.json["skins"][0]["joints"]] == names
    np.testing.assert_allclose(worlds[..., :3, 3], place, rtol=0, atol=READ_BACK)
    bind = np.linalg.inv(glb.array(glb.json["skins"][0]["inverseBindMatrices"]).reshape(-1, 4, 4).swapaxes(1, 2))
    # Who retargets asks the nodes for the rest pose.
    np.testing.assert_allclose(glb.joint_worlds(played=False)[0], bind, rtol=0, atol=PLACE)
    from_rest = worlds[..., :3, :3] @ transposed(bind[:, :3, :3])
    assert angle(from_rest @ transposed(from_rest[0]), turned) < TURNED
    # Bones point as the rest pose says, and the turns take them to where they were tracked.
    skeleton = result.subject.body.skeleton
    for start, (end, direction) in known.bones.items():
        a, b = skeleton.index(start), skeleton.index(end)
        bone = bind[b, :3, 3] - bind[a, :3, 3]
        np.testing.assert_allclose(bone / np.linalg.norm(bone), direction, rtol=0, atol=1e-5)
        np.testing.assert_allclose(from_rest[:, a] @ bone, place[:, b] - place[:, a], rtol=0, atol=READ_BACK)
    export(named, tmp_path / "a.bvh")
    read = read_bvh(tmp_path / "a.bvh")
    order = [read.joint_names.index(name) for name in names]
    np.testing.assert_allclose(read.place[:, order] / 100, place, rtol=0, atol=READ_BACK)
    assert angle(read.rotation[:, order], from_rest) < TURNED  # as SOMA's poses are: from a T, in the world's axes


def angle(a: np.ndarray, b: np.ndarray) -> float:
    """The largest angle between rotations [degrees]."""
    cosine = (np.trace(a @ transposed(b), axis1=-2, axis2=-1) - 1) / 2
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))).max())


def test_a_vrm_animation_says_which_node_is_which_bone_and_rests_in_a_t(tmp_path):
    result = shipped()
    export(with_rig(result, "vrm"), tmp_path / "a.vrma")
    glb = Glb(tmp_path / "a.vrma")
    assert glb.faults() == []
    bones = glb.json["extensions"]["VRMC_vrm_animation"]["humanoid"]["humanBones"]
    # All that VRM requires are there.
    required = ["hips", "spine", "head", *(f"{side}{part}" for side in ("left", "right") for part in LIMBS)]
    assert set(required) <= set(bones)
    nodes = glb.json["nodes"]
    assert all(nodes[bone["node"]]["name"] == name for name, bone in bones.items())
    # What a node has of its own is the rest pose: no turn, arms along x.
    assert all(nodes[bone["node"]]["rotation"] == [0, 0, 0, 1] for bone in bones.values())
    hand = nodes[bones["leftHand"]["node"]]["translation"]
    np.testing.assert_allclose(hand / np.linalg.norm(hand), [1, 0, 0], rtol=0, atol=1e-6)
    np.testing.assert_allclose(
        nodes[bones["hips"]["node"]]["translation"], result.subject.body.joint_rest[0], rtol=0, atol=PLACE
    )
    np.testing.assert_allclose(glb.joint_worlds()[..., :3, 3], body_motion(result)[0], rtol=0, atol=READ_BACK)


def test_a_vrm_animation_has_no_other_rig(tmp_path):
    with pytest.raises(UsageError, match=r"rig mixamo cannot be in a .vrma"):
        mm.export("walk.usdc", tmp_path / "a.vrma", rig="mixamo")


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
    with pytest.raises(ValueError, match=r"rig must be one of \['mixamo', .*\], got 'fuse'"):
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
