"""Reading TOML with one clear line for every mistake: wrong type, missing or unknown key, wrong setting."""

from __future__ import annotations

import difflib
import inspect
import math
import os
import re
import tomllib
import types
from collections.abc import Iterable
from contextlib import AbstractContextManager
from dataclasses import Field, field, fields
from numbers import Integral, Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, get_args, get_type_hints

from mmocap_warp.errors import InputError, input_errors
from mmocap_warp.whole_file import native_path, read_text

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    Config = TypeVar("Config", bound=DataclassInstance)

_MAX_BYTES = 1 << 22  # of a file; the project's own have some kilobytes
_MAX_LEVELS = 32  # of tables and lists; the project's own files have four

_KINDS = {str: "a string", bool: "true or false", int: "a whole number", float: "a number"}
_KINDS |= {list: "a list", dict: "a table"}


def load_toml(path: str | Path) -> Table:
    """The whole file as a :class:`Table`."""
    text = read_text(path, "give a TOML text file", most=_MAX_BYTES)
    too_deep = InputError(path, f"is nested over {_MAX_LEVELS} levels deep", "flatten its tables and lists")
    try:
        values = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(path, f"is not valid TOML: {error}", "correct that line") from None
    except ValueError:  # Python's own limit
        raise InputError(path, "holds a number of more digits than can be read", "correct that number") from None
    except RecursionError:
        raise too_deep from None
    level: list[Any] = [values]
    for _ in range(_MAX_LEVELS):  # a dotted key nests tables without the parser's recursion
        inner = [each for outer in level for each in (outer.values() if isinstance(outer, dict) else outer)]
        level = [each for each in inner if isinstance(each, (dict, list))]
    if level:
        raise too_deep
    return Table(values, str(path), "")


def quoted(text: str) -> str:
    """A TOML basic string, all on one line and visible; what is not UTF-8 becomes ``?``."""
    text = text.encode(errors="replace").decode()
    escaped = {"\\": "\\\\", '"': '\\"'}
    return '"' + "".join(escaped.get(c, c) if c.isprintable() else f"\\U{ord(c):08x}" for c in text) + '"'


def quoted_key(text: str) -> str:
    """A TOML key, in quotes if it needs them."""
    return text if re.fullmatch(r"[A-Za-z0-9_-]+", text) else quoted(text)


def visible(text: str) -> str:
    """Text for a comment, all on one line: what cannot be seen is a blank."""
    return "".join(c if c.isprintable() else " " for c in text)


def relative_path(path: Path, folder: Path) -> Path:
    """A path from a folder; on another drive of Windows, to which none leads, it is absolute."""
    try:
        return Path(os.path.relpath(path, folder))
    except ValueError:
        return path.absolute()


def quoted_path(path: Path, folder: Path) -> str:
    """A path as a TOML string, for a file in ``folder``: from there, with slashes; an InputError if it is not UTF-8."""
    return quoted(Path(native_path(str(relative_path(path.resolve(), folder.resolve())))).as_posix())


