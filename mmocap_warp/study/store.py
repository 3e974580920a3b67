"""A study's cells as tasks, and their results: one file per cell, named by what it depends on."""

import hashlib
import json
import re
import time
import zipfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import asdict
from functools import partial
from pathlib import Path

from mmocap_warp.errors import InputError
from mmocap_warp.jobs.job_run import Task
from mmocap_warp.study.cell import PROVENANCE_FILE, Cell, CellResult, read_cell, write_cell
from mmocap_warp.study.definition import Plan, Study
from mmocap_warp.study.job import Job, code_of
from mmocap_warp.study.source import clip_facts, shipped_bodies
from mmocap_warp.tracking.algorithms import ALGORITHMS
from mmocap_warp.whole_file import write_whole

_KEY_DIGITS = 20  # of 64; in a folder of a million results two keys are alike with a chance of 4e-13
_ABANDONED = 60.0  # a file that has been half written for so long will not be finished [s]

_CONTOURS = 500  # evaluations that a frame's contours take as long as, the clip's smoothing included, about


class CellTask(Task):
    """A cell to be tracked."""

    noun = "cell"

    def check(self) -> None:
        """See :class:`~mmocap_warp.jobs.job_run.Task`."""
        if read_cell(self.path).cell != self.job.cell:
            raise InputError(self.path, "is the result of another cell", "delete it")

    def store(self, result: CellResult) -> None:
        """See :class:`~mmocap_warp.jobs.job_run.Task`."""
        write_cell(self.path, result)

    def spent(self, result: CellResult) -> int:
        """See :class:`~mmocap_warp.jobs.job_run.Task`."""
        return int(result.per_run["evaluations"].sum())


def plan_tasks(study: Study, folder: Path, device_kind: str) -> list[CellTask]:
    """Every cell of a study with its file in ``folder``, for results of a kind of device (``cpu`` or ``cuda``).

    Raises:
        InputError: a sequence that does not exist or is wrong.
    """
    facts = {clip: clip_facts(clip) for clip in study.clips}
    tasks = []
    for plan in study.plans:
        (identity, frames, models), cell, config = facts[plan.clip], plan.cell, plan.config
        if models and cell.dof not in models:
            problem = f"dof = {cell.dof} is no model of {cell.sequence}'s body, which has {', '.join(map(str, models))}"
            raise InputError(study.name, problem, "give that sequence a [[grid]] of its own")
        code = code_of(config, plan.clip, plan.solved)
        job = Job(cell, plan.clip, identity, config, study.name, code, plan.solved)
        path = result_path(folder, cell, content_key(plan, identity, device_kind, code))
        # A frame that is fitted by contours counts as a small search.
        searched = frames * config.runs * config.budget
        work = searched + frames * config.runs * _CONTOURS * config.fits_contours
        tasks.append(CellTask(job, path, cell, plan.clip, cell.algorithm, work, searched, plan.grid))
    return tasks


def content_key(plan: Plan, clip_identity: str, device_kind: str, code: str | None = None) -> str:
    """A hash of all that a cell's result depends on, the same on any machine.

    That is: what is tracked and what it is judged against (``clip_identity``), the cell and its settings, the code that
    this kind of cell runs (``code``; by default the present one), and ``cpu`` or ``cuda``, whose arithmetic differs in
    the last bits.
    """
    settings = {name: value for name, value in asdict(plan.config).items() if name not in ("device", "threads")}
    depends = {"cell": asdict(plan.cell), "clip": clip_identity, "config": settings, "device": device_kind}
    depends["code"] = code or code_of(plan.config, plan.clip, plan.solved)
    made = ALGORITHMS[plan.config.algorithm].source if plan.config.algorithm in ALGORITHMS else ""
    if isinstance(made, partial):  # an optimizer of one's own, whose settings are in it
        depends["optimizer"] = re.sub(" at 0x[0-9a-f]+", "", repr(made))
    if plan.solved:
        depends["bodies"] = shipped_bodies()  # among them the one that is expected before anything is seen
    return hashlib.sha256(json.dumps(depends, sort_keys=True).encode()).hexdigest()[:_KEY_DIGITS]


