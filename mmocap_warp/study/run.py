"""Running a study: what is missing is given to workers, what they finish is stored."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from mmocap_warp.errors import InputError
from mmocap_warp.study.cell import Cell, CellResult, read_cell
from mmocap_warp.study.engines.engine import Death, Engine, EngineLost, Event, Notice, Ready
from mmocap_warp.study.job import Advance, Refusal
from mmocap_warp.study.outbox import Outbox
from mmocap_warp.study.source import Clip
from mmocap_warp.study.tasks import Task

_ATTEMPTS = 3  # at a cell whose workers die
_WAIT = 0.5  # for something to happen, at most [s]
_PATIENCE = 300.0  # with a full disk, when nothing else is left to do [s]
_MARGIN = 1.1  # of the time that a cell is expected to take, where time is limited


@dataclass(frozen=True)
class Seat:
    """A worker, as a person is told of it.

    Attributes:
        name: its device, and its machine where there are several.
        cell: what it is tracking; None while it waits.
        advance: how far it is with that.
    """

    name: str
    cell: Cell | None
    advance: Advance | None


@dataclass(frozen=True)
class Status:
    """Where a study stands.

    Attributes:
        cells: in the study.
        reused: finished before this run.
        finished: in this run, and stored.
        unstored: finished in this run, but not on disk yet.
        failures: cells given up in this run, and why.
        evaluations: spent in this run, all frames and seeds together.
        evaluations_left: at most.
        seconds: since this run's workers were started, zero if none was.
        seats: the workers.
    """

    cells: int
    reused: int
    finished: int
    unstored: int
    failures: dict[Cell, str]
    evaluations: int
    evaluations_left: int
    seconds: float
    seats: tuple[Seat, ...]

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
    missing = [task for task in tasks if not _is_stored(task, note)]
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


def _is_stored(task: Task, note: Callable[[str], None]) -> bool:
    """Whether a cell's result is there and whole."""
    if not task.path.exists():
        return False
    try:
        read_cell(task.path)
    except InputError as error:
        note(f"{error.source}: {error.problem}; this cell is repeated")
        return False
    return True


