# SPDX-License-Identifier: GPL-3.0-or-later
"""Imports a result of mmocap-warp into Blender: the animated body, the cameras, and their images behind the view."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import StringProperty
from bpy_extras.io_utils import ImportHelper

IMAGES = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp"}
VIDEOS = {".mp4", ".mov", ".avi", ".mkv", ".webm"}
FOLDERS = ("", "videos", "images")
"""Where the images of a camera are looked for, below the folder that is named."""


def import_result(path: str | Path, images: str | Path = "") -> list[str]:
    """Import a result into the current scene, and return what a user should know about it.

    Args:
        path: the file that `mmocap track` wrote.
        images: a folder with a video `<camera>.mp4`, or a folder of images `<camera>/`, for each camera.

    Raises:
        ValueError: the file is no result.
    """
    cameras, rate = _read(path)
    render = bpy.context.scene.render
    render.fps = max(round(rate), 1)
    render.fps_base = render.fps / rate

    # Blender imports the body, its animation and the pinhole cameras; what is new afterwards is ours.
    before = set(bpy.data.objects)
    bpy.ops.wm.usd_import(filepath=str(path), import_blendshapes=False, set_frame_range=True)
    views = [thing for thing in bpy.data.objects if thing not in before and thing.type == "CAMERA"]
    notes = []
    for view in views:
        calibration = cameras.get(view.name.partition(".")[0])  # Blender numbers a name that is taken: cam01.001
        if calibration is None:
            continue
        view["mmocap_size"] = calibration["size"]
        if images:
            notes += _show_images(view, calibration, Path(images))
    if views:
        look_through(min(views, key=lambda view: view.name))
    return notes


def _read(path: str | Path) -> tuple[dict[str, dict], float]:
    """The calibration of each camera, by the name of its prim, and the frames a second."""
    bpy.utils.expose_bundled_modules()
    from pxr import Usd

    try:
        stage = Usd.Stage.Open(str(path))
    except Exception:
        raise ValueError(f"{path}: is not a USD file; give the file that `mmocap track` wrote") from None
    scope = stage.GetPrimAtPath("/World/Cameras")
    if not scope or not scope.HasAttribute("mmocap:cameras"):
        raise ValueError(f"{path}: holds no cameras; give the file that `mmocap track` wrote")
    cameras = {}
    for prim in scope.GetChildren():
        lens = prim.GetAttribute("mmocap:lens")
        cameras[prim.GetName()] = {
            "name": prim.GetAttribute("mmocap:name").Get(),
            "size": [int(side) for side in prim.GetAttribute("mmocap:size").Get()],
            "intrinsics": list(prim.GetAttribute("mmocap:intrinsics").Get()),
            "distortion": list(prim.GetAttribute("mmocap:distortion").Get()),
            "fisheye": bool(lens) and lens.Get() == "fisheye",
        }
    return cameras, stage.GetTimeCodesPerSecond()


def _show_images(view: bpy.types.Object, calibration: dict, folder: Path) -> list[str]:
    """Put a camera's images behind its view, undistorted as the body is; returns what is wrong with them."""
    name = calibration["name"]
    file = find_images(folder, name)
    if file is None:
        return [f"{folder}: no images of camera '{name}'; put {name}.mp4 or a folder {name} there"]
    clip = bpy.data.movieclips.load(str(file))
    clip.frame_start = 0  # a result counts its frames from 0
    background = view.data.background_images.new()
    background.source, background.clip = "MOVIE_CLIP", clip
    background.frame_method, background.alpha = "FIT", 1.0
    view.data.show_background_images = True
    if calibration["fisheye"]:
        return [f"{name}: its lens is a fisheye, which Blender cannot undistort; the body does not lie on its images"]
    if any(calibration["distortion"]):
        _set_lens(clip.tracking.camera, calibration, clip.size[0] / calibration["size"][0])
        background.clip_user.use_render_undistorted = True
    if tuple(clip.size) != tuple(calibration["size"]):
        sizes = " and ".join("x".join(map(str, size)) for size in (clip.size, calibration["size"]))
        return [f"{name}: images and calibration have sizes {sizes}; the images are fitted into the view"]
    return []


