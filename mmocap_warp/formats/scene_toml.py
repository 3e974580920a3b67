"""Reading ``scene.toml``: every mistake is one :class:`~mmocap_warp.errors.InputError` before any work starts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from mmocap_warp.cameras import UP_AXES, CameraRig
from mmocap_warp.errors import InputError
from mmocap_warp.foreground.frames import Frames, open_frames, open_video
from mmocap_warp.foreground.settings import MODELS, SOURCES, ForegroundSettings
from mmocap_warp.formats.opencv_yaml import read_opencv_yaml
from mmocap_warp.formats.qualisys import read_qualisys
from mmocap_warp.formats.toml_rig import METRES, read_toml_rig
from mmocap_warp.formats.toml_table import Table, load_toml
from mmocap_warp.scene import CameraSource, Scene


Opened = TypeVar("Opened")


def read_scene(path: str | Path) -> Scene:
    """Read and check a scene; paths in it are relative to its folder.

    Raises:
        InputError: anything that is wrong with the scene file, the calibration, or the files it names.
    """
    path = Path(path)
    path = path / "scene.toml" if path.is_dir() else path
    file = load_toml(path)
    about = file.take_table("scene")
    name = about.take("name", str, path.parent.name)
    fps = about.take("fps", float)
    if not 0 < fps < 100_000:
        raise about.error(f"fps = {fps:g} is not a frame rate", "give the frames per second of the recording")
    up = about.take_choice("up", UP_AXES, "+z")
    frames = about.take("frames", int, None)
    subject = _path(path, about.take("subject", str, None))
    body = about.take("body", str, None)
    about.finish()
    truth = file.take_table("truth")
    truth_file = _path(path, truth.take("file", str, None))
    truth_axes = truth.take("axes", str, "xyz")
    truth.finish()
    sources, rig = _read_cameras(file.take_table("cameras"), path, up)
    foreground = _read_foreground(file.take_table("foreground"))
    scene = Scene(
        path=path,
        name=name,
        fps=fps,
        frame_count=_frame_count(sources, frames, path),
        calibrated=rig,
        cameras=sources,
        foreground=foreground,
        subject=subject,
        body=_path(path, body) if body and body.endswith((".usd", ".usda", ".usdc")) else body,
        truth=truth_file,
        truth_axes=truth_axes,
        track=file.take_table("track").take_rest(),
        fit=file.take_table("fit").take_rest(),
    )
    file.finish()
    return scene


def _path(scene: Path, value: str | None) -> Path | None:
    return None if value is None else scene.parent / value


def _read_cameras(table: Table, scene: Path, up: str) -> tuple[tuple[CameraSource, ...], CameraRig]:
    calibration = scene.parent / table.take("calibration", str)
    units = table.take_choice("units", tuple(METRES), "m")
    tables = table.take_tables()
    table.finish()
    sources, shifts = [], []
    for name, camera in tables.items():
        shifts.append(camera.take_numbers("centre_shift", (2,), [0.0, 0.0]))
        sources.append(_read_source(camera, name, scene))
    rig = _read_rig(calibration, units, up)
    names = tuple(source.name for source in sources)
    rig = rig.select(names)
    K = rig.K.copy()
    K[:, :2, 2] += np.array(shifts)
    return tuple(sources), replace(rig, K=K)


def _read_source(table: Table, name: str, scene: Path) -> CameraSource:
    def opened(key: str, opener: Callable[[Path], Opened]) -> Opened | None:
        value = table.take(key, str, None)
        return None if value is None else opener(scene.parent / value)

    recorded = table.take_table("video_from_calibrated")
    left, top = recorded.take_numbers("offset", (2,), [0.0, 0.0])
    source = CameraSource(
        name=name,
        video=opened("video", open_video),
        masks=opened("masks", open_frames),
        clean_plate=_path(scene, table.take("clean_plate", str, None)),
        background=opened("background", open_video),
        frame_offset=table.take("frame_offset", int, 0),
        recorded_scale=recorded.take("scale", float, 1.0),
        recorded_offset=(left, top),
    )
    recorded.finish()
    table.finish()
    return source


def _read_rig(path: Path, units: str, up: str) -> CameraRig:
    if path.is_dir() or path.suffix in (".yml", ".yaml"):
        return read_opencv_yaml(path, units, up)
    if path.suffix == ".toml":
        return read_toml_rig(path, units, up)
    return read_qualisys(path, up)


def _read_foreground(table: Table) -> ForegroundSettings:
    settings = ForegroundSettings(
        source=table.take_choice("source", SOURCES, "masks"),
        model=table.take_choice("model", MODELS, "gaussian"),
        repair=table.take("repair", bool, False),
    )
    table.finish()
    return settings


def _frame_count(sources: tuple[CameraSource, ...], frames: int | None, path: Path) -> int:
    counts: dict[str, int] = {}
    for source in sources:
        recording: Frames | None = source.masks or source.video
        if recording is not None:
            counts[source.name] = len(recording)
    shortest = min(counts.values())
    if frames is None and len(set(counts.values())) > 1:
        found = ", ".join(f"{name} {count}" for name, count in counts.items())
        raise InputError(path, f"cameras differ in their number of frames: {found}", f"set [scene] frames = {shortest}")
    return frames or shortest
