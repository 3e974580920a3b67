"""Where to start with a body that may lie or bend any way: many ways are judged, and the best are kept."""

import numpy as np

from mmocap_warp.body.posing import Poser
from mmocap_warp.body.rotations import spread_rotations, transposed, turn, zyx_angles
from mmocap_warp.body.shape_space import ShapeSpace, heading_rotation, upright_base
from mmocap_warp.body.skeleton import ROOT_ANGLES, TRANSLATION, Skeleton
from mmocap_warp.fitting.standing_search import FirstFrame
from mmocap_warp.silhouettes.objective import Objective

_ROTATIONS = 240  # rotations of a body that may lie any way up: every one is within 40 degrees of one of them
_HEADINGS = 24  # directions that a standing body is turned to
_DRAWS = 48  # poses of a robot, whose joints may be anywhere
_AT_ONCE = 240  # candidates that are judged at a time
_SMALLEST, _LARGEST = 0.6, 1.4  # limits of a body's scale
_SAME_PLACE = 0.15  # two starts are one if no joint is farther apart, as a share of the body's size
_COMPARED = 40  # best candidates that are compared for each start that is wanted


def usual_poses(skeleton: Skeleton, any_pose: bool, seed: int) -> np.ndarray:
    """Poses (pose, coordinate) to start from: the zero pose, as near as limits let it be.

    Where joints may be anywhere within their limits (``any_pose``), as a robot's, draws follow.
    """
    low, high = np.clip(skeleton.coordinate_limits, -np.pi, np.pi).T
    poses = np.tile(np.clip(0.0, low, high), (1 + _DRAWS if any_pose else 1, 1))
    bent = skeleton.searched()[skeleton.searched() >= ROOT_ANGLES.stop]
    poses[1:, bent] = np.random.default_rng(seed).uniform(low[bent], high[bent], (len(poses) - 1, len(bent)))
    return poses


def screened_starts(space: ShapeSpace, frame: FirstFrame, hull: np.ndarray, poses: np.ndarray, most: int) -> np.ndarray:
    """The best starts (start, coordinate) of a space, each somewhere else, the best first.

    Poses (pose, coordinate) are turned about in the middle of the masks' hull (point, 3) [m]: a body that stands to all
    headings, its lowest point on the hull's; any other all ways. Unless it is rigid, its size makes silhouettes as
    large as the masks.
    """
    observation, objective = frame.observation, frame.objective(space.body, np.eye(3), _AT_ONCE, shapes=space)
    scale = np.ones(len(poses) * (_HEADINGS if space.body.skeleton.stands else _ROTATIONS))
    candidates = _turned_poses(space, poses, hull, scale)
    seen = observation.foreground > 0
    cost, area = _judged(objective, candidates, seen)
    if not space.body.rigid:
        scale = np.clip(np.sqrt(observation.foreground.sum() / np.maximum(area, 1)), _SMALLEST, _LARGEST)
        candidates = _turned_poses(space, poses, hull, scale)
        cost, _ = _judged(objective, candidates, seen)
    return _distinct(space, candidates[np.argsort(cost, kind="stable")[: _COMPARED * most]], most)


def _turned_poses(space: ShapeSpace, poses: np.ndarray, hull: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Coordinates (pose * turn, coordinate) of a scale each (pose * turn,): the skin's middle is in the hull's."""
    body, skeleton, upright = space.body, space.body.skeleton, upright_base(space.up)
    up, frame = upright[:, 1], skeleton.frame[0].astype(float)
    headings = 2 * np.pi * np.arange(_HEADINGS) / _HEADINGS
    turns = turn("y", headings) if skeleton.stands else spread_rotations(_ROTATIONS)
    own = poses.copy()
    own[:, : TRANSLATION if skeleton.stands else ROOT_ANGLES.stop] = 0.0
    skin = Poser(body, np.eye(3)).tracking_vertices(own).astype(float)
    scale = scale.reshape(len(poses), len(turns))
    turned = np.zeros((len(poses), len(turns), len(space)))
    turned[..., : skeleton.coordinates] = own[:, None]
    turned[..., space.scale_index] = np.log(scale)
    middle = scale[..., None] * np.einsum("ij,tjk,pk->pti", upright, turns, skin.mean(axis=1))
    place = np.median(hull, axis=0) - middle
    if skeleton.stands:
        turned[..., space.heading_index] = headings
        bottom = scale * skin[:, :, 1].min(axis=1)[:, None]
        place += (np.percentile(hull @ up, 0.5) - bottom - place @ up)[..., None] * up
    else:
        turned[..., ROOT_ANGLES] = zyx_angles(frame.T @ turns @ frame)
    turned[..., :TRANSLATION] = place
    return turned.reshape(-1, len(space))


def _judged(objective: Objective, candidates: np.ndarray, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(candidate,) costs, and how large the silhouettes are in the views that are ``seen`` (camera,) bool [px]."""
    judged = [objective.judged(candidates[first : first + _AT_ONCE]) for first in range(0, len(candidates), _AT_ONCE)]
    cost, count = map(np.concatenate, zip(*judged, strict=True))
    return cost, count[:, seen, 0].sum(axis=1)


def _distinct(space: ShapeSpace, candidates: np.ndarray, count: int) -> np.ndarray:
    """The first ``count`` of the candidates that are not where an earlier one is."""
    skeleton = space.body.skeleton
    near = _SAME_PLACE * float(np.ptp(space.body.skin.rest, axis=0).max())
    pose, upright = candidates[:, : skeleton.coordinates], upright_base(space.up)
    own = Poser(space.body, upright).joint_transforms(pose)[:, :, :3, 3] - pose[:, None, :TRANSLATION]
    turned = np.stack([heading_rotation(heading) for heading in candidates[:, space.heading_index]])
    own = own @ transposed(upright @ turned @ upright.T)
    place = np.exp(candidates[:, space.scale_index])[:, None, None] * own + pose[:, None, :TRANSLATION]
    kept: list[int] = []
    for number in range(len(candidates)):
        if all(np.linalg.norm(place[number] - place[other], axis=1).max() > near for other in kept):
            kept.append(number)
        if len(kept) == count:
            break
    return candidates[kept]
