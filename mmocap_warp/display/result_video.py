"""A result to look at: an overlay video of all cameras, a contact sheet, and a single view."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import repeat
from pathlib import Path

import cv2
import numpy as np

from mmocap_warp.body.model import Subject
from mmocap_warp.body.posing import Poser
from mmocap_warp.cameras.rig import CameraRig, project
from mmocap_warp.display.overlay import INK, Look, ViewedBody, Window, draw_view, legend, plain, text_width, write_text
from mmocap_warp.errors import InputError, UsageError
from mmocap_warp.formats.image_files import WebmFile, write_animation, write_png
from mmocap_warp.masks.frames import evenly_spread
from mmocap_warp.result.result import STATUS, Result
from mmocap_warp.scene.frame_choice import read_ahead
from mmocap_warp.scene.recording import Scene
from mmocap_warp.tracking.body_masks import tracked_masks

_VIDEO_AREA = (1600, 900)  # size that the tiled views of a video frame fill at most, well within a screen [px]
_TITLE_WIDTH = 640  # width of a video at least, for the line above its views [px]
_BOX_FRAMES = 500  # frames, at most, from which the part of the image with the body is found
_HEADER = 30  # height of the line above the views [px]
_GAP = 4  # gap between tiles [px]
_SHEET_FRAMES = 8
_SHEET_ROW = 260  # height of a view in a contact sheet [px]
_STILL_COLUMNS = 4
_STILL_SIZE = (600, 600)  # size of the views from four sides [px]
_STILL_DISTANCE = 3.0  # distance of the four views from the body, in its sizes
_CROP_MARGIN = 0.12  # margin around the body, as a share of its size
_STRIP_FRAMES, _STRIP_RATE = 48, 20.0  # frames of an animated strip, and frames a second, at most
_STRIP_SIZE = (960, 240)  # width and height of an animated strip, at most [px]

View = np.ndarray | None
Views = Sequence[View]  # an image for each camera
Images = Iterable[Views]  # per frame


def show(
    result: Result,
    images: Images | None,
    masks: Images | None,
    *,
    people: Sequence[tuple[Look, Result, Images | None]] = (),
    video: str | Path | None = None,
    sheet: str | Path | None = None,
    strip: str | Path | None = None,
    layout: Layout | None = None,
    slow: float = 1.0,
    deviations: bool = False,
    progress: Callable[[int], None] | None = None,
) -> None:
    """Draw the best run over what was seen, in one pass over the recording.

    Args:
        result: what was tracked.
        images: per frame of the result, a gray or BGR image for each camera (None where there is none), undistorted;
            any resolution with the aspect of the result's cameras. None: draw over the masks.
        masks: likewise, (height, width) bool. None: draw no mask.
        people: where several are shown, each one's result of the same frames and masks; the first are those above.
        video: a ``.webm`` of all frames (VP8, which browsers play), or None.
        sheet: a ``.png`` of up to eight frames, a row for each camera, cut to the body, or None.
        strip: an animated ``.webp`` of the views in a row, small and endless, or None.
        layout: what the video shows of each camera. None: what is around the body.
        slow: how many times slower than it was the video and the strip play.
        deviations: draw ellipses of the joints' standard deviations too, where the result has them.
        progress: called after each frame with the number of frames done.

    Raises:
        InputError: a folder that cannot be written, or fewer images or masks than frames.
    """
    looks, results = [look for look, _, _ in people], [each for _, each, _ in people] or [result]
    if not deviations:
        results = [replace(each, joint_sigma=None) for each in results]
    bodies = [_project_run(each, each.best_run, looks[i] if looks else None) for i, each in enumerate(results)]
    layout, count = layout or video_layout(result, others=results[1:]), len(result.frame_numbers)
    seconds = slow * count / result.rate
    in_strip = max(1, min(_STRIP_FRAMES, int(_STRIP_RATE * seconds)))
    on_sheet, on_strip = evenly_spread(count, _SHEET_FRAMES), evenly_spread(count, in_strip)
    crops, small = _sheet_windows(bodies, on_sheet), _strip_windows(layout.windows)
    unnumbered = [replace(body, iou=None) for body in bodies]
    cells: list[list[np.ndarray]] = []
    strips: list[np.ndarray] = []
    with contextlib.ExitStack() as stack:
        writer = stack.enter_context(WebmFile(video, result.rate / slow)) if video else None

        def drawn() -> Iterator[np.ndarray | None]:
            """Each frame of the video, where there is one; other drawings are put aside."""
            streams = _frames_in_step(result, images, *([seen for _, _, seen in people] or [masks]))
            for frame, (seen, *masked) in enumerate(streams):
                if sheet and frame in on_sheet:
                    cells.append(_views(bodies, frame, seen, masked, crops))
                shown = writer or (strip and frame in on_strip)
                views = _views(bodies, frame, seen, masked, layout.windows) if shown else []
                if strip and frame in on_strip:
                    large = _views(unnumbered, frame, seen, masked, small) if looks else views
                    sized = zip(large, small, strict=True)
                    parts = [cv2.resize(each, to.size, interpolation=cv2.INTER_AREA) for each, to in sized]
                    strips.append(np.concatenate(parts, axis=1))
                yield _video_frame(results, looks, frame, views, layout.columns) if writer else None

        # A frame is encoded while the next ones are drawn.
        for frame, picture in enumerate(stack.enter_context(contextlib.closing(read_ahead(drawn())))):
            if writer and picture is not None:
                writer.write(picture)
            if progress is not None:
                progress(frame + 1)
    if sheet:
        write_png(sheet, _contact_sheet(results[0], on_sheet, cells, numbered=not looks))
    if strip:
        write_animation(strip, strips, seconds / len(strips))


def overlay(
    result: Result, scene: Scene | None = None, frame: int = 0, camera: int | str = 0, *, run: int | None = None
) -> np.ndarray:
    """Draw the tracked body over what one camera saw: skin, contours of body and mask, skeleton.

    Args:
        result: what was tracked.
        scene: its recording, for image and mask; None draws the body alone.
        frame: position in ``result.frame_numbers``; a negative one counts from the end.
        camera: which, by name or number.
        run: of which run; None for the best one.

    Returns:
        (height, width, 3) uint8, red, green, blue; as large as the camera's images, or as its masks without a video.

    Raises:
        ValueError: no such camera.
        IndexError: no such frame or run.
        InputError: the scene is another recording, or an image cannot be read.
    """
    names = result.cameras.names
    if camera not in (*names, *range(len(names))):
        raise UsageError(f"--camera must be one of {list(names)} or a number below {len(names)}, got {camera!r}")
    count, (first, last) = len(result.frame_numbers), result.frame_numbers[[0, -1]].tolist()
    if not -count <= frame < count:
        raise IndexError(f"frame must be 0 to {count - 1}, for the recording's {first} to {last}, got {frame}")
    k = names.index(camera) if isinstance(camera, str) else camera
    number = int(result.frame_numbers[frame])
    images: Views = [None] * len(names)
    masks: Views = images
    if scene is not None:
        check_same_recording(result, scene)
        images = next(scene.of_frames(range(number, number + 1)).images())
        masks = next(tracked_masks(scene, result, [frame % len(result.frame_numbers)]))
    body = _project_run(result, result.best_run if run is None else run)
    whole = [
        Window((0, 0), (width, height), (width, height) if image is None else (image.shape[1], image.shape[0]))
        for (width, height), image in zip(result.cameras.size.tolist(), images, strict=True)
    ]
    return _views([body], frame, images, [masks], whole)[k][:, :, ::-1].copy()  # OpenCV draws blue first


def show_subject(
    subject: Subject,
    sheet: str | Path,
    rig: CameraRig | None = None,
    images: Views | None = None,
    masks: Views | None = None,
) -> None:
    """Draw a subject in its first pose as a ``.png``, each view cut to the body; without a rig from four sides.

    There may be an image and a mask for each camera, as :func:`show` takes them.
    """
    rig = rig or _rig_around(subject)
    nothing: list[View] = [None] * len(rig)
    bodies = [_ProjectedBody(subject, rig, subject.pose[None])]
    views = _views(bodies, 0, images or nothing, [masks or nothing], _sheet_windows(bodies, [0]))
    for name, view in zip(rig.names, views, strict=True):
        write_text(view, name, (6, 6), size=0.4)
    columns = math.ceil(len(views) / math.ceil(len(views) / _STILL_COLUMNS))  # rows as long as each other, or nearly
    canvas, _ = _tile([views[first : first + columns] for first in range(0, len(views), columns)])
    # The body's name, and its fitted height; its length if it lies or goes on four legs.
    title, known = subject.body.name, subject.provenance
    measure, adjective = ("length", "long") if "body.length" in known else ("height", "tall")
    if f"body.{measure}" in known and f"body.{measure}.sigma" in known:
        size, sigma = float(known[f"body.{measure}"]), float(known[f"body.{measure}.sigma"])
        title += f"   {size:.2f} +- {sigma:.2f} m {adjective}"
    write_text(canvas, title, (6, 9))
    write_png(sheet, canvas)


def _rig_around(subject: Subject) -> CameraRig:
    """Four cameras around a subject, the first before it."""
    from mmocap_warp.formats.usd.usd_body import up_axis

    (vertices,) = Poser(subject.body, subject.root_base).vertices(subject.pose)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    extent = float(np.linalg.norm(high - low))
    ahead, up = subject.root_base[:, 2], subject.root_base[:, 1]
    aside = np.cross(up, ahead)
    towards = -np.stack([ahead, aside, -ahead, -aside])
    R = np.stack([np.stack([np.cross(-up, forward), -up, forward]) for forward in towards])
    eye = (low + high) / 2 - _STILL_DISTANCE * extent * towards
    width, height = _STILL_SIZE
    focal = _STILL_DISTANCE * height
    K = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1.0]])
    t = -np.einsum("kab,kb->ka", R, eye)
    names = ("front", "left", "back", "right")
    sizes, straight = np.tile(_STILL_SIZE, (4, 1)), np.zeros((4, 5))
    return CameraRig(names, np.tile(K, (4, 1, 1)), R, t, sizes, straight, up_axis(subject.root_base))


def check_same_recording(result: Result, scene: Scene) -> None:
    """Raise InputError for a scene that is not a result's: it has other cameras, or fewer frames."""
    mine, theirs, last = result.cameras.names, scene.calibrated.names, int(result.frame_numbers[-1])
    if mine != theirs:
        problem = f"has the cameras {', '.join(theirs)}, the result {', '.join(mine)}"
    elif last >= scene.recorded_frames:
        problem = f"has {scene.recorded_frames} frames, the result goes to frame {last}"
    else:
        return
    raise InputError(scene.path, problem, "name the scene that was tracked")


