"""The mutants: every place where cosmic-ray's operators apply, and a seeded sample of them."""

from __future__ import annotations

import ast
import difflib
import random
import re
from collections import defaultdict
from pathlib import Path

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator, operator_names
from mutant import Mutant

LEFT_OUT = (
    "BitOr", "BitAnd", "BitXor", "LShift", "RShift", "Invert",  # of floats they do not run; of types they say nothing
    "RemoveDecorator",  # without its decorator a kernel or a property is no longer called at all
    "Variable",  # operators that are written for a variable each
)  # fmt: skip
"""Operators with one of these in their names are not used."""


def draw(root: Path, files: list[str], count: int, seed: int) -> tuple[list[Mutant], int]:
    """So many mutants, each at a place of its own, in the order of files; and of how many places they are a sample.

    A place is drawn first, every place as likely, and then one of its mutants. So a sum, of which there are many
    mutants, counts no more than a condition, of which there is one.
    """
    places = [(file, changes) for file in files for changes in _places(root, file)]
    generator, drawn = random.Random(seed), {}
    for k in generator.sample(range(len(places)), len(places)):
        file, changes = places[k]
        generator.shuffle(changes)
        mutants = (_mutant(root, file, *change) for change in changes)
        mutant = next((mutant for mutant in mutants if mutant is not None), None)
        if mutant is not None:
            drawn[k] = mutant
        if len(drawn) == count:
            break
    return [drawn[k] for k in sorted(drawn)], len(places)


def _places(root: Path, file: str) -> list[list[tuple[str, int]]]:
    """The places of a file, and by operator and occurrence what may be changed at each."""
    source = (root / file).read_text(encoding="utf-8")
    lines, nodes, places = source.splitlines(), list(ast_nodes(get_ast(source))), defaultdict(list)
    for name in filter(_is_used, sorted(operator_names())):
        operator = get_operator(name)()
        found = [place for node in nodes for place in operator.mutation_positions(node)]
        for occurrence, (begin, end) in enumerate(found):
            line = lines[begin[0] - 1]
            is_star = line[begin[1] : begin[1] + 2] == "*,"  # it only parts the parameters
            is_decorator = line.lstrip().startswith("@")  # mypy sees to it that what is frozen is not changed
            is_guard = line[: begin[1]].endswith("strict=")  # of lengths that differ by a mistake in the code alone
            if not (is_star or is_decorator or is_guard):
                places[begin, end].append((name, occurrence))
    return [places[place] for place in sorted(places)]


def _mutant(root: Path, file: str, operator: str, occurrence: int) -> Mutant | None:
    """A change; None where it is no Python or means the same."""
    source = (root / file).read_text(encoding="utf-8")
    changed = mutate_code(source, get_operator(operator)(), occurrence)
    if file.startswith("kernels/"):  # a loop over nothing in a form that Warp compiles
        changed = re.sub(r" in +\[\]:", " in range(0):", changed)
    try:
        same = ast.dump(ast.parse(changed)) == ast.dump(ast.parse(source))
    except SyntaxError:
        return None
    if same:
        return None
    old, new = source.splitlines(keepends=True), changed.splitlines(keepends=True)
    codes = [
        code for code in difflib.SequenceMatcher(None, old, new, autojunk=False).get_opcodes() if code[0] != "equal"
    ]
    begin, end, new_begin, new_end = codes[0][1], codes[-1][2], codes[0][3], codes[-1][4]
    return Mutant(file, begin + 1, operator.removeprefix("core/"), old[begin:end], new[new_begin:new_end])


def _is_used(operator: str) -> bool:
    if any(part in operator for part in LEFT_OUT):
        return False
    # `is` is for None: of numbers it asks which object they are, and None has no order.
    identity = [part in ("Is", "IsNot") for part in operator.split("_")[1:]]
    return all(identity) or not any(identity)
