"""Mask area that no body explains, by body part: where a limb is that was lost before the trunk or folded away.

An overlap hardly notices a forearm, and no outline of the body tells of mask that the body does not cover. Area counts
here if it is deep, if the other views' masks agree that something is there, and if two views show it: what one view
alone shows may be a fault of its mask, unless it is as large as a hand. Views that show more than limbs beside the
body, somebody who passes by or a chest, do not count.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import cv2
import numpy as np
import warp as wp

from mmocap_warp.body.model import SkinMesh, Subject
from mmocap_warp.body.posing import Poser
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.kernels.silhouettes.beside import Sight, find_cells, follow_rays
from mmocap_warp.kernels.structs import allocated
from mmocap_warp.masks.observation import Observation

_CELL = 0.02  # pixels are looked at that are so far apart at the body [m]
_SPACING = 0.1  # points of the skin are at most so far apart: then none of it is deep [m]
_SAME_PLACE = 1e-4  # points that are nearer to each other are one [m]
_DEEP = 0.06  # mask farther than this from every such point is uncovered [m]
_FAR = 0.5  # what is farther than this from the body is no limb of it [m]
_REACH = 1.2  # rays are followed so far before and behind the body's middle [m]
_STEP = 0.03  # between the points of a ray [m]
_MOST_RAYS = 48  # rays that are followed of a view
_LEAST_AREA = 0.002  # less than that beside a body is noise of a mask [m^2]
_LEAST_VIEWS = 4  # so many other views must be there for one of them to be allowed to disagree
_FAULT_AREA = 0.003  # what one view alone shows counts where it is more than that: a mask may have such faults [m^2]
_MOST_AREA = 0.12  # a view that leaves more than that uncovered shows somebody or something else [m^2]

_zeros = partial(wp.zeros, device="cpu")
_LOOK_INTERVAL = 0.1  # seconds between the frames that are looked at for limbs that were lost
_JUDGE_INTERVAL = 1 / 30  # seconds between the frames whose final poses are judged
_CLEAR_AREA = 0.01  # area above the usual that says by itself that a limb is lost [m^2], in a body like a person
_REPEATED_AREA = 0.006  # the same, where two looks in a row show so much [m^2]
LASTING_AREA = 0.002
"""The same, where two looks for lost limbs show the area [m^2], in a body as large as a person."""
_FINAL_LASTING_AREA = 0.003  # the same, in the median of final looks: a torso that fits badly shows 0.0025 [m^2]
LARGEST_USUAL_AREA = 0.01
"""More than this near a part is never usual [m^2]: it may be a limb that is wrong in all frames."""
WIDE_SIGMA = 0.15
"""Least standard deviation of a joint of a part in doubt, along each axis [m]."""
_USUAL_SHARE = 0.2  # of all looks at a clip, those that show less uncovered area than usual
_LASTING = 0.2  # seconds before and after a look, in the median of which area has to last
_AROUND = 0.2  # seconds within which a limb is in doubt before and after it stands out
_MOST_DOUBTFUL = 0.75  # share of the looks that a lost limb may stand out in
_LEAST_LOOKS = 10  # that this share is taken of
_BLAMED_SHARE = 0.3  # of the area, what is near a part that is in doubt


@dataclass(frozen=True, eq=False)
class Uncovered:
    """What one frame's masks show beside a body."""

    area: np.ndarray  # (part,) near each part, in the view that decides [m^2]
    place: np.ndarray  # (n, 3) where it is, about the middle of what the masks leave open [m]


def look_interval(rate: float, *, final: bool = False) -> int:
    """Frames from one that is looked at to the next, for limbs that were lost or to judge final poses."""
    return max(1, int((_JUDGE_INTERVAL if final else _LOOK_INTERVAL) * rate))


