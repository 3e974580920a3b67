"""The first frames of the built-in walk, and studies of it that take seconds."""

from __future__ import annotations

import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

from study_workers import DirectEngine
from walk_scene import walking

from mmocap_warp.body.model import Subject
from mmocap_warp.formats.usd.usd_body import write_subject
from mmocap_warp.scenes import ROOT
from mmocap_warp.study.definition import load_study
from mmocap_warp.study.engines.engine import Engine
from mmocap_warp.study.run import Status, run_study
from mmocap_warp.study.store import Task, plan_tasks

FRAMES = 3
STUDY = """
[study]
name = "tiny"
seeds = 2
scale = 0.1

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
    """The walk's first frames, with its true body and first pose as the subject."""
    for file in (ROOT / "walk").rglob("*"):
        if file.suffix in (".toml", ".usdc") or (file.suffix == ".png" and int(file.stem) < frames):
            target = folder / file.relative_to(ROOT / "walk")
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(file, target)
    made = walking()  # the whole walk: a shorter one would start elsewhere
    write_subject(folder / "subject.usdc", Subject(made.body, made.root_base, made.poses[0], {}))
    scene = folder / "scene.toml"
    scene.write_text(scene.read_text().replace("[scene]\n", '[scene]\nsubject = "subject.usdc"\n'))
    return scene


def write_study(folder: Path, text: str = STUDY) -> Path:
    """A study of the scene in ``folder/walk``, which is made if it is not there."""
    if not (folder / "walk").exists():
        write_scene(folder / "walk")
    path = folder / "study.toml"
    path.write_text(text)
    return path


def tasks_of(study: Path, results: Path) -> list[Task]:
    """The cells of a study, for the CPU."""
    results.mkdir(exist_ok=True)
    return plan_tasks(load_study(study), results, "cpu")


def run_quietly(
    tasks: list[Task], engine: Callable[[], Engine] | None = None, notes: list[str] | None = None
) -> Status:
    """Run a study in this process, or on an engine of one's own; what is noted is added to ``notes``."""
    kept = [] if notes is None else notes
    return run_study(tasks, engine or DirectEngine, lambda status: None, kept.append)


def answer_members(path: Path) -> dict[str, bytes]:
    """The parts of a result file that any repetition on the same kind of device gives bit for bit, by member."""
    with zipfile.ZipFile(path) as file:
        return {name: file.read(name) for name in file.namelist() if name != "provenance.json"}
