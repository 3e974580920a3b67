"""A recording of a few small frames, and a study of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from synthetic import ring_rig, synthetic_poses, synthetic_subject

from mmocap_warp.bodies.human import JOINTS
from mmocap_warp.body.posing import Poser
from mmocap_warp.formats.calibration.toml_rig import write_toml_rig
from mmocap_warp.formats.png import write_png
from mmocap_warp.formats.usd.body import write_subject
from mmocap_warp.formats.usd.truth import write_truth
from mmocap_warp.result.truth import Truth
from mmocap_warp.views.silhouette import silhouettes

FRAMES = 8
_SIZE = (160, 120)
_SCENE = """
[scene]
fps = 60
up = "+y"
subject = "subject.usdc"
[cameras]
calibration = "calibration.toml"
{cameras}
[truth]
file = "truth.usdc"
[fit]
headings = 2
evaluations = 48
finalists = 1
frames = 3
[track]
device = "cpu"
"""
_STUDY = """
[study]
name = "killed"
[sequences]
Made = "scene.toml"
[[grid]]
sequences = ["Made"]
algorithms = ["h-cmaes", "pso", "apf"]
dof = [39]
evaluations = [300]
"""


def write_recording(folder: Path, frames: int = FRAMES) -> None:
    """Three cameras see the test body move."""
    subject, rig = synthetic_subject(), ring_rig(3, _SIZE)
    poses = synthetic_poses(5 * frames)[:frames]
    poser = Poser(subject.body, subject.root_base)
    for frame, pose in enumerate(poses):
        vertices = poser.tracking_vertices(pose)[0]
        for name, mask in zip(rig.names, silhouettes(rig, vertices, subject.body.tracking_face), strict=True):
            (folder / "masks" / name).mkdir(parents=True, exist_ok=True)
            write_png(folder / "masks" / name / f"{frame:05d}.png", mask)
    write_toml_rig(folder / "calibration.toml", rig)
    write_subject(folder / "subject.usdc", subject)
    markers = poser.vertices(poses)[:, subject.body.marker_vertex].astype(float)
    joints = poser.joint_transforms(poses)[:, :, :3, 3].astype(float)
    truth = Truth(60.0, np.arange(frames), subject.body.marker_names, markers, JOINTS, joints)
    write_truth(folder / "truth.usdc", truth, up="+y")
    cameras = "\n".join(f'[cameras.{name}]\nmasks = "masks/{name}"' for name in rig.names)
    (folder / "scene.toml").write_text(_SCENE.format(cameras=cameras))


def write_study(folder: Path) -> None:
    """Three cells of the recording."""
    (folder / "study.toml").write_text(_STUDY)
