"""A first ``scene.toml`` for a folder of videos: what is there is named, what is missing is said."""

import os
import re
from collections import Counter
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from mmocap_warp.cameras.rig import UP_AXES, CameraRig
from mmocap_warp.errors import InputError
from mmocap_warp.formats.calibration.calibration_text import EVERY_OTHER
from mmocap_warp.formats.toml_table import quoted_key, quoted_path, visible
from mmocap_warp.masks.frames import Frames, ImageFolder, VideoFile, as_colour, open_frames
from mmocap_warp.scene import folder_search as search
from mmocap_warp.scene.camera_tables import RATE_TOLERANCE
from mmocap_warp.scene.folder_search import CalibrationFile, Kind, Medium, Take
from mmocap_warp.scene.recording import Scene

# Walking and boxing in seven views are tracked as well at 220 as at 870 px (3.6 and 5.2 mm). At 145 px errors are 11 %
# larger, at 72 px 80 %.
_ENOUGH = 220  # pixels of a subject
LARGE_IMAGE = 1000
"""Pixels of the longer side from which images are scaled."""
_FILLED = 0.75  # share of an image's height that a subject is supposed to fill
_MIN_UPRIGHT = 0.8  # share of the images' vertical that is along the world's if cameras stand upright
_MAX_BAR_LEVEL = 30.0  # gray levels, of a black bar's brightest row
_MIN_BAR_STEP = 20.0  # gray levels, by which the picture beside a black bar is brighter
_UNLIKE_LEVELS = 1.6  # ratio of mean gray levels from which exposures differ: somewhat over a stop


@dataclass
class Draft:
    """A drafted scene."""

    text: str = ""  # of ``scene.toml``
    project: str | None = None  # whose project the folder is, None where that is not known
    calibration: Path | None = None  # its file, or None
    cameras: tuple[str, ...] = ()  # their names
    found: list[str] = field(default_factory=list)  # what was found and taken, in sentences
    missing: list[str] = field(default_factory=list)  # what has to be done before the scene can be tracked, likewise


@dataclass(frozen=True)
class _Media:
    """What there is of each camera, and the frames that its size, length and rate are taken from."""

    video: Take
    masks: Take
    background: Take
    clean_plate: Take

    @cached_property
    def frames(self) -> dict[str, Frames]:
        return {name: open_frames(path) for name, path in (self.masks | self.video).items()}

    @cached_property
    def first_images(self) -> dict[str, np.ndarray]:
        """Of each camera's frames, BGR."""
        return {name: as_colour(next(frames.read())) for name, frames in self.frames.items()}

    @cached_property
    def fps(self) -> float | None:
        """The rate that most videos have."""
        rates = Counter(round(rate, 3) for rate in self.rates.values())
        return max(rates, key=lambda rate: (rates[rate], rate)) if rates else None

    @cached_property
    def rates(self) -> dict[str, float]:
        """Of each video that tells it."""
        videos = {name: frames for name, frames in self.frames.items() if isinstance(frames, VideoFile)}
        return {name: video.fps for name, video in videos.items() if video.fps > 0}

    def others_rate(self, name: str) -> float | None:
        """A video's own rate, where most have another."""
        rate = self.rates.get(name)
        return rate if rate is not None and self.fps and abs(rate / self.fps - 1) > RATE_TOLERANCE else None


def tracking_scale(size: np.ndarray, length: float | None = None) -> float:
    """The power of two by which images (camera, 2) [px] are scaled for a tracker, which gains nothing from larger ones.

    ``length`` is the subject's [px]; where it is not known, three quarters of the images' height.
    """
    length = _FILLED * float(size[:, 1].max()) if length is None else length
    return 1.0 if size.max() < LARGE_IMAGE else 0.5 ** max(0, int(np.log2(max(length, 1.0) / _ENOUGH)))


def mask_scale(scene: Scene) -> float:
    """The scale at which a scene's masks are made: full size where it names the one at which it is tracked."""
    return 1.0 if "scale" in scene.track else tracking_scale(scene.calibrated.size)


