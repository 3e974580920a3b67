"""The rooms import what the page on architecture lets them; device code stays in its room."""

from __future__ import annotations

import ast
import re
import tomllib
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import mmocap_warp as mm

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = {"mmocap_warp": "mmocap_warp", "kernels": "mmocap_warp.kernels", "scenes": "mmocap_warp.scenes"}
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
LAYERS = [
    [room.strip() for room in layer.split("|")]
    for layer in PROJECT["tool"]["importlinter"]["contracts"][0]["layers"][::-1]
]
"""The rooms as import-linter orders them, those first that know no other."""
DEVICE_CODE = {"func", "func_native", "kernel", "launch", "launch_tiled", "struct"}
"""Of Warp: what only kernels/ uses."""


@cache
def modules() -> dict[str, ast.Module]:
    """Every module's syntax tree, by the name it is installed as."""
    trees = {}
    for folder, package in FOLDERS.items():
        for file in (ROOT / folder).rglob("*.py"):
            below = file.relative_to(ROOT / folder).with_suffix("").parts
            name = ".".join([package, *below]).removesuffix(".__init__")
            trees[name] = ast.parse(file.read_text(encoding="utf-8"))
    return trees


def room_of(module: str) -> str:
    """The name below ``mmocap_warp``; empty for the package itself."""
    return module.removeprefix("mmocap_warp").removeprefix(".").split(".")[0]


def imported_rooms(tree: ast.Module) -> set[str]:
    """Rooms that a module imports anywhere, inside functions and for type checkers too."""
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module == "mmocap_warp":
            names |= {f"mmocap_warp.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module)
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
    return {room_of(name) for name in names if name.split(".")[0] == "mmocap_warp"}


def packages() -> list[str]:
    """Rooms that are folders."""
    return sorted({room_of(name) for name in modules() if name.count(".") > 1} | {"scenes"})


def without_subject() -> set[str]:
    """What every room may import: the modules beside the rooms, and the data."""
    return {room_of(name) for name in modules()} - set(packages()) | {"scenes"}


@cache
def table() -> dict[str, str]:
    """What each room may import, by the rows of the table on the page, in their order."""
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    return dict(re.findall(r"^\| `(\w+)/` \|.*\| ([^|]+) \|$", page, re.M))


def allowed(room: str) -> set[str]:
    """The rooms that the table names."""
    known = {"no other room": set(), "every other room": set(packages()) - {room}}
    said = table()[room]
    return known[said] if said in known else set(said.split(", "))


def layer_of(room: str) -> int:
    """How many layers a room stands on."""
    return next(number for number, rooms in enumerate(LAYERS) if room in rooms)


@pytest.mark.parametrize("room", packages())
def test_a_room_imports_no_more_than_the_page_on_architecture_says(room):
    assert allowed(room) <= {below for rooms in LAYERS[: layer_of(room)] for below in rooms}
    trees = [tree for name, tree in modules().items() if room_of(name) == room]
    imported = set().union(*map(imported_rooms, trees))
    assert imported - without_subject() - {room} <= allowed(room)


def test_the_page_on_architecture_has_the_rooms_in_their_order():
    assert sorted(table()) == packages()
    assert sorted(table(), key=layer_of) == list(table())


def test_a_file_s_name_occurs_once():
    files = [file.name for file in (ROOT / "mmocap_warp").rglob("*.py") if not file.name.startswith("__")]
    assert [name for name, count in Counter(files).items() if count > 1] == []


def test_no_room_has_the_name_of_a_public_function():
    """A room that is imported becomes an attribute of the package, and would hide the function."""
    assert not set(packages()) & set(mm.__all__)


def test_device_code_is_in_kernels_alone():
    for name, tree in modules().items():
        if room_of(name) == "kernels":
            continue
        for node in ast.walk(tree):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in ("wp", "warp"):
                assert node.attr not in DEVICE_CODE, f"{name}, line {node.lineno}: wp.{node.attr}"
            if isinstance(node, ast.ImportFrom) and node.module == "warp":
                assert not DEVICE_CODE & {alias.name for alias in node.names}, f"{name}, line {node.lineno}"


def decorated_with(function: ast.FunctionDef, name: str) -> bool:
    return any(
        isinstance(node, ast.Attribute) and node.attr == name
        for decorator in function.decorator_list
        for node in ast.walk(decorator)
    )


def kernels() -> Iterator[tuple[str, ast.Module, str]]:
    """Module, its tree, and a kernel's name."""
    for module, tree in modules().items():
        for function in tree.body:
            if isinstance(function, ast.FunctionDef) and decorated_with(function, "kernel"):
                yield module, tree, function.name


def launchers_of(kernel: str, tree: ast.Module) -> list[ast.FunctionDef | ast.ClassDef]:
    """Functions and classes of a module that name a kernel, or one that does so for them."""
    users = [
        part
        for part in tree.body
        if isinstance(part, ast.FunctionDef | ast.ClassDef)
        and part.name != kernel
        and any(isinstance(node, ast.Name) and node.id == kernel for node in ast.walk(part))
    ]
    private = [user.name for user in users if user.name.startswith("_")]
    return users + [outer for name in private for outer in launchers_of(name, tree)]


def test_a_kernel_is_private_and_its_launcher_public_and_documented():
    found = list(kernels())
    assert len(found) > 20
    for module, tree, kernel in found:
        assert kernel.startswith("_"), f"{module}.{kernel} is public"
        public = [launcher for launcher in launchers_of(kernel, tree) if not launcher.name.startswith("_")]
        assert public, f"{module}.{kernel} has no launcher"
        assert all(ast.get_docstring(launcher) for launcher in public), f"a launcher of {module}.{kernel} says nothing"
