"""A body's contours by the kernels, stage by stage, into arrays that are poisoned first; and float64 twins of them."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from functools import cached_property

import numpy as np
import warp as wp
from poisoned import poisoned, poisoned_joints

from mmocap_warp.body.mesh_pieces import mesh_edges
from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.posing import make_body_arrays
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.contour.frame.fields import DistanceFields
from mmocap_warp.contour.frame.fitter import ContourFitter, MatchingConfig
from mmocap_warp.kernels.block import Batch, batch_of
from mmocap_warp.kernels.body.skinning import pose_vertices
from mmocap_warp.kernels.contour.jacobian import Posed, RestChange, Rows, Tree, differentiate, move_origins, turn_axes
from mmocap_warp.kernels.contour.moving import Moving
from mmocap_warp.kernels.contour.normal_equations import Sums, sum_normal_equations, sum_tallies
from mmocap_warp.kernels.contour.outline import BANDS, Edges, Outline, find_contours
from mmocap_warp.kernels.contour.residuals import Matching, Residuals, find_residuals
from mmocap_warp.kernels.structs import filled
from mmocap_warp.masks.observation import Observation, make_views
from mmocap_warp.synthesis.exact_posing import ExactPoser

MATCHING = asdict(MatchingConfig())


def poisoned_outline(
    candidates: int, cameras: int, size: int, mesh: tuple[int, int, int], device: str, bands: float = 3.0
) -> Outline:
    """Room for contour edges of a mesh of so many vertices, triangles and edges, in so many bands each, on average."""
    vertices, faces, edges = mesh
    view = (candidates, cameras)
    return filled(
        Outline,
        size=size,
        late=poisoned(view, wp.float32, device),
        image=poisoned((*view, vertices), wp.vec3, device),
        facing=wp.zeros((*view, faces), dtype=wp.uint8, device=device),
        found=poisoned((*view, edges), wp.int32, device),
        count=poisoned(view, wp.int32, device),
        ends=poisoned((*view, size), wp.vec2i, device),
        room=int(bands * size),
        line=poisoned(candidates * cameras * 4 * int(bands * size), wp.float32, device),
        band=poisoned((*view, BANDS + 1), wp.int32, device),
    )


def poisoned_residuals(candidates: int, cameras: int, size: int, device: str) -> Residuals:
    """Room for the residuals of contour edges."""
    shape = (candidates, cameras, size)
    return filled(
        Residuals,
        normal=poisoned(shape, wp.vec2, device),
        weighted=poisoned(shape, wp.vec2, device),
        tally=poisoned(shape, wp.vec4, device),
    )


@dataclass
class Contours:
    """Poses of a body in a rig.

    Attributes:
        pose: (candidate, coordinate) [m, rad].
        base: (candidate, 3, 3) of the root.
        bands: of a contour edge for which there is room, on average.
        size: contour edges of a view for which there is room; all edges where omitted.
        change: of the rest body by its parameters: (parameter, vertex, 3), (parameter, joint, 3).
        own: columns of the views' own, ``OWN`` or none.
        late: (camera,) by how much views are late [s]; None where all are in time.
    """

    body: BodyModel
    rig: CameraRig
    pose: np.ndarray
    base: np.ndarray
    device: str
    size: int | None = None
    bands: float = 3.0
    change: tuple[np.ndarray, np.ndarray] | None = None
    own: int = 0
    late: np.ndarray | None = None
    matching: dict[str, float] = field(default_factory=lambda: dict(MATCHING))

    def __post_init__(self) -> None:
        mesh, device, n = self.body.tracking, self.device, len(self.pose)
        joints, vertices = len(self.body.joint_rest), len(mesh.rest)
        self.edge = mesh_edges(mesh.face)
        self.size = self.size or len(self.edge)
        self.index = self.body.skeleton.searched()
        arrays = make_body_arrays(self.body, np.eye(3), mesh, device, bases=n)
        arrays.root_base.assign(self.base.astype(np.float32))
        self.posed = filled(
            Posed,
            body=arrays,
            joints=poisoned_joints(n, joints, device),
            axes=poisoned((n, joints), wp.mat33, device),
            vertex=poisoned((n, vertices), wp.vec3, device),
        )
        self.edges = filled(
            Edges,
            face=wp.array(mesh.face, dtype=wp.vec3i, device=device),
            edge=wp.array(self.edge, dtype=wp.vec4i, device=device),
        )
        sizes = vertices, len(mesh.face), len(self.edge)
        self.outline = poisoned_outline(n, len(self.rig), self.size, sizes, device, self.bands)
        self.residuals = poisoned_residuals(n, len(self.rig), self.size, device)
        vertex, joint = self.change or (np.zeros((0, vertices, 3)), np.zeros((0, joints, 3)))
        self.rest_change = filled(
            RestChange,
            vertex=wp.array(vertex, dtype=wp.vec3, device=device),
            joint=wp.array(joint, dtype=wp.vec3, device=device),
            origin=poisoned((n if len(vertex) else 0, len(vertex), joints), wp.vec3, device),
        )
        self.width = len(self.index) + len(vertex) + self.own + 1
        self.rows = filled(
            Rows,
            value=poisoned(n * len(self.rig) * self.size * self.width, wp.float32, device),
            width=self.width,
            own=self.own,
        )
        triangle = self.width * (self.width + 1) // 2
        self.sums = filled(
            Sums,
            triangle=poisoned(n * len(self.rig) * triangle, wp.float32, device),
            tally=poisoned((n, len(self.rig)), wp.vec4, device),
        )
        self.fields = DistanceFields(self.rig, 1, device)
        self.place = wp.zeros(n, dtype=wp.int32, device=device)
        self.moving = moving_skin(self.late, self.place, n, vertices, device)
        self.views = make_views(self.rig, device)

    @property
    def batch(self) -> Batch:
        """All candidates."""
        return batch_of(0, len(self.pose), len(self.pose), self.device)

    @cached_property
    def tree(self) -> Tree:
        """As the fitter has it."""
        fitter = ContourFitter(
            self.body, self.rig, self.index, self.body.skeleton.coordinate_limits, candidates=1, device=self.device
        )
        return fitter._tree

    def found(self) -> Contours:
        """Posed, with contours."""
        pose = wp.array(self.pose, dtype=wp.float32, device=self.device)
        vertex = wp.array(np.arange(len(self.body.tracking.rest)), dtype=wp.int32, device=self.device)
        pose_vertices(self.posed.body, pose, vertex, self.batch, self.posed.joints, self.posed.vertex)
        turn_axes(pose, self.batch, self.posed)
        find_contours(self.edges, self.posed.vertex, self.moving, self.views, self.batch, self.outline)
        return self

    def matched(self, masks: list[np.ndarray]) -> Contours:
        """With residuals against masks."""
        self.found()
        self.fields.observe([Observation.from_masks(masks)])
        matching = filled(Matching, **self.matching)
        find_residuals(self.outline, self.fields.judging(self.place), self.views, matching, self.batch, self.residuals)
        return self

    def summed(self, masks: list[np.ndarray]) -> Contours:
        """With the rows and their sums."""
        self.matched(masks)
        move_origins(self.posed, self.rest_change, self.batch)
        differentiate(
            self.posed,
            self.tree,
            self.rest_change,
            self.views,
            self.outline,
            self.residuals,
            self.batch,
            self.rows,
        )
        sum_tallies(self.outline, self.residuals, self.batch, self.sums)
        sum_normal_equations(self.outline, self.residuals, self.rows, self.batch, self.sums)
        return self

    def rows_of(self, c: int, k: int) -> np.ndarray:
        """(contour edge, column) float64 rows of a view."""
        rows = self.rows.value.numpy().reshape(len(self.pose), len(self.rig), self.size, self.width)
        return rows[c, k, : self.outline.count.numpy()[c, k]].astype(float)

    def sums_of(self, c: int, k: int) -> np.ndarray:
        """(column, column) float64 sums of a view, the lower triangle."""
        triangle = np.zeros((self.width, self.width))
        triangle[np.tril_indices(self.width)] = self.sums.triangle.numpy().reshape(len(self.pose), len(self.rig), -1)[
            c, k
        ]
        return triangle

    def twin(self, c: int) -> np.ndarray:
        """(vertex, 3) float64 [m] of a candidate."""
        return ExactPoser(self.body, self.base[c]).vertices(self.pose[c][None])[0][self.body.tracking_vertex]


def moving_skin(late: np.ndarray | None, frame: object, n: int, vertices: int, device: str) -> Moving:
    """A skin that is not known to move, for views that are late by so much."""
    times = np.zeros((1, 16 if late is None else len(late))) if late is None else np.asarray(late)[None]
    return filled(
        Moving,
        late=wp.array(times, dtype=wp.float32, device=device),
        frame=frame,
        own=0.0,
        velocity=wp.zeros((n, vertices), dtype=wp.vec3, device=device),
        bend=wp.zeros((n, vertices), dtype=wp.vec3, device=device),
    )


def image_of(rig: CameraRig, k: int, points: np.ndarray) -> np.ndarray:
    """(n, 2) float64 [px] of points (n, 3) in a camera."""
    p = points @ rig.R[k].T + rig.t[k]
    return p[:, :2] / p[:, 2:] * (rig.K[k, 0, 0], rig.K[k, 1, 1]) + rig.K[k, :2, 2]


def contour_edges(edge: np.ndarray, face: np.ndarray, image: np.ndarray, doubt: float = 1e-2) -> tuple[set, set]:
    """Directed edges (start, end) at which a facing triangle meets one that does not, and those that are doubtful.

    Doubtful is what touches a triangle of less than ``doubt`` [px^2].
    """
    a, b, c = (image[face[:, i]] for i in range(3))
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    sure, doubtful = set(), set()
    for start, end, left, right in edge.tolist():
        if min(abs(area[left]), abs(area[right])) < doubt:
            doubtful |= {(start, end), (end, start)}
        elif (area[left] < 0) != (area[right] < 0):
            sure.add((start, end) if area[left] < 0 else (end, start))
    return sure, doubtful


def depth_in_body(point: np.ndarray, face: np.ndarray, image: np.ndarray) -> np.ndarray:
    """(n,) how deep points (n, 2) lie in the body's image, in its deepest triangle; negative outside [px]."""
    a, b, c = (image[face[:, i]] for i in range(3))
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    depth = np.full((len(point), len(face)), np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        along = end - start
        length = np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-12)
        from_start = point[:, None] - start
        side = (along[:, 0] * from_start[..., 1] - along[:, 1] * from_start[..., 0]) / length
        depth = np.minimum(depth, side * np.sign(area))
    return depth.max(axis=1)
