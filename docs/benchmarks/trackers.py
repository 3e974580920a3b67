"""Table of all trackers on two recordings, from the results of a study of them.

    python docs/benchmarks/trackers.py RESULTS > docs/benchmarks/trackers.txt

``RESULTS`` is what ``mmocap study run`` wrote of a study with sequences named ``walk`` and ``balancing``.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from mmocap_warp.study.cell import CellResult
from mmocap_warp.study.paper import ALGORITHM_ORDER
from mmocap_warp.study.store import read_results
from mmocap_warp.tracking.algorithms import ALGORITHMS

ERRORS = {"walk": "marker_error", "balancing": "mpjpe"}
HEAD = """| tracker | walk: median (quartiles) [mm] | worst | IoU | real: median (quartiles) [mm] | worst | IoU | ms |
|---|---|---|---|---|---|---|---|"""


def columns(result: CellResult) -> str:
    """Error over all frames of all runs, and overlap."""
    error = 1000.0 * result.per_frame[ERRORS[result.cell.sequence]]
    low, middle, high = np.nanpercentile(error, [25, 50, 75])
    overlap = np.nanmean(result.per_frame["iou"])
    return f"{middle:.1f} ({low:.1f}-{high:.1f}) | {np.nanmax(error):.0f} | {overlap:.3f}"


def main() -> None:
    """Print the tables, one for each preset, budget and model."""
    read = read_results(Path(sys.argv[1]))
    results = {result.cell: result for result in read if isinstance(result, CellResult)}
    groups = {(cell.preset, cell.evaluations, -cell.dof) for cell in results}
    for preset, evaluations, less in sorted(groups, key=lambda group: (group[0] == "paper", group)):
        print(f"\n### Preset `{preset}`, {evaluations} evaluations, {-less} DOF\n\n{HEAD}")
        for algorithm in ALGORITHM_ORDER:
            row = {
                cell.sequence: result
                for cell, result in results.items()
                if (cell.algorithm, cell.preset, cell.evaluations, cell.dof) == (algorithm, preset, evaluations, -less)
            }
            real = row["balancing"]
            time = 1000.0 * real.per_run["seconds"][0] / len(real.frames) / len(real.seeds)
            print(f"| {ALGORITHMS[algorithm].label} | {columns(row['walk'])} | {columns(real)} | {time:.1f} |")


if __name__ == "__main__":
    main()
