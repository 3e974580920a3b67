"""A command of the command line, made from the function that does its work: it has that function's parameters and help.

They are read from the function's source, so that neither a help nor a list of commands imports what the work needs.
"""

import ast
import inspect
import re
import signal
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from inspect import Parameter
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from cyclopts import Parameter as CliParameter

from mmocap_warp.cli.console import BAD_INPUT, OK, Console, Identity, Output, ResultFile, SceneFile, Switch, given
from mmocap_warp.errors import InputError
from mmocap_warp.formats.sandbox import start_sandbox

_TYPES: dict[str, Any] = {"str": str, "int": int, "float": float, "bool": bool, "Path": Path, "Frames": str}
_KNOWN = (*_TYPES, "tuple", "Literal")  # the command line has no parameter of any other type
_FILES: dict[str, Any] = {"scene": SceneFile, "result": ResultFile}
_OF_OTHERS = {"scene", "result", "results", "example"}  # parameters that name files, which the sandbox reads first
REQUIRED = Parameter.empty  # the default of a parameter that has none
BY_PLACE, BY_FLAG, ANY_NUMBER = Parameter.POSITIONAL_ONLY, Parameter.KEYWORD_ONLY, Parameter.VAR_POSITIONAL
_LAST = ("settings", "resume", "accept_changed_code", "trust_cameras", "force")  # the flags at the end


class Given(NamedTuple):
    """How the command line takes a parameter in another way than the function."""

    type: Any  # as the parser reads it
    default: Any = ...  # ``REQUIRED`` for none; the function's own where it is left out
    kind: Any = ...  # ``BY_PLACE``, ``BY_FLAG`` or ``ANY_NUMBER``; where it is left out it follows from the function's


def several(flag: str, of: type = str) -> Any:
    """Values of a flag that may be given many times."""
    return Annotated[tuple[of, ...], CliParameter(name=flag, negative="", show_default=False)]  # type: ignore[valid-type]


class Answer(NamedTuple):
    """What a command prints on stdout, values as JSON for programs or lines for people, and its exit code."""

    values: dict[str, Any]
    lines: Iterable[object]
    code: int = OK


def answer_of_each(
    console: Console, work: Mapping[str, Callable[[], Answer]], problems: Mapping[str, InputError] | None = None
) -> Answer:
    """One answer about several people, and about those who had ``problems`` before."""
    from mmocap_warp.commands.track_people import of_each

    answers, failed = of_each(console, work)
    for name, error in (failed | dict(problems or {})).items():
        answers[name] = Answer({"problem": str(error)}, [f"failed: {error}"], BAD_INPUT)
    lines = [line for name, answer in answers.items() for line in (f"{name}:", *answer.lines)]
    codes = [answer.code for answer in answers.values()]
    values = {name: answer.values for name, answer in answers.items()}
    return Answer({"people": values}, lines, BAD_INPUT if BAD_INPUT in codes else max(codes))


def attributes(of: object, *names: str, at: int | None = None, **keys: str) -> dict[str, Any]:
    """Attributes of an object by their names, and by other keys; with ``at``, the element there of each."""
    values = {key: getattr(of, name) for key, name in [*zip(names, names, strict=True), *keys.items()]}
    return values if at is None else {key: value[at] for key, value in values.items()}