@dataclass(frozen=True)
class _ProjectedBody:
    """A subject in the cameras' pixels, one pose of (frame, coordinate) at a time: all skin would fill the memory."""

    subject: Subject
    rig: CameraRig
    pose: np.ndarray
    joint_sigma: np.ndarray | None = None  # (frame, joint, 3)
    iou: np.ndarray | None = None  # (frame, camera), stands behind the name
    look: Look | None = None

    @cached_property
    def _poser(self) -> Poser:
        return Poser(self.subject.body, self.subject.root_base)

    def vertices(self, frame: int) -> np.ndarray:
        """(camera, vertex, 2), the tracking mesh [px]."""
        (vertices,) = self._poser.tracking_vertices(self.pose[frame])
        return project(self.rig, vertices)

    def seen(self, frame: int, masks: Views) -> list[ViewedBody]:
        """What each camera sees of it."""
        (transforms,) = self._poser.joint_transforms(self.pose[frame])
        places = transforms[:, :3, 3]
        vertices, joints = self.vertices(frame), project(self.rig, places)
        # Covariances of the joints' places [px^2], where the result has them.
        spread: list[View] = [None] * len(self.rig)
        if self.joint_sigma is not None:
            off = self.joint_sigma[frame][:, None] * np.eye(3)  # (joint, axis, 3)
            moved = [project(self.rig, places + off[:, axis]) - joints for axis in range(3)]
            spread = list(sum(each[..., :, None] * each[..., None, :] for each in moved))
        looks = [self.look] * len(self.rig)
        if self.look is not None and self.iou is not None:
            looks = [replace(self.look, name=_number(self.look.name, iou, "not used")) for iou in self.iou[frame]]
        depths = (self.rig.R @ places[0] + self.rig.t)[:, 2].tolist()
        seen = zip(masks, vertices, joints, spread, looks, depths, strict=True)
        return [ViewedBody(self.subject.body, *view) for view in seen]


