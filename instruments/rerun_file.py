"""A result as a recording of Rerun's (``.rrd``), whose own program shows it beside other data.

pip install rerun-sdk; python instruments/rerun_file.py RESULT.usdc RESULT.rrd [--scene SCENE]
"""

import argparse
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np

from mmocap_warp.body.posing import Poser
from mmocap_warp.commands.inputs import result_from, scene_of, truth_of
from mmocap_warp.display.overlay import COLOUR_OF_SIDE, MODEL_COLOUR
from mmocap_warp.display.page.page_content import curves, tracks
from mmocap_warp.display.result_video import check_same_recording
from mmocap_warp.formats.image_files import encode_png
from mmocap_warp.result.result import Result
from mmocap_warp.result.truth import Truth
from mmocap_warp.scene.recording import Scene
from mmocap_warp.tracking.body_masks import tracked_masks
from mmocap_warp.whole_file import write_whole

_UP = {"+x": "RIGHT_HAND_X_UP", "-x": "RIGHT_HAND_X_DOWN"} | {
    f"{sign}{axis}": f"RIGHT_HAND_{axis.upper()}_{way}" for axis in "yz" for sign, way in (("+", "UP"), ("-", "DOWN"))
}
"""Rerun's names of the world's vertical."""


def write_rerun(path: Path, result: Result, scene: Scene | None = None, truth: Truth | None = None) -> None:
    """Write the best run: tracking mesh and skeleton, the raw skeleton, cameras with masks, curves; every frame.

    Masks are the scene's, errors are measured from the truth, where there are these.

    Raises:
        ModuleNotFoundError: ``rerun-sdk`` is not installed.
        InputError: the folder cannot be written, or the scene or the truth is of another recording.
    """
    import rerun as rr

    if scene is not None:
        check_same_recording(result, scene)
    recording = rr.RecordingStream("mmocap-warp")
    written = recording.binary_stream()
    recording.set_log_time_enabled(False)
    recording.set_log_tick_enabled(False)
    recording.log("world", getattr(rr.ViewCoordinates, _UP[result.cameras.up]), static=True)
    _log_cameras(rr, recording, result)
    _log_frames(rr, recording, result, scene)
    _log_curves(rr, recording, result, truth)
    write_whole(path, written.read() or b"")


def _log_cameras(rr: Any, recording: Any, result: Result) -> None:
    rig = result.cameras
    for k, name in enumerate(rig.names):
        to_camera = rr.Transform3D(translation=rig.t[k], mat3x3=rig.R[k], relation=rr.TransformRelation.ChildFromParent)
        K = rig.K[k].copy()
        K[:2, 2] += 0.5  # Rerun counts pixels from the image's corner
        pinhole = rr.Pinhole(image_from_camera=K, resolution=rig.size[k], camera_xyz=rr.ViewCoordinates.RDF)
        recording.log(["world", name], to_camera, pinhole, static=True)


def _log_frames(rr: Any, recording: Any, result: Result, scene: Scene | None) -> None:
    """What moves; what stays, such as the mesh's triangles, is logged once."""
    subject, run = result.subject, result.best_run
    body = subject.body
    poser = Poser(body, subject.root_base)
    mesh = rr.Mesh3D.from_fields(triangle_indices=body.tracking_face, albedo_factor=MODEL_COLOUR[::-1])
    recording.log("world/skin", mesh, static=True)
    skeleton = body.skeleton
    colours = [COLOUR_OF_SIDE[skeleton.side(skeleton.joints[joint])][::-1] for _, joint in skeleton.bones]
    masks = repeat([]) if scene is None else tracked_masks(scene, result)
    for frame, (number, seen) in enumerate(zip(result.frame_numbers.tolist(), masks, strict=False)):
        _set_time(recording, result, number)
        (vertices,) = poser.tracking_vertices(result.pose[run, frame])
        recording.log("world/skin", rr.Mesh3D.from_fields(vertex_positions=vertices))
        for track, pose in tracks(result).items():
            (transforms,) = poser.joint_transforms(pose[run, frame])
            bones = [transforms[list(pair), :3, 3] for pair in skeleton.bones]
            strips = rr.LineStrips3D(bones, colors=colours, radii=rr.Radius.ui_points(2.0))
            recording.log(["world", "skeleton", track], strips)
        for name, mask in zip(result.cameras.names, seen, strict=False):
            picture = rr.EncodedImage(contents=encode_png(mask), media_type="image/png")
            recording.log(["world", name, "mask"], picture)


def _log_curves(rr: Any, recording: Any, result: Result, truth: Truth | None) -> None:
    for curve in curves(result, truth):
        for track, values in curve.values.items():
            of_run = values[result.best_run]
            for number, value in zip(result.frame_numbers.tolist(), of_run.tolist(), strict=True):
                if np.isfinite(value):
                    _set_time(recording, result, number)
                    recording.log(["curves", f"{curve.name} [{curve.unit or 'share'}]", track], rr.Scalars(value))


def _set_time(recording: Any, result: Result, number: int) -> None:
    recording.set_time("frame", sequence=number)
    recording.set_time("time", duration=(number - int(result.frame_numbers[0])) / result.fps)


def main() -> None:
    """Write the recording of the result that is named."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("result", type=Path)
    parser.add_argument("output", type=Path)
    parser.add_argument("--scene", help="the scene, if it is no longer where the result says")
    given = parser.parse_args()
    result, path = result_from(given.result)
    scene = scene_of(result, path, given.scene)
    write_rerun(given.output, result, scene, truth_of(scene))


if __name__ == "__main__":
    main()
