"""A study's results: one file per cell, named by what it depends on."""

from __future__ import annotations

import hashlib
import json
import re
import time
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

from mmocap_warp.errors import InputError
from mmocap_warp.study.cell import Cell, CellResult, read_cell
from mmocap_warp.study.definition import Plan
from mmocap_warp.study.job import code_of
from mmocap_warp.study.source import shipped_bodies

_KEY_DIGITS = 20  # of 64; in a folder of a million results two keys are alike with a chance of 4e-13
_ABANDONED = 60.0  # a file that has been half written for so long will not be finished [s]


def content_key(plan: Plan, clip_identity: str, device_kind: str, code: str | None = None) -> str:
    """A hash of all that a cell's result depends on, the same on any machine.

    That is: what is tracked and what it is judged against (``clip_identity``), the cell and its settings, the code that
    this kind of cell runs (``code``; by default the present one), and ``cpu`` or ``cuda``, whose arithmetic differs in
    the last bits.
    """
    settings = asdict(plan.config)
    del settings["device"], settings["threads"]
    depends = {
        "cell": asdict(plan.cell),
        "clip": clip_identity,
        "config": settings,
        "code": code or code_of(plan.config, plan.clip, plan.solved),
        "device": device_kind,
    }
    if plan.solved:
        depends["bodies"] = shipped_bodies()  # among them the one that is expected before anything is seen
    return hashlib.sha256(json.dumps(depends, sort_keys=True).encode()).hexdigest()[:_KEY_DIGITS]


def result_path(folder: Path, cell: Cell, key: str) -> Path:
    """Where a cell's result lies: a name for people, then its key."""
    name = f"{cell.sequence}-{cell.algorithm}-{cell.dof}-{cell.evaluations}-{cell.preset}"
    return folder / f"{re.sub(r'[^A-Za-z0-9-]+', '_', name)}.{key}.npz"


def open_folder(folder: Path) -> Path:
    """A folder for results, made if it does not exist, and freed of what kills amid writing left there.

    Raises:
        InputError: it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for file in folder.glob(".*.npz.*"):
            if time.time() - file.stat().st_mtime > _ABANDONED:
                file.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(folder, f"cannot be used ({error.strerror})", "name a folder for results") from None
    return folder


def read_results(folder: str | Path) -> Iterator[CellResult | InputError]:
    """Every result in a folder, in the order of their names; for a damaged file, what is wrong with it.

    Raises:
        InputError: no such folder.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(folder, "no such folder", "name the folder that 'mmocap study run' wrote")
    for path in sorted(folder.glob("*.npz")):
        try:
            yield read_cell(path)
        except InputError as error:
            yield error
