"""Clips that are made, and trackers compared on them: ``mmocap study make`` and ``ablate``."""

from __future__ import annotations

import csv
import io
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from mmocap_warp.commands.caller import Reporter, start_warp
from mmocap_warp.commands.outputs import lock, new_folder, releases_locks
from mmocap_warp.errors import InputError, UsageError
from mmocap_warp.formats.toml_table import Table, config_from_table
from mmocap_warp.study import ablation
from mmocap_warp.study.ablation import REPORTING, STARTS, TUNING, AblationCell, track_with_seed
from mmocap_warp.study.degradations import NONE, parse, write_people, write_sequence
from mmocap_warp.study.sequences import CLIP_PLANS, CLIPS, SEQUENCES, clip_sequence
from mmocap_warp.study.source import Clip
from mmocap_warp.study.store import open_folder
from mmocap_warp.tracking.track_config import TrackConfig
from mmocap_warp.whole_file import write_whole

_COMMON_SETTINGS = {"seed": "seeds", "runs": "seeds", "scale": "scale", "device": "device", "threads": "threads"}
"""Settings that are the same for all trackers, and the flags that set them."""


@releases_locks
def make_sequences(
    folder: str | Path,
    sequences: Sequence[str] = (),
    *,
    frames: int | None = None,
    degrade: str = "none",
    seed: int = 0,
    clip: str | Path | None = None,
    skeleton: str | Path | None = None,
    markers: str | Path | None = None,
    together: bool = False,
    force: bool = False,
    reporter: Reporter | None = None,
) -> dict[str, Path]:
    """Write shipped sequences as scenes, to look at or to track on their own.

    Args:
        folder: the folder to write; each sequence gets its own in it, such as S1/Walking.
        sequences: which: S1, S2 or S3 with /Walking, /Gestures or /Box, or further clips: S1/Spin, S2/Spin,
            Uneven/Walking, Skirt/Walking, Child/Walking. [default: the nine of S1 to S3]
        frames: at most so many of each. [default: all]
        degrade: what makes them worse: passer-by, furniture, fps=15, views=3, cut=2 (or all), calibration=10 (pixels),
            or several joined by +.
        seed: of what is random in that.
        clip: a .bvh or .amc file whose motion takes the place of the one sequence's own.
        skeleton: the .asf of an .amc. [default: beside it, named as the .amc up to '_']
        markers: the .c3d of the same take as an .amc; its marker paths become the truth.
        together: the people of the sequences, two or more, are in one scene of label images and pass each other.
        force: write among files that are there.
        reporter: who is told of progress.

    Returns:
        The scenes' files, by the sequences' names.

    Raises:
        UsageError: arguments that cannot be, or that contradict each other.
        InputError: a clip that cannot be read, or a folder that cannot be written to.
    """
    if unknown := [name for name in sequences if name not in CLIPS]:
        raise UsageError(f"--sequence {unknown[0]} is not one of {', '.join(CLIPS)}")
    if frames is not None and frames < 1:
        raise UsageError(f"--frames must be at least 1, got {frames}")
    if clip is not None and len(sequences) != 1:
        raise UsageError("--clip needs one --sequence, whose person and cameras it takes")
    if clip is not None and sequences[0] not in SEQUENCES:
        raise UsageError(f"--clip needs a --sequence of {', '.join(SEQUENCES)}, got {sequences[0]}")
    if clip is None and (skeleton or markers):
        raise UsageError(f"--{'skeleton' if skeleton else 'markers'} needs --clip")
    _check_degradation(degrade)
    people = {name.split("/")[0] for name in sequences}
    if together and (len(people) < 2 or len(people) < len(sequences) or degrade != NONE or clip is not None):
        raise UsageError("--together needs two or more --sequence of different people, without --clip and --degrade")
    folder = new_folder(folder, force=force)
    if together:
        shortest = min(CLIPS[name].frame_count for name in sequences)
        of_people = [CLIPS[name].first(min(frames or shortest, shortest)) for name in sequences]
        with (reporter or Reporter()).stage("make people") as progress:
            return {" and ".join(sequences): write_people(folder, of_people, progress)}
    scenes = {}
    for name in sequences or tuple(SEQUENCES):
        made = CLIPS[name] if clip is None else clip_sequence(name, clip, skeleton, markers)
        made = made.first(min(frames or made.frame_count, made.frame_count))
        with (reporter or Reporter()).stage(f"make {name}") as progress:
            try:
                scenes[name] = write_sequence(folder / name, made, progress, degradation=degrade, seed=seed)
            except ValueError as error:
                raise UsageError(f"--degrade: {error}") from None
    return scenes


def _check_degradation(text: str) -> None:
    try:
        parse(text)
    except ValueError as error:
        raise UsageError(f"--degrade: {error}") from None


