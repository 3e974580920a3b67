"""A recording as its ``scene.toml`` describes it: calibrated cameras, where their images lie, what is foreground."""

import json
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing
from dataclasses import dataclass, field, replace
from functools import reduce
from pathlib import Path
from typing import Any, Literal, Protocol, Self
from urllib.parse import quote

import cv2
import numpy as np

from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.cameras.undistort import Undistortion, undistortion
from mmocap_warp.device.cores import available_threads
from mmocap_warp.errors import InputError
from mmocap_warp.formats.attachments import Attachment
from mmocap_warp.formats.toml_table import Table
from mmocap_warp.masks.cleanup import keep_mended, mend_mask
from mmocap_warp.masks.frames import as_colour
from mmocap_warp.masks.mask_image import decode_mask
from mmocap_warp.masks.mask_settings import SUBTRACTION, ForegroundSettings
from mmocap_warp.masks.observation import Observation
from mmocap_warp.masks.subtraction import learn_background
from mmocap_warp.masks.visual_hull import repair_masks
from mmocap_warp.scene.camera_source import CameraSource, recorded_frames, split_offset
from mmocap_warp.scene.frame_choice import frames_by_number, read_ahead, read_together
from mmocap_warp.scene.kept_masks import MaskMark, calibration_hash, store_masks, stored_masks
from mmocap_warp.version import __version__
from mmocap_warp.whole_file import content_hash

# Says where the body was last, of each camera that is asked for: (height, width) bool.
BodyMasks = Callable[[], "ViewMasks"]


class ViewMasks(Protocol):
    """Masks by the number of their camera."""

    def __getitem__(self, k: int, /) -> np.ndarray: ...


@dataclass(frozen=True)
class Person:
    """One of several people in a scene."""

    labels: tuple[int, ...]  # in each camera's masks, in the rig's order
    subject: Path | None = None  # a fitted subject, or None
    body: str | Path | None = None  # a body file, or the name of a shipped body, or None for the scene's
    truth: Path | None = None  # reference joints or a result to compare with, or None