def draft_scene(folder: Path) -> Draft:
    """Look at what a folder holds and draft its scene file. Nothing is written.

    Raises:
        InputError: a folder without videos and images, an unreadable calibration, or several possible recordings.
    """
    draft = Draft(project=search.project_kind(folder))
    files = search.find_media(folder)
    if not any(medium.kind in ("recording", "masks") for medium in files):
        remedy = "put a video or a folder of images of each camera there"
        raise InputError(folder, "holds no video and no folder of images", remedy)
    # The calibration names the cameras, and each camera's name is looked for in the media's.
    rig_file = search.find_calibration(folder)
    rig, units = search.read_with_unit(rig_file, _sizes(files, rig_file)) if rig_file else (None, "m")
    names = rig.names if rig else search.names_without_calibration(files)
    video = _one_take(folder, files, names)
    kinds: tuple[Kind, ...] = ("masks", "background", "clean_plate")
    media = _Media(video, *(next(iter(search.takes(files, kind, names).values()), {}) for kind in kinds))
    draft.cameras = tuple(name for name in names if name in media.frames)
    if not draft.cameras:
        problem = f"no video or folder is named after a camera ({', '.join(names) or 'no camera is known'})"
        remedy = "name each video after its camera, or write scene.toml by hand as docs/scene.md says"
        raise InputError(folder, problem, remedy)
    if left_out := [name for name in names if name not in draft.cameras]:
        draft.missing.append(f"videos of {', '.join(left_out)}, which the calibration has: the scene leaves them out")
    _note_first_images(draft, media)
    # The file, a block for each table.
    of = f", a project of {draft.project}" if draft.project else ""
    head = f"# {visible(folder.resolve().name)}{of}. Drafted by mmocap init: read it, and correct what is wrong."
    blocks = [
        [head, "# Paths count from this file's folder. docs/scene.md explains every key."],
        _about(draft, rig, media),
        _calibration(draft, rig_file, units, folder),
        *(_camera(draft, name, folder, rig, media) for name in draft.cameras),
        _foreground(draft, media),
    ]
    draft.text = "\n\n".join("\n".join(lines) for lines in blocks) + "\n"
    return draft


def _note_first_images(draft: Draft, media: _Media) -> None:
    """Say which cameras are much darker or brighter than the others in their first images, and which begin later."""
    read = media.frames | {name: open_frames(path) for name, path in media.masks.items()}  # masks are what is tracked
    folders = {name: frames.files[0].stem for name, frames in read.items() if isinstance(frames, ImageFolder)}
    begin = {name: int(end[0]) for name, stem in folders.items() if (end := re.search("[0-9]+$", stem))}
    if len({*begin.values()}) > 1:
        listed = ", ".join(f"{name} {number}" for name, number in begin.items())
        draft.found.append(f"images begin with unlike numbers ({listed}); if these are moments, give frame_offset")
    level = {name: float(image.mean()) for name, image in media.first_images.items() if name in media.video}
    usual = float(np.median([*level.values()])) if level else 0.0
    for name, own in level.items():
        if max(own, usual) > _UNLIKE_LEVELS * min(own, usual):
            than = f"{'darker' if own < usual else 'brighter'} than others (mean gray {own:.0f}, theirs {usual:.0f})"
            draft.found.append(f"{name} is {than}: look whether its masks are as good; expose all cameras alike")


def _sizes(media: list[Medium], found: CalibrationFile) -> dict[str, tuple[int, int]]:
    """Of recordings and masks, by their names, for a calibration that may not tell sizes; of all, if there is one."""
    if not found.format.open_sizes:
        return {}
    sizes: dict[str, tuple[int, int]] = {}
    for medium in media:
        if medium.kind in ("recording", "masks") and medium.parts[-1] not in sizes:
            size = open_frames(medium.path).size
            for word in (medium.parts[-1], *re.findall("[A-Za-z0-9]+", medium.parts[-1])):  # of which one is a camera's
                sizes.setdefault(word, size)
    return sizes | ({EVERY_OTHER: next(iter(sizes.values()))} if len(set(sizes.values())) == 1 else {})


def _one_take(folder: Path, files: list[Medium], names: tuple[str, ...]) -> Take:
    """The one recording, an InputError if there are several; of videos and images taken out of them, the videos."""
    candidates = search.takes(files, "recording", names)
    videos = {place: take for place, take in candidates.items() if not next(iter(take.values())).is_dir()}
    candidates = videos or candidates
    if len(candidates) < 2:
        return next(iter(candidates.values()), {})
    places = [os.path.commonpath([path.parent for path in take.values()]) for take in candidates.values()]
    remedy = f"name one recording's folder: mmocap init {places[0]}"
    if len(set(places)) < len(candidates):
        remedy = "move each recording into a folder of its own"
    raise InputError(folder, f"holds several recordings: {', '.join(candidates)}", remedy)


