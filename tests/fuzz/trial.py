"""Runs a reader's cases, in a process that is replaced whenever a file ends it."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from readers import READERS

_FOLDER = Path(__file__).parent


@dataclass
class Trial:
    """What became of a reader's damaged files.

    Attributes:
        reader: its name.
        became: how many were read, were refused in one line, or escaped.
        escapes: by what escaped, the first case of each, what it said, and how many there are.
        seconds: of processor that all files took, but for those that ended the process.
        slowest: that one file took, at most.
        peak: bytes that the process held, at most.
    """

    reader: str
    became: Counter[str] = field(default_factory=Counter)
    escapes: dict[str, tuple[int, str, int]] = field(default_factory=dict)
    seconds: float = 0.0
    slowest: float = 0.0
    peak: int = 0

    def add(self, case: int, became: str, said: str = "", seconds: float = 0.0, peak: int = 0) -> None:
        """Count a case."""
        self.became[became] += 1
        self.seconds += seconds
        self.slowest, self.peak = max(self.slowest, seconds), max(self.peak, peak)
        if became == "escaped":
            kind, _, example = said.partition(": ")
            case, example, count = self.escapes.get(kind, (case, example, 0))
            self.escapes[kind] = case, example, count + 1


@dataclass(frozen=True)
class Rules:
    """What every reader's trial has in common.

    Attributes:
        seed: of the damage.
        cases: damaged files a reader.
        seconds: of processor time for a file.
        memory: bytes for all beside the libraries.
        keep: where a file goes that ended the process; None for nowhere.
    """

    seed: int = 1
    cases: int = 300
    seconds: float = 10.0
    memory: int = 2**30
    keep: Path | None = None


def run(readers: Sequence[str], rules: Rules, tell: Callable[[Trial], None] = lambda trial: None) -> list[Trial]:
    """Read damaged files, reader by reader; each trial is told when it is complete."""
    trials = [Trial(reader) for reader in readers]
    left, case = list(trials), 0
    while left:
        with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
            case = _run_worker(left, case, Path(folder), rules, tell) % rules.cases
        left = [trial for trial in left if trial.became.total() < rules.cases]
    return trials


def _run_worker(trials: list[Trial], first: int, folder: Path, rules: Rules, tell: Callable[[Trial], None]) -> int:
    """Run cases in a process until it ends; returns the next case of the first trial that is not complete."""
    named = {trial.reader: trial for trial in trials}
    wanted = [",".join(named), rules.seed, first, rules.cases, folder, rules.seconds, rules.memory]
    worker = subprocess.Popen(
        [sys.executable, str(_FOLDER / "worker.py"), *map(str, wanted)],
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
    )
    begun: tuple[str, int] | None = None
    for line in worker.stdout or ():
        said = json.loads(line)
        begun = said.pop("reader"), said["case"]
        if "became" in said:
            _count(named[begun[0]], rules, tell, **said)
            begun = None
    if worker.wait() == 0:
        return rules.cases
    if begun is None:
        raise RuntimeError(f"the worker ended with {worker.returncode} while it read nothing")
    reader, case = begun
    ended = signal.Signals(-worker.returncode).name if worker.returncode < 0 else f"exit {worker.returncode}"
    too_long = worker.returncode in (-signal.SIGPROF, -signal.SIGALRM)
    said = f"over {rules.seconds:g} s" if too_long else f"the process ended: {ended}"
    _count(named[reader], rules, tell, case=case, became="escaped", said=said)
    if rules.keep is not None:
        rules.keep.mkdir(parents=True, exist_ok=True)
        shutil.copy(folder / reader / READERS[reader].file, rules.keep / f"{reader}-{case}")
    return case + 1


def _count(trial: Trial, rules: Rules, tell: Callable[[Trial], None], **said: Any) -> None:
    trial.add(**said)
    if trial.became.total() == rules.cases:
        tell(trial)
