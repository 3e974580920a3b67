"""Turns an exported ``.glb`` into ``.fbx`` with Blender, which has the one free writer of that format.

Run with Blender's Python (``pip install bpy`` in an environment of its own, or ``blender --background --python``):

    python to_fbx.py walk.glb walk.fbx 60

The last argument is the motion's frames per second, a whole number: export it by ``mmocap export --fps 60``.
The armature has the skin and one animation, in metres, with Blender's usual axes for FBX (Y up, -Z forward).
"""

from __future__ import annotations

import sys

import bpy


def main(source: str, target: str, rate: str) -> None:
    """Read one file and write the other."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps = int(rate)  # before the import: glTF's times are seconds
    bpy.ops.import_scene.gltf(filepath=source, disable_bone_shape=True)  # else a sphere for its bones comes along
    (action,) = bpy.data.actions
    scene.frame_start, scene.frame_end = (round(frame) for frame in action.frame_range)
    bpy.ops.export_scene.fbx(
        filepath=target,
        object_types={"ARMATURE", "MESH"},
        add_leaf_bones=False,
        bake_anim_use_all_bones=True,
        bake_anim_use_nla_strips=False,
        bake_anim_use_all_actions=False,
        bake_anim_simplify_factor=0.0,  # keep every frame
    )


if __name__ == "__main__":
    main(*sys.argv[-3:])
