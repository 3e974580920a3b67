"""Finished cells of an earlier state of the code, which are kept where a sample of them has the same bits now."""

from __future__ import annotations

import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

from mmocap_warp.errors import InputError
from mmocap_warp.study.cell import PROVENANCE_FILE, read_cell
from mmocap_warp.study.definition import Plan, Study
from mmocap_warp.study.store import content_key, result_path
from mmocap_warp.study.tasks import Task


def keep_earlier_cells(
    study: Study,
    tasks: list[Task],
    device_kind: str,
    track: Callable[[list[Task]], object],
    note: Callable[[str], None],
) -> None:
    """Take over results that differ from what is missing in their code alone, algorithm by algorithm.

    The first, the middle and the last of an algorithm's cells are tracked again. Where all of them have the bits that
    they had, the others are copied under the names that this code gives them; they go on naming the code that they
    come from.

    Args:
        study: whose cells.
        tasks: all of them.
        device_kind: ``cpu`` or ``cuda``.
        track: tracks the cells that it is given, and stores their results.
        note: called with a line for each algorithm.
    """
    # What lies there of other code, and a sample of it.
    earlier: dict[str, list[tuple[Task, Path]]] = {}
    for task, plan in zip(tasks, study.plans, strict=True):
        if not task.path.exists() and (file := _earlier_result(task, plan, device_kind)):
            earlier.setdefault(task.cell.algorithm, []).append((task, file))
    if not earlier:
        return
    samples = {algorithm: sample_of(cells) for algorithm, cells in earlier.items()}

    # What the sample gives now decides about the rest.
    track([task for sample in samples.values() for task, _ in sample])
    for algorithm, cells in earlier.items():
        same = [task.path.exists() and _answer(task.path) == _answer(file) for task, file in samples[algorithm]]
        if not all(same):
            note(f"{algorithm}: {same.count(False)} of {len(same)} cells have other bits now; all of them are repeated")
            continue
        for task, file in cells:
            if not task.path.exists():
                shutil.copyfile(file, task.path)
        note(f"{algorithm}: {len(same)} cells have the same bits now; {len(cells) - len(same)} more are kept")


def sample_of(cells: list[tuple[Task, Path]]) -> list[tuple[Task, Path]]:
    """The first, the middle and the last."""
    return [cells[place] for place in sorted({0, len(cells) // 2, len(cells) - 1})]


def _earlier_result(task: Task, plan: Plan, device_kind: str) -> Path | None:
    """A whole result of the cell whose key is the cell's own but for the code that the result names."""
    cell, *_ = task.path.name.rsplit(".", 2)
    for file in sorted(task.path.parent.glob(f"{cell}.*.npz")):
        try:
            code = read_cell(file).meta.get("code")
        except InputError:
            continue
        key = content_key(plan, task.job.clip_identity, device_kind, code)
        if code and file == result_path(file.parent, plan.cell, key):
            return file
    return None


def _answer(file: Path) -> dict[str, bytes]:
    """The members of a result's file that a repetition gives bit for bit."""
    with zipfile.ZipFile(file) as members:
        return {name: members.read(name) for name in members.namelist() if name != PROVENANCE_FILE}
