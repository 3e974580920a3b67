"""Writing a scene's masks to a folder that is a scene itself: made once, read fast."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import repeat
from pathlib import Path

import cv2
import numpy as np

from mmocap_warp.formats.attachments import attachment_lines
from mmocap_warp.formats.calibration.toml_rig import write_toml_rig
from mmocap_warp.formats.image_files import WebmFile, make_image_folders, write_png
from mmocap_warp.formats.toml_table import quoted, quoted_path, toml_value
from mmocap_warp.masks.frames import VideoFile
from mmocap_warp.masks.people import UNDECIDED
from mmocap_warp.scene.camera_source import CameraSource
from mmocap_warp.scene.kept_masks import MaskMark, calibration_hash
from mmocap_warp.scene.recording import Scene
from mmocap_warp.whole_file import file_name, write_whole

TINTS = ((31, 210, 255), (80, 200, 60), (230, 120, 200), (220, 200, 40), (90, 120, 255))  # BGR, of people in turn
_ADDED, _TAKEN = (255, 90, 0), (40, 40, 255)  # BGR: blue, red
_NAME = (235, 235, 235)
_OVERLAY = 1600, 900  # width and height that the overlay's views fill at most, well within a screen [px]

Refine = Callable[[list[np.ndarray], list[np.ndarray | None]], list[np.ndarray]]
"""From a frame's masks, per camera (height, width) bool, and its images to better masks."""


def write_masks(
    scene: Scene,
    folder: str | Path,
    scale: float = 1.0,
    progress: Callable[[int], None] | None = None,
    look: Callable[[list[list[np.ndarray]]], None] | None = None,
    refine: Refine | None = None,
    images: Iterable[list[np.ndarray | None]] | None = None,
    apart: Iterable[tuple[Sequence[list[np.ndarray]], list[np.ndarray]]] | None = None,
    make_consistent: Sequence[Callable[[list[np.ndarray]], list[np.ndarray]]] = (),
) -> Path:
    """Write finished masks (undistorted, resampled, cleaned, repaired) and an overlay; the new ``scene.toml``'s path.

    The folder gets ``<camera>/<frame>.png`` (1 bit, or labels where the scene has people), each camera's
    :class:`~mmocap_warp.scene.kept_masks.MaskMark`, ``overlay.webm``, ``pinholes.toml`` (the cameras that the masks
    belong to, for other programs) and last ``scene.toml``: the same scene, whose masks are made, read back exactly at
    ``scale``. Files of the same names are replaced. ``make_consistent``, one for each person, and then ``refine`` make
    a frame's masks better, and the overlay shows what the first of them has changed. ``look`` is called with those of
    each person, per camera (height, width) bool, and ``progress`` after each frame with the number of frames done.
    ``images`` are the scene's, where they lie somewhere in the meantime. ``apart`` are a frame's masks of each person
    and of what may be in front of them, where labels do not tell people apart. Raises an InputError for images that
    turn out unreadable, a folder that cannot be written to, or a name that is not UTF-8.
    """
    folder, rig = Path(folder), scene.rig(scale)
    folders = [folder / file_name(name, scene.path) for name in rig.names]
    about = masked_scene(scene, folder, scale).encode()  # refuses names that it cannot hold, before any work
    make_image_folders(folder, folders, digits=6)
    write_toml_rig(folder / "pinholes.toml", rig)
    for k, each in enumerate(folders):  # before any mask, so that none is ever without
        mask_mark(scene, k, scale, repaired=bool(make_consistent)).write(each)
    people = [scene.of_person(name) for name in scene.people] or [scene]
    streams = zip(*(person.masks(scale) for person in people), strict=True)
    with WebmFile(folder / "overlay.webm", scene.rate) as video, ThreadPoolExecutor() as pool:
        has_labels = bool(scene.people) or scene.has_others
        hidden = scene.hidden(scale) if has_labels else repeat([], scene.frame_count)
        pairs = apart or zip(streams, hidden, strict=True)
        frames = zip(pairs, scene.images(scale) if images is None else images, strict=True)
        encoding: Future[None] = pool.submit(lambda: None)  # a frame, while the next one is made
        for f, ((before, in_front), views) in enumerate(frames):
            masks = [make(each) for make, each in zip(make_consistent, before, strict=False)] or list(before)
            if refine is not None:
                before, masks = (), [refine(masks[0], views)]
            written = masks[0]
            if has_labels:  # numbered from 1 on; what is filled lies behind what was there before
                written = [np.where(hides, np.uint8(UNDECIDED), np.uint8(0)) for hides in in_front]
                for label, of_person in enumerate(zip(masks, before, strict=True), 1):
                    for labels, mask, old in zip(written, *of_person, strict=True):
                        labels[mask & (old | (labels == 0))] = label
            list(pool.map(write_png, [each / f"{f:06d}.png" for each in folders], written))
            overlay = draw_masks(masks, views, rig.names, before)
            encoding.result()
            encoding = pool.submit(video.write, overlay)
            if look is not None:
                look(masks)
            if progress is not None:
                progress(f + 1)
        encoding.result()
    write_whole(folder / "scene.toml", about)
    return folder / "scene.toml"


