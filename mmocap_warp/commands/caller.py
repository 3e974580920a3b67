"""What a command has from its caller: settings, of which arguments win over ``scene.toml``, and who listens to it."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any, TypeVar

from mmocap_warp.errors import InputError, UsageError, input_errors
from mmocap_warp.formats.toml_table import Table, config_from_table

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    from mmocap_warp.jobs.engine import Engine, MakeWorker

    Config = TypeVar("Config", bound=DataclassInstance)

Progress = Callable[..., None]
"""Called with the steps that are done, how many there are, and perhaps the evaluations that were spent."""


class Reporter:
    """Listens to a command. Notes and progress are dropped, warnings are Python's; a subclass may do otherwise."""

    def note(self, line: str) -> None:
        """Hear what happens."""

    def warn(self, line: str) -> None:
        """Hear what is wrong."""
        level, frame = 1, sys._getframe()
        while frame.f_back is not None and frame.f_globals.get("__name__", "").startswith("mmocap_warp."):
            level, frame = level + 1, frame.f_back
        warnings.warn(line, stacklevel=level)  # it names the caller's line, not one of ours

    def progress(self, stage: str, done: int, total: int) -> None:
        """Hear that a stage, such as ``track``, has done so many of its steps."""

    def stage(self, name: str, unit: str | None = "frames") -> AbstractContextManager[Progress]:
        """Work on a stage for as long as the context is open; what it gives is called after each step.

        Args:
            name: of the stage.
            unit: what a step is; None where steps are only shares of the whole.
        """
        return nullcontext(lambda done, total, evaluations=0: self.progress(name, done, total))


@contextmanager
def arguments_checked() -> Iterator[None]:
    """Let a ``ValueError`` that names a setting be a :class:`~mmocap_warp.errors.UsageError`."""
    try:
        yield
    except (InputError, UsageError):
        raise
    except ValueError as error:
        name, _, rest = str(error).partition(" ")
        raise UsageError(f"--{name.replace('_', '-')} {rest}") from None


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


def seconds_of(minutes: float | None) -> float | None:
    """How long a run may take, where its minutes are limited; a UsageError if that is no time at all."""
    if minutes is not None and not minutes > 0:
        raise UsageError(f"--minutes must be positive, got {minutes:g}")
    return None if minutes is None else 60.0 * minutes


def start_warp(device: str = "auto", written_in: str | None = None) -> None:
    """Start Warp without its messages and see that ``device`` is there.

    Raises:
        UsageError: this machine has no such device.
        InputError: likewise, where the device is ``written_in`` a table of a file.
    """
    from mmocap_warp.device.resolve import resolve_device, start_quietly

    start_quietly()
    with input_errors(written_in, "{error}", "name one of these", ValueError) if written_in else arguments_checked():
        resolve_device(device)


def engine_of(
    make: MakeWorker, engine: str, device: str, threads: int | None, address: str, workers: int | None, gpus: float
) -> tuple[str, Callable[[], Engine]]:
    """Where many jobs are done: the kind of the devices, and what starts a worker on each; arguments are commands'.

    Raises:
        UsageError: arguments that cannot be.
        InputError: Ray is not installed, or there is no such cluster.
    """
    if threads is not None and threads < 1:
        raise UsageError(f"--threads must be at least 1, got {threads}")
    if engine == "local":
        from mmocap_warp.device.resolve import device_kind
        from mmocap_warp.jobs.local_engine import LocalEngine, local_devices

        with arguments_checked():
            devices = local_devices(device)
        return device_kind(devices[0]), lambda: LocalEngine(make, devices, threads)
    if engine != "ray":
        raise UsageError(f"--engine must be local or ray, got '{engine}'")
    if device != "auto" or threads is not None:
        raise UsageError("--device and --threads are of this machine: they cannot be given with --engine ray")
    from mmocap_warp.jobs.ray_engine import RayEngine, join_cluster, share_cluster

    head = join_cluster(address)
    with arguments_checked():
        shares = share_cluster(workers, gpus)
    return shares.device_kind, lambda: RayEngine(make, head, shares)
