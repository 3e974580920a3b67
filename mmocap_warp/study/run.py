"""Running a study: what is missing is given to workers, what they finish is stored."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from mmocap_warp.errors import InputError
from mmocap_warp.study.cell import Cell, CellResult, read_cell, write_cell
from mmocap_warp.study.engines.engine import Death, Engine, EngineLost, Event, Notice, Ready
from mmocap_warp.study.job import Advance, Refusal
from mmocap_warp.study.source import Clip
from mmocap_warp.study.store import Task

_ATTEMPTS = 3  # how often a cell is begun whose workers die
_WAIT = 0.5  # longest wait for the next event [s]
_PATIENCE = 300.0  # longest wait for room on a full disk, when nothing else is left to do [s]
_MARGIN = 1.1  # factor on the time that a cell is expected to take, where time is limited
_CAPACITY = 16  # results that wait in memory for room on the disk; each has some megabytes
_SECONDS_BETWEEN_TRIES = 5.0  # to store what waits


@dataclass(frozen=True)
class Seat:
    """A worker, as a person is told of it."""

    name: str  # of its device, and of its machine where there are several
    cell: Cell | None  # what it is tracking; None while it waits
    advance: Advance | None  # how far that is


@dataclass(frozen=True)
class Status:
    """Where a study stands."""

    cells: int  # in the study
    reused: int  # cells that were finished before this run
    finished: int  # cells of this run that are stored
    unstored: int  # cells of this run that are finished, but not on disk yet
    failures: dict[Cell, str]  # cells that were given up in this run, and why
    evaluations: int  # that were spent in this run, in all frames and seeds together
    evaluations_left: int  # at most
    seconds: float  # since this run's workers were started, zero if none was
    seats: tuple[Seat, ...]  # the workers

    @property
    def rate(self) -> float:
        """Evaluations a second, images and masks included."""
        return self.evaluations / self.seconds if self.seconds > 0 else 0.0


def run_study(
    tasks: Sequence[Task],
    engine: Callable[[], Engine],
    report: Callable[[Status], None],
    note: Callable[[str], None],
    seconds: float | None = None,
    keep: Callable[[CellResult], CellResult] = lambda result: result,
) -> Status:
    """Track every cell whose result is missing or damaged; returns where the study stands in the end.

    A cell whose worker dies is tried again, three times in all; if that fails too, or a worker refuses the cell, this
    is noted and the rest goes on. Results that cannot be stored are kept, and tried again as long as the run lasts.

    Args:
        tasks: the study's cells.
        engine: starts the workers; called only if something is missing.
        report: called whenever something may have happened, at least twice a second.
        note: called with a line that a person should read.
        seconds: that the run may take. No cell is begun that would take longer at the pace so far; what runs on all the
            same is ended then.
        keep: what of a result is stored.
    """
    missing = []
    for task in tasks:
        if task.path.exists():
            try:
                read_cell(task.path)
                continue
            except InputError as error:
                note(f"{error.source}: {error.problem}; this cell is repeated")
        missing.append(task)
    run = _Run(missing, len(tasks), note, seconds, keep)
    if missing:
        workers = engine()
        try:
            run.work(workers, report)
        finally:
            workers.close()
    status = run.status()
    report(status)
    return status


@dataclass
class _Worker:
    """What is known of a worker."""

    name: str  # of its device, and of its machine where there are several
    clip: Clip | None = None  # it tracked this last, and holds its masks
    task: Task | None = None  # what it is tracking
    begun: float = 0.0  # when that was begun
    advance: Advance | None = None  # how far that is


class _Run:
    """One run: what is left to do, who does what, and what came of it.

    While the disk is full results wait in memory, so that none is lost if room is made in time.
    """

    def __init__(
        self,
        missing: list[Task],
        cells: int,
        note: Callable[[str], None],
        seconds: float | None,
        keep: Callable[[CellResult], CellResult],
    ) -> None:
        self._pending, self._cells, self._reused = list(missing), cells, cells - len(missing)
        self._note, self._keep = note, keep
        self._allowed = math.inf if seconds is None else seconds
        self._pace: dict[str, float] = {}  # work a second of one worker, in an algorithm's last cell
        self._waiting: dict[Path, CellResult] = {}  # results to be stored
        self._next_try = 0.0  # when that is tried next
        self._disk_problem = ""
        self._failures: dict[Cell, str] = {}
        self._attempts: Counter[Cell] = Counter()
        self._finished = self._spent = 0
        self._started = self._stopped = 0.0
        self._workers: dict[int, _Worker] = {}

    def _store(self) -> None:
        """Try to store what waits, if the last try was long enough ago."""
        if time.monotonic() < self._next_try:
            return
        for path, result in [*self._waiting.items()]:
            try:
                write_cell(path, result)
            except InputError as error:
                self._next_try = time.monotonic() + _SECONDS_BETWEEN_TRIES
                if not self._disk_problem:
                    self._note(f"{error}; results wait in memory until then")
                self._disk_problem = str(error)
                return
            del self._waiting[path]
            self._finished += 1
        self._disk_problem, self._next_try = "", 0.0

    @property
    def _memory_is_full(self) -> bool:
        """Whether no more results should be made before those that wait are stored."""
        return len(self._waiting) >= _CAPACITY

    @property
    def _tracking(self) -> list[Task]:
        """What workers are tracking."""
        return [worker.task for worker in self._workers.values() if worker.task is not None]

    def work(self, engine: Engine, report: Callable[[Status], None]) -> None:
        """Until nothing is left that can be done."""
        self._started = time.monotonic()
        while self._tracking or self._pending or self._waiting:
            # Nothing can be done before results are stored, while the disk is full.
            if not self._tracking and self._waiting and (self._memory_is_full or not self._pending):
                if not self._room_is_made(report):
                    break
                continue
            self._hand_out(engine)
            if self._time_is_up:
                self._leave_the_rest(f"the time of {self._allowed:.0f} s is up")
                break
            try:
                for number, event in engine.events(_WAIT):
                    self._take(number, event)
            except EngineLost as error:
                self._leave_the_rest(str(error))
            self._store()
            report(self.status())
        self._give_up(self._disk_problem)
        self._failures |= {result.cell: self._disk_problem for result in self._waiting.values()}
        self._stopped = time.monotonic()

    def _room_is_made(self, report: Callable[[Status], None]) -> bool:
        """Wait for room on the disk; returns whether it came."""
        self._note(f"waiting up to {_PATIENCE:.0f} s for {len(self._waiting)} results to be stored")
        deadline = time.monotonic() + _PATIENCE
        while self._waiting and time.monotonic() < deadline:
            time.sleep(_WAIT)
            self._store()
            report(self.status())
        return not self._waiting

    def status(self) -> Status:
        """Where the study stands now."""
        now = self._stopped or time.monotonic()
        running = sum(worker.advance.evaluations for worker in self._workers.values() if worker.advance)
        budget = sum(task.evaluations for task in [*self._pending, *self._tracking])
        return Status(
            cells=self._cells,
            reused=self._reused,
            finished=self._finished,
            unstored=len(self._waiting),
            failures=dict(self._failures),
            evaluations=self._spent + running,
            evaluations_left=budget - running,
            seconds=now - self._started if self._started else 0.0,
            seats=tuple(
                Seat(worker.name, worker.task.cell if worker.task else None, worker.advance)
                for _, worker in sorted(self._workers.items())
            ),
        )

    @property
    def _time_is_up(self) -> bool:
        """Whether the time allowed has passed, or nothing runs and nothing that is left would be finished in it."""
        if self._seconds_left() <= 0:
            return True
        return bool(self._pending) and not self._tracking and not self._waiting and not self._fitting()

    def _seconds_left(self) -> float:
        return self._allowed - (time.monotonic() - self._started)

    def _fitting(self) -> list[Task]:
        """What is left and would be finished in time, at the algorithm's pace so far, or else at the slowest."""
        left = self._seconds_left() / _MARGIN
        if left == math.inf or not self._pace:
            return self._pending
        slowest = min(self._pace.values())
        return [task for task in self._pending if task.work <= left * self._pace.get(task.cell.algorithm, slowest)]

    def _hand_out(self, engine: Engine) -> None:
        """Give every worker that waits a cell."""
        for number, worker in self._workers.items():
            if worker.task is None and not self._memory_is_full and (fitting := self._fitting()):
                task = self._choose(fitting, worker.clip)
                self._pending.remove(task)
                self._attempts[task.cell] += 1
                worker.task, worker.clip, worker.begun = task, task.job.clip, time.monotonic()
                engine.submit(number, task.job)

    def _choose(self, pending: list[Task], held: Clip | None) -> Task:
        """The next cell of a worker: of the study's earliest grid, and in it of the clip whose masks the worker holds.

        Else of the clip that needs workers most. The longest comes first, so that nobody waits for it in the end.
        """
        first = min(task.grid for task in pending)
        pending = [task for task in pending if task.grid == first]
        left = Counter(task.job.clip for task in pending)
        if held is None or held not in left:
            taken = Counter(task.job.clip for task in self._tracking)
            held = max(left, key=lambda clip: left[clip] / (1 + taken[clip]))
        return max((task for task in pending if task.job.clip == held), key=lambda task: task.work)

    def _take(self, number: int, event: Event) -> None:
        """What has happened to a worker; a refusal or a result ends its task."""
        if isinstance(event, Ready):
            self._workers[number] = _Worker(event.name)
        elif isinstance(event, Notice):
            self._note(event.text)
        elif isinstance(event, Death):
            self._bury(self._workers.pop(number, _Worker("worker")), event)
        elif isinstance(event, Advance):
            self._workers[number].advance = event
        elif (task := self._workers[number].task) is not None:
            self._end(task, self._workers[number], event)

    def _end(self, task: Task, worker: _Worker, event: Refusal | CellResult) -> None:
        """A worker's task has ended, by a refusal or a result."""
        worker.task, worker.advance = None, None
        if isinstance(event, Refusal):
            self._fail(task, event.problem)
            return
        self._spent += int(event.per_run["evaluations"].sum())
        self._pace[task.cell.algorithm] = task.work / max(time.monotonic() - worker.begun, 1e-3)
        self._waiting[task.path] = self._keep(event)

    def _bury(self, worker: _Worker, death: Death) -> None:
        """A worker has died; its cell is tried again."""
        task = worker.task
        if task is None:
            self._note(f"{worker.name} died while it waited or started ({death.reason})")
        elif self._attempts[task.cell] < _ATTEMPTS:
            self._note(f"{task.cell}: {worker.name} died ({death.reason}); the cell is tried again")
            self._pending.append(task)
        else:
            problem = f"{worker.name} died ({death.reason}), as workers did {_ATTEMPTS} times at this cell"
            self._fail(task, f"{problem}; {death.remedy}" if death.remedy else problem)

    def _fail(self, task: Task, problem: str) -> None:
        self._note(f"{task.cell}: given up: {problem}")
        self._failures[task.cell] = problem

    def _leave_the_rest(self, problem: str) -> None:
        self._note(f"{problem}; {len(self._pending) + len(self._tracking)} cells are left for another run")
        self._give_up(problem)

    def _give_up(self, problem: str) -> None:
        """Nothing more can be done: all that is left has failed."""
        self._failures |= {task.cell: problem for task in [*self._pending, *self._tracking]}
        self._pending, self._workers = [], {}
