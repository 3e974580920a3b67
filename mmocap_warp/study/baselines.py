"""What no tracker should fall behind: a body that stands still, and one that goes on as it began.

Both are judged as every tracked run is, over the same frames. They look at no mask, so that of them fitness and overlap
are unknown.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mmocap_warp.body.model import Subject
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.result.result import STATUS, Result
from mmocap_warp.result.truth import Truth
from mmocap_warp.study.cell import Cell, CellResult
from mmocap_warp.study.metrics import measure
from mmocap_warp.study.source import Clip, OpenClip, clip_facts, open_clip
from mmocap_warp.study.summary import CellSummary, StudySummary, summarise

_FIRST_STEP = 0.3  # how far the first frame's search may take the root [m]


def baselines(study: StudySummary, clips: Mapping[str, Clip]) -> dict[tuple[str, str], CellSummary]:
    """What each baseline scores on each clip that is at hand and has truth, by sequence and baseline.

    - ``stands-still``: the start pose throughout.
    - ``constant-velocity``: from the start pose on, every coordinate goes on at the speed that it truly has between the
      first two frames. Known only where the truth has poses of a body with the same joints and axes.

    Raises:
        InputError: a clip that cannot be opened.
    """
    found = {}
    for name, clip in clips.items():
        cells = [summary for cell, summary in study.cells.items() if cell.sequence == name]
        if not cells:
            continue
        longest = max(cells, key=lambda cell: len(cell.frames))
        opened = open_clip(replace(clip, frames=len(longest.frames)))
        if opened.truth is None or not is_of(longest, clip, opened.subject, opened.rig):
            continue
        still = np.repeat(opened.subject.pose[None], opened.frames, axis=0)
        poses = {"stands-still": still}
        velocity = _first_velocity(opened, opened.truth)
        if velocity is not None:
            poses["constant-velocity"] = still + np.arange(opened.frames)[:, None] * velocity
        found |= {(name, which): summarise(_judged(name, which, opened, pose)) for which, pose in poses.items()}
    return found


def is_of(cell: CellSummary, clip: Clip, subject: Subject, rig: CameraRig) -> bool:
    """Whether a result is of this recording, not of another of the same name: the body starts where it says."""
    tracked = cell.meta.get("clip")  # results of before December 2026 do not say
    if tracked and tracked != clip_facts(replace(clip, frames=len(cell.frames))).identity:
        return False
    start = cell.typical_pose[0, :3] - subject.pose[:3]
    return list(rig.names) == cell.meta.get("cameras") and float(np.linalg.norm(start)) < _FIRST_STEP


def _first_velocity(opened: OpenClip, truth: Truth) -> np.ndarray | None:
    """(coordinate,) of the true pose from frame 0 to frame 1; None where that is unknown."""
    subject = opened.subject
    if truth.pose is None or truth.root_base is None or truth.frame_numbers[:2].tolist() != [0, 1]:
        return None
    if truth.pose.shape[1] != len(subject.pose) or not np.allclose(truth.root_base, subject.root_base, atol=1e-6):
        return None
    return truth.pose[1] - truth.pose[0]


def _judged(sequence: str, name: str, opened: OpenClip, pose: np.ndarray) -> CellResult:
    numbers, unknown = np.arange(len(pose)), np.full((1, len(pose)), np.nan)
    views = np.full((1, len(pose), len(opened.rig)), np.nan)
    spent, status = np.zeros((1, len(pose)), np.int64), np.full((1, len(pose)), STATUS.index("tracked"), np.int8)
    of, seed = (opened.subject, opened.rig, opened.fps, numbers, pose[None]), {"seed": 0}
    result = Result(*of, unknown, views, evaluations=spent, status=status, seconds=0.0, config=seed, versions={})
    measured, place = measure(result, opened.truth), result.pose.astype(np.float32)
    meta = {"fps": opened.fps, "cameras": list(opened.rig.names), "size": opened.rig.size.tolist()}
    return CellResult(Cell(sequence, name, 0, 0), np.zeros(1, np.int64), numbers, *measured, place, meta)
