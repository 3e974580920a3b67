"""Reading ``scene.toml``: every mistake is one :class:`~mmocap_warp.errors.InputError` before any work starts."""

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mmocap_warp.cameras.rig import METRES, UP_AXES, CameraRig
from mmocap_warp.errors import InputError
from mmocap_warp.formats.attachments import take_attachments
from mmocap_warp.formats.toml_table import Table, load_toml
from mmocap_warp.masks.frames import Frames
from mmocap_warp.masks.mask_files import Masks
from mmocap_warp.masks.mask_image import Labels, decode_mask, identities_of
from mmocap_warp.masks.mask_settings import BACKGROUNDS, GIVEN, KEEP, MODELS, SOURCES, ForegroundSettings, subtracted
from mmocap_warp.scene.camera_source import CameraSource, recorded_frames
from mmocap_warp.scene.camera_tables import fastest, read_cameras
from mmocap_warp.scene.frame_choice import FrameChoice
from mmocap_warp.scene.kept_masks import MARK_NAME, MaskMark, calibration_hash
from mmocap_warp.scene.label_tables import read_people, take_body, with_labels
from mmocap_warp.scene.recording import Person, Scene

_WAYS_TO_MASKS = (
    "add masks, got in one of three ways: mmocap mask SCENE --with mediapipe (or another program, such as rembg or "
    'SAM 2) makes them of the videos; mmocap mask subtracts the background, once [foreground] source is "recording", '
    '"clean_plate" or "background_video"; or name masks that you have, a folder of images or a video'
)

_IMAGES = {  # by the source of the foreground, the images that every camera needs
    "masks": ("masks",),
    "clean_plate": ("video", "clean_plate"),
    "background_video": ("video", "background"),
    "recording": ("video",),
    "program": ("video",),
}
_SAMPLES = 5  # number of mask images per camera that are looked at while loading
_MIN_PICTURE_LEVEL = 32  # if all gray levels are below, they are rather labels than a picture
_MAX_FOREGROUND = 0.8  # share of an image; a mask that shows more is inverted


