"""Characters as artists make them: feet on inverse kinematics, meshes without a skin, several pieces, mirrored axes."""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh
from made_up_rigs import JOINTS, write_creature

from mmocap_warp.body.mesh_pieces import is_closed
from mmocap_warp.body.rotations import applied, nearest_rotation, turn
from mmocap_warp.cli import main
from mmocap_warp.formats.rigged.gltf import read_gltf
from mmocap_warp.formats.rigged.rigged_mesh import RiggedMesh, RiggedMotion
from mmocap_warp.kernels.contour import descent
from mmocap_warp.rigging.importing.closing import closed, closed_pieces
from mmocap_warp.rigging.importing.freedom import MOST_SEARCHED
from mmocap_warp.rigging.importing.imported import imported
from mmocap_warp.rigging.importing.joint_tree import with_moving_parents
from mmocap_warp.rigging.importing.joints_file import GivenJoint, GivenJoints


def creature(folder: Path, **changes) -> RiggedMesh:
    return read_gltf(write_creature(folder / "creature.glb", **changes))


def changed_glb(path: Path, change) -> Path:
    """The file with its JSON changed in place."""
    data = path.read_bytes()
    size = struct.unpack_from("<I", data, 12)[0]
    document = json.loads(data[20 : 20 + size])
    change(document)
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    rest = struct.pack("<II", len(text), 0x4E4F534A) + text + data[20 + size :]
    path.write_bytes(struct.pack("<III", 0x46546C67, 2, 12 + len(rest)) + rest)
    return path


def with_a_twin(document: dict) -> None:
    """Another creature stands beside the first, and nods at another time; one node above both is no joint."""
    nodes, count = document["nodes"], len(document["nodes"])
    for node in list(nodes):
        twin = dict(node)
        twin["name"] = f"Twin's {node['name']}"
        twin["children"] = [child + count for child in node.get("children", [])]
        nodes.append(twin | ({"skin": 1} if "skin" in node else {}))
    nodes[count]["translation"] = [3.0, 0.0, 0.0]
    nodes.append({"name": "Scene", "children": [0, count - 1, count, 2 * count - 1]})
    skin = document["skins"][0]
    document["skins"].append({**skin, "joints": [joint + count for joint in skin["joints"]]})
    nod = document["animations"][0]
    channels = [
        {**each, "target": {**each["target"], "node": each["target"]["node"] + count}} for each in nod["channels"]
    ]
    document["animations"].append({**nod, "name": "TwinNod", "channels": channels})


def test_of_two_characters_in_a_file_one_is_named(tmp_path: Path, capsys) -> None:
    file, output = changed_glb(write_creature(tmp_path / "two.glb"), with_a_twin), str(tmp_path / "one.usda")
    assert main(["body", "import", str(file), "-o", output]) == 3
    assert "holds 2 characters; choose one with --character: Creature, Twin's Creature" in capsys.readouterr().err
    assert main(["body", "import", str(file), "-o", output, "--character", "Creatur"]) == 3
    assert "and not one that is called 'Creatur'" in capsys.readouterr().err
    assert main(["body", "import", str(file), "-o", output, "--character", "Twin's Creature"]) == 0
    twin, alone = read_gltf(file, "Twin's Creature"), creature(tmp_path)
    assert twin.joints == tuple(f"Twin's {name}" for name in alone.joints)
    assert list(twin.motions) == ["TwinNod"]
    np.testing.assert_allclose(twin.vertex, alone.vertex + np.array([3.0, 0.0, 0.0]), atol=1e-6)


def test_two_skins_on_joints_of_one_tree_are_one_character(tmp_path: Path) -> None:
    def on_its_head(document: dict) -> None:
        with_a_twin(document)
        twin = document["nodes"][-1]["children"].pop(2)
        document["nodes"][list(JOINTS).index("head")].setdefault("children", []).append(twin)

    mesh = read_gltf(changed_glb(write_creature(tmp_path / "tall.glb"), on_its_head))
    assert mesh.name == "Creature"
    assert len(mesh.joints) == 2 * len(JOINTS)
    assert list(mesh.motions) == ["Nod", "TwinNod"]


def test_feet_that_hang_on_the_root_are_hung_on_what_they_move_with(tmp_path: Path) -> None:
    mesh = creature(tmp_path)
    number = {name: joint for joint, name in enumerate(mesh.joints)}
    # The body strides ahead by two metres, and swings its left shin; the foot hangs on the armature.
    world = np.repeat(mesh.bind[None], 21, axis=0)
    world[:, 1:, 2, 3] += np.linspace(0, 2, 21)[:, None]
    swing = np.linspace(0, 1, 21)
    swung = turn("x", swing)
    at = world[:, number["shin.L"], :3, 3].copy()
    for name in ("shin.L", "foot.L"):
        joint = number[name]
        world[:, joint, :3, 3] = at + np.einsum("fab,fb->fa", swung, world[:, joint, :3, 3] - at)
        world[:, joint, :3, :3] = swung
    parent = list(mesh.parent)
    parent[number["foot.L"]] = number["armature"]
    mesh = replace(mesh, parent=tuple(parent), motions={"Stride": RiggedMotion(30.0, world)})
    made = imported(mesh, "creature")
    skeleton = made.body.skeleton
    assert skeleton.joints[skeleton.parent[skeleton.index("foot.L")]] == "shin.L"
    assert any("foot.L moves with shin.L, not with armature" in note for note in made.notes)
    assert any("joints within 0.0 mm" in note for note in made.notes)