@dataclass(frozen=True)
class Scene:
    """A recording, or the part of it that is to be tracked. A camera whose shifted frame does not exist is lost there.

    Methods that take ``first`` and ``count`` count frames of that part; :attr:`frames` has the recording's numbers.
    """

    path: Path  #: the scene file
    name: str  #: for people
    fps: float  #: frames per second of the recording
    frame_count: int  #: number of frames that are to be tracked, the same for all cameras
    calibrated: CameraRig  #: the rig as calibrated (refined centres applied), with distortion, at full size
    cameras: tuple[CameraSource, ...]  #: in the rig's order
    foreground: ForegroundSettings  #: how masks are made
    subject: Path | None = None  #: a fitted subject, or None
    body: str | Path | None = None  #: a body file, or the name of a shipped body, or None
    truth: Path | None = None  #: reference joints or a result to compare with, or None
    truth_axes: str = "xyz"  #: which axes of the truth file are the world's x, y, z, such as ``zxy``
    truth_first_frame: int = 0  #: number of the first row of a ``.trc``, counted at its rate from the recording's start
    track: dict[str, Any] = field(default_factory=dict)  #: settings of the tracker, as written
    fit: dict[str, Any] = field(default_factory=dict)  #: settings of the first-frame fit, as written
    first_frame: int = 0  #: the recording's number of the first of the frames
    stride: int = 1  #: every how many-th of the recording's frames is one of them
    calibration: Path | None = None  #: its file or folder; None where there is none, and ``calibrated`` says nothing
    units: str | None = None  #: of the calibration's lengths, as the scene says; None where it does not
    #: the frames that the scene file names, whose subtracted masks are kept; None for ``frames``
    named_frames: range | None = None
    attached: tuple[Attachment, ...] = ()  #: what the body carries
    #: who is labelled in the masks, by name; empty where the scene has no such table
    people: dict[str, Person] = field(default_factory=dict)
    person: str = ""  #: the name of the one of them who is tracked; empty where none is chosen
    told_apart: bool = False  #: whether poses told these people apart

    def __repr__(self) -> str:
        names = ", ".join(self.calibrated.names)
        last = self.frames[-1] if self.frame_count else self.first_frame
        frames = f"{self.frame_count} frames, {self.first_frame} to {last}, at {self.rate:g} a second"
        return f"Scene {self.name}: {frames}; cameras {names}; foreground from {self.foreground.source}; {self.path}"

    @property
    def directory(self) -> Path:
        """The folder of the scene file."""
        return self.path.parent

    @property
    def frames(self) -> range:
        """The recording's numbers of the frames that are to be tracked."""
        return range(self.first_frame, self.first_frame + self.frame_count * self.stride, self.stride)

    @property
    def rate(self) -> float:
        """How many of these there are in a second."""
        return self.fps / self.stride

    def of_frames(self, frames: range) -> Self:
        """The same recording, other frames of it."""
        count, named = len(frames), self._named_frames
        return replace(self, first_frame=frames.start, frame_count=count, stride=frames.step, named_frames=named)

    def with_cameras(self, rig: CameraRig, offsets: dict[str, float]) -> Self:
        """The same recording by other cameras of the same names and sizes, which lag by ``offsets`` [s]."""
        lags = [split_offset(offsets[source.name] * self.fps * source.rate) for source in self.cameras]
        pairs = zip(self.cameras, lags, strict=True)
        cameras = tuple(replace(source, frame_offset=whole, fraction=rest) for source, (whole, rest) in pairs)
        return replace(self, calibrated=rig, cameras=cameras)

    @property
    def labelled(self) -> bool:
        """Whether its masks say who is tracked."""
        return any(source.label for source in self.cameras)

    @property
    def has_others(self) -> bool:
        """Whether its masks say what may be in front of who is tracked."""
        return any(source.in_front for source in self.cameras)

    @property
    def of_several(self) -> bool:
        """Whether its masks do not tell its people apart."""
        return bool(self.people) and any(source.several for source in self.cameras)

    def of_person(self, name: str) -> Self:
        """The same recording as one of its people is tracked in it: all others may be in front.

        Raises:
            KeyError: there is nobody of that name.
        """
        chosen, others = self.people[name], [each for key, each in self.people.items() if key != name]
        cameras = []
        for k, source in enumerate(self.cameras):
            hides = {*source.in_front, *source.several, *(other.labels[k] for other in others)} - {chosen.labels[k]}
            cameras.append(replace(source, label=chosen.labels[k], in_front=tuple(sorted(hides))))
        own = replace(self, subject=chosen.subject, body=chosen.body or self.body, truth=chosen.truth)
        return replace(own, cameras=tuple(cameras), person=name)

    @property
    def _named_frames(self) -> range:
        return self.frames if self.named_frames is None else self.named_frames

    def as_recorded(self) -> Self:
        """Every camera's own frames by their own numbers: without offsets, rates and what views know of each other.

        If the scene means all frames, the recording goes on to the end of the longest camera.
        """
        cameras = tuple(replace(source, frame_offset=0, fraction=0.0, rate=1.0) for source in self.cameras)
        end, longest = self.frames[-1] + 1, max(recorded_frames(each, self.foreground.source) for each in cameras)
        frames = range(self.first_frame, longest if end == self.recorded_frames else end)
        foreground = replace(self.foreground, repair=False)
        return replace(self.of_frames(frames), cameras=cameras, foreground=foreground, named_frames=frames)

    @property
    def recorded_frames(self) -> int:
        """How many frames the recording has: as many as the shortest of the cameras'."""
        return min(recorded_frames(source, self.foreground.source) for source in self.cameras)

    def settings(self, name: Literal["track", "fit"]) -> Table:
        """Its [track] or [fit] table, to be read as a configuration."""
        return Table(getattr(self, name), str(self.path), name)

    def rig(self, scale: float = 1.0) -> CameraRig:
        """The undistorted pinholes of the images at ``scale``.

        Raises:
            InputError: a scale that leaves an image without pixels.
        """
        if 0 < scale * int(self.calibrated.size.min()) < 1:
            raise InputError(self.path, f"at scale {scale:g} an image has no pixel left", "choose a larger scale")
        return self.calibrated.undistorted(scale)

    def observations(
        self, scale: float = 1.0, first: int = 0, count: int | None = None, body: BodyMasks | None = None
    ) -> Iterator[Observation]:
        """Masks of frames ``first`` to ``first + count - 1`` (to the end without ``count``), one frame at a time.

        They are made as the scene says: read or subtracted, undistorted and resampled once, cleaned, repaired. With
        them come the times at which they were taken, and what may be in front of the person.

        Args:
            scale: of the images relative to the calibrated ones.
            first: frame to start with.
            count: number of frames.
            body: for ``keep = "nearest"``: called before each of these frames, returns per camera (height, width) bool
                where the body was tracked last. Without it, what was kept in the frame before stands for the body.

        Raises:
            ValueError: frames that the scene does not have.
            InputError: images that turn out unreadable.
        """
        hides = self.has_others
        for place, (views, in_front) in enumerate(self._seen(scale, first, count, body, hides), first):
            frame = self.frames[place : place + 1]
            late = np.array([source.late(frame)[0] for source in self.cameras]) / self.fps  # (camera,) [s]
            yield Observation.from_masks(views, late if late.any() else None, in_front if hides else None)

    def hidden(self, scale: float) -> Iterator[list[np.ndarray]]:
        """Per camera (height, width) bool, what may be in front of the person, of all frames."""
        return (in_front for _, in_front in self._seen(scale, 0, None, None, hides=True))

    def masks(
        self, scale: float = 1.0, first: int = 0, count: int | None = None, body: BodyMasks | None = None
    ) -> Iterator[list[np.ndarray]]:
        """As :meth:`observations`, unpacked: per camera (height, width) bool."""
        return (masks for masks, _ in self._seen(scale, first, count, body))

    def _seen(
        self, scale: float, first: int, count: int | None, body: BodyMasks | None, hides: bool = False
    ) -> Iterator[tuple[list[np.ndarray], list[np.ndarray]]]:
        """Each frame's masks, and where that is asked what ``hides`` the person; an image is read once for both."""
        wanted, rig = self._numbers(first, count), self.rig(scale)
        # A frame has the same mask wherever reading starts, so what is remembered is gathered from the first frame on.
        follows_masks = self.foreground.keep == "nearest" and body is None
        followed = self.frames[: first + len(wanted)] if follows_masks else wanted
        read = range(wanted[-1] + 1) if wanted and self.foreground.model_remembers else followed
        empty = [np.zeros((height, width), bool) for width, height in rig.size]

        def mended(k: int) -> Iterator[tuple[np.ndarray | None, np.ndarray]]:
            in_front = self.cameras[k].in_front if hides else ()
            raw_masks = self._raw_masks(k, scale, read, (), *([in_front] if in_front else []))
            for frame, raw in zip(read, raw_masks, strict=True):
                # The background model alone remembers what is before the frames that are followed.
                mask = None if raw is None or frame not in followed else mend_mask(raw[0], self.foreground, scale)
                yield mask, raw[1] if raw and in_front else empty[k]

        def keep(mask: np.ndarray | None, nothing: np.ndarray, k: int) -> np.ndarray:
            return nothing if mask is None else keep_mended(mask, self.foreground, scale, lambda: last[k])

        kept: list[np.ndarray] = empty
        # OpenCV lets other threads run; a thread more than mask files keep busy takes Python's lock from the tracker.
        kept_busy = 1 + sum(mask.size for mask in empty) // 1_000_000
        count = min(kept_busy if self.foreground.source == "masks" else len(empty), len(empty), available_threads())
        with ExitStack() as stack:
            pools = [stack.enter_context(ThreadPoolExecutor(count)) for _ in range(2)]
            keeping, reading = (pool.map if count > 1 else map for pool in pools)  # an idle pool has no thread
            streams = read_together([mended(k) for k in range(len(empty))], reading)
            ahead = stack.enter_context(closing(read_ahead(streams)))
            for frame, seen in zip(read, ahead, strict=True):
                if frame not in followed:
                    continue
                last = kept if body is None else body()
                each = map if self.foreground.keep == "all" else keeping  # then nothing is left to be done
                kept = list(each(keep, (mask for mask, _ in seen), empty, range(len(empty))))
                if frame in wanted:
                    repaired = repair_masks(rig, kept, keeping) if self.foreground.repair else kept
                    yield repaired, [in_front for _, in_front in seen]

    def _raw_masks(
        self, k: int, scale: float, frames: range, *labels: tuple[int, ...]
    ) -> Iterator[list[np.ndarray] | None]:
        """Camera ``k``'s masks, undistorted but as read or subtracted; None where it has no frame.

        Where they are given, there is one of the objects of each of ``labels``, as :meth:`mask_maker` takes them.
        """
        source = self.cameras[k]
        if self.foreground.source == "masks":
            makers = [self.mask_maker(k, scale, each) for each in labels]
            for image in frames_by_number(source.masks, map(source.mask_number, frames)):
                yield None if image is None else [make(image) for make in makers]
            return
        if self.foreground.source == "program":
            raise InputError(self.path, "its masks are not made yet", "make them with mmocap mask, and track these")
        for mask in self._subtracted_once(k, scale, frames):
            yield None if mask is None else [mask]

    def mask_maker(self, k: int, scale: float = 1.0, labels: tuple[int, ...] = ()) -> Callable[[Any], np.ndarray]:
        """What makes masks of camera ``k``'s images: (height, width) bool, undistorted but as read or subtracted.

        Given masks show the objects of ``labels``; without any, who is tracked, or everybody where nobody is chosen.

        Raises:
            InputError: a background that turns out unreadable.
        """
        source, mark, settings = self.cameras[k], self.cameras[k].mask_mark, self.foreground
        if settings.source == "masks":
            resample = self._undistortion(k, scale) if mark is None else self._resampling(k, scale, mark)
            soft = source.masks is not None and source.masks.soft
            everybody = () if self.person else tuple(person.labels[k] for person in self.people.values())
            labels = labels or everybody or (source.label or settings.identity,)
            return lambda image: resample.mask(
                reduce(np.logical_or, (decode_mask(image, each, soft) for each in labels))
            )
        to_pinhole, examples = self._undistortion(k, scale), source.background_examples(settings.source)
        images = (to_pinhole.image(as_colour(image)) for image in examples.read())
        background = learn_background(images, len(examples), settings)
        return lambda image: background.foreground(to_pinhole.image(as_colour(image)))

    def _subtracted_once(self, k: int, scale: float, frames: range) -> Iterator[np.ndarray | None]:
        """Camera ``k``'s subtracted masks, stored beside the scene once they have been made for all of its frames."""
        file = self.path.parent / ".mmocap" / self.path.stem / f"{quote(self.cameras[k].name, safe='')}@{scale:g}.tar"
        key = self._subtraction_key(k, scale)
        all_frames = self._named_frames
        same_steps = len(frames) == 1 or frames.step == all_frames.step
        if frames and same_steps and frames[0] in all_frames and frames[-1] in all_frames:
            stored = stored_masks(file, key, all_frames.index(frames[0]), len(frames))
            if stored is not None:
                return stored
        made = self._subtracted(k, scale, frames)
        return store_masks(file, key, len(frames), made) if frames == all_frames else made

    def _subtraction_key(self, k: int, scale: float) -> str:
        """All that camera ``k``'s subtracted masks are made from."""
        source, settings = self.cameras[k], self.foreground
        files = [file for files in source.files_for(settings.source) for file in files]
        placed = source.recorded_scale, source.recorded_offset
        fraction = [source.fraction] if source.rate != 1.0 and source.fraction else []
        made_from = {
            "versions": [__version__, cv2.__version__],
            "files": [content_hash(file).hex() for file in files],
            "frames": [source.frame_offset, source.rate, *fraction, str(self._named_frames)],
            "calibration": calibration_hash(self.calibrated, k, *placed, whole_rig=False),
            "scale": scale,
        }
        return json.dumps(made_from | {name: getattr(settings, name) for name in SUBTRACTION})

    def _subtracted(self, k: int, scale: float, frames: range) -> Iterator[np.ndarray | None]:
        make = self.mask_maker(k, scale)
        for image in frames_by_number(self.cameras[k].video, map(self.cameras[k].number, frames)):
            yield None if image is None else make(image)

    def images(self, scale: float = 1.0, first: int = 0, count: int | None = None) -> Iterator[list[np.ndarray | None]]:
        """Undistorted BGR images, pixel for pixel as the masks; None for a camera without video or frame."""
        streams = [self.camera_images(k, scale, first, count) for k in range(len(self.cameras))]
        yield from map(list, zip(*streams, strict=True))

    def camera_images(
        self, k: int, scale: float = 1.0, first: int = 0, count: int | None = None
    ) -> Iterator[np.ndarray | None]:
        """As :meth:`images`, of camera ``k`` alone."""
        source, to_pinhole = self.cameras[k], self._undistortion(k, scale)
        for image in frames_by_number(source.video, map(source.number, self._numbers(first, count))):
            yield None if image is None else to_pinhole.image(as_colour(image))

    def _numbers(self, first: int, count: int | None) -> range:
        """The recording's numbers of ``count`` frames from the ``first`` on."""
        count = self.frame_count - first if count is None else count
        if first < 0 or count < 0 or first + count > self.frame_count:
            raise ValueError(f"frames {first} to {first + count - 1} are not in 0 to {self.frame_count - 1}")
        return self.frames[first : first + count]

    def _undistortion(self, k: int, scale: float) -> Undistortion:
        source = self.cameras[k]
        return undistortion(self.calibrated, k, scale, source.recorded_scale, source.recorded_offset)

    def _resampling(self, k: int, scale: float, mark: MaskMark) -> Undistortion:
        """From masks that are undistorted already; those of the same scale stay as they are, to the pixel."""
        shift = 0.5 * mark.scale - 0.5  # a pixel's centre keeps its place in the image
        return undistortion(self.calibrated.undistorted(), k, scale, mark.scale, (shift, shift))
