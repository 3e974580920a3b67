"""Where a subject stands, how tall it is and which way it may face: a short search from each of several headings."""

from dataclasses import dataclass

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


@dataclass(frozen=True, eq=False)
class FirstFrame:
    """The frame that a fit begins with, and how the work on it is done."""

    rig: CameraRig  # undistorted cameras at the masks' size
    observation: Observation  # the masks
    seed: int = 0  # of the random numbers
    device: str = "cpu"  # a Warp device
    threads: int = 1  # CPU threads

    def objective(
        self, body: BodyModel, root_base: np.ndarray, candidates: int, shapes: ShapeSpace | None = None
    ) -> Objective:
        """Judges candidates against the masks."""
        objective = Objective(
            body, root_base, self.rig, candidates,
            renderer="raster", shapes=shapes, device=self.device, threads=self.threads,
        )  # fmt: skip
        objective.observe(self.observation)
        return objective


def subject_hull(body: BodyModel, frame: FirstFrame) -> np.ndarray:
    """(point, 3) the visual hull of what may be a body [m]; a NoSubjectError without two views of one subject."""
    spacing = _VOXEL * body.relative_size
    for tolerate in (0, 1):
        hull = visual_hull(frame.rig, frame.observation, spacing=spacing, tolerate=tolerate)
        if len(hull) >= _LEAST_POINTS:
            return hull
    raise NoSubjectError("no point in space lies in the silhouettes of two or more cameras")


def standing_start(space: ShapeSpace, frame: FirstFrame, *, scaled: bool = True) -> np.ndarray:
    """Coordinates of the rest pose where the visual hull stands, ``scaled`` to its height unless the body is rigid.

    Raises:
        NoSubjectError: fewer than two views see the subject, or they see different things.
    """
    hull = subject_hull(space.body, frame)
    up = upright_base(frame.rig.up)[:, 1]
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
    space: ShapeSpace, frame: FirstFrame, start: np.ndarray, headings: int, evaluations: int
) -> np.ndarray:
    """Fit evenly spread headings of a start (coordinate,), each on its own, as :func:`search_starts` does."""
    starts = np.repeat(start[None], headings, axis=0)
    starts[:, space.heading_index] = 2 * np.pi * np.arange(headings) / headings
    return search_starts(space, frame, starts, evaluations)


def search_starts(
    space: ShapeSpace, frame: FirstFrame, starts: np.ndarray, evaluations: int, *, near_rest: bool = True
) -> np.ndarray:
    """Fit starts (start, coordinate), each on its own: pose, shape and scale at once, with CMA-ES; float32.

    Each may spend so many evaluations. A prior on the pose holds elbows and knees the right way round if they are to be
    ``near_rest``; else joints may be anywhere.
    """
    skeleton, count = space.body.skeleton, len(starts)
    searched = np.concatenate([skeleton.searched(), space.shape_index])
    seeds = wp.array(frame.seed + np.arange(count), dtype=wp.int32, device=frame.device)
    counter = wp.zeros(count, dtype=wp.int32, device=frame.device)
    spread = _spread(space)
    optimizer = CmaEs(make_space(searched, spread[searched], seeds, counter), evaluations, CmaEsConfig(_POPULATION))
    objective = frame.objective(space.body, upright_base(space.up), count * optimizer.particles, shapes=space)
    prior = _prior(space, spread)
    if not near_rest:
        prior[ROOT_ANGLES.stop : skeleton.coordinates] = 0.0
    objective.prior.assign(prior)
    search = Search(objective, [optimizer], evaluations, space.limits(skeleton.coordinate_limits))
    search.best_pose.assign(starts.astype(np.float32))
    search.run()
    return np.asarray(search.best_pose.numpy().copy())


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
