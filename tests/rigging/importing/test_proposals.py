"""What motions show of joints: proposals for a joints file, where joints turn; and how a file's body faces."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_up_rigs import write_creature

from mmocap_warp.body.rotations import turn
from mmocap_warp.formats.rigged.gltf import read_gltf
from mmocap_warp.formats.rigged.rigged_mesh import RiggedMesh, RiggedMotion
from mmocap_warp.rigging.importing.imported import Imported, imported
from mmocap_warp.rigging.importing.joints_file import read_joints_file, write_joints_file


def walking(folder: Path) -> RiggedMesh:
    """A creature that swings its legs anyhow and closes its shins about one axis; its bones lie in no plane.

    Its feet stay as they are, and the left one hangs on the armature.
    """
    mesh = read_gltf(write_creature(folder / "creature.glb"))
    number = {name: joint for joint, name in enumerate(mesh.joints)}
    mesh.bind[[number["shin.L"], number["shin.R"]], 0, 3] = 0.35, -0.35
    when, world = np.linspace(0, 1, 21), np.repeat(mesh.bind[None], 21, axis=0)
    local = np.linalg.inv(world[:, list(mesh.parent)]) @ world
    for side in "LR":
        local[:, number[f"leg.{side}"], :3, :3] = turn("x", when) @ turn("y", when**2)
        local[:, number[f"shin.{side}"], :3, :3] = turn("z", when)
    local[:, number["head"], :3, :3] = turn("y", when) @ turn("z", when**2)
    for joint, above in enumerate(mesh.parent):
        world[:, joint] = local[:, joint] if above < 0 else world[:, above] @ local[:, joint]
    parent = list(mesh.parent)
    parent[number["foot.L"]] = number["armature"]
    return replace(mesh, parent=tuple(parent), motions={"Walk": RiggedMotion(30.0, world)})


@pytest.fixture(scope="module")
def walker(tmp_path_factory: pytest.TempPathFactory) -> RiggedMesh:
    return walking(tmp_path_factory.mktemp("walker"))


@pytest.fixture(scope="module")
def made(walker: RiggedMesh) -> Imported:
    return imported(walker, "creature")


def test_what_motions_propose_goes_through_a_joints_file(tmp_path: Path, walker: RiggedMesh, made: Imported) -> None:
    proposals = [note for note in made.notes if "propose" in note]
    assert proposals == [
        "its motions propose: foot.L, foot.R held, shin.L, shin.R hinges (24 -> 14 angles); "
        "--write-joints FILE.toml writes it to be edited, --joints FILE.toml reads it"
    ]
    path = tmp_path / "joints.toml"
    write_joints_file(path, made.body, made.proposed, made.parents)
    text = path.read_text()
    assert '[joints."foot.L"]  # held, as no motion turns it\nfree = ""\nparent = "shin.L"\n' in text
    assert '[joints."shin.R"]  # hinge, as motions turn it about one axis\nfree = "x"\nhinge = [0, 0, 1]\n' in text
    again = imported(walker, "creature", joints=read_joints_file(path))
    assert len(again.body.skeleton.searched()) == len(made.body.skeleton.searched()) - 10
    assert again.body.skeleton.parent == made.body.skeleton.parent
    assert not [note for note in again.notes if "propose" in note]
    np.testing.assert_allclose(again.body.skin.rest, made.body.skin.rest, atol=1e-7)
    np.testing.assert_array_equal(again.body.tracking_face, made.body.tracking_face)
    # What is written of what was read is the same, so that a second edit begins where the first ended.
    write_joints_file(tmp_path / "again.toml", again.body, again.proposed, again.parents)
    lines = [
        [each.partition("  #")[0] for each in (tmp_path / name).read_text().splitlines()]
        for name in ("joints.toml", "again.toml")
    ]
    assert [line for line in lines[0] if line not in lines[1]] == []


def test_a_motion_of_one_joint_proposes_nothing(tmp_path: Path) -> None:
    made = imported(read_gltf(write_creature(tmp_path / "creature.glb")), "creature")
    assert made.motions
    assert not [note for note in made.notes if "propose" in note]
    assert [how.origin for how in made.proposed] == [how.origin for how in made.freedom]


def test_a_body_that_faces_aside_is_turned_by_its_left_and_right(walker: RiggedMesh, made: Imported) -> None:
    quarter = np.eye(4)
    quarter[:3, :3] = turn("y", np.array(np.pi / 2))
    aside = replace(
        walker,
        bind=quarter @ walker.bind,
        vertex=walker.vertex @ quarter[:3, :3].T,
        motions={"Walk": RiggedMotion(30.0, quarter @ walker.motions["Walk"].world)},
    )
    turned = imported(aside, "creature")
    assert "its left and right show that it faces aside: turned" in turned.notes
    assert turned.body.skeleton.pairs == made.body.skeleton.pairs
    np.testing.assert_allclose(turned.body.joint_rest, made.body.joint_rest, atol=1e-6)
    told = imported(aside, "creature", facing="+z")  # who says how it faces is believed
    assert not told.body.skeleton.pairs


def test_a_joint_is_put_where_its_motions_turn_it(walker: RiggedMesh, made: Imported) -> None:
    """An artist swings a leg about a point below its hip, and brings it back with translations."""
    leg, away = walker.joints.index("leg.L"), np.eye(4)
    away[:3, 3] = 0.1, -0.3, 0.05
    bind, world = walker.bind.copy(), walker.motions["Walk"].world.copy()
    bind[leg], world[:, leg] = bind[leg] @ away, world[:, leg] @ away
    again = imported(replace(walker, bind=bind, motions={"Walk": RiggedMotion(30.0, world)}), "creature")
    np.testing.assert_allclose(again.body.joint_rest, made.body.joint_rest, atol=1e-5)
    assert any("joints within 0.0 mm" in note for note in again.notes)


def test_left_and_right_may_begin_at_one_place(walker: RiggedMesh, made: Imported) -> None:
    bind = walker.bind.copy()
    bind[[walker.joints.index(f"leg.{side}") for side in "LR"], 0, 3] = 0.0
    together = imported(replace(walker, bind=bind, motions={}), "creature").body.skeleton.pairs
    assert together == made.body.skeleton.pairs[:2]  # without motions the left foot hangs on the armature


def bending(folder: Path, joint: str, axis: str) -> RiggedMesh:
    """A creature that turns one joint about an axis; its bones lie in planes, and its left leg has no skin."""
    mesh = read_gltf(write_creature(folder / "creature.glb"))
    number = {name: joint for joint, name in enumerate(mesh.joints)}
    world = np.repeat(mesh.bind[None], 21, axis=0)
    local = np.linalg.inv(world[:, list(mesh.parent)]) @ world
    local[:, number[joint], :3, :3] = turn(axis, np.linspace(0, 1, 21))
    for each, above in enumerate(mesh.parent):
        world[:, each] = local[:, each] if above < 0 else world[:, above] @ local[:, each]
    influence = np.where(mesh.influence == number["leg.L"], number["hips"], mesh.influence)
    return replace(mesh, influence=influence, motions={"Bend": RiggedMotion(30.0, world)})


@pytest.mark.parametrize(
    ("joint", "axis", "free"),
    [
        ("shin.R", "x", {"shin.R": "x", "leg.L": "", "shin.L": "xyz"}),  # a handle that none turns begins no limb
        ("shin.R", "z", {"shin.R": "xyz", "leg.L": "", "shin.L": "xyz"}),  # bones say hinge, motions say otherwise
        ("leg.L", "x", {"shin.R": "x", "leg.L": "xyz", "shin.L": "x"}),
    ],
)
def test_motions_tell_hinges_and_handles(tmp_path: Path, joint: str, axis: str, free: dict[str, str]) -> None:
    made = imported(bending(tmp_path, joint, axis), "creature")
    found = dict(zip(made.body.skeleton.joints, made.freedom, strict=True))
    assert {name: found[name].free for name in free} == free
    assert any("joints within 0.0 mm" in note for note in made.notes)


def test_a_root_that_few_vertices_follow_is_no_part_of_the_body(tmp_path: Path) -> None:
    mesh = read_gltf(write_creature(tmp_path / "creature.glb"))
    mesh.influence[0, 1] = mesh.joints.index("armature")
    made = imported(mesh, "creature")
    assert made.body.skeleton.joints[0] == "hips"
    assert any("armature move no skin: left out" in note for note in made.notes)
