"""How commands talk: the parameters that they share; results on stdout, everything else on stderr; an exit code."""

from __future__ import annotations

import json as json_format
import shlex
import sys
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass, field, fields, make_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

from cyclopts import Parameter

from mmocap_warp.commands import caller
from mmocap_warp.formats.toml_table import setting_line

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

OK = 0
FAILURE = 1  # something broke that is no fault of the input
USAGE = 2  # the command line itself is wrong: UsageError
BAD_INPUT = 3  # a file or value that the user can mend: InputError
CHECK_FAILED = 4  # the command ran, and what it checked does not hold
BROKEN_PIPE = 141  # whoever was to read the output has closed it, as head does; nothing is said
INTERRUPTED = 130  # stopped by Ctrl-C
TERMINATED = 143  # stopped by SIGTERM, as by a scheduler or a machine that shuts down

# How parameters are taken that many commands have. A switch is given or not: it takes no value and has no opposite.
Switch = Annotated[bool, Parameter(negative="", show_default=False)]
Output = Parameter(name=["--output", "-o"])
Pictures = Annotated[Path | None, Output]
_IDENTITY = "The person to take, where masks show several: a palette index or a gray level."
_SCENE_FRAMES = (
    "Which of the recording's frames: first:end or first:end:stride, such as 120:480:2, which leaves out the end; or a "
    "count of those that the scene names. [default: those that the scene names]"
)
_RESULT_FRAMES = "Which frames: first:end or first:end:stride by the recording's numbers, or a count. [default: all]"
SceneFile = Annotated[Path, Parameter(help="The scene file, or its folder.")]
ResultFile = Annotated[Path, Parameter(help="What 'mmocap track' wrote.")]
Identity = Annotated[int | None, Parameter(help=_IDENTITY)]
SceneFrames = Annotated[str | None, Parameter(help=_SCENE_FRAMES)]
ResultFrames = Annotated[str | None, Parameter(help=_RESULT_FRAMES)]


def flags_of(config: type[DataclassInstance]) -> type[DataclassInstance]:
    """Flags for the settings of a configuration, each with its one statement as help; None where one is not given."""
    hints = get_type_hints(config)
    flags = [
        (each.name, Annotated[hints[each.name] | None, Parameter(help=setting_line(each))], field(default=None))
        for each in fields(config)
        if each.metadata["flag"]
    ]
    namespace = {"__module__": __name__}  # the parser does not look into a class of Python's own module "types"
    kind = make_dataclass(f"{config.__name__}Flags", flags, namespace=namespace, frozen=True, kw_only=True)
    return Parameter(name="*")(kind)


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Console(caller.Reporter):
    """The options that every command has."""

    json: Switch = False
    """Print exactly one JSON object on stdout."""
    quiet: Switch = False
    """Say nothing on stderr but warnings and errors."""
    debug: Switch = False
    """Show the traceback of an error; MMOCAP_DEBUG=1 does so too."""
    allow_references: Switch = False
    """Let USD files name others outside their folder; MMOCAP_ALLOW_REFERENCES=1 does so too."""

    def note(self, line: str) -> None:
        """Say what happens, on stderr."""
        if not self.quiet:
            print(line, file=sys.stderr, flush=True)

    def warn(self, line: str) -> None:
        """Say what is wrong, on stderr."""
        print(line, file=sys.stderr, flush=True)

    def stage(self, name: str, unit: str | None = "frames") -> AbstractContextManager[caller.Progress]:
        """Show how far a stage is, on stderr."""
        from mmocap_warp.cli.progress import Progress

        return Progress(name, unit, quiet=self.quiet)

    def result(self, values: dict[str, Any], text: str) -> None:
        """Print the command's answer on stdout: ``values`` as JSON where that is asked for, else ``text``."""
        if self.json:
            from mmocap_warp.result.json_values import json_values

            text = json_format.dumps(json_values(values), indent=2, allow_nan=False)
        print(text)


def checked(holds: bool) -> int:
    """The exit code of a command that has checked something."""
    return OK if holds else CHECK_FAILED


def table(rows: Sequence[tuple[str, ...]], left: int | None = None) -> str:
    """Aligned columns: the first ``left`` of them at their left ends, all if it is None, the others at their right."""
    aligned = [
        [f"{cell:{'<' if left is None or i < left else '>'}{max(map(len, column))}}" for cell in column]
        for i, column in enumerate(zip(*rows, strict=True))
    ]
    return "\n".join("  ".join(row).rstrip() for row in zip(*aligned, strict=True))


def given(flags: DataclassInstance | None) -> dict[str, Any]:
    """The flags that were given, by the name of their setting."""
    return {name: value for name, value in (asdict(flags) if flags else {}).items() if value is not None}


def next_step(name: str, *arguments: str | Path) -> str:
    """A command of ``mmocap`` as a shell takes it, so that it can be copied to the next prompt."""
    return shlex.join(["mmocap", name, *map(str, arguments)])