def _views(
    bodies: list[_ProjectedBody], frame: int, images: Views, masks: Sequence[Views], windows: list[Window]
) -> list[np.ndarray]:
    """Each camera's drawing; ``masks`` are each body's."""
    seen = [body.seen(frame, of_body) for body, of_body in zip(bodies, masks, strict=True)]
    sizes = map(tuple, bodies[0].rig.size.tolist())
    return [draw_view(*view) for view in zip(windows, sizes, images, zip(*seen, strict=True), strict=True)]


def _project_run(result: Result, run: int, look: Look | None = None) -> _ProjectedBody:
    """One of a result's runs."""
    sigma = None if result.joint_sigma is None else result.joint_sigma[run]
    return _ProjectedBody(result.subject, result.cameras, result.pose[run], sigma, result.iou[run], look)


def _frames_in_step(result: Result, *seen: Images | None) -> Iterator[tuple]:
    """Images and people's masks of each frame of the result."""
    nothing = repeat([None] * len(result.cameras))
    streams = zip(*(nothing if each is None else each for each in seen), strict=False)
    for number in result.frame_numbers:
        if (both := next(streams, None)) is None:
            scene = result.config.get("scene", "recording")
            raise InputError(scene, f"has no frame {number}, which the result has", "show it with its own scene")
        yield both


