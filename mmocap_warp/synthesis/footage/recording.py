"""A body in motion as its cameras' masks, each frame made when it is asked for and the same in any order."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mmocap_warp.bodies.human import JOINTS
from mmocap_warp.body.model import BodyModel
from mmocap_warp.synthesis.footage.outlines import Surface, fill
from mmocap_warp.synthesis.footage.segmentation import Contrast, Patch, segment
from mmocap_warp.synthesis.posing import SkinnedBody, joint_transforms
from mmocap_warp.views.observation import Observation
from mmocap_warp.views.rig import CameraRig

_LIGHT = np.array([0.45, -0.3, -1.0])  # where the lamps shine to
_SHADOWED = tuple(JOINTS.index(name) for name in ("LKnee", "LAnkle", "RKnee", "RAnkle"))  # shanks and feet
_PATCH_LIFE = 24  # frames in which a patch that looks like the background comes and goes
_PATCH_RADIUS = (0.015, 0.06)  # [m]
_DROPOUT_EVERY, _DROPOUT_FRAMES = 100, (6, 19)  # at most one in so many frames, and how long it lasts
_MASK, _PATCHES, _DROPOUT = range(3)  # what chance is drawn for


@dataclass(frozen=True)
class Footage:
    """A body that moves before pinhole cameras. The world's floor is at zero.

    Attributes:
        body: who is seen.
        root_base: (3, 3), world from body axes at zero root rotation.
        poses: (frame, 51) full pose vectors.
        rig: the cameras, without distortion.
        contrast: one per camera.
        seed: where the faults' chance comes from.
    """

    body: BodyModel
    root_base: np.ndarray
    poses: np.ndarray
    rig: CameraRig
    contrast: tuple[Contrast, ...]
    seed: int

    def vertices(self, frame: int) -> np.ndarray:
        """(vertex, 3) float64, the full mesh in the world [m]."""
        return self._skin.vertices(self.joints[frame])

    @cached_property
    def joints(self) -> np.ndarray:
        """(frame, joint, 3, 4), axes and places of the joints in the world."""
        return joint_transforms(self.body, self.root_base, self.poses)

    def silhouettes(self, frame: int) -> list[np.ndarray]:
        """Per camera (height, width) bool: what a faultless segmentation would give."""
        return self._silhouettes(self.vertices(frame))

    def masks(self, frame: int) -> list[np.ndarray]:
        """Per camera (height, width) bool, with faults; empty where the camera has dropped out."""
        vertices = self.vertices(frame)
        shadow = self._shadow(vertices)
        masks = []
        for k, silhouette in enumerate(self._silhouettes(vertices)):
            if self.dropped_out(k, frame):
                masks.append(np.zeros_like(silhouette))
                continue
            cast = self._fill(k, *shadow) if self.contrast[k].shadow > 0 else silhouette
            rng = np.random.default_rng([self.seed, _MASK, k, frame])
            masks.append(segment(silhouette, cast, self._patches(k, frame, vertices), self.contrast[k], rng))
        return masks

    def observation(self, frame: int) -> Observation:
        """The masks of a frame, packed."""
        return Observation.from_masks(self.masks(frame))

    def dropped_out(self, k: int, frame: int) -> bool:
        """Whether camera ``k`` delivers nothing in a frame; in frame 0, where tracking starts, all do."""
        block = frame // _DROPOUT_EVERY
        rng = np.random.default_rng([self.seed, _DROPOUT, k, block])
        first = block * _DROPOUT_EVERY + 1 + rng.integers(_DROPOUT_EVERY - _DROPOUT_FRAMES[1])
        happens = rng.random() < self.contrast[k].dropouts * _DROPOUT_EVERY / 1000
        return bool(happens and first <= frame < first + rng.integers(*_DROPOUT_FRAMES))

    @cached_property
    def _skin(self) -> SkinnedBody:
        return SkinnedBody(self.body)

    @cached_property
    def _surface(self) -> Surface:
        return Surface.of(self.body.skin.face)

    @cached_property
    def _low_surface(self) -> Surface:
        """Of the mesh, what casts the shadow at the feet."""
        skin = self.body.skin
        heaviest = skin.joint[np.arange(len(skin.joint)), skin.weight.argmax(axis=1)]
        return Surface.of(skin.face[np.isin(heaviest, _SHADOWED)[skin.face].all(axis=1)])

    @cached_property
    def _share_of_skin(self) -> np.ndarray:
        """(face,) each face's share of the body's surface, summed up: for drawing points evenly."""
        corner = self.body.skin.rest[self.body.skin.face]
        area = np.linalg.norm(np.cross(corner[:, 2] - corner[:, 0], corner[:, -1] - corner[:, 1]), axis=1)
        return np.cumsum(area) / area.sum()

    def _silhouettes(self, vertices: np.ndarray) -> list[np.ndarray]:
        viewers = np.concatenate([self.rig.centres, np.ones((len(self.rig), 1))], axis=1)
        facing = self._surface.facing(vertices, viewers)
        return [self._fill(k, vertices, *self._surface.contour(facing[k])) for k in range(len(self.rig))]

    def _shadow(self, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The outline of the shadow of shanks and feet: vertices laid on the floor, edges and their signs."""
        surface, up = self._low_surface, self.rig.up_vector
        on_floor = vertices - np.outer(vertices @ up / (_LIGHT @ up), _LIGHT)
        lit = surface.facing(vertices, np.append(-_LIGHT, 0.0)[None])[0]
        return on_floor, *surface.contour(lit)

    def _fill(self, k: int, vertices: np.ndarray, edge: np.ndarray, sign: np.ndarray) -> np.ndarray:
        start, end = (self._project(k, vertices[ends]) for ends in edge.T)
        return fill(start, end, sign, *self.rig.size[k])

    def _project(self, k: int, points: np.ndarray) -> np.ndarray:
        """Pixels (..., 2) of points (..., 3) in camera ``k``."""
        seen = points @ self.rig.R[k].T + self.rig.t[k]
        focal, centre = self.rig.K[k, [0, 1], [0, 1]], self.rig.K[k, :2, 2]
        return seen[..., :2] / seen[..., 2:] * focal + centre

    def _patches(self, k: int, frame: int, vertices: np.ndarray) -> list[Patch]:
        """What of the body looks like the background to camera ``k``: stays on the skin for a fraction of a second."""
        block = frame // _PATCH_LIFE
        rng = np.random.default_rng([self.seed, _PATCHES, k, block])
        patches = []
        for _ in range(rng.poisson(3.0 * self.contrast[k].holes)):  # each is there for a third of its block, on average
            begin, end = np.sort(rng.integers(0, _PATCH_LIFE + 1, 2)) + block * _PATCH_LIFE
            face = int(np.searchsorted(self._share_of_skin, rng.random()))
            radii, angle = rng.uniform(*_PATCH_RADIUS, 2), rng.uniform(0, 180)
            if begin <= frame < end:
                place = vertices[self.body.skin.face[face, 0]]
                column, row = self._project(k, place)
                across, along = radii * self.rig.K[k, 0, 0] / float(self.rig.R[k, 2] @ place + self.rig.t[k, 2])
                patches.append(Patch((float(column), float(row)), (float(across), float(along)), angle))
        return patches
