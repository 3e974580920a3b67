"""The shipped sequences: Walking, Gestures and Box of S1, S2 and S3, and further clips; made where they are needed.

The nine stand in for HumanEva-I's where nobody has a copy: seven cameras in its ring, 60 frames/s, each a third as
long as the paper's. ``docs/sequences.md`` says what is in all of them and how they are made.
"""

import tomllib
from collections import UserDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, Self

import numpy as np

from mmocap_warp.body.model import BodyModel, Subject
from mmocap_warp.body.rotations import zyx_angles, zyx_rotation
from mmocap_warp.body.shape_space import heading_rotation, upright_base
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.formats.motion.motion_clip import read_bvh
from mmocap_warp.masks.observation import Observation
from mmocap_warp.result.pose_errors import HEAD_TOP, head_top
from mmocap_warp.result.truth import Truth
from mmocap_warp.synthesis.footage.made_recording import Recording, placed_camera
from mmocap_warp.synthesis.footage.segmentation import Contrast, SegmentedMasks
from mmocap_warp.synthesis.footage.together import garment_masks
from mmocap_warp.synthesis.garment import GARMENTS, worn_vertices
from mmocap_warp.synthesis.motion.retarget import retargeted
from mmocap_warp.synthesis.motion.stored_poses import stored_poses
from mmocap_warp.synthesis.walkers import PEOPLE, STRANGERS, Person, fitted_start

FPS = 60.0
MARKER_NOISE = 0.002
"""Standard deviation of the true markers along each axis [m]."""

_SIZE = (640, 480)
_DIGITS = 12  # of rotations; poses and truth have fewer: machines whose sines differ in the last digit agree on them

_DATA: dict[str, dict[str, list]] = tomllib.loads(files(__package__).joinpath("sequences.toml").read_text("utf-8"))
_CAMERAS: dict[str, Any] = _DATA["cameras"]
_COLOUR = Contrast(halo=0.3, flicker=0.3, ragged=0.6, holes=1.2, specks=1.0, shadow=0.15, dropouts=0.5)
_GREY = Contrast(halo=0.6, flicker=0.5, ragged=0.9, holes=2.5, specks=2.0, shadow=0.45, dropouts=1.5)
_LIGHT = np.array([0.45, -0.3, -1.0])  # where the lamps shine to
_PEOPLE: dict[str, Person] = {**PEOPLE, **STRANGERS}
_WORSE = {"S1": 1.0, "S2": 0.8, "S3": 1.3}  # how much worse than these a subject's clothes make it


@dataclass(frozen=True)
class StudySequence:
    """A recording with known truth whose masks are made as they are asked for."""

    name: str  # such as ``S1/Walking``
    fps: float  # frames per second
    subject: Subject  # the tracker's body, where a fit of the first frame might have left it
    truth: Truth  # markers on the true body's skin with 2 mm of noise, joints, and the true body's poses
    recording: Recording  # the true body before the cameras

    @property
    def rig(self) -> CameraRig:
        """Seven pinholes."""
        return self.recording.rig

    @property
    def frame_count(self) -> int:
        """Frames run from 0 to one less."""
        return len(self.recording)

    def observation(self, frame: int, labelled: bool = False) -> Observation:
        """The masks of a frame, the same in whatever order frames are asked for; ``labelled``: garments hide skin."""
        if not labelled or self.recording.worn is None:
            return self.recording.observation(frame)
        masks = self.recording.masks(frame)
        worn = garment_masks(self.recording, frame, masks)
        return Observation.from_masks([mask & ~over for mask, over in zip(masks, worn, strict=True)], None, worn)

    def first(self, count: int | None) -> Self:
        """The sequence cut after ``count`` frames at most, which stay as they are; all of it for None."""
        count = min(count or self.frame_count, self.frame_count)
        return replace(self, truth=self.truth.at_frames(slice(count)), recording=self.recording.first(count))


Motion = Callable[[BodyModel, int, int], np.ndarray]
"""Pose vectors (frame, 51) in body axes about the origin of the floor, of a body, a number of frames and a seed."""


@dataclass(frozen=True)
class SequencePlan:
    """How a sequence is made."""

    person: str  # who moves: a key of ``PEOPLE`` or ``STRANGERS``
    frames: int  # of the whole sequence
    motion: Motion  # what the person does
    heading: float  # of the motion's axes in the world [rad]
    seed: int  # of everything that is random in the sequence
    cameras: tuple[str, ...] = tuple(_CAMERAS)  # of the ring, those that record it


