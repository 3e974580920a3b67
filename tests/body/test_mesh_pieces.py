"""Which triangles a part of the pose moves, and what their edges are."""

from __future__ import annotations

import numpy as np
import pytest
from body_parts import Part, hierarchical, holistic
from person_skeleton import JOINTS, PARENT
from synthetic import MODELS, NAMES, SKELETON, synthetic_body

from mmocap_warp.body.mesh_pieces import mesh_edges, split_mesh
from mmocap_warp.body.posing import Poser
from mmocap_warp.formats.usd.usd_body import read_body
from mmocap_warp.scenes import ROOT

BODIES = sorted((ROOT / "bodies").glob("*.usdc"))
TETRAHEDRON = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])


def parts_of(dof: int) -> list[Part]:
    return hierarchical(SKELETON, dof)


def below(joint: int) -> set[int]:
    """A joint and all that hangs on it, by going up from each."""

    def above(j: int) -> set[int]:
        return {j} if PARENT[j] < 0 else {j} | above(PARENT[j])

    return {j for j in range(len(JOINTS)) if joint in above(j)}


# Joints


@pytest.mark.parametrize("name", NAMES)
def test_a_coordinate_moves_its_joint_and_all_below(name):
    moved = SKELETON.moved_by(np.array([NAMES.index(name)]))
    joint = JOINTS.index(name.split(".")[0]) if "." in name else 0
    assert set(np.flatnonzero(moved)) == below(joint)


def test_parts_move_what_their_names_say():
    moved = {part.name: {JOINTS[j] for j in np.flatnonzero(SKELETON.moved_by(part.index))} for part in parts_of(28)}
    assert moved["root"] == set(JOINTS)
    assert moved["torso and head"] == {name for name in JOINTS if name[1:] not in ("Hip", "Knee", "Ankle", "oot")}
    assert moved["left arm"] == {"LShoulder", "LElbow", "LWrist"}
    assert moved["right leg"] == {"RHip", "RKnee", "RAnkle"}


# Triangles


@pytest.mark.parametrize("dof", MODELS)
def test_a_split_leaves_no_triangle_out_and_takes_none_twice(dof):
    mesh = synthetic_body().tracking
    for part in [*parts_of(dof), *holistic(SKELETON, dof)]:
        moving, resting = split_mesh(mesh, SKELETON, part.index)
        together = np.concatenate([moving.face, resting.face])
        np.testing.assert_array_equal(np.unique(together, axis=0), np.unique(mesh.face, axis=0))
        assert len(together) == len(mesh.face)
        for piece in (moving, resting):
            np.testing.assert_array_equal(piece.vertex, np.unique(piece.face))


@pytest.mark.parametrize("dof", [39, 28])
def test_what_rests_really_rests_and_what_moves_really_moves(dof):
    """Posed twice, with a part turned in between: resting corners are equal to the bit, moving triangles are not."""
    body = synthetic_body()
    poser, rng = Poser(body, np.eye(3)), np.random.default_rng(0)
    for part in parts_of(dof):
        poses = np.tile(rng.uniform(-0.5, 0.5, 51), (2, 1))
        poses[1, part.index] += rng.uniform(0.1, 0.2, len(part.index))
        before, after = poser.tracking_vertices(poses)
        moving, resting = split_mesh(body.tracking, body.skeleton, part.index)
        np.testing.assert_array_equal(before[resting.vertex], after[resting.vertex])
        assert np.any(before[moving.face] != after[moving.face], axis=(1, 2)).all()
        assert len(moving.face) > 0
        assert (len(resting.face) == 0) == (part.name == "root")


def test_a_vertex_moves_with_any_of_its_joints_that_has_weight():
    mesh = synthetic_body().tracking
    turned = np.array([NAMES.index("LWrist.Ry")])
    moving, _ = split_mesh(mesh, SKELETON, turned)
    wrist = np.any((mesh.joint == JOINTS.index("LWrist")) & (mesh.weight > 0), axis=1)
    np.testing.assert_array_equal(moving.face, mesh.face[wrist[mesh.face].any(axis=1)])
    assert not np.isin(np.flatnonzero(~wrist), moving.vertex).all()


# Edges


def sides(edges: np.ndarray) -> set[tuple[int, int, int]]:
    """(start, end, triangle) of both sides, as each triangle goes along it."""
    return {(a, b, t) for a, b, t, _ in edges.tolist()} | {(b, a, t) for a, b, _, t in edges.tolist() if t >= 0}


def half_edges(face: np.ndarray) -> set[tuple[int, int, int]]:
    return {(int(f[i]), int(f[(i + 1) % 3]), t) for t, f in enumerate(face) for i in range(3)}


def test_a_closed_surface_has_an_edge_for_every_two_sides():
    edges = mesh_edges(TETRAHEDRON)
    assert len(edges) == 6
    assert (edges[:, 3] >= 0).all()
    assert sides(edges) == half_edges(TETRAHEDRON)


def test_the_border_of_an_open_surface_has_one_side():
    face = TETRAHEDRON[1:]
    edges = mesh_edges(face)
    border = edges[edges[:, 3] < 0]
    assert {frozenset(edge[:2]) for edge in border.tolist()} == {frozenset(e) for e in ((0, 1), (1, 2), (2, 0))}
    assert len(edges) == 6
    assert sides(edges) == half_edges(face)


def test_where_more_triangles_meet_they_are_paired_as_far_as_they_go():
    """A book of four pages: three along the spine one way, one the other way."""
    face = np.array([[0, 1, 2], [0, 1, 3], [1, 0, 4], [0, 1, 5]])
    edges = mesh_edges(face)
    spine = edges[np.isin(edges[:, :2], (0, 1)).all(axis=1)]
    assert sorted((spine[:, 3] >= 0).tolist()) == [False, False, True]
    assert sides(edges) == half_edges(face)


def test_faces_that_turn_different_ways_share_no_edge():
    edges = mesh_edges(np.array([[0, 1, 2], [0, 1, 3]]))
    assert len(edges) == 6
    assert (edges[:, 3] == -1).all()


def test_no_faces_have_no_edges():
    assert mesh_edges(np.zeros((0, 3), int)).shape == (0, 4)


@pytest.mark.parametrize("path", BODIES, ids=lambda path: path.stem)
def test_shipped_tracking_meshes_are_closed(path):
    """What counting facing triangles alone, and holding a part of the body, rests on."""
    mesh = read_body(path).tracking
    edges = mesh_edges(mesh.face)
    assert (edges[:, 3] >= 0).all()
    assert 2 * len(edges) == 3 * len(mesh.face)