def load_scene(
    path: str | Path,
    frames: str | None = None,
    identity: int | None = None,
    *,
    masks: bool = True,
    calibrated: bool = True,
    source: str | None = None,
    live: bool = False,
) -> Scene:
    """Read and check a scene file, or the ``scene.toml`` of a folder; paths in it are relative to its folder.

    Args:
        path: the file or its folder.
        frames: which of the recording's frames, in place of what the file says: ``first:end``, ``first:end:stride``,
            or a count of those that the file names.
        identity: of the person to be tracked, instead of the scene's own [foreground] identity.
        masks: whether masks, or what they are made of, must be there; a look at the cameras does without.
        calibrated: whether a calibration must be named, which must say where cameras stand, and cameras must agree on
            where they end. Without one, they are pinholes of the recorded images' sizes that stand nowhere.
        source: instead of the scene's own [foreground] source: ``"program"``, or ``"subtraction"`` for the best of the
            backgrounds that the scene has.
        live: what is tracked comes from elsewhere: no video and no masks must be there, only what is subtracted.

    Raises:
        ValueError: ``frames`` that the recording does not have.
        InputError: anything that is wrong with the scene file, the calibration, or the files it names.
    """
    path = Path(path)
    path = path / "scene.toml" if os.path.isdir(path) else path
    file = load_toml(path)
    # The file's tables; an unknown one is reported before anything else.
    about, truth, cameras = (file.take_table(key) for key in ("scene", "truth", "cameras"))
    labels, people = file.take_table("labels"), file.take_tables_of("people")
    labelled, told_apart = bool(people) or labels.has("person"), labels.take("told_apart", bool, False)
    making = file.take_table("foreground")
    track, fit = file.take_table("track").take_rest(), file.take_table("fit").take_rest()
    attached = take_attachments(file, path.parent)
    file.finish()

    # [scene]: names, times and the body.
    name = about.take("name", str, "") or path.resolve().parent.name or "scene"
    stated_fps = about.take("fps", float, None)
    if stated_fps is not None and not 0 < stated_fps < 100_000:
        raise about.error(f"fps = {stated_fps:g} is not a frame rate", "give the frames per second of the recording")
    states_up, up = about.has("up"), about.take_choice("up", UP_AXES, "+z")
    value = about.take_any("frames", (int, str), ":")
    with about.errors('give a count, "first:end" or "first:end:stride"'):
        named_frames = FrameChoice(count=value) if isinstance(value, int) else FrameChoice.parse(value)
    body, subject = take_body(about, path), about.take_file("subject", path.parent, None)
    tracked = about.take("person", str, None)
    about.finish()

    # [cameras]: the calibration, and each camera's images.
    named_calibration = cameras.take("calibration", str, None)
    if named_calibration is None and calibrated:
        remedy = 'name its file, calibration = "...", or let mmocap calib solve find one from a person who walks'
        raise cameras.error("'calibration' is missing", remedy)
    calibration = None if named_calibration is None else path.parent / named_calibration
    units = cameras.take_choice("units", tuple(METRES), None)
    tables = cameras.take_tables()
    fps = fastest(tables, path, about) if stated_fps is None else stated_fps
    sources, rig = read_cameras(cameras, tables, path, calibration, units, up, fps, calibrated)
    foreground = _read_foreground(making, identity, source, labelled, rig)
    sources = with_labels(sources, labels, foreground)
    # What the tables name must fit together.
    if states_up and rig.up != up:
        raise about.error(f'up = "{up}", but {named_calibration} says {rig.up}', "leave up out, or correct one of them")
    if not masks:  # frames are counted by what every camera has
        have_masks = all(source.masks is not None for source in sources)
        foreground = replace(foreground, source="masks" if have_masks else "recording")
    elif source == "subtraction" and foreground.source == "recording":
        kinds = (kind for kind in BACKGROUNDS if all(getattr(each, need) for each in sources for need in _IMAGES[kind]))
        foreground = replace(foreground, source=next(kinds, "recording"))
    named_people = read_people(people, sources, foreground, path, body)
    if len(named_people) < 2 and any(each.several for each in sources):
        raise labels.error("several is of two people or more", "name them in tables of their own: [people.<name>]")
    if not (tracked is None or tracked in named_people):
        raise about.error(f'person = "{tracked}" has no table', f"add [people.{tracked}], or leave person out")
    to_come = ("video", "masks") if live and foreground.source != "recording" else ()
    needs = [each for each in _IMAGES[foreground.source] if each not in to_come] if masks else []
    _check_sources(sources, rig, foreground, cameras, named_people, needs, undistorted_with=calibration is not None)
    named, chosen = _frames(sources, foreground, named_frames, frames, about, agreeing=calibrated)
    scene = Scene(
        path=path, name=name, fps=fps, frame_count=len(chosen), calibrated=rig, cameras=sources, foreground=foreground,
        subject=subject, body=body, truth=truth.take_file("file", path.parent, None),
        truth_axes=truth.take("axes", str, "xyz"), truth_first_frame=truth.take("first_frame", int, 0), track=track,
        fit=fit, first_frame=chosen.start, stride=chosen.step, calibration=calibration, units=units, named_frames=named,
        attached=attached, people=named_people, told_apart=told_apart,
    )  # fmt: skip
    truth.finish()
    return scene if tracked is None else scene.of_person(tracked)


def _read_foreground(
    table: Table, identity: int | None, source: str | None, labelled: bool, rig: CameraRig
) -> ForegroundSettings:
    stated = table.take_choice("source", SOURCES, "masks")
    if source == "subtraction":
        source = stated if stated in BACKGROUNDS else "recording"
    source = source or stated
    has_identities = source in ("masks", "program")
    default = replace(GIVEN if has_identities else subtracted(int(rig.size.max())), source=source)
    if labelled:  # then all pieces that have a person's label are that person's
        default = replace(default, keep="all")
    values: dict[str, Any] = {
        "model": table.take_choice("model", MODELS, default.model),
        "keep": table.take_choice("keep", KEEP, default.keep),
    }
    for name, fallback in vars(default).items():
        if name not in ("source", *values):
            values[name] = table.take(name, type(fallback), fallback)
    table.finish()
    if identity is not None:
        values["identity"] = identity
    if values["identity"] and not has_identities:
        raise table.error("identity chooses among given masks; these are subtracted", "leave it out")
    if values["identity"] and labelled:
        raise table.error("identity and labels of people both say who is tracked", "leave it out; --person chooses")
    with table.errors("give a value in that range"):
        return replace(default, **values)


