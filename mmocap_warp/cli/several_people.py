"""Commands that do the same for each of several people of a scene or a result."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from mmocap_warp.cli.command import Answer
from mmocap_warp.cli.console import BAD_INPUT, Console
from mmocap_warp.errors import InputError

if TYPE_CHECKING:
    from mmocap_warp.scene.recording import Scene


def everybody(scene: Scene, person: str | None) -> list[str]:
    """The people who are meant one after the other; none where one is, or the scene names nobody."""
    all_of_them = person == "all" and person not in scene.people
    return [*scene.people] if all_of_them or not (person or scene.person) else []


def answer_of_each(
    console: Console, work: Mapping[str, Callable[[], Answer]], problems: Mapping[str, InputError] | None = None
) -> Answer:
    """One answer about all for whom something is done, and those who had ``problems`` before."""
    from mmocap_warp.commands.track_people import of_each

    answers, failed = of_each(console, work)
    for name, error in (failed | dict(problems or {})).items():
        answers[name] = Answer({"problem": str(error)}, [f"failed: {error}"], BAD_INPUT)
    lines = [line for name, answer in answers.items() for line in (f"{name}:", *answer.lines)]
    codes = [answer.code for answer in answers.values()]
    values = {name: answer.values for name, answer in answers.items()}
    return Answer({"people": values}, lines, BAD_INPUT if BAD_INPUT in codes else max(codes))
