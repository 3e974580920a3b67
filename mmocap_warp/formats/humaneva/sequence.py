"""HumanEva-I, from a user's own copy: a sequence's cameras, videos, synchronisation and ground truth.

See docs/sequences.md for what is read, and for what had to be assumed.
"""

import tomllib
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path

import numpy as np

from mmocap_warp.cameras.rig import CameraRig, rig_of
from mmocap_warp.errors import InputError, input_errors
from mmocap_warp.formats.datasets.dataset_scene import CameraFiles, DatasetScene
from mmocap_warp.formats.humaneva import humaneva_files, vicon_points
from mmocap_warp.formats.motion.captured_points import read_c3d
from mmocap_warp.masks.frames import Frames, as_colour, open_frames
from mmocap_warp.result.truth import Truth

CAMERAS: tuple[str, ...] = ("C1", "C2", "C3", "BW1", "BW2", "BW3", "BW4")
"""HumanEva's cameras, three of colour and four gray, in the order that its synchronisation counts from."""

FPS = 60.0
FIRST_FRAME = 6
"""The first frame that HumanEva's own lists use: the videos' codec spoils the ones before."""

_TRIAL = 1  # the only one that has both video and public motion capture
_CLIPS = (1, 2, 3)

_PUBLISHED = tomllib.loads(files(__package__).joinpath("sequence.toml").read_text(encoding="utf-8"))
SEQUENCES: dict[tuple[str, str], tuple[int, list[int]]] = {
    (subject, action): (about["last"], about["starts"])
    for subject, actions in _PUBLISHED.items()
    for action, about in actions.items()
}
"""By subject and action the last frame, and where videos C1 to C3 start, in HumanEva's own numbers."""


def read_humaneva(root: Path, subject: str, action: str, first: str = "", last: str = "") -> DatasetScene:
    """Read trial 1 of one of the ``SEQUENCES``, from the folder that holds ``S1``, ``S2``, ``S3`` and ``Background``.

    Frames ``first`` to ``last`` are in HumanEva's own numbers, both included; its own list's where omitted. Raises an
    InputError for an unknown sequence or range, or what is missing or wrong in the data.
    """
    name = f"{subject} {action}"
    if (subject, action) not in SEQUENCES:
        subjects, actions = (", ".join(dict.fromkeys(names)) for names in zip(*SEQUENCES, strict=True))
        problem = "is no sequence with both video and public motion capture"
        raise InputError(name, problem, f"give one of {subjects} and one of {actions}")
    for number in (first, last):
        if number and not number.isdecimal():
            raise InputError(name, f"{number!r} is not the number of a frame", "give whole numbers")
    listed, published = SEQUENCES[subject, action]
    begin, end = int(first or FIRST_FRAME), int(last or listed)
    if not 1 <= begin <= end:
        raise InputError(name, f"frames {begin} to {end} are not a range", "count from 1, first to last")
    trial = f"{action}_{_TRIAL}"
    data = _find_entry(root, subject, f"name the folder that holds {subject} and Background")
    videos = [_open_video(_find_entry(data, "Image_Data"), f"{trial}_({camera})") for camera in CAMERAS]
    rig = _read_rig(_find_entry(data, "Calibration_Data"), videos)
    sync_data = _find_entry(data, "Sync_Data")
    offsets = [humaneva_files.read_ofs(_find_entry(sync_data, f"{trial}_({camera}).ofs")) for camera in CAMERAS]
    sync = humaneva_files.synchronise(offsets)
    _check_range(videos, sync, end)
    truth, no_joints = _read_truth(_find_entry(data, "Mocap_Data"), subject, trial, sync, np.arange(begin, end + 1))
    empty_room = _find_entry(root, "Background")
    cameras = [
        CameraFiles(video.path, background=_find_background(empty_room, camera, video).path, frame_offset=offset)
        for camera, video, offset in zip(CAMERAS, videos, (sync.start + begin - 2).tolist(), strict=True)
    ]
    # What is odd in the data but may be so.
    notes, starts = [], sync.start[: len(published)]
    if (np.abs(starts - published) > 1).any():
        notes.append(
            f"videos C1, C2, C3 start at their frames {', '.join(map(str, starts))}, others who use the data found "
            "other ones; has its Critical_Update_OFS_files been applied?"
        )
    if no_joints:
        notes.append(f"the truth has markers but no joints: {no_joints}")
    about = (
        f"HumanEva-I, {name}, trial 1, written by mmocap dataset.",
        f"Frame 0 is frame {begin} of HumanEva's own numbers.",
    )
    return DatasetScene(about, name, rig, FPS, end - begin + 1, tuple(cameras), truth, tuple(notes), _FOREGROUND)


def _entries(folder: Path) -> dict[str, Path]:
    """What a folder holds, by name in lower case: copies of the data set differ in it."""
    if not folder.is_dir():
        raise InputError(folder, "no such folder", "check the path of the data set")
    return {entry.name.lower(): entry for entry in folder.iterdir()}


def _find_entry(folder: Path, name: str, remedy: str = humaneva_files.REMEDY) -> Path:
    entry = _entries(folder).get(name.lower())
    if entry is None:
        raise InputError(folder, f"holds no {name}", remedy)
    return entry


def _images(folder: Path, name: str) -> Path | None:
    """A video, or the folder of images that it was unpacked into, which goes first, as in HumanEva's software."""
    entries = _entries(folder)
    return entries.get(name.lower()) or entries.get(f"{name}.avi".lower())


