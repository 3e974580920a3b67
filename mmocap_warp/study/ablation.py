"""Ablations: every combination of clips, degradations of them and trackers, with one file for each.

A cell is one tracker with one seed on one clip made worse in one way. Its file is named by a hash of all that it
depends on, so that a run that was interrupted, or has cells added, tracks what is missing and nothing else.
"""

from __future__ import annotations

import hashlib
import json
import re
import socket
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import Any

from mmocap_warp.body.model import Subject
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.code_hash import code_hash
from mmocap_warp.device.resolve import device_kind
from mmocap_warp.fitting.clip_body import frames_to_follow
from mmocap_warp.fitting.subject_fit import FitConfig, fit_clip
from mmocap_warp.masks.observation import Observation
from mmocap_warp.result.evaluation import evaluate
from mmocap_warp.result.pose_errors import LOST_LIMB, common_frames, farthest
from mmocap_warp.result.result import Result
from mmocap_warp.result.truth import Truth, at_rate
from mmocap_warp.rigging.shipped import DEFAULT_BODY, load_body
from mmocap_warp.study.degradations import degraded, is_random
from mmocap_warp.study.job import solved_subject
from mmocap_warp.study.sequences import CLIP_PLANS, PLANS
from mmocap_warp.study.source import Clip, OpenClip, clip_facts, open_clip
from mmocap_warp.tracking.frame_loop import track_observations
from mmocap_warp.tracking.track_config import TrackConfig
from mmocap_warp.version import __version__
from mmocap_warp.whole_file import write_whole

TUNING: tuple[str, ...] = (*tuple(PLANS)[1::2], "S2/Spin")
"""Clips to choose settings on: of the nine sequences those of even number, and a spin."""

REPORTING: tuple[str, ...] = tuple(name for name in CLIP_PLANS if name not in TUNING)
"""Clips whose figures are reported, and on which nothing is chosen."""

STARTS: tuple[str, ...] = ("given", "solved", "first-frame", "fitted")
"""Where body and first pose come from: the clip's own subject; its pose with the body solved from the clip; or a fit of
both to the degraded masks, of the first frame alone or of the clip."""

_VERSION = 2  # of the measures; results of another version are made again
_KEY_DIGITS = 20
_FROM_EVALUATION = (
    "marker_error_mm", "mpjpe_mm", "shake_mm", "growth", "mean_iou", "worst_iou", "wrongly_tracked", "near_tracked",
    "lost", "partial", "rescued", "interpolated",
)  # fmt: skip

Track = Callable[[Subject, CameraRig, Iterable[Observation], float, TrackConfig, int], Result]
"""From a subject, undistorted cameras, the frames' masks, frames per second, settings and a seed."""


def track_with_seed(
    subject: Subject, rig: CameraRig, observations: Iterable[Observation], fps: float, settings: TrackConfig, seed: int
) -> Result:
    """One run of the tracker that the settings name."""
    return track_observations(subject, rig, observations, fps, replace(settings, seed=seed, runs=1))


@dataclass(frozen=True)
class AblationCell:
    """One point of an ablation."""

    clip: Clip  # it is tracked
    degradation: str  # as :mod:`mmocap_warp.study.degradations` writes it
    label: str  # the tracker's name in tables
    settings: TrackConfig  # the tracker's; their seed and runs do not count
    seed: int  # of the tracker, of the fit, and of the degradation where that is random
    start: str = "given"  # one of ``STARTS``

    def __post_init__(self) -> None:
        if self.start not in STARTS:
            raise ValueError(f"start must be one of {list(STARTS)}, got {self.start!r}")

    def __str__(self) -> str:
        return f"{self.clip.name} {self.degradation} {self.start} {self.label} seed {self.seed}"


def purpose(clip: Clip) -> str:
    """``tuning`` or ``reporting``; of a clip that is not made by name, unknown: an empty string."""
    return "tuning" if clip.name in TUNING else "reporting" if clip.name in REPORTING else ""


def run_ablation(
    folder: Path, cells: Sequence[AblationCell], report: Callable[[AblationCell, dict], None], track: Track
) -> list[dict[str, Any]]:
    """Track the cells whose file is missing in a folder that exists, and read the others.

    Cells of one clip that follow each other share its masks in memory. ``report`` is called with each cell and what
    :func:`measures` gave. Of each cell a file's content is returned: ``cell``, ``settings``, ``measures`` and ``made``.

    Raises:
        InputError: a clip that cannot be opened, a folder that cannot be written to.
        ValueError: a degradation that means nothing to a clip; masks that show nobody to start from.
    """
    rows = []
    for clip, of_clip in groupby(cells, key=lambda cell: cell.clip):
        identity = clip_facts(clip).identity
        takes = _Takes(clip)
        for cell in of_clip:
            path = _path(folder, cell, identity)
            if not path.exists():
                row = _tracked(cell, takes.of(cell), track)
                write_whole(path, json.dumps(row, indent=1, allow_nan=False).encode())
            rows.append(json.loads(path.read_bytes()))
            report(cell, rows[-1]["measures"])
    return rows


