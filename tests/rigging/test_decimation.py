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
