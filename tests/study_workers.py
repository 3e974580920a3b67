"""Workers and engines that misbehave on purpose."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import cv2
import numpy as np

from mmocap_warp.jobs.engine import Advance, Death, EngineLost, Event, Ready, Refusal
from mmocap_warp.jobs.local_engine import serve_jobs
from mmocap_warp.study.cell import Cell, CellResult
from mmocap_warp.study.job import Job, Worker

PER_FRAME = ("eq20_as_printed", "marker_error", "joint_error", "mpjpe", "pa_mpjpe", "iou")
PER_RUN = ("shake", "growth", "jerk", "foot_slide", "frames_lost", "seconds", "evaluations")
DYING_ALWAYS, DYING_ONCE, FAILING = "always", "once", "failing"


def serve_and_die_once(mark: Path, connection, device, threads) -> None:
    """A worker that the system kills amid its third cell, unless there is a mark that this has happened before."""
    work, done = Worker.work, []

    def working(worker, job):
        done.append(job)
        for event in work(worker, job):
            if len(done) == 3 and not mark.exists():
                mark.touch()
                os.kill(os.getpid(), signal.SIGKILL)
            yield event

    Worker.work = working
    serve_jobs(Worker, connection, device, threads)


def serve_and_be_killed(connection, device, threads) -> None:
    """A worker that makes up results, and that the system kills whenever PSO is to be tracked."""
    connection.send(Ready(device))
    while True:
        job = connection.recv()
        if job.cell.algorithm == "pso":
            os.kill(os.getpid(), signal.SIGKILL)
        connection.send(made_up(job))


class ThreadCounter:
    """Refuses a job with the number of threads that OpenCV has here."""

    def __init__(self, device: str, threads: int | None) -> None:
        pass

    def work(self, job):
        yield Refusal(str(cv2.getNumThreads()))


class DirectEngine:
    """Tracks in this process, which spares the start of another."""

    def __init__(self) -> None:
        self._worker, self._waiting = Worker("cpu", 1), [iter([Ready("cpu")])]

    def submit(self, worker: int, job: Job) -> None:
        self._waiting.append(self._worker.work(job))

    def events(self, seconds: float) -> list[tuple[int, Event]]:
        events = [(0, event) for each in self._waiting for event in each]
        self._waiting = []
        return events

    def close(self) -> None:
        pass


class ScriptedEngine:
    """Makes up results at once, or does what the script says of a cell.

    Args:
        workers: how many.
        script: by cell, ``DYING_ALWAYS``, ``DYING_ONCE`` or ``FAILING``.
        vanishes_after: so many results.
    """

    def __init__(self, workers: int, script: dict[Cell, str], vanishes_after: int | None = None) -> None:
        self._script, self._left = dict(script), vanishes_after
        self._told: list[tuple[int, Event]] = [(worker, Ready(f"seat {worker}")) for worker in range(workers)]
        self.given: list[tuple[int, Job]] = []
        self.closed = False

    @property
    def submitted(self) -> list[Job]:
        return [job for _, job in self.given]

    def submit(self, worker: int, job: Job) -> None:
        self.given.append((worker, job))
        fate = self._script.get(job.cell)
        if fate in (DYING_ALWAYS, DYING_ONCE):
            if fate == DYING_ONCE:
                del self._script[job.cell]
            self._told += [(worker, Death("lightning", "stand elsewhere")), (worker, Ready(f"seat {worker}"))]
        elif fate == FAILING:
            self._told.append((worker, Refusal("scene.toml: is wrong; mend it")))
        else:
            self._told += [(worker, Advance("search", 1, 2, 10)), (worker, made_up(job))]

    def events(self, seconds: float) -> list[tuple[int, Event]]:
        if self._left == 0:
            raise EngineLost("the cluster has vanished")
        told = [self._told.pop(0)]
        if self._left is not None and isinstance(told[0][1], CellResult):
            self._left -= 1
        return told

    def close(self) -> None:
        self.closed = True


def made_up(job: Job) -> CellResult:
    """A result that no search was needed for."""
    runs, frames = job.config.runs, 2
    return CellResult(
        cell=job.cell,
        seeds=np.arange(runs),
        frames=np.arange(frames),
        per_frame={name: np.zeros((runs, frames), np.float32) for name in PER_FRAME},
        per_run={name: np.ones(runs) for name in PER_RUN},
        pose=np.zeros((runs, frames, 51), np.float32),
        meta={"study": job.study},
    )
