"""A scene's cameras: looked at, synchronised, checked, refined, solved, and written for other programs.

``mmocap cameras``, ``mmocap sync`` and ``mmocap calib``.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from mmocap_warp.body.model import BodyModel
from mmocap_warp.calibration.adjust.camera_changes import AdjustConfig, Deviations
from mmocap_warp.cameras.rig import METRES, UP_AXES, CameraRig, CameraSummary, describe_rig, draw_world_axes
from mmocap_warp.commands.caller import Reporter, arguments_checked, start_warp
from mmocap_warp.commands.inputs import Frames, body_from, look_first, scene_from
from mmocap_warp.commands.outputs import new_file, new_folder, releases_locks
from mmocap_warp.display.still_pictures import floor_picture
from mmocap_warp.errors import UsageError
from mmocap_warp.formats.calibration.calibration_text import EVERY_OTHER
from mmocap_warp.formats.calibration.toml_rig import write_toml_rig
from mmocap_warp.formats.image_files import write_png
from mmocap_warp.formats.table import CALIBRATION_EXPORTS, format_of, read_calibration, write_calibration
from mmocap_warp.scene.camera_tables import write_timing
from mmocap_warp.scene.recording import Scene
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.whole_file import file_name

if TYPE_CHECKING:  # Warp and SciPy, which looking at the cameras does not need
    from mmocap_warp.calibration.camera_check import CameraCheck
    from mmocap_warp.calibration.refine.refinement import Refinement
    from mmocap_warp.calibration.solve.solution import SolvedCameras
    from mmocap_warp.calibration.sync.synchronise import Synchronisation

_BEFORE, _AFTER = (60, 60, 230), (80, 200, 60)  # BGR of the body's outline as calibrated, and as put right
_MASK_GRAY = 110  # of a mask below these outlines
_FOREGROUND, _BACKGROUND = 128, 64  # grays of a mask that stands for a missing image


@dataclass(frozen=True)
class CameraTable:
    """A scene's cameras, to be compared with the room."""

    rows: tuple[CameraSummary, ...]  # a summary of each camera
    size: np.ndarray  # (camera, 2) width and height of their images [px]
    up: str  # the world's vertical
    pictures: tuple[Path, ...] = ()  # of the world's axes in each view

    @property
    def mean_height(self) -> float:
        """Of the cameras over the world's zero [m]."""
        return float(np.mean([row.height for row in self.rows]))

    @property
    def plausible(self) -> bool:
        """Whether the cameras are above the world's zero."""
        return self.mean_height > 0

    def __repr__(self) -> str:
        header = f"{'camera':<12} {'size':>10} {'x':>8} {'y':>8} {'z':>8} {'height':>8} {'nearest':>8} {'view':>10}"
        lines = [header, f"{'':<12} {'px':>10} {'m':>8} {'m':>8} {'m':>8} {'m':>8} {'m':>8} {'deg':>10}"]
        for row, (width, height) in zip(self.rows, self.size, strict=True):
            place = " ".join(f"{value:8.2f}" for value in (*row.centre, row.height, row.nearest))
            view = "{:.0f}x{:.0f}".format(*row.field_of_view)
            lines.append(f"{row.name:<12} {f'{width}x{height}':>10} {place} {view:>10}")
        return "\n".join(lines)


@releases_locks
def show_cameras(scene: Scene | str | Path, pictures: str | Path | None = None, *, force: bool = False) -> CameraTable:
    """Describe a scene's cameras, and draw the world's axes into their views; masks need not be there yet.

    Args:
        scene: the scene, or its file or folder.
        pictures: folder for one picture of each camera with the world's x, y and z axis in red, green and blue.
        force: write into a folder that holds files.

    Raises:
        InputError: anything wrong with the scene, or a folder that cannot be written to.
    """
    loaded = scene if isinstance(scene, Scene) else load_scene(scene, masks=False)
    rows = tuple(describe_rig(loaded.calibrated))
    files = () if pictures is None else _draw_axes(loaded, new_folder(pictures, force=force))
    return CameraTable(rows, loaded.calibrated.size, loaded.calibrated.up, files)