class UncoveredArea:
    """Finds mask area that a posed body does not cover.

    Args:
        subject: the body, and the base of its root.
        rig: undistorted cameras at the masks' size.
    """

    def __init__(self, subject: Subject, rig: CameraRig) -> None:
        body, mesh = subject.body, subject.body.tracking
        self._rig, self._parts = rig, len(body.skeleton.parts)
        self._corner, self._share = _points_of_faces(mesh, _SPACING * body.relative_size)
        part = np.array(body.skeleton.part)[mesh.heaviest_joint]
        self._part = np.concatenate([part, part[self._corner[:, 0]]])
        self._poser = Poser(replace(body, skin=mesh), subject.root_base)
        self._size = body.relative_size
        self._lens = rig.K @ rig.R, np.einsum("kij,kj->ki", rig.K, rig.t)
        back = np.swapaxes(rig.R, 1, 2)
        self._sight = allocated(
            Sight,
            "cpu",
            word=(0, 0, 0),
            possible=(0, 0, 0),
            size=rig.size.astype(np.int32),
            turn=self._lens[0],
            shift=self._lens[1],
            origin=-np.einsum("kij,kj->ki", back, rig.t),
            into_world=back @ np.linalg.inv(rig.K),
        )
        most = int(4 * _MOST_AREA / _CELL**2) + 1  # cells are at least half as far apart as they may be
        self._cells = _zeros(len(rig) * int(rig.size.prod(axis=1).max()), wp.uint8), _zeros((len(rig), most), wp.vec2i)
        self._agreed = [_zeros(2 * _MOST_RAYS, kind) for kind in (wp.vec3d, wp.int32, wp.float64)]

    def of(self, poses: np.ndarray, observation: Observation) -> list[Uncovered]:
        """The area beside poses (n, coordinate), each by itself."""
        masks = (np.ascontiguousarray(words) for words in (observation.words, observation.possible))
        self._sight.word, self._sight.possible = (wp.array(a, dtype=wp.uint32, device="cpu", copy=False) for a in masks)
        return [self._beside_skin(skin, observation) for skin in self._poser.vertices(poses).astype(float)]

    def _beside_skin(self, skin: np.ndarray, observation: Observation) -> Uncovered:
        """The area beside the vertices (n, 3) of the skin."""
        skin = np.concatenate([skin, np.einsum("nc,ncx->nx", self._share, skin[self._corner])])
        middle = skin.mean(axis=0)

        # What is beside the body in each view. A view with more than limbs there shows somebody or something else.
        depth = self._rig.R[:, 2] @ middle + self._rig.t[:, 2]
        scale = self._rig.K[:, 0, 0] / np.where(depth > 0, depth, np.inf)
        step = np.maximum(1, (_CELL * self._size * scale).astype(int)) * ((observation.foreground > 0) & (depth > 0))
        cells = self._beside(self._projected(skin), step, _DEEP * self._size * scale)
        beside: dict[int, tuple[np.ndarray, float, float]] = {}  # pixels, the area of each [m^2], the body's depth [m]
        for k in np.flatnonzero(step).tolist():
            if len(cells[k]) * (step[k] / scale[k]) ** 2 <= _MOST_AREA * self._size**2:
                beside[k] = step[k] * cells[k], (step[k] / scale[k]) ** 2, depth[k]

        # Of that, what the other views agree on, near the body. Views with less than the two that show most do not
        # decide.
        seen = np.array(list(beside), int)
        area: list[np.ndarray] = [np.zeros(self._parts)] * 2  # the view with most of it first
        places = [np.empty((0, 3))]
        least = _LEAST_AREA * self._size**2
        for k, (pixels, pixel, depth) in sorted(beside.items(), key=lambda view: -len(view[1][0]) * view[1][1]):
            if len(pixels) * pixel < max(least, area[1].sum()):
                break
            every = -(-len(pixels) // _MOST_RAYS)
            place, nearest, apart = self._agreed_on(k, pixels[::every], depth, seen[seen != k], skin[::4])
            near = apart < (_FAR * self._size) ** 2
            place, part = place[near], self._part[::4][nearest[near]]
            if not len(place):
                continue
            of_view = np.bincount(part, np.full(len(part), every * pixel), self._parts)
            area = sorted([*area, of_view], key=lambda each: -each.sum())[:2]
            places.append(place)
        # The view with the second most area decides, or that with the most, less what may be a fault of its mask.
        most, second = (each.sum() for each in area)
        alone = max(most - _FAULT_AREA * self._size**2, 0.0)
        return Uncovered(area[0] * (alone / most) if alone > second else area[1], np.concatenate(places))

    def _beside(self, skin: np.ndarray, step: np.ndarray, deep: np.ndarray) -> list[np.ndarray]:
        """Of each view's mask the cells (n, 2), column and row, that are deeper than ``deep`` px beside skin (n, 2).

        A view's cells are ``step`` (camera,) pixels apart; where that is 0 the view is left out.
        """
        radius = np.maximum(1, np.round(deep / np.maximum(step, 1)).astype(int)) * (step > 0)
        reach = np.full((len(step), radius.max() + 1), -1, np.int32)
        for row, r in zip(reach, radius.tolist(), strict=True):
            row[: r + 1] = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * r + 1, 2 * r + 1))[r:].sum(axis=1) // 2
        count = _zeros(len(step), wp.int32)
        apart = _on_cpu(step.astype(np.int32), wp.int32)
        find_cells(self._sight, _on_cpu(skin, wp.vec2d), apart, _on_cpu(reach, wp.int32), *self._cells, count)
        cell = self._cells[1].numpy()
        return [cell[k, :n] for k, n in enumerate(count.numpy().tolist())]

    def _agreed_on(
        self, k: int, pixels: np.ndarray, depth: float, others: np.ndarray, skin: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Where the other views' masks agree with pixels (m, 2) of a view, in the middle along each ray.

        Returns:
            (n, 3) the places [m], (n,) the nearest point of the skin (point, 3), and (n,) the square of its distance.
        """
        reach, step = _REACH * self._size, _STEP * self._size
        first = max(depth - reach, step)
        steps = int(np.ceil((depth + reach - first) / step))
        most = len(others) - max(2, len(others) - (len(others) >= _LEAST_VIEWS))
        rays, asked = _on_cpu(pixels.astype(np.int32), wp.vec2i), _on_cpu(others.astype(np.int32), wp.int32)
        follow_rays(self._sight, k, rays, asked, most, (first, step, steps), _on_cpu(skin, wp.vec3d), self._agreed)
        place, nearest, apart = (each.numpy()[: len(pixels)] for each in self._agreed)
        hit = nearest >= 0
        return place[hit], nearest[hit], apart[hit]

    def _projected(self, points: np.ndarray, views: int | slice = slice(None)) -> np.ndarray:
        """Pixels (..., n, 2) of points (n, 3) in views; NaN behind the camera."""
        turn, shift = self._lens
        seen = points @ np.swapaxes(turn[views], -1, -2) + shift[views][..., None, :]
        pixels: np.ndarray = seen[..., :2] / np.where(seen[..., 2:] > 0, seen[..., 2:], np.nan)
        return pixels


def _on_cpu(values: np.ndarray, dtype: Any) -> Any:
    """A NumPy array as kernels take it, without a copy where it is contiguous."""
    return wp.array(np.ascontiguousarray(values), dtype=dtype, device="cpu", copy=False)


def parts_in_doubt(size: float, rate: float, looked: np.ndarray, area: np.ndarray, frames: int) -> np.ndarray:
    """(frame, part) bool: parts near mask area that nothing explains, for a moment in plenty or for a while.

    Args:
        size: the body's size, as a share of a person's.
        rate: frames a second.
        looked: (look,) positions of the frames that were looked at, ascending.
        area: (look, part) mask area that is uncovered near each part [m^2].
        frames: how many frames there are.
    """
    # More area than usual, at once, in two looks in a row, or for some time.
    usual = np.minimum(np.quantile(area, _USUAL_SHARE, axis=0), LARGEST_USUAL_AREA * size**2)
    excess = np.maximum(area - usual, 0.0)
    total = excess.sum(axis=1)
    beside = np.pad(total, 1)
    repeated = np.minimum(total, np.maximum(beside[:-2], beside[2:]))
    first, last = np.searchsorted(looked, [looked - _LASTING * rate - 0.5, looked + _LASTING * rate + 0.5])
    around = [slice(*ends) for ends in zip(first, last, strict=True)]
    lasting = np.array([np.median(total[looks]) for looks in around])
    doubtful = stands_out(size, total, repeated, lasting, _FINAL_LASTING_AREA)
    if is_usual((total > LASTING_AREA * size**2).sum(), len(looked)):
        return np.zeros((frames, area.shape[1]), bool)
    # It is put down to the parts that most of it is near, over the looks around.
    near = np.stack([excess[looks].sum(axis=0) for looks in around])
    blamed = (near >= _BLAMED_SHARE * near.sum(axis=1, keepdims=True)) & doubtful[:, None]
    # A limb is lost before it stands out, and back after it did: the frames before and after are in doubt, too.
    doubt, after = np.zeros((frames, area.shape[1]), bool), max(1, round(_AROUND * rate))
    for frame, parts in zip(looked, blamed, strict=True):
        doubt[max(0, frame - after + 1) : frame + after] |= parts
    return doubt


def stands_out(
    size: float, area: np.ndarray, repeated: np.ndarray, lasting: np.ndarray, least_lasting: float = LASTING_AREA
) -> np.ndarray:
    """Whether uncovered areas above the usual say that a limb is lost: of a look, of two in a row, and lasting ones.

    A lasting area counts above ``least_lasting`` [m^2], in a body as large as a person.
    """
    large = (area > _CLEAR_AREA * size**2) | (repeated > _REPEATED_AREA * size**2)
    doubtful: np.ndarray = large | (lasting > least_lasting * size**2)
    return doubtful


def is_usual(standing_out: np.ndarray, looks: np.ndarray | int) -> np.ndarray:
    """Whether so many of the looks show no lost limb, but something that the body lacks: a skirt, a bag, a stick."""
    usual: np.ndarray = (standing_out > _MOST_DOUBTFUL * looks) & (looks >= _LEAST_LOOKS)
    return usual


def _points_of_faces(mesh: SkinMesh, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Points on triangles that are larger than a spacing [m]: their corners (n, 3), and the share of each (n, 3)."""
    corners = mesh.rest[mesh.face]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    divisions = np.ceil(longest / spacing).astype(int)
    corner, share = [np.empty((0, 3), int)], [np.empty((0, 3))]
    for n in np.unique(divisions[divisions > 1]):
        i, j = (axis.ravel() for axis in np.mgrid[: n + 1, : n + 1])
        grid = np.stack([i, j, n - i - j], axis=1)[i + j <= n] / n
        faces = mesh.face[divisions == n]
        corner.append(np.repeat(faces, len(grid), axis=0))
        share.append(np.tile(grid, (len(faces), 1)))
    corners_of, share_of = np.concatenate(corner), np.concatenate(share)
    # Corners are vertices, and faces have their edges' points in common.
    own = (share_of > 0).sum(axis=1) > 1
    place = np.einsum("nc,ncx->nx", share_of[own], mesh.rest[corners_of[own]])
    first = np.sort(np.unique(np.round(place / _SAME_PLACE), axis=0, return_index=True)[1])
    return corners_of[own][first], share_of[own][first]
