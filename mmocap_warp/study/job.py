"""A cell as work: what a worker is given, and how it is tracked."""

import re
import socket
import time
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime

import numpy as np

from mmocap_warp.body.model import Subject
from mmocap_warp.code_hash import code_hash
from mmocap_warp.device.resolve import device_kind, resolve_device
from mmocap_warp.errors import InputError
from mmocap_warp.jobs.engine import LESS_MEMORY, Advance, Refusal
from mmocap_warp.masks.observation import Observation
from mmocap_warp.result.result import FrameAnswer
from mmocap_warp.study.cell import Cell, CellResult
from mmocap_warp.study.metrics import measure
from mmocap_warp.study.source import Clip, OpenClip, clip_facts, open_clip
from mmocap_warp.tracking.frame_loop import collect, track_frames
from mmocap_warp.tracking.from_settings import in_own_unit
from mmocap_warp.tracking.make_tracker import make_tracker
from mmocap_warp.tracking.smoothing import smoothed
from mmocap_warp.tracking.track_config import TrackConfig

_SECONDS_BETWEEN_REPORTS = 0.5
_SAME = "give all machines the same files and version; if they have changed since, run the study again"


@dataclass(frozen=True)
class Job:
    """A cell to be tracked."""

    cell: Cell  # which one
    clip: Clip  # what is tracked
    clip_identity: str  # of the clip where the study was started; a worker that finds another one refuses
    config: TrackConfig  # settings; device and threads are the worker's
    study: str  # the study's name
    code: str  # hash of the code where the study was started; a worker that runs other code refuses
    solved: bool = False  # whether the body is solved from the clip, instead of taken as given


class Worker:
    """Tracks one job after the other on one device; keeps the masks of the clip it tracked last."""

    def __init__(self, device: str, threads: int | None = None) -> None:
        self.device, self.threads = resolve_device(device), threads
        self._opened: tuple[Clip, OpenClip] | None = None
        self._observations: list[Observation] = []
        self._solved: tuple[tuple[Clip, int], Subject] | None = None

    def work(self, job: Job) -> Iterator[Advance | CellResult | Refusal]:
        """Do a job: yields now and then how far it is, and last the result, or why there is none."""
        try:
            yield from self._work(job)
        except InputError as error:
            yield Refusal(str(error))
        except (MemoryError, RuntimeError) as error:
            # Warp has no exception of its own for it.
            if isinstance(error, RuntimeError) and not re.search("Failed to allocate|out of memory", str(error)):
                raise
            self._opened, self._observations, self._solved = None, [], None  # the masks may be what took it
            reason = " ".join(str(error).split()) or "MemoryError"
            yield Refusal(f"{self.device}: memory ran out ({reason}); {LESS_MEMORY}")

    def _work(self, job: Job) -> Iterator[Advance | CellResult]:
        if job.code != code_of(job.config, job.clip, job.solved):
            raise InputError(socket.gethostname(), "runs other code than the study was started with", _SAME)
        started, begun = datetime.now(UTC).isoformat(timespec="seconds"), time.perf_counter()
        clip = yield from self._open(job)
        config = replace(job.config, device=self.device, threads=self.threads, renderer="raster")
        if job.solved:
            clip = replace(clip, subject=self._solve(job, clip))
        answers: list[FrameAnswer] = []
        total, evaluations, pace = len(self._observations), 0, _Pace()
        subject, rig, own = in_own_unit(clip.subject, clip.rig, config)
        for answer in track_frames(make_tracker(subject, rig, own, clip.fps), self._observations):
            answers.append(answer)
            evaluations += answer.evaluations * config.runs
            if pace.due():
                yield Advance("search", len(answers), total, evaluations)
        tracked = collect(subject, rig, clip.fps, own, answers)
        if config.acceleration:
            tracked = smoothed(tracked, own, self._observations)
        tracked = replace(tracked.in_unit(1 / clip.subject.body.unit), subject=clip.subject, cameras=clip.rig)
        meta = {
            "fps": clip.fps,
            "cameras": list(clip.rig.names),
            "size": clip.rig.size.tolist(),
            "config": {name: value for name, value in tracked.config.items() if name not in ("device", "threads")},
            "device": device_kind(self.device),
            "versions": tracked.versions,
            "clip": job.clip_identity,
            "code": job.code,
            "code_covers": _covered(job.config, job.clip, job.solved),
            "host": socket.gethostname(),
            "started": started,
            "study": job.study,
        }
        seeds = np.arange(config.seed, config.seed + config.runs, dtype=np.int64)
        numbers, per_frame, per_run = tracked.frame_numbers.astype(np.int64), *measure(tracked, clip.truth)
        meta["wall_seconds"] = time.perf_counter() - begun
        yield CellResult(job.cell, seeds, numbers, per_frame, per_run, tracked.pose.astype(np.float32), meta)

    def _solve(self, job: Job, clip: OpenClip) -> Subject:
        """The clip's subject with its body solved, once for all runs and for all trackers of the same first seed."""
        wanted = job.clip, job.config.seed
        if self._solved is None or self._solved[0] != wanted:
            subject = solved_subject(clip, self._observations, job.config.seed, self.device, self.threads)
            self._solved = wanted, subject
        return self._solved[1]

    def _open(self, job: Job) -> Generator[Advance, None, OpenClip]:
        """The job's clip with its masks in memory, where the last job's may be already."""
        if self._opened is None or self._opened[0] != job.clip:
            self._opened, self._observations = None, []
            if clip_facts(job.clip).identity != job.clip_identity:
                problem = f"{job.clip.name} is not the same here as where the study was started"
                raise InputError(socket.gethostname(), problem, _SAME)
            clip, pace = open_clip(job.clip), _Pace()
            for observation in clip.observations:
                self._observations.append(observation)
                if pace.due():
                    yield Advance("masks", len(self._observations), clip.frames, 0)
            self._opened = job.clip, clip
        return self._opened[1]


def solved_subject(clip: OpenClip, seen: Sequence[Observation], seed: int, device: str, threads: int | None) -> Subject:
    """A clip's subject in its first pose, with the body that is ``seen`` in frames of the clip's beginning.

    ``seed``, ``device`` and ``threads`` are of the tracker that follows the subject through these frames.
    """
    from mmocap_warp.fitting.clip_body import frames_to_follow, solve_body_in_clip
    from mmocap_warp.fitting.subject_fit import FitConfig
    from mmocap_warp.rigging.shipped import DEFAULT_BODY, load_body

    numbers = frames_to_follow(clip.fps, len(seen))
    followed = [seen[number] for number in numbers]
    following = TrackConfig(seed=seed, device=device, threads=threads)
    generic, fps = load_body(DEFAULT_BODY), clip.fps / numbers.step
    return solve_body_in_clip(clip.subject, generic, clip.rig, followed, fps, FitConfig().frames, following).subject


def code_of(config: TrackConfig, clip: Clip, solved: bool) -> str:
    """Hash of the code that a cell's result depends on."""
    return code_hash("study.job", **_covered(config, clip, solved))


def _covered(config: TrackConfig, clip: Clip, solved: bool) -> dict[str, bool]:
    """What a cell's code includes, see :func:`mmocap_warp.code_hash.code_hash`."""
    return {"contours": config.fits_contours or config.acceleration > 0 or solved, "recorded": clip.scene is not None}


class _Pace:
    """Says when the next report is due."""

    _next = 0.0

    def due(self) -> bool:
        is_due = (now := time.monotonic()) >= self._next
        self._next = now + _SECONDS_BETWEEN_REPORTS if is_due else self._next
        return is_due