def _open_video(folder: Path, name: str) -> Frames:
    path = _images(folder, name)
    if path is None:
        raise InputError(folder, f"holds no {name}.avi and no folder {name}", humaneva_files.REMEDY)
    return open_frames(path)


def _read_rig(folder: Path, videos: Sequence[Frames]) -> CameraRig:
    pairs = zip(CAMERAS, videos, strict=True)
    cameras = [humaneva_files.read_cal(_find_entry(folder, f"{name}.cal"), name, video.size) for name, video in pairs]
    try:
        return rig_of(cameras, "+z", folder)
    except InputError as error:  # whose remedy is for calibrations that the user made
        raise InputError(error.source, error.problem, humaneva_files.REMEDY) from None


def _check_range(videos: Sequence[Frames], sync: humaneva_files.Synchronisation, last: int) -> None:
    ends = [len(video) - int(start) + 1 for video, start in zip(videos, sync.start, strict=True)]
    for video, end in zip(videos, ends, strict=True):
        if end < last:
            problem = f"has {len(video)} frames, so it ends with the sequence's frame {end}, not {last}"
            remedy = f"copy it again, or give {min(ends)} as LAST" if min(ends) > 0 else "copy it and its .ofs again"
            raise InputError(video.path, problem, remedy)


def _read_truth(
    folder: Path, subject: str, trial: str, sync: humaneva_files.Synchronisation, frames: np.ndarray
) -> tuple[Truth, str]:
    """The truth, and why it has no joints."""
    path = _find_entry(folder, f"{trial}.c3d")
    tracks = read_c3d(path)
    if not 0.9 < sync.mocap_per_frame / (tracks.rate / FPS) < 1.1:
        ratio = f"the .ofs say that {sync.mocap_per_frame:.4g} of its frames pass in one"
        raise InputError(path, f"runs at {tracks.rate:g} Hz, but {ratio}", "take .c3d and .ofs of the same sequence")
    position = sync.mocap_position(frames) - 1  # HumanEva counts from 1, arrays from 0
    remedy = "give the data set's own .c3d: Vicon's 39 markers are needed"
    with input_errors(path, "{error}", remedy, vicon_points.MissingPointError):
        markers = vicon_points.markers_at(tracks, position)
    valid = np.isfinite(markers).all(axis=(1, 2))
    if not valid.any():
        problem = f"shows all {len(vicon_points.MARKERS)} markers in none of the frames {frames[0]} to {frames[-1]}"
        raise InputError(path, problem, "choose other frames, or check that .c3d and .ofs belong together")
    names, joints, why = vicon_points.JOINT_NAMES, np.zeros((len(frames), 0, 3)), ""
    try:
        joints = vicon_points.joint_positions(tracks, position, *_read_measures(folder, subject))
    except vicon_points.MissingPointError as error:
        names, why = (), f"{path.name} {error}"
    joints = np.where(valid[:, None, None], joints, np.nan)
    return Truth(FPS, frames - frames[0], vicon_points.MARKERS, markers, names, joints), why


def _read_measures(folder: Path, subject: str) -> tuple[float, list[float]]:
    """The radius of the torso, and the offsets of both shoulders [m]."""
    path, static = _find_entry(folder, f"{subject}.mp"), _find_entry(folder, "Static.c3d")
    measures = humaneva_files.read_measures(path)
    offsets = [f"{side}ShoulderOffset" for side in "LR"]
    for name in offsets:
        if name not in measures:
            raise InputError(path, f"has no line ${name} = ...", humaneva_files.REMEDY)
    with input_errors(static, "{error}", humaneva_files.REMEDY, vicon_points.MissingPointError):
        radius = vicon_points.torso_radius(read_c3d(static))
    if not np.isfinite(radius):
        raise InputError(static, "never shows LSHO and RSHO together", humaneva_files.REMEDY)
    return radius, [measures[name] / 1000 for name in offsets]


def _find_background(folder: Path, camera: str, video: Frames) -> Frames:
    names = [f"Background_{clip}_({camera})" for clip in _CLIPS]
    clips = [open_frames(path) for name in names if (path := _images(folder, name)) is not None]
    if not clips:
        raise InputError(folder, f"holds none of {', '.join(names)} (.avi)", humaneva_files.REMEDY)
    for clip in clips:
        if clip.size != video.size:
            actual, wanted = ("{}x{}".format(*frames.size) for frames in (clip, video))
            raise InputError(clip.path, f"is {actual}, the camera's video is {wanted}", humaneva_files.REMEDY)
    return clips[nearest_background(video, clips)]


_SAMPLES = 15
_OUTLIER = 16.0  # gray levels; where the subject is, images differ more, and by how much says nothing


def nearest_background(recording: Frames, clips: Sequence[Frames]) -> int:
    """The clip whose room looks most like the recording's start.

    HumanEva filmed the empty room at three times of a week. Light and things in the room changed meanwhile, so the
    clip nearest in time fits best, and the whole image says which that is. Clips have the recording's size.
    """
    samples = (map(as_colour, frames.sample(_SAMPLES)) for frames in (recording, *clips))
    room, *rooms = (np.median(list(images), axis=0) for images in samples)
    return int(np.argmin([np.minimum(np.abs(clip - room), _OUTLIER).mean() for clip in rooms]))


_FOREGROUND = """
# Lengths suit a subject of 300 pixels. Gray images have no colour to tell a shadow by, so shadows stay.
[foreground]
source = "background_video"
model = "gaussian"
shadow_brightness = 1.0
median = 3.0
close = 5.0
fill_holes = 60.0
min_area = 120.0
keep = "largest"
join = 20.0
"""
