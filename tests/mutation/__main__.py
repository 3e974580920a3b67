"""Mutation testing: changes a line at a time and sees whether a test fails. See docs/testing.md.

Run from the repository's root, in an environment with the extra ``test`` and cosmic-ray::

    python tests/mutation --sample 300 --seed 1 --jobs 16 --out mutants.json

What is in the file already is not done again, so that a run that was stopped continues. Of those that ``--again``
runs once more, the file keeps as ``before`` that they survived.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import threading
import time
import tomllib
from collections import Counter
from dataclasses import asdict
from fnmatch import fnmatch
from pathlib import Path
from queue import Empty, SimpleQueue

from mutant import Mutant
from trial import KILLED, SURVIVED, TIMEOUT, UNBUILT, Copy

ROOT = Path(__file__).resolve().parents[2]
TARGETS = tomllib.loads(Path(__file__).with_name("targets.toml").read_text(encoding="utf-8"))
EQUIVALENT = tomllib.loads(Path(__file__).with_name("equivalent.toml").read_text(encoding="utf-8"))["equivalent"]


def main() -> int:
    """Draw or continue, run, report."""
    asked = _arguments()
    if asked.out.exists():
        kept = json.loads(asked.out.read_text(encoding="utf-8"))
    else:
        from sample import draw  # needs cosmic-ray; a sample that is drawn already does not

        mutants, places = draw(ROOT, list(TARGETS), asked.sample, asked.seed)
        kept = {"seed": asked.seed, "places": places, "mutants": [asdict(mutant) for mutant in mutants]}
        _write(asked.out, kept)
    work = [
        row
        for row in kept["mutants"]
        if fnmatch(row["file"], asked.only) and ("status" not in row or (asked.again and _verdict(row) == SURVIVED))
    ]
    _run(work, kept, asked)
    _report([row for row in kept["mutants"] if "status" in row])
    return 0


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python tests/mutation", description=__doc__.splitlines()[0])
    parser.add_argument("--sample", type=int, default=300, help="mutants (default: 300)")
    parser.add_argument("--seed", type=int, default=1, help="of the sample (default: 1)")
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)), help="at a time (default: cores)")
    parser.add_argument("--only", default="*", help="run the mutants of files that match (default: *)")
    parser.add_argument("--again", action="store_true", help="run those that survived once more")
    parser.add_argument("--cache", type=Path, help="Warp's kernel cache to use (default: an empty one)")
    parser.add_argument("--out", type=Path, required=True, help="the sample and its results, JSON")
    return parser.parse_args()


def _run(work: list[dict], kept: dict, asked: argparse.Namespace) -> None:
    """Run mutants, each job on a core and in a copy of its own; the clean tests of their files first."""
    with tempfile.TemporaryDirectory(prefix="mutation-") as scratch:
        cache = asked.cache or Path(scratch) / "kernels"
        copies = [Copy(ROOT, Path(scratch) / str(k), cache) for k in range(min(asked.jobs, len(work)))]
        lock, clean_seconds = threading.Lock(), {}

        def clean(copy: Copy, tests: tuple[str, ...]) -> None:
            status, seconds, said = copy.run(list(tests), 600.0)
            if status != SURVIVED:
                raise RuntimeError(f"{', '.join(tests)} do not pass without a mutant: {said}")
            clean_seconds[tests] = seconds

        def mutated(copy: Copy, row: dict) -> None:
            mutant = Mutant(**{name: row[name] for name in Mutant.__dataclass_fields__})
            limit = 15.0 + 3.0 * clean_seconds[tests_of(mutant.file)]
            status, seconds, said = copy.outcome(mutant, TARGETS[mutant.file], limit)
            with lock:
                if "status" in row:
                    row["before"] = row["status"]
                row |= {"status": status, "seconds": round(seconds, 1), "said": said}
                _write(asked.out, kept)
                print(f"{status:15}{seconds:6.1f} s  {mutant.file}:{mutant.line}  {_change(row)}", flush=True)

        # Files that have the same tests share their clean run. Then come the mutants, the longest first.
        _in_parallel(copies, clean, sorted({tests_of(row["file"]) for row in work}))
        _in_parallel(copies, mutated, sorted(work, key=lambda row: -clean_seconds[tests_of(row["file"])]))


def tests_of(file: str) -> tuple[str, ...]:
    """The tests that judge a file's mutants."""
    return tuple(TARGETS[file])


def _in_parallel(copies: list[Copy], do, things: list) -> None:
    """Do things, a thread a copy; the first error of any ends all."""
    left, errors = SimpleQueue(), []
    for thing in things:
        left.put(thing)

    def worker(number: int, copy: Copy) -> None:
        cores = sorted(os.sched_getaffinity(0))
        mine = cores[number * len(cores) // len(copies) % len(cores)]
        os.sched_setaffinity(0, {mine})  # of this thread and the processes that it starts
        while not errors:
            try:
                do(copy, left.get_nowait())
            except Empty:
                return
            except Exception as error:
                errors.append(error)

    threads = [threading.Thread(target=worker, args=pair, daemon=True) for pair in enumerate(copies)]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):  # Ctrl-C comes through
        time.sleep(0.2)
    if errors:
        raise errors[0]


def _write(path: Path, kept: dict) -> None:
    """Whole or not at all."""
    temporary = path.with_name(path.name + ".part")
    temporary.write_text(json.dumps(kept, indent=1), encoding="utf-8")
    temporary.replace(path)


def _change(row: dict) -> str:
    return f"{''.join(row['old']).strip()}  ->  {''.join(row['new']).strip()}"


def _verdict(row: dict) -> str:
    mutant = Mutant(**{name: row[name] for name in Mutant.__dataclass_fields__})
    same = any(mutant.matches(known["file"], known["old"], known["new"]) for known in EQUIVALENT)
    return "equivalent" if same and row["status"] == SURVIVED else row["status"]


def _report(rows: list[dict]) -> None:
    """A line a file, the share killed of those that build and are not equivalent, and the survivors."""
    columns = (KILLED, TIMEOUT, SURVIVED, "equivalent", UNBUILT)
    counts = {file: Counter(_verdict(row) for row in rows if row["file"] == file) for file in TARGETS}
    counts["all"] = sum(counts.values(), Counter())
    print("\n" + "".join(f"{name:>16}" for name in columns))
    for file, count in counts.items():
        if count:
            print("".join(f"{count[name]:16}" for name in columns) + f"  {file}")
    killed = counts["all"][KILLED] + counts["all"][TIMEOUT]
    judged = killed + counts["all"][SURVIVED]
    earlier = killed - sum(_verdict(row) in (KILLED, TIMEOUT) and "before" in row for row in rows)
    print(f"\n{killed} of {judged} killed: {killed / max(judged, 1):.1%}; before: {earlier}\n")
    for row in rows:
        if _verdict(row) == SURVIVED:
            print(f"{row['file']}:{row['line']}  {_change(row)}")


if __name__ == "__main__":
    sys.exit(main())