def test_what_moves_a_little_like_another_joint_is_not_hung_on_it(tmp_path: Path) -> None:
    mesh = creature(tmp_path)
    one, other = (mesh.joints.index(f"foot.{side}") for side in "LR")
    world = np.repeat(mesh.bind[None], 21, axis=0)
    away = 0.2 * np.ptp(mesh.vertex) * np.linspace(0, 1, 21)
    world[:, one, 2, 3] += away
    world[:, other, 2, 3] += away / 2
    assert with_moving_parents(replace(mesh, motions={"Jump": RiggedMotion(30.0, world)})).parent == mesh.parent


def test_held_joints_and_limits_are_as_the_files_motions_have_them(tmp_path: Path) -> None:
    mesh = creature(tmp_path)
    world = np.repeat(mesh.bind[None], 21, axis=0)
    turned = {}
    for name, angle in (("shin.L", np.linspace(0, -2.6, 21)), ("foot.L", np.full(21, 1.2))):
        joint = mesh.joints.index(name)
        above = turned.get(mesh.parent[joint], np.tile(np.eye(3), (21, 1, 1)))
        turned[joint] = above @ turn("x", angle)
        shift = mesh.bind[joint, :3, 3] - mesh.bind[mesh.parent[joint], :3, 3]
        world[:, joint, :3, 3] = world[:, mesh.parent[joint], :3, 3] + applied(above, shift)
        world[:, joint, :3, :3] = turned[joint] @ mesh.bind[joint, :3, :3]
    mesh = replace(mesh, motions={"Kick": RiggedMotion(30.0, world)})
    held = GivenJoints("", joints={"foot.L": GivenJoint("", None, {}, None, None)})
    made = imported(mesh, "creature", joints=held)
    skeleton, pose = made.body.skeleton, made.motions["Kick"].pose
    np.testing.assert_allclose(pose[:, skeleton.angles("foot.L")], 0, atol=1e-6)
    low, high = skeleton.coordinate_limits[skeleton.searched()].T
    seen = pose[:, skeleton.searched()]
    assert ((low <= seen) & (seen <= high)).all()
    assert any("joints within 0.0 mm" in note for note in made.notes)
    assert made.outline.overlap > 0.97


def test_a_mesh_without_a_skin_follows_the_joint_that_it_hangs_on(tmp_path: Path) -> None:
    def hang_a_hat(document: dict) -> None:
        names = [node["name"] for node in document["nodes"]]
        attributes = document["meshes"][0]["primitives"][0]["attributes"]
        document["meshes"].append({"primitives": [{"attributes": {"POSITION": attributes["POSITION"]}}]})
        hat = {"name": "hat", "mesh": 1, "scale": [0.1, 0.1, 0.1], "translation": [0, 0.5, 0]}
        document["nodes"].append(hat)
        document["nodes"][names.index("head")]["children"].append(len(document["nodes"]) - 1)

    plain = creature(tmp_path)
    mesh = read_gltf(changed_glb(write_creature(tmp_path / "hat.glb"), hang_a_hat))
    head, hat = mesh.joints.index("head"), mesh.vertex[len(plain.vertex) :]
    np.testing.assert_allclose(hat, 0.1 * plain.vertex + mesh.bind[head, :3, 3] + (0, 0.5, 0), atol=1e-6)
    assert (mesh.influence[len(plain.vertex) :, 0] == head).all()
    assert "mesh hat has no skin: it follows head" in mesh.notes


def test_two_skins_that_are_bound_in_spaces_of_their_own_meet_in_the_scene(tmp_path: Path) -> None:
    def add_a_skin_bound_at_the_origin(document: dict) -> None:
        names = [node["name"] for node in document["nodes"]]
        attributes = document["meshes"][0]["primitives"][0]["attributes"]
        count = document["accessors"][attributes["POSITION"]]["count"]
        document["accessors"].append({"componentType": 5121, "type": "VEC4", "count": count})  # zeros: the one joint
        own = {"JOINTS_0": len(document["accessors"]) - 1, "WEIGHTS_0": attributes["WEIGHTS_0"]}
        document["meshes"].append({"primitives": [{"attributes": {"POSITION": attributes["POSITION"], **own}}]})
        document["skins"].append({"joints": [names.index("head")]})
        document["nodes"].append({"name": "visor", "mesh": 1, "skin": 1})

    plain = creature(tmp_path)
    mesh = read_gltf(changed_glb(write_creature(tmp_path / "two.glb"), add_a_skin_bound_at_the_origin))
    head, visor = plain.joints.index("head"), slice(len(plain.vertex), None)
    np.testing.assert_allclose(mesh.vertex[: len(plain.vertex)], plain.vertex, atol=1e-6)
    np.testing.assert_allclose(mesh.vertex[visor], plain.vertex + plain.bind[head, :3, 3], atol=1e-6)
    assert set(mesh.influence[visor][mesh.weight[visor] > 0]) == {head}


