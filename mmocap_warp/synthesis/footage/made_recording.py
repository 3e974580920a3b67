"""A body in motion before cameras, known exactly; each frame is made when asked for, the same in any order."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.rotations import turn
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.masks.observation import Observation
from mmocap_warp.result.truth import Truth
from mmocap_warp.synthesis.exact_posing import ExactPoser
from mmocap_warp.synthesis.footage.faults import SpoiltMasks
from mmocap_warp.synthesis.footage.segmentation import SegmentedMasks


@dataclass(frozen=True)
class Recording:
    """A body that moves before cameras. The world's floor is at zero."""

    body: BodyModel  # who is seen
    root_base: np.ndarray  # (3, 3), world from body axes at zero root rotation
    poses: np.ndarray  # (frame, 51) full pose vectors
    fps: float  # frames per second
    rig: CameraRig  # the cameras
    segmentation: SpoiltMasks | SegmentedMasks  # how their masks come about
    posed_by: Callable[[BodyModel, np.ndarray], ExactPoser] = ExactPoser  # makes what poses the body
    worn: np.ndarray | None = None  # (vertex,) bool, of the full mesh: those of a garment, if one is worn

    def __len__(self) -> int:
        return len(self.poses)

    def first(self, count: int) -> Self:
        """The recording cut after ``count`` frames, which stay as they are."""
        return replace(self, poses=self.poses[:count])

    def vertices(self, frame: int) -> np.ndarray:
        """(vertex, 3), the full mesh in the world [m]."""
        return self._poser.moving(self.poses, frame, self.fps)

    def masks(self, frame: int) -> list[np.ndarray]:
        """Per camera (height, width) bool, with faults."""
        return self.segmentation.masks(self.rig, self.vertices(frame), frame)

    def observation(self, frame: int) -> Observation:
        """The masks of a frame, packed."""
        return Observation.from_masks(self.masks(frame))

    def truth(self, more_joints: Mapping[str, int] | None = None) -> Truth:
        """Markers, joints and poses of every frame, exactly; vertices in ``more_joints`` count as joints, by name."""
        named = more_joints or {}
        points = np.array([*self.body.marker_vertex, *named.values()], int)
        skin = np.stack([self.vertices(frame)[points] for frame in range(len(self))]).astype(float)
        markers, more = np.split(skin, [len(self.body.marker_vertex)], axis=1)
        places = self._poser.joint_transforms(self.poses)[:, :, :3, 3].astype(float)
        return Truth(
            fps=self.fps,
            frame_numbers=np.arange(len(self)),
            marker_names=self.body.marker_names,
            markers=markers,
            joint_names=(*self.body.skeleton.joints, *named),
            joints=np.concatenate([places, more], axis=1),
            pose=self.poses,
            root_base=self.root_base,
        )

    @cached_property
    def _poser(self) -> ExactPoser:
        return self.posed_by(self.body, self.root_base)


def placed_camera(
    bearing: float,
    distance: float,
    height: float,
    aim: float,
    roll: float,
    focal: float,
    offset: tuple[float, float],
    size: tuple[int, int],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """K, R and t of a camera that looks at the vertical through the origin of a world with +Z up.

    Its centre is at a ``distance`` from the vertical [m], in a ``bearing`` that counts from +X toward +Y [degrees], and
    at a ``height`` [m]. It looks at the height ``aim`` [m], with a ``roll`` about that line [degrees]. Focal length,
    the ``offset`` of its principal point from the image's middle, and the image's width and height are in pixels.
    """
    angle = np.radians(bearing)
    centre = np.array([distance * np.cos(angle), distance * np.sin(angle), height])
    forward = np.array([0.0, 0.0, aim]) - centre
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    R = turn("z", np.radians(-roll)) @ np.stack([right, np.cross(forward, right), forward])
    (x, y), (width, height_px) = offset, size
    K = np.array([[focal, 0.0, (width - 1) / 2 + x], [0.0, focal, (height_px - 1) / 2 + y], [0.0, 0.0, 1.0]])
    return K, R, -R @ centre
