"""A figure that swings its limbs and crosses the floor before four cameras, any of which may lag."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
from planted import swung
from synthetic import ring_rig, synthetic_body

from mmocap_warp.body.model import Subject
from mmocap_warp.calibration.adjust.footage import Motion
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.cameras.silhouette import silhouettes
from mmocap_warp.contour.frame.rooted import Rooting
from mmocap_warp.formats.calibration.toml_rig import write_toml_rig
from mmocap_warp.formats.image_files import write_png
from mmocap_warp.masks.observation import Observation, unpack_masks
from mmocap_warp.scene.recording import Scene
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.synthesis.exact_posing import ExactPoser

BODY = synthetic_body()
RIG = ring_rig(4)
FPS = 30.0
ROOTING = Rooting(BODY.skeleton, np.eye(3), BODY.skeleton.searched())


@cache
def motion() -> Motion:
    poses = swung(BODY, 64, FPS)
    way = np.linspace(0.0, 1.0, 64)
    poses[:, :3] = np.stack([1.6 * way - 0.8, np.full(64, 0.95), 0.5 * np.sin(5.0 * way)], axis=1)
    return Motion(ROOTING, ROOTING.enter(poses), FPS)


def masks_at(rig: CameraRig, frames: np.ndarray, late: np.ndarray) -> list[Observation]:
    """What cameras see, each so many frames after it happened."""
    views = []
    for k in range(len(rig)):
        rooted = motion().at(frames - late[k])
        camera = rig.select((rig.names[k],))
        posed = [
            ExactPoser(BODY, base).vertices(pose[None])[0][BODY.tracking_vertex]
            for base, pose in zip(rooted.base, rooted.pose, strict=True)
        ]
        views.append([silhouettes(camera, vertices, BODY.tracking_face)[0] for vertices in posed])
    return [Observation.from_masks(list(of_frame)) for of_frame in zip(*views, strict=True)]


def write_scene(folder: Path, rig: CameraRig = RIG, frames: int = 28, late: tuple[int, ...] = (0, 0, 0, 0)) -> Scene:
    """A scene of the figure's first frames, whose cameras are said to be ``rig``."""
    seen = masks_at(RIG, np.arange(frames), np.array(late, float))
    for frame, observation in enumerate(seen):
        for name, mask in zip(RIG.names, unpack_masks(observation.words, RIG.size), strict=True):
            (folder / "masks" / name).mkdir(parents=True, exist_ok=True)
            write_png(folder / "masks" / name / f"{frame:04d}.png", mask.astype(np.uint8) * 255)
    write_toml_rig(folder / "calibration.toml", rig)
    cameras = "".join(f'[cameras.{name}]\nmasks = "masks/{name}"\n' for name in RIG.names)
    about = f'[scene]\nfps = {FPS:g}\nup = "{RIG.up}"\n[cameras]\ncalibration = "calibration.toml"\n'
    (folder / "scene.toml").write_text(about + cameras)
    return load_scene(folder)


def subject() -> Subject:
    """The figure in the first frame."""
    first = motion().rooted[:1]
    pose = ROOTING.leave(first, np.zeros(3))[0]
    return Subject(BODY, ROOTING.root_base, pose, {})
