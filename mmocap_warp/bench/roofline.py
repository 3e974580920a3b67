"""How near the whole evaluation is to what the machine could do.

The model counts what any method of the renderer's kind must do, and no more:

- bytes: each number that a candidate needs and another step has made is written once and read once; what all
  candidates share is read once a call. Caches may save some of that.
- operations: each addition, multiplication, division, comparison and logical step on a word is one. Counted are posing
  a vertex and projecting it into each camera; telling which way each triangle faces; for ``raycast``, fitting the boxes
  of the tree and crossing each row of each facing triangle once; for ``raster``, crossing each row of each edge of the
  contour and summing up the words of the body's box; and comparing these words with the mask.

What finding the way through the tree takes is not counted: it is what a better way would save. The ceilings are those
of a copy and of multiply-adds, which are two operations each.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from mmocap_warp.bench.evaluations import EVALUATION
from mmocap_warp.bench.workload import Workload
from mmocap_warp.body.mesh_parts import mesh_edges
from mmocap_warp.kernels.benchmarks.case import Measurement
from mmocap_warp.kernels.benchmarks.ceilings import GROUP as CEILINGS
from mmocap_warp.kernels.views.projection import SUBPIXEL

# Operations, counted in the kernels' source.
_JOINT = 330  # three angles' sines and cosines, their rotation, and seven products of 3 x 3 matrices
_INFLUENCE = 24  # a 3 x 4 matrix times a point, weighed and added
_PROJECTION = 32  # into the camera, divided, onto the grid, and into the box of all
_FACING = 7
_LEAF_CORNER, _NODE = 4, 4
_TRIANGLE_ROW = 20  # two crossings and their bits
_TRIANGLE = 30  # its corners sorted and three slopes
_EDGE, _EDGE_ROW = 12, 12
_RASTER_WORD, _COUNT_WORD = 80, 5
_CAMERA = 12  # Eq. 4 from three counts

_SAMPLE = 8  # candidates whose geometry is counted


@dataclass(frozen=True)
class Demand:
    """What an evaluation needs, on average.

    Attributes:
        bytes: to move.
        operations: to do.
    """

    bytes: float
    operations: float


@dataclass(frozen=True)
class _Geometry:
    """What there is to draw of a candidate in all cameras, on average."""

    vertices: int
    triangles: int
    edges: int
    influences: int
    facing: float
    facing_rows: float
    contour: float
    contour_rows: float
    words: float


def demand(load: Workload, renderer: str, candidates: int) -> Demand:
    """Of one evaluation among so many in a call."""
    g = _geometry(load)
    cameras, joints = len(load.rig), len(load.body.joint_rest)
    nodes = 2 * (g.triangles / 3)  # leaves hold two to four triangles
    matrices, posed, drawn = 2 * 48 * joints, 12 * g.vertices, cameras * (8 * g.vertices + g.triangles)
    moved = 4.0 * load.body.skeleton.coordinates + 2 * (matrices + posed + drawn) + 4 * g.words + 2 * 8 * cameras
    shared = 44 * g.vertices + (12 * g.triangles + 16 * nodes if renderer == "raycast" else 28 * g.edges)
    work = (
        float(_JOINT * joints)
        + _INFLUENCE * g.influences
        + cameras * (_PROJECTION * g.vertices + _FACING * g.triangles)
    )
    work += _COUNT_WORD * g.words + _CAMERA * cameras
    if renderer == "raycast":
        moved += 2 * 16 * nodes * cameras
        work += 3 * _LEAF_CORNER * g.facing + _NODE * nodes * cameras
        work += _TRIANGLE * g.facing + _TRIANGLE_ROW * g.facing_rows
    else:
        work += cameras * g.edges + _EDGE * g.contour + _EDGE_ROW * g.contour_rows + _RASTER_WORD * g.words
    return Demand(moved + shared / candidates, work)


def _geometry(load: Workload) -> _Geometry:
    mesh = load.body.tracking
    edges = mesh_edges(mesh.face)
    cells = np.floor(SUBPIXEL * load.pixels(load.poses(_SAMPLE))).astype(int)  # (candidate, camera, vertex, 2)
    a, b, c = (cells[:, :, mesh.face[:, i]] for i in range(3))
    p, q = b - a, c - a
    facing = p[..., 0] * q[..., 1] < p[..., 1] * q[..., 0]
    top, bottom = (pick(np.stack([a, b, c])[..., 1], axis=0) for pick in (np.min, np.max))
    contour = facing[:, :, edges[:, 2]] != facing[:, :, edges[:, 3]]
    ends = cells[:, :, edges[:, :2], 1]
    low, high = cells.min(axis=2) // SUBPIXEL, cells.max(axis=2) // SUBPIXEL
    words = (high[..., 1] - low[..., 1]) * (high[..., 0] // 32 - low[..., 0] // 32 + 1)

    def each(values: np.ndarray) -> float:
        return float(values.sum()) / _SAMPLE

    return _Geometry(
        vertices=len(mesh.rest),
        triangles=len(mesh.face),
        edges=len(edges),
        influences=int((mesh.weight > 0).sum()),
        facing=each(facing),
        facing_rows=each((bottom // SUBPIXEL - top // SUBPIXEL)[facing]),
        contour=each(contour),
        contour_rows=each(np.abs(np.diff(ends // SUBPIXEL, axis=-1)[..., 0])[contour]),
        words=each(words),
    )


def roofline(load: Workload, measured: list[Measurement]) -> list[dict[str, Any]]:
    """For the largest batch of each renderer: demand, rates, shares of the ceilings, and the shortest time possible.

    On the CPU those of one thread.
    """
    ceiling = {row.name: row for row in measured if row.group == CEILINGS}
    bandwidth = ceiling["copy"].sizes["bytes"] / ceiling["copy"].median
    peak = ceiling["multiply-add"].sizes["operations"] / ceiling["multiply-add"].median
    rows = [row for row in measured if row.group == EVALUATION and row.sizes.get("threads", 1) == 1]
    largest = {row.sizes["renderer"]: row for row in sorted(rows, key=lambda row: row.sizes["candidates"])}
    lines = []
    for renderer, row in largest.items():
        needed = demand(load, renderer, row.sizes["candidates"])
        seconds = row.median / row.evaluations
        lines.append(
            {
                "renderer": renderer,
                "candidates": row.sizes["candidates"],
                "seconds": seconds,
                "bytes": needed.bytes,
                "operations": needed.operations,
                "bytes_per_second": needed.bytes / seconds,
                "operations_per_second": needed.operations / seconds,
                "ceiling_bytes_per_second": bandwidth,
                "ceiling_operations_per_second": peak,
                "share_of_bytes": needed.bytes / seconds / bandwidth,
                "share_of_operations": needed.operations / seconds / peak,
                "shortest_seconds": max(needed.bytes / bandwidth, needed.operations / peak),
            }
        )
    return lines
