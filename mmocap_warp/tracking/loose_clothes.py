"""Loose clothes: mask that stands off the parts of a body that wear them may be cloth, and so hides what is there.

A skirt shows no gap between the legs. Taken for skin it makes thick, short thighs and low hips, and pulls legs apart.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace

import cv2
import numpy as np

from mmocap_warp.body.model import Subject
from mmocap_warp.body.posing import Poser
from mmocap_warp.cameras.rig import CameraRig, project
from mmocap_warp.cameras.silhouette import silhouette
from mmocap_warp.masks.cleanup import around
from mmocap_warp.masks.observation import Observation, pack_masks, unpack_masks
from mmocap_warp.tracking.body_masks import body_silhouettes
from mmocap_warp.tracking.holes import with_holes
from mmocap_warp.tracking.limb_pairs import limbs

LOOSE = "fit.loose"
"""What a subject's provenance calls the joints whose skin is under loose clothes, with a ``+`` between them."""

# All lengths are shares of the mask's extent.
_MARGIN = 0.015  # mask so near to the body is its skin
_WIDTH = 0.008  # radius of a disc that fits into cloth: what is thinner is an error of the pose
_LOST_WIDTH = 0.012  # the same, where a lost hand or foot must not be taken for cloth
_AROUND = 0.05  # mask so near to such a disc may be cloth, too
_REACH = 0.1  # how far cloth stands off the parts that wear it
_BARE, _LOST_BARE = 0.04, 0.06  # mask so near to a limb that wears none is the limb's; and where that may be lost

PoseBefore = Callable[[int], np.ndarray]
"""From a position, the poses (run, coordinate) that were tracked in the frame before."""


class LooseClothes:
    """Finds what of masks may be loose clothes of a subject, which the ``joints`` of these names wear.

    If the pose is not ``known``, a limb may be lost: what may be one is no cloth.
    """

    def __init__(self, subject: Subject, rig: CameraRig, joints: Sequence[str], known: bool = False) -> None:
        mesh, skeleton = subject.body.tracking, subject.body.skeleton
        self._rig, self._poser = rig, Poser(subject.body, subject.root_base)
        self._width, self._bare = (_WIDTH, _BARE) if known else (_LOST_WIDTH, _LOST_BARE)
        faces, names = subject.body.tracking_face, np.array(skeleton.joints)
        own = [names[limb.joints].tolist() for limb in limbs(skeleton)]
        kinds = joints, [joint for each in own if not set(each) & set(joints) for joint in each]
        of_loose, of_bare = (np.isin(names[mesh.heaviest_joint], each)[faces].any(axis=1) for each in kinds)
        self._faces = faces[of_loose], faces[of_bare], faces[~of_loose & ~of_bare]

    def hidden_in(self, seen: Observation, poses: np.ndarray) -> Observation:
        """A frame's masks without what may be clothes around a body in poses (run, coordinate), which is hidden."""
        hidden = np.zeros_like(seen.words) if seen.hidden is None else seen.hidden.copy()
        pixels = [project(self._rig, vertices) for vertices in self._poser.tracking_vertices(poses)]
        for k in np.flatnonzero(seen.foreground > 0).tolist():
            mask = unpack_masks(seen.words[k : k + 1], self._rig.size[k : k + 1])[0]
            cloth = pack_masks([self._cloth(mask, [of_run[k] for of_run in pixels])])[0]
            hidden[k, : cloth.shape[0], : cloth.shape[1]] |= cloth
        words = seen.words & ~hidden
        return replace(seen, words=words, hidden=hidden, foreground=np.bitwise_count(words).sum(axis=(1, 2), dtype=int))

    def _cloth(self, mask: np.ndarray, pixels: list[np.ndarray]) -> np.ndarray:
        """What of a view's mask may be cloth beside bodies whose vertices are seen at ``pixels`` (vertex, 2) each."""
        height, width = mask.shape
        box, cloth = around(mask.view(np.uint8), 1), np.zeros_like(mask)
        there, extent = mask[box], max(mask[box].shape)
        drawn = [
            np.logical_or.reduce([silhouette(each, _turned(each, of), (width, height))[box] > 0 for each in pixels])
            for of in self._faces
        ]
        body, loose, bare = (_distance(each) for each in (np.logical_or.reduce(drawn), *drawn[:2]))
        free = there & (bare > self._bare * extent)
        beside = free & (body > _MARGIN * extent) & (loose < _REACH * extent)
        inner = _distance(~np.pad(beside, 1))[1:-1, 1:-1] > self._width * extent
        cloth[box] = free & (body > 0) & (_distance(inner) < (self._width + _AROUND) * extent)
        return cloth


def _turned(pixels: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Those of a mesh's faces that are turned one way: they cover what all of them do."""
    first, second = (pixels[faces[:, k]] - pixels[faces[:, 0]] for k in (1, 2))
    return np.asarray(faces[first[:, 0] * second[:, 1] > first[:, 1] * second[:, 0]])


def _distance(pixels: np.ndarray) -> np.ndarray:
    """(height, width) float32, how far each pixel is from the nearest of these (height, width) bool; far if none is."""
    if not pixels.any():
        return np.full(pixels.shape, np.inf, np.float32)
    return np.asarray(cv2.distanceTransform((~pixels).view(np.uint8), cv2.DIST_L2, 5))


def loose_joints(subject: Subject) -> list[str]:
    """The joints whose skin is under the loose clothes that a subject was fitted in."""
    return str(subject.provenance[LOOSE]).split("+") if LOOSE in subject.provenance else []


def with_hidden(
    observations: Iterable[Observation], subject: Subject, rig: CameraRig, rate: float, pose: PoseBefore
) -> Iterator[Observation]:
    """Consecutive frames' masks, in which what holes and loose clothes may cover is hidden.

    The first is of the frame that the subject's own pose is of. ``rate`` is in frames a second.
    """
    silhouettes_of = body_silhouettes(subject, rig)
    followed = with_holes(observations, rate, lambda place: silhouettes_of(pose(place)))
    if not (worn := loose_joints(subject)):
        return followed
    clothes = LooseClothes(subject, rig, worn)
    return (clothes.hidden_in(seen, pose(i) if i else subject.pose[None]) for i, seen in enumerate(followed))
