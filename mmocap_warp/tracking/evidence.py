"""How far each view's masks lie beside the body of a finished track: a verdict rests on it.

A pose is a compromise between views that disagree, so each view is asked by itself, over a wide reach.
"""

from collections.abc import Iterable
from dataclasses import replace
from itertools import islice
from typing import Any

import numpy as np

from mmocap_warp.body.model import Subject
from mmocap_warp.body.skeleton import TRANSLATION
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.contour.frame.fitter import WIDE, ContourFitter
from mmocap_warp.contour.frame.rooted import Neighbours, RootedPoses, Rooting
from mmocap_warp.device.resolve import resolve_device
from mmocap_warp.masks.observation import Observation
from mmocap_warp.result.result import STATUS, Result
from mmocap_warp.result.verdict import PARTS_IN_DOUBT, frames_by_name
from mmocap_warp.tracking.from_settings import make_fitter, search_limits
from mmocap_warp.tracking.track_config import TrackConfig
from mmocap_warp.tracking.uncovered import UncoveredArea, look_interval, parts_in_doubt

FRAMES_TOGETHER = 8  # frames that are looked at together
_NO_OVERLAP = 0.1  # overlap up to which outlines do not meet: such a view is off by the whole reach
_NEGLIGIBLE = 1e-6  # information about a shift [1/px^2]: a view with less shows nothing


class ViewShifts:
    """Measures how far the masks of each view lie beside posed bodies.

    Attributes:
        fitter: what compares outlines with masks; with those of another fitter, if it is made ``like`` that.
    """

    def __init__(
        self, subject: Subject, rig: CameraRig, config: TrackConfig, like: ContourFitter | None = None
    ) -> None:
        wide: dict[str, Any] = {"frames": FRAMES_TOGETHER, "lens": True, "matching": WIDE, "like": like}
        self.fitter, self._rig = make_fitter(subject, rig, config, FRAMES_TOGETHER, **wide), rig
        self._reach = WIDE.reach * subject.body.relative_size

    def of(self, places: np.ndarray, rooted: RootedPoses, root: np.ndarray, neighbours: Neighbours) -> np.ndarray:
        """(pose, camera) shifts [m] of the frames in places (pose,), of bodies whose ``root`` is at (pose, 3)."""
        rig, first = self._rig, len(self.fitter.index) + 1
        views = self.fitter.linearise_views(places, rooted, neighbours)
        # A metre at the root has so many pixels in a view.
        px = rig.K[:, 0, 0] / np.maximum(root @ rig.R[:, 2].T + rig.t[:, 2], 0.1)
        centre = slice(first, first + 2)  # the columns of a view's principal point
        by_place = px[..., None, None] * rig.R[:, :2]
        return np.asarray(_shift(views.matrix[..., centre, centre], views.gradient[..., centre], by_place) / px)

    def limited(self, shift: np.ndarray, iou: np.ndarray, status: np.ndarray) -> np.ndarray:
        """Shifts (run, frame, camera) as a result has them, with overlaps and statuses."""
        shift = np.where(iou < _NO_OVERLAP, self._reach, np.minimum(shift, self._reach))
        shift[status == STATUS.index("repeated")] = np.nan  # their masks are of another time
        return shift


def with_evidence(result: Result, config: TrackConfig, observations: Iterable[Observation]) -> Result:
    """A result that is not smoothed, with its ``view_shift`` and doubts, from the masks that it was tracked from.

    It has no deviations: parts of the body near mask area that nothing explains are in doubt.
    """
    subject, rig = result.subject, result.cameras
    shifts = ViewShifts(subject, rig, config)
    rooting = Rooting(subject.body.skeleton, subject.root_base, shifts.fitter.index, search_limits(subject, config))
    courses = [rooting.refold(rooting.enter(pose)) for pose in result.pose]
    shift, stream, first = np.zeros(result.iou.shape), iter(observations), 0
    looks = UncoveredArea(subject, rig, resolve_device(config.device))
    looked, areas = range(0, len(result.frame_numbers), look_interval(result.rate, final=True)), []
    while some := list(islice(stream, FRAMES_TOGETHER)):
        shifts.fitter.observe_all(some)
        frames = np.arange(first, first + len(some))
        first += len(some)
        for frame, seen in zip(frames.tolist(), some, strict=True):
            if frame in looked:
                areas.append([each.area for each in looks.of(result.pose[:, frame], seen, shadows=False)])
        for run, course in enumerate(courses):
            root, neighbours = result.pose[run, frames, :TRANSLATION], Neighbours.of(course, frames, result.rate)
            shift[run, frames] = shifts.of(frames - frames[0], course[frames], root, neighbours)
    judged = _with_doubts(result, np.array(looked), np.array(areas))
    return replace(judged, view_shift=shifts.limited(shift, result.iou, result.status))


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
