"""Many recordings, each through the same steps: ``mmocap batch``."""

import base64
import hashlib
import json
import os
import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass, fields, make_dataclass
from fnmatch import fnmatch
from html import escape
from itertools import cycle, islice
from os.path import commonpath
from pathlib import Path
from typing import Any
from urllib.parse import quote

import cv2
import numpy as np

from mmocap_warp.body.model import BodyModel, Subject
from mmocap_warp.body.rest_space import RestSpace
from mmocap_warp.commands import evaluate, mask, show, track
from mmocap_warp.commands.caller import Reporter, arguments_checked, engine_of, seconds_of, start_warp
from mmocap_warp.commands.outputs import lock, releases_locks
from mmocap_warp.device.cores import available_threads
from mmocap_warp.device.resolve import resolve_device
from mmocap_warp.display.page.viewer import filled, resource
from mmocap_warp.display.result_video import overlay
from mmocap_warp.errors import InputError, UsageError, input_errors
from mmocap_warp.fitting.fit_config import KNOWN, FitConfig
from mmocap_warp.formats.table import EXPORT_SUFFIXES
from mmocap_warp.formats.toml_table import Table, config_from_table, load_toml
from mmocap_warp.formats.usd.usd_body import write_body, write_subject
from mmocap_warp.formats.usd.usd_result import read_result
from mmocap_warp.jobs.engine import Advance, Refusal
from mmocap_warp.jobs.job_run import Status, Task, run_jobs
from mmocap_warp.jobs.local_engine import forks_of, local_devices
from mmocap_warp.result.result import Result
from mmocap_warp.scene.recording import Scene
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.study.source import file_hash, recording_facts
from mmocap_warp.tracking.track_config import TrackConfig
from mmocap_warp.version import __version__
from mmocap_warp.whole_file import file_name, read_json, read_text, walk, write_whole

STEPS = ("mask", "fit", "track", "eval", "view")
"""The steps, in their order; before view there may be ``export:ENDING``."""

_FITTED = 3  # trials of a person that are fitted, and give the body together
_FAILED = 2.0  # a fit that costs over this many times the best of these has gone wrong; sound ones cost up to 1.75
_COSTLY = 0.07  # a known body that costs more is searched with all means: sound ones .04 to .06, exchanged legs .095
_COLUMNS = {"frames": "", "mean_iou": ".3f", "worst_iou": ".3f", "trusted": ".0%", "mpjpe_mm": ".1f"}
_COLUMNS |= {"marker_error_mm": ".1f"}  # of the page, with their formats
_FIGURES = [name for name in _COLUMNS if name not in ("frames", "trusted")]  # of an evaluation
_MPS = Path(os.environ.get("CUDA_MPS_PIPE_DIRECTORY", "/tmp/nvidia-mps"), "nvidia-cuda-mps-control.pid")  # if it runs
_MANY = 64  # of more scenes than this, several are read at once
_THUMBNAIL = 320  # longer side [px]

_MASK = make_dataclass("_MASK", [("scale", float, 1.0), ("consistent", bool, False), ("with_", str, "")])
_CONFIGS: dict[str, Any] = {"mask": _MASK, "fit": FitConfig, "track": TrackConfig}
_SETTINGS = {kind: {each.name for each in fields(of)} - {"device", "threads"} for kind, of in _CONFIGS.items()}

Settings = dict[str, dict[str, Any]]  # of the commands ``mask``, ``fit`` and ``track``

Rule = tuple[str, str | None, Settings]  # a pattern of names, the person whose recordings these are, and settings


@dataclass(frozen=True)
class Trial:
    """A recording to be done, a worker's job; or a person to be fitted, once for all recordings of that person."""

    name: str  # the recording's or the person's
    scenes: tuple[Path, ...]  # the scene's file; of a person, those of some recordings
    folder: Path  # what is written goes there, and nothing else may lie there
    key: str  # a hash of all that this depends on
    settings: Settings
    steps: tuple[str, ...] = ()  # none where a person is fitted
    body: Path | None = None  # file of the person's body, where the settings name the person


class TrialTask(Task):
    """A recording to be done, or a person to be fitted."""

    noun = "scene"

    def check(self) -> dict[str, Any]:
        """What was done; an InputError if that is damaged."""
        record = read_json(self.path, "run the batch again")
        if "frames" in record and not (self.job.folder / "result.usdc").exists():
            raise InputError(self.path, "is of a result that is gone", "run the batch again")
        return record

    def store(self, result: dict[str, Any]) -> None:
        """See :class:`~mmocap_warp.jobs.job_run.Task`."""
        write_whole(self.path, json.dumps(result, indent=1, allow_nan=False).encode())