def test_pieces_are_closed_by_themselves_where_the_whole_cannot_be() -> None:
    """Two cylinders side by side, one with a wall inside: a wrap of both would join them."""
    one = trimesh.creation.cylinder(0.08, 1.0, sections=24)
    other = one.copy().apply_translation((0.18, 0, 0))
    vertex = np.concatenate([one.vertices, other.vertices])
    wall = np.array([[0, 1, 5], [0, 5, 9], [1, 5, 9]])
    face = np.concatenate([one.faces, np.asarray(other.faces) + len(one.vertices), wall])
    surface = closed_pieces(vertex, face)
    assert surface.done.startswith("3 pieces, of which 1 ")  # the wall is one
    assert is_closed(surface.face)
    wrap = closed(vertex, face)
    counts = []
    for made in (surface, wrap):
        mesh = trimesh.Trimesh(np.concatenate([vertex, made.added]), made.face, process=False)
        mesh.remove_unreferenced_vertices()
        counts.append(mesh.body_count)
    assert counts == [3, 1]


def test_mirrored_axes_do_not_flip_between_frames() -> None:
    angle = np.linspace(0, 3, 50)
    turn = np.zeros((50, 3, 3))
    turn[:, 2, 2] = 1
    turn[:, 0, 0] = turn[:, 1, 1] = np.cos(angle)
    turn[:, 1, 0], turn[:, 0, 1] = np.sin(angle), -np.sin(angle)
    rotations = nearest_rotation(turn @ np.diag([-1.0, 1.0, 1.0]) * np.linspace(0.999, 1.001, 50)[:, None, None])
    steps = np.swapaxes(rotations[:-1], 1, 2) @ rotations[1:]
    assert np.degrees(np.arccos((np.trace(steps, axis1=1, axis2=2) - 1) / 2)).max() < 5
    np.testing.assert_allclose(np.linalg.det(rotations), 1.0)


def test_a_size_that_nothing_filmed_has_is_named_with_the_remedy(tmp_path: Path) -> None:
    assert "give --scale 0.01" in " ".join(imported(creature(tmp_path, scale=100.0), "giant").notes)
    assert not any("--scale" in note for note in imported(creature(tmp_path), "creature").notes)


def test_other_endings_and_extensions_that_touch_no_geometry_are_read(tmp_path: Path) -> None:
    required = ["KHR_texture_basisu", "KHR_lights_punctual", "KHR_materials_clearcoat", "VRMC_vrm"]
    for name in ("a.GLB", "a.vrm"):
        assert read_gltf(write_creature(tmp_path / name, extensionsRequired=required)).joints


def test_fingers_are_held_and_no_more_is_searched_than_a_tracker_can(tmp_path: Path) -> None:
    plain = creature(tmp_path)
    head, extra = plain.joints.index("head"), 60
    # Sixty whiskers on the head, each a small triangle; the first two are called fingers.
    names = ("finger.L", "finger.R", *(f"whisker{i}" for i in range(extra - 2)))
    place = plain.bind[head, :3, 3] + np.random.default_rng(0).normal(0, 0.1, (extra, 3))
    bind = np.tile(np.eye(4), (extra, 1, 1))
    bind[:, :3, 3] = place
    corner = (place[:, None] + 0.02 * np.eye(3)).reshape(-1, 3)
    width = plain.weight.shape[1]
    mesh = replace(
        plain,
        joints=plain.joints + names,
        parent=plain.parent + (head,) * extra,
        bind=np.concatenate([plain.bind, bind]),
        vertex=np.concatenate([plain.vertex, corner]),
        face=np.concatenate([plain.face, np.arange(3 * extra).reshape(-1, 3) + len(plain.vertex)]),
        influence=np.concatenate(
            [plain.influence, np.repeat(np.arange(extra) + len(plain.joints), 3)[:, None].repeat(width, 1)]
        ),
        weight=np.concatenate([plain.weight, np.tile(np.eye(1, width), (3 * extra, 1))]),
        motions={},
    )
    made = imported(mesh, "cat")
    (searched,) = made.body.skeleton.models.values()
    assert 90 < len(searched) <= MOST_SEARCHED == descent.MOST_SEARCHED
    held = [note for note in made.notes if note.startswith("held:")]
    assert len(held) == 2
    assert "finger.L, finger.R, too fine for masks" in held[0]
