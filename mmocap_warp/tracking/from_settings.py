"""What a tracking run's settings make of a subject and cameras: limits, an objective, a fitter of contours."""

from typing import Any

import numpy as np

from mmocap_warp.body.model import Subject
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.contour.frame.fitter import ContourFitter
from mmocap_warp.device.cores import available_threads
from mmocap_warp.device.resolve import resolve_device
from mmocap_warp.silhouettes.objective import Objective
from mmocap_warp.tracking.track_config import TrackConfig


def in_own_unit(subject: Subject, rig: CameraRig, config: TrackConfig) -> tuple[Subject, CameraRig, TrackConfig]:
    """All three in the unit of length in which the body is searched for."""
    unit = subject.body.unit
    return subject.in_unit(unit), rig.in_unit(unit), config.in_unit(unit)


def search_limits(subject: Subject, config: TrackConfig) -> np.ndarray:
    """(coordinate, 2) lowest and highest values that a search keeps to."""
    skeleton = subject.body.skeleton
    return skeleton.coordinate_limits if config.limits else np.tile([-np.inf, np.inf], (skeleton.coordinates, 1))


def make_objective(subject: Subject, rig: CameraRig, config: TrackConfig, candidates: int, bases: int = 1) -> Objective:
    """An objective of a run's settings for so many candidates, which share ``bases`` evenly.

    Where contours are fitted it draws with the renderer that is faster everywhere: no result depends on that.
    """
    renderer = "raster" if config.fits_contours else config.renderer
    return Objective(
        subject.body, subject.root_base, rig, candidates,
        cost=config.cost, renderer=renderer, bases=bases, **_machine(config),
    )  # fmt: skip


def make_fitter(subject: Subject, rig: CameraRig, config: TrackConfig, candidates: int, **others: Any) -> ContourFitter:
    """A fitter of contours by a run's settings; ``others`` are arguments of :class:`ContourFitter`."""
    index, limits = subject.body.skeleton.searched(config.dof), search_limits(subject, config)
    return ContourFitter(subject.body, rig, index, limits, candidates=candidates, **_machine(config), **others)


def _machine(config: TrackConfig) -> dict[str, Any]:
    """Where the work is done."""
    return {"device": resolve_device(config.device), "threads": config.threads or available_threads()}
