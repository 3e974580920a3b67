"""Recordings of small frames on disk, few or many, and a study of one."""

from __future__ import annotations

import os
from itertools import cycle, islice
from pathlib import Path

import numpy as np
from person_skeleton import JOINTS
from synthetic import ring_rig, synthetic_poses, synthetic_subject

from mmocap_warp.body.posing import Poser
from mmocap_warp.cameras.silhouette import silhouettes
from mmocap_warp.formats.calibration.toml_rig import write_toml_rig
from mmocap_warp.formats.image_files import write_png
from mmocap_warp.formats.truth_file import write_truth
from mmocap_warp.formats.usd.usd_body import write_subject
from mmocap_warp.result.truth import Truth

FRAMES = 8
_STRIDE = 40  # frames in one direction
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


def write_recording(folder: Path, frames: int = FRAMES, speed: float = 1.0) -> None:
    """Three cameras see the test body move, to and fro; a frame that comes again is a link to the same file."""
    subject, rig = synthetic_subject(), ring_rig(3, _SIZE, distance=3.0)
    once = synthetic_poses(round(200 / speed))[:_STRIDE]
    there_and_back = list(islice(cycle([*range(_STRIDE), *range(_STRIDE - 2, 0, -1)]), frames))
    poser = Poser(subject.body, subject.root_base)
    for name in rig.names:
        (folder / "masks" / name).mkdir(parents=True)
    for frame, number in enumerate(there_and_back):
        first = there_and_back.index(number)
        files = [folder / "masks" / name / f"{frame:06d}.png" for name in rig.names]
        if first < frame:
            for file in files:
                os.link(file.with_name(f"{first:06d}.png"), file)
            continue
        masks = silhouettes(rig, poser.tracking_vertices(once[number])[0], subject.body.tracking_face)
        for file, mask in zip(files, masks, strict=True):
            write_png(file, mask)
    write_toml_rig(folder / "calibration.toml", rig)
    write_subject(folder / "subject.usdc", subject)
    markers = poser.vertices(once)[:, subject.body.marker_vertex].astype(float)[there_and_back]
    joints = poser.joint_transforms(once)[:, :, :3, 3].astype(float)[there_and_back]
    truth = Truth(60.0, np.arange(frames), subject.body.marker_names, markers, JOINTS, joints)
    write_truth(folder / "truth.usdc", truth, up="+y")
    cameras = "\n".join(f'[cameras.{name}]\nmasks = "masks/{name}"' for name in rig.names)
    (folder / "scene.toml").write_text(_SCENE.format(cameras=cameras))


def write_many(folder: Path) -> None:
    """Three short recordings."""
    for name in ("many/one", "many/two", "many/three"):
        (folder / name).mkdir(parents=True)
        write_recording(folder / name, 3)


def write_study(folder: Path) -> None:
    """Three cells of the recording."""
    (folder / "study.toml").write_text(_STUDY)
