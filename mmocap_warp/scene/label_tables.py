"""Who and what label images show: the tables [labels] and [people.<name>] of a ``scene.toml``."""

from dataclasses import replace
from itertools import chain
from pathlib import Path

from mmocap_warp.errors import InputError
from mmocap_warp.formats.toml_table import Table
from mmocap_warp.masks.mask_settings import ForegroundSettings
from mmocap_warp.scene.camera_source import CameraSource
from mmocap_warp.scene.recording import Person
from mmocap_warp.whole_file import file_name

_ROLES = ("person", "thing", "ignore", "garment")  # skin under a garment is as much in doubt as behind a thing
_NOT_GIVEN = "labels are those of given masks; these are made"


def with_labels(
    sources: tuple[CameraSource, ...], table: Table, foreground: ForegroundSettings
) -> tuple[CameraSource, ...]:
    """The cameras with the labels of who is tracked, and of what may be in front; ``table`` is [labels].

    Raises:
        InputError: labels that cannot be, or of masks that are not given.
    """
    roles = {role: _take_labels(table, role, sources) for role in _ROLES}
    several = _take_labels(table, "several", sources)
    table.finish()
    for unsure, *others in zip(several, *roles.values(), strict=True):
        if both := {*unsure} & {*chain(*others)}:
            raise table.error(f"several and another key name label {min(both)}", "leave it out of one of them")
    if any(len(labels) > 1 for labels in roles["person"]):
        raise table.error("person has several labels", "name several people in tables of their own: [people.<name>]")
    if any(map(any, [several, *roles.values()])) and foreground.source != "masks":
        raise table.error(_NOT_GIVEN, "leave the table out")
    return tuple(
        replace(source, label=next(iter(person), 0), in_front=tuple(sorted({*chain(*others)})), several=unsure)
        for source, unsure, person, *others in zip(sources, several, *roles.values(), strict=True)
    )


def read_people(
    tables: dict[str, Table],
    sources: tuple[CameraSource, ...],
    foreground: ForegroundSettings,
    scene: Path,
    body: str | Path | None,
) -> dict[str, Person]:
    """The people of tables [people.<name>], of ``body`` where theirs name none; results are named after them.

    Raises:
        InputError: labels or files that cannot be, or a label of two people.
    """
    people: dict[str, Person] = {}
    if tables and foreground.source != "masks":
        raise InputError(f"{scene}: [people]", _NOT_GIVEN, "leave the tables out")
    for name, table in tables.items():
        file_name(name, f"{scene}: [people]")
        if not table.has("label"):
            raise table.error("'label' is missing", "add label = ... (a number), or one for each camera")
        labels = _take_labels(table, "label", sources)
        if not all(len(of_camera) == 1 for of_camera in labels):
            raise table.error("label is not one number for each camera", "give label = 1, or label = { cam1 = 1, ... }")
        own = tuple(of_camera[0] for of_camera in labels)
        if any(label in (source.label, *source.in_front) for label, source in zip(own, sources, strict=True)):
            raise table.error(f"'{name}' has a label of [labels]", "leave it out of one of them")
        for other, person in people.items():
            if any(a == b for a, b in zip(own, person.labels, strict=True)):
                raise table.error(f"'{name}' and '{other}' have the same label", "give each person its own")
        subject, truth = (table.take_file(key, scene.parent, None) for key in ("subject", "truth"))
        people[name] = Person(own, subject, take_body(table, scene) or body, truth)
        table.finish()
    return people


def _take_labels(table: Table, key: str, sources: tuple[CameraSource, ...]) -> list[tuple[int, ...]]:
    """Numbers of each camera: of all alike, or by the cameras' names."""
    value = table.take_any(key, (int, list, dict), [])
    names = [source.name for source in sources]
    by_camera = value if isinstance(value, dict) else dict.fromkeys(names, value)
    if unknown := by_camera.keys() - set(names):
        raise table.error(f"{key} names '{min(unknown)}', which is no camera", f"use one of {', '.join(names)}")
    numbers = [each if isinstance(each, list) else [each] for each in (by_camera.get(name, []) for name in names)]
    if not all(type(number) is int and 0 < number < 1 << 16 for of_camera in numbers for number in of_camera):
        raise table.error(f"{key} = {value!r} is no label", "labels are whole numbers from 1 to 65535")
    return [tuple(of_camera) for of_camera in numbers]


def take_body(table: Table, scene: Path) -> str | Path | None:
    """The body that a table names: a file relative to the scene's, or a shipped one's name."""
    is_file = Path(str(table.peek("body"))).suffix
    return table.take_file("body", scene.parent, None) if is_file else table.take("body", str, None)
