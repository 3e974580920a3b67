"""Reads damaged files, one after the other, in a process of its own; what becomes of each is a line on stdout.

A process, because native code may end it: by a crash, or because the kernel does where a file takes too much time. Run
by ``trial``, with readers' names, the seed, the first case of the first reader, how many cases a reader has, a folder,
and the limits.
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from pathlib import Path
from random import Random

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(1, str(Path(__file__).resolve().parents[2] / "instruments"))

from reader import Reader
from readers import READERS

from mmocap_warp.errors import InputError

_PATIENCE = 6.0  # seconds for each of the processor's: the machine may be busy
_LONGEST_LINE = 1250  # characters that a person may be asked to read


def main() -> None:
    """Read each reader's sound file, then its damaged ones."""
    names, seed, first, count, folder, seconds, memory = sys.argv[1:]
    out = os.fdopen(os.dup(1), "w")
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):  # libraries complain about broken files as they like
        os.dup2(nowhere, stream)
    begin = int(first)
    for name in names.split(","):
        place = Path(folder) / name
        place.mkdir()
        reader = READERS[name]
        _limit_memory(None)
        reader.write(place)
        sound = (place / reader.file).read_bytes()
        reader.read(place)
        _limit_memory(int(memory))
        for case in range(begin, int(count)):
            (place / reader.file).write_bytes(damaged(reader, sound, int(seed), case))
            print(json.dumps({"reader": name, "case": case}), file=out, flush=True)
            signal.setitimer(signal.ITIMER_PROF, float(seconds))  # of processor time; the kernel ends the process
            signal.setitimer(signal.ITIMER_REAL, _PATIENCE * float(seconds))  # and one that waits for nothing
            began = time.process_time()
            said = outcome(reader, place)
            took = time.process_time() - began
            signal.setitimer(signal.ITIMER_PROF, 0)
            signal.setitimer(signal.ITIMER_REAL, 0)
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
            line = {"reader": name, "case": case, **said, "seconds": took, "peak": peak}
            print(json.dumps(line), file=out, flush=True)
        begin = 0


def replay(escapes: str) -> None:
    """Read files that escaped once, ``READER/CASE`` in a folder, and print the name of each that does not.

    Raises:
        AssertionError: a file that escapes still.
    """
    with tempfile.TemporaryDirectory() as folder:
        for path in sorted(Path(escapes).glob("*/*")):
            reader, place = READERS[path.parent.name], Path(folder) / path.parent.name
            if not place.exists():
                place.mkdir()
                reader.write(place)
            shutil.copy(path, place / reader.file)
            said = outcome(reader, place)
            assert said["became"] != "escaped", f"{path}: {said['said']}"
            print(f"{path.parent.name}/{path.name}")


def damaged(reader: Reader, sound: bytes, seed: int, case: int) -> bytes:
    """The file of a case: the same on any machine that writes the same sound one."""
    return reader.damage(Random(f"{seed} {reader.name} {case}"), sound)


def outcome(reader: Reader, folder: Path) -> dict[str, str]:
    """What reading gives: ``read``, ``refused``, or ``escaped`` with what escaped and where from."""
    try:
        reader.read(folder)
    except InputError as error:
        lines = " ".join(str(error).split())
        if len(lines) > _LONGEST_LINE:
            return {"became": "escaped", "said": f"a line of {len(lines)} characters: {lines[:200]}"}
        return {"became": "refused"}
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)
        ours = [frame for frame in place if "mmocap_warp" in frame.filename] or list(place)
        where = f"{Path(ours[-1].filename).name}:{ours[-1].name}"
        return {"became": "escaped", "said": f"{type(error).__name__} in {where}: {' '.join(str(error).split())[:200]}"}
    return {"became": "read"}


def _limit_memory(more: int | None) -> None:
    """Let the process have so many bytes more than it has now; None for as many as it wants."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    most = hard if more is None else pages * resource.getpagesize() + more
    resource.setrlimit(resource.RLIMIT_AS, (most, hard))


if __name__ == "__main__":
    main()
