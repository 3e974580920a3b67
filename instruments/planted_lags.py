"""Whether lags of cameras are found again that were planted in recordings whose cameras are in step.

``python instruments/planted_lags.py FOLDER [CLIP ...]`` writes the clips to FOLDER as scenes, where they are not
there yet, and plants lags in each of them three times. A clip is one of those made by name, or a ``scene.toml`` with
mask images. Without any named, it is those that no threshold of ``mmocap sync`` was chosen on. It takes about 25
seconds of one core a clip.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mmocap_warp.calibration.sync.synchronise import Synchronisation, synchronise
from mmocap_warp.masks.mask_files import MaskImages
from mmocap_warp.scene.camera_source import CameraSource
from mmocap_warp.scene.recording import Scene
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.study.degradations import write_sequence
from mmocap_warp.study.sequences import CLIP_PLANS, CLIPS

CHOSEN_ON = ("S1/Walking", "S1/Box", "S1/Spin", "S2/Gestures", "S2/Spin", "S3/Gestures")
"""Clips that were looked at when thresholds were chosen, beside ``scenes/walk`` and ``scenes/balancing``."""

_TRIALS = 3
_FRAMES = 160
_MOST = 10  # [frames] of a planted lag
_IN_STEP = 0.5  # of the cameras


@dataclass(frozen=True)
class Way:
    """How lags are looked for.

    Attributes:
        name: for people.
        calibrated: whether the calibration is used.
        within: by how much one camera may lag another [s].
        exact: by how many frames an offset may be off.
    """

    name: str
    calibrated: bool
    within: float
    exact: int


WAYS = (Way("motion", False, 1.0, 2), Way("motion, within 0.25 s", False, 0.25, 2), Way("calibrated", True, 1.0, 1))


@dataclass(frozen=True, eq=False)
class Trial:
    """What became of planted lags.

    Attributes:
        off: (camera,) by how many frames each offset is off.
        sure: whether they were said to be sure.
    """

    off: np.ndarray
    sure: bool

    @property
    def worst(self) -> int:
        """The largest error [frames]."""
        return int(np.abs(self.off).max())


def plant(scene: Scene, lags: np.ndarray, first: int, count: int) -> Scene:
    """Some frames of a scene as cameras would record them that lag.

    Args:
        scene: cameras in step, with masks in images.
        lags: (camera,) [frames].
        first: the frame that a camera without a lag begins with.
        count: how many frames each camera has.

    Raises:
        ValueError: frames that a camera does not have, or masks that are no images.
    """
    cameras = tuple(_lagging(source, int(lag), first, count) for source, lag in zip(scene.cameras, lags, strict=True))
    return replace(scene, cameras=cameras, first_frame=0, frame_count=count)


def _lagging(source: CameraSource, lag: int, first: int, count: int) -> CameraSource:
    if not isinstance(source.masks, MaskImages):
        raise ValueError(f"camera '{source.name}' has no mask images")
    members = source.masks.members[max(0, first - lag) : first - lag + count]
    if len(members) != count:
        wanted = f"{first - lag} to {first - lag + count - 1}"
        raise ValueError(f"camera '{source.name}' has {len(source.masks)} frames, not {wanted}")
    return replace(source, masks=replace(source.masks, members=members), frame_offset=0, fraction=0.0)


def trial(scene: Scene, seed: int, way: Way) -> Trial:
    """Plant lags and look for them.

    Args:
        scene: cameras in step, with masks in images.
        seed: of the lags, and of the frames that are looked at.
        way: how.
    """
    random = np.random.default_rng(seed)
    cameras, frames = len(scene.cameras), scene.recorded_frames
    lags = np.where(random.random(cameras) < _IN_STEP, 0, random.integers(1, _MOST + 1, cameras))
    count = min(_FRAMES, frames - _MOST)
    planted = plant(scene, lags, int(random.integers(_MOST, frames - count + 1)), count)
    found = synchronise(planted if way.calibrated else replace(planted, calibration=None), within=way.within)
    return Trial(errors(found, lags), found.sure)


def errors(found: Synchronisation, lags: np.ndarray) -> np.ndarray:
    """(camera,) by how many frames offsets are off; an offset that all have in common means nothing."""
    off = np.array([view.frames for view in found.views.values()]) - lags
    values, counts = np.unique(off, return_counts=True)
    common: np.ndarray = off - values[counts.argmax()]
    return common


def row(name: str, scene: Scene, trials: Sequence[tuple[Way, list[Trial]]]) -> str:
    """A line of the table."""
    cells = [name, str(len(scene.cameras))]
    for way, each in trials:
        right = [one for one in each if one.sure and one.worst <= way.exact]
        wrong = [one for one in each if one.sure and one.worst > way.exact]
        unsure = [one for one in each if not one.sure]
        nearly = sum(one.worst <= way.exact for one in unsure)
        cell = f"{len(right)} found" + (f" (worst {max(one.worst for one in right)})" if right else "")
        cell += f", {len(unsure)} not sure ({nearly} right)" if unsure else ""
        cells.append(cell + (f", **{len(wrong)} wrong** ({max(one.worst for one in wrong)})" if wrong else ""))
    return f"| {' | '.join(cells)} |"


def _scenes(folder: Path, clips: Sequence[str]) -> Iterator[tuple[str, Scene]]:
    for clip in clips:
        file = Path(clip)
        if clip in CLIP_PLANS:
            file = folder / clip / "scene.toml"
            file = file if file.exists() else write_sequence(file.parent, CLIPS[clip])
        yield clip, load_scene(file)


def _main(folder: Path, clips: Sequence[str]) -> None:
    head = ["clip", "cameras", *(way.name for way in WAYS)]
    print(f"| {' | '.join(head)} |\n{'|---' * len(head)}|")
    for clip, scene in _scenes(folder, clips):
        trials = [(way, [trial(scene, seed, way) for seed in range(_TRIALS)]) for way in WAYS]
        print(row(clip, scene, trials), flush=True)


if __name__ == "__main__":
    if len(sys.argv) < 2:
        raise SystemExit("usage: python instruments/planted_lags.py FOLDER [CLIP ...]")
    _main(Path(sys.argv[1]), sys.argv[2:] or [clip for clip in CLIP_PLANS if clip not in CHOSEN_ON])
