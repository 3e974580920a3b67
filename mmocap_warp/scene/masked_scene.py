"""The text of a scene whose masks have been made: the recorded scene, with these in place of what made them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mmocap_warp.formats.attachments import attachment_lines
from mmocap_warp.formats.toml_table import quoted, quoted_path
from mmocap_warp.scene.recording import CameraSource, Scene


def masked_scene(scene: Scene, folder: Path, scale: float, first: int, count: int) -> str:
    """``scene.toml`` of a folder that holds a scene's masks, one folder a camera.

    It keeps all that the scene says but how masks are made: calibration, videos, truth, body, settings.

    Args:
        scene: the recorded scene.
        folder: where the text will lie; paths count from there.
        scale: of the masks; they are tracked at this scale unless the scene asks for a smaller one.
        first: the scene's frame that the first masks are of.
        count: number of frames.
    """

    def path(file: Path) -> str:
        return quoted_path(file, folder)

    body = None if scene.body is None else path(scene.body) if isinstance(scene.body, Path) else quoted(scene.body)
    calibration = [] if scene.calibration is None else [f"calibration = {path(scene.calibration)}"]
    lines = [
        f"# A recorded scene with its masks made, at scale {scale:g}. By mmocap mask.",
        "[scene]",
        f"name = {quoted(scene.name)}",
        f"fps = {scene.fps!r}",
        f'up = "{scene.calibrated.up}"',
        f"frames = {_frames(scene.frames[first : first + count])}",
        *([f"subject = {path(scene.subject)}"] if scene.subject else []),
        *([f"body = {body}"] if body else []),
        *(["", "[truth]", f"file = {path(scene.truth)}", f'axes = "{scene.truth_axes}"'] if scene.truth else []),
        "",
        "[cameras]",
        *calibration,
        *([f'units = "{scene.units}"'] if scene.units is not None else []),
    ]
    for source in scene.cameras:
        video = [] if source.video is None else [f"video = {path(source.video.path)}"]
        lines += ["", f"[cameras.{quoted(source.name)}]", f"masks = {quoted(source.name)}", *video]
        lines += _placed(source, scene.fps)
    lines += attachment_lines(scene.attached, folder)
    track = dict(scene.track)
    asked = track.get("scale", 1.0)
    if isinstance(asked, int | float) and scale < asked:
        track["scale"] = scale
    for name, settings in (("track", track), ("fit", scene.fit)):
        if settings:
            lines += ["", f"[{name}]", *(f"{key} = {_value(value)}" for key, value in settings.items())]
    return "\n".join([*lines, ""])


def _frames(frames: range) -> str:
    """Frames as a scene names them."""
    if (frames.start, frames.step) == (0, 1):
        return str(len(frames))
    return quoted(f"{frames.start}:{frames[-1] + 1}:{frames.step}")


def _placed(source: CameraSource, fps: float) -> list[str]:
    """How a camera's images lie in time and on its calibrated image, where that is not as they come."""
    lines = []
    if source.fraction:
        lines.append(f"offset = {(source.frame_offset + source.fraction) / (fps * source.rate)!r}")
    elif source.frame_offset:
        lines.append(f"frame_offset = {source.frame_offset}")
    if source.rate != 1.0:
        lines.append(f"fps = {fps * source.rate!r}")
    if source.centre_shift != (0.0, 0.0):
        lines.append(f"centre_shift = {list(source.centre_shift)}")
    if source.recorded_scale != 1 or source.recorded_offset != (0.0, 0.0):
        offset = list(source.recorded_offset)
        lines.append(f"video_from_calibrated = {{ scale = {source.recorded_scale!r}, offset = {offset} }}")
    return lines


def _value(value: Any) -> str:
    """A setting as TOML has it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    return quoted(value) if isinstance(value, str) else repr(value)
