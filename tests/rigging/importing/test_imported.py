"""Bodies of other programs' files: axes, joints, freedom, skin and motions."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_up_rigs import ROBOT, write_creature
from scipy.spatial.transform import Rotation

from mmocap_warp.body.mesh_pieces import is_closed
from mmocap_warp.body.posing import Poser
from mmocap_warp.errors import InputError
from mmocap_warp.formats.exports.glb import write_body_glb
from mmocap_warp.formats.rigged.gltf import read_gltf
from mmocap_warp.formats.rigged.rigged_mesh import RiggedMesh
from mmocap_warp.formats.rigged.urdf import read_urdf
from mmocap_warp.formats.rigged.usd_skel import read_usd_skel
from mmocap_warp.formats.usd.usd_body import read_body, write_body
from mmocap_warp.formats.usd.usd_check import faults
from mmocap_warp.rigging.importing.imported import Imported, imported
from mmocap_warp.rigging.importing.joint_tree import mirrored_pairs, with_one_root
from mmocap_warp.rigging.importing.joints_file import read_joints_file, write_joints_file


@pytest.fixture(scope="module")
def creature(tmp_path_factory: pytest.TempPathFactory) -> RiggedMesh:
    return read_gltf(write_creature(tmp_path_factory.mktemp("creature") / "creature.glb"))


@pytest.fixture(scope="module")
def made(creature: RiggedMesh) -> Imported:
    return imported(creature, "creature")


def test_the_root_is_the_first_joint_that_skin_follows(made: Imported) -> None:
    joints = made.body.skeleton.joints
    assert joints[0] == "hips"
    assert "armature" not in joints
    assert set(joints) == {"hips", "leg.L", "shin.L", "foot.L", "leg.R", "shin.R", "foot.R", "head", "head end"}
    assert any("armature" in note for note in made.notes)


def test_joints_keep_the_files_names_in_every_format(creature: RiggedMesh, tmp_path: Path) -> None:
    new = {"leg.L": "左 足", "leg.R": "右 足", "head": "a/b:c", "head end": "line\nend", "foot.R": "foot.L"}
    mesh = replace(creature, joints=tuple(new.get(name, name) for name in creature.joints))
    body = imported(mesh, "creature").body
    names = body.skeleton.joints
    assert {"左 足", "右 足", "a/b:c", "line_end", "foot.L", "foot.L_2"} < set(names)
    assert ("足", "左 足", "右 足") in body.skeleton.pairs
    write_body(tmp_path / "body.usdc", body)
    assert read_body(tmp_path / "body.usdc").skeleton.joints == names
    assert not faults(tmp_path / "body.usdc")
    again = read_usd_skel(tmp_path / "body.usdc")
    assert again.joints == names
    write_body_glb(body, {}, tmp_path / "body.glb")
    assert [name for name in read_gltf(tmp_path / "body.glb").joints if name in names] == list(names)
    freedom = imported(mesh, "creature").freedom
    write_joints_file(tmp_path / "joints.toml", body, freedom, {"左 足": "hips"})
    assert read_joints_file(tmp_path / "joints.toml").joints["左 足"].parent == "hips"


def test_names_differ_whatever_a_format_makes_of_them_and_join_no_pair(creature: RiggedMesh) -> None:
    new = {"head end": "foot L", "head": "leg+shin", "hips": " ", "shin.R": "=1"}
    names = imported(
        replace(creature, joints=tuple(new.get(name, name) for name in creature.joints)), "x"
    ).body.skeleton
    assert {"foot.L", "foot L_2", "leg_shin", "joint", "=1"} < {*names.joints}
    assert len({re.sub(r"\W", "_", name) for name in names.joints}) == len(names.joints)


def test_a_character_that_stands_askew_is_noted(creature: RiggedMesh, made: Imported) -> None:
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_euler("y", 30, degrees=True).as_matrix()
    askew = imported(replace(creature, bind=turn @ creature.bind, vertex=creature.vertex @ turn[:3, :3].T), "creature")
    assert askew.body.skeleton.pairs == ()
    assert any("names tell left from right, but no joints mirror each other" in note for note in askew.notes)
    assert not any("names tell" in note for note in made.notes)


def test_limbs_are_hinges_about_the_normal_of_their_bend(made: Imported) -> None:
    skeleton = made.body.skeleton
    free = dict(zip(skeleton.joints, (how.free for how in made.freedom), strict=True))
    assert free == {"hips": "xyz", "leg.L": "xyz", "shin.L": "x", "foot.L": "x", "leg.R": "xyz", "shin.R": "x"} | {
        "foot.R": "x",
        "head": "xyz",
        "head end": "",
    }
    for shin in ("shin.L", "shin.R"):
        joint = skeleton.index(shin)
        np.testing.assert_allclose(np.abs(skeleton.frame[joint, :, 0]), (1, 0, 0), atol=1e-6)
        lower, upper = skeleton.limits[joint, 0]
        assert -1.2 < lower < -0.9  # the bend of 53 degrees opens, and a little more
        assert upper > 1.5
    assert len(skeleton.searched()) == 3 + 3 + 2 * 5 + 3


def test_a_hinge_bends_on_where_the_limb_is_bent(made: Imported) -> None:
    """At a positive angle of the shin the foot comes nearer to the hip."""
    body, skeleton = made.body, made.body.skeleton
    pose = np.zeros((2, skeleton.coordinates))
    pose[:, :3] = body.joint_rest[0]
    pose[1, skeleton.angles("shin.L").start] = 0.4
    place = Poser(body, np.eye(3)).joint_transforms(pose)[:, :, :3, 3]
    apart = np.linalg.norm(place[:, skeleton.index("foot.L")] - place[:, skeleton.index("leg.L")], axis=1)
    assert apart[1] < apart[0] - 0.02


def test_pairs_and_parts_come_from_places_and_the_tree(made: Imported) -> None:
    skeleton = made.body.skeleton
    assert {(left, right) for _, left, right in skeleton.pairs} == {
        ("leg.L", "leg.R"), ("shin.L", "shin.R"), ("foot.L", "foot.R"),
    }  # fmt: skip
    assert skeleton.parts == ("hips", "leg.L", "leg.R", "head")
    assert skeleton.parts[skeleton.part[skeleton.index("foot.R")]] == "leg.R"


def test_what_faces_backwards_is_told(creature: RiggedMesh) -> None:
    assert any("--facing" in note for note in imported(creature, "x", facing="-z").notes)
    assert not any("--facing" in note for note in imported(creature, "x").notes)


def test_axes_and_scale(creature: RiggedMesh, made: Imported) -> None:
    turn = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])  # from y up to z up
    lying = replace(
        creature,
        vertex=100 * creature.vertex @ turn.T,
        bind=_turned(creature.bind, turn, 100),
        motions={},
    )
    again = imported(lying, "creature", up="+z", facing="-y", scale=0.01)
    np.testing.assert_allclose(again.body.joint_rest, made.body.joint_rest, atol=1e-6)
    np.testing.assert_allclose(again.body.skeleton.frame, made.body.skeleton.frame, atol=1e-5)
    np.testing.assert_allclose(again.body.skin.rest, made.body.skin.rest, atol=1e-6)
    with pytest.raises(ValueError, match="facing must be across up"):
        imported(creature, "x", up="+z", facing="-z")


def _turned(bind: np.ndarray, turn: np.ndarray, scale: float) -> np.ndarray:
    moved = bind.copy()
    moved[:, :3, :3] = turn @ bind[:, :3, :3]
    moved[:, :3, 3] = scale * bind[:, :3, 3] @ turn.T
    return moved


def test_skin_is_welded_closed_and_follows_four_joints(made: Imported) -> None:
    body = made.body
    assert len(body.skin.rest) == 8 * 8  # of 288 corners of triangles
    assert is_closed(body.tracking_face)
    assert body.volume == pytest.approx(sum(_box_volumes()), rel=1e-5)
    assert any("up to 1.0 % of one's weight was dropped" in note for note in made.notes)
    np.testing.assert_allclose(body.skin.weight.sum(axis=1), 1, atol=1e-6)
    head = body.skin.rest[:, 1] > 1.35
    assert (body.skin.heaviest_joint[head] == body.skeleton.index("head")).all()


def _box_volumes() -> list[float]:
    from made_up_rigs import _BOXES

    return [8 * float(np.prod(half)) for _, half in _BOXES.values()]


def test_a_tracking_mesh_is_made_coarser(creature: RiggedMesh) -> None:
    fine = creature
    for _ in range(3):  # each triangle in four
        corner = fine.vertex[fine.face]
        middle = (corner + np.roll(corner, -1, axis=1)) / 2
        four = np.stack(
            [
                np.stack([corner[:, 0], middle[:, 0], middle[:, 2]], 1),
                np.stack([corner[:, 1], middle[:, 1], middle[:, 0]], 1),
                np.stack([corner[:, 2], middle[:, 2], middle[:, 1]], 1),
                middle,
            ],
            1,
        ).reshape(-1, 3)
        own = np.repeat(fine.face[:, 0], 12)
        fine = replace(
            fine,
            vertex=four,
            face=np.arange(len(four)).reshape(-1, 3),
            influence=fine.influence[own],
            weight=fine.weight[own],
        )
    coarse = imported(fine, "x", triangles=400)
    assert len(coarse.body.tracking_face) == 400
    assert coarse.body.volume == pytest.approx(sum(_box_volumes()), rel=1e-3)
    assert any("triangles made 400" in note for note in coarse.notes)
    shown = imported(fine, "x", triangles=400, skin_triangles=800).body
    assert len(shown.skin.face) == 800
    assert is_closed(shown.skin.face)
    assert len(shown.tracking_face) == 400
    assert is_closed(shown.tracking_face)
    assert shown.volume == pytest.approx(coarse.body.volume, rel=1e-3)


def test_motions_move_the_bodys_joints_as_the_files(creature: RiggedMesh, made: Imported) -> None:
    nod = made.motions["Nod"]
    place = Poser(made.body, np.eye(3)).joint_transforms(nod.pose)[:, :, :3, 3]
    theirs = creature.motions["Nod"].world[:, [creature.joints.index(name) for name in ("hips", "head", "head end")]]
    mine = place[:, [made.body.skeleton.index(name) for name in ("hips", "head", "head end")]]
    np.testing.assert_allclose(mine, theirs[..., :3, 3], atol=1e-5)


def test_a_joints_file_takes_the_place_of_what_is_derived(tmp_path: Path, creature: RiggedMesh, made: Imported) -> None:
    path = tmp_path / "joints.toml"
    write_joints_file(path, made.body, made.proposed, made.parents)
    again = imported(creature, "creature", joints=read_joints_file(path))
    np.testing.assert_allclose(again.body.skeleton.limits, made.body.skeleton.limits, atol=1e-3)
    np.testing.assert_array_equal(again.body.skeleton.searched(), made.body.skeleton.searched())
    path.write_text(
        'root = "fixed"\n[joints.head]\nfree = "x"\nhinge = [0, 1, 0]\nx = [-70, 70]\n[joints."foot.L"]\nfree = ""\n'
        '[joints."foot.R"]\nfree = "xy"\nparent = "hips"\n'
    )
    given = imported(creature, "creature", joints=read_joints_file(path)).body.skeleton
    names = [given.coordinate_names[i] for i in given.searched()]
    assert not any(name.startswith(("T", "hips", "foot.L")) for name in names)
    assert "foot.R.Ry" in names
    assert given.joints[given.parent[given.index("foot.R")]] == "hips"
    np.testing.assert_allclose(given.frame[given.index("head"), :, 0], (0, 1, 0), atol=1e-6)
    np.testing.assert_allclose(given.limits[given.index("head"), 0], np.radians([-70, 70]), rtol=1e-6)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('[joints.tail]\nfree = "x"\n', "there is no joint 'tail'"),
        ('[joints.head]\nfree = "w"\n', "is not known"),
        ("[joints.head]\nx = [3, 1]\n", "upside down"),
        ("[joints.head]\nhinge = [0, 0, 0]\n", "no direction"),
        ("[joints.head]\nlimit = 3\n", "unknown key"),
        ("[joints]\nrigid = true\n", "unknown key 'rigid'"),
        ('root = "loose"\n', "is not known"),
        ("rigid = 1\n", "rigid"),
    ],
)
def test_a_joints_file_that_cannot_be_is_told(tmp_path: Path, creature: RiggedMesh, text: str, said: str) -> None:
    path = tmp_path / "joints.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=said):
        imported(creature, "x", joints=read_joints_file(path))


def test_a_robot_is_rigid_and_turns_about_its_axes(tmp_path: Path) -> None:
    path = tmp_path / "crane.urdf"
    path.write_text(ROBOT)
    crane = imported(read_urdf(path), "crane")
    skeleton = crane.body.skeleton
    assert skeleton.joints == ("base", "slew", "luff", "hoist")
    assert len(skeleton.searched()) == 3  # one chain: its base stands still
    assert crane.body.rigid
    np.testing.assert_allclose(skeleton.frame[1, :, 0], (0, 1, 0), atol=1e-6)  # up
    np.testing.assert_allclose(skeleton.frame[2, :, 0], (0, 0, 1), atol=1e-6)  # +X of the file is ahead
    np.testing.assert_allclose(skeleton.limits[2, 0], (-0.2, 1.2), rtol=1e-6)
    assert is_closed(crane.body.tracking_face)
    assert set(crane.body.skin.weight[:, 0]) == {1.0}
    raised = np.zeros((1, skeleton.coordinates))
    raised[0, skeleton.angles("luff").start] = 1.0
    tip = Poser(crane.body, np.eye(3)).vertices(raised)[0, :, 1].max()
    assert tip == pytest.approx(1.1 + 0.8 * np.sin(1.0) + 0.05 * np.cos(1.0), abs=1e-4)


def test_a_joints_file_frees_a_robots_base_and_its_shape(tmp_path: Path) -> None:
    (tmp_path / "crane.urdf").write_text(ROBOT)
    robot = read_urdf(tmp_path / "crane.urdf")
    path = tmp_path / "joints.toml"
    fixed = imported(robot, "crane")
    write_joints_file(path, fixed.body, fixed.proposed, fixed.parents)
    again = imported(robot, "crane", joints=read_joints_file(path))
    assert (len(again.body.skeleton.searched()), again.body.rigid, again.body.skeleton.stands) == (3, True, True)
    path.write_text('root = "free"\nrigid = false\nstands = false\n')
    freed = imported(robot, "crane", joints=read_joints_file(path))
    assert (len(freed.body.skeleton.searched()), freed.body.rigid, freed.body.skeleton.stands) == (9, False, False)


def test_what_has_two_sides_stands_near_its_bind_pose(creature: RiggedMesh, made: Imported) -> None:
    assert made.body.skeleton.stands
    # Where its motion goes far from there, it may begin as far.
    head = made.body.skeleton.index("head")
    nod = made.motions["Nod"].pose[:, made.body.skeleton.angles("head")]
    assert set(np.delete(made.body.skeleton.spread, head)) == {0.2}
    assert made.body.skeleton.spread[head] == pytest.approx(np.sqrt((nod**2).mean(axis=0)).max())
    assert made.body.skeleton.spread[head] > 0.3
    no_sides = replace(creature, joints=tuple("abcdefghijklmn"[: len(creature.joints)]))
    lying = imported(no_sides, "creature").body.skeleton
    assert not lying.stands
    hinge = int(lying.searched()[-1])
    low, high = lying.coordinate_limits[hinge]
    assert lying.spread[(hinge - 3) // 3] == pytest.approx(max((high - low) / np.sqrt(12), 0.2), rel=1e-5)


def test_joints_side_by_side_are_chained_by_their_names(creature: RiggedMesh) -> None:
    names = ("wrist", "thumb-a", "thumb-b", "index-a", "index-b", "index-c")
    flat = replace(
        creature,
        joints=names,
        parent=(-1,) * 6,
        bind=creature.bind[:6],
        influence=np.minimum(creature.influence, 5),
        motions={},
    )
    hand = with_one_root(flat)
    above = {name: hand.joints[parent] for name, parent in zip(hand.joints, hand.parent, strict=True) if parent >= 0}
    assert above == {"thumb-a": "wrist", "thumb-b": "thumb-a", "index-a": "wrist"} | {
        "index-b": "index-a",
        "index-c": "index-b",
    }
    with pytest.raises(ValueError, match="side by side"):
        with_one_root(replace(flat, joints=("a", "b", "c", "d", "e", "f")))


def test_joints_that_lie_mirrored_but_are_named_otherwise_are_no_pair(creature: RiggedMesh) -> None:
    bind = np.tile(np.eye(4), (5, 1, 1))
    bind[:, :3, 3] = (0, 1, 0), (0.2, 0.5, 0), (-0.2, 0.5, 0), (0.2, 1.5, 0), (-0.2, 1.5, 0)

    def pairs(*joints: str) -> tuple:
        return mirrored_pairs(replace(creature, joints=joints, parent=(-1, 0, 0, 0, 0), bind=bind))

    assert pairs("root", "FL_hip", "FR_hip", "arm", "sensor") == (("F_hip", "FL_hip", "FR_hip"),)
    named = pairs("root", "Leg_2_Left", "Leg_2_Right", "eye_01", "eye_02")
    assert [(left, right) for _, left, right in named] == [("Leg_2_Left", "Leg_2_Right"), ("eye_01", "eye_02")]
