"""A study as its TOML file defines it: the grid as data."""

from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

from mmocap_warp.formats.toml_table import Table, load_toml
from mmocap_warp.study.cell import Cell
from mmocap_warp.study.source import Clip
from mmocap_warp.tracking.track_config import TrackConfig
from mmocap_warp.whole_file import file_name

_PERSON_DOFS = (39, 28, 51)  # degrees of freedom that a person can have
_EXTRAS = ("polish", "solved")  # of an algorithm, each after a plus


@dataclass(frozen=True)
class Plan:
    """A cell with all that says how it is tracked, but for the device."""

    cell: Cell  # which one
    clip: Clip  # what is tracked
    config: TrackConfig  # settings
    solved: bool = False  # whether the body is solved from the clip, instead of taken as given
    grid: int = 0  # number of the grid that it stands in; those of an earlier one are tracked first


@dataclass(frozen=True)
class Study:
    """A study."""

    name: str  # what it is called
    plans: tuple[Plan, ...]  # one per cell, in the file's order

    @property
    def clips(self) -> tuple[Clip, ...]:
        """What is tracked, each clip once."""
        return tuple(dict.fromkeys(plan.clip for plan in self.plans))


def load_study(path: str | Path) -> Study:
    """Read a ``STUDY.toml`` (``docs/study.md``), paths in it from its folder; an InputError for what is wrong in it."""
    path = Path(path)
    file = load_toml(path)
    table = file.take_table("study")
    common = {key: _whole(table, key, *of) for key, of in _WHOLE.items()} | {"scale": table.take("scale", float, 1.0)}
    name = table.take("name", str, path.stem)
    table.finish()
    table = file.take_table("sequences")  # the user's own: scene file by name
    scenes = {}
    for key, value in table.take_rest().items():
        if not isinstance(value, str):
            raise table.error(f"{key} = {value!r} is not a string", "name a scene.toml")
        scenes[key] = path.parent / value
    grids = file.take_list("grid")
    file.finish()
    for part in (part for name in scenes for part in name.split("/")):
        file_name(part, f"{path}: [sequences]")
    if not grids:
        raise file.error("there is no grid", "add a table [[grid]] with sequences, algorithms, dof and evaluations")
    plans: dict[Cell, Plan] = {}
    for number, grid in enumerate(grids, 1):
        for plan in _grid(grid, number, common, scenes):
            if plans.setdefault(plan.cell, plan) != replace(plan, grid=plans[plan.cell].grid):
                raise grid.error(f"{plan.cell} is in an earlier grid with other seeds or frames", "keep one of them")
    return Study(name, tuple(plans.values()))


_WHOLE: dict[str, tuple[int | None, int]] = {"seeds": (1, 1), "first_seed": (0, 0), "frames": (None, 1)}
"""Of [study], and of a grid that differs: what it is by default, and the least that it can be."""


def _grid(grid: Table, number: int, common: dict[str, Any], scenes: dict[str, Path]) -> list[Plan]:
    """The plans of one [[grid]]: every combination of what it lists; ``common`` is what it inherits from [study]."""
    axes = (
        _values(grid, "sequences", str),
        _values(grid, "presets", str, ["recording"]),
        _values(grid, "evaluations", int, [None]),
        _values(grid, "dof", int),
        _values(grid, "algorithms", str),
    )
    seeds, seed, frames = (_whole(grid, key, common[key], least) for key, (_, least) in _WHOLE.items())
    grid.finish()
    plans, scale = [], common["scale"]
    for sequence, preset, evaluations, dof, algorithm in product(*axes):
        name, *extras = algorithm.split("+")
        if extras != [extra for extra in _EXTRAS if extra in extras]:
            raise grid.error(f"algorithm '{algorithm}' has another + than {list(_EXTRAS)}, in this order", "correct it")
        values = {"dof": dof, "evaluations": evaluations, "seed": seed, "runs": seeds, "preset": preset, "scale": scale}
        with grid.errors("correct that value"):
            config = TrackConfig(algorithm=name, polish="polish" in extras, **values)
        config = config if config.budget else replace(config, evaluations=None)  # it searches nothing
        if sequence not in scenes and dof not in _PERSON_DOFS:  # who is in a scene of one's own is not known yet
            raise grid.error(f"dof must be one of {list(_PERSON_DOFS)}, got {dof}", "correct that value")
        clip = Clip(sequence, scenes.get(sequence), frames, scale)
        cell = Cell(sequence, algorithm, dof, config.budget, preset)
        plans.append(Plan(cell, clip, config, "solved" in extras, number))
    return plans


def _values(table: Table, key: str, kind: type, default: Any = ...) -> list[Any]:
    values = table.take(key, list, default)
    if values is default:
        return values
    if not values or any(type(value) is not kind for value in values):
        wanted = "strings" if kind is str else "whole numbers"
        raise table.error(f"{key} = {values!r} is not a list of {wanted}", f"list one or more {wanted}")
    if kind is int and max(map(abs, values)) >= 2**31:
        raise table.error(f"{key} has a number of over 31 bits", "give a smaller one")
    return values


def _whole(table: Table, key: str, default: int | None, least: int) -> Any:
    value = table.take(key, int, default)
    if value is not None and value < least:
        raise table.error(f"{key} = {value} is below {least}", f"give {least} or more")
    return value
