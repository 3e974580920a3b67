"""What a study's cells come down to: jobs, their files, and how much work each is."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from mmocap_warp.study.cell import Cell
from mmocap_warp.study.code_hash import code_hash
from mmocap_warp.study.definition import Study
from mmocap_warp.study.job import Job
from mmocap_warp.study.source import clip_facts
from mmocap_warp.study.store import content_key, result_path


@dataclass(frozen=True)
class Task:
    """A cell to be tracked.

    Attributes:
        job: what a worker is given.
        path: where the result goes.
        frames: of the clip.
    """

    job: Job
    path: Path
    frames: int

    @property
    def cell(self) -> Cell:
        """Which one."""
        return self.job.cell

    @property
    def evaluations(self) -> int:
        """At most, all frames and runs together."""
        return self.frames * self.job.config.budget * self.job.config.runs


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
        job = Job(plan.cell, plan.clip, identity, plan.config, study.name, code_hash())
        tasks.append(Task(job, result_path(folder, plan.cell, key), frames))
    return tasks
