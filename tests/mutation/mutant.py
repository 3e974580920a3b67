"""A mutant: a file with a small change."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Mutant:
    """A changed line or two of a file.

    Attributes:
        file: from the repository's root.
        line: where the change begins, counted from 1.
        operator: cosmic-ray's name of what was done.
        old: the lines as they are.
        new: the lines in their place.
    """

    file: str
    line: int
    operator: str
    old: list[str]
    new: list[str]

    def applied(self, source: str) -> str:
        """The file with the change.

        Raises:
            ValueError: the file is not the one that the sample was drawn from.
        """
        lines = source.splitlines(keepends=True)
        begin, end = self.line - 1, self.line - 1 + len(self.old)
        if lines[begin:end] != self.old:
            raise ValueError(f"{self.file} has changed since the sample was drawn; draw it anew")
        return "".join([*lines[:begin], *self.new, *lines[end:]])

    def matches(self, file: str, old: str, new: str) -> bool:
        """Whether this is the change of a file in which, white space aside, ``old`` becomes ``new``."""
        mine = ("".join(self.old), "".join(self.new))
        return (file, _bare(old), _bare(new)) == (self.file, *map(_bare, mine))


def _bare(text: str) -> str:
    return "".join(text.split())
