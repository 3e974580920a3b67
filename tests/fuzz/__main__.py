"""Fuzz every reader: does a damaged file ever end in anything but an answer or one clear line? See docs/testing.md.

python tests/fuzz --cases 10000 --seed 1
python tests/fuzz --reader scene.toml --reader body.usda --cases 2000 --keep escapes
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(1, str(Path(__file__).resolve().parents[2] / "instruments"))

from readers import READERS
from trial import Rules, Trial, run

GIB = 2**30


def main() -> int:
    """Run the readers one after the other; 1 where a file escaped."""
    asked = _arguments()
    rules = Rules(asked.seed, asked.cases, asked.seconds, int(asked.memory * GIB), asked.keep)
    print(f"{'reader':24}{'read':>8}{'refused':>9}{'escaped':>9}{'all':>10}{'slowest':>10}{'memory':>10}")
    trials = run(asked.reader or list(READERS), rules, lambda trial: print(_row(trial), flush=True))
    escaped = sum(trial.became["escaped"] for trial in trials)
    print(f"{sum(trial.became.total() for trial in trials)} files of {len(trials)} readers, {escaped} escaped")
    return 1 if escaped else 0


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python tests/fuzz", description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=300, help="damaged files a reader (default: 300)")
    parser.add_argument("--seed", type=int, default=1, help="of the damage (default: 1)")
    parser.add_argument("--reader", action="append", choices=list(READERS), help="only this one; may be repeated")
    parser.add_argument("--seconds", type=float, default=10.0, help="of processor time for a file (default: 10)")
    parser.add_argument("--memory", type=float, default=1.0, help="GiB for all beside the libraries (default: 1)")
    parser.add_argument("--keep", type=Path, help="folder for files that ended the process")
    return parser.parse_args()


def _row(trial: Trial) -> str:
    read, refused, escaped = (trial.became[name] for name in ("read", "refused", "escaped"))
    row = f"{trial.reader:24}{read:8}{refused:9}{escaped:9}"
    row += f"{trial.seconds:8.0f} s{trial.slowest:8.2f} s{trial.peak / GIB:6.2f} GiB"
    escapes = (
        f"\n  {kind}: {example} (case {case} and {count - 1} more)"
        for kind, (case, example, count) in trial.escapes.items()
    )
    return row + "".join(escapes)


if __name__ == "__main__":
    sys.exit(main())