def _check_sources(
    sources: tuple[CameraSource, ...],
    rig: CameraRig,
    foreground: ForegroundSettings,
    table: Table,
    people: dict[str, Person],
    needs: list[str],
    undistorted_with: bool,
) -> None:
    if foreground.repair and len(sources) < 3:
        raise table.error(f"repair needs at least 3 cameras, this scene has {len(sources)}", "set repair = false")
    for k, source in enumerate(sources):
        where = f"{table.source}: [cameras.{source.name}]"
        # Every camera has the images that masks are made from,
        for need in needs:
            if getattr(source, need) is None:
                problem = f"'{need}' is missing, which [foreground] source = \"{foreground.source}\" needs"
                raise InputError(where, problem, _WAYS_TO_MASKS if need == "masks" else f"add {need}")
        # images of the size that the calibration says,
        recorded_masks = source.masks if source.mask_mark is None else None
        for frames in (source.video, recorded_masks, source.clean_plate, source.background):
            if frames is not None:
                _check_size(frames, source, rig.size[k], where)
        # and masks that can be of this subject.
        if source.masks is not None and source.mask_mark is not None and undistorted_with:
            _check_undistorted(source.masks, source.mask_mark, source, rig, k)
        if foreground.source == "masks" and source.masks is not None and not people:
            _check_masks(source.masks, source.label or foreground.identity)
    for name, person in people.items() if "masks" in needs else ():
        of_views = [(each.masks, (person.labels[k], *each.several)) for k, each in enumerate(sources) if each.masks]
        images = ((image, labels) for masks, labels in of_views for image in masks.sample(_SAMPLES))
        if not any(decode_mask(image, label).any() for image, labels in images for label in labels):
            where = f"{table.source}: [people.{name}]"
            remedy = "give the person's in the masks; if people are one blob, name the blob's under [labels] as several"
            raise InputError(where, f"no mask shows label {person.labels[0]}", remedy)


def _check_size(frames: Frames | Masks, source: CameraSource, size: np.ndarray, where: str) -> None:
    recorded = np.array(frames.size)
    files: list[Path] = list(getattr(frames, "files", ()))
    stated = "{} is {}x{}".format(files[0] if len(files) == 1 else frames.path, *frames.size)
    if source.video is not None and frames.size != source.video.size:
        problem = "{}, and {} is {}x{}".format(stated, source.video.path, *source.video.size)
        raise InputError(where, problem, "give images of the video's size")
    if source.recorded_scale == 1 and source.recorded_offset == (0.0, 0.0):
        if (recorded != size).any():
            by, offset = "...", "..."
            if len(scales := {round(scale, 2) for scale in recorded / size}) == 1:
                (by,) = scales  # a pixel's centre keeps its place in the image
                offset = f"{0.5 * by - 0.5:g}, {0.5 * by - 0.5:g}"
            remedy = f"calibrate this size, or set video_from_calibrated = {{ scale = {by}, offset = [{offset}] }}"
            if (recorded == size[::-1]).all():
                remedy = "they seem to be turned by 90 degrees: turn them back, or calibrate the camera as it is turned"
            raise InputError(where, f"{stated}, but the calibration says {size[0]}x{size[1]}", remedy)
        return
    low = np.array(source.recorded_offset)
    high = low + source.recorded_scale * size
    overlap = np.clip(np.minimum(high, recorded) - np.maximum(low, 0), 0, None).prod()
    if overlap < 0.5 * recorded.prod():
        problem = f"{stated}, but video_from_calibrated puts the calibrated image at {low.round(1)} to {high.round(1)}"
        raise InputError(where, problem, "correct it: recorded pixel = scale * calibrated pixel + offset")


def _check_undistorted(masks: Masks, mark: MaskMark, source: CameraSource, rig: CameraRig, k: int) -> None:
    if mark.camera != source.name:
        problem = f"these masks are of '{mark.camera}', not of '{source.name}'"
        raise InputError(masks.path, problem, "correct masks = under [cameras]")
    placed = source.recorded_scale, source.recorded_offset
    if mark.calibration != calibration_hash(rig, k, *placed, mark.repaired):
        problem = f"these masks of '{mark.camera}' were undistorted with another calibration than the scene's"
        remedy = f"make them again with mmocap mask, or remove {MARK_NAME} if they are in the recorded video's pixels"
        raise InputError(masks.path, problem, remedy)
    width, height = rig.undistorted(mark.scale).size[k]
    if masks.size != (width, height):
        problem = f"the masks are {masks.size[0]}x{masks.size[1]}, their {MARK_NAME} says {width}x{height}"
        raise InputError(masks.path, problem, "make them again")


