"""What a study's cells come down to: jobs, their files, and how much work each is."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from mmocap_warp.study.cell import Cell
from mmocap_warp.study.definition import Study
from mmocap_warp.study.job import Job, code_of
from mmocap_warp.study.source import clip_facts
from mmocap_warp.study.store import content_key, result_path

_CONTOURS = 500  # evaluations that a frame's contours take as long as, the clip's smoothing included, about


@dataclass(frozen=True)
class Task:
    """A cell to be tracked."""

    job: Job  # what a worker is given
    path: Path  # where the result goes
    frames: int  # of the clip
    grid: int = 0  # number of the study's grid; those of an earlier one come first

    @property
    def cell(self) -> Cell:
        """Which one."""
        return self.job.cell

    @property
    def evaluations(self) -> int:
        """At most, all frames and runs together."""
        return self.frames * self.job.config.budget * self.job.config.runs

    @property
    def work(self) -> int:
        """What it takes, in evaluations; a frame that is fitted by contours counts as a small search."""
        config = self.job.config
        return self.frames * config.runs * (config.budget + _CONTOURS * config.fits_contours)


def plan_tasks(study: Study, folder: Path, device_kind: str) -> list[Task]:
    """Every cell of a study with its file in ``folder``, for results of a kind of device (``cpu`` or ``cuda``).

    Raises:
        InputError: a sequence that does not exist or is wrong.
    """
    facts = {clip: clip_facts(clip) for clip in study.clips}
    tasks = []
    for plan in study.plans:
        identity, frames = facts[plan.clip].identity, facts[plan.clip].frames
        key = content_key(plan, identity, device_kind)
        code = code_of(plan.config, plan.clip, plan.solved)
        job = Job(plan.cell, plan.clip, identity, plan.config, study.name, code, plan.solved)
        tasks.append(Task(job, result_path(folder, plan.cell, key), frames, plan.grid))
    return tasks