def command(
    target: str, order: str = "output", calibrated: bool = True, **types: Any
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Let a function that prints the answer of another one have the other's parameters on the command line.

    The printing function names those of the parameters that it needs, besides ``console`` and ``call``, which does the
    work; arguments of ``call`` replace those of the command line. Where it names ``loaded``, the scene is read first.
    It returns an :class:`Answer`.

    Args:
        target: ``module:function`` in the room of commands.
        order: the flags that come first.
        calibrated: whether a scene that is read first must have a calibration.
        types: of parameters that the command line takes in another way: a type, or :class:`Given`; None leaves a
            parameter out. One that the function does not have is for the printing function alone.
    """
    module, function_name = target.split(":")
    own, help_text = _declaration(module, function_name)
    signature = _signature(own, types, order.split())

    def decorate(print_answer: Callable[..., Any]) -> Callable[..., Any]:
        needed = inspect.signature(print_answer).parameters

        def run(*arguments: Any, **named: Any) -> Any:
            bound = signature.bind(*arguments, **named)
            bound.apply_defaults()
            values = bound.arguments
            values["console"] = console = values["console"] or Console()
            if not _OF_OTHERS.isdisjoint(own):
                start_sandbox()
            with _undisturbed():
                import_module(f"mmocap_warp.commands.{module}")
            if "loaded" in needed:
                from mmocap_warp.commands.inputs import scene_from

                chosen = values.pop("frames"), values.pop("identity", None)
                values["scene"] = values["loaded"] = scene_from(values["scene"], *chosen, calibrated=calibrated)

            def call(**changes: Any) -> Any:
                # The function gets what it has a parameter for, each setting by its own name, and the console.
                passed = {key: value for key, value in values.items() if key in own and key != "settings"}
                passed |= given(values.get("settings")) | ({"reporter": console} if "reporter" in own else {})
                return getattr(import_module(f"mmocap_warp.commands.{module}"), function_name)(**passed | changes)

            answer: Answer = print_answer(**{key: call if key == "call" else values[key] for key in needed})
            console.result(answer.values, "\n".join(map(str, answer.lines)))
            return answer.code

        run.__name__ = print_answer.__name__
        run.__doc__ = re.sub(  # an argument's text begins a row of the help
            r"^(    \w+: )([a-z])", lambda row: row[1] + row[2].upper(), help_text, flags=re.MULTILINE
        )
        run.__signature__ = signature  # type: ignore[attr-defined]
        return run

    return decorate


@contextmanager
def _undisturbed() -> Iterator[None]:
    """Let signals wait: OpenUSD swallows what they raise while it is imported, and goes on without a part of itself."""
    if sys.platform == "win32":
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _signature(own: dict[str, Parameter], types: dict[str, Any], order: list[str]) -> inspect.Signature:
    """What the parser sees: the function's ``own`` parameters and those for the printing function, as it takes them."""
    overrides = {name: type_ if isinstance(type_, Given) else Given(type_) for name, type_ in types.items()}
    parameters = [_parser_parameter(each, overrides.get(each.name)) for each in own.values()]
    parameters += [_parser_parameter(_flag(name), overrides[name]) for name in overrides if name not in own]
    # The order of the help: what has no flag, the flags in their order, and those that most commands have.
    places = {name: place for place, name in enumerate(order, -len(order))}
    places |= {name: place for place, name in enumerate(_LAST, 1)}
    shown = [each for each in parameters if each.annotation is not None]
    shown.sort(key=lambda each: (each.kind, places.get(each.name, 0)))
    return inspect.Signature([*shown, _flag("console").replace(annotation=Console | None)])


def _declaration(module: str, name: str) -> tuple[dict[str, Parameter], str]:
    """A function's parameters, with their annotations as text, and its docstring, from its source."""
    (function,) = [each for each in _statements(module) if isinstance(each, ast.FunctionDef) and each.name == name]
    had = function.args
    by_place = [*had.posonlyargs, *had.args]
    defaults = [None] * (len(by_place) - len(had.defaults)) + had.defaults
    listed: list[tuple[ast.arg | None, Any, ast.expr | None]] = [
        *((each, Parameter.POSITIONAL_OR_KEYWORD, default) for each, default in zip(by_place, defaults, strict=True)),
        (had.vararg, Parameter.VAR_POSITIONAL, None),
        *((each, BY_FLAG, default) for each, default in zip(had.kwonlyargs, had.kw_defaults, strict=True)),
        (had.kwarg, Parameter.VAR_KEYWORD, None),
    ]
    parameters = {}
    for each, kind, default in listed:
        if each is not None:
            known = {} if default is None else {"default": ast.literal_eval(default)}
            annotation = ast.unparse(each.annotation) if each.annotation else ""
            parameters[each.arg] = Parameter(each.arg, kind, annotation=annotation, **known)
    return parameters, inspect.cleandoc(ast.get_docstring(function) or "")


@cache
def _statements(module: str) -> list[ast.stmt]:
    spec = find_spec(f"mmocap_warp.commands.{module}")
    return ast.parse(Path(str(spec and spec.origin)).read_text(encoding="utf-8")).body


def _flag(name: str) -> Parameter:
    return Parameter(name, Parameter.KEYWORD_ONLY, default=None)


def _parser_parameter(parameter: Parameter, overrides: Given | None) -> Parameter:
    """A parameter as the parser takes it; its annotation is None where the command line does not have it."""
    type_, default, kind = overrides or Given(_type(parameter))
    default = parameter.default if default is ... else default
    kind = parameter.kind if kind is ... else kind
    # What has no default is known by its place, but for the output.
    if kind is Parameter.POSITIONAL_OR_KEYWORD:
        by_place = default is REQUIRED and parameter.name != "output"
        kind = Parameter.POSITIONAL_ONLY if by_place else Parameter.KEYWORD_ONLY
    if kind is Parameter.VAR_KEYWORD:
        kind, default = Parameter.KEYWORD_ONLY, None
    if kind is Parameter.VAR_POSITIONAL:
        default = REQUIRED
    if parameter.name == "output":
        type_, default = Annotated[type_, Output], Path(default) if isinstance(default, str) else default
    return Parameter(parameter.name, kind, default=default, annotation=type_)


def _type(parameter: Parameter) -> Any:
    """What the command line makes of an annotation: of paths and objects the path, of other types the first."""
    parts = str(parameter.annotation).split(" | ")
    known = [part for part in parts if part.split("[")[0] in _KNOWN]
    if parameter.name == "identity":
        return Identity
    if parameter.default is REQUIRED and parameter.name in _FILES:
        return _FILES[parameter.name]
    if parts == ["bool"]:
        return Switch
    if not known:
        return None
    name = "Path" if "Path" in known and parameter.name != "body" else known[0]  # a body may be a shipped one's name
    type_ = _resolved(ast.parse(name, mode="eval").body)
    return type_ | None if "None" in parts or name == "Frames" else type_


def _resolved(node: ast.expr) -> Any:
    """The type that an annotation names: one of ``_TYPES``, or a tuple or choice of such."""
    if isinstance(node, ast.Subscript):
        items = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        if isinstance(node.value, ast.Name) and node.value.id == "Literal":
            return Literal[tuple(ast.literal_eval(each) for each in items)]
        return tuple[tuple(map(_resolved, items))]  # type: ignore[misc]
    if isinstance(node, ast.Constant):
        return node.value  # the dots of a tuple of any length
    return _TYPES[ast.unparse(node)]
