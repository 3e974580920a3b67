"""The cameras of a ``scene.toml``: where their images lie, and when they were taken, which is written to it, too."""

import difflib
import re
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from mmocap_warp.cameras.rig import CameraRig, check_rig
from mmocap_warp.errors import InputError, input_errors
from mmocap_warp.formats.table import read_calibration, read_lenses
from mmocap_warp.formats.toml_table import Table, is_number
from mmocap_warp.masks.frames import VideoFile, open_frames, open_image, wrong_numbers
from mmocap_warp.masks.mask_files import open_masks
from mmocap_warp.scene.camera_source import CameraSource, split_offset
from mmocap_warp.scene.kept_masks import read_mark
from mmocap_warp.whole_file import file_name, read_text, write_whole

RATE_TOLERANCE = 0.005
"""Rates that differ by less than this share are one rate: video of 59.94 frames a second is called one of 60."""

_CHANNELS = ("blue", "green", "red")  # in OpenCV's order
_MAX_OFFSET = 1e8  # frames
_HEADER = re.compile(r"\s*\[(?!\[)(?P<name>.*)\]\s*(#.*)?$")
_OFFSET = re.compile(r"\s*(frame_offset|offset)\s*=")
_FPS = re.compile(r"\s*fps\s*=")

Opened = TypeVar("Opened")


def fastest(cameras: dict[str, Table], scene: Path, about: Table) -> float:
    """The rate of the fastest camera, of those that tell theirs."""
    rates = [rate for camera in cameras.values() if is_number(rate := camera.peek("fps"))]
    videos = [video for camera in cameras.values() if isinstance(video := camera.peek("video"), str)]
    opened = [open_frames(scene.parent / video) for video in videos]
    rates += [video.fps for video in opened if isinstance(video, VideoFile)]
    if not max(rates, default=0.0) > 0:
        raise about.error("'fps' is missing", "add fps = ... (a number), of the recording or of each camera")
    return float(max(rates))


def read_cameras(
    table: Table,
    tables: dict[str, Table],
    scene: Path,
    calibration: Path | None,
    units: str | None,
    up: str,
    fps: float,
    placed: bool,
) -> tuple[tuple[CameraSource, ...], CameraRig]:
    """The cameras of the file ``scene`` and their rig.

    All other keys of [cameras], ``table``, were taken; ``tables`` are those of each camera, by name. The calibration, a
    file or folder, must say where the cameras stand if they are to be ``placed``. Raises an InputError for wrong keys,
    files that cannot be read, or rates that disagree.
    """
    table.finish()
    if not tables:
        raise table.error("no camera is named", "add a table [cameras.<name>] for each, named as in the calibration")
    for name in tables:
        file_name(name, f"{scene}: [cameras]")
    # Each camera's images; the rates of videos must agree where the scene does not state them.
    stated = {name for name, camera in tables.items() if camera.has("fps")}
    sources = tuple(_read_source(camera, name, scene, fps) for name, camera in tables.items())
    by_file = [source for source in sources if source.name not in stated]
    for source in by_file:
        _check_rate(source, fps, tables[source.name])
    _check_drift(by_file, fps, table)
    if calibration is None:
        return _uncalibrated(sources, up, table)
    # The calibration of these cameras, in the scene's order.
    shifts = np.array([source.centre_shift for source in sources])
    sizes = {source.name: size for source in sources if (size := _recorded_size(source)) is not None}
    lenses = read_lenses(calibration, up, sizes)
    if lenses and placed:
        remedy = "calibrate the whole rig, or let mmocap calib solve find it from a person who walks"
        raise InputError(calibration, "has lenses, but not where the cameras stand", remedy)
    rig = lenses or read_calibration(calibration, units, up, sizes)
    for source in sources:
        if source.name not in rig.names:
            near = difflib.get_close_matches(source.name, rig.names, 1, 0.0)[0]
            problem = f"camera '{source.name}' is not in {calibration.name}"
            raise table.error(problem, f"it has {', '.join(rig.names)}; did you mean '{near}'?")
    rig = rig.select(tuple(source.name for source in sources))
    # Principal points that the scene corrects.
    K = rig.K.copy()
    K[:, :2, 2] += shifts
    return sources, check_rig(replace(rig, K=K), f"{scene}: centre_shift", rig.placed) if shifts.any() else rig


