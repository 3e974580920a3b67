"""Where a subject stands, how tall it is and which way it may face: a short search from each of several headings."""

from __future__ import annotations

import numpy as np
import warp as wp

from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.shape_space import ShapeSpace, upright_base
from mmocap_warp.body.skeleton import ROOT_ANGLES, TRANSLATION
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.kernels.optimizers.populations import make_space
from mmocap_warp.masks.observation import Observation
from mmocap_warp.masks.visual_hull import visual_hull
from mmocap_warp.optimizers.cma_es import CmaEs, CmaEsConfig
from mmocap_warp.optimizers.search import Search
from mmocap_warp.silhouettes.objective import Objective

_VOXEL = 0.03  # distance between the points of the visual hull [m]
_SPREAD_TRANSLATION = 0.10  # standard deviation of the place at the start of the search [m]
_SPREAD_SLIDER = 0.3  # the same of a shape's slider
_SPREAD_SCALE = 0.05  # the same of the logarithm of the scale
_POSE_PRIOR = 0.001  # pull to the rest pose, per squared standard deviation of an angle
_SHAPE_PRIOR = 0.003  # pull to the starting body, per squared slider
_POPULATION = 24  # CMA-ES's candidates of a generation
_LEAST_POINTS = 100  # a visual hull of fewer points shows no body


class NoSubjectError(ValueError):
    """The masks do not show one subject."""


def subject_hull(body: BodyModel, rig: CameraRig, observation: Observation) -> np.ndarray:
    """(point, 3) the visual hull of what may be a body [m].

    Raises:
        NoSubjectError: fewer than two views see the subject, or they see different things.
    """
    spacing = _VOXEL * body.relative_size
    hull = visual_hull(rig, observation, spacing=spacing)
    if len(hull) < _LEAST_POINTS:
        hull = visual_hull(rig, observation, spacing=spacing, tolerate=1)
    if len(hull) < _LEAST_POINTS:
        raise NoSubjectError("the silhouettes of at least two views do not meet anywhere in space")
    return hull


def standing_start(space: ShapeSpace, rig: CameraRig, observation: Observation, *, scaled: bool = True) -> np.ndarray:
    """Coordinates of the rest pose where the visual hull stands, ``scaled`` to its height unless the body is rigid.

    Raises:
        NoSubjectError: fewer than two views see the subject, or they see different things.
    """
    hull = subject_hull(space.body, rig, observation)
    up = upright_base(rig.up)[:, 1]
    low, high = np.percentile(hull @ up, [0.5, 99.5])
    body = space.body
    height = body.skin.rest[body.own_vertex, 1]
    scale = 1.0 if body.rigid or not scaled else np.clip((high - low) / np.ptp(height), 0.6, 1.4)
    centre = np.median(hull, axis=0)
    coordinates = np.zeros(len(space))
    root_height = low + scale * (body.joint_rest[0, 1] - height.min())
    coordinates[:3] = centre + (root_height - centre @ up) * up
    coordinates[space.scale_index] = np.log(scale)
    return coordinates


def search_headings(
    space: ShapeSpace,
    rig: CameraRig,
    observation: Observation,
    start: np.ndarray,
    *,
    headings: int,
    evaluations: int,
    seed: int,
    device: str,
    threads: int,
) -> np.ndarray:
    """Fit evenly spread headings, each on its own, as :func:`search_starts` does.

    Args:
        start: (coordinate,) as :func:`standing_start` finds them.
        headings: how many.
    """
    starts = np.repeat(start[None], headings, axis=0)
    starts[:, space.heading_index] = 2 * np.pi * np.arange(headings) / headings
    return search_starts(
        space, rig, observation, starts, evaluations=evaluations, seed=seed, device=device, threads=threads
    )


def search_starts(
    space: ShapeSpace,
    rig: CameraRig,
    observation: Observation,
    starts: np.ndarray,
    *,
    near_rest: bool = True,
    evaluations: int,
    seed: int,
    device: str,
    threads: int,
) -> np.ndarray:
    """Fit starts, each on its own: pose, shape and scale at once, with CMA-ES.

    A prior on the pose holds elbows and knees the right way round.

    Args:
        space: the coordinates.
        rig: undistorted cameras at the masks' size.
        observation: the masks.
        starts: (start, coordinate).
        near_rest: whether the prior on the pose is on; without, joints may be anywhere.
        evaluations: spent on each.
        seed: of the first start's random numbers.
        device: a Warp device.
        threads: CPU threads.

    Returns:
        Coordinates (start, coordinate) float32.
    """
    skeleton, count = space.body.skeleton, len(starts)
    searched = np.concatenate([skeleton.searched(), space.shape_index])
    seeds = wp.array(seed + np.arange(count), dtype=wp.int32, device=device)
    counter = wp.zeros(count, dtype=wp.int32, device=device)
    spread = _spread(space)
    optimizer = CmaEs(make_space(searched, spread[searched], seeds, counter), evaluations, CmaEsConfig(_POPULATION))
    objective = Objective(
        space.body,
        upright_base(space.up),
        rig,
        count * optimizer.particles,
        renderer="raster",
        shapes=space,
        device=device,
        threads=threads,
    )
    objective.observe(observation)
    prior = _prior(space, spread)
    if not near_rest:
        prior[ROOT_ANGLES.stop : skeleton.coordinates] = 0.0
    objective.prior.assign(prior)
    search = Search(objective, [optimizer], evaluations, space.limits(skeleton.coordinate_limits))
    search.best_pose.assign(starts.astype(np.float32))
    search.run()
    found: np.ndarray = search.best_pose.numpy().copy()
    return found


def _spread(space: ShapeSpace) -> np.ndarray:
    """(coordinate,) how far each may be from the start: the scale of the search and of the prior."""
    skeleton = space.body.skeleton
    spread = np.full(len(space), np.inf)  # the heading's is not used
    spread[:TRANSLATION] = _SPREAD_TRANSLATION * space.body.relative_size
    spread[TRANSLATION : skeleton.coordinates] = np.repeat(skeleton.spread, 3)
    spread[space.slider_index] = _SPREAD_SLIDER
    spread[space.scale_index] = _SPREAD_SCALE
    return spread


def _prior(space: ShapeSpace, spread: np.ndarray) -> np.ndarray:
    """(coordinate,) quadratic pull: to the rest pose in units of the spread, and to the starting shape."""
    prior = np.zeros(len(space))
    angles = slice(TRANSLATION, space.body.skeleton.coordinates)
    prior[angles] = _POSE_PRIOR / spread[angles] ** 2
    if not space.body.skeleton.stands:
        prior[ROOT_ANGLES] = 0.0
    prior[space.slider_index] = _SHAPE_PRIOR
    return prior
