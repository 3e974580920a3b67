"""How far each view's masks lie beside the body of a finished track: a verdict rests on it.

A pose is a compromise between views that disagree, so each view is asked by itself, over a wide reach.
"""

from collections.abc import Iterable
from dataclasses import replace
from itertools import islice

import numpy as np

from mmocap_warp.body.skeleton import TRANSLATION
from mmocap_warp.contour.frame.fitter import WIDE
from mmocap_warp.contour.frame.rooted import Neighbours, Rooting
from mmocap_warp.device.resolve import resolve_device
from mmocap_warp.masks.observation import Observation
from mmocap_warp.result.result import STATUS, Result
from mmocap_warp.result.verdict import PARTS_IN_DOUBT, frames_by_name
from mmocap_warp.tracking.from_settings import make_fitter, search_limits
from mmocap_warp.tracking.track_config import TrackConfig
from mmocap_warp.tracking.uncovered import UncoveredArea, look_interval, parts_in_doubt

_FRAMES = 8  # frames that are looked at together
_NO_OVERLAP = 0.1  # overlap up to which outlines do not meet: such a view is off by the whole reach
_NEGLIGIBLE = 1e-6  # information about a shift [1/px^2]: a view with less shows nothing


def with_evidence(result: Result, config: TrackConfig, observations: Iterable[Observation]) -> Result:
    """The result with its ``view_shift``, from the masks that it was tracked from.

    Where it has no deviations, parts of the body near mask area that nothing explains are in doubt.
    """
    body, rig = result.subject.body, result.cameras
    fitter = make_fitter(result.subject, rig, config, _FRAMES, frames=_FRAMES, lens=True, matching=WIDE)
    rooting = Rooting(body.skeleton, result.subject.root_base, fitter.index, search_limits(result.subject, config))
    courses = [rooting.refold(rooting.enter(pose)) for pose in result.pose]
    # A metre at the root has so many pixels in a view.
    depth = result.pose[..., :TRANSLATION] @ rig.R[:, 2].T + rig.t[:, 2]
    px = rig.K[:, 0, 0] / np.maximum(depth, 0.1)
    centre = slice(len(fitter.index) + 1, len(fitter.index) + 3)  # the columns of a view's principal point
    shift, stream, first = np.zeros(result.iou.shape), iter(observations), 0
    looks = UncoveredArea(result.subject, rig, resolve_device(config.device)) if result.joint_sigma is None else None
    looked, areas = range(0, len(result.frame_numbers), look_interval(result.rate, final=True)), []
    while some := list(islice(stream, _FRAMES)):
        fitter.observe_all(some)
        frames = np.arange(first, first + len(some))
        first += len(some)
        for frame, seen in zip(frames.tolist(), some, strict=True):
            if looks and frame in looked:
                areas.append([each.area for each in looks.of(result.pose[:, frame], seen)])
        for run, course in enumerate(courses):
            neighbours = Neighbours.of(course, frames, result.rate)
            views = fitter.linearise_views(frames - frames[0], course[frames], neighbours)
            by_place = px[run, frames][..., None, None] * rig.R[:, :2]
            moved = _shift(views.matrix[..., centre, centre], views.gradient[..., centre], by_place)
            shift[run, frames] = moved / px[run, frames]
    reach = WIDE.reach * body.relative_size
    shift = np.where(result.iou < _NO_OVERLAP, reach, np.minimum(shift, reach))
    shift[result.status == STATUS.index("repeated")] = np.nan  # their masks are of another time
    judged = _with_doubts(result, np.array(looked), np.array(areas)) if looks else result
    return replace(judged, view_shift=shift)


def _with_doubts(result: Result, looked: np.ndarray, area: np.ndarray) -> Result:
    """The result, whose frames are ``partial`` where area (look, run, part) [m^2] puts a part of the body in doubt."""
    skeleton, size = result.subject.body.skeleton, result.subject.body.relative_size
    given = size, result.rate, looked
    runs = [parts_in_doubt(*given, of_run, len(result.frame_numbers), may_lack=False) for of_run in area.swapaxes(0, 1)]
    doubt, good = np.array(runs), [STATUS.index(name) for name in ("tracked", "rescued")]
    status = np.where(doubt.any(axis=2) & np.isin(result.status, good), STATUS.index("partial"), result.status)
    named = frames_by_name(result, doubt[result.best_run], skeleton.parts)
    return replace(result, status=status.astype(result.status.dtype), config=result.config | {PARTS_IN_DOUBT: named})


def _shift(matrix: np.ndarray, pull: np.ndarray, by_place: np.ndarray) -> np.ndarray:
    """(pose, camera) length of the shift of each view's masks that fits them best to the body [px]; NaN if unknown.

    What puts the body into another place in all views does not count: it is no camera's fault. ``matrix @ shift =
    pull`` are the normal equations of each image, which follows the body's place by ``by_place`` (..., 2, 3) [px/m].
    """
    across = np.swapaxes(by_place, 2, 3)
    of_place = (across @ matrix @ by_place).sum(axis=1) + _NEGLIGIBLE * np.eye(3)
    place = np.linalg.solve(of_place, (across @ pull[..., None]).sum(axis=1))
    rest = pull[..., None] - matrix @ by_place @ place[:, None]
    known = np.linalg.eigvalsh(matrix)[..., 0] > _NEGLIGIBLE
    shift = np.linalg.solve(np.where(known[..., None, None], matrix, np.eye(2)), rest)[..., 0]
    return np.where(known, np.linalg.norm(shift, axis=-1), np.nan)