def _about(draft: Draft, rig: CameraRig | None, media: _Media) -> list[str]:
    lines = ["[scene]"]
    if media.fps is None:
        lines.append("# fps = 60   # MISSING: frames per second of the recording; images do not say it")
        draft.missing.append("the recording's rate: give fps under [scene]; images do not say it")
    else:
        lines.append(f"fps = {media.fps:g}")
    up, share = "+z", 0.0
    if rig is not None:  # up in the cameras' images, on average, is nearest to this axis, and so much along it
        mean = -rig.R[:, 1].mean(axis=0)
        axis = int(np.abs(mean).argmax())
        up, share = UP_AXES[2 * axis + (mean[axis] < 0)], float(abs(mean[axis]))
    why = "the vertical of the calibration's world" if rig is None else "along which the cameras stand upright"
    if rig is not None and share < _MIN_UPRIGHT:
        why = "a guess: the cameras do not stand upright along an axis"
        draft.missing.append(f'a look at the vertical: up = "{up}" is a guess, and mmocap cameras draws the axes')
    lines.append(f'up = "{up}"   # {why}')
    counts = {name: len(frames) for name, frames in media.frames.items()}
    if len(set(counts.values())) > 1 and not any(map(media.others_rate, counts)):
        found, shortest = ", ".join(f"{name} {count}" for name, count in counts.items()), min(counts.values())
        lines.append(f"frames = {shortest}   # of the shortest: {found}")
        draft.found.append(f"cameras of different lengths ({found}): their first {shortest} frames are taken")
    lines.append('# frames = "120:480:2"   # some of them: the first, the one after the last, every how many-th')
    lines.append("# offset = 0.05 under a camera says by how many seconds it lags; mmocap sync finds it")
    return lines


def _calibration(draft: Draft, found: CalibrationFile | None, units: str, folder: Path) -> list[str]:
    if found is None:
        draft.missing.append(
            "a calibration: put a Pose2Sim .toml, a Qualisys .qca.txt, EasyMocap's intri.yml and extri.yml, or another "
            "that docs/calibration.md lists there, and name it as 'calibration'; the scene's cameras must be named as "
            "in it. Or let 'mmocap calib solve' find one from a person of known height who walks about"
        )
        return ["[cameras]", '# calibration = "calibration.toml"   # MISSING']
    draft.calibration = found.path
    draft.found.append(f"calibration {found.path} ({found.format.name})")
    lines = ["[cameras]", f"calibration = {quoted_path(found.path, folder)}   # {found.format.name}"]
    if found.format.open_units:
        lines.append(f'units = "{units}"   # a guess: nothing says the unit of its lengths')
        draft.missing.append(f'the unit of the calibration\'s lengths: units = "{units}" under [cameras] is a guess')
    elif units != "m":
        lines.append(f'units = "{units}"   # in metres, its cameras would be too far apart')
    if found.others:
        lines.append(f"# also there: {', '.join(quoted_path(path, folder) for path in found.others)}")
        draft.found.append(f"other calibrations, which are not taken: {', '.join(map(str, found.others))}")
    return lines


def _camera(draft: Draft, name: str, folder: Path, rig: CameraRig | None, media: _Media) -> list[str]:
    frames = media.frames[name]
    rate = f" at {frames.fps:g} a second" if isinstance(frames, VideoFile) and frames.fps > 0 else ""
    content = "{} frames of {}x{}".format(len(frames), *frames.size) + rate
    lines = [f"[cameras.{quoted_key(name)}]   # {content}"]
    for key in ("video", "masks", "background", "clean_plate"):
        if name in (take := getattr(media, key)):
            lines.append(f"{key} = {quoted_path(take[name], folder)}")
    if turned := getattr(frames, "turned", 0):
        draft.found.append(f"{frames.path} says that its images are turned by {turned} degrees, and so they are read")
    if own_rate := media.others_rate(name):
        lines.append(f"# fps = {own_rate:g}   # its own rate: without the first #, its frames are taken by time")
        draft.missing.append(
            f"the rate of {name}: its video has {own_rate:g} frames a second, others {media.fps:g}; give fps = "
            f"{own_rate:g} under [cameras.{name}] to take its frames by time"
        )
    if rig is not None:
        lines += _placement(draft, name, frames, rig.size[rig.names.index(name)], media.first_images[name])
    return lines


