"""How bind poses differ from person to person: one's arms hang a little lower than another's.

An angle counts from the bind pose. A part that is turned in it looks like the same part with another angle: no outline
tells them apart, and the turn cannot be solved for. Its usual size is known.
"""

from typing import NamedTuple

import numpy as np

from mmocap_warp.body.mirroring import mirrored_joints, mirrored_weights
from mmocap_warp.body.model import BodyModel

_TURN = 0.022  # standard deviation of the turn, about each axis, of a part that is as thick as long [rad]
_ON_PLANE = 0.02  # a joint this near to the plane of symmetry lies in it, as a share of the skeleton's extent
_REFLECTED = np.array([1.0, -1.0, -1.0])  # what a turn's axis becomes in the mirror


class BindPoseTurns(NamedTuple):
    """Independent turns of parts in the bind pose, those of joints that mirror each other together."""

    sigma: np.ndarray  # (turn,) float64, standard deviations [rad]
    vertex: np.ndarray  # (turn, vertex, 3) float64, how far each moves the full mesh's skin at 1 rad [m]
    joint: np.ndarray  # (turn, joint, 3) float64, likewise the joints' centres


def bind_pose_turns(body: BodyModel, weight: np.ndarray | None = None) -> BindPoseTurns:
    """How parts, with all that hangs on them, may be turned at their joints about the body's axes.

    The centre of a joint in a thick limb may lie anywhere in it, and a bone is the line between two centres: so a part
    turns in proportion to how thick it is for its length. Where no skin bends (:func:`thickness`) nothing is turned.
    Who knows the :func:`mirrored_weights` may give them.
    """
    rest, place = body.skin.rest.astype(np.float64), body.joint_rest.astype(np.float64)
    weight, below = mirrored_weights(body) if weight is None else weight, body.skeleton.below
    thick = thickness(body, weight)
    length = _mean_distance(body, weight)
    groups = list(mirrored_joints(body).values())
    symmetric = any(len(group) > 1 for group in groups)
    near = _ON_PLANE * np.ptp(place, axis=0).max()
    # Each group of joints that mirror each other turns about each of the body's axes.
    sigma, turned, moved = [], [], []
    for group in groups:
        first = group[0]
        if not thick[first]:
            continue
        in_plane = symmetric and len(group) == 1 and abs(place[first, 0] - place[0, 0]) <= near
        # A part that is its own mirror image turns about the axis across alone.
        for axis in np.eye(3)[: 1 if in_plane else 3]:
            skin, centre = np.zeros_like(rest), np.zeros_like(place)
            for joint, about in zip(group, (axis, axis * _REFLECTED), strict=False):
                skin += weight[:, below[joint]].sum(axis=1)[:, None] * np.cross(about, rest - place[joint])
                centre[below[joint]] += np.cross(about, place[below[joint]] - place[joint])
            sigma.append(_TURN * thick[first] / length[first])
            turned.append(skin)
            moved.append(centre)
    return BindPoseTurns(
        np.array(sigma), np.array(turned).reshape(-1, *rest.shape), np.array(moved).reshape(-1, *place.shape)
    )


def thickness(body: BodyModel, weight: np.ndarray) -> np.ndarray:
    """(joint,) mean distance from each joint's centre of the skin that bends with it [m]; zero where none does.

    That is skin which follows, by weights (vertex, joint), both the joint and its parent, of the root both it and its
    children.
    """
    parent = np.array(body.skeleton.parent)
    beside = weight[:, parent]
    beside[:, 0] = weight[:, parent == 0].sum(axis=1)
    return _mean_distance(body, weight * beside)


def _mean_distance(body: BodyModel, weight: np.ndarray) -> np.ndarray:
    """(joint,) mean distance of the skin from each joint's centre by weights (vertex, joint); zero without weight."""
    distance = np.linalg.norm(body.skin.rest[:, None].astype(float) - body.joint_rest.astype(float), axis=2)
    total = weight.sum(axis=0)
    return (weight * distance).sum(axis=0) / np.where(total > 0, total, 1.0)