def result_path(folder: Path, cell: Cell, key: str) -> Path:
    """Where a cell's result lies: a name for people, then its key."""
    name = f"{cell.sequence}-{cell.algorithm}-{cell.dof}-{cell.evaluations}-{cell.preset}"
    return folder / f"{re.sub(r'[^A-Za-z0-9-]+', '_', name)}.{key}.npz"


def open_folder(folder: Path) -> None:
    """Make a folder for results if need be, and remove what killed writers left; an InputError if it cannot be used."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for file in folder.glob(".*.*.[0-9]*.npz"):  # as whole_file names them: .<name>.<key>.<process>.npz
            with suppress(FileNotFoundError):  # its writer has renamed or removed it meanwhile
                if time.time() - file.stat().st_mtime > _ABANDONED:
                    file.unlink()
    except OSError as error:
        raise InputError(folder, f"cannot be used ({error.strerror})", "name a folder for results") from None


def read_results(folder: str | Path) -> Iterator[CellResult | InputError]:
    """Every result in a folder, in the order of their names; for a damaged file, what is wrong with it.

    Raises:
        InputError: no such folder.
    """
    if not Path(folder).is_dir():
        raise InputError(folder, "no such folder", "name the folder that 'mmocap study run' wrote")
    for path in sorted(Path(folder).glob("[!.]*.npz")):
        try:
            yield read_cell(path)
        except InputError as error:
            yield error


def keep_earlier_cells(
    study: Study,
    tasks: list[CellTask],
    device_kind: str,
    track: Callable[[list[CellTask]], object],
    note: Callable[[str], None],
) -> None:
    """Take over results that differ from what is missing in their code alone, algorithm by algorithm.

    The first, the middle and the last of an algorithm's cells are tracked again, by ``track``. Where all of them have
    the bits that they had, the others are copied under the names that this code gives them; they go on naming the code
    that they come from. A note is made of each algorithm.
    """
    # What lies there of other code, and a sample of it.
    earlier: dict[str, list[tuple[CellTask, Path]]] = {}
    for task, plan in zip(tasks, study.plans, strict=True):
        if not task.path.exists() and (file := _earlier_result(task, plan, device_kind)):
            earlier.setdefault(task.kind, []).append((task, file))
    samples = {algorithm: sample_of(cells) for algorithm, cells in earlier.items()}
    # What the sample gives now decides about the rest.
    if samples:
        track([task for sample in samples.values() for task, _ in sample])
    for algorithm, cells in earlier.items():
        same = [task.path.exists() and _answer(task.path) == _answer(file) for task, file in samples[algorithm]]
        if not all(same):
            note(f"{algorithm}: {same.count(False)} of {len(same)} cells have other bits now; all of them are repeated")
            continue
        for task, file in cells:
            if not task.path.exists():
                write_whole(task.path, file.read_bytes())
        note(f"{algorithm}: {len(same)} cells have the same bits now; {len(cells) - len(same)} more are kept")


def sample_of(cells: list[tuple[CellTask, Path]]) -> list[tuple[CellTask, Path]]:
    """The first, the middle and the last."""
    return [cells[place] for place in sorted({0, len(cells) // 2, len(cells) - 1})]


def _earlier_result(task: CellTask, plan: Plan, device_kind: str) -> Path | None:
    """A whole result of the cell whose key is the cell's own but for the code that the result names."""
    cell, *_ = task.path.name.rsplit(".", 2)
    for file in sorted(task.path.parent.glob(f"{cell}.*.npz")):
        with suppress(InputError):
            code = read_cell(file).meta.get("code", "")
            key = content_key(plan, task.job.clip_identity, device_kind, code)
            if code and file == result_path(file.parent, plan.cell, key):
                return file
    return None


def _answer(file: Path) -> dict[str, bytes]:
    """The members of a result's file that a repetition gives bit for bit; poses are kept of all runs or of one."""
    with zipfile.ZipFile(file) as members:
        names = [name for name in members.namelist() if name not in (PROVENANCE_FILE, "pose.npy")]
        return {name: members.read(name) for name in names}
