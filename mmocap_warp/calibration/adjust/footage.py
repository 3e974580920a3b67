"""The frames of a recording that calibrate it, with times that may yet change, and the person who is seen in them."""

from dataclasses import dataclass, replace

import numpy as np

from mmocap_warp.body.model import Subject
from mmocap_warp.body.rotations import between, transposed
from mmocap_warp.body.skeleton import ROOT_ANGLES
from mmocap_warp.contour.frame.rooted import RootedPoses, Rooting
from mmocap_warp.errors import InputError
from mmocap_warp.masks.observation import Observation
from mmocap_warp.masks.repeats import frozen_views, repeated_views
from mmocap_warp.scene.recording import Scene

_RATE = 30.0  # frames a second: more are not needed to follow a person
_MAX_SECONDS = 20.0  # seconds of a recording that are used
_MAX_PIXELS = 640  # pixels of an image's longer side: more are not needed for outlines
MIN_FRAMES = 4
"""Frames that cameras are solved from, and frames that judge them, at least."""


class Footage:
    """A recording's masks, read again whenever its cameras' times change.

    The masks are read without repair, because repairing them would need the calibration that is in doubt. ``scale`` is
    of masks and cameras; by default images are at most 640 pixels long.
    """

    def __init__(self, scene: Scene, scale: float | None = None) -> None:
        self._scene = replace(scene, foreground=replace(scene.foreground, repair=False))
        self.scale = scale or min(1.0, _MAX_PIXELS / float(scene.calibrated.size.max()))
        self.rig = scene.rig(self.scale)  # the cameras as they were calibrated, at the masks' size
        self._step = max(1, int(scene.rate / _RATE))
        self.fps = scene.rate / self._step  # of the frames that are used

    def check_length(self) -> None:
        """Raise an InputError for a clip in which no person can be tracked for long enough."""
        needed, count = (2 * MIN_FRAMES - 1) * self._step + 1, self._scene.frame_count
        if count < needed:
            problem = f"has too few frames ({count}): cameras are compared by {needed} or more"
            raise InputError(self._scene.path, problem, "give a longer clip, or take the cameras as they are given")

    def _first_frames(self, offset: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(camera,) the number of each camera's first frame, if offsets grow by ``offset``, and the rest [s]."""
        fps = self._scene.fps * np.array([source.rate for source in self._scene.cameras])
        total = offset + np.array([source.frame_offset + source.fraction for source in self._scene.cameras]) / fps
        whole = np.rint(total * fps).astype(int)
        return whole, total - whole / fps

    def rest(self, offset: np.ndarray) -> np.ndarray:
        """(camera,) the part of each camera's offset that whole frames leave over, if it grows by ``offset`` [s]."""
        return self._first_frames(offset)[1]

    def observations(self, offset: np.ndarray) -> list[Observation]:
        """The masks of the frames that are used, if cameras lag by ``offset`` (camera,) [s] more than the scene says.

        Each camera gives its nearest whole frame, and none while it is frozen.
        """
        shifted = tuple(
            replace(source, frame_offset=int(frames), fraction=0.0)
            for source, frames in zip(self._scene.cameras, self._first_frames(offset)[0], strict=True)
        )
        scene = replace(self._scene, cameras=shifted)
        count = min(scene.frame_count, max(1, round(_MAX_SECONDS * scene.rate)))
        every = [Observation.from_masks(views) for views in scene.masks(self.scale, count=count)]
        seen = list(zip(every, frozen_views(repeated_views(every)), strict=True))[:: self._step]
        return [each.without(frozen) if frozen.any() else each for each, frozen in seen]


@dataclass(frozen=True, eq=False)
class Motion:
    """Poses of consecutive frames."""

    rooting: Rooting  # moves poses; it searches all of the root's angles
    rooted: RootedPoses  # the poses
    fps: float  # of the frames

    def at(self, frame: np.ndarray) -> RootedPoses:
        """The poses at frames (n,), which may be fractions; beyond the clip's ends the person stands still."""
        last = len(self.rooted) - 1
        at = np.clip(frame, 0, last)
        before = np.clip(np.floor(at).astype(int), 0, max(last - 1, 0))
        after, share = np.minimum(before + 1, last), at - before
        one, other = self.rooted[before], self.rooted[after]
        return RootedPoses(between(one.base, other.base, share), one.pose + share[:, None] * (other.pose - one.pose))

    def velocity(self, frames: np.ndarray) -> np.ndarray:
        """(n, dof) how fast the searched coordinates change in whole frames (n,) [m/s, rad/s]."""
        from scipy.spatial.transform import Rotation

        # Central differences of the pose.
        last = len(self.rooted) - 1
        before, after = self.rooted[np.maximum(frames - 1, 0)], self.rooted[np.minimum(frames + 1, last)]
        seconds = np.maximum(np.minimum(frames + 1, last) - np.maximum(frames - 1, 0), 1)[:, None] / self.fps
        velocity: np.ndarray = (after.pose - before.pose)[:, self.rooting.searched] / seconds
        # The root's base turns too, which counts as a change of the root's angles.
        turned = Rotation.from_matrix(after.base @ transposed(before.base)).as_rotvec() / seconds
        root = np.searchsorted(self.rooting.searched, ROOT_ANGLES.start)
        axes = self.rooting.root_axes(self.rooted[frames])
        velocity[:, root : root + 3] += np.linalg.solve(axes, turned[..., None])[..., 0]
        return velocity


@dataclass(frozen=True, eq=False)
class Person:
    """The person as tracked by cameras."""

    subject: Subject  # the body, with the pose of the first frame
    observations: list[Observation]  # the frames' masks, each camera's shifted by whole frames
    motion: Motion  # the poses
    found: np.ndarray  # (frame,) int, the frames in which the person was found

    def spread(self, count: int) -> np.ndarray:
        """At most ``count`` frames that show the person, evenly spread, with the first and the last.

        Where there are few, enough are left out to judge by.
        """
        at = np.linspace(0, len(self.found) - 1, min(count, len(self.found) - MIN_FRAMES))
        return self.found[at.round().astype(int)]

    def between(self, count: int, taken: np.ndarray) -> np.ndarray:
        """At most ``count`` frames other than those ``taken``, evenly spread, none at the ends."""
        others = np.setdiff1d(self.found, taken)
        at = (np.arange(min(count, len(others))) + 0.5) * len(others) / max(min(count, len(others)), 1)
        return others[at.astype(int)]
