"""From a scene of several people to a result each, and a file of all: ``mmocap track --person all``."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from mmocap_warp.commands.caller import Reporter, effective
from mmocap_warp.commands.inputs import Frames, scene_from
from mmocap_warp.commands.mask import with_masks
from mmocap_warp.commands.outputs import new_file, releases_locks
from mmocap_warp.commands.track import track
from mmocap_warp.errors import InputError, UsageError
from mmocap_warp.formats.usd.usd_file import USD_SUFFIXES
from mmocap_warp.formats.usd.usd_people import results_in, write_people
from mmocap_warp.formats.usd.usd_result import write_result
from mmocap_warp.result.result import Result
from mmocap_warp.scene.recording import Scene
from mmocap_warp.tracking.telling_apart import doubted_together
from mmocap_warp.tracking.track_config import TrackConfig

T = TypeVar("T")


@releases_locks
def track_people(
    scene: Scene | str | Path,
    output: str | Path | None = None,
    *,
    frames: Frames = None,
    resume: bool = False,
    force: bool = False,
    reporter: Reporter | None = None,
    **arguments: Any,
) -> dict[str, Result]:
    """Track everybody in a scene, one after the other; where poses tell them apart, all are in doubt where one is.

    Args:
        scene: the recording, or its file or folder.
        output: the file of all. It refers to each person's own beside it: ``result.anna.usdc`` for ``result.usdc``.
        frames: which of the recording's frames. [default: those that the scene names]
        resume: continue an interrupted run.
        force: replace results that exist.
        reporter: receives notes, progress, and a warning of each who cannot be tracked.
        arguments: others of :func:`track`: ``config``, single settings, ``trust_cameras`` and so on.

    Returns:
        Each person's result by name, of those who can be tracked.

    Raises:
        UsageError: the scene names nobody. InputError: nobody can be tracked. Others: see :func:`track`.
    """
    reporter, loaded = reporter or Reporter(), scene_from(scene, frames)
    if not loaded.people:
        raise UsageError("the scene names no people: track its one person with track")
    everybody(loaded, "all", subject=arguments.get("subject"), again=arguments.get("again"))
    settings = {name: value for name, value in arguments.items() if name in vars(TrackConfig())}
    chosen = effective(TrackConfig, loaded.settings("track"), settings, arguments.get("config"))
    made, file = with_masks(loaded, reporter, chosen), None if output is None else Path(output)
    given = arguments | {"resume": resume, "force": force, "reporter": reporter}
    tracked, problems = track_each(made, file, lambda one, to: track(one, output=to, **given), reporter, resume, force)
    if not tracked:
        raise next(iter(problems.values()))
    return tracked


def track_each(
    scene: Scene,
    output: Path | None,
    track_one: Callable[[Scene, Path | None], Result],
    reporter: Reporter,
    resume: bool,
    force: bool,
) -> tuple[dict[str, Result], dict[str, InputError]]:
    """What ``track_one`` makes of each person in a scene whose masks are made, and why others cannot be tracked."""
    before = results_in(output) if resume and output and output.exists() else {}
    if output:
        new_file(output, *USD_SUFFIXES, force=force or bool(before))
    files = {name: file_of(output, name) if output else None for name in scene.people}
    work = {name: lambda name=name: track_one(scene.of_person(name), files[name]) for name in files}
    tracked, problems = of_each(reporter, work)
    if scene.told_apart and tracked:
        tracked, count = doubted_together(tracked)
        if count:
            reporter.note(f"people: in {count} frames one is in doubt, and so are all")
    written = {name: (file, tracked[name]) for name, file in files.items() if file and name in tracked}
    for file, result in written.values() if scene.told_apart else ():
        write_result(file, result)
    if output and written and (force or [*before] != [*written]):
        write_people(output, written)
    return tracked, problems


def everybody(scene: Scene, person: str | None, **of_one: object) -> list[str]:
    """The people who are meant one after the other, or none; a UsageError if several are given what is ``of_one``."""
    all_of_them = person == "all" and person not in scene.people
    people = [*scene.people] if all_of_them or not (person or scene.person) else []
    if len(people) > 1 and (given := [name for name, value in of_one.items() if value is not None]):
        raise UsageError(f"--{given[0]} is of one person: choose one of {', '.join(people)} by --person")
    return people


def file_of(output: Path, name: str) -> Path:
    """The file of one of several people: ``result.anna.usdc`` for ``result.usdc``."""
    return output.with_name(f"{output.stem}.{name}{output.suffix}")


def of_each(reporter: Reporter, work: Mapping[str, Callable[[], T]]) -> tuple[dict[str, T], dict[str, InputError]]:
    """What is done for each person, by name, and why it failed for others: a warning says so, and the rest goes on."""
    done: dict[str, T] = {}
    problems: dict[str, InputError] = {}
    for name, do in work.items():
        try:
            done[name] = do()
        except InputError as error:
            reporter.warn(f"{name}: {error}")
            problems[name] = error
    return done, problems