def _placement(draft: Draft, name: str, frames: Frames, calibrated: np.ndarray, image: np.ndarray) -> list[str]:
    """How the calibrated image lies in a recorded one of another size, as far as the recorded ``image`` tells."""
    recorded, turned = np.array(frames.size), getattr(frames, "turned", 0)
    if (recorded == calibrated).all():
        return []
    if turned and (recorded[::-1] == calibrated).all():
        step = f"ffmpeg -display_rotation 0 -i {frames.path.name} -c copy NEW{frames.path.suffix}"
        draft.missing.append(f"{frames.path} without its rotation, of which the calibration knows nothing: {step}")
        return ["# MISSING: turned as the file says; the calibration is of images that are not."]
    sizes = "{}x{}, the calibration {}x{}".format(*recorded, *calibrated)
    scale = float((recorded / calibrated).min())
    bars = (recorded - scale * calibrated) / 2
    left, top = (0.5 * scale - 0.5 + bars).round(3).tolist()  # pixel centres are whole numbers
    placed = f"video_from_calibrated = {{ scale = {scale:.6g}, offset = [{left:g}, {top:g}] }}"
    if bars.max() < 0.5:
        draft.found.append(f"{frames.path} is {sizes}, of one shape: taken to be the whole image, scaled")
        return [f"# {sizes}: taken to be scaled.", placed]
    if _has_bars(image, bars):
        draft.found.append(f"{frames.path} is {sizes}: taken to be the whole image, scaled, with black bars")
        return [f"# {sizes}: scaled, between black bars.", placed]
    draft.missing.append(
        f"where the calibrated image lies in {frames.path}, which is {sizes}: give video_from_calibrated under "
        f"[cameras.{name}], or calibrate this size"
    )
    return [f"# MISSING: {sizes}. If it was scaled and then cut or padded alike on both sides:", f"# {placed}"]


def _has_bars(image: np.ndarray, bars: np.ndarray) -> bool:
    """Whether an image has dark bars where a scaled one would leave them, and nowhere further in."""
    gray = image.mean(axis=2)
    rows = gray if bars[1] > bars[0] else gray.T
    width = int(bars.max())
    if width < 2:
        return False
    level = rows.mean(axis=1)
    outside = np.concatenate([level[: width - 1], level[len(level) - width + 1 :]])
    inside = np.minimum(level[width + 1], level[len(level) - width - 2])
    return bool(outside.max() < _MAX_BAR_LEVEL and inside > outside.max() + _MIN_BAR_STEP)


def _foreground(draft: Draft, media: _Media) -> list[str]:
    cameras = set(draft.cameras)
    for what, of_some in (("masks", media.masks), ("clean plates", media.clean_plate)):
        if of_some and (without := [name for name in draft.cameras if name not in of_some]):
            draft.missing.append(f"{what} of {', '.join(without)}, which other cameras have: no file has their name")
    if cameras <= media.masks.keys():
        draft.found.append("masks of every camera, which are tracked as they are")
        return ["[foreground]", 'source = "masks"   # as they are; median, close, min_area and keep would clean them']
    if cameras <= media.clean_plate.keys():
        source, how = "clean_plate", "it learns the background from the pictures without the person"
    elif cameras <= media.background.keys():
        source, how = "background_video", "it learns the background from the recordings without the person"
    elif draft.calibration is not None and cameras <= media.video.keys():
        source, how = "program", "by MediaPipe, because not every camera has a picture of the background alone"
    else:
        source, how = "recording", "it learns the background from the recording, in which the person must walk about"
    draft.found.append(f"no masks of some cameras: mmocap mask makes them; {how}")
    return [
        "# Masks, the white silhouettes that are tracked, come in one of three ways:",
        '# 1. mmocap mask makes them by a program (source = "program"): MediaPipe, which knows people, or the one that',
        "#    --with names, such as rembg or SAM 2.",
        "# 2. mmocap mask subtracts a background, which is learnt from a picture without the person (clean_plate =",
        '#    "..." for each camera, source = "clean_plate"), from a video without (background, "background_video"),',
        '#    or from the whole recording (source = "recording"; the person has to walk about).',
        '# 3. You have them. Then name each camera\'s masks = "..." and set source = "masks".',
        "[foreground]",
        f'source = "{source}"',
    ]
