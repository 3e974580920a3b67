"""Settings of a command: flags win over ``scene.toml``, which wins over the defaults."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any, TypeVar

from mmocap_warp.cli.exit_codes import UsageError
from mmocap_warp.formats.toml_table import Table, config_from_table

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    Config = TypeVar("Config", bound=DataclassInstance)


def effective(kind: type[Config], written: Table, flags: Any) -> Config:
    """The settings to run with.

    Args:
        kind: a frozen dataclass that checks its fields and raises ``ValueError``.
        written: the scene file's table of them.
        flags: a dataclass with some of the same fields, ``None`` where a flag was not given.

    Raises:
        InputError: the scene file holds an unknown name or a wrong value.
        UsageError: a flag's value is wrong.
    """
    config = config_from_table(kind, written)
    given = _given(flags)
    try:
        return replace(config, **given)
    except ValueError as error:
        raise UsageError(as_flag(error)) from None


def describe(config: DataclassInstance, written: Mapping[str, Any], flags: Any) -> str:
    """The effective settings in one line, each with where it comes from unless that is the default."""
    given = _given(flags)
    parts = []
    for name, value in asdict(config).items():
        origin = " (flag)" if name in given else " (scene.toml)" if name in written else ""
        if value is not None:
            parts.append(f"{name} {str(value).lower() if isinstance(value, bool) else value}{origin}")
    return ", ".join(parts)


def _given(flags: Any) -> dict[str, Any]:
    return {name: value for name, value in asdict(flags).items() if value is not None}


def as_flag(error: ValueError) -> str:
    """A message that starts with a setting's name, in the words of the command line."""
    name, _, rest = str(error).partition(" ")
    return f"--{name.replace('_', '-')} {rest}"