class _Notes(Reporter):
    """Keeps what is wrong."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def warn(self, line: str) -> None:
        self.lines.append(line)


class TrialWorker:
    """Takes one recording after the other through its steps; see :class:`~mmocap_warp.jobs.engine.Worker`."""

    def __init__(self, device: str, threads: int | None = None) -> None:
        self.device = resolve_device(device)
        self._where: dict[str, Any] = {"device": self.device, "threads": threads}

    def work(self, job: Trial) -> Iterator[Advance | Refusal | dict[str, Any]]:
        """Do the steps: yields each, and last what they gave, or why they could not be done."""
        try:
            mark = job.folder / f"begun.{job.key}"
            if not mark.exists():
                if job.folder.exists() and any(job.folder.iterdir()) and not list(job.folder.glob("begun.*")):
                    raise InputError(job.folder, "holds files that no batch has written", "name another output folder")
                shutil.rmtree(job.folder, ignore_errors=True)  # of a scene that was another then
                job.folder.mkdir(parents=True)
                mark.touch()
            yield from self._done(job) if job.steps else self._fitted(job)
        except (InputError, UsageError) as error:
            yield Refusal(" ".join(str(error).split()))

    def _fitted(self, job: Trial) -> Iterator[Advance | dict[str, Any]]:
        """Write the body of a person: the mean of what some recordings show, of which one alone shows too little."""
        fits, problems = [], []
        for number, scene in enumerate(job.scenes):
            yield Advance("fit", number, len(job.scenes), 0)
            try:
                fits.append(track.fit(scene, **self._where | job.settings["fit"]))
            except InputError as error:
                problems.append(error)
        if not fits:
            raise problems[0]
        write_body(job.folder / "body.usdc", _mean_body(fits))
        yield {"name": job.name}

    def _done(self, job: Trial) -> Iterator[Advance | dict[str, Any]]:
        notes, started, settings, steps = _Notes(), time.perf_counter(), job.settings, dict[str, float]()
        scene, result, subject = load_scene(job.scenes[0]), job.folder / "result.usdc", None
        if scene.people:
            raise InputError(scene.path, "names several people, and a batch tracks one each", "use mmocap track for it")
        record: dict[str, Any] = {"name": job.name, "scene": str(scene.path), "notes": notes.lines}
        record["step_seconds"] = steps
        for number, step in enumerate(job.steps):
            yield Advance(step, number, len(job.steps), 0)
            begun = time.perf_counter()
            if step == "mask" and scene.foreground.source != "masks":
                given = settings["mask"] | {"force": True, "reporter": notes}
                scene = load_scene(mask.mask(scene, job.folder / "masks", **given).scene)
            elif step == "fit" and (job.body or scene.subject is None):
                subject = job.folder / "subject.usdc"
                given = self._where | {"reporter": notes} | settings["fit"]
                if not subject.exists():
                    before = len(notes.lines)
                    fitted = track.fit(scene, job.body, **(KNOWN if job.body else {}) | given)
                    if job.body and float(fitted.provenance["fit.cost"]) > _COSTLY:
                        del notes.lines[before:]  # of a fit that does not count
                        fitted = track.fit(scene, job.body, **{"rigid": True, **given})
                    write_subject(subject, fitted)
            elif step == "track":
                given = self._where | settings["track"]
                tracked = track.track(scene, subject, output=result, resume=True, reporter=notes, **given)
                record["frames"] = len(tracked.frame_numbers)
            elif step == "eval":
                report = evaluate.evaluate(result, scene=scene, reporter=notes)
                judged = report["verdict"]
                write_whole(job.folder / "evaluation.json", json.dumps(report | {"series": None}, indent=1).encode())
                record |= {name: report[name] for name in _FIGURES if report.get(name) is not None}
                record["trusted"] = judged["trusted"] / max(judged["frames"], 1)
            elif step.startswith("export:"):
                show.export(result, result.with_suffix(f".{step[7:]}"), force=True)
            elif step == "view":
                show.view(result, scene, output=job.folder / "view.html", force=True, name=job.name, reporter=notes)
                record["thumbnail"] = _thumbnail(read_result(result), scene)
            steps[step] = time.perf_counter() - begun
        yield record | {"seconds": time.perf_counter() - started}


def _mean_body(fits: Sequence[Subject]) -> BodyModel:
    """The mean of fitted bodies that are alike, without those whose fit has failed."""
    cost = np.array([float(fit.provenance["fit.cost"]) for fit in fits])
    space, betas = RestSpace(fits[int(cost.argmin())].body), []
    for number in np.flatnonzero(cost <= _FAILED * cost.min()).tolist():
        with suppress(ValueError):  # has other joints: something is carried in some recordings
            betas.append(space.nearest(fits[number].body))
    return space.model(np.mean(betas, axis=0))


def _thumbnail(result: Result, scene: Scene) -> str:
    """The body over what the first camera saw in the middle, as a small JPEG picture in base64."""
    picture = overlay(result, scene, len(result.frame_numbers) // 2)[..., ::-1]
    share = _THUMBNAIL / max(picture.shape[:2])
    small = cv2.resize(picture, None, fx=share, fy=share, interpolation=cv2.INTER_AREA)
    return base64.b64encode(cv2.imencode(".jpg", small)[1].tobytes()).decode()


@dataclass(frozen=True)
class BatchRun:
    """Where a batch stands after a run."""

    page: Path  # the HTML page, a row for each recording
    status: Status  # of the recordings and their persons: how many are done, and how fast
    # what is known of every recording that is done: its ``name``, ``scene``, ``frames``, ``seconds``, and the figures
    # of its evaluation
    trials: list[dict[str, Any]]
    failures: dict[str, str]  # recordings that are not done, by name, and why


@releases_locks
def batch(
    scenes: str | Path | Sequence[str | Path],
    output: str | Path,
    *,
    steps: str = "mask,fit,track,eval,export:glb,view",
    plan: str | Path | None = None,
    engine: str = "local",
    device: str = "auto",
    threads: int | None = None,
    address: str = "auto",
    workers: int | None = None,
    gpus: float = 1.0,
    minutes: float | None = None,
    show: Callable[[Status], None] | None = None,
    reporter: Reporter | None = None,
) -> BatchRun:
    """Take any number of recordings through the same steps, and write one page of all.

    Args:
        scenes: a folder, of which every scene.toml below it counts, or a text file with a scene in each line. From
            Python also a list of scenes.
        output: the folder of all that is written, made if it does not exist: a folder for each scene, and index.html.
        steps: joined by commas: mask, fit, track, eval, export: with an ending, and view. Masks are made where a scene
            has none, and a subject is fitted where none is known.
        plan: a TOML file of settings for all scenes, for those that match a pattern, and for persons.
        engine: what works: local, this machine, or ray, a Ray cluster that is running, whose machines see these files.
        device: local: auto (all CUDA devices, or the CPU), cpu, or a list such as cuda:0,cuda:2.
        threads: local: CPU threads of each worker. [default: all, shared out]
        address: ray: of the cluster; auto finds the one that this machine belongs to.
        workers: how many scenes at a time. [default: one on each device, or on each machine of a cluster]
        gpus: ray: of each worker; 0.5 puts two workers on a GPU, 0 none.
        minutes: limit of the run, from its workers' start; the same command continues.
        show: called with the status, at least twice a second.
        reporter: receives scenes that are given up.

    Raises:
        UsageError: arguments that cannot be.
        InputError: no scenes, settings that are wrong, or a folder that cannot be used.
    """
    reporter, folder = reporter or Reporter(), Path(output)
    chosen, files = _steps(steps), _scene_files(scenes, folder)
    rules = [] if plan is None else _rules(Path(plan))
    if workers is not None and workers < 1:
        raise UsageError(f"--workers must be at least 1, got {workers}")
    if engine == "local" and (gpus != 1.0 or address != "auto"):
        raise UsageError("--gpus and --address need --engine ray")
    seconds = seconds_of(minutes)
    start_warp()
    if engine == "local" and workers is not None:
        with arguments_checked():
            own = local_devices(device)
        if own[0] != "cpu" and workers > len(own) and shutil.which("nvidia-cuda-mps-control") and not _MPS.exists():
            reporter.note("workers take turns on a GPU; started once, 'nvidia-cuda-mps-control -d' lets them share it")
        device = ",".join(islice(cycle(own), workers))
        threads = threads or max(1, available_threads() // workers)
    kind, start = engine_of(TrialWorker, engine, device, threads, address, workers, gpus)
    people, trials, failures = _planned(files, folder, chosen, rules, str(plan), kind)
    with input_errors(folder, "cannot be made ({error})", "name another output folder", OSError):
        folder.mkdir(parents=True, exist_ok=True)
    lock(folder)
    for pattern in [rule[0] for rule in rules if not any(fnmatch(name, rule[0]) for name in files)]:
        reporter.warn(f"{plan}: no scene matches '{pattern}'; the first is called '{next(iter(files))}'")
    for name, problem in failures.items():
        reporter.warn(f"{name}: given up: {problem}")

    status = run_jobs([*people, *trials], start, show or (lambda status: None), reporter.warn, seconds)
    failures |= {task.job.name: status.failures[task.name] for task in trials if task.name in status.failures}
    done = [task.check() for task in trials if task.name not in failures]
    page = folder / "index.html"
    write_whole(page, _page(folder.resolve().name, done, failures).encode())
    return BatchRun(page, status, done, failures)


def _steps(text: str) -> tuple[str, ...]:
    """The steps in their order."""
    named = dict.fromkeys(step.strip() for step in text.split(","))
    named |= {"fit": None} if "track" in named else {}  # as far as it is needed
    exports = [step for step in named if step.startswith("export:") and f".{step[7:]}" in EXPORT_SUFFIXES]
    if "export:usdc" in named:
        raise UsageError("--steps takes no export:usdc: each result is a result.usdc already")
    if wrong := [step for step in named if step not in (*STEPS, *exports)]:
        raise UsageError(f"--steps must be of {', '.join(STEPS)} and export:ENDING, got '{wrong[0]}'")
    if "track" not in named and named.keys() - {"mask", "fit"}:
        raise UsageError("--steps needs track: what comes after it shows its result")
    return tuple(step for step in (*STEPS[:-1], *exports, STEPS[-1]) if step in named)


def _scene_files(scenes: str | Path | Sequence[str | Path], output: Path) -> dict[str, Path]:
    """The scenes' files by name: their folders, below the one that was given or else from where these part."""
    source = Path(scenes) if isinstance(scenes, str | Path) else Path("the list of scenes")
    if not isinstance(scenes, str | Path):
        given = [Path(scene) for scene in scenes]
    elif source.is_dir():
        found = sorted(Path(place, "scene.toml") for place, _, files in walk(source.resolve()) if "scene.toml" in files)
        given = [file for file in found if output.resolve() not in file.resolve().parents]
        if found and not given:
            raise InputError(output, "holds all the scenes, and would hold results as well", "name another output")
        # What lies within a scene's folder was made of it, such as its masks.
        around = {file.parent for file in given}
        given = [file for file in given if around.isdisjoint(file.parent.parents)]
    elif source.suffix == ".toml" and source.is_file():
        given = [source]
    else:
        lines = map(str.strip, read_text(source, "name a folder, or a file with a scene in each line").splitlines())
        given = [source.parent / line for line in lines if line and not line.startswith("#")]
    files = [file if file.suffix == ".toml" else file / "scene.toml" for file in given]
    if not files:
        raise InputError(source, "names no scene", "write a scene.toml for each recording, as 'mmocap init' does")
    with input_errors(source, "names no file ({error})", "name a scene in each line", ValueError):
        folders = [file.parent if source.is_dir() else file.resolve().parent for file in files]  # links have own names
    root = commonpath([folder.parent for folder in folders] + [source.resolve()] * source.is_dir())
    named = {folder.relative_to(root).as_posix(): file for folder, file in zip(folders, files, strict=True)}
    if len(named) < len(files) or not all(map({*folders}.isdisjoint, (folder.parents for folder in folders))):
        raise InputError(source, "names two scenes of one folder", "give every scene a folder of its own")
    return named


