"""Label images, in which who is nearer hides others: several people before the same cameras, or a garment."""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.result.truth import Truth
from mmocap_warp.synthesis.footage.made_recording import Recording
from mmocap_warp.synthesis.footage.outlines import Surface, draw_outlines

_STEP = 0.02  # between the radii that are tried [m]
_NEIGHBOURS = 4  # vertices about a pixel, the nearest of which says how deep the skin is there
_SKIN, _WORN = 1, 2
_SPREAD = 3  # points along each side of a face
_HALO = 3  # how far a fault of a mask moves the garment's edge at most [px]


def places(ways: Sequence[np.ndarray], apart: float) -> np.ndarray:
    """(person, 2), shifts of ways (frame, 2) on the floor with which people meet in the middle of the clip [m].

    They are on a circle about the origin then, on the smallest that keeps them ``apart`` in all frames.
    """
    bearing = 2 * np.pi * np.arange(len(ways)) / len(ways)
    ring = np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
    middle, radius = np.array([way[len(way) // 2] for way in ways]), 0.0
    while True:
        shifts: np.ndarray = radius * ring - middle
        placed = [way + shift for way, shift in zip(ways, shifts, strict=True)]
        pairs = [(one, other) for i, one in enumerate(placed) for other in placed[i + 1 :]]
        if all(np.linalg.norm(one - other, axis=1).min() >= apart for one, other in pairs):
            return shifts
        radius += _STEP


def shifted_truth(truth: Truth, shift: np.ndarray) -> Truth:
    """The truth of somebody who is elsewhere by ``shift`` (2,) on the floor of a world with +Z up [m]."""
    by = np.array([*shift, 0.0])
    pose = None if truth.pose is None else np.concatenate([truth.pose[:, :3] + by, truth.pose[:, 3:]], axis=1)
    return replace(truth, markers=truth.markers + by, joints=truth.joints + by, pose=pose)


class Together:
    """Recordings of one length by the same cameras, in one; people keep the order of their labels, from 1 on.

    They are elsewhere than in their recordings by ``shifts`` (person, 2) [m].
    """

    def __init__(self, recordings: Sequence[Recording], shifts: np.ndarray) -> None:
        pairs = zip(recordings, shifts, strict=True)
        moved = [(each, np.column_stack([each.poses[:, :2] + shift, each.poses[:, 2:]])) for each, shift in pairs]
        self._people = [replace(each, poses=poses) for each, poses in moved]
        self.fps, self.rig = recordings[0].fps, recordings[0].rig

    def __len__(self) -> int:
        return len(self._people[0])

    def masks(self, frame: int) -> list[np.ndarray]:
        """Per camera (height, width) uint8: labels, with the faults that each person's mask has; 0 is background."""
        masks = [recording.masks(frame) for recording in self._people]
        skins = [recording.vertices(frame) for recording in self._people]
        by_view = enumerate(zip(*masks, strict=True))
        return [_nearest(of_people, [_seen(self.rig, k, skin) for skin in skins]) for k, of_people in by_view]


def garment_masks(recording: Recording, frame: int, masks: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Per camera (height, width) bool: the pixels of the ``masks`` of a frame that show the garment that is worn.

    A ValueError where none is worn.
    """
    if recording.worn is None:
        raise ValueError("nobody wears a garment")
    vertices, face, rig = recording.vertices(frame), recording.body.skin.face, recording.rig
    cloth = recording.worn[face].all(axis=1)
    surfaces = [Surface.of(face[~cloth]), Surface.of(face[cloth])]
    outlines = [draw_outlines(rig, vertices, surface) for surface in surfaces]
    facing = [surface.facing(vertices, rig.centres) for surface in surfaces]
    worn = []
    for k, mask in enumerate(masks):
        seen = [_seen(rig, k, _points(vertices[each.face[of[k]]])) for each, of in zip(surfaces, facing, strict=True)]
        labels = _nearest([of_surface[k] for of_surface in outlines], seen)
        # What a halo adds beside the garment is the garment's.
        about = cv2.dilate((labels == _WORN).astype(np.uint8), np.ones((2 * _HALO + 1, 2 * _HALO + 1))) > 0
        worn.append(mask & about & (labels != _SKIN))
    return worn


def _points(corner: np.ndarray) -> np.ndarray:
    """(point, 3) spread over quads (quad, 4, 3)."""
    along = (np.arange(_SPREAD) + 0.5) / _SPREAD
    first, second = (each.ravel() for each in np.meshgrid(along, along))
    share = np.stack([(1 - first) * (1 - second), first * (1 - second), first * second, (1 - first) * second], axis=1)
    return (share @ corner).reshape(-1, 3)


def _seen(rig: CameraRig, k: int, skin: np.ndarray) -> np.ndarray:
    """(point, 3) column and row in a view [px], and depth [m]."""
    seen = skin @ rig.R[k].T + rig.t[k]
    image = seen @ rig.K[k].T
    return np.column_stack([image[:, :2] / image[:, 2:], seen[:, 2]])


def _nearest(masks: Sequence[np.ndarray], seen: Sequence[np.ndarray]) -> np.ndarray:
    """The label of each pixel of a view, from the masks and vertices of the surfaces in it."""
    from scipy.spatial import cKDTree

    labels = np.zeros(masks[0].shape, np.uint8)
    for number, mask in enumerate(masks, 1):
        labels[mask] = number
    row, column = np.nonzero(np.sum(masks, axis=0) > 1)
    if len(row):
        pixels, depth = np.column_stack([column, row]), np.full((len(masks), len(row)), np.inf)
        for number, (mask, skin) in enumerate(zip(masks, seen, strict=True)):
            nearest = cKDTree(skin[:, :2]).query(pixels, _NEIGHBOURS)[1]
            depth[number] = np.where(mask[row, column], skin[nearest, 2].min(axis=1), np.inf)
        labels[row, column] = 1 + depth.argmin(axis=0)
    return labels