def stored_motion(name: str) -> Motion:
    """The beginning of a motion that was made for a sequence's person and ships as data; the seed has no part in it."""
    return lambda body, frames, seed: stored_poses(name)[:frames]


def _stored_plans(kind: str) -> dict[str, SequencePlan]:
    return {
        name: SequencePlan(name.split("/")[0], frames, stored_motion(name), heading, seed, *map(tuple, cameras))
        for name, (frames, heading, seed, *cameras) in _DATA[kind].items()
    }


PLANS = _stored_plans("plans")
"""The nine by name."""

FURTHER_PLANS = _stored_plans("further_plans")
"""Clips beyond the nine, in no table of the study: people who turn fast, and people unlike the tracker's bodies."""

CLIP_PLANS: dict[str, SequencePlan] = {**PLANS, **FURTHER_PLANS}
"""Of all that is made by name."""


def make_sequence(name: str, plan: SequencePlan, person: Person | None = None) -> StudySequence:
    """Write the motion and put the moving body, the plan's person or another, before the study's cameras."""
    person = person or _PEOPLE[plan.person]
    body = person.true_body()
    base, poses = _facing_ahead(plan.motion(body, plan.frames, plan.seed), plan.heading)
    worse = _WORSE.get(plan.person, 1.0)
    contrast = tuple((_COLOUR if camera.startswith("C") else _GREY).worse(worse) for camera in plan.cameras)
    masks = SegmentedMasks(body, contrast, _LIGHT, plan.seed)
    worn = worn_vertices(body, GARMENTS[person.garment]) if person.garment else None
    recording = Recording(body, base, poses, FPS, study_rig().select(plan.cameras), masks, person.posed_by, worn)
    start = fitted_start(person, base, poses[0], plan.seed)
    exact = recording.truth({HEAD_TOP: head_top(recording.body)})
    noise = MARKER_NOISE * np.random.default_rng([plan.seed, 2]).standard_normal(exact.markers.shape)
    truth = replace(exact, markers=np.round(exact.markers + noise, 7), joints=np.round(exact.joints, 7))
    return StudySequence(name, FPS, start, truth, recording)


def clip_sequence(name: str, clip: str | Path) -> StudySequence:
    """The sequence whose person and cameras are taken, with the person moving as a ``.bvh`` does, as long as that.

    Raises:
        InputError: a file that is missing or wrong, or a skeleton that is not understood.
    """
    plan = PLANS[name]
    poses = retargeted(read_bvh(clip), _PEOPLE[plan.person].true_body(), FPS, clip)
    return make_sequence(name, replace(plan, frames=len(poses), motion=lambda *_: poses))


class MadeSequences(UserDict[str, Any]):
    """Sequences by name, each made from its plan when it is first asked for."""

    def __init__(self, plans: dict[str, SequencePlan]) -> None:
        self.data = plans

    def __getitem__(self, name: str) -> StudySequence:
        return _made(name, self.data[name])


_made = cache(make_sequence)

SEQUENCES: Mapping[str, StudySequence] = MadeSequences(PLANS)
"""The nine sequences by name."""

CLIPS: Mapping[str, StudySequence] = MadeSequences(CLIP_PLANS)
"""All clips by name."""


def study_rig() -> CameraRig:
    """HumanEva's ring: three colour and four grey cameras around the origin, as pinholes. The world has +Z up."""
    placed = [placed_camera(*(*place, _SIZE)) for place in _CAMERAS.values()]
    K, R, t = (np.array(each).round(_DIGITS) for each in zip(*placed, strict=True))
    return CameraRig(tuple(_CAMERAS), K, R, t, np.tile(_SIZE, (len(_CAMERAS), 1)), np.zeros((len(_CAMERAS), 5)), "+z")


def _facing_ahead(poses: np.ndarray, heading: float) -> tuple[np.ndarray, np.ndarray]:
    """The base (3, 3) in which the body faces ahead in frame 0, and the poses (frame, 51) from it.

    The given poses are in body axes about the origin of the floor, which have this heading in the world [rad].
    """
    turned = zyx_rotation(poses[:, 3:6])
    floor = upright_base("+z") @ heading_rotation(heading)  # the world from the axes that motions are written in
    base = np.round(floor @ heading_rotation(float(np.arctan2(turned[0, 0, 2], turned[0, 2, 2]))), _DIGITS)
    moved = poses.copy()
    moved[:, :3], moved[:, 3:6] = poses[:, :3] @ floor.T, zyx_angles(base.T @ floor @ turned)
    return base, np.round(moved, 9)
