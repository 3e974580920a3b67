"""The answer of a tracking run, and that of each of its frames."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np

from mmocap_warp.body.joint_sets import RIG
from mmocap_warp.body.joint_sets import joint_set as set_named
from mmocap_warp.body.model import Subject
from mmocap_warp.body.posing import joint_positions, skin_positions
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.result import CONFIGURED_LENGTHS

STATUS: tuple[str, ...] = ("tracked", "partial", "lost", "rescued", "interpolated", "repeated")
"""How a frame's pose was found.

Tracked: in the ordinary way, with all views. Partial: likewise, but a view was left out (its mask is empty), or a part
of the body is in doubt: then its deviations are wide.
Lost: not at all; without any mask the pose is carried over. Rescued: by a larger search or a new start. Interpolated:
filled in afterwards from the frames around it. Repeated: likewise, as its images are those of the frame before.
"""


@dataclass(frozen=True)
class FrameAnswer:
    """What a frame's search found."""

    pose: np.ndarray  # (run, coordinate) float32
    cost: np.ndarray  # (run,) float32; NaN where no view shows anything
    iou: np.ndarray  # (run, camera) float64; NaN for a lost view
    evaluations: int  # spent by each run
    status: int | np.ndarray  # index into ``STATUS``, of all runs or (run,) int
    seconds: float  # wall-clock time [s]


