"""What the masks say about a finished track: which views lie beside the body, and at which parts nobody is seen.

A verdict on the result rests on it, see :mod:`mmocap_warp.result.verdict`. Each view is asked by itself, and outlines
are matched over a wide reach, because poses are a compromise between views that disagree.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import islice

import numpy as np

from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.skeleton import TRANSLATION
from mmocap_warp.contour.frame.fitter import WIDE, OutlineMatch
from mmocap_warp.contour.frame.rooted import Neighbours, Rooting
from mmocap_warp.masks.observation import Observation
from mmocap_warp.result.result import STATUS, Result
from mmocap_warp.tracking.from_settings import make_fitter, search_limits
from mmocap_warp.tracking.track_config import TrackConfig

_FRAMES = 8  # frames that are looked at together
_MATCHED_SHARE = 0.3  # share of a view's outline that must meet a contour to tell how far the view is off
_MIN_OUTLINE = 0.1  # metres of a part's outline that a view must show to say anything about the part
_EXPOSED_SHARE = 0.5  # share of this outline deep outside of the mask, where the view contradicts the part
_CONFIRMED = 0.5  # mean square of this outline's residuals, in units of their variance, where it confirms the part


def with_evidence(result: Result, config: TrackConfig, observations: Iterable[Observation]) -> Result:
    """The result with its ``view_shift`` and ``part_doubt``, from the masks that it was tracked from."""
    body, rig = result.subject.body, result.cameras
    fitter = make_fitter(result.subject, rig, config, _FRAMES, frames=_FRAMES, matching=WIDE)
    rooting = Rooting(body.skeleton, result.subject.root_base, fitter.index, search_limits(result.subject, config))
    courses = [rooting.refold(rooting.enter(pose)) for pose in result.pose]
    # The root's depth tells how many pixels of a view a metre has.
    depth = result.pose[..., :TRANSLATION] @ rig.R[:, 2].T + rig.t[:, 2]
    px = rig.K[:, 0, 0] / np.maximum(depth, 0.1)
    shift, doubt = np.zeros(result.iou.shape), np.zeros((*result.status.shape, len(body.skeleton.parts)))
    stream, first = iter(observations), 0
    while some := list(islice(stream, _FRAMES)):
        fitter.observe_all(some)
        frames = np.arange(first, first + len(some))
        first += len(some)
        for run, course in enumerate(courses):
            match = fitter.match(frames - frames[0], course[frames], Neighbours.of(course, frames, result.rate))
            shift[run, frames] = _shift(match, px[run, frames], WIDE.reach * body.relative_size)
            doubt[run, frames] = _doubt(match, px[run, frames], body)
    repeated = result.status == STATUS.index("repeated")  # their masks are of another time
    shift[repeated], doubt[repeated] = np.nan, 0.0
    return replace(result, view_shift=shift, part_doubt=doubt)


def _shift(match: OutlineMatch, px: np.ndarray, reach: float) -> np.ndarray:
    """(pose, camera) length of the shift of each view's masks that fits them best to the body [m].

    ``reach`` where too little of the outline meets a contour, NaN where there is no outline.
    """
    residual, weight = np.moveaxis(match.weighted, -1, 0)
    matrix = np.einsum("pke,pkei,pkej->pkij", weight, match.normal, match.normal)
    pull = np.einsum("pke,pke,pkei->pki", weight, residual, match.normal)
    known = np.linalg.det(matrix) > 0
    shift = np.linalg.solve(np.where(known[..., None, None], matrix, np.eye(2)), pull[..., None])[..., 0]
    _, length, matched, _ = np.moveaxis(match.tally.sum(axis=2), -1, 0)
    metres = np.where(matched > _MATCHED_SHARE * length, np.linalg.norm(shift, axis=-1) / px, reach)
    return np.where(length > 0, np.minimum(metres, reach), np.nan)


def _doubt(match: OutlineMatch, px: np.ndarray, body: BodyModel) -> np.ndarray:
    """(pose, part) bool: two views or more show nobody there, and fewer views confirm the part."""
    part = np.array(body.skeleton.part)[body.tracking.heaviest_joint][match.vertex]
    parts, views = len(body.skeleton.parts), np.prod(px.shape)
    row = (np.arange(views).reshape(px.shape)[..., None] * parts + part).ravel()
    sums = (np.bincount(row, match.tally[..., i].ravel(), views * parts) for i in range(4))
    cost, length, _, exposed = (each.reshape(*px.shape, parts) for each in sums)
    metres = length / px[..., None]
    shown = metres > _MIN_OUTLINE * body.relative_size
    against = shown & (exposed > _EXPOSED_SHARE * metres)
    confirms = shown & (cost * WIDE.apart < _CONFIRMED * length)
    count = against.sum(axis=1)
    doubt: np.ndarray = (count >= 2) & (count > confirms.sum(axis=1))
    return doubt
