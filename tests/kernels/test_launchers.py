"""Launchers can be read: few arguments, all annotated, and their kernels get arguments that were built before."""

import ast
import re
from pathlib import Path

import pytest

from mmocap_warp.kernels import __path__ as folders

MOST = 8  # arguments
FILES = {path: path.read_text(encoding="utf-8") for path in sorted(Path(folders[0]).rglob("*.py"))}
MODULES = [path for path, text in FILES.items() if re.search(r"^ +(wp\.)?launch\(", text, re.MULTILINE)]


def launches(function):
    return any(
        isinstance(node, ast.Call) and ast.unparse(node.func) in ("wp.launch", "launch") for node in ast.walk(function)
    )


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.stem)
def test_launchers_take_few_annotated_arguments(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    launchers = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef) and launches(node)]
    assert launchers
    for launcher in launchers:
        arguments = [*launcher.args.posonlyargs, *launcher.args.args, *launcher.args.kwonlyargs]
        arguments = [argument for argument in arguments if argument.arg != "self"]
        assert len(arguments) <= MOST, launcher.name
        assert all(argument.annotation for argument in arguments), launcher.name
        assert launcher.returns is not None, launcher.name