def _check_masks(masks: Masks, identity: int) -> None:
    """Look at a few images; only if they show nothing at all, at every one."""

    def decoded(images: Iterator[np.ndarray | Labels]) -> Iterator[np.ndarray]:
        return (decode_mask(image, identity, masks.soft) for image in images)

    if identity and masks.soft:
        raise InputError(masks.path, "a video of masks holds no identities", "give it as images, or set identity = 0")
    fractions = [mask.mean() for mask in decoded(masks.sample(_SAMPLES))]
    if not any(fractions) and not any(mask.any() for mask in decoded(masks.read())):
        raise InputError(masks.path, *_why_empty(masks, identity))
    if np.median(fractions) > _MAX_FOREGROUND:
        remedy = "invert them (the subject is white), or subtract a clean plate of this camera and this light"
        raise InputError(masks.path, f"masks are {100 * np.median(fractions):.0f} % foreground", remedy)


def _why_empty(masks: Masks, identity: int) -> tuple[str, str]:
    """What is wrong with masks that show nothing, and what to do."""
    levels = identities_of(masks.sample(_SAMPLES))
    listed = ", ".join(map(str, sorted(levels)[:8]))
    if identity:
        remedy = f"set one that is there: {listed}" if levels else "set identity = 0"
        return f"no mask shows identity {identity}", remedy
    if levels and max(levels) < _MIN_PICTURE_LEVEL:
        return "all masks are empty", f"if their gray levels are labels ({listed}), choose one with identity"
    return "all masks are empty", "check how they were exported"


def _frames(
    sources: tuple[CameraSource, ...],
    foreground: ForegroundSettings,
    named: FrameChoice,
    asked: str | None,
    table: Table,
    agreeing: bool,
) -> tuple[range, range]:
    """The frames that the scene names, and those that are asked for; cameras must agree on where an open range ends."""
    # Frames of each camera, of those that have images; all have where masks are needed.
    images = "masks" if foreground.source == "masks" else "video"
    filmed = [source for source in sources if getattr(source, images) is not None]
    counts = {source.name: recorded_frames(source, foreground.source) for source in filmed}
    shortest = min(counts.values(), default=1)
    listed = ", ".join(f"{name} {count}" for name, count in counts.items())
    choice = FrameChoice.parse(asked) if asked is not None else named
    open_end = named if choice.count is not None else choice
    if agreeing and open_end.count is None and open_end.end is None and len(set(counts.values())) > 1:
        raise table.error(f"cameras differ in their number of frames: {listed}", f"set frames = {shortest}")
    with table.errors("name frames that are there", f"{{error}} ({listed})"):
        own = named.of(range(shortest), shortest)
    frames = own if asked is None else choice.of(own, shortest)
    for source in sources:
        if source.mask_mark is None and abs(source.shift) >= shortest:
            problem = f"camera '{source.name}' has frame_offset = {source.frame_offset} in {shortest} frames"
            raise table.error(problem, "give a shift of a few frames")
    _check_shared_time(filmed, counts, table)
    return own, frames


def _check_shared_time(filmed: list[CameraSource], counts: dict[str, int], table: Table) -> None:
    """See that there is a moment at which all cameras that have images recorded; ``counts`` are their frames."""
    timed = [source for source in filmed if source.mask_mark is None]
    if len(timed) < 2:
        return
    begin = {source.name: -source.frame_offset / source.rate for source in timed}
    end = {source.name: begin[source.name] + counts[source.name] - 1 for source in timed}
    latest, earliest = max(begin, key=lambda name: begin[name]), min(end, key=lambda name: end[name])
    if begin[latest] > end[earliest]:
        problem = f"{earliest} has ended when {latest} begins: by their offsets they recorded at no common time"
        raise table.error(problem, "correct the offsets; mmocap sync finds them")
