"""Things that a body carries: where they are, how they move, that they keep their size, and what is refused."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from other_bodies import burdened, quadruped, things
from synthetic import ring_rig

from mmocap_warp.biomechanics.measure_all import bone_lengths
from mmocap_warp.body.mesh_pieces import is_closed
from mmocap_warp.body.model import BodyModel, Subject, joint_transforms
from mmocap_warp.body.posing import Poser
from mmocap_warp.body.rest_space import RestSpace
from mmocap_warp.body.rotations import turn, zyx_rotation
from mmocap_warp.errors import InputError
from mmocap_warp.formats.attachments import Attachment, attachment_lines, take_attachments
from mmocap_warp.formats.exports.rigs import with_rig
from mmocap_warp.formats.toml_table import load_toml
from mmocap_warp.formats.usd.usd_body import read_body, write_body
from mmocap_warp.result.excerpt import at_rate
from mmocap_warp.result.result import Result
from mmocap_warp.rigging.attaching import carrying, subject_carrying
from mmocap_warp.rigging.shipped import deviation_factors, load_body
from mmocap_warp.synthesis.exact_posing import ExactPoser
from mmocap_warp.tracking.limb_pairs import limb_pairs, limbs

BASE = turn("x", 1.3) @ turn("z", 0.4)


def box_of(body: BodyModel, name: str) -> np.ndarray:
    """(vertex, 3) of a thing in the bind pose."""
    return body.skin.rest[body.skin.heaviest_joint == body.skeleton.index(name)].astype(float)


def anywhere(body: BodyModel, frames: int = 3) -> np.ndarray:
    return np.random.default_rng(1).normal(0, 0.5, (frames, body.skeleton.coordinates))


def result_of(body: BodyModel, pose: np.ndarray) -> Result:
    frames, rig = len(pose), ring_rig(2)
    subject = Subject(body, BASE, pose[0], {})
    shape = (1, frames)
    return Result(
        subject=subject, cameras=rig, fps=60.0, frame_numbers=np.arange(frames), pose=pose[None],
        cost=np.zeros(shape), iou=np.ones((*shape, 2)), evaluations=np.zeros(shape, int),
        status=np.zeros(shape, np.int8), seconds=1.0, config={}, versions={},
    )  # fmt: skip


def test_what_the_skeleton_gets() -> None:
    plain, skeleton = quadruped().skeleton, burdened().skeleton
    assert skeleton.joints == (*plain.joints, "Stick", "Wheel", "Block_place", "Block")
    assert [skeleton.joints[parent] for parent in skeleton.parent[-4:]] == ["Head", "LForeHip", "Trunk", "Block_place"]
    (number,) = skeleton.models
    assert number == next(iter(plain.models)), "models are named by what is the body's own"
    added = [skeleton.coordinate_names[i] for i in skeleton.searched()][number:]
    assert added == ["Wheel.Rz", *(f"Block_place.T{axis}" for axis in "xyz"), *(f"Block.R{axis}" for axis in "xyz")]
    assert list(skeleton.searched_by_part())[-2:] == ["Wheel", "Block"]
    assert (skeleton.evaluation_groups, skeleton.ends) == (plain.evaluation_groups, plain.ends)
    before, after = ({limb.name: limb for limb in limbs(each)} for each in (plain, skeleton))
    assert [name for name in after if name not in before] == ["Wheel", "Block"]
    for name, limb in before.items():
        np.testing.assert_array_equal(after[name].reach, limb.reach)
        np.testing.assert_array_equal(after[name].coordinates, limb.coordinates)
    assert len(limb_pairs(skeleton)) == len(limb_pairs(plain))


def test_a_thing_lies_where_it_is_said_to() -> None:
    plain, body = quadruped(), burdened()
    trunk, block = plain.joint_rest[0], box_of(body, "Block")
    centre = trunk + np.array([0.3, -0.2, 0.6])
    np.testing.assert_allclose(block.mean(axis=0), centre, atol=1e-6)
    own = (block - centre) @ turn("x", np.radians(30))  # undone
    np.testing.assert_allclose(np.abs(own).max(axis=0), 0.1, atol=1e-6)
    np.testing.assert_array_equal(body.own_vertex[: len(plain.skin.rest)], True)
    assert not body.own_vertex[len(plain.skin.rest) :].any()
    assert is_closed(body.tracking_face)
    assert is_closed(body.skin.face)
    assert body.volume == pytest.approx(plain.volume + 8 * (0.25 * 0.03**2 + 0.08**3 + 0.1**3), rel=1e-5)


def test_every_poser_agrees() -> None:
    """Kernels, the twin in double precision, and what exports and USD are written with."""
    body, pose = burdened(), anywhere(burdened())
    exact = ExactPoser(body, BASE).joint_transforms(pose)
    np.testing.assert_allclose(Poser(body, BASE).joint_transforms(pose), exact, atol=1e-5)
    np.testing.assert_allclose(Poser(body, BASE).vertices(pose), ExactPoser(body, BASE).vertices(pose), atol=1e-5)
    _, world = joint_transforms(Subject(body, BASE, pose[0], {}), pose)
    np.testing.assert_allclose(world, exact, atol=1e-6)


def test_coordinates_of_a_free_thing() -> None:
    """Shifts run along its own axes in the bind pose, then it turns about them."""
    body = burdened()
    skeleton, rest = body.skeleton, np.zeros(body.skeleton.coordinates)
    moved = rest.copy()
    moved[skeleton.angles("Block_place")] = 0.1, -0.2, 0.3
    moved[skeleton.angles("Block")] = 0.4, 0.5, -0.6
    before, after = ExactPoser(body, np.eye(3)).joint_transforms(np.stack([rest, moved]))[:, -1]
    np.testing.assert_allclose(after[:3, 3] - before[:3, 3], turn("x", np.radians(30)) @ (0.1, -0.2, 0.3), atol=1e-7)
    np.testing.assert_allclose(before[:3, :3].T @ after[:3, :3], zyx_rotation(np.array([0.4, 0.5, -0.6])), atol=1e-7)


def test_things_keep_their_size_and_their_way_from_the_joint() -> None:
    body = burdened()
    space = RestSpace(body)
    beta = np.random.default_rng(2).normal(size=len(space.names)) * space.sigma
    names = [name.split(".")[-1] for name in space.names]
    assert not {"Stick", "Wheel", "Block", "Block_place"} & set(names)
    for other in (space.model(beta), body.shaped({}, 1.3)):
        for name, carrier in (("Stick", "Head"), ("Wheel", "LForeHip"), ("Block", "Trunk")):
            joint = body.skeleton.index(carrier)
            for moved in (box_of(other, name), other.joint_rest[[other.skeleton.index(name)]]):
                same = box_of(body, name) if len(moved) > 1 else body.joint_rest[[body.skeleton.index(name)]]
                np.testing.assert_allclose(moved - other.joint_rest[joint], same - body.joint_rest[joint], atol=1e-6)


def test_a_mesh_that_is_open_fine_or_in_pieces_is_made_fit(tmp_path: Path) -> None:
    box = trimesh.creation.box((0.2, 0.2, 0.2))
    trimesh.Trimesh(box.vertices, box.faces[2:]).export(tmp_path / "open.obj")
    trimesh.creation.icosphere(subdivisions=4, radius=0.1).export(tmp_path / "ball.stl")
    made, notes = carrying(
        quadruped(), [Attachment(n, tmp_path / f, "Head") for n, f in (("Open", "open.obj"), ("Ball", "ball.stl"))]
    )
    assert notes == (
        "Open: open.obj 1 hole filled",
        "Ball: tracking mesh: 5120 triangles made 600",
    )
    assert is_closed(made.tracking_face)
    moved = replace(quadruped(), motion_poses=np.ones((2, quadruped().skeleton.coordinates)))
    carrier = carrying(moved, [Attachment("Ball", tmp_path / "ball.stl", "Head")])[0]
    assert carrier.motion_poses is not None
    own = np.arange(carrier.skeleton.coordinates) < moved.skeleton.coordinates
    np.testing.assert_array_equal(carrier.motion_poses, [own, own])
    again, notes = carrying(made, [Attachment("Ball", tmp_path / "ball.stl", "Head")])
    assert again is made
    assert notes == ()


def test_a_person_carries_it_through_files_and_shapes(tmp_path: Path) -> None:
    with things() as (stick, *_):
        body = carrying(load_body("adult_man"), [replace(stick, joint="RWrist")])[0]
    assert body.skin.face.shape[1] == 4
    write_body(tmp_path / "body.usdc", body)
    back = read_body(tmp_path / "body.usdc")
    assert (back.skeleton.attached, back.skeleton.sliding) == (("Stick",), ())
    assert list(back.skeleton.models) == [39, 28, 51]
    taller = body.shaped({"arm_length_incr": 0.5, "height_incr": 0.5})
    wrist = body.skeleton.index("RWrist")
    for each in (body, taller):
        np.testing.assert_allclose(
            box_of(each, "Stick").mean(axis=0) - each.joint_rest[wrist], stick.position, atol=1e-5
        )
    plain = load_body("adult_man")
    factors, of_plain = deviation_factors(body), deviation_factors(plain)
    assert factors is not None
    assert of_plain is not None
    np.testing.assert_array_equal(factors.joint, [*of_plain.joint, [1, 1, 1]])
    lengths = [
        bone_lengths(Subject(each, np.eye(3), np.zeros(each.skeleton.coordinates), {})) for each in (body, plain)
    ]
    assert lengths[0] == lengths[1]


def test_a_rig_of_another_program_carries_it() -> None:
    with things() as (stick, _, block):
        body = carrying(load_body("adult_man"), [replace(stick, joint="RWrist"), block])[0]
    result = result_of(body, anywhere(body, 4) / 4)
    made = with_rig(result, "mixamo")
    assert made.subject.body.skeleton.joints[-3:] == ("Stick", "Block_place", "Block")
    np.testing.assert_allclose(made.joints()[0], result.joints()[0], atol=1e-5)


def test_shifts_between_frames_lie_on_a_line() -> None:
    body = burdened()
    pose = np.zeros((2, body.skeleton.coordinates))
    pose[1, body.skeleton.angles("Block_place")] = 4.0, 5.0, 6.0
    between = at_rate(result_of(body, pose), 120.0).pose[0]
    np.testing.assert_allclose(between[1, body.skeleton.angles("Block_place")], (2.0, 2.5, 3.0))


def test_a_subject_gets_it_in_its_bind_pose() -> None:
    plain = quadruped()
    subject = Subject(plain, BASE, anywhere(plain, 1)[0], {"made": "here"})
    with things() as carried:
        made, _ = subject_carrying(subject, carried)
    np.testing.assert_array_equal(made.pose[: len(subject.pose)], subject.pose)
    assert not made.pose[len(subject.pose) :].any()


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    with things() as carried:
        (tmp_path / "scene.toml").write_text("\n".join(attachment_lines(carried, tmp_path)))
        again = take_attachments(load_toml(tmp_path / "scene.toml"), tmp_path)
        assert [replace(each, mesh=each.mesh.resolve(), source="attach") for each in again] == [
            replace(each, mesh=each.mesh.resolve()) for each in carried
        ]


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "no mesh": ({"mesh": Path("nowhere.obj")}, "nowhere.obj: no such file"),
    "no mesh's ending": ({"mesh": Path(__file__)}, r"attach: names the mesh test_attaching.py, of a kind that is not"),
    "joint": ({"joint": "Hed"}, "no joint 'Hed'; use one of its own, such as Head"),
    "name": ({"name": "Head"}, "has a joint or a part of that name; name it differently"),
    "millimetres": ({"scale": 1000.0}, r"stick.obj is 500 m long, the body 1.1 m; set scale to its unit in metres"),
    "kilometres": ({"scale": 0.001}, r"stick.obj is 0.0005 m long"),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_what_cannot_be_is_refused_in_one_line(wrong: str) -> None:
    change, message = WRONG[wrong]
    with things() as (stick, *_), pytest.raises(InputError) as caught:
        carrying(quadruped(), [replace(stick, **change)])
    assert re.search(message, str(caught.value)), str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_no_mesh_is_refused(tmp_path: Path) -> None:
    (tmp_path / "bat.stl").write_text("solid bat")
    with pytest.raises(InputError, match=r"bat\.stl"):
        carrying(quadruped(), [Attachment("Bat", tmp_path / "bat.stl", "Head")])


def test_triangles_without_area_are_refused(tmp_path: Path) -> None:
    (tmp_path / "line.obj").write_text("v 0 0 0\nv 0.5 0 0\nf 1 2 2\n")
    with pytest.raises(InputError, match=r"line\.obj has no triangles of any area"):
        carrying(quadruped(), [Attachment("Line", tmp_path / "line.obj", "Head")])