def _uncalibrated(given: tuple[CameraSource, ...], up: str, table: Table) -> tuple[tuple[CameraSource, ...], CameraRig]:
    """Cameras that have images only, and pinholes of these images' sizes."""
    sizes = [_recorded_size(source) for source in given]
    for source, size in zip(given, sizes, strict=True):
        if size is None:
            raise table.error(f"camera '{source.name}' has neither masks nor a video", "add one of them")
    images, K = np.array(sizes), np.zeros((len(given), 3, 3))
    K[:, [0, 1], [0, 1]] = images.max(axis=1, keepdims=True)
    K[:, :2, 2], K[:, 2, 2] = 0.5 * (images - 1), 1.0
    R, t = np.tile(np.eye(3), (len(given), 1, 1)), np.zeros((len(given), 3))
    rig = CameraRig(tuple(source.name for source in given), K, R, t, images, np.zeros((len(given), 5)), up)
    return tuple(replace(s, recorded_scale=1.0, recorded_offset=(0.0, 0.0)) for s in given), rig


def _read_source(table: Table, name: str, scene: Path, fps: float) -> CameraSource:
    def opened(key: str, opener: Callable[[Path], Opened]) -> Opened | None:
        value = table.take(key, str, None)
        return None if value is None else opener(scene.parent / value)

    recorded = table.take_table("video_from_calibrated")
    left, top = recorded.take_numbers("offset", (2,), [0.0, 0.0])
    right, down = table.take_numbers("centre_shift", (2,), [0.0, 0.0])
    masks = opened("masks", open_masks)
    channel = table.take_choice("mask_channel", ("", *_CHANNELS), "")
    if channel:
        if not isinstance(masks, VideoFile):
            raise table.error("mask_channel is for masks that are a video", "leave it out")
        masks = replace(masks, channel=_CHANNELS.index(channel))
    video, is_stated = opened("video", open_frames), table.has("fps")
    own_fps = table.take("fps", float, fps)
    if not 0 < own_fps < 100_000:
        raise table.error(f"fps = {own_fps:g} is not a frame rate", "give the frames per second of this camera")
    rate = own_fps / fps
    if isinstance(video, VideoFile) and is_stated and rate == 1.0:
        video = replace(video, fps=0.0)  # what the file says of times does not count
    for frames in (each for each in (video, masks) if each):
        if wrong := wrong_numbers([file.stem for file in frames.files]):
            raise InputError(frames.path, wrong, "number each image once, without a gap")
    offset, fraction = _take_offset(table, fps * rate)
    source = CameraSource(
        name=name, video=video, masks=masks, clean_plate=opened("clean_plate", open_image),
        background=opened("background", open_frames), frame_offset=offset, fraction=fraction,
        recorded_scale=recorded.take("scale", float, 1.0), recorded_offset=(left, top), rate=rate,
        centre_shift=(right, down), mask_mark=read_mark(masks.path) if masks else None,
    )  # fmt: skip
    if not 0.01 < source.recorded_scale < 100:
        raise recorded.error(f"scale = {source.recorded_scale:g} is not a scale", "give recorded pixels per calibrated")
    recorded.finish()
    table.finish()
    return source


def _take_offset(table: Table, fps: float) -> tuple[int, float]:
    """A camera's offset in whole frames of its own, and the rest; what is nearly whole is whole."""
    if not table.has("offset"):
        return table.take("frame_offset", int, 0), 0.0
    if table.has("frame_offset"):
        raise table.error("has both offset and frame_offset", "give offset alone, in seconds")
    frames = table.take("offset", float) * fps
    if abs(frames) > _MAX_OFFSET:
        raise table.error(f"offset is {frames:.3g} frames", "give the seconds by which this camera lags")
    return split_offset(frames)


