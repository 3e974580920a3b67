"""The one exception for input that a user can mend."""

from __future__ import annotations


class InputError(ValueError):
    """Wrong input: says what, where, and what to do. The command line prints it in one line and exits with 3.

    Args:
        source: the file (and, where it helps, the line or frame) that is wrong.
        problem: what is wrong, naming the field and the value found.
        remedy: what the user can do about it.
    """

    def __init__(self, source: object, problem: str, remedy: str) -> None:
        self.source = str(source)
        self.problem = problem
        self.remedy = remedy
        super().__init__(f"{self.source}: {problem}; {remedy}")
