"""Tracking meshes: what is open is closed, what is turned inside out is turned back, and it is said."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from mmocap_warp.body.mesh_pieces import is_closed
from mmocap_warp.rigging.importing.closing import closed, consistently_wound, wrapped


def volume(vertex: np.ndarray, face: np.ndarray) -> float:
    return float(trimesh.Trimesh(vertex, face, process=False).volume)


@pytest.fixture(scope="module")
def ball() -> trimesh.Trimesh:
    return trimesh.creation.icosphere(subdivisions=3)


def test_a_closed_mesh_stays_as_it_is(ball: trimesh.Trimesh) -> None:
    surface = closed(ball.vertices, np.asarray(ball.faces))
    assert surface.done == ""
    assert len(surface.added) == 0
    np.testing.assert_array_equal(surface.face, ball.faces)


def test_a_hole_is_filled_with_what_lies_in_it(ball: trimesh.Trimesh) -> None:
    low = ball.vertices[ball.faces][:, :, 1].max(axis=1) < -0.5
    surface = closed(ball.vertices, np.asarray(ball.faces)[~low])
    assert surface.done == "1 hole filled"
    vertex = np.concatenate([ball.vertices, surface.added])
    assert is_closed(surface.face)
    cap = np.pi * 0.5**2 * (3 - 0.5) / 3
    assert volume(vertex, surface.face) == pytest.approx(ball.volume - cap, rel=0.05)
    assert np.linalg.norm(ball.vertices[surface.beside] - surface.added, axis=1) < 1


def test_triangles_that_are_wound_at_random_are_put_in_order(ball: trimesh.Trimesh) -> None:
    face = np.asarray(ball.faces).copy()
    turned = np.random.default_rng(0).random(len(face)) < 0.5
    face[turned] = face[turned][:, ::-1]
    surface = closed(ball.vertices, face)
    assert surface.done == ""
    assert is_closed(surface.face)
    assert volume(ball.vertices, surface.face) == pytest.approx(ball.volume)


def test_pieces_inside_out_are_turned(ball: trimesh.Trimesh) -> None:
    vertex = np.concatenate([ball.vertices, np.add(ball.vertices, (3, 0, 0))])
    face = np.concatenate([ball.faces, np.asarray(ball.faces)[:, ::-1] + len(ball.vertices)])
    surface = closed(vertex, face)
    assert volume(vertex, surface.face) == pytest.approx(2 * ball.volume)


def test_a_heap_of_triangles_is_wrapped() -> None:
    """Many holes, a wall inside, an edge with three triangles."""
    ball = trimesh.creation.icosphere(subdivisions=4)
    face = np.asarray(ball.faces)[np.random.default_rng(1).random(len(ball.faces)) < 0.9]
    corner = len(ball.vertices)
    vertex = np.concatenate([ball.vertices, [(0.5, 0, 0), (0, 0.5, 0), (0, 0, 0.5)]])
    face = np.concatenate([face, [(corner, corner + 1, corner + 2)], [(face[0, 0], face[0, 1], corner)]])
    surface = closed(vertex, face)
    assert surface.done.startswith("wrapped in a new surface")
    assert is_closed(surface.face)
    everything = np.concatenate([vertex, surface.added])
    assert volume(everything, surface.face) == pytest.approx(ball.volume, rel=0.05)
    assert np.linalg.norm(vertex[surface.beside] - surface.added, axis=1).max() < 0.2


def test_a_wrapped_box_has_its_size_and_one_sheet_gets_two_sides() -> None:
    box = trimesh.creation.box((1.0, 0.6, 0.4))
    count = len(box.vertices)
    whole = wrapped(box.vertices, np.asarray(box.faces), 30, "")
    assert is_closed(whole.face)
    np.testing.assert_allclose(np.ptp(whole.added, axis=0), (1.0, 0.6, 0.4), atol=0.03)
    assert volume(whole.added, whole.face - count) == pytest.approx(0.24, rel=0.08)
    sheet = wrapped(box.vertices, np.asarray(box.faces)[:1], 30, "")
    assert is_closed(sheet.face)
    assert 0 < volume(sheet.added, sheet.face - count) < 0.02


def test_a_triangle_that_touches_no_other_stays_as_it_is() -> None:
    face = np.array([[0, 1, 2], [2, 1, 3], [4, 5, 6]])
    np.testing.assert_array_equal(consistently_wound(face), face)
