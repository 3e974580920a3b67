"""Rigs whose feet are brought to the shins by inverse kinematics, and how an import is checked against its file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from made_up_rigs import write_creature

from mmocap_warp.body.mesh_pieces import is_closed
from mmocap_warp.cli import main
from mmocap_warp.formats.rigged.gltf import read_gltf
from mmocap_warp.formats.rigged.rigged_mesh import RiggedMesh, RiggedMotion
from mmocap_warp.rigging.importing.closing import closed_pieces, weighted
from mmocap_warp.rigging.importing.imported import imported
from mmocap_warp.rigging.importing.proof import SAME_OUTLINE

FRAMES = 41


def swinging(mesh: RiggedMesh, stretch: float = 0.0) -> RiggedMotion:
    """The body strides two metres ahead of its armature and swings its left shin; a frame stretches the ankle."""
    number = {name: joint for joint, name in enumerate(mesh.joints)}
    world = np.repeat(mesh.bind[None], FRAMES, axis=0)
    world[:, 1:, 2, 3] += np.linspace(0, 2, FRAMES)[:, None]
    swing = np.linspace(0, 1.2, FRAMES)
    turn = np.tile(np.eye(3), (FRAMES, 1, 1))
    turn[:, 1, 1] = turn[:, 2, 2] = np.cos(swing)
    turn[:, 2, 1], turn[:, 1, 2] = np.sin(swing), -np.sin(swing)
    knee = world[:, number["shin.L"], :3, 3].copy()
    for name in ("shin.L", "foot.L"):
        world[:, number[name], :3, 3] = knee + np.einsum("fab,fb->fa", turn, world[:, number[name], :3, 3] - knee)
        world[:, number[name], :3, :3] = turn
    world[FRAMES // 2, number["foot.L"], 1, 3] -= stretch
    return RiggedMotion(30.0, world)


def on_the_armature(tmp_path: Path, stretch: float = 0.0) -> RiggedMesh:
    mesh = read_gltf(write_creature(tmp_path / "creature.glb"))
    parent = list(mesh.parent)
    parent[mesh.joints.index("foot.L")] = mesh.joints.index("armature")
    return replace(mesh, parent=tuple(parent), motions={"Stride": swinging(mesh, stretch)})


def test_a_foot_is_hung_on_its_shin_though_a_frame_stretches_the_ankle(tmp_path: Path) -> None:
    made = imported(on_the_armature(tmp_path, stretch=0.1), "creature")
    skeleton = made.body.skeleton
    assert skeleton.joints[skeleton.parent[skeleton.index("foot.L")]] == "shin.L"
    (note,) = (note for note in made.notes if note.startswith("motion Stride"))
    assert "joints within 100.0 mm" in note
    assert "foot.L is" in note
    assert not made.fault


def test_a_root_that_stays_behind_gives_its_skin_to_the_joint_that_leaves_it(tmp_path: Path) -> None:
    mesh = on_the_armature(tmp_path)
    armature, hips = mesh.joints.index("armature"), mesh.joints.index("hips")
    influence = np.where(mesh.influence == hips, armature, mesh.influence)
    influence[: len(influence) // 2] = mesh.influence[: len(influence) // 2]
    made = imported(replace(mesh, influence=influence), "creature")
    assert made.body.skeleton.joints[0] == "hips"
    assert any("joints within 0.0 mm" in note for note in made.notes)


def test_vertices_without_weights_follow_the_nearest_that_have_some(tmp_path: Path) -> None:
    mesh = read_gltf(write_creature(tmp_path / "creature.glb"))
    weight = mesh.weight.copy()
    weight[7] = 0
    made = weighted(replace(mesh, weight=weight))
    apart = np.linalg.norm(mesh.vertex - mesh.vertex[7], axis=1)
    apart[7] = np.inf
    assert made.weight[7].sum() > 0
    assert made.influence[7, 0] == mesh.influence[apart.argmin(), 0]
    assert made.notes[-1].startswith("1 of ")


def test_a_body_that_its_own_motions_contradict_is_not_written(tmp_path: Path, capsys, monkeypatch) -> None:
    """The head leaves the body in every frame, and moves with nothing else."""

    def with_a_loose_head(path: Path, _: str | None) -> RiggedMesh:
        mesh = read_gltf(path)
        motion = swinging(mesh)
        head = [joint for joint, name in enumerate(mesh.joints) if name.startswith("head")]
        motion.world[:, head, 0, 3] += np.linspace(0.5, 1.5, FRAMES)[:, None]
        return replace(mesh, motions={"Fall": motion})

    monkeypatch.setattr("mmocap_warp.commands.bodies.read_gltf", with_a_loose_head)
    file, output = write_creature(tmp_path / "creature.glb"), tmp_path / "body.usda"
    assert main(["body", "import", str(file), "-o", str(output)]) == 4
    out = capsys.readouterr().out
    assert "check failed: joints are" in out
    assert "head in Fall" in out
    assert not output.exists()
    assert main(["body", "import", str(file), "-o", str(output), "--force"]) == 0
    assert output.exists()


def test_the_outline_is_compared_with_the_skin_that_the_files_joints_move(tmp_path: Path) -> None:
    mesh = on_the_armature(tmp_path)
    made = imported(mesh, "creature")
    assert made.outline.overlap > SAME_OUTLINE
    # The head leaves the neck for some frames, which the body's head cannot. One that is always there is bound there.
    motion = mesh.motions["Stride"]
    head, middle = mesh.joints.index("head"), len(motion.world) // 2
    motion.world[middle : middle + 3, head, :3, 3] += (0.6, 0.0, 0.0)
    off = imported(mesh, "creature")
    motion.world[[*range(middle), *range(middle + 3, len(motion.world))], head, :3, 3] += (0.6, 0.0, 0.0)
    moved = imported(mesh, "creature")
    assert moved.outline.overlap > SAME_OUTLINE
    assert any(note.startswith("bones to head, head end are as its motions have them") for note in moved.notes)
    assert any("joints within 0.0 mm" in note for note in moved.notes)
    assert off.outline.overlap < SAME_OUTLINE
    assert off.outline.view.startswith("in motion Stride from ")
    assert off.outline.picture.shape[2] == 3


def test_sheets_that_meet_in_an_edge_are_closed_one_by_one() -> None:
    """A box, and a fin that stands on one of its edges: three triangles meet there."""
    corner = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    box = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    fin = np.array([(-0.5, 1.5, 0.0), (-0.5, 1.5, 1.0)])
    vertex = np.concatenate([corner, fin])
    face = np.array([*box, (2, 3, 9), (2, 9, 8)])
    surface = closed_pieces(vertex, face)
    assert surface.done.startswith("2 pieces")
    assert is_closed(surface.face)
    place = np.concatenate([vertex, surface.added])[np.unique(surface.face)]
    np.testing.assert_allclose([place.min(axis=0), place.max(axis=0)], [(-0.5, 0, 0), (1, 1.5, 1)], atol=1e-9)
