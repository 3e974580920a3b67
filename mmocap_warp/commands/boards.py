"""Cameras from a board that is moved about, and the board to print: ``mmocap calib board`` and ``print-board``."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from mmocap_warp.calibration.board.board_cameras import BoardCalibration, calibrate_from_board, detect_board, on_floor
from mmocap_warp.calibration.board.pattern import Board
from mmocap_warp.calibration.solve.solution import upright
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.commands.caller import Reporter
from mmocap_warp.commands.inputs import scene_from
from mmocap_warp.commands.outputs import new_file, releases_locks
from mmocap_warp.display.overlay import INK, LEFT_COLOUR, PAPER, write_text
from mmocap_warp.errors import InputError, UsageError
from mmocap_warp.formats.calibration.toml_rig import write_toml_rig
from mmocap_warp.formats.image_files import write_png
from mmocap_warp.formats.table import read_calibration, read_lenses
from mmocap_warp.masks.frames import Frames, as_colour, open_frames
from mmocap_warp.scene.camera_source import CameraSource
from mmocap_warp.scene.frame_choice import frames_by_number
from mmocap_warp.scene.recording import Scene
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.whole_file import write_whole

_MAX_FRAMES = 400  # frames of each camera that are searched for the board, evenly spread
_WIDTH = 480  # of a camera in the picture [px]
_MAGNIFIED = 50  # times that residuals are drawn longer than they are


@releases_locks
def calibrate_board(
    videos: Sequence[str | Path] | str | Path,
    board: str,
    output: str | Path | None = None,
    *,
    picture: str | Path | None = None,
    known: str | Path | None = None,
    floor: int | None = None,
    person: Scene | str | Path | None = None,
    force: bool = False,
    reporter: Reporter | None = None,
) -> BoardCalibration:
    """Find cameras from videos in which a board of known size is held close to each camera, then moved amid them.

    Args:
        videos: a video or folder of images of each camera, which start together; or one scene, whose offsets are used.
        board: such as charuco:5x7:40mm, with the numbers of squares and the side of one; also
            charuco:5x7:40mm:30mm:4x4_50, with the markers' side and dictionary, or chessboard:6x9:40mm.
        output: the calibration's file, .toml.
        picture: a .png with the corners in each camera, and how far the calibration misses them, 50 times longer.
        known: a calibration whose lenses are held; its places are not used.
        floor: the number of a frame in which the board lies on the floor, its print up: the world's origin is its first
            corner, z is up. [default: the world is the first camera's]
        person: a scene, with masks, of somebody who walks before these cameras: the floor is at zero below the walk's
            middle, z is up. Its own calibration is not used.
        force: replace files that exist.
        reporter: receives progress.

    Raises:
        UsageError: no such board, or both ``floor`` and ``person``.
        UnsolvableError: the person does not show where the floor is.
        InputError: videos that cannot be read, a camera that does not see the board, or cameras that are not in step.
    """
    pattern = Board.parse(board)
    if floor is not None and person is not None:
        raise UsageError("--floor and --person both say where the floor is; give one of them")
    walk = None if person is None else scene_from(person, calibrated=False)
    file = None if output is None else new_file(output, ".toml", force=force)
    image = None if picture is None else new_file(picture, ".png", force=force)
    sources = _sources([Path(video) for video in ([videos] if isinstance(videos, str | Path) else videos)])
    if len(sources) < 2:
        raise UsageError("a rig has two cameras at least: give a video of each, or a scene")
    names, sizes = list(sources), np.array([frames.size for frames, _ in sources.values()])
    lenses = None if known is None else _lenses(Path(known), names, sizes)
    # The same moments of all cameras.
    ends = (len(f) if s is None else int((len(f) - s.frame_offset) / s.rate) for f, s in sources.values())
    count = max(1, min(ends))
    if floor is not None and not 0 <= floor < count:
        raise UsageError(f"--floor = {floor} is not in 0 to {count - 1}")
    moments = sorted({*range(0, count, max(1, -(-count // _MAX_FRAMES))), *([] if floor is None else [floor])})
    detections = []
    with (reporter or Reporter()).stage("board") as progress:
        for k, (frames, source) in enumerate(sources.values()):
            numbers = moments if source is None else [source.number(moment) for moment in moments]
            images = (None if image is None else as_colour(image) for image in frames_by_number(frames, numbers))
            detections.append(detect_board(images, pattern))
            progress((k + 1) * len(moments), len(sources) * len(moments))
    found = calibrate_from_board(names, sizes, detections, pattern, lenses)
    if floor is not None:
        found = replace(found, rig=on_floor(found, detections, pattern, moments.index(floor)))
    if walk is not None:
        found = replace(found, rig=upright(found.rig, walk))
    if file is not None:
        write_toml_rig(file, found.rig)
    if image is not None:
        write_png(image, board_picture(found))
    return found


def _sources(videos: Sequence[Path]) -> dict[str, tuple[Frames, CameraSource | None]]:
    """The videos, by the names of the cameras; with a scene's cameras where a scene is given."""
    opened: dict[str, tuple[Frames, CameraSource | None]] = {}
    if len(videos) == 1 and (videos[0].suffix == ".toml" or (videos[0] / "scene.toml").is_file()):
        for source in load_scene(videos[0], masks=False, calibrated=False).cameras:
            if source.video is None:
                raise InputError(videos[0], f"camera '{source.name}' has no video", "name the board's under [cameras]")
            opened[source.name] = source.video, source
        return opened
    stems = Counter(video.stem for video in videos)
    for video in videos:
        name = video.stem if stems[video.stem] == 1 else video.resolve().parent.name
        if name in opened:
            raise InputError(video, f"is a second video of a camera '{name}'", "give the files names of their own")
        opened[name] = open_frames(video), None
    return opened


def _lenses(file: Path, names: Sequence[str], sizes: np.ndarray) -> CameraRig:
    by_name = {name: (int(width), int(height)) for name, (width, height) in zip(names, sizes, strict=True)}
    rig = read_lenses(file, "+z", by_name) or read_calibration(file, "m", "+z", by_name)
    for name, (width, height) in by_name.items():
        if name not in rig.names or name in rig.fisheye:
            problem = f"has no lens of camera '{name}' that is not a fisheye"
            raise InputError(file, problem, f"it has {', '.join(rig.names)}; name the videos as its cameras")
        if tuple(rig.size[rig.names.index(name)]) != (width, height):
            problem = f"the lens of camera '{name}' is of images of another size than its video's {width}x{height}"
            raise InputError(file, problem, "film at the size of the lens's calibration, or leave --known out")
    return rig


def board_picture(found: BoardCalibration) -> np.ndarray:
    """The corners in the image of each camera, with their residuals magnified, BGR."""
    views = []
    scales = _WIDTH / found.rig.size[:, 0]
    heights = np.rint(scales * found.rig.size[:, 1]).astype(int)
    for k, (name, scale) in enumerate(zip(found.rig.names, scales, strict=True)):
        canvas = np.zeros((heights.max(), _WIDTH, 3), np.uint8)
        canvas[: heights[k]] = PAPER
        cv2.rectangle(canvas, (0, 0), (_WIDTH - 1, int(heights[k]) - 1), (90, 90, 90), 1)
        for point, residual in zip(found.points[k], found.residuals[k], strict=True):
            start = np.rint(point * scale).astype(int).tolist()
            end = np.rint((point + _MAGNIFIED * residual) * scale).astype(int).tolist()
            cv2.line(canvas, start, end, LEFT_COLOUR, 1, cv2.LINE_AA)
            cv2.circle(canvas, start, 1, INK, -1)
        write_text(canvas, f"{name}: {found.rms[k]:.2f} px, covers {100 * found.coverage[k]:.0f} %", (8, 8))
        views.append(canvas)
    columns = int(np.ceil(np.sqrt(len(views))))
    views += [np.zeros_like(views[0])] * (-len(views) % columns)
    return np.vstack([np.hstack(views[at : at + columns]) for at in range(0, len(views), columns)])


@releases_locks
def print_board(board: str, output: str | Path, *, force: bool = False) -> Path:
    """Write the drawing of a board as SVG, to be printed at 100 %; a ruler in it checks the print.

    Args:
        board: such as charuco:5x7:40mm, with the numbers of squares and the side of one; also
            charuco:5x7:40mm:30mm:4x4_50, with the markers' side and dictionary, or chessboard:6x9:40mm.
        output: the drawing's file, .svg.
        force: replace a file that exists.

    Raises:
        UsageError: no such board.
        InputError: a file that cannot be written.
    """
    pattern = Board.parse(board)
    file = new_file(output, ".svg", force=force)
    write_whole(file, pattern.svg().encode())
    return file