@dataclass(frozen=True)
class Result:
    """Poses of every frame of every run, with what is needed to evaluate and repeat them.

    Raises:
        ValueError: no frame, frame numbers that do not ascend, or arrays whose shapes disagree.
    """

    subject: Subject  #: the body that was tracked; its pose is where tracking started
    cameras: CameraRig  #: the rig, undistorted, at the scale that was tracked
    fps: float  #: frames per second of the recording
    frame_numbers: np.ndarray  #: (frame,) int, the recording's own frame numbers
    pose: np.ndarray  #: (run, frame, coordinate) float64, poses: the answer, smoothed where the track was
    cost: np.ndarray  #: (run, frame) float64, cost of the best pose; NaN where no view shows anything
    iou: np.ndarray  #: (run, frame, camera) float64, intersection over union; NaN for a lost view
    evaluations: np.ndarray  #: (run, frame) int64, evaluations spent
    status: np.ndarray  #: (run, frame) int8, index into ``STATUS``
    seconds: float  #: wall-clock time of the search, images left out [s]
    config: dict  #: all settings as JSON-compatible values; ``config["seed"]`` is the first run's seed
    versions: dict[str, str]  #: package versions and device
    raw_pose: np.ndarray | None = None  #: like ``pose``, the track before it was smoothed; None if it was not
    #: like ``pose``, standard deviation of each coordinate [m, rad], NaN where it is unknown; None if the tracker does
    #: not give it
    angle_sigma: np.ndarray | None = None
    #: (run, frame, joint, 3) float64, standard deviation of each joint's place along the world's axes [m]; likewise
    joint_sigma: np.ndarray | None = None
    #: (run, frame, camera) float64, by how far a view's masks lie beside the body as a whole [m], NaN where nothing of
    #: it is seen; None where that was not looked at
    view_shift: np.ndarray | None = None
    left_out_before: int = 0  #: how many frames of the track were before the first, where this is a part of it

    def __repr__(self) -> str:
        first, last = self.frame_numbers[[0, -1]].tolist()
        best = self.best_run
        counts = np.bincount(self.status[best], minlength=len(STATUS))
        statuses = ", ".join(f"{count} {name}" for name, count in zip(STATUS, counts, strict=True) if count)
        known = self.iou[best][np.isfinite(self.iou[best])]
        overlap = f"mean IoU {known.mean():.3f}" if len(known) else "no IoU"
        runs = f"{len(self.pose)} runs, best {best}" if len(self.pose) > 1 else "1 run"
        return (
            f"Result of {self.subject.body.name} by {self.config.get('algorithm', 'an unknown tracker')}: "
            f"{len(self.frame_numbers)} frames, {first} to {last} ({statuses}), {len(self.cameras)} cameras, {runs}, "
            f"{overlap}"
        )

    def __post_init__(self) -> None:
        runs, frames, cameras = len(self.pose), len(self.frame_numbers), len(self.cameras)
        skeleton = self.subject.body.skeleton
        poses = runs, frames, skeleton.coordinates
        if not runs or not frames or (np.diff(self.frame_numbers) <= 0).any():
            raise ValueError("a result needs a run, a frame, and frame_numbers that ascend")
        shapes: dict[str, tuple[int, ...]] = {"joint_sigma": (runs, frames, len(skeleton.joints), 3)}
        shapes |= dict.fromkeys(("pose", "raw_pose", "angle_sigma"), poses)
        shapes |= dict.fromkeys(("iou", "view_shift"), (runs, frames, cameras))
        for name, array in self.arrays.items():
            shape = shapes.get(name, (runs, frames))
            if array.shape != shape:
                raise ValueError(f"{name} must be {shape}, got {array.shape}")

    @property
    def arrays(self) -> dict[str, Any]:
        """The arrays (run, frame, ...) that there are, by name."""
        required = ("pose", "cost", "iou", "evaluations", "status")
        names = (*required, "raw_pose", "angle_sigma", "joint_sigma", "view_shift")
        return {name: array for name in names if (array := getattr(self, name)) is not None}

    @property
    def best_run(self) -> int:
        """The run with the lowest mean cost: the one that is animated."""
        return int(np.argmin(np.nanmean(self.cost, axis=1))) if np.isfinite(self.cost).any() else 0

    @property
    def rate(self) -> float:
        """The result's frames in a second: fewer than ``fps`` where frames were passed over."""
        return self.fps / self.stride

    @property
    def stride(self) -> int:
        """Between the numbers of its frames."""
        return int(np.diff(self.frame_numbers).min()) if len(self.frame_numbers) > 1 else 1

    def in_unit(self, unit: float) -> Self:
        """The result with all of its lengths in a unit [m], as trackers take it; all else is for metres."""
        if unit == 1:
            return self
        coordinates = self.subject.body.skeleton.units(unit)
        units: dict[str, Any] = dict.fromkeys(("pose", "raw_pose", "angle_sigma"), coordinates)
        units |= dict.fromkeys(("joint_sigma", "view_shift"), unit)
        arrays = {name: array / units[name] for name, array in self.arrays.items() if name in units}
        given = {name: self.config.get(name) for name in CONFIGURED_LENGTHS}
        config = self.config | {name: value / unit for name, value in given.items() if value is not None}
        subject, cameras = self.subject.in_unit(unit), self.cameras.in_unit(unit)
        return replace(self, subject=subject, cameras=cameras, config=config, **arrays)

    def at(self, positions: Sequence[int]) -> Self:
        """The result of some frames, by their positions in ``frame_numbers``, ascending, or by a mask of them."""
        chosen = _chosen(positions, len(self.frame_numbers))
        arrays = {name: array[:, chosen] for name, array in self.arrays.items()}
        before = self.left_out_before + int(chosen[0])
        numbers, seconds = self.frame_numbers[chosen], self.seconds * len(chosen) / len(self.frame_numbers)
        return replace(self, frame_numbers=numbers, left_out_before=before, seconds=seconds, **arrays)

    def joints(self, joint_set: str | Path = RIG) -> np.ndarray:
        """Joint centres in the world: (run, frame, joint, 3) float64 [m], in the order of :meth:`joint_names`.

        Args:
            joint_set: by which definitions: the body's own, a named set such as ``isb``, or a user's .toml file.

        Raises:
            InputError: no such set, or one that is not for this body.
        """
        if joint_set != RIG:
            return set_named(joint_set, self.subject.body).of_runs(self.subject, self.pose)
        centres = joint_positions(self.subject, self.pose.reshape(-1, self.pose.shape[2]))
        return centres.reshape(*self.pose.shape[:2], -1, 3)

    def joint_names(self, joint_set: str | Path = RIG) -> tuple[str, ...]:
        """Names of the joints of a set, as :meth:`joints` takes it."""
        return set_named(joint_set, self.subject.body).names

    def vertices(self, run: int | None = None, frames: Sequence[int] | None = None) -> np.ndarray:
        """The skin's vertices in the world, which ``subject.body.skin.face`` joins: (frame, vertex, 3) float32 [m].

        Args:
            run: of which run; None for the best one.
            frames: positions in ``frame_numbers``, negative ones from the end; None for all. A frame of a body of
                13,000 vertices takes 160 KB, so of a long recording take some at a time.

        Raises:
            IndexError: no such run or frame.
        """
        pose = self.pose[self.best_run if run is None else run]
        chosen = pose if frames is None else pose[_chosen(frames, len(pose))]
        return skin_positions(self.subject, chosen, np.arange(len(self.subject.body.skin.rest)))


def _chosen(wanted: Any, count: int) -> np.ndarray:
    """(n,) positions below ``count``, by themselves, from the end, or by a mask; an IndexError for others."""
    return np.arange(count)[np.atleast_1d(np.asarray(wanted)) if np.size(wanted) else slice(0)]
