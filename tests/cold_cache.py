"""Processes that start at once on one empty kernel cache all succeed, with the same bits. See docs/testing.md.

Run from the repository's root::

    python tests/cold_cache.py --processes 2
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from recordings import write_recording

from mmocap_warp.formats.usd.usd_result import read_result


def main() -> int:
    """Start them, wait, compare; 1 where one failed or differs."""
    parser = argparse.ArgumentParser(prog="python tests/cold_cache.py", description=__doc__.splitlines()[0])
    parser.add_argument("--processes", type=int, default=2)
    processes = parser.parse_args().processes
    with tempfile.TemporaryDirectory() as scratch:
        folder, cache = Path(scratch), Path(scratch) / "cache"
        write_recording(folder / "made")
        environment = os.environ | {"WARP_CACHE_PATH": str(cache)}
        results = [folder / f"{number}.usdc" for number in range(processes)]
        for attempt in ("cold", "warm"):
            begun = time.monotonic()
            command = [sys.executable, "-m", "mmocap_warp", "track", str(folder / "made"), "--quiet", "--force", "-o"]
            runs = [
                subprocess.Popen([*command, str(result)], stdout=subprocess.DEVNULL, env=environment)
                for result in results
            ]
            codes = [run.wait() for run in runs]
            poses = [read_result(result).pose for result in results if result.exists()]
            same = len(poses) == processes and all(np.array_equal(poses[0], pose) for pose in poses)
            modules = sum(path.is_dir() for path in cache.glob("*/*"))
            print(f"{attempt}: exit codes {codes}, same bits: {same}, {modules} modules in the cache, ", end="")
            print(f"{time.monotonic() - begun:.1f} s")
            if any(codes) or not same:
                return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
