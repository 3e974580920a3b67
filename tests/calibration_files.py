"""Small calibrations as other programs write them, of any rig."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np

from mmocap_warp.cameras.rig import CameraRig


def write_easymocap(
    folder: Path, rig: CameraRig, rotation: str = "Rot", size: bool = True, per_metre: float = 1.0
) -> None:
    """``intri.yml`` and ``extri.yml``, by OpenCV's own writer; ``rotation`` is "Rot" (3x3) or "R" (Rodrigues)."""
    inside, outside = (cv2.FileStorage(str(folder / f"{name}.yml"), 1) for name in ("intri", "extri"))
    for storage in (inside, outside):
        storage.startWriteStruct("names", cv2.FileNode_SEQ)
        for name in rig.names:
            storage.write("", name)
        storage.endWriteStruct()
    for k, name in enumerate(rig.names):
        inside.write(f"K_{name}", rig.K[k])
        inside.write(f"dist_{name}", rig.distortion[k : k + 1])
        if size:
            inside.write(f"W_{name}", int(rig.size[k, 0]))
            inside.write(f"H_{name}", int(rig.size[k, 1]))
        outside.write(f"{rotation}_{name}", rig.R[k] if rotation == "Rot" else cv2.Rodrigues(rig.R[k])[0])
        outside.write(f"T_{name}", rig.t[k][:, None] * per_metre)
    inside.release()
    outside.release()


def caliscope(rig: CameraRig) -> str:
    """Caliscope's ``camera_array.toml``, and in it a camera without a place and one that is ignored."""
    lines = ["[cameras.8]\ncam_id = 8\nsize = [640, 480]\nrotation_count = 0\n"]
    for k, name in enumerate(rig.names):
        fisheye = name in rig.fisheye
        lines.append(
            f"[cameras.{k + 1}]\ncam_id = {k + 1}\nsize = {rig.size[k].tolist()}\nrotation_count = 0\nerror = 0.25\n"
            f"matrix = {rig.K[k].tolist()}\ndistortions = {rig.distortion[k, : 4 if fisheye else 5].tolist()}\n"
            f"translation = {rig.t[k].tolist()}\nrotation = {cv2.Rodrigues(rig.R[k])[0].ravel().tolist()}\n"
            f"grid_count = 20\nfisheye = {str(fisheye).lower()}\n"
        )
    return "\n".join([*lines, lines[1].replace("[cameras.1]", "[cameras.9]") + "ignore = true\n"])


def multical(rig: CameraRig) -> str:
    """MultiCal's ``calibration.json`` for the first camera's axes as world, the last one given from the second."""
    poses = []
    for R, t in zip(rig.R, rig.t, strict=True):
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = R, t
        poses.append(pose)
    master = rig.names[0]
    bases = dict.fromkeys(range(1, len(rig)), 0) | {len(rig) - 1: min(1, len(rig) - 2)}
    told = {master: {"R": np.eye(3).tolist(), "T": [0.0, 0.0, 0.0]}}
    for k, base in bases.items():
        pose = poses[k] @ np.linalg.inv(poses[base])
        told[f"{rig.names[k]}_to_{rig.names[base]}"] = {"R": pose[:3, :3].tolist(), "T": pose[:3, 3].tolist()}
    cameras = {}
    for k, name in enumerate(rig.names):
        lens = rig.distortion[k, :4, None] if name in rig.fisheye else rig.distortion[k : k + 1]
        size, K = rig.size[k].tolist(), rig.K[k].tolist()
        cameras[name] = {"model": "standard", "image_size": size, "K": K, "dist": lens.tolist()}
    return json.dumps({"cameras": cameras, "camera_poses": told, "image_sets": {"rgb": []}})


def colmap(rig: CameraRig, model: str = "OPENCV") -> tuple[str, str]:
    """COLMAP's ``cameras.txt`` and ``images.txt``; of every other image points are listed."""
    cameras, images = ["# Camera list\n"], ["# Image list\n", "#   POINTS2D[] as (X, Y, POINT3D_ID)\n"]
    for k, name in enumerate(rig.names):
        K, lens = rig.K[k], rig.distortion[k]
        centre = [K[0, 2] + 0.5, K[1, 2] + 0.5]
        parameters = {
            "SIMPLE_PINHOLE": [K[0, 0], *centre],
            "PINHOLE": [K[0, 0], K[1, 1], *centre],
            "SIMPLE_RADIAL": [K[0, 0], *centre, lens[0]],
            "RADIAL": [K[0, 0], *centre, lens[0], lens[1]],
            "OPENCV": [K[0, 0], K[1, 1], *centre, *lens[:4]],
            "OPENCV_FISHEYE": [K[0, 0], K[1, 1], *centre, *lens[:4]],
        }[model]
        cameras.append(f"{k + 7} {model} {rig.size[k, 0]} {rig.size[k, 1]} {' '.join(map(str, parameters))}\n")
        turn = cv2.Rodrigues(rig.R[k])[0].ravel()
        angle = np.linalg.norm(turn)
        pose = [np.cos(angle / 2), *(np.sin(angle / 2) * turn / max(angle, 1e-12)), *rig.t[k]]
        points = "" if k % 2 else "10.5 20.25 -1 30.0 40.0 7"
        images.append(f"{k + 1} {' '.join(map(str, pose))} {k + 7} {name}.jpg\n{points}\n")
    return "".join(cameras), "".join(images)


def write_colmap_model(folder: Path, rig: CameraRig, model: str = "OPENCV") -> None:
    """Both files."""
    for name, text in zip(("cameras.txt", "images.txt"), colmap(rig, model), strict=True):
        (folder / name).write_text(text)


def humaneva(rig: CameraRig, k: int) -> str:
    """Camera ``k`` as HumanEva's ``.cal``."""
    rows = [rig.K[k, [0, 1], [0, 1]], rig.K[k, :2, 2], [0.0], rig.distortion[k], rig.R[k].ravel(), 1000 * rig.t[k]]
    return "\n".join(str(float(value)) for row in rows for value in row)
