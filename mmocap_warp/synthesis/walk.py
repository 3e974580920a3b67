"""The walking recording: who walks where, seen by which cameras, with what faults."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mmocap_warp.bodies.human import JOINTS
from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.posing import Poser
from mmocap_warp.body.shape_space import heading_rotation, upright_base
from mmocap_warp.result.truth import Truth
from mmocap_warp.synthesis.footage.cameras import placed_camera
from mmocap_warp.synthesis.footage.faults import Faults, spoil
from mmocap_warp.synthesis.footage.polygons import draw_silhouettes
from mmocap_warp.synthesis.motion.gait import Walk
from mmocap_warp.synthesis.motion.gait_curves import CADENCE
from mmocap_warp.synthesis.walker import walker
from mmocap_warp.views.rig import CameraRig

FRAMES, FPS = 64, 60.0
_HEADING = 0.6  # of the walk in the world, halfway [rad]
_SIZE = (640, 480)

# Bearing [degrees], distance and height of the centre, height looked at [m], roll [degrees], focal length, principal
# point off the image's middle [px], distortion k1 k2 p1 p2.
_CAMERAS = (
    (14.0, 4.2, 1.25, 0.90, 0.4, 668.0, 3.1, -1.4, -0.165, 0.060, 0.0004, -0.0003),
    (83.0, 3.9, 2.30, 0.88, -0.9, 641.0, -2.6, 2.2, -0.152, 0.048, -0.0006, 0.0002),
    (158.0, 4.4, 1.05, 0.92, 0.7, 682.0, 1.7, 3.5, -0.171, 0.066, 0.0003, 0.0005),
    (226.0, 4.0, 1.90, 0.87, -0.3, 655.0, -3.8, -0.9, -0.148, 0.041, -0.0002, -0.0004),
    (297.0, 3.8, 1.55, 0.91, 1.1, 634.0, 0.6, -2.7, -0.159, 0.053, 0.0005, 0.0001),
)
_FAULTS = (
    Faults(grow=-0.2, ragged=0.5, holes=1.5, specks=2.0, salt=5e-5),
    Faults(grow=0.1, ragged=0.6, holes=1.5, specks=2.0, salt=5e-5, shadow=0.15),
    Faults(grow=-0.3, ragged=0.5, holes=2.5, specks=2.0, salt=5e-5),
    Faults(grow=0.2, ragged=0.6, holes=1.5, specks=4.0, salt=5e-5, shadow=0.22),
    Faults(grow=0.0, ragged=0.7, smooth=7.0, holes=1.5, specks=2.0, salt=1e-4),
)
_LIGHT = np.array([0.6, -0.35, -1.0])


@dataclass(frozen=True)
class Recording:
    """A body in motion before cameras, known exactly. The world has +Z up, the floor is at zero.

    Attributes:
        body: who is seen.
        root_base: (3, 3), world from body axes at zero root rotation.
        poses: (frame, 51) full pose vectors.
        rig: the cameras, with distortion.
        faults: per camera, what is wrong with its masks.
        fps: frames per second.
        seed: where the faults' chance comes from.
    """

    body: BodyModel
    root_base: np.ndarray
    poses: np.ndarray
    rig: CameraRig
    faults: tuple[Faults, ...]
    fps: float
    seed: int

    @cached_property
    def vertices(self) -> np.ndarray:
        """(frame, vertex, 3), the full mesh in the world [m]."""
        return Poser(self.body, self.root_base).vertices(self.poses)

    def perfect_masks(self, frame: int) -> list[np.ndarray]:
        """Per camera (height, width) bool: what a faultless segmentation of the distorted image would give."""
        return draw_silhouettes(self.rig, self.vertices[frame], self.body.skin.face)

    def masks(self, frame: int) -> list[np.ndarray]:
        """Per camera (height, width) bool, with faults; the same for the same seed, camera and frame."""
        return [self._spoilt(k, frame, mask) for k, mask in enumerate(self.perfect_masks(frame))]

    def truth(self) -> Truth:
        """Markers, joints and poses of every frame."""
        transforms = Poser(self.body, self.root_base).joint_transforms(self.poses)
        return Truth(
            fps=self.fps,
            frame_numbers=np.arange(len(self.poses)),
            marker_names=self.body.marker_names,
            markers=self.vertices[:, self.body.marker_vertex].astype(float),
            joint_names=JOINTS,
            joints=transforms[:, :, :3, 3].astype(float),
            pose=self.poses,
        )

    def _spoilt(self, k: int, frame: int, mask: np.ndarray) -> np.ndarray:
        faults = self.faults[k]
        shadow = self._shadow(k, frame, faults.shadow) if faults.shadow else np.zeros_like(mask)
        return spoil(mask, shadow, faults, np.random.default_rng([self.seed, k, frame]))

    def _shadow(self, k: int, frame: int, below: float) -> np.ndarray:
        """Camera ``k``'s view of the shadow on the floor of what is lower than ``below``."""
        vertices, faces, up = self.vertices[frame], self.body.skin.face, self.rig.up_vector
        height = vertices @ up
        low = faces[(height[faces] < below).all(axis=1)]
        on_floor = vertices - np.outer(height / (_LIGHT @ up), _LIGHT)
        return draw_silhouettes(self.rig.select((self.rig.names[k],)), on_floor, low)[0]


def walking(frames: int = FRAMES, seed: int = 0) -> Recording:
    """The recording of the built-in scene: nearly a stride along part of a circle, five cameras around its middle."""
    body = walker()
    base = upright_base("+z") @ heading_rotation(_HEADING)
    cycles = CADENCE / 120.0 / FPS
    poses = Walk(body).poses(cycles * (np.arange(frames) - (frames - 1) / 2))
    poses[:, :3] = poses[:, :3] @ base.T
    return Recording(body, base, poses, camera_ring(), _FAULTS, FPS, seed)


def camera_ring() -> CameraRig:
    """Five cameras of slightly different lenses around the origin, no two alike in height or distance."""
    placed = [placed_camera(*row[:6], row[6:8], _SIZE) for row in _CAMERAS]
    K, R, t = (np.array(column) for column in zip(*placed, strict=True))
    distortion = np.array([(*row[8:], 0.0) for row in _CAMERAS])
    names = tuple(f"cam{k + 1}" for k in range(len(_CAMERAS)))
    return CameraRig(names, K, R, t, np.tile(_SIZE, (len(names), 1)), distortion, "+z")