def _draw_axes(scene: Scene, folder: Path) -> tuple[Path, ...]:
    """Write a picture for each camera; returns their files."""
    # A view without a video shows its mask, or nothing.
    rig = scene.rig()
    images = next(scene.images(count=1))
    masks = [np.zeros((height, width), bool) for width, height in rig.size]
    if any(image is None for image in images) and all(source.masks is not None for source in scene.cameras):
        masks = next(scene.masks(count=1))
    for k, name in enumerate(rig.names):
        picture = draw_world_axes(_image_or_mask(images[k], masks[k]), rig, k)
        write_png(folder / f"{file_name(name, scene.path)}.png", picture)
    return tuple(folder / f"{name}.png" for name in rig.names)


def _image_or_mask(image: np.ndarray | None, mask: np.ndarray) -> np.ndarray:
    if image is not None:
        return image
    return np.where(mask[..., None], _FOREGROUND, _BACKGROUND).astype(np.uint8).repeat(3, axis=2)


def sync(
    scene: Scene | str | Path,
    *,
    frames: Frames = None,
    within: float = 1.0,
    trust_cameras: bool = False,
    write: bool = False,
    reporter: Reporter | None = None,
) -> Synchronisation:
    """Find how far a scene's cameras lag one another, from the motion of the person; it needs no calibration.

    Args:
        scene: the scene, or its file or folder.
        frames: of the cameras, that are used: first:end, such as 120:900, or a count. [default: those the scene names]
        within: the largest lag between two cameras, in seconds. Steps repeat themselves every half second, so for
            somebody who only walks, motion determines lags of less than half of that.
        trust_cameras: go on even if masks and a calibration, where there is one, fit no body.
        write: put the offsets into the scene file if all of them are sure, and leave everything else in it as it is.
        reporter: receives progress.

    Raises:
        UsageError: ``within`` is no time.
        InputError: a single camera, or one that shows nobody, or masks and a calibration that fit no body.
    """
    from mmocap_warp.calibration.sync.synchronise import synchronise

    loaded = scene_from(scene, frames, calibrated=False)
    if loaded.named_frames is not None and loaded.stride != loaded.named_frames.step:
        raise UsageError("--frames must be first:end or a count, since all frames in between are used")
    if loaded.calibration is not None and loaded.calibrated.placed:
        look_first(loaded, None, reporter or Reporter(), trust_cameras, to_be_mended=True)
    with (reporter or Reporter()).stage("sync") as progress:
        synchronisation = synchronise(loaded, progress, within)
    if write and synchronisation.sure:
        write_timing(loaded.path, synchronisation.timing(loaded))
    return synchronisation


@releases_locks
def check_cameras(
    scene: Scene | str | Path,
    *,
    body: BodyModel | str | Path | None = None,
    frames: Frames = None,
    identity: int | None = None,
    person: str | None = None,
    pictures: str | Path | None = None,
    force: bool = False,
    reporter: Reporter | None = None,
    **settings: Any,
) -> CameraCheck:
    """Say which camera of a scene disagrees with the others, by how much, and what is probably wrong with it.

    Args:
        scene: the scene, or its file or folder.
        body: a generic one near the person's: a shipped one's name or a USD file. [default: the scene's, or adult_man]
        frames: of the recording: first:end or first:end:stride; 20 s are used. [default: those that the scene names]
        identity: of the person who is meant, where masks show several.
        person: by whom, of the scene's people. [default: the scene's, or the first]
        pictures: folder for a picture of each camera that disagrees: its mask, and the outline of the body of the other
            views as the camera is calibrated (red) and as it would be put right (green).
        force: write into a folder that holds files.
        reporter: receives notes and progress.
        settings: of an ``AdjustConfig``: ``scale``, ``seed``, ``device``, ``threads``.

    Raises:
        UsageError: a setting that cannot be.
        InputError: masks that show nobody, or too few frames in which the person could be tracked.
    """
    from mmocap_warp.calibration.camera_check import check

    reporter = reporter or Reporter()
    loaded = _by_one_person(scene_from(scene, frames, identity, reporter, person=person), reporter)
    folder = None if pictures is None else new_folder(pictures, force=force)
    with arguments_checked():
        config = AdjustConfig(**settings)
    generic = body_from(body, loaded)
    start_warp(config.device)
    with reporter.stage("check", None) as progress:
        result = check(loaded, generic, config, lambda stage, done: progress(round(100 * done), 100))
    return result if folder is None else replace(result, pictures=_draw_views(result, folder))