@dataclass(frozen=True)
class Layout:
    """What a video shows: each camera's window, in rows of so many ``columns``."""

    windows: list[Window]
    columns: int

    @property
    def scale(self) -> float:
        """The scale of the cameras' images at which no window has to be enlarged."""
        return max(window.size[1] / window.extent[1] for window in self.windows)


def video_layout(result: Result, whole: bool = False, others: Sequence[Result] = ()) -> Layout:
    """Windows that fill a video: whole images, or what is around the bodies of the best runs over the clip.

    Each has a fixed place, so that what stands still in a camera stands still in the video.
    """
    sizes, count = result.cameras.size.astype(float), len(result.frame_numbers)
    boxes = np.stack([np.zeros_like(sizes), sizes], axis=1)
    if not whole:
        bodies = [_project_run(each, each.best_run) for each in (result, *others)]
        boxes = _boxes(bodies, evenly_spread(count, _BOX_FRAMES))
    # Boxes grow to one shape, as far as the images reach: then they fill the cells of a grid.
    extent = boxes[:, 1] - boxes[:, 0]
    shape = float(np.median(extent[:, 0] / extent[:, 1]))
    grown = np.maximum(extent, np.stack([extent[:, 1] * shape, extent[:, 0] / shape], axis=1))
    grown = np.minimum(np.ceil(grown), sizes)
    corners = np.clip(np.floor(boxes.mean(axis=1) - grown / 2), 0, sizes - grown).astype(int).tolist()

    def cell_height(columns: int) -> float:
        rows = math.ceil(len(sizes) / columns)
        return min(_VIDEO_AREA[0] / (columns * shape), _VIDEO_AREA[1] / rows)

    columns = max(range(1, len(sizes) + 1), key=cell_height)
    cell = cell_height(columns) * np.array([shape, 1.0])
    windows = []
    for corner, part in zip(corners, grown, strict=True):
        width, height = np.maximum(1, np.floor(part * (cell / part).min() + 1e-6)).astype(int).tolist()
        windows.append(Window(tuple(corner), tuple(part.astype(int).tolist()), (width, height)))
    return Layout(windows, columns)


def _boxes(bodies: list[_ProjectedBody], frames: list[int]) -> np.ndarray:
    """(camera, 2, 2), left top and right bottom around the bodies in ``frames`` [px]; of the image where unseen."""
    sizes = bodies[0].rig.size.astype(float)
    low, high = np.full_like(sizes, np.inf), np.full_like(sizes, -np.inf)
    for frame in frames:
        pixels = np.concatenate([body.vertices(frame) for body in bodies], axis=1)
        inside = ((pixels >= 0) & (pixels < sizes[:, None])).all(axis=2, keepdims=True)
        low = np.minimum(low, np.where(inside, pixels, np.inf).min(axis=1))
        high = np.maximum(high, np.where(inside, pixels, -np.inf).max(axis=1))
    unseen = np.isinf(low)
    low, high = np.where(unseen, 0.0, low), np.where(unseen, sizes, high)
    margin = _CROP_MARGIN * (high - low).max(axis=1, keepdims=True) + 1
    return np.stack([np.maximum(np.floor(low - margin), 0), np.minimum(np.ceil(high + margin), sizes)], axis=1)


