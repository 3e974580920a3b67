"""Settings of a command: arguments win over ``scene.toml``, which wins over the defaults."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any, TypeVar

from mmocap_warp.errors import InputError, UsageError
from mmocap_warp.formats.toml_table import Table, config_from_table

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    Config = TypeVar("Config", bound=DataclassInstance)


@contextmanager
def arguments_checked() -> Iterator[None]:
    """Let a ``ValueError`` that names a setting be a :class:`~mmocap_warp.errors.UsageError`."""
    try:
        yield
    except (InputError, UsageError):
        raise
    except ValueError as error:
        raise UsageError.of_setting(error) from None


def effective(kind: type[Config], written: Table, given: Mapping[str, Any], base: Config | None = None) -> Config:
    """The settings to run with: those of the scene file, or of ``base``, but for those that the caller gives by name.

    Their ``kind`` is a frozen dataclass that checks its fields and raises ``ValueError``.

    Raises:
        InputError: the scene file holds an unknown name or a wrong value.
        UsageError: a given value is wrong.
        TypeError: a given name is no setting.
    """
    config = config_from_table(kind, written) if base is None else base
    with arguments_checked():
        return replace(config, **given)


def describe(config: DataclassInstance, written: Mapping[str, Any], given: Mapping[str, Any]) -> str:
    """The effective settings in one line, each with where it comes from unless that is the default."""
    parts = []
    for name, value in asdict(config).items():
        origin = " (flag)" if name in given else " (scene.toml)" if name in written else ""
        if value is not None:
            parts.append(f"{name} {str(value).lower() if isinstance(value, bool) else value}{origin}")
    return ", ".join(parts)


def start_warp(device: str = "auto") -> None:
    """Start Warp without its messages and see that ``device`` is there.

    Raises:
        UsageError: this machine has no such device.
    """
    from mmocap_warp.device.resolve import resolve_device, start_quietly

    start_quietly()
    with arguments_checked():
        resolve_device(device)
