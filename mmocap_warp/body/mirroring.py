"""Which joints and vertices of a body are each other's mirror image: left and right across the root, along X."""

import re

import numpy as np

from mmocap_warp.body.model import BodyModel

_SIDES = (("L", "R"), ("l", "r"), ("Left", "Right"), ("left", "right"), ("LEFT", "RIGHT"))
_JOINT_TOLERANCE = 0.02  # how far mirrored joints may be apart, as a share of the skeleton's extent
_VERTEX_TOLERANCE = 1e-3  # how far mirrored vertices may be apart, as a share of the mesh's extent
_TOGETHER = 4096  # vertices whose mirror images are looked for at a time: it bounds memory
_MIRROR = np.array([-1.0, 1.0, 1.0])


def mirrored_joints(body: BodyModel) -> dict[str, tuple[int, ...]]:
    """The body's joints by number in groups: joints that mirror each other, or a joint alone.

    Joints mirror each other if the skeleton's pairs say so, or if their names differ in a prefix or suffix of the side
    (``L`` and ``R``, ``left`` and ``right``) and their rest places are mirrored. A group is named after its joints,
    ``LKnee+RKnee`` or ``Neck``; groups are in the order of their first joint.
    """
    skeleton = body.skeleton
    mirrored: dict[int, tuple[int, ...]] = {}
    for _, *sides in skeleton.pairs:
        pair = tuple(skeleton.index(joint) for joint in sides)
        mirrored |= dict.fromkeys(pair, pair)
    rest = body.joint_rest.astype(np.float64) - body.joint_rest[0]
    near = _JOINT_TOLERANCE * np.ptp(rest, axis=0).max()
    for left, joint in enumerate(skeleton.joints):
        for right in (skeleton.joints.index(name) for name in _other_side(joint) if name in skeleton.joints):
            apart = np.linalg.norm(rest[left] * _MIRROR - rest[right])
            if left not in mirrored and right not in mirrored and apart <= near:
                mirrored |= dict.fromkeys((left, right), (left, right))
    groups = [mirrored.get(joint, (joint,)) for joint in range(len(skeleton.joints))]
    return {"+".join(skeleton.joints[joint] for joint in group): group for group in groups}


def _other_side(joint: str) -> list[str]:
    """Names that a left joint's mirror image may have."""
    turned = ((re.sub(rf"\A{left}", right, joint), re.sub(rf"{left}\Z", right, joint)) for left, right in _SIDES)
    return [name for names in turned for name in names if name != joint]


def mirrored_weights(body: BodyModel) -> np.ndarray:
    """(vertex, joint) float64, the full mesh's skinning weights, equal on both sides.

    Each vertex takes the mean of its own weights and of its mirror image's, which has them at the other side's joints.
    A vertex without a mirror image keeps its own.
    """
    skin = body.skin
    weight = np.zeros((len(skin.rest), len(body.joint_rest)))
    np.add.at(weight, (np.arange(len(weight))[:, None], skin.joint), skin.weight.astype(np.float64))
    across = np.arange(len(body.joint_rest))
    for group in mirrored_joints(body).values():
        across[list(group)] = group[::-1]

    rest = skin.rest.astype(np.float64) - body.joint_rest[0]
    near = _VERTEX_TOLERANCE * np.ptp(rest, axis=0).max()
    # of vertices that lie on each other, the one with like weights is the mirror image
    own = np.concatenate([rest, near * weight], axis=1)
    image = np.concatenate([rest * _MIRROR, near * weight[:, across]], axis=1)
    mirror = _nearest(own, image, 2 * near)
    apart = np.linalg.norm(rest[mirror] - rest * _MIRROR, axis=1)
    has_image = (apart <= near) & (mirror[mirror] == np.arange(len(mirror)))
    return np.where(has_image[:, None], (weight + weight[mirror][:, across]) / 2, weight)


def _nearest(points: np.ndarray, places: np.ndarray, reach: float) -> np.ndarray:
    """(place,) the point (n, value) nearest to each place (place, value); any one where none is within ``reach``.

    SciPy's tree does the same, but it takes longer to load than this takes.
    """
    if len(places) > _TOGETHER:
        parts = np.array_split(places, -(-len(places) // _TOGETHER))
        return np.concatenate([_nearest(points, part, reach) for part in parts])
    long = int(np.ptp(points[:, :3], axis=0).argmax())
    order = np.argsort(points[:, long], kind="stable")
    first, last = (np.searchsorted(points[order, long], places[:, long] + side) for side in (-reach, reach))
    # Each place with each point that is beside it along the longest axis.
    count = last - first
    place = np.repeat(np.arange(len(places)), count)
    point = order[np.arange(len(place)) + np.repeat(first - np.cumsum(count) + count, count)]
    for axis in {0, 1, 2} - {long}:
        near = np.abs(points[point, axis] - places[place, axis]) < reach
        place, point = place[near], point[near]
    apart = ((points[point] - places[place]) ** 2).sum(axis=1)
    nearest = np.zeros(len(places), int)
    farthest_first = np.lexsort((point, apart))[::-1]
    nearest[place[farthest_first]] = point[farthest_first]
    return nearest