def _sheet_windows(bodies: list[_ProjectedBody], frames: list[int]) -> list[Window]:
    """Each camera's window around the bodies in ``frames``, as high as a row of a contact sheet."""
    windows = []
    for (left, top), (right, bottom) in _boxes(bodies, frames).astype(int).tolist():
        extent = (right - left, bottom - top)
        windows.append(Window((left, top), extent, (max(1, round(extent[0] * _SHEET_ROW / extent[1])), _SHEET_ROW)))
    return windows


def _video_frame(
    results: list[Result], looks: list[Look], frame: int, views: list[np.ndarray], columns: int
) -> np.ndarray:
    """All cameras at one frame, each with its overlap, below a line with the frame's number and status."""
    result, alone = results[0], not looks
    run = result.best_run
    for k, view in enumerate(views):
        overlap = f"   {_number('IoU', result.iou[run, frame, k], 'not used')}" if alone else ""
        write_text(view, f"{result.cameras.names[k]}{overlap}", (8, 8))
    canvas, _ = _tile([views[i : i + columns] for i in range(0, len(views), columns)], _TITLE_WIDTH)
    title = f"frame {result.frame_numbers[frame]}"
    words = [(_number("cost", result.cost[run, frame], "no cost"), INK)]
    states = [STATUS[each.status[each.best_run, frame]] for each in results]
    if alone:
        title += f"   {states[0]}"
    else:
        words = [(f"{look.name}: {state}", look.colour) for look, state in zip(looks, states, strict=True)]
    end = write_text(canvas, title, (12, 8), size=0.55)
    for text, colour in words:
        end = write_text(canvas, text, (end + 18, 9), colour)
    # The legend stands at the right end, the same in all frames.
    height, right = canvas.shape[:2]
    for name, colour in reversed(legend(alone, ellipses=result.joint_sigma is not None).items()):
        right -= text_width(name) + 18
        write_text(canvas, name, (right, 9), colour)
    width = canvas.shape[1]
    return np.pad(canvas, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")  # codecs want even sizes


def _strip_windows(windows: list[Window]) -> list[Window]:
    """Small ones that stand side by side; what has names is drawn in these, so that the names can be read."""
    shapes = [window.size[0] / window.size[1] for window in windows]
    height = min(_STRIP_SIZE[1], int(_STRIP_SIZE[0] / sum(shapes)))
    sizes = [(max(1, round(height * shape)), height) for shape in shapes]
    return [replace(window, size=size) for window, size in zip(windows, sizes, strict=True)]


def _contact_sheet(result: Result, frames: list[int], cells: list[list[np.ndarray]], numbered: bool) -> np.ndarray:
    """Frames from left to right, cameras from top to bottom."""
    for frame, views in zip(frames, cells, strict=True) if numbered else ():
        for k, view in enumerate(views):
            write_text(view, _number("", result.iou[result.best_run, frame, k], "not used"), (6, 6), size=0.4)
    for name, view in zip(result.cameras.names, cells[0], strict=True):
        write_text(view, name, (6, view.shape[0] - 18), size=0.4)
    canvas, lefts = _tile([[views[k] for views in cells] for k in range(len(result.cameras))])
    for frame, left in zip(frames, lefts, strict=True):
        write_text(canvas, f"frame {result.frame_numbers[frame]}", (left + 6, 9))
    return canvas


def _tile(rows: list[list[np.ndarray]], least: int = 0) -> tuple[np.ndarray, list[int]]:
    """A canvas of views in rows below a free header, ``least`` so wide, and where its columns begin [px]."""
    columns = len(rows[0])
    widths = [max(row[c].shape[1] for row in rows if c < len(row)) for c in range(columns)]
    heights = [max(view.shape[0] for view in row) for row in rows]
    lefts = [_GAP + sum(widths[:c]) + c * _GAP for c in range(columns)]
    tops = [_HEADER + sum(heights[:r]) + r * _GAP for r in range(len(rows))]
    width = max(lefts[-1] + widths[-1] + _GAP, least)
    canvas = plain(tops[-1] + heights[-1] + _GAP, width)
    for row, top, height in zip(rows, tops, heights, strict=True):
        for view, left, width in zip(row, lefts, widths, strict=False):
            y, x = top + (height - view.shape[0]) // 2, left + (width - view.shape[1]) // 2
            canvas[y : y + view.shape[0], x : x + view.shape[1]] = view
    return canvas, lefts


def _number(name: str, value: float, absent: str) -> str:
    return f"{name} {value:.3f}".strip() if np.isfinite(value) else absent
