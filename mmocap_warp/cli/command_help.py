"""The help of a command is the docstring of the function that does its work, read without importing that."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Callable
from importlib.util import find_spec
from typing import TypeVar

Command = TypeVar("Command", bound=Callable)


def documented_by(target: str, **arguments: str) -> Callable[[Command], Command]:
    """Let a command have the docstring of another function, whose arguments are the command's parameters.

    Args:
        target: ``module:function`` in the room of commands.
        arguments: of parameters that are called otherwise, the name of the function's argument.
    """
    module, name = target.split(":")
    spec = find_spec(f"mmocap_warp.commands.{module}")
    with open(str(spec and spec.origin), encoding="utf-8") as file:
        tree = ast.parse(file.read())
    (function,) = [node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == name]
    text = inspect.cleandoc(ast.get_docstring(function) or "")
    for parameter, argument in arguments.items():
        text = re.sub(rf"^    {argument}: ", f"    {parameter}: ", text, flags=re.MULTILINE)
    # An argument's text begins a row of the help.
    text = re.sub(r"^(    \w+: )([a-z])", lambda line: line[1] + line[2].upper(), text, flags=re.MULTILINE)

    def document(command: Command) -> Command:
        command.__doc__ = text
        return command

    return document