@releases_locks
def ablate(
    folder: str | Path,
    clips: Sequence[str] = (),
    *,
    degradations: Sequence[str] = (),
    starts: Sequence[str] = (),
    trackers: Sequence[str] = (),
    seeds: int = 3,
    frames: int | None = None,
    scale: float = 1.0,
    subject: str | Path | None = None,
    device: str = "auto",
    threads: int | None = None,
    show: Callable[[AblationCell, dict[str, Any], int], None] | None = None,
) -> list[dict[str, Any]]:
    """Track clips, made worse in several ways, with several trackers, and write ``ablation.csv``.

    Args:
        folder: of the results, made if it does not exist: a JSON file for each cell, which is not tracked again, and
            ablation.csv.
        clips: shipped sequences or further clips by name, scene.toml files, or all clips for 'tuning' (choose settings
            on them) or for 'reporting' (choose nothing on them). [default: tuning]
        degradations: none, passer-by, furniture, fps=15, views=3, cut=2 (or all), calibration=10 (pixels), or several
            joined by +. [default: none]
        starts: body and first pose: given (the clip's own), solved (the body from the clip, with the given pose to
            begin with), or both found in the masks: first-frame (the body from that frame alone) or fitted (as
            'mmocap fit' does). [default: given]
        trackers: an algorithm and settings of 'mmocap track', such as h-cmaes,evaluations=300. [default: h-cmaes]
        seeds: how many, from 0 on.
        frames: at most so many of each clip. [default: all]
        scale: of masks and cameras; shipped sequences have 1.
        subject: file of the subject to start from. [default: the clip's own]
        device: auto, cpu, or a CUDA device such as cuda:0.
        threads: CPU threads. [default: all]
        show: called with each cell that is done, its measures, and how many cells there are.

    Returns:
        Of each cell: ``cell``, ``settings``, ``measures`` and ``made``.

    Raises:
        UsageError: arguments that cannot be.
        InputError: a clip that cannot be opened, or a folder that cannot be written to.
    """
    # Check all arguments first.
    folder = Path(folder)
    if seeds < 1:
        raise UsageError(f"--seeds must be at least 1, got {seeds}")
    if frames is not None and frames < 1:
        raise UsageError(f"--frames must be at least 1, got {frames}")
    ways = tuple(dict.fromkeys(degradations or (NONE,)))
    for way in ways:
        _check_degradation(way)
    begins = tuple(dict.fromkeys(starts or STARTS[:1]))
    if unknown := set(begins) - set(STARTS):
        raise UsageError(f"--start must be one of {', '.join(STARTS)}, got {min(unknown)}")
    settings = {text: _tracker_settings(text, scale, device, threads) for text in trackers or ("h-cmaes",)}
    chosen = _clips(clips or ("tuning",), frames, scale, None if subject is None else Path(subject))
    start_warp(device)
    # Every combination is a cell; cells of one clip follow each other.
    cells = [
        AblationCell(of, way, text, config, seed, begin)
        for of in chosen
        for way in ways
        for seed in range(seeds)
        for begin in begins
        for text, config in settings.items()
    ]

    def report(cell: AblationCell, measures: dict[str, Any]) -> None:
        if show:
            show(cell, measures, len(cells))

    lock(open_folder(folder))
    try:
        rows = ablation.run_ablation(folder, cells, report, track_with_seed)
    except ValueError as error:  # such as more views than a clip has, or no such model of its body
        raise UsageError(str(error)) from None
    # A line for each cell, for spreadsheets.
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*rows[0]["cell"], *rows[0]["measures"]])
    writer.writerows([*row["cell"].values(), *row["measures"].values()] for row in rows)
    write_whole(folder / "ablation.csv", text.getvalue().encode())
    return rows


def _clips(names: Sequence[str], frames: int | None, scale: float, subject: Path | None) -> list[Clip]:
    """The clips of names, of scene files and of groups."""
    groups = {"tuning": TUNING, "reporting": REPORTING}
    clips = []
    for name in dict.fromkeys(each for text in names for each in groups.get(text, (text,))):
        if name in CLIP_PLANS:
            clips.append(Clip(name, None, frames, scale, subject))
        elif name.endswith(".toml"):
            path = Path(name)
            clips.append(Clip(path.resolve().parent.name, path, frames, scale, subject))
        else:
            raise UsageError(f"--clip {name} is no scene.toml and not one of {', '.join((*groups, *CLIP_PLANS))}")
    return clips


def _tracker_settings(text: str, scale: float, device: str, threads: int | None) -> TrackConfig:
    """``h-cmaes,evaluations=300,cost=iou`` as settings; values are read as in a scene file, words need no quotes."""
    algorithm, *pairs = text.split(",")
    values: dict[str, Any] = {"algorithm": algorithm}
    for pair in pairs:
        name, _, value = pair.partition("=")
        if name in _COMMON_SETTINGS:
            raise UsageError(f"--tracker {text}: {name} holds for all trackers; use --{_COMMON_SETTINGS[name]}")
        try:
            values[name] = tomllib.loads(f"value = {value}")["value"]
        except tomllib.TOMLDecodeError:
            values[name] = value
    try:
        config = config_from_table(TrackConfig, Table(values, "--tracker", text))
        return replace(config, scale=scale, device=device, threads=threads)
    except (InputError, ValueError) as error:
        raise UsageError(f"--tracker {text}: {error}") from None
