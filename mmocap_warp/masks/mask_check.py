"""Judging masks without truth: what every view shows, and whether the views show the same thing.

Views that see the same solid body agree: each mask lies within what the others' visual hull covers, and the hull of all
holds the body's volume. A mask that lacks a part takes it from the hull, so that the others are no longer explained.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.masks.frames import evenly_spread
from mmocap_warp.masks.visual_hull import explained_share, meeting_point, seen_at

_COMPARED_FRAMES = 12  # number of frames whose views are compared
_SPACING = 0.04  # between voxels [m]
_GRID_REACH = 1.3  # of the voxels' grid about the subject [m]
_COMPARED_PIXELS = 600  # number of a mask's pixels that are compared with the other views
_MIN_VOLUME = 0.4  # of a body's volume. A hull of less shows a part: that of a leg has up to 0.25, of a body 1 to 3
_MIN_VOLUME_TWO_VIEWS = 0.8  # the same of two views, whose hulls are larger: a leg's up to 0.5, a body's from 1.5 on
_MIN_COVERED = 0.5  # share of the others' hull. A view that covers less lacks most of the subject: a leg is 0.15 to 0.3
_MIN_EXPLAINED = 0.6  # share of a mask. One that is explained less shows something else: good masks are at 0.93 to 1
_MAX_EMPTY_SHARE = 0.25  # of the frames
_SMALL, _PERSON = 0.5, 1.8  # extents [m]: a subject that has less is looked at in a unit in which it has a person's
LITRE = 1e-3  # [m^3]


@dataclass(frozen=True)
class ViewReport:
    """What one camera's masks show."""

    area: np.ndarray  # (frame,) foreground pixels
    # Share of the mask that the other views' hull covers, median over the compared frames; NaN where fewer than two
    # others see the subject.
    explained: float
    covered: float  # share of the other views' hull that the mask covers, likewise


@dataclass(frozen=True)
class MaskReport:
    """What all masks show."""

    views: dict[str, ViewReport]  # by camera name; of several people behind each one's, as in "S1: C1"
    volume: float  # of everybody's hull of all views, median over the compared frames [m^3]; NaN without any such frame
    faults: tuple[str, ...]  # a sentence for each thing that is wrong; empty where the masks can be tracked


class MaskJudge:
    """Looks at each of so many ``frames`` as it passes.

    The cameras are undistorted pinholes, as the masks; a body like the subject's has ``body_volume`` [m^3]. If that is
    ``supposed``, because nobody has named the body, less than a litre may be an animal, and is not judged by it.
    """

    def __init__(self, rig: CameraRig, frames: int, body_volume: float, *, supposed: bool = False) -> None:
        self._rig, self._body_volume, self._supposed = rig, body_volume, supposed
        self._compared = set(evenly_spread(frames, _COMPARED_FRAMES))
        self._area: list[list[int]] = []
        self._agreements: list[_Agreement] = []

    def add(self, masks: list[np.ndarray]) -> None:
        """Look at the next frame's masks, per camera (height, width) bool."""
        if len(self._area) in self._compared:
            self._agreements.append(_agreement(self._rig, masks))
        self._area.append([int(mask.sum()) for mask in masks])

    def report(self) -> MaskReport:
        """What was seen so far."""
        explained, covered, volumes = map(np.array, zip(*self._agreements, strict=True))
        reports = map(ViewReport, np.array(self._area).T, map(_median, explained.T), map(_median, covered.T))
        views = dict(zip(self._rig.names, reports, strict=True))
        volume = _median(volumes)
        faults = [
            f"{name} shows nothing in {(view.area == 0).sum()} of {len(view.area)} frames"
            for name, view in views.items()
            if (view.area == 0).mean() > _MAX_EMPTY_SHARE
        ]
        faults += self._disagreements(views, volume)
        return MaskReport(views, volume, tuple(faults))

    def _disagreements(self, views: dict[str, ViewReport], volume: float) -> list[str]:
        """What the views' agreement says. One that lacks most of the subject leaves all others unexplained."""
        part = (_MIN_VOLUME_TWO_VIEWS if len(views) == 2 else _MIN_VOLUME) * self._body_volume
        lacking = [
            f"{name} shows {100 * view.covered:.0f} % of what the other views see: most of the subject is missing there"
            for name, view in views.items()
            if view.covered < _MIN_COVERED
            and view.explained > _MIN_EXPLAINED
            and all(other.explained < _MIN_EXPLAINED for other in views.values() if other is not view)
        ]
        if lacking:
            return lacking
        if not volume > part and not (self._supposed and volume < LITRE):
            volumes = f"{_litres(np.nan_to_num(volume))} litres, a body like the subject's {_litres(self._body_volume)}"
            why = "only a part of it was segmented, such as a moving leg, or a view shows something else"
            why += ", or the scene's body is to be named, where it is no person's" * self._supposed
            return [f"what all views agree on holds {volumes}: {why}"]
        return [
            f"{100 * (1 - view.explained):.0f} % of what {name} shows is seen by no other view: something else is"
            " in it (a clean plate of another camera?), or its calibration or frame_offset is wrong"
            for name, view in views.items()
            if view.explained < _MIN_EXPLAINED
        ]