def mask_mark(scene: Scene, k: int, scale: float, repaired: bool = False) -> MaskMark:
    """What the masks that are written of camera ``k`` are of."""
    source, rig, repaired = scene.cameras[k], scene.calibrated, repaired or scene.foreground.repair
    placed = source.recorded_scale, source.recorded_offset
    return MaskMark(
        camera=source.name, size=tuple(rig.undistorted(scale).size[k].tolist()), scale=scale,
        calibrated_size=tuple(rig.size[k].tolist()), first_frame=scene.first_frame, shift=source.shift,
        stride=scene.stride, repaired=repaired, calibration=calibration_hash(rig, k, *placed, repaired),
    )  # fmt: skip


def draw_masks(
    people: Sequence[list[np.ndarray]],
    images: list[np.ndarray | None],
    names: Sequence[str],
    before: Sequence[list[np.ndarray]] = (),
) -> np.ndarray:
    """All views, in as many columns as make them largest: people's masks tinted and outlined over images (BGR).

    Each has its camera's name. Where there is no image masks are over gray. What was added to or taken from the masks
    that were there ``before`` has colours of its own.
    """
    # As large as a screen allows, each in the corner of a cell.
    height, width = np.max([mask.shape for mask in people[0]], axis=0).tolist()
    rows = {columns: -(-len(images) // columns) for columns in range(1, len(images) + 1)}
    fits = ((min(1.0, _OVERLAY[0] / (c * width), _OVERLAY[1] / (rows[c] * height)), c) for c in rows)
    scale, columns = max(fits)
    height, width = (max(1, round(scale * side)) for side in (height, width))
    canvas = np.full((rows[columns] * height, columns * width, 3), 40, np.uint8)
    for k, image in enumerate(images):
        pairs = [(new[k], old[k]) for new, old in zip(people, before or people, strict=True)]
        size = [max(1, round(scale * side)) for side in reversed(people[0][k].shape)]
        shape = (*reversed(size), 3)
        view = np.full(shape, 40, np.uint8) if image is None else cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        for person, pair in enumerate(pairs):
            mask, old = (cv2.resize(m.view(np.uint8), size, interpolation=cv2.INTER_NEAREST).view(bool) for m in pair)
            own = TINTS[person % len(TINTS)]
            for part, tint in ((mask, own), (mask & ~old, _ADDED), (old & ~mask, _TAKEN)):
                if part.any():
                    cv2.copyTo(view // 2 + np.array(tint, np.uint8) // 2, part.view(np.uint8), view)
            contours, _ = cv2.findContours(mask.view(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
            cv2.drawContours(view, contours, -1, own, 1)
        cv2.putText(view, names[k], (8, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.5, _NAME, 1, cv2.LINE_AA)
        top, left = k // columns * height, k % columns * width
        canvas[top : top + size[1], left : left + size[0]] = view
    return canvas


def masked_scene(scene: Scene, folder: Path, scale: float) -> str:
    """``scene.toml`` of a folder that holds a scene's masks of that scale, one folder a camera.

    It keeps all that the scene says but how masks are made: calibration, videos, truth, body, settings. The masks are
    tracked at their scale unless the scene asks for a smaller one.
    """

    def path(file: str | Path | None) -> str | None:
        """A file, or the name of a shipped body, as TOML has it."""
        return quoted(file) if isinstance(file, str) else None if file is None else quoted_path(file, folder)

    frames, people = scene.frames, scene.people
    subject, truth = (None, None) if people else (scene.subject, scene.truth)
    is_start = (frames.start, frames.step) == (0, 1)
    frames_value = str(len(frames)) if is_start else quoted(f"{frames.start}:{frames[-1] + 1}:{frames.step}")
    about = {"name": quoted(scene.name), "fps": repr(scene.fps), "up": quoted(scene.calibrated.up)}
    lines = [f"# A recorded scene with its masks made, at scale {scale:g}. By mmocap mask.", "[scene]"]
    lines += _key_lines(about | {"frames": frames_value, "subject": path(subject), "body": path(scene.body)})
    lines += [f"person = {quoted(scene.person)}   # is tracked; without this line everybody is"] if scene.person else []
    if scene.truth or any(person.truth for person in people.values()):
        known = {"file": path(truth), "axes": quoted(scene.truth_axes), "first_frame": str(scene.truth_first_frame)}
        lines += ["", "[truth]", *_key_lines(known)]
    units = None if scene.units is None else quoted(scene.units)
    lines += ["", "[cameras]", *_key_lines({"calibration": path(scene.calibration), "units": units})]
    for source in scene.cameras:
        media = {"masks": quoted(source.name), "video": path(source.video.path if source.video else None)}
        lines += ["", f"[cameras.{quoted(source.name)}]", *_key_lines(media | _placement(source, scene.fps))]
    lines += ["", "[labels]", f"thing = {UNDECIDED}"] if people or scene.has_others else []
    lines += ["person = 1"] if scene.has_others and not people else []
    lines += ["told_apart = true   # by their poses"] if scene.of_several or scene.told_apart else []
    for number, (name, person) in enumerate(people.items(), 1):
        files = {"subject": path(person.subject), "body": path(person.body), "truth": path(person.truth)}
        lines += ["", f"[people.{quoted(name)}]", f"label = {number}", *_key_lines(files)]
    lines += attachment_lines(scene.attached, folder)
    track = dict(scene.track)
    tracked_scale = track.get("scale", 1.0)
    if isinstance(tracked_scale, int | float) and scale < tracked_scale:
        track["scale"] = scale
    for name, settings in (("track", track), ("fit", scene.fit)):
        values = {key: toml_value(value) for key, value in settings.items()}
        lines += ["", f"[{name}]", *_key_lines(values)] if values else []
    return "\n".join([*lines, ""])


def _key_lines(values: Mapping[str, str | None]) -> list[str]:
    """Lines of keys with values in TOML; None is left out."""
    return [f"{key} = {value}" for key, value in values.items() if value is not None]


def _placement(source: CameraSource, fps: float) -> dict[str, str | None]:
    """The keys that place a camera's images in time and space, where they differ from the defaults."""
    is_stated = isinstance(source.video, VideoFile) and not source.video.fps  # the file is wrong about it
    placed, corner = source.recorded_scale != 1 or source.recorded_offset != (0.0, 0.0), list(source.recorded_offset)
    return {
        "offset": repr((source.frame_offset + source.fraction) / (fps * source.rate)) if source.fraction else None,
        "frame_offset": str(source.frame_offset) if source.frame_offset and not source.fraction else None,
        "fps": repr(fps * source.rate) if source.rate != 1.0 or is_stated else None,
        "centre_shift": str(list(source.centre_shift)) if source.centre_shift != (0.0, 0.0) else None,
        "video_from_calibrated": f"{{ scale = {source.recorded_scale!r}, offset = {corner} }}" if placed else None,
    }
