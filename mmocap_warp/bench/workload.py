"""The measure: seven cameras of 640x480 around a body about 280 px tall, in poses near the one that was seen."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import warp as wp

from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.posing import Poser
from mmocap_warp.cameras.rig import CameraRig, project
from mmocap_warp.cameras.silhouette import silhouettes
from mmocap_warp.formats.usd.usd_body import read_body
from mmocap_warp.masks.observation import Observation
from mmocap_warp.scenes import ROOT
from mmocap_warp.silhouettes.objective import Objective

CAMERAS, SIZE = 7, (640, 480)
_DISTANCE, _EYE, _MIDDLE = 4.15, 1.4, 0.9  # [m] of the cameras from the body, their height, and the height they look at
_SPREAD = 0.05  # standard deviation of poses [rad, m]


@dataclass(frozen=True)
class Workload:
    """What is evaluated."""

    body: BodyModel  # its tracking mesh is drawn
    rig: CameraRig  # undistorted

    @cached_property
    def sizes(self) -> dict[str, int]:
        """Cameras, pixels of one of them, and triangles."""
        triangles = len(self.body.tracking_face)
        return {"cameras": len(self.rig), "pixels": int(self.rig.size[0].prod()), "triangles": triangles}

    def sizes_on(self, device: str, threads: int | None) -> dict[str, int | None]:
        """The sizes, with the number of threads on a CPU."""
        return self.sizes | ({"threads": threads} if device == "cpu" else {})

    @cached_property
    def seen(self) -> np.ndarray:
        """(coordinate,) float32, the pose that the masks show."""
        return self.poses(1, seed=1)[0]

    @cached_property
    def observation(self) -> Observation:
        """The masks of all cameras."""
        (vertices,) = self.vertices(self.seen[None])
        return Observation.from_masks(silhouettes(self.rig, vertices, self.body.tracking_face))

    def poses(self, candidates: int, seed: int = 0) -> np.ndarray:
        """(candidate, coordinate) float32: standing upright, and a little different in everything."""
        rng = np.random.default_rng(seed)
        pose = rng.normal(0.0, _SPREAD, (candidates, self.body.skeleton.coordinates)).astype(np.float32)
        pose[:, 1] += _MIDDLE
        return pose

    def vertices(self, poses: np.ndarray) -> np.ndarray:
        """(candidate, tracking vertex, 3) float32 [m], posed on the CPU."""
        return Poser(self.body, np.eye(3)).tracking_vertices(poses)

    @property
    def height(self) -> float:
        """Of the body in the images, mean over the cameras [px]."""
        (vertices,) = self.vertices(self.seen[None])
        return float(np.ptp(project(self.rig, vertices)[..., 1], axis=1).mean())

    def objective(self, candidates: int, renderer: str, device: str, threads: int = 1) -> Objective:
        """An objective with masks and poses in it."""
        made = Objective(self.body, np.eye(3), self.rig, candidates, renderer=renderer, device=device, threads=threads)
        made.observe(self.observation)
        made.pose.assign(self.poses(candidates))
        return made

    def posed(self, candidates: int, device: str) -> wp.array:
        """(candidate, tracking vertex) vec3 [m]."""
        return wp.array(self.vertices(self.poses(candidates)), dtype=wp.vec3, device=device)


def workload(cameras: int = CAMERAS, size: tuple[int, int] = SIZE) -> Workload:
    """The measure, or with another number of cameras or size of images [px]; the body fills the same share of them."""
    return Workload(read_body(ROOT / "bodies" / "adult_man.usdc"), _ring(cameras, size))


def _ring(cameras: int, size: tuple[int, int]) -> CameraRig:
    width, height = size
    angle = 2.0 * np.pi * np.arange(cameras) / cameras + 0.3
    eye = np.stack([_DISTANCE * np.sin(angle), np.full(cameras, _EYE), _DISTANCE * np.cos(angle)], axis=1)
    forward = np.array([0.0, _MIDDLE, 0.0]) - eye
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    right = np.cross(forward, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    R = np.stack([right, np.cross(forward, right), forward], axis=1)
    K = np.array([[width, 0.0, (width - 1) / 2], [0.0, width, (height - 1) / 2], [0.0, 0.0, 1.0]])
    names, t = tuple(f"cam{k}" for k in range(1, cameras + 1)), -np.einsum("kij,kj->ki", R, eye)
    repeated = np.tile(K, (cameras, 1, 1)), R, t, np.tile(size, (cameras, 1)), np.zeros((cameras, 5))
    return CameraRig(names, *repeated, "+y")
