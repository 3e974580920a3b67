"""Skin whose vertices that lie on each other are one: files repeat them wherever colours or normals change."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mmocap_warp.formats.rigged.rigged_mesh import RiggedMesh

_SAME = 1e-5  # of the mesh's extent, how near vertices are one


def welded(mesh: RiggedMesh) -> RiggedMesh:
    """The mesh with one vertex for each place, and without triangles that have no area or are there twice.

    Of vertices that are joined the weights are averaged; rigid parts are not joined to each other. Vertices of no
    triangle are left out.

    Raises:
        ValueError: a mesh of no extent.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    extent = float(np.ptp(mesh.vertex, axis=0).max())
    if not 0 < extent < np.inf:
        raise ValueError("the mesh has no extent")
    tolerance = _SAME * extent
    apart = mesh.influence[:, :1].astype(float) if mesh.rigid else np.zeros((len(mesh.vertex), 0))
    scaled = np.concatenate([mesh.vertex / tolerance, 2 * apart], axis=1)
    # cells first: what lies in one is joined anyhow, and pairs stay few wherever vertices crowd
    _, first, cell = np.unique(np.round(2 * scaled), axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)  # as the file has them
    first, cell = first[order], np.argsort(order)[cell]
    near = cKDTree(scaled[first]).query_pairs(1.0, output_type="ndarray")
    joined = coo_matrix((np.ones(len(near)), (near[:, 0], near[:, 1])), shape=(len(first), len(first)))
    place = connected_components(joined, directed=False)[1][cell.ravel()]
    face = place[mesh.face]
    face = face[(face[:, 0] != face[:, 1]) & (face[:, 1] != face[:, 2]) & (face[:, 2] != face[:, 0])]
    _, whole = np.unique(np.sort(face, axis=1), axis=0, return_index=True)
    kept, face = np.unique(face[np.sort(whole)], return_inverse=True)

    # of vertices at one place all influences are taken, by the mean
    dense = np.zeros((place.max() + 1, len(mesh.joints)))
    np.add.at(dense, (place[:, None], mesh.influence), mesh.weight)
    dense = dense[kept] / np.bincount(place)[kept, None]
    most = max(int((dense > 0).sum(axis=1).max(initial=0)), 1)
    influence = np.argsort(-dense, axis=1, kind="stable")[:, :most]
    vertex = np.zeros((place.max() + 1, 3))
    np.add.at(vertex, place, mesh.vertex)
    vertex /= np.bincount(place)[:, None]
    return replace(
        mesh,
        vertex=vertex[kept],
        face=face.reshape(-1, 3),
        influence=influence,
        weight=np.take_along_axis(dense, influence, axis=1),
    )


def four_influences(mesh: RiggedMesh) -> tuple[np.ndarray, np.ndarray, float]:
    """Each vertex's heaviest joints (vertex, 4) int32, weights (vertex, 4) float32 of sum one, and what was dropped.

    The last is the largest share of a vertex's weight that its other joints had. Vertices that follow no joint follow
    the root.
    """
    total = mesh.weight.sum(axis=1)
    share = np.divide(mesh.weight, total[:, None], out=np.zeros_like(mesh.weight), where=total[:, None] > 0)
    pad = max(4 - share.shape[1], 0)
    share, joint = np.pad(share, ((0, 0), (0, pad))), np.pad(mesh.influence, ((0, 0), (0, pad)))
    order = np.argsort(-share, axis=1, kind="stable")[:, :4]
    weight, joint = np.take_along_axis(share, order, axis=1), np.take_along_axis(joint, order, axis=1)
    kept = weight.sum(axis=1)
    dropped = float((1 - kept[total > 0]).max(initial=0.0))
    weight[total == 0], kept[total == 0] = (1, 0, 0, 0), 1.0
    weight = weight / kept[:, None]
    return np.where(weight > 0, joint, 0).astype(np.int32), weight.astype(np.float32), max(dropped, 0.0)