def _litres(volume: float) -> str:
    """For people, without the unit."""
    return f"{volume / LITRE:.0f}" if volume >= LITRE else f"{volume / LITRE:.2g}"


_Agreement = tuple[np.ndarray, np.ndarray, float]
"""Of a frame: per camera the shares ``explained`` and ``covered``, NaN where not known; and the hull's volume [m^3]."""


def _agreement(rig: CameraRig, masks: list[np.ndarray]) -> _Agreement:
    explained, covered = np.full((2, len(rig)), np.nan)
    seen = [k for k, mask in enumerate(masks) if mask.any()]
    if len(seen) < 2:
        return explained, covered, np.nan
    extent = _extent(rig, masks, seen)
    unit = extent / _PERSON if 0 < extent < _SMALL else 1.0  # not of views that meet behind the cameras
    rig = rig.in_unit(unit)
    subject = meeting_point(rig, masks)
    # Of each camera and voxel: seen as foreground; and foreground or outside of the image.
    along = np.arange(-_GRID_REACH, _GRID_REACH, _SPACING)
    voxels = np.stack(np.meshgrid(along, along, along, indexing="ij"), axis=-1).reshape(-1, 3) + subject
    shown = np.array([seen_at(rig, k, voxels, mask, -1)[1] for k, mask in enumerate(masks)])
    hit, possible = shown > 0, shown != 0
    for k in seen if len(seen) > 2 else ():
        others = [j for j in seen if j != k]
        hull = _hull_of(hit, possible, others)
        if hull.any():
            covered[k] = possible[k, hull].mean()  # what lies outside of its image, a view cannot lack
        pixels = np.argwhere(masks[k])[:, ::-1]
        some = pixels[:: max(1, len(pixels) // _COMPARED_PIXELS)]
        depth = float((rig.R[k] @ subject + rig.t[k])[2])
        explained[k] = explained_share(rig, masks, k, others, some, depth)
    return explained, covered, float(_hull_of(hit, possible, seen).sum() * (unit * _SPACING) ** 3)


def _extent(rig: CameraRig, masks: list[np.ndarray], seen: list[int]) -> float:
    """How large the subject is, as most views see it: its box's diagonal where the views meet [m]."""
    depth = rig.R[:, 2] @ meeting_point(rig, masks) + rig.t[:, 2]
    diagonal = [np.linalg.norm(cv2.boundingRect(masks[k].view(np.uint8))[2:]) for k in seen]
    return float(np.median(diagonal * depth[seen] / rig.K[seen, 0, 0]))


def _hull_of(hit: np.ndarray, possible: np.ndarray, views: list[int]) -> np.ndarray:
    """(voxel,) bool: the hull of some views; two must see a voxel, and none may see background there."""
    return possible[views].all(axis=0) & (hit[views].sum(axis=0) >= min(2, len(views)))


def _median(values: np.ndarray) -> float:
    known = values[~np.isnan(values)]
    return float(np.median(known)) if len(known) else float("nan")