def measures(result: Result, truth: Truth | None) -> dict[str, float | None]:
    """The numbers of a result of one run; None where nothing defines them.

    Those of :func:`mmocap_warp.result.evaluation.evaluate` have its names. ``off_frames`` are frames with a limb's end
    or the root over 200 mm off, whatever their status says, ``longest_off`` the most of these in a row.
    """
    report = evaluate(result, truth)
    known: dict[str, float | None] = {name: report.get(name) for name in _FROM_EVALUATION}
    known |= {"off_frames": None, "longest_off": None, "ms_per_frame": 1000.0 * result.seconds / report["frames"]}
    if truth is not None:
        truth = at_rate(truth, result.fps)
        (off,) = farthest(result, truth, *common_frames(result, truth), result.joints()) > LOST_LIMB
        in_a_row = [len(list(run)) for is_off, run in groupby(off) if is_off]
        known |= {"off_frames": sum(in_a_row), "longest_off": max(in_a_row, default=0)}
    return known


class _Takes:
    """A clip's masks, made or read once, and the last degradation of them with the subjects that started from it."""

    def __init__(self, clip: Clip) -> None:
        self._clip, self._whole = clip, cache(lambda: _in_memory(open_clip(clip)))
        self._last: tuple[tuple[str, int], OpenClip, list[Observation]] | None = None
        self._started: dict[tuple[str, int], Subject] = {}

    def of(self, cell: AblationCell) -> OpenClip:
        which = cell.degradation, cell.seed if is_random(cell.degradation) else 0
        if self._last is None or self._last[0] != which:
            whole, masks = self._whole()
            self._last = None  # one in memory at a time
            self._last = which, *_in_memory(degraded(replace(whole, observations=iter(masks)), *which))
            self._started.clear()
        _, take, masks = self._last
        key = cell.start, cell.seed
        if key not in self._started:
            self._started[key] = _subject(cell, take, masks)
        return replace(take, subject=self._started[key], observations=iter(masks))


def _in_memory(clip: OpenClip) -> tuple[OpenClip, list[Observation]]:
    return clip, list(clip.observations)


def _subject(cell: AblationCell, take: OpenClip, masks: list[Observation]) -> Subject:
    """Body and first pose that a cell starts from."""
    if cell.start == "given":
        return take.subject
    if cell.start == "solved":
        return solved_subject(take, masks, cell.seed, cell.settings.device, cell.settings.threads)
    config = FitConfig(cell.seed, device=cell.settings.device, threads=cell.settings.threads)
    generic = load_body(DEFAULT_BODY)
    if cell.start == "first-frame":
        return fit_clip(generic, take.rig, take.fps, masks[:1], config)
    numbers = frames_to_follow(take.fps, take.frames)
    return fit_clip(generic, take.rig, take.fps / numbers.step, [masks[number] for number in numbers], config)


def _tracked(cell: AblationCell, take: OpenClip, track: Track) -> dict[str, Any]:
    started = datetime.now(UTC).isoformat(timespec="seconds")
    result = track(take.subject, take.rig, take.observations, take.fps, cell.settings, cell.seed)
    clip, code = cell.clip, code_hash("study.ablation")
    about: dict[str, Any] = {
        "clip": clip.name,
        "purpose": purpose(clip),
        "degradation": cell.degradation,
        "start": cell.start,
    }
    about |= {"tracker": cell.label, "seed": cell.seed, "frames": take.frames, "scale": clip.scale}
    made = {"started": started, "host": socket.gethostname(), "versions": result.versions, "code": code}
    return {"cell": about, "settings": result.config, "measures": measures(result, take.truth), "made": made}


def _path(folder: Path, cell: AblationCell, identity: str) -> Path:
    """Where a cell's file lies: a name for people, then a hash of all that it depends on."""
    settings = asdict(replace(cell.settings, seed=cell.seed, runs=1))
    kind, _ = device_kind(settings.pop("device")), settings.pop("threads")
    depends: dict[str, Any] = {
        "clip": identity,
        "degradation": cell.degradation,
        "start": cell.start,
        "settings": settings,
    }
    depends |= {"device": kind, "code": code_hash("study.ablation"), "package": __version__, "version": _VERSION}
    key = hashlib.sha256(json.dumps(depends, sort_keys=True).encode()).hexdigest()[:_KEY_DIGITS]
    name = f"{cell.clip.name}-{cell.degradation}-{cell.start}-{cell.label}-{cell.seed}"
    return folder / f"{re.sub(r'[^A-Za-z0-9.=+-]+', '_', name)}.{key}.json"
