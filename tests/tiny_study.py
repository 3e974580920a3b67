"""A recording of a few small frames, and studies of it that take seconds."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from pathlib import Path

from recordings import write_recording
from study_workers import DirectEngine

from mmocap_warp.jobs.engine import Engine
from mmocap_warp.jobs.job_run import Status, run_jobs
from mmocap_warp.study.definition import load_study
from mmocap_warp.study.store import CellTask, plan_tasks

FRAMES = 3
STUDY = """
[study]
name = "tiny"
seeds = 2
scale = 0.5

[sequences]
Walk = "walk/scene.toml"

[[grid]]
sequences = ["Walk"]
algorithms = ["h-cmaes", "cmaes", "de", "pso"]
dof = [51, 39, 28]
evaluations = [12]
"""
CELLS = 12


def write_scene(folder: Path, frames: int = FRAMES) -> Path:
    """The scene's file: three small views of a figure of boxes."""
    write_recording(folder, frames)
    scene = folder / "scene.toml"
    scene.write_text(f"{scene.read_text()}[foreground]\nmedian = 3.0\njoin = 6.0\n")
    return scene


def write_study(folder: Path, text: str = STUDY) -> Path:
    """A study of the scene in ``folder/walk``, which is made if it is not there."""
    if not (folder / "walk").exists():
        write_scene(folder / "walk")
    path = folder / "study.toml"
    path.write_text(text)
    return path


def tasks_of(study: Path, results: Path) -> list[CellTask]:
    """The cells of a study, for the CPU."""
    results.mkdir(exist_ok=True)
    return plan_tasks(load_study(study), results, "cpu")


def run_quietly(
    tasks: list[CellTask], engine: Callable[[], Engine] | None = None, notes: list[str] | None = None
) -> Status:
    """Run a study in this process, or on an engine of one's own; what is noted is added to ``notes``."""
    kept = [] if notes is None else notes
    return run_jobs(tasks, engine or DirectEngine, lambda status: None, kept.append)


def answer_members(path: Path) -> dict[str, bytes]:
    """The parts of a result file that any repetition on the same kind of device gives bit for bit, by member."""
    with zipfile.ZipFile(path) as file:
        return {name: file.read(name) for name in file.namelist() if name != "provenance.json"}