class _Run:
    """One run: what is left to do, who does what, and what came of it."""

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
        self._outbox = Outbox(note)
        self._failures: dict[Cell, str] = {}
        self._attempts: Counter[Cell] = Counter()
        self._finished = self._spent = 0
        self._started = self._stopped = 0.0
        # By worker: its name, the clip whose masks it holds, what it is tracking, and how far it is with that.
        self._name: dict[int, str] = {}
        self._held: dict[int, Clip] = {}
        self._task: dict[int, Task] = {}
        self._begun: dict[int, float] = {}
        self._advance: dict[int, Advance] = {}

    def work(self, engine: Engine, report: Callable[[Status], None]) -> None:
        """Until nothing is left that can be done."""
        self._started = time.monotonic()
        while self._task or self._pending or self._outbox.cells:
            if self._stuck:
                if not self._room_is_made(report):
                    break
                continue
            self._hand_out(engine)
            if self._time_is_up:
                problem = f"the time of {self._allowed:.0f} s is up"
                self._note(f"{problem}; {len(self._pending) + len(self._task)} cells are left for another run")
                self._give_up(problem)
                break
            try:
                for worker, event in engine.events(_WAIT):
                    self._take(worker, event)
            except EngineLost as error:
                self._note(f"{error}; {len(self._pending) + len(self._task)} cells are left for another run")
                self._give_up(str(error))
            self._finished += self._outbox.flush_if_due()
            report(self.status())
        self._give_up(self._outbox.problem)
        self._failures |= dict.fromkeys(self._outbox.cells, self._outbox.problem)
        self._stopped = time.monotonic()

    @property
    def _stuck(self) -> bool:
        """Whether nothing can be done before results are stored."""
        return not self._task and bool(self._outbox.cells) and (self._outbox.full or not self._pending)

    def _room_is_made(self, report: Callable[[Status], None]) -> bool:
        """Wait for room on the disk; whether it came."""
        self._note(f"waiting up to {_PATIENCE:.0f} s for {len(self._outbox.cells)} results to be stored")
        deadline = time.monotonic() + _PATIENCE
        while self._outbox.cells and time.monotonic() < deadline:
            time.sleep(_WAIT)
            self._finished += self._outbox.flush_if_due()
            report(self.status())
        return not self._outbox.cells

    def status(self) -> Status:
        """Where the study stands now."""
        now = self._stopped or time.monotonic()
        running = sum(advance.evaluations for advance in self._advance.values())
        budget = sum(task.evaluations for task in [*self._pending, *self._task.values()])
        return Status(
            cells=self._cells,
            reused=self._reused,
            finished=self._finished,
            unstored=len(self._outbox.cells),
            failures=dict(self._failures),
            evaluations=self._spent + running,
            evaluations_left=budget - running,
            seconds=now - self._started if self._started else 0.0,
            seats=tuple(self._seat(worker) for worker in sorted(self._name)),
        )

    def _seat(self, worker: int) -> Seat:
        task = self._task.get(worker)
        return Seat(self._name[worker], task.cell if task else None, self._advance.get(worker))

    @property
    def _seconds_left(self) -> float:
        return self._allowed - (time.monotonic() - self._started)

    @property
    def _time_is_up(self) -> bool:
        """Whether the time allowed has passed, or nothing runs and nothing that is left would be finished in it."""
        if self._seconds_left <= 0:
            return True
        return bool(self._pending) and not self._task and not self._outbox.cells and not self._fitting()

    def _fitting(self) -> list[Task]:
        """What is left and would be finished in time, at the algorithm's pace so far, or else at the slowest."""
        left = self._seconds_left / _MARGIN
        if left == math.inf or not self._pace:
            return self._pending
        slowest = min(self._pace.values())
        return [task for task in self._pending if task.work <= left * self._pace.get(task.cell.algorithm, slowest)]

    def _hand_out(self, engine: Engine) -> None:
        """Give every worker that waits a cell."""
        for worker in self._name:
            if worker not in self._task and not self._outbox.full and (fitting := self._fitting()):
                task = self._choose(fitting, self._held.get(worker))
                self._pending.remove(task)
                self._attempts[task.cell] += 1
                self._task[worker], self._held[worker] = task, task.job.clip
                self._begun[worker] = time.monotonic()
                engine.submit(worker, task.job)

    def _choose(self, pending: list[Task], held: Clip | None) -> Task:
        """The next cell of a worker: of the study's earliest grid, and in it of the clip whose masks the worker holds.

        Else of the clip that needs workers most. The longest comes first, so that nobody waits for it in the end.
        """
        first = min(task.grid for task in pending)
        pending = [task for task in pending if task.grid == first]
        left = Counter(task.job.clip for task in pending)
        if held is None or held not in left:
            taken = Counter(task.job.clip for task in self._task.values())
            held = max(left, key=lambda clip: left[clip] / (1 + taken[clip]))
        return max((task for task in pending if task.job.clip == held), key=lambda task: task.work)

    def _take(self, worker: int, event: Event) -> None:
        """What has happened to a worker."""
        if isinstance(event, Ready):
            self._name[worker] = event.name
        elif isinstance(event, Advance):
            self._advance[worker] = event
        elif isinstance(event, Death):
            self._mourn(worker, event)
        elif isinstance(event, Notice):
            self._note(event.text)
        else:
            task = self._task.pop(worker)
            self._advance.pop(worker, None)
            if isinstance(event, Refusal):
                self._fail(task, event.problem)
            else:
                self._spent += int(event.per_run["evaluations"].sum())
                self._pace[task.cell.algorithm] = task.work / max(time.monotonic() - self._begun[worker], 1e-3)
                self._finished += self._outbox.put(task.path, self._keep(event))

    def _mourn(self, worker: int, death: Death) -> None:
        """A worker has died; its cell is tried again."""
        name, task = self._name.pop(worker, "worker"), self._task.pop(worker, None)
        self._advance.pop(worker, None)
        self._held.pop(worker, None)
        if task is None:
            self._note(f"{name} died while it waited or started ({death.reason})")
        elif self._attempts[task.cell] < _ATTEMPTS:
            self._note(f"{task.cell}: {name} died ({death.reason}); the cell is tried again")
            self._pending.append(task)
        else:
            problem = f"{name} died ({death.reason}), as workers did {_ATTEMPTS} times at this cell"
            self._fail(task, f"{problem}; {death.remedy}" if death.remedy else problem)

    def _fail(self, task: Task, problem: str) -> None:
        self._note(f"{task.cell}: given up: {problem}")
        self._failures[task.cell] = problem

    def _give_up(self, problem: str) -> None:
        """Nothing more can be done: all that is left has failed."""
        self._failures |= {task.cell: problem for task in [*self._pending, *self._task.values()]}
        self._pending = []
        for by_worker in (self._name, self._held, self._task, self._advance):
            by_worker.clear()
