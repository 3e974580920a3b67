"""Tries the Blender extension on a result: skin, cameras, and images of dots that a lens has displaced.

Twice, as it needs both this project and Blender (``pip install bpy`` in an environment of its own):

    python blender_extension.py prepare result.usdc FOLDER               # with this project's Python
    python blender_extension.py check FOLDER mmocap_result-VERSION.zip   # with Blender's

What it printed is in blender_extension.txt.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import numpy as np

LENS = (-0.18, 0.06, 0.002, -0.0015, 0.01)  # k1, k2, p1, p2, k3
FRAMES = 3
REACH = 8  # pixels around a dot
BOUNDS = {"skin [mm]": 0.01, "cameras [px]": 0.01, "dots [px]": 0.2}


def prepare(result_file: str, folder: Path) -> None:
    """Write the result with lenses, images for it, and where skin and dots are to be."""
    from dataclasses import replace

    import cv2

    from mmocap_warp.formats.usd.usd_result import read_result, write_result

    result = read_result(result_file)
    rig = replace(result.cameras, distortion=np.tile(LENS, (len(result.cameras), 1)), fisheye=())
    folder.mkdir(parents=True, exist_ok=True)
    write_result(folder / "result.usdc", replace(result, cameras=rig))
    positions = np.linspace(0, len(result.frame_numbers) - 1, FRAMES).astype(int).tolist()
    truth = {"frames": result.frame_numbers[positions].tolist(), "cameras": {}}
    np.save(folder / "skin.npy", result.vertices(frames=positions))
    for k, name in enumerate(rig.names):
        width, height = map(int, rig.size[k])
        share = np.linspace(0.12, 0.88, 6)
        dots = np.stack(np.meshgrid(share * width, share * height), axis=-1).reshape(-1, 2)
        rays = np.linalg.solve(rig.K[k], np.c_[dots, np.ones(len(dots))].T).T
        seen, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), rig.K[k], rig.distortion[k])
        image = np.zeros((height, width), np.uint8)
        for x, y in seen[:, 0]:
            cv2.circle(image, (round(16 * x), round(16 * y)), 3 * 16, 255, -1, cv2.LINE_AA, 4)
        (folder / "images" / name).mkdir(parents=True, exist_ok=True)
        for frame in range(2):
            cv2.imwrite(str(folder / "images" / name / f"{frame:04d}.png"), image)
        matrix = rig.K[k] @ np.c_[rig.R[k], rig.t[k]]
        truth["cameras"][name] = {"size": [width, height], "matrix": matrix.tolist(), "dots": dots.tolist()}
    (folder / "truth.json").write_text(json.dumps(truth), encoding="utf-8")


def check(folder: Path, extension: Path) -> int:
    """Print how far off Blender's skin, cameras and undistorted images are; 1 where any is too far."""
    import bpy
    from bpy_extras.object_utils import world_to_camera_view
    from mathutils import Vector

    truth, skin = json.loads((folder / "truth.json").read_text()), np.load(folder / "skin.npy")
    bpy.ops.wm.read_factory_settings()
    bpy.data.batch_remove(list(bpy.data.objects))
    bpy.ops.extensions.package_install_files(filepath=str(extension), repo="user_default", enable_on_install=True)
    bpy.ops.import_scene.mmocap_result(filepath=str(folder / "result.usdc"), images=str(folder / "images"))
    scene, off = bpy.context.scene, dict.fromkeys(BOUNDS, 0.0)
    (body,) = (thing for thing in bpy.data.objects if thing.type == "MESH")
    for frame, wanted in zip(truth["frames"], skin, strict=True):
        scene.frame_set(frame)
        posed = body.evaluated_get(bpy.context.evaluated_depsgraph_get())
        vertices = np.array([posed.matrix_world @ vertex.co for vertex in posed.to_mesh().vertices])
        off["skin [mm]"] = max(off["skin [mm]"], 1000 * np.abs(vertices - wanted).max())
    for name, camera in truth["cameras"].items():
        bpy.ops.view3d.mmocap_look_through(camera=name)
        view, (width, height) = bpy.data.objects[name], camera["size"]
        points = skin[0][::50]
        image = np.c_[points, np.ones(len(points))] @ np.array(camera["matrix"]).T
        shares = np.array([world_to_camera_view(scene, view, Vector(point)) for point in points])
        pixels = np.c_[shares[:, 0] * width - 0.5, (1 - shares[:, 1]) * height - 0.5]
        off["cameras [px]"] = max(off["cameras [px]"], np.abs(pixels - image[:, :2] / image[:, 2:]).max())
    # Without a window Blender writes the proxies of one clip only: those of the first camera.
    name, camera = next(iter(truth["cameras"].items()))
    undistorted = _undistorted(bpy.data.objects[name].data.background_images[0].clip, folder / "proxies")
    off["dots [px]"] = max(_distance(undistorted, *dot) for dot in camera["dots"])
    print(f"Blender {bpy.app.version_string}, {len(skin)} frames, {len(truth['cameras'])} cameras")
    for what, value in off.items():
        print(f"{what} off by at most {value:.4f}, of {BOUNDS[what]:g}")
    good = all(off[what] < bound for what, bound in BOUNDS.items())
    print("good" if good else "wrong")
    return int(not good)


def _undistorted(clip, folder: Path) -> np.ndarray:
    """A clip's image as Blender undistorts it for the view; Blender writes it as a proxy."""
    import bpy

    clip.use_proxy = clip.use_proxy_custom_directory = True
    clip.proxy.directory, clip.proxy.quality = str(folder), 100
    clip.proxy.build_25, clip.proxy.build_undistorted_100 = False, True
    window = bpy.context.window_manager.windows[0]
    area = window.screen.areas[0]
    area.type = "CLIP_EDITOR"
    area.spaces.active.clip = clip
    region = next(region for region in area.regions if region.type == "WINDOW")
    with bpy.context.temp_override(window=window, area=area, region=region):
        bpy.ops.clip.rebuild_proxy()
    for _ in range(100):  # it is written beside this
        files = sorted(folder.rglob("*.jpg"))
        if files and files[0].stat().st_size:
            break
        time.sleep(0.1)
    time.sleep(0.5)
    image = bpy.data.images.load(str(files[0]))
    width, height = image.size
    return np.array(image.pixels).reshape(height, width, -1)[::-1, :, 0]


def _distance(image: np.ndarray, x: float, y: float) -> float:
    """From the middle of the dot that is near a place to that place."""
    column, row = round(x), round(y)
    rows, columns = np.mgrid[row - REACH : row + REACH + 1, column - REACH : column + REACH + 1]
    weight = np.maximum(image[rows, columns] - 0.15, 0.0)
    return float(np.hypot((weight * columns).sum() / weight.sum() - x, (weight * rows).sum() / weight.sum() - y))


if __name__ == "__main__":
    task, first, second = sys.argv[1:]
    sys.exit(
        prepare(first, Path(second)) if task == "prepare" else check(Path(first).resolve(), Path(second).resolve())
    )
