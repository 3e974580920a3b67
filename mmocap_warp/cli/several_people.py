"""Commands that do the same for each of several people of a scene or a result."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from mmocap_warp.cli.command import Answer
from mmocap_warp.cli.console import BAD_INPUT, Console
from mmocap_warp.errors import InputError

if TYPE_CHECKING:
    from mmocap_warp.scene.recording import Scene

T = TypeVar("T")


def everybody(scene: Scene, person: str | None) -> list[str]:
    """The people who are meant one after the other; none where one is, or the scene names nobody."""
    all_of_them = person == "all" and person not in scene.people
    return [*scene.people] if all_of_them or not (person or scene.person) else []


def file_of(output: Path, name: str) -> Path:
    """The file of one of several people: ``result.anna.usdc`` for ``result.usdc``."""
    return output.with_name(f"{output.stem}.{name}{output.suffix}")


def of_each(console: Console, work: Mapping[str, Callable[[], T]]) -> tuple[dict[str, T], dict[str, Answer]]:
    """What is done for each person, by name, and what is said of those for whom it failed: others go on."""
    done: dict[str, T] = {}
    failed: dict[str, Answer] = {}
    for name, do in work.items():
        try:
            done[name] = do()
        except InputError as error:
            console.warn(f"{name}: {error}")
            failed[name] = Answer({"problem": str(error)}, [f"failed: {error}"], BAD_INPUT)
    return done, failed


def together(answers: Mapping[str, Answer]) -> Answer:
    """The answers about several people, by their names, as one."""
    lines = [line for name, answer in answers.items() for line in (f"{name}:", *answer.lines)]
    codes = [answer.code for answer in answers.values()]
    values = {name: answer.values for name, answer in answers.items()}
    return Answer({"people": values}, lines, BAD_INPUT if BAD_INPUT in codes else max(codes))


def answer_of_each(console: Console, work: Mapping[str, Callable[[], Answer]]) -> Answer:
    """One answer about all for whom something is done."""
    done, failed = of_each(console, work)
    answers = done | failed
    return together({name: answers[name] for name in work})
