"""Opens exports of one result in Blender, and measures how far joints and skin are from where they should be.

Run with Blender's Python (``pip install bpy`` in an environment of its own, or ``blender --background --python``):

    python blender_check.py FOLDER

FOLDER holds ``walk.npz``, ``walk.usdc``, ``walk.glb`` and ``walk.bvh`` of one result whose world is Z up, as Blender's.
What it printed is in blender_check.txt.
"""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
import numpy as np

FRAMES = 5
TOLERANCE = 0.001  # [m]


def main(folder: Path) -> int:
    """Print a line a frame; 1 where any is off by a millimetre, else 0."""
    with np.load(folder / "walk.npz") as arrays:
        truth = dict(arrays)
    skin = skinned(truth)
    rate = float(truth["rate"])
    seconds = truth["time"] - truth["time"][0]
    files = {  # and Blender's frame of each of the file's: glTF's importer goes by whole frames per second
        "walk.usdc": (lambda path: bpy.ops.wm.usd_import(filepath=path), truth["frame"]),
        "walk.glb": (lambda path: bpy.ops.import_scene.gltf(filepath=path), seconds * round(rate)),
        "walk.bvh": (lambda path: bpy.ops.import_anim.bvh(filepath=path, global_scale=0.01), 1 + seconds * rate),
    }
    print(f"Blender {bpy.app.version_string}, {len(seconds)} frames at {rate:g} a second")
    worst = 0.0
    for name, (read, frames) in files.items():
        bpy.ops.wm.read_factory_settings(use_empty=True)
        bpy.context.scene.render.fps = round(rate)  # before the import: glTF's times are seconds
        read(str(folder / name))
        for position in np.linspace(0, len(frames) - 1, FRAMES).astype(int):
            frame, rest = divmod(round(float(frames[position]), 6), 1)
            bpy.context.scene.frame_set(int(frame), subframe=rest)
            off = [np.abs(heads(truth["joint_names"]) - truth["joints"][position]).max()]
            points = vertices()
            if points is not None:
                off.append(np.abs(points - skin[position]).max())
            worst = max(worst, *off)
            told = ", ".join(f"{what} {1000 * o:.4f} mm" for what, o in zip(("joints", "skin"), off, strict=False))
            print(f"{name} frame {truth['frame'][position]}: off by at most {told}")
    print("good" if worst < TOLERANCE else "wrong")
    return int(worst >= TOLERANCE)


def skinned(truth: dict[str, np.ndarray]) -> np.ndarray:
    """(frame, vertex, 3), as docs/formats.md says of the .npz."""
    matrix = truth["world"] @ np.linalg.inv(truth["bind"])
    rest = np.concatenate([truth["rest"], np.ones((len(truth["rest"]), 1))], axis=1)
    return np.stack([np.einsum("vk,vkij,vj->vi", truth["skin_weight"], m[truth["skin_joint"]], rest) for m in matrix])[
        ..., :3
    ]


def heads(names: np.ndarray) -> np.ndarray:
    """(joint, 3) where the armature's bones begin, in Blender's world."""
    (armature,) = (thing for thing in bpy.context.scene.objects if thing.type == "ARMATURE")
    bones = {bone.name.rpartition("/")[2]: bone for bone in armature.pose.bones}
    return np.array([armature.matrix_world @ bones[name].head for name in names])


def vertices() -> np.ndarray | None:
    """(vertex, 3) of the largest mesh that an armature moves, in Blender's world; None where there is none."""
    graph = bpy.context.evaluated_depsgraph_get()
    meshes = [thing for thing in bpy.context.scene.objects if thing.type == "MESH" and thing.find_armature()]
    if not meshes:
        return None
    posed = max(meshes, key=lambda thing: len(thing.data.vertices)).evaluated_get(graph)
    return np.array([posed.matrix_world @ vertex.co for vertex in posed.data.vertices])


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[-1])))
