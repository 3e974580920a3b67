"""What the formats write: joints and markers of a result's best run, at even times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mmocap_warp.body.model import Subject, bind_transforms, rest_transforms
from mmocap_warp.body.posing import skin_positions
from mmocap_warp.body.rotations import applied, zyx_rotation
from mmocap_warp.body.skeleton import TRANSLATION
from mmocap_warp.result.excerpt import evenly
from mmocap_warp.result.result import STATUS, Result


@dataclass(frozen=True)
class Tracks:
    """One run at even times, posed in double precision.

    Attributes:
        subject: who moves.
        rate: frames per second.
        time: (frame,) [s] since the recording's frame 0.
        number: (frame,) int, the recording's frame, as the time codes of USD have it.
        pose: (frame, coordinate) [m, rad].
        status: one per frame, of ``STATUS``.
        bind: (joint, 4, 4), body space from joint in the bind pose; all transforms are for column vectors.
        local: (frame, joint, 4, 4), parent from joint; the root's is world from root.
        world: (frame, joint, 4, 4), world from joint.
    """

    subject: Subject
    rate: float
    time: np.ndarray
    number: np.ndarray
    pose: np.ndarray
    status: tuple[str, ...]
    bind: np.ndarray
    local: np.ndarray
    world: np.ndarray

    @property
    def row_number(self) -> np.ndarray:
        """(frame,) int: numbers by ones from 1 at the recording's start, for formats that cannot pass frames over."""
        return int(np.round(self.time[0] * self.rate)) + 1 + np.arange(len(self.time))

    def points(self) -> tuple[tuple[str, ...], np.ndarray]:
        """Joint centres, then the virtual markers on the skin: their names, and (frame, point, 3) [m].

        A marker that is called like a joint gets the ending ``_marker``.
        """
        body = self.subject.body
        joints = body.skeleton.joints
        markers = tuple(f"{name}_marker" if name in joints else name for name in body.marker_names)
        skin = skin_positions(self.subject, self.pose, body.marker_vertex)
        return joints + markers, np.concatenate([self.world[:, :, :3, 3], skin], axis=1)


def tracks_of(result: Result) -> Tracks:
    """The best run of a result; frames that are not evenly spaced are resampled at the result's rate."""
    result = evenly(result)
    subject, pose = result.subject, result.pose[result.best_run]
    local, world = posed(subject, pose)
    return Tracks(
        subject=subject,
        rate=result.rate,
        time=result.frame_numbers / result.fps,
        number=result.frame_numbers,
        pose=pose,
        status=tuple(STATUS[status] for status in result.status[result.best_run]),
        bind=bind_transforms(subject.body),
        local=local,
        world=world,
    )


def posed(subject: Subject, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Transforms of the joints in poses (frame, coordinate), local and world as :class:`Tracks` has them."""
    local = np.tile(rest_transforms(subject.body), (len(pose), 1, 1, 1))
    local[:, 0, :3, :3] = subject.root_base @ local[:, 0, :3, :3]
    local[:, 0, :3, 3] = pose[:, :TRANSLATION]
    slides, own = subject.body.skeleton.slides, pose[:, TRANSLATION:].reshape(len(pose), -1, 3)
    for number in np.flatnonzero(slides):
        local[:, number, :3, 3] += applied(local[:, number, :3, :3], own[:, number])
    turned = zyx_rotation(np.where(slides[:, None], 0.0, own))
    local[..., :3, :3] = local[..., :3, :3] @ turned
    world = local.copy()
    for joint, parent in enumerate(subject.body.skeleton.parent):
        if parent >= 0:
            world[:, joint] = world[:, parent] @ local[:, joint]
    return local, world