def _rules(file: Path) -> list[Rule]:
    """Patterns of names, whose recordings these are, and their settings; later ones win."""
    table, rules = load_toml(file), []
    for part in (table, *table.take_list("scenes")):
        pattern, person = ("*", None) if part is table else (part.take("match", str), part.take("person", str, None))
        parts = {kind: part.take_table(kind) for kind in _SETTINGS}
        part.finish()
        if person is not None:
            file_name(person, f"{file}: person")
        values = {kind: of.take_rest() for kind, of in parts.items()}
        for kind, names in _SETTINGS.items():
            if wrong := sorted(values[kind].keys() - names):
                raise parts[kind].error(f"{wrong[0]} is not known", f"use one of {', '.join(sorted(names))}")
        rules.append((pattern, person, values))
    return rules


def _planned(
    files: dict[str, Path], folder: Path, steps: tuple[str, ...], rules: list[Rule], plan: str, device_kind: str
) -> tuple[list[TrialTask], list[TrialTask], dict[str, str]]:
    """Tasks of persons and of recordings, and why other recordings cannot be read; an InputError for a wrong plan."""
    known: dict[str, tuple[str | None, Settings, dict[str, Any]]] = {}
    failures: dict[str, str] = {}
    for name, found in zip(files, _facts_of([*files.values()]), strict=True):
        of = [rule for rule in rules if fnmatch(name, rule[0])]
        person = next((whose for _, whose, _ in reversed(of) if whose), None)
        settings = {kind: {k: v for _, _, each in of for k, v in each[kind].items()} for kind in _SETTINGS}
        for kind, config in _CONFIGS.items():
            config_from_table(config, Table(settings[kind], plan, kind))
        if isinstance(found, str):
            failures[name] = found
        else:
            known[name] = person, settings, found

    def task(place: str, name: str, scenes: list[str], settings: Settings, *steps: str, of: Any = None) -> TrialTask:
        content, theirs = [known[scene][2] for scene in scenes], of and of.job.key
        depends = [content, settings, "mask" in steps, theirs, device_kind, __version__]
        key = hashlib.sha256(json.dumps(depends, sort_keys=True).encode()).hexdigest()[:20]
        where, body = folder / place / name, of and of.job.folder / "body.usdc"
        job = Trial(name, tuple(files[scene] for scene in scenes), where, key, settings, steps, body)
        named, after = (name, {"needs": of and of.name, "order": 1}) if steps else (f"the body of {name}", {})
        done = hashlib.sha256(json.dumps(steps).encode()).hexdigest()[:8]  # other steps go on with what is there
        return TrialTask(job, where / f"done.{key}.{done}.json", named, kind=place, **after)

    people: dict[str | None, TrialTask] = {}
    trials = []
    for name, (person, settings, _) in known.items():
        if person is not None and person not in people:
            theirs = [other for other, (whose, *_) in known.items() if whose == person]
            people[person] = task("people", person, theirs[:_FITTED], settings)
        trials.append(task("trials", name, [name], settings, *steps, of=people.get(person)))
    return list(people.values()), trials, failures


