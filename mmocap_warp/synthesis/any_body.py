"""Any body in a motion of its own, amid a ring of cameras: what to expect of a recording before it is made."""

from pathlib import Path

import numpy as np

from mmocap_warp.body.model import BodyModel, BodyMotion, Subject
from mmocap_warp.body.shape_space import upright_base
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.synthesis.exact_posing import ExactPoser
from mmocap_warp.synthesis.footage.faults import Faults, SpoiltMasks
from mmocap_warp.synthesis.footage.made_recording import Recording, placed_camera
from mmocap_warp.synthesis.writing import FAULTY_MASKS, Progress, write_made_scene

SIZE = (640, 480)
"""Of the cameras' images, by default [px]."""

_FILLED = 0.85  # share of the image that the motion takes at most
_FOCAL = 1.4  # focal length, in widths of the image
_ELEVATIONS = (4.0, 20.0, 10.0, 30.0, 15.0)  # of the cameras over the middle of the motion, in turn [degrees]
_FIRST_BEARING = 14.0  # direction of the first camera [degrees]: none looks along an axis of the world
_FAULTS = (
    Faults(grow=-0.2, ragged=0.5, holes=1.5, specks=2.0, salt=5e-5),
    Faults(grow=0.2, ragged=0.6, holes=1.5, specks=3.0, salt=5e-5),
    Faults(grow=0.0, ragged=0.7, smooth=7.0, holes=2.5, specks=2.0, salt=1e-4),
)
_LIGHT = np.array([0.6, -0.35, -1.0])
_FOREGROUND = f"# The masks have ragged contours, holes and specks.\n{FAULTY_MASKS}"
_PERFECT = '[foreground]\nsource = "masks"\n'


def recorded(
    body: BodyModel,
    motion: BodyMotion,
    cameras: int,
    *,
    size: tuple[int, int] = SIZE,
    faulty: bool = True,
    seed: int = 0,
) -> Recording:
    """A body that moves amid cameras, in a world with +Z up and its floor under the lowest point of the motion.

    The cameras stand evenly around it, with images of a ``size`` of width and height [px]. Their masks have the faults
    of real ones if they are to be ``faulty``, by chance that begins with ``seed``.
    """
    base, poses = upright_base("+z"), motion.pose.copy()
    poses[:, :3] = poses[:, :3] @ base.T
    poser = ExactPoser(body, base)
    used = np.unique(body.skin.face)
    seen = np.stack([poser.vertices(pose[None])[0][used] for pose in poses])
    low, high = seen.min(axis=(0, 1)), seen.max(axis=(0, 1))
    poses[:, :3] -= np.array([*((low + high) / 2)[:2], low[2]])
    seen -= np.array([*((low + high) / 2)[:2], low[2]])
    rig = camera_ring(cameras, seen.reshape(-1, 3), size)
    faults = tuple(_FAULTS[k % len(_FAULTS)] if faulty else Faults() for k in range(cameras))
    return Recording(body, base, poses, motion.fps, rig, SpoiltMasks(body.skin.face, faults, _LIGHT, seed))


def camera_ring(cameras: int, seen: np.ndarray, size: tuple[int, int]) -> CameraRig:
    """Cameras evenly around points (n, 3) [m], at several elevations, each as near as it can be and see all of them.

    They look at the vertical through the origin of a world with +Z up, at half the points' height.
    """
    focal, middle = _FOCAL * size[0], float(seen[:, 2].min() + seen[:, 2].max()) / 2
    placed = []
    for k in range(cameras):
        bearing = _FIRST_BEARING + 360.0 * k / cameras
        elevation = np.radians(_ELEVATIONS[k % len(_ELEVATIONS)])
        rise = float(np.tan(elevation))  # of the camera over the middle, by its distance from the vertical
        _, R, _ = placed_camera(bearing, 1.0, middle + rise, middle, 0.0, focal, (0.0, 0.0), size)
        x, y, ahead = R @ (seen - (0.0, 0.0, middle)).T
        needed = np.maximum(np.abs(x) / size[0], np.abs(y) / size[1]) * 2 * focal / _FILLED - ahead
        distance = float(needed.max() * np.cos(elevation))
        placed.append(placed_camera(bearing, distance, middle + rise * distance, middle, 0.0, focal, (0.0, 0.0), size))
    K, R, t = (np.array(column) for column in zip(*placed, strict=True))
    names = tuple(f"cam{k + 1}" for k in range(cameras))
    return CameraRig(names, K, R, t, np.tile(size, (cameras, 1)), np.zeros((cameras, 5)), "+z")


def write_recorded(
    folder: Path, recording: Recording, faulty: bool, *, file: Path | None = None, progress: Progress | None = None
) -> Path:
    """Write the recording as a scene with its truth, and the body in its first pose; the path of ``scene.toml``.

    Masks that are ``faulty`` are to be cleaned. A ``file`` of the body with its motions is what a fit starts from.
    ``progress`` is called after each frame. Raises an InputError for a folder that cannot be written to.
    """
    body = recording.body
    return write_made_scene(
        folder,
        recording,
        recording.truth(),
        name=folder.resolve().name,
        about=f"{body.name}, made up with known truth. {body.attribution}",
        foreground=_FOREGROUND if faulty else _PERFECT,
        subject=Subject(body, recording.root_base, recording.poses[0], {}),
        body=file,
        progress=progress,
    )
