#!/usr/bin/env python3
"""Imports public rigs, films each in its own motion, tracks it from an automatic first frame, and prints a table.

``python instruments/public_rigs.py RIGS OUT``: RIGS is a folder that holds files of ``public_rigs.toml``, which says
where each comes from. The table has, for each file that is there, how well the body's outline overlaps the file's own
skin, the median over its joints of their median errors as a share of its length, and the overlap of the track with the
masks. Joints that an import holds, such as fingers, bend in the truth all the same: what hangs on them is in the median
over all joints, and not in that over those that are placed.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import statistics
import subprocess
import sys
import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from mmocap_warp.body.skeleton import TRANSLATION
from mmocap_warp.formats.usd.usd_body import read_body

_LIST = Path(__file__).with_suffix(".toml")
_CAMERAS = 4
_GOOD_ERROR, _GOOD_OVERLAP = 1.0, 0.95  # at most [% of length], and at least
_LEAST_OUTLINE = 0.97


def run(command: list[object], threads: int, seconds: float) -> tuple[int, dict[str, Any], str]:
    """Exit code, answer and error line of a command of mmocap; 124 where it takes too long."""
    words = [sys.executable, "-m", "mmocap_warp", *map(str, command), "--json", "--quiet"]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": str(threads)}
    try:
        done = subprocess.run(words, capture_output=True, text=True, env=environment, timeout=seconds)
    except subprocess.TimeoutExpired:
        return 124, {}, f"takes over {seconds:.0f} s"
    answer = json.loads(done.stdout) if done.stdout.strip() else {}
    return done.returncode, answer, done.stderr.strip().splitlines()[-1] if done.stderr.strip() else ""


def measured(rig: dict[str, Any], rigs: Path, out: Path, frames: int, seconds: float) -> dict[str, Any]:
    """What becomes of a rig: a row of the table."""
    row: dict[str, Any] = {name: rig[name] for name in ("maker", "file", "licence")}
    folder = out / Path(rig["file"]).with_suffix("").as_posix().replace("/", "_")
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    body, scene, result = folder / "body.usda", folder / "scene", folder / "result.usdc"
    code, made, said = run(
        ["body", "import", rigs / rig["file"], "-o", body, "--scale", rig.get("scale", 1.0)], 1, seconds
    )
    if code:
        return row | {"refused": made.get("fault") or said}
    row |= {"length": max(made["size"]), "outline": made["outline_overlap"]}
    code, _, said = run(["synth", body, "-o", scene, "--motion", rig["motion"], "--cameras", _CAMERAS], 1, seconds)
    if code:
        return row | {"refused": said}
    track = ["track", scene, "-o", result, "--body", body, "--frames", f"0:{frames}", "--device", "cpu", "--threads", 1]
    code, tracked, said = run(track, 1, seconds)
    if code not in (0, 4):
        return row | {"refused": said}
    row |= {"overlap": tracked["mean_iou"], "trusted": tracked["verdict"]["trusted"]}
    _, judged, _ = run(["eval", result], 1, seconds)
    placed, per_cent = placed_joints(body), 100 / 1000 / row["length"]
    medians = {name: per_cent * each["median_mm"] for name, each in judged["by_joint"].items()}
    own = statistics.median(share for name, share in medians.items() if name in placed)
    return row | {"error": statistics.median(medians.values()), "placed": own}


def placed_joints(file: Path) -> set[str]:
    """The joints of a body that hang on one that is searched: a pose says where they are."""
    skeleton = read_body(file).skeleton
    searched = (skeleton.searched_angles() - TRANSLATION) // 3
    return {name for name, above in zip(skeleton.joints, skeleton.parent, strict=True) if above in (0, *searched)}


def table(rows: list[dict[str, Any]]) -> str:
    """The rows in Markdown, and how many rigs are tracked well."""
    lines = [
        "| maker | file | licence | length [m] | outline | joints, median [% of length] | of those placed | overlap "
        "| frames trusted |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        cells = [row["maker"], row["file"], row["licence"]]
        cells.append(f"{row['length']:.3g}" if "length" in row else "")
        cells.append(f"{row['outline']:.3f}" if "outline" in row else "")
        if "refused" in row:
            cells += [f"refused: {row['refused']}", "", "", ""]
        else:
            cells += [f"{row['error']:.2f}", f"{row['placed']:.2f}", f"{row['overlap']:.3f}", str(row["trusted"])]
        lines.append(f"| {' | '.join(cells)} |")
    tracked = [row for row in rows if "error" in row]
    good, placed = (
        sum(row[error] < _GOOD_ERROR and row["overlap"] > _GOOD_OVERLAP for row in tracked)
        for error in ("error", "placed")
    )
    makers = len({row["maker"] for row in tracked})
    alike = sum(row["outline"] >= _LEAST_OUTLINE for row in tracked)
    lines += [
        "",
        f"{len(rows)} rigs: {len(tracked)} of {makers} makers tracked, {good} of them with joints within "
        f"{_GOOD_ERROR:g} % ({placed} with those that are placed) and an overlap over {_GOOD_OVERLAP}; "
        f"{alike} outlines overlap by {_LEAST_OUTLINE} or more",
    ]
    return "\n".join(lines)


def main() -> None:
    """Measure every rig of the list that the folder holds."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("rigs", type=Path, metavar="RIGS", help="folder of the files")
    arguments.add_argument("out", type=Path, metavar="OUT", help="folder of bodies, scenes, results and table.md")
    arguments.add_argument("--only", nargs="+", metavar="FILE", help="of the list")
    arguments.add_argument("--frames", type=int, default=24)
    arguments.add_argument("--jobs", type=int, default=1, help="rigs at a time")
    arguments.add_argument("--seconds", type=float, default=1800.0, help="that a step may take")
    given = arguments.parse_args()
    listed = tomllib.loads(_LIST.read_text(encoding="utf-8"))["rig"]
    there = [rig for rig in listed if (given.rigs / rig["file"]).is_file()]
    chosen = [rig for rig in there if given.only is None or rig["file"] in given.only]

    def printed(rig: dict[str, Any]) -> dict[str, Any]:
        row = measured(rig, given.rigs, given.out, given.frames, given.seconds)
        print(json.dumps(row), file=sys.stderr, flush=True)
        return row

    with ThreadPoolExecutor(given.jobs) as pool:
        rows = list(pool.map(printed, chosen))
    text = table(rows)
    (given.out / "table.md").write_text(text + "\n", encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
