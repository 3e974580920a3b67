"""Filled outlines of a posed mesh, fast: only the edges between what faces a camera and what faces away are drawn.

Of a closed surface, the faces that face a viewer cover exactly its silhouette. Where they overlap they are counted, and
summed over all of them the edges that two of them share cancel: the count at a pixel is the winding number of the
edges that are left, the contour generators. A body of 13,000 faces has a thousand or so of these, so a silhouette
takes about a millisecond, and the pixel rule is exact: a pixel belongs to it if its centre does.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from mmocap_warp.body.mesh_pieces import mesh_edges
from mmocap_warp.cameras.rig import CameraRig, to_pixels


@dataclass(frozen=True)
class Surface:
    """A mesh's edges with the faces on their two sides."""

    face: np.ndarray  # (face, corner) int, counter-clockwise seen from outside; triangles or quads
    edge: np.ndarray  # (edge, 2) int, vertices from and to
    left: np.ndarray  # (edge,) int, the face that runs along the edge
    right: np.ndarray  # (edge,) int, the face that runs against it; -1 where the mesh ends

    @classmethod
    def of(cls, face: np.ndarray) -> Self:
        """The edges of a mesh in which at most two faces meet at an edge, and run along it in opposite directions."""
        edge = mesh_edges(face)
        return cls(face, edge[:, :2], edge[:, 2], edge[:, 3])

    def facing(self, vertices: np.ndarray, viewers: np.ndarray) -> np.ndarray:
        """(viewer, face) bool: whether a face of vertices (vertex, 3) is seen from outside, by viewers (viewer, 3)."""
        corner = vertices[self.face]
        normal = np.cross(corner[:, -2] - corner[:, 0], corner[:, -1] - corner[:, 1])
        plane = np.concatenate([normal, -(normal * corner[:, 0]).sum(axis=1, keepdims=True)], axis=1)
        return np.concatenate([viewers, np.ones((len(viewers), 1))], axis=1) @ plane.T > 0

    def contour(self, facing: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The edges (n, 2) where ``facing`` (face,) changes, and their sign (n,): +1 if the left face is seen."""
        seen = np.append(facing, False).astype(np.int8)  # the last is of no face, beyond the mesh's end
        sign = seen[self.left] - seen[self.right]
        there = np.flatnonzero(sign)
        return self.edge[there], sign[there]


def draw_outlines(rig: CameraRig, vertices: np.ndarray, surface: Surface) -> list[np.ndarray]:
    """Per camera (height, width) bool: pixels whose centre the surface covers, where it faces the camera.

    The cameras have no distortion. The surface's vertices (vertex, 3) are posed, in the world [m].
    """
    masks = []
    for k, facing in enumerate(surface.facing(vertices, rig.centres)):
        edge, sign = surface.contour(facing)
        start, end = (on_image(rig, k, vertices[ends]) for ends in edge.T)
        masks.append(fill(start, end, sign, *rig.size[k]))
    return masks


def on_image(rig: CameraRig, k: int, points: np.ndarray) -> np.ndarray:
    """Pixels (..., 2) of points (..., 3) in camera ``k``, a pinhole."""
    seen = points @ rig.R[k].T + rig.t[k]
    return to_pixels(rig, k, seen[..., :2] / seen[..., 2:])


def fill(start: np.ndarray, end: np.ndarray, sign: np.ndarray, width: int, height: int) -> np.ndarray:
    """(height, width) bool: pixels whose centre the directed edges wind around.

    An edge leads from ``start`` to ``end`` (edge, 2) [px] and counts as often as ``sign`` (edge,) says.
    """
    mask = np.zeros((height, width), bool)
    above = start[:, 1] < end[:, 1]
    upper, lower = np.where(above[:, None], start, end), np.where(above[:, None], end, start)
    first = np.clip(np.ceil(upper[:, 1]), 0, height).astype(np.int64)
    rows = np.clip(np.ceil(lower[:, 1]), 0, height).astype(np.int64) - first  # an edge has its upper end, not its lower
    total = int(rows.sum())
    if not total:
        return mask
    of = np.repeat(np.arange(len(rows)), rows)
    row = np.arange(total) - np.repeat(np.cumsum(rows) - rows, rows) + first[of]
    slope = (lower[:, 0] - upper[:, 0]) / np.where(rows > 0, lower[:, 1] - upper[:, 1], 1.0)
    column = np.clip(np.ceil(upper[of, 0] + (row - upper[of, 1]) * slope[of]), 0, width).astype(np.int64)
    top, left = row.min(), column.min()
    box_height, box_width = row.max() + 1 - top, column.max() + 1 - left
    turn = np.where(above, sign, -sign)[of]
    steps = np.bincount((row - top) * box_width + column - left, turn, box_height * box_width)
    winding = np.cumsum(steps.reshape(box_height, box_width).astype(np.int16), axis=1)
    covered = mask[top : top + box_height, left : left + box_width]
    covered[:] = (winding != 0)[:, : covered.shape[1]]
    return mask
