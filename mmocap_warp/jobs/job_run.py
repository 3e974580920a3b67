"""A run of many jobs: what is missing is given to workers, what they finish is stored."""

import math
import time
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Hashable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, TypeAlias

from mmocap_warp.errors import InputError
from mmocap_warp.jobs.engine import Advance, Death, Engine, EngineLost, Notice, Ready, Refusal

_ATTEMPTS = 3  # how often a job is begun whose workers die
_WAIT = 0.5  # longest wait for the next event [s]
_PATIENCE = 300.0  # longest wait for room on a full disk, when nothing else is left to do [s]
_MARGIN = 1.1  # factor on the time that a job is expected to take, where time is limited
_CAPACITY = 16  # results that wait in memory for room on the disk; each has some megabytes
_SECONDS_BETWEEN_TRIES = 5.0  # to store what waits

Note: TypeAlias = Callable[[str], None]
Keep: TypeAlias = Callable[[Any], Any]


@dataclass(frozen=True)
class Task(ABC):
    """A job whose result is a file."""

    noun: ClassVar[str]  # what one is called

    job: Any  # what a worker is given
    path: Path  # where the result goes
    name: Hashable  # which one; its text is for people
    held: Hashable = None  # what a worker goes on holding after it, such as a clip's masks
    kind: str = ""  # jobs of a kind take as long for the same work
    work: int = 1  # what it takes
    evaluations: int = 0  # that it spends at most
    order: int = 0  # those of a lower one are done first
    needs: Hashable = None  # name of the task whose result it starts from

    @abstractmethod
    def check(self) -> Any:
        """Read the result; an InputError if it is damaged."""

    @abstractmethod
    def store(self, result: Any) -> None:
        """Write the result, whole or not at all; an InputError if it cannot be."""

    def spent(self, result: Any) -> int:
        """Evaluations that a result took."""
        return 0


@dataclass
class Seat:
    """What is known of a worker."""

    name: str  # of its device, and of its machine where there are several
    held: Hashable = None  # what it holds of the job before
    task: Task | None = None  # what it is doing; None while it waits
    begun: float = 0.0  # when that was begun
    advance: Advance | None = None  # how far that is


@dataclass(frozen=True)
class Status:
    """Where a run stands; a job is a cell of a study, or a scene of a batch."""

    jobs: int  # of all
    reused: int  # jobs that were finished before this run
    finished: int  # jobs of this run that are stored
    unstored: int  # jobs of this run that are finished, but not on disk yet
    failures: dict[Any, str]  # names of jobs that were given up in this run, and why
    evaluations: int  # that were spent in this run, in all frames and seeds together
    evaluations_left: int  # at most
    seconds: float  # since this run's workers were started, zero if none was
    seats: tuple[Seat, ...]  # the workers
    noun: str  # what a job is called

    @property
    def rate(self) -> float:
        """Evaluations a second, images and masks included."""
        return self.evaluations / self.seconds if self.seconds > 0 else 0.0


def run_jobs(
    tasks: Sequence[Task],
    engine: Callable[[], Engine],
    report: Callable[[Status], None],
    note: Note,
    seconds: float | None = None,
    keep: Keep = lambda result: result,
) -> Status:
    """Do every job whose result is missing or damaged; returns where the run stands in the end.

    A job whose worker dies is tried again, three times in all; if that fails too, or a worker refuses the job, this is
    noted and the rest goes on. Results that cannot be stored are kept, and tried again as long as the run lasts.

    The engine is started only if something is missing; ``report`` is called at least twice a second, ``note`` with
    lines for a person to read. If the run may take so many ``seconds``, no job is begun that would take longer at the
    pace so far. What ``keep`` returns is stored of a result.
    """
    missing = []
    for task in tasks:
        if task.path.exists():
            try:
                task.check()
                continue
            except InputError as error:
                note(f"{error.source}: {error.problem}; this {task.noun} is repeated")
        missing.append(task)
    run = _Run(missing, tasks, note, math.inf if seconds is None else seconds, keep)
    if missing:
        try:
            with closing(engine()) as workers:
                run.work(workers, report)
        except EngineLost as error:  # no worker could be started
            run.leave_the_rest(str(error))
    status = run.status()
    report(status)
    return status


