"""Decimation keeps a closed mesh closed and its vertices where they were."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from mmocap_warp.body.mesh_pieces import is_closed
from mmocap_warp.rigging.decimation import decimate


@pytest.fixture(scope="module")
def sphere() -> trimesh.Trimesh:
    return trimesh.creation.icosphere(subdivisions=3)


def test_a_coarse_sphere_is_closed_and_inscribed(sphere: trimesh.Trimesh) -> None:
    kept, face = decimate(sphere.vertices, sphere.faces, 200)
    assert len(face) == 200
    coarse = trimesh.Trimesh(sphere.vertices[kept], face, process=False)
    assert coarse.is_watertight
    assert coarse.is_winding_consistent
    assert 0.93 * sphere.volume < coarse.volume < sphere.volume


def test_flat_parts_go_first() -> None:
    box = trimesh.creation.box().subdivide().subdivide().subdivide()
    kept, face = decimate(box.vertices, box.faces, 60)
    assert trimesh.Trimesh(box.vertices[kept], face, process=False).volume == pytest.approx(1.0, abs=1e-9)


def test_repeats_itself(sphere: trimesh.Trimesh) -> None:
    first, second = (decimate(sphere.vertices, sphere.faces, 300) for _ in range(2))
    np.testing.assert_array_equal(first[0], second[0])
    np.testing.assert_array_equal(first[1], second[1])


def test_an_open_mesh_is_refused(sphere: trimesh.Trimesh) -> None:
    assert is_closed(sphere.faces)
    assert not is_closed(sphere.faces[1:])
    assert not is_closed(np.r_[sphere.faces[:1, ::-1], sphere.faces[1:]])
    with pytest.raises(ValueError, match="only a closed mesh"):
        decimate(sphere.vertices, sphere.faces[1:], 100)


def test_there_is_a_coarsest_mesh(sphere: trimesh.Trimesh) -> None:
    with pytest.raises(ValueError, match="cannot be decimated to 2 triangles"):
        decimate(sphere.vertices, sphere.faces, 2)


def test_a_wing_keeps_its_outline():
    """A flat sheet with two sides: the planes of its faces let its rim move freely."""
    rim, rings = 24, 5
    angle = np.linspace(0, 2 * np.pi, rim, endpoint=False)
    disc = np.stack([np.cos(angle), 0.5 * np.sin(angle), 0 * angle], axis=1)
    sheet = np.concatenate([disc * share for share in np.linspace(1, 0, rings, endpoint=False)] + [np.zeros((1, 3))])
    at = np.arange(rim)
    side = []
    for ring in range(rings - 1):
        a, b = ring * rim + at, ring * rim + (at + 1) % rim
        side += [np.stack([a, b, a + rim], axis=1), np.stack([b, b + rim, a + rim], axis=1)]
    last = (rings - 1) * rim
    side.append(np.stack([last + at, last + (at + 1) % rim, np.full(rim, rings * rim)], axis=1))
    top = np.concatenate(side)
    under = np.where(top < rim, top, top + len(sheet) - rim)[:, ::-1]  # the rim is common to both
    vertex, face = np.concatenate([sheet, sheet[rim:]]), np.concatenate([top, under])

    def area(corner: np.ndarray) -> float:
        a, b, c = corner.swapaxes(0, 1)
        return float(np.abs(np.cross(b - a, c - a)[:, 2]).sum() / 4)

    kept, coarser = decimate(vertex, face, 60)
    assert area(vertex[kept][coarser]) > 0.98 * area(vertex[face])
