"""The exceptions for what a user can mend: the input, or the arguments of a command."""

import re
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Self

_MOST = 400  # characters of a source, a problem or a remedy that are shown


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
        super().__init__(f"{_readable(self.source)}: {_readable(problem)}; {_readable(remedy)}")

    def __reduce__(self) -> tuple[type[Self], tuple[str, str, str]]:
        """How it is sent from one process to another."""
        return type(self), (self.source, self.problem, self.remedy)


@contextmanager
def input_errors(source: object, problem: str, remedy: str, *kinds: type[Exception]) -> Iterator[None]:
    """Let errors of some kinds be an :class:`InputError`, whose ``problem`` may have their text as ``{error}``."""
    try:
        yield
    except InputError:
        raise
    except kinds as error:
        raise InputError(source, problem.replace("{error}", str(error)), remedy) from error


class UsageError(ValueError):
    """An argument of a command is wrong, or its arguments contradict each other. The command line exits with 2.

    Args:
        flags: what is wrong, with arguments written as on the command line, such as ``--truth-axes``; the text of the
            exception has them as in Python, ``truth_axes``.
    """

    def __init__(self, flags: str) -> None:
        self.flags = flags
        super().__init__(re.sub(r"--([a-z]+(?:-[a-z]+)*)", lambda flag: flag[1].replace("-", "_"), flags))


def needs_package(path: object, package: str, purpose: str, extra: str, otherwise: str) -> AbstractContextManager[None]:
    """Let a failing import be an InputError: a file cannot be ``purpose`` ("read", "written") without its package.

    This program's ``extra`` installs it; ``otherwise`` says what else the user can do.
    """
    remedy = f'pip install "mmocap-warp[{extra}]", or {otherwise}'
    return input_errors(path, f"needs the package {package} to be {purpose}", remedy, ImportError)


def _readable(text: str) -> str:
    """``text`` as it is, or its beginning and end: it may quote a value of any length."""
    return text if len(text) <= _MOST else f"{text[: _MOST - 50]} ... {text[-40:]}"