def find_images(folder: Path, name: str) -> Path | None:
    """A camera's video, or the first of its images."""
    for below in FOLDERS:
        for video in sorted((folder / below).glob(f"{name}.*")):
            if video.suffix.lower() in VIDEOS:
                return video
        for image in sorted((folder / below / name).glob("*")):
            if image.suffix.lower() in IMAGES and not image.name.startswith("."):
                return image
    return None


def _set_lens(lens: bpy.types.MovieTrackingCamera, calibration: dict, scale: float) -> None:
    """Give a clip the lens of a calibration; Blender's Brown model is OpenCV's, from the image's lower left edge."""
    fx, _, cx, _, fy, cy, *_ = calibration["intrinsics"]
    k1, k2, p1, p2, k3 = calibration["distortion"]
    height = calibration["size"][1]
    lens.distortion_model = "BROWN"
    lens.pixel_aspect = fx / fy
    lens.units = "PIXELS"
    lens.focal_length_pixels = fx * scale
    lens.principal_point_pixels = ((cx + 0.5) * scale, (height - 0.5 - cy) * scale)  # y upwards
    lens.brown_k1, lens.brown_k2, lens.brown_k3 = k1, k2, k3
    lens.brown_p1, lens.brown_p2 = p2, -p1  # Blender's p1 goes with x, and its y points upwards


def look_through(view: bpy.types.Object) -> None:
    """Make a camera the scene's, with the size of its images: Blender has one size for all cameras."""
    scene = bpy.context.scene
    scene.camera = view
    if "mmocap_size" in view:
        scene.render.resolution_x, scene.render.resolution_y = view["mmocap_size"]
        scene.render.resolution_percentage = 100


class ImportResult(bpy.types.Operator, ImportHelper):
    """Import a result of mmocap-warp: body, cameras and their images."""

    bl_idname = "import_scene.mmocap_result"
    bl_label = "Import mmocap result"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  as Blender wants it

    filename_ext = ".usdc"
    filter_glob: StringProperty(default="*.usdc;*.usda;*.usd", options={"HIDDEN"})
    images: StringProperty(
        name="Images",
        description="A folder with a video or a folder of images of each camera, by its name",
        subtype="DIR_PATH",
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Import the chosen file."""
        try:
            notes = import_result(self.filepath, bpy.path.abspath(self.images))
        except (ValueError, RuntimeError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        for note in notes:
            self.report({"WARNING"}, note)
        return {"FINISHED"}


class LookThrough(bpy.types.Operator):
    """Look through this camera, at the size of its images."""

    bl_idname = "view3d.mmocap_look_through"
    bl_label = "Look through a camera of a mmocap result"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    camera: StringProperty()

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Change the scene's camera and size, and the view to the camera's."""
        view = bpy.data.objects.get(self.camera)
        if view is None:
            return {"CANCELLED"}
        look_through(view)
        for area in context.screen.areas if context.screen else ():
            if area.type == "VIEW_3D":
                area.spaces.active.region_3d.view_perspective = "CAMERA"
        return {"FINISHED"}


class Cameras(bpy.types.Panel):
    """A button for each camera of imported results."""

    bl_idname = "VIEW3D_PT_mmocap_cameras"
    bl_label = "Cameras"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "mmocap"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the buttons."""
        for view in sorted(context.scene.objects, key=lambda view: view.name):
            if "mmocap_size" in view:
                self.layout.operator(LookThrough.bl_idname, text=view.name).camera = view.name


CLASSES = (ImportResult, LookThrough, Cameras)


def _menu(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    self.layout.operator(ImportResult.bl_idname, text="mmocap result (.usdc)")


def register() -> None:
    """Add the importer to File > Import, and the panel to the 3D view's sidebar."""
    for each in CLASSES:
        bpy.utils.register_class(each)
    bpy.types.TOPBAR_MT_file_import.append(_menu)


def unregister() -> None:
    """Remove both."""
    bpy.types.TOPBAR_MT_file_import.remove(_menu)
    for each in reversed(CLASSES):
        bpy.utils.unregister_class(each)