def _draw_views(check: CameraCheck, folder: Path) -> tuple[Path, ...]:
    """A picture of each camera for which the body is known as it is calibrated and as it would be put right."""
    files = []
    for view in check.views:
        image = np.where(view.mask[..., None], _MASK_GRAY, 0).astype(np.uint8).repeat(3, axis=2)
        for drawn, colour in ((view.before, _BEFORE), (view.after, _AFTER)):
            outline, _ = cv2.findContours(drawn.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
            cv2.drawContours(image, outline, -1, colour, 1, cv2.LINE_AA)
        files.append(folder / f"{file_name(view.camera, folder)}.png")
        write_png(files[-1], image)
    return tuple(files)


def _by_one_person(scene: Scene, reporter: Reporter) -> Scene:
    """The scene of one person: of several of whom none is chosen, the first."""
    if not scene.people or scene.person:
        return scene
    name = next(iter(scene.people))
    reporter.note(f"cameras: judged by {name}; --person chooses somebody else")
    return scene.of_person(name)


@releases_locks
def refine_cameras(
    scene: Scene | str | Path,
    output: str | Path | None = None,
    *,
    fixed: str | None = None,
    height: float | None = None,
    distance: tuple[str, str, float] | None = None,
    body: BodyModel | str | Path | None = None,
    frames: Frames = None,
    identity: int | None = None,
    person: str | None = None,
    trust_cameras: bool = False,
    force: bool = False,
    reporter: Reporter | None = None,
    **settings: Any,
) -> Refinement:
    """Refine a scene's cameras and their times together with the body and the poses of the person before them.

    Args:
        scene: the scene, or its file or folder.
        output: the refined calibration, .toml; it is written only if held-out frames agree that it is better.
        fixed: the camera that stands still and gives the time. [default: the one relative to which others move least]
        height: of the person, in metres: gives the scale.
        distance: two cameras and the metres between their centres, such as cam01 cam02 3.20: gives the scale.
        body: a generic one near the person's: a shipped one's name or a USD file. [default: the scene's, or adult_man]
        frames: of the recording: first:end or first:end:stride; 20 s are used. [default: those that the scene names]
        identity: of the person who is meant, where masks show several.
        person: by whom, of the scene's people. [default: the scene's, or the first]
        trust_cameras: go on even if masks and calibration fit no body for a reason that this does not mend.
        force: replace a file that exists.
        reporter: receives notes and progress.
        settings: of an ``AdjustConfig``: ``scale``, ``seed``, ``device``, ``threads``; and of ``Deviations``:
            ``rotation``, ``position``, ``focal``, ``centre``, ``offset``.

    Raises:
        UsageError: a setting that cannot be.
        InputError: masks that show nobody, or too few frames in which the person could be tracked.
    """
    reporter = reporter or Reporter()
    file = None if output is None else new_file(output, ".toml", force=force)
    loaded = _by_one_person(scene_from(scene, frames, identity, reporter, person=person), reporter)
    with arguments_checked():
        doubt = {each.name: settings.pop(each.name) for each in fields(Deviations) if each.name in settings}
        config = AdjustConfig(deviations=Deviations(**doubt), fixed=fixed, height=height, distance=distance, **settings)
        config.check_names(loaded.calibrated.names)
    generic = body_from(body, loaded)
    sized = None if height is not None or distance is not None else generic
    look_first(loaded, sized, reporter, trust_cameras, to_be_mended=True)
    start_warp(config.device)
    return refine_scene(loaded, generic, config, file, reporter)


def refine_scene(
    scene: Scene, body: BodyModel, config: AdjustConfig, file: Path | None, reporter: Reporter
) -> Refinement:
    """Refine a scene's cameras, and write them to ``file``, if there is one, where they are better."""
    from mmocap_warp.calibration.refine.refinement import refine

    with reporter.stage("refine", None) as progress:
        result = refine(scene, body, config, lambda stage, done: progress(round(100 * done), 100))
    if file is not None and result.better:
        write_toml_rig(file, result.rig, offsets=result.offsets(scene))
    return result


@releases_locks
def solve_cameras(
    scene: Scene | str | Path,
    height: float,
    output: str | Path | None = None,
    *,
    picture: str | Path | None = None,
    frames: Frames = None,
    identity: int | None = None,
    force: bool = False,
) -> SolvedCameras:
    """Find cameras from the silhouettes of one person who walks about, in metres, with the floor at zero.

    Args:
        scene: the scene, or its file or folder. Of a calibration that it names only the intrinsics are used; without
            one, focal lengths are guessed from the images' sizes, and solved for if the walk determines them.
        height: of the person, standing, in shoes, in metres.
        output: the calibration's file, .toml.
        picture: a .png of the views with the floor, the person's path and the body's axis.
        frames: which of the recording's frames: first:end or first:end:stride, such as 120:480:2, which leaves out the
            end; or a count of those that the scene names. [default: those that the scene names]
        identity: of the person who is meant, where masks show several.
        force: replace files that exist.

    Raises:
        UsageError: a height that is no person's.
        UnsolvableError: the recording does not determine the cameras.
        InputError: a single camera, or anything wrong with the scene.
    """
    from mmocap_warp.calibration.solve.solution import solve_cameras as solve

    loaded = scene_from(scene, frames, identity, calibrated=False)
    calibration = None if output is None else new_file(output, ".toml", force=force)
    image = None if picture is None else new_file(picture, ".png", force=force)
    result = solve(loaded, height)
    if calibration is not None:
        write_toml_rig(calibration, result.rig)
    if image is not None:
        _draw_floor(image, loaded, result)
    return result


def _draw_floor(path: Path, scene: Scene, cameras: SolvedCameras) -> None:
    """Draw the floor and the person's path into the views of the frame in the middle of the path."""
    known = np.flatnonzero(np.isfinite(cameras.heads[:, 0]))
    frame = int(known[len(known) // 2])
    there = scene.frames.index(cameras.frames[frame])
    solved = replace(scene, calibrated=cameras.rig, foreground=replace(scene.foreground, repair=False))
    images, masks = next(solved.images(cameras.scale, there, 1)), next(solved.masks(cameras.scale, there, 1))
    drawn = [_image_or_mask(image, mask) for image, mask in zip(images, masks, strict=True)]
    title = f"floor in squares of 0.5 m, the person's way, and the body's axis; frame {cameras.frames[frame]}"
    write_png(path, floor_picture(drawn, solved.rig(cameras.scale), cameras.heads, frame, title))


@releases_locks
def convert_cameras(
    calibration: CameraRig | str | Path,
    output: str | Path,
    *,
    units: str | None = None,
    up: str = "+z",
    size: str | None = None,
    force: bool = False,
) -> CameraRig:
    """Write a calibration in the format that the output's name tells, lengths in metres.

    Args:
        calibration: cameras, or their file, known by its ending, or a folder where the format has one.
        output: NAME.toml (Pose2Sim, aniposelib), intri.yml (EasyMocap, OpenCV; with extri.yml), cameras.txt (COLMAP;
            with images.txt and points3D.txt) or NAME.usda, NAME.usdc, NAME.usd.
        units: of the lengths that are read, where the format leaves that open: m, mm, cm, in or ft.
        up: the vertical of the calibration's world, such as +y; it is written to USD, the other formats do not have it.
        size: such as 1920x1080, of the images of cameras for which the calibration has none.
        force: replace files that exist.

    Raises:
        UsageError: units, an axis or a size that cannot be.
        InputError: a calibration that cannot be read, or files that cannot be written.
    """
    if units is not None and units not in METRES:
        raise UsageError(f"--units must be one of {', '.join(METRES)}, got '{units}'")
    if up not in UP_AXES:
        raise UsageError(f"--up must be one of {', '.join(UP_AXES)}, got '{up}'")
    pixels = None if size is None else re.fullmatch(r"([1-9]\d{0,5})x([1-9]\d{0,5})", size)
    if size is not None and pixels is None:
        raise UsageError(f"--size must be such as 1920x1080, got '{size}'")
    files = calibration_files(output)
    sizes = None if pixels is None else {EVERY_OTHER: (int(pixels[1]), int(pixels[2]))}
    rig = calibration if isinstance(calibration, CameraRig) else read_calibration(Path(calibration), units, up, sizes)
    for file in files:
        new_file(file, file.suffix, force=force)
    write_calibration(Path(output), rig)
    return rig


def calibration_files(output: str | Path) -> list[Path]:
    """The files of a calibration that is written as ``output``: that one, and those that its format has beside it."""
    path = Path(output)
    return [path, *(path.with_name(name) for name in format_of(CALIBRATION_EXPORTS, path).beside)]