def toml_value(value: Any) -> str:
    """A value as a TOML file has it: a string, truth, number, or a list of them."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(toml_value, value))}]"
    return quoted(value) if isinstance(value, str) else repr(value)


def is_number(value: object) -> bool:
    """Whether a value of a TOML file is a number, whole ones within the 64 bits that TOML asks for."""
    return type(value) is float or (type(value) is int and -(2**63) <= value < 2**63)


class Table:
    """A TOML table that is emptied key by key; what is left over at the end is unknown.

    Messages name the file that it is from, its ``source``, and its own ``name``, such as ``cameras.cam01``, which is
    empty for the whole file.
    """

    def __init__(self, values: dict[str, Any], source: str, name: str) -> None:
        self._values = dict(values)
        self._known: list[str] = []
        self.source, self.name = source, name
        self.where = f"{source}: [{name}]" if name else source

    def error(self, problem: str, remedy: str) -> InputError:
        """An :class:`InputError` that names the file and this table."""
        return InputError(self.where, problem, remedy)

    def errors(self, remedy: str, problem: str = "{error}") -> AbstractContextManager[None]:
        """Let a ``ValueError`` be an :meth:`error`, whose ``problem`` has its text."""
        return input_errors(self.where, problem, remedy, ValueError)

    def take(self, key: str, kind: type, default: Any = ...) -> Any:
        """The value of ``key``, which must be of ``kind`` (a whole number is a number too); required without default.

        Raises:
            InputError: missing, of another type, or a number that is not finite.
        """
        if not self._check_presence(key, default, f"... ({_KINDS[kind]})"):
            return default
        value = self._values.pop(key)
        if type(value) is int and not is_number(value):
            raise self.error(f"{key} is a number of over 64 bits", "give an ordinary number")
        if kind is float and type(value) is int:
            value = float(value)
        if type(value) is not kind:
            raise self.error(f"{key} = {value!r} is not {_KINDS[kind]}", f"give {_KINDS[kind]}")
        if isinstance(value, float) and not math.isfinite(value):
            raise self.error(f"{key} is not finite", "give an ordinary number")
        return value

    def has(self, key: str) -> bool:
        """Whether ``key`` is there and has not been taken."""
        return key in self._values

    def peek(self, key: str) -> Any:
        """The value of ``key`` without taking it; None where it is not there."""
        return self._values.get(key)

    def replace(self, key: str, value: Any) -> None:
        """Let ``key`` have another value, such as its own in another form."""
        self._values[key] = value

    def take_any(self, key: str, kinds: tuple[type, ...], default: Any) -> Any:
        """The value of ``key`` where several kinds are possible."""
        kind = next((kind for kind in kinds if type(self._values.get(key)) is kind), kinds[0])
        return self.take(key, kind, default)

    def take_choice(self, key: str, choices: tuple[str, ...], default: Any = ...) -> Any:
        """A string that must be one of ``choices``; an absent one is ``default``, whatever that is."""
        value = self.take(key, str, default)
        if value is not default and value not in choices:
            raise self.error(f"{key} = {value!r} is not known", f"use one of {', '.join(map(repr, choices))}")
        return value

    def take_numbers(self, key: str, count: tuple[int, ...], default: Any = ...) -> list[float]:
        """A list of finite numbers, as long as one of ``count`` says."""
        if not self._check_presence(key, default, "[...]"):
            return default
        value, length = self._values.pop(key), " or ".join(map(str, count))
        if not (isinstance(value, list) and len(value) in count and all(map(is_number, value))):
            raise self.error(f"{key} = {value!r} is not {length} numbers", f"give a list of {length} numbers")
        if not all(math.isfinite(v) for v in value):
            raise self.error(f"{key} holds a value that is not finite", "give ordinary numbers")
        return [float(v) for v in value]

    def take_table(self, key: str) -> Table:
        """A table inside this one; an absent one is empty."""
        return Table(self.take(key, dict, {}), self.source, f"{self.name}.{key}" if self.name else key)

    def take_tables(self) -> dict[str, Table]:
        """All tables that are left, by name."""
        keys = [key for key, value in self._values.items() if isinstance(value, dict)]
        return {key: self.take_table(key) for key in keys}

    def take_tables_of(self, key: str) -> dict[str, Table]:
        """The tables inside a table, by name; it may hold nothing else, or be absent."""
        holder = self.take_table(key)
        tables = holder.take_tables()
        holder.finish()
        return tables

    def take_file(self, key: str, folder: Path, default: Any = ...) -> Any:
        """The file that is named, relative to ``folder``; an absent one is ``default``."""
        if (name := self.take(key, str, default)) is default:
            return default
        if not os.path.isfile(folder / name):
            raise self.error(f"{folder / name} does not exist", "check the path; it is relative to the scene file")
        return folder / name

    def take_list(self, key: str) -> list[Table]:
        """The tables ``[[key]]`` in their order."""
        values = self.take(key, list, [])
        if not all(isinstance(each, dict) for each in values):
            raise self.error(f"{key} is not a list of tables", f"write [[{key}]] before each of them")
        return [Table(each, self.source, f"{key} {number}") for number, each in enumerate(values, 1)]

    def take_rest(self) -> dict[str, Any]:
        """Everything that is left, unchecked."""
        rest, self._values = self._values, {}
        return rest

    def _check_presence(self, key: str, default: Any, example: str) -> bool:
        """Whether ``key`` is there. Raise InputError for one that must be, which is perhaps there but misspelt."""
        self._known.append(key)
        if key not in self._values and default is ...:
            near = difflib.get_close_matches(key, self._values, 1, 0.7)
            raise self.error(f"'{key}' is missing", f"is it '{near[0]}'?" if near else f"add {key} = {example}")
        return key in self._values

    def finish(self) -> None:
        """Raise InputError for a key that is not known, and name the known one that is nearest."""
        if not self._values:
            return
        key = next(iter(self._values))
        near, known = difflib.get_close_matches(key, self._known, 1, 0.4), ", ".join(dict.fromkeys(self._known))
        remedy = f"did you mean '{near[0]}'?" if near else f"known keys: {known}" if known else "take it out"
        raise self.error(f"unknown key '{key}'", remedy)


def setting(default: Any, meaning: str, otherwise: str = "", *, flag: bool = True) -> Any:
    """A field of a configuration: its default, and the one statement of what it means, for help and documents.

    ``otherwise`` is the default in words, where the value does not tell it. The command line has a ``flag`` of its
    name.
    """
    return field(default=default, metadata={"meaning": meaning, "otherwise": otherwise, "flag": flag})


def check_kinds(config: Config) -> None:
    """Raise a ValueError unless each number and switch of a configuration is one, and whole where it must be."""
    for name, hint in get_type_hints(type(config)).items():
        value, (kind, *others) = getattr(config, name), get_args(hint) or (hint,)
        allowed = {bool: bool, int: Integral, float: Real}.get(kind)
        if allowed is None or (value is None and types.NoneType in others):
            continue
        if not isinstance(value, allowed) or isinstance(value, bool) != (kind is bool):
            raise ValueError(f"{name} must be {_KINDS[kind]}, got {value!r}")


def describes_settings(kind: type[Config]) -> type[Config]:
    """Let the docstring of a configuration tell what each :func:`setting` means."""
    lines = [f"    {each.name}: {setting_line(each)}" for each in fields(kind)]
    kind.__doc__ = "\n".join([inspect.cleandoc(kind.__doc__ or ""), "", "Attributes:", *lines])
    return kind


def setting_line(each: Field) -> str:
    """What a setting means, and its default."""
    default: Any = each.default
    if isinstance(default, bool):
        default = "yes" if default else "no"
    elif isinstance(default, float):
        default = f"{default:g}"
    default = each.metadata["otherwise"] or default
    return f"{each.metadata['meaning']} [default: {default}]"


def listed(names: Iterable[str]) -> str:
    """Names that one may choose from: ``a, b or c``."""
    *most, last = names
    return f"{', '.join(most)} or {last}" if most else last


def config_from_table(kind: type[Config], table: Table) -> Config:
    """The settings that a table holds, with defaults for the others; the table is emptied.

    ``kind`` is a dataclass that checks its fields and raises ``ValueError``.
    """
    hints = get_type_hints(kind)
    values = {}
    for each in fields(kind):
        hint = hints[each.name]
        if isinstance(hint, types.UnionType):  # a setting that may also be None
            hint = next(arm for arm in get_args(hint) if arm is not type(None))
        values[each.name] = table.take(each.name, hint, each.default)
    table.finish()
    with table.errors("correct that value"):
        return kind(**values)
