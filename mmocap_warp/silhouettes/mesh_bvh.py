"""A bounding volume hierarchy over the rest pose's triangles; ``kernels/silhouettes/raycast.py`` has its layout."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Bvh:
    """A binary tree in depth-first order.

    Attributes:
        node: (node, 3) int32, ``skip, first, count``; ``count`` is 0 for an inner node.
        triangle: (triangle, 3) int32, the faces in leaf order.
    """

    node: np.ndarray
    triangle: np.ndarray


def build_bvh(vertices: np.ndarray, faces: np.ndarray, leaf_size: int = 4) -> Bvh:
    """Split the triangles at the median of their centroids' widest axis until a leaf holds ``leaf_size`` at most.

    Args:
        vertices: (vertex, 3) float, the rest pose: boxes stay tight when a limb moves as a whole.
        faces: (triangle, 3) int.
        leaf_size: largest number of triangles in a leaf.
    """
    centroid = np.asarray(vertices, np.float64)[faces].mean(axis=1)
    nodes: list[list[int]] = []
    order: list[int] = []

    def split(triangles: np.ndarray) -> None:
        index = len(nodes)
        nodes.append([0, len(order), 0])
        if len(triangles) <= leaf_size:
            nodes[index][2] = len(triangles)
            order.extend(triangles)
        else:
            axis = np.ptp(centroid[triangles], axis=0).argmax()
            ranked = triangles[np.argsort(centroid[triangles, axis], kind="stable")]
            split(ranked[: len(ranked) // 2])
            split(ranked[len(ranked) // 2 :])
        nodes[index][0] = len(nodes)

    split(np.arange(len(faces)))
    return Bvh(np.array(nodes, np.int32), np.asarray(faces, np.int32)[order])
