"""Kills commands at random moments, and sees that they end with the same bits. See docs/testing.md.

Run from the repository's root, in an environment with the extra ``test``::

    python tests/kill --kills 100 --seed 1
    python tests/kill --kills 10 --only mask,export

A command is killed (SIGKILL) a few times in a row and then left to end: with ``--resume`` where it has that, from the
beginning with ``--force`` where not. Of a batch it is any of its processes, its workers among them. After every kill of
the command itself, whatever lies under a name that it would give is compared with that of a run that nothing stopped,
and so is all of it in the end.
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import sys
import tempfile
from collections import Counter
from contextlib import suppress
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(1, str(Path(__file__).resolve().parents[2] / "instruments"))

from commands import COMMANDS, processes_of, run_to_end, started
from recordings import write_many, write_recording, write_study
from sameness import difference

from mmocap_warp.device.resolve import start_quietly

IN_A_ROW = 4  # kills before a run is left to end


def main() -> int:
    """Kill, compare, report; 1 where anything differed."""
    asked = _arguments()
    random = np.random.default_rng(asked.seed)
    wanted = asked.only.split(",")
    faults, kills, ends = [], Counter(), Counter()
    start_quietly()
    with tempfile.TemporaryDirectory(prefix="mmocap-kill-") as scratch:
        made = Path(scratch) / "made"
        write_recording(made)
        write_study(made)
        if "batch" in wanted:
            write_many(made)
        if "export" in wanted:
            run_to_end(COMMANDS["track"].arguments(made, made))
            (made / "r.usdc").rename(made / "result.usdc")
        for number, name in enumerate(wanted):
            share = asked.kills // len(wanted) + (number < asked.kills % len(wanted))
            for fault in _killed(name, share, made, Path(scratch), random, kills, ends):
                faults.append(f"{name}: {fault}")
                print(faults[-1], flush=True)
            print(f"{name:<8} {kills[name]:4d} kills, {ends[name]:3d} ended and compared", flush=True)
    print(f"{sum(kills.values())} kills, {sum(ends.values())} results compared, {len(faults)} differ")
    return 1 if faults else 0


def _killed(
    name: str, wanted: int, made: Path, scratch: Path, random: np.random.Generator, kills: Counter, ends: Counter
) -> list[str]:
    """What went wrong when a command was killed so many times."""
    command = COMMANDS[name]
    whole, faults = scratch / f"{name}-whole", []
    whole.mkdir()
    longest = run_to_end(command.arguments(made, whole))
    while kills[name] < wanted:
        out = scratch / f"{name}-{ends[name]}"
        out.mkdir()
        arguments = command.arguments(made, out)
        run = started(arguments)
        for _ in range(min(IN_A_ROW, wanted - kills[name])):
            run.join(random.uniform(0.0, 1.1 * longest))
            if run.exitcode is not None:
                break
            victim = int(random.choice(processes_of(run))) if command.any_process else run.pid
            with suppress(ProcessLookupError):
                os.kill(victim, signal.SIGKILL)
            kills[name] += 1
            if victim == run.pid:
                run.join()
                faults += [f"after kill {kills[name]}: {fault}" for fault in difference(whole, out, complete=False)]
                run = started([*arguments, *command.again])
        run.join()
        if run.exitcode:
            run_to_end([*arguments, *command.again])
        ends[name] += 1
        faults += [f"in the end: {fault}" for fault in difference(whole, out, complete=True)]
        shutil.rmtree(out)
    return faults


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python tests/kill", description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=100, help="in all (default: 100)")
    parser.add_argument("--seed", type=int, default=1, help="of the moments (default: 1)")
    parser.add_argument("--only", default=",".join(COMMANDS), help="commands, with commas (default: all)")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
