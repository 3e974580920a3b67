"""Runs a reader's cases, in a process that is replaced whenever a file ends it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

_FOLDER = Path(__file__).parent


@dataclass
class Trial:
    """What became of a reader's damaged files.

    Attributes:
        reader: its name.
        became: how many were read, were refused in one line, or escaped.
        escapes: by what escaped, the first case of each, and how many there are.
        slowest: seconds of processor that a file took, at most.
        peak: bytes that the process held, at most.
    """

    reader: str
    became: Counter[str] = field(default_factory=Counter)
    escapes: dict[str, tuple[int, int]] = field(default_factory=dict)
    slowest: float = 0.0
    peak: int = 0

    def add(self, case: int, became: str, said: str = "", seconds: float = 0.0, peak: int = 0) -> bool:
        """Count a case; whether what it says is new."""
        self.became[became] += 1
        self.slowest, self.peak = max(self.slowest, seconds), max(self.peak, peak)
        if became != "escaped":
            return False
        kind = said.split(": ")[0]
        first, count = self.escapes.get(kind, (case, 0))
        self.escapes[kind] = first, count + 1
        return count == 0


def run(reader: str, file: str, seed: int, cases: int, limits: tuple[float, int], keep: Path | None = None) -> Trial:
    """Read damaged files.

    Args:
        reader: its name.
        file: what it reads, from its folder on.
        seed: of the damage.
        cases: how many files.
        limits: seconds of processor for a file, and bytes of memory.
        keep: where the first file of each escape is copied to.
    """
    trial, case = Trial(reader), 0
    while case < cases:
        with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
            case = _run_worker(trial, Path(folder), file, (seed, case, cases), limits, keep)
    return trial


def _run_worker(
    trial: Trial, folder: Path, file: str, which: tuple[int, int, int], limits: tuple[float, int], keep: Path | None
) -> int:
    """Run cases in a process until it ends; the next case."""
    seed, first, cases = which
    wanted = [trial.reader, seed, first, cases - first, folder, *limits]
    worker = subprocess.Popen(
        [sys.executable, str(_FOLDER / "worker.py"), *map(str, wanted)],
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
    )
    begun, done = first - 1, first - 1
    for line in worker.stdout or ():
        said = json.loads(line)
        begun = said["case"]
        if "became" in said:
            done = begun
            # The worker goes on meanwhile: a file of interest is made anew from its number.
            if trial.add(**said) and keep is not None:
                print(f"  {trial.reader} {begun}: {said['said']}", flush=True)
    if worker.wait() == 0:
        return cases
    if begun == done:  # not while it read
        raise RuntimeError(f"the worker of {trial.reader} ended with {worker.returncode} at case {begun + 1}")
    ended = signal.Signals(-worker.returncode).name if worker.returncode < 0 else f"exit {worker.returncode}"
    took_too_long = worker.returncode == -signal.SIGPROF
    if (
        trial.add(begun, "escaped", f"over {limits[0]:g} s" if took_too_long else f"the process ended: {ended}")
        and keep
    ):
        keep.mkdir(parents=True, exist_ok=True)
        (keep / f"{trial.reader}-{begun}").write_bytes((folder / file).read_bytes())
        print(f"  {trial.reader} {begun}: {ended}", flush=True)
    return begun + 1
