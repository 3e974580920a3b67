"""Make the built-in scene again: ``python instruments/walk_scene.py FOLDER``.

A person walks nearly a stride, seen by five cameras whose masks have faults.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from gait_curves import CADENCE
from made_walks import Walk

from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.posing import Poser
from mmocap_warp.body.shape_space import heading_rotation, upright_base
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.errors import InputError
from mmocap_warp.rigging.shipped import load_body
from mmocap_warp.synthesis.footage.faults import Faults, SpoiltMasks
from mmocap_warp.synthesis.footage.made_recording import Recording, placed_camera
from mmocap_warp.synthesis.walkers import stretched
from mmocap_warp.synthesis.writing import FAULTY_MASKS, write_made_scene

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

FOREGROUND = f"# The masks have ragged contours, holes, specks and shadows.\n{FAULTY_MASKS}"


_WALKER_SHAPE: dict[str, float] = {
    "weight_incr": 0.35,
    "muscle_incr": 0.25,
    "leg_length_incr": 0.30,
    "arm_length_decr": 0.20,
    "shoulder_width_incr": 0.40,
    "waist_incr": 0.30,
}
_WALKER_STRETCH = (1.02, 0.99, 1.03)


class _SinglePrecision(Poser):
    """Poses a body as the tracker does: the scene was first made so."""

    def moving(self, poses: np.ndarray, frame: int, fps: float) -> np.ndarray:
        """The vertices (vertex, 3) in a frame of a motion [m]."""
        return self.vertices(poses[frame : frame + 1])[0]


def walker() -> BodyModel:
    """The shipped woman, heavier, stronger, longer of leg, broader of shoulder, then stretched unequally."""
    return stretched(load_body("adult_woman").shaped(_WALKER_SHAPE), "walker", _WALKER_STRETCH)


def walking(frames: int = FRAMES, seed: int = 0) -> Recording:
    """Part of a circle, walked along amid the cameras."""
    body = walker()
    base = upright_base("+z") @ heading_rotation(_HEADING)
    cycles = CADENCE / 120.0 / FPS
    poses = Walk(body).poses(cycles * (np.arange(frames) - (frames - 1) / 2))
    poses[:, :3] = poses[:, :3] @ base.T
    return Recording(body, base, poses, FPS, camera_ring(), segmentation(body, seed), posed_by=_SinglePrecision)


def segmentation(body: BodyModel, seed: int = 0) -> SpoiltMasks:
    """The masks that the scene's cameras get of a body."""
    return SpoiltMasks(body.skin.face, _FAULTS, _LIGHT, seed)


def camera_ring() -> CameraRig:
    """Five cameras of slightly different lenses around the origin, no two alike in height or distance."""
    placed = [placed_camera(*row[:6], row[6:8], _SIZE) for row in _CAMERAS]
    K, R, t = (np.array(column) for column in zip(*placed, strict=True))
    distortion = np.array([(*row[8:], 0.0) for row in _CAMERAS])
    names = tuple(f"cam{k + 1}" for k in range(len(_CAMERAS)))
    return CameraRig(names, K, R, t, np.tile(_SIZE, (len(names), 1)), distortion, "+z")


def write_walk(folder: str | Path, recording: Recording) -> Path:
    """Write the recording as a scene named after its folder, and return the path of ``scene.toml``.

    Raises:
        InputError: a folder that cannot be written to.
    """
    return write_made_scene(
        Path(folder),
        recording,
        recording.truth(),
        name=Path(folder).resolve().name,
        about="A person walking along part of a circle, made up with known truth. See README.md.",
        foreground=FOREGROUND,
    )


if __name__ == "__main__":
    if len(sys.argv) != 2:
        raise SystemExit("usage: python instruments/walk_scene.py FOLDER")
    try:
        print(f"wrote {write_walk(sys.argv[1], walking())}")
    except InputError as error:
        print(error, file=sys.stderr)
        raise SystemExit(3) from None