def _check_rate(source: CameraSource, fps: float, table: Table) -> None:
    """See that a camera's videos have the recording's rate, where the scene does not say what rate they have."""
    for frames in (source.video, source.masks):
        if isinstance(frames, VideoFile) and frames.fps > 0 and abs(frames.fps / fps - 1) > RATE_TOLERANCE:
            raise table.error(
                f"{frames.path} has {frames.fps:g} frames a second, [scene] says {fps:g}",
                f"correct [scene] fps; or add fps = {frames.fps:g} here, and its frames are taken by time; "
                f"or fps = {fps:g} here if the file is wrong about it",
            )


def _check_drift(sources: list[CameraSource], fps: float, table: Table) -> None:
    """See that videos whose rates are nearly one do not drift apart by a frame before the shortest ends."""
    videos = {source.name: source.video for source in sources if isinstance(source.video, VideoFile)}
    rates = {name: video.fps for name, video in videos.items() if video.fps > 0}
    if not rates:
        return
    slow, fast = min(rates, key=lambda name: rates[name]), max(rates, key=lambda name: rates[name])
    drift = (rates[fast] - rates[slow]) / fps * min(map(len, videos.values()))
    if drift > 1:
        raise table.error(
            f"{slow} has {rates[slow]:g} frames a second and {fast} {rates[fast]:g}: they end {drift:.1f} frames apart",
            f"give each camera its own, such as fps = {rates[slow]:g} for {slow}, and frames are taken by time; or "
            f"fps = {fps:g} to each if the files are wrong about it",
        )


def _recorded_size(source: CameraSource) -> tuple[int, int] | None:
    """Width and height of a camera's recorded images; None where they are not known."""
    if source.video is not None:
        return source.video.size
    if source.mask_mark is not None:
        return source.mask_mark.calibrated_size
    return source.masks.size if source.masks is not None else None


def write_timing(path: Path, timing: Mapping[str, Mapping[str, float]]) -> None:
    """Set ``offset`` [s], and ``fps`` where it is given, of cameras by their names; an offset of 0 is left out.

    Everything else in the scene file stays as people wrote it, comments too. Raises an InputError for a file in which
    they cannot be set so, such as of cameras in inline tables.
    """
    text = read_text(path, "give a TOML text file")
    lines: list[str] = []
    camera = ""
    for line in text.splitlines(keepends=True):
        if header := _HEADER.match(line):
            camera = _camera_of(header["name"])
            lines.append(line)
            if camera in timing:
                lines[-1] = line if line.endswith("\n") else f"{line}\n"
                lines += [f"{key} = {value!r}\n" for key, value in timing[camera].items() if value]
        elif camera not in timing or not (_OFFSET.match(line) or ("fps" in timing[camera] and _FPS.match(line))):
            lines.append(line)
    # The text is only written if a reader finds in it what was there, and the new times.
    changed, expected = "".join(lines), tomllib.loads(text)
    for name, keys in timing.items():
        values = expected["cameras"][name]
        for key in ("frame_offset", "offset", *keys):
            values.pop(key, None)
        values |= {key: value for key, value in keys.items() if value}
    remedy = "leave --write out, and put the lines there by hand"
    with input_errors(path, "is written in a way that cannot be changed safely", remedy, ValueError):
        if tomllib.loads(changed) != expected:
            raise ValueError("other keys have changed")
    end = "\r\n" if b"\r\n" in path.read_bytes() else "\n"  # reading took either for \n
    write_whole(path, changed.replace("\n", end).encode())


def _camera_of(header: str) -> str:
    """The camera whose table a header begins; "" for other tables."""
    try:
        cameras = tomllib.loads(f"[{header}]").get("cameras", {})
    except tomllib.TOMLDecodeError:
        return ""
    return next((name for name, values in cameras.items() if values == {}), "")