def _facts_of(files: list[Path]) -> list[dict[str, Any] | str]:
    """What a result depends on of each scene, or why it cannot be read; of many scenes by a process on each core."""
    if len(files) > _MANY:  # by 61 processes at most: Windows allows a pool no more
        with suppress(BrokenProcessPool), ProcessPoolExecutor(min(61, available_threads()), forks_of(__name__)) as pool:
            return list(pool.map(_facts, files, chunksize=_MANY // 4))
    return list(map(_facts, files))


def _facts(file: Path) -> dict[str, Any] | str:
    try:
        scene = load_scene(file)
        return recording_facts(scene) | {"files": file_hash([each for each in (scene.path, scene.subject) if each])}
    except InputError as error:
        return " ".join(str(error).split())


def _page(title: str, done: list[dict[str, Any]], failures: dict[str, str]) -> str:
    """A row for each recording, those that failed first."""
    failed = '<tr><td>{}</td><td class="failed" colspan="9">{}</td></tr>'
    rows = [failed.format(*map(escape, each)) for each in failures.items()]
    for each in done:
        name, picture = escape(each["name"]), ""
        if "thumbnail" in each:
            picture = f'<img alt="" src="data:image/jpeg;base64,{each["thumbnail"]}"/>'
            name = f'<a href="trials/{quote(each["name"])}/view.html">{name}</a>'
        cells = [format(each[key], form) if key in each else "" for key, form in _COLUMNS.items()]
        cells = [name, picture, *cells, f"{each['seconds']:.0f} s", escape("; ".join(each["notes"]))]
        rows.append(f"<tr>{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>")
    lead = f"{len(done)} of {len(done) + len(failures)} recordings are done. Written by mmocap-warp {__version__}."
    template, style, script = (resource("mmocap_warp.display.page", f"batch.{kind}") for kind in ("html", "css", "js"))
    return filled(template, title=title, script=script, style=style, lead=lead, rows="\n".join(rows))