class _Run:
    """One run: what is left to do, who does what, and what came of it.

    While the disk is full results wait in memory, so that none is lost if room is made in time.
    """

    def __init__(self, missing: list[Task], tasks: Sequence[Task], note: Note, seconds: float, keep: Keep) -> None:
        self._pending, self._jobs, self._reused = list(missing), len(tasks), len(tasks) - len(missing)
        self._noun = tasks[0].noun if tasks else "job"
        self._note, self._keep, self._allowed = note, keep, seconds
        self._pace: dict[str, float] = {}  # work a second of one worker, in the last job of a kind
        self._waiting: dict[Path, tuple[Task, Any]] = {}  # results to be stored
        self._next_try = 0.0  # when that is tried next
        self._disk_problem = ""
        self._failures: dict[Hashable, str] = {}
        self._attempts: Counter[Hashable] = Counter()
        self._open = {task.name for task in missing}  # what is not on disk yet
        self._finished = self._spent = 0
        self._started = self._stopped = 0.0
        self._seats: dict[int, Seat] = {}

    @property
    def _at_work(self) -> list[Task]:
        """What workers are doing."""
        return [seat.task for seat in self._seats.values() if seat.task is not None]

    def work(self, engine: Engine, report: Callable[[Status], None]) -> None:
        """Until nothing is left that can be done."""
        self._started = time.monotonic()
        while self._at_work or self._pending or self._waiting:
            # Nothing can be done before results are stored, while the disk is full.
            if not self._at_work and self._waiting and (len(self._waiting) >= _CAPACITY or not self._pending):
                if not self._room_is_made(report):
                    break
                continue
            self._hand_out(engine)
            stuck = self._pending and not self._at_work and not self._waiting and not self._fitting()
            if self._seconds_left <= 0 or stuck:  # nothing runs, and nothing that is left would be finished in time
                self.leave_the_rest(f"the time of {self._allowed:.0f} s is up")
                break
            try:
                for number, event in engine.events(_WAIT):
                    self._take(number, event)
            except EngineLost as error:
                self.leave_the_rest(str(error))
            self._store()
            report(self.status())
        self._give_up(self._disk_problem)
        self._failures |= {task.name: self._disk_problem for task, _ in self._waiting.values()}
        self._stopped = time.monotonic()

    def _store(self) -> None:
        """Try to store what waits, if the last try was long enough ago."""
        if time.monotonic() < self._next_try:
            return
        try:
            for path, (task, result) in [*self._waiting.items()]:
                task.store(result)
                del self._waiting[path]
                self._open.discard(task.name)
                self._finished += 1
            self._disk_problem = ""
        except InputError as error:
            self._next_try = time.monotonic() + _SECONDS_BETWEEN_TRIES
            if not self._disk_problem:
                self._note(f"{error}; results wait in memory until then")
            self._disk_problem = str(error)

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
        """Where the run stands now."""
        now = self._stopped or time.monotonic()
        running = sum(seat.advance.evaluations for seat in self._seats.values() if seat.advance)
        counts = self._jobs, self._reused, self._finished, len(self._waiting), dict(self._failures)
        left = sum(task.evaluations for task in [*self._pending, *self._at_work]) - running
        seconds = now - self._started if self._started else 0.0
        seats = tuple(replace(seat) for _, seat in sorted(self._seats.items()))
        return Status(*counts, self._spent + running, left, seconds, seats, self._noun)

    @property
    def _seconds_left(self) -> float:
        return self._allowed - (time.monotonic() - self._started)

    def _fitting(self) -> list[Task]:
        """What can be begun and would be finished in time, at its kind's pace so far, or else at the slowest."""
        left, ready = self._seconds_left / _MARGIN, [task for task in self._pending if task.needs not in self._open]
        if left == math.inf or not self._pace:
            return ready
        slowest = min(self._pace.values())
        return [task for task in ready if task.work <= left * self._pace.get(task.kind, slowest)]

    def _hand_out(self, engine: Engine) -> None:
        """Give every worker that waits a job, unless results that wait already fill the memory."""
        for number, seat in self._seats.items():
            if seat.task is None and len(self._waiting) < _CAPACITY and (fitting := self._fitting()):
                task = self._choose(fitting, seat.held)
                self._pending.remove(task)
                self._attempts[task.name] += 1
                seat.task, seat.held, seat.begun = task, task.held, time.monotonic()
                engine.submit(number, task.job)

    def _choose(self, pending: list[Task], held: Hashable) -> Task:
        """The next job of a worker: of the lowest order, and of that one for which the worker holds what it needs.

        Else for what needs workers most. The longest comes first, so that nobody waits for it in the end.
        """
        first = min(task.order for task in pending)
        pending = [task for task in pending if task.order == first]
        left = Counter(task.held for task in pending)
        if held is None or held not in left:
            taken = Counter(task.held for task in self._at_work)
            held = max(left, key=lambda each: left[each] / (1 + taken[each]))
        return max((task for task in pending if task.held == held), key=lambda task: task.work)

    def _take(self, number: int, event: Any) -> None:
        """What has happened to a worker; a refusal or a result ends its job."""
        if isinstance(event, Ready):
            self._seats[number] = Seat(event.name)
        elif isinstance(event, Notice):
            self._note(event.text)
        elif isinstance(event, Death):
            self._bury(self._seats.pop(number, Seat("worker")), event)
        elif isinstance(event, Advance):
            self._seats[number].advance = event
        elif (task := self._seats[number].task) is not None:
            seat = self._seats[number]
            seat.task, seat.advance = None, None
            if isinstance(event, Refusal):
                self._fail(task, event.problem)
                return
            self._spent += task.spent(event)
            self._pace[task.kind] = task.work / max(time.monotonic() - seat.begun, 1e-3)
            self._waiting[task.path] = task, self._keep(event)

    def _bury(self, seat: Seat, death: Death) -> None:
        """A worker has died; its job is tried again."""
        task = seat.task
        if task is None:
            self._note(f"{seat.name} died while it waited or started ({death.reason})")
        elif self._attempts[task.name] < _ATTEMPTS:
            self._note(f"{task.name}: {seat.name} died ({death.reason}); the {self._noun} is tried again")
            self._pending.append(task)
        else:
            problem = f"{seat.name} died ({death.reason}), as workers did {_ATTEMPTS} times at this {self._noun}"
            self._fail(task, f"{problem}; {death.remedy}" if death.remedy else problem)

    def _fail(self, task: Task, problem: str) -> None:
        self._note(f"{task.name}: given up: {problem}")
        in_vain = [other for other in self._pending if other.needs == task.name]
        self._failures |= {task.name: problem} | {other.name: f"{task.name} failed: {problem}" for other in in_vain}
        self._pending = [other for other in self._pending if other.needs != task.name]

    def leave_the_rest(self, problem: str) -> None:
        """Give up what is not done, and say why."""
        self._note(f"{problem}; {len(self._pending) + len(self._at_work)} {self._noun}s are left for another run")
        self._give_up(problem)

    def _give_up(self, problem: str) -> None:
        """Nothing more can be done: all that is left has failed."""
        self._failures |= {task.name: problem for task in [*self._pending, *self._at_work]}
        self._pending, self._seats = [], {}
