"""``mmocap study show``: what results a folder holds."""

from __future__ import annotations

from pathlib import Path

from mmocap_warp.cli.console import CHECK_FAILED, OK, Console


def show(folder: Path, /, *, console: Console | None = None) -> int:
    """List a folder's results.

    Parameters
    ----------
    folder
        What 'mmocap study run' wrote, or several such folders copied into one.
    """
    from mmocap_warp.errors import InputError
    from mmocap_warp.study.store import read_results

    console = console or Console()
    rows, damaged = [], []
    for result in read_results(folder):
        if isinstance(result, InputError):
            damaged.append(str(result))
            continue
        runs, frames = len(result.seeds), len(result.frames)
        names = ("study", "host", "device", "started", "wall_seconds", "versions", "code")
        made = {name: result.meta.get(name) for name in names}
        rows.append({"cell": str(result.cell), "runs": runs, "frames": frames} | made)
    lines = [
        f"{row['cell']}, {row['runs']} runs of {row['frames']} frames, {row['device']}, {row['host']}" for row in rows
    ]
    lines += [f"damaged: {problem}" for problem in damaged]
    lines.append(f"{folder}: {len(rows)} results, {len(damaged)} damaged")
    console.result({"folder": folder, "results": rows, "damaged": damaged}, "\n".join(lines))
    return CHECK_FAILED if damaged else OK
