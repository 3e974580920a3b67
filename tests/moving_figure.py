"""A small made-up recording that the commands are given, one after the other."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from person_skeleton import JOINTS
from small_scene import CAMERAS
from synthetic import ring_rig, synthetic_poses, synthetic_subject

from mmocap_warp.body.posing import Poser
from mmocap_warp.cameras.rig import project
from mmocap_warp.cameras.silhouette import silhouette
from mmocap_warp.formats.calibration.toml_rig import write_toml_rig
from mmocap_warp.formats.truth_file import write_truth
from mmocap_warp.formats.usd.usd_body import write_body, write_subject
from mmocap_warp.result.truth import Truth

FRAMES = 8
SCENE = f"""
[scene]
fps = 60
up = "+y"
subject = "subject.usdc"
{CAMERAS}
[truth]
file = "truth.usdc"
[track]
evaluations = 60
device = "cpu"
"""
PROMISED = ("frames", "lost", "evaluations", "evaluations_per_second", "mean_iou", "worst_iou")
PROMISED_WITH_TRUTH = ("marker_error_mm", "mpjpe_mm")


def write_moving_figure(folder: Path) -> Path:
    """Three cameras see the test body move for eight frames; the truth is known. The scene's file."""
    subject, rig, poses = synthetic_subject(), ring_rig(3, (160, 120)), synthetic_poses(40)[:FRAMES]
    poser = Poser(subject.body, subject.root_base)
    vertices = poser.vertices(poses)
    for frame, points in enumerate(poser.tracking_vertices(poses)):
        for name, pixels in zip(rig.names, project(rig, points), strict=True):
            (folder / "masks" / name).mkdir(parents=True, exist_ok=True)
            mask = silhouette(pixels, subject.body.tracking_face, (160, 120))
            cv2.imwrite(str(folder / "masks" / name / f"{frame:03d}.png"), mask)
    write_toml_rig(folder / "calibration.toml", rig)
    write_subject(folder / "subject.usdc", subject)
    write_body(folder / "boxes.usdc", subject.body)
    markers = vertices[:, subject.body.marker_vertex].astype(np.float64)
    joints = poser.joint_transforms(poses)[:, :, :3, 3].astype(np.float64)
    truth = Truth(60.0, np.arange(FRAMES), subject.body.marker_names, markers, JOINTS, joints)
    write_truth(folder / "truth.usdc", truth, up="+y")
    (folder / "scene.toml").write_text(SCENE)
    return folder / "scene.toml"
