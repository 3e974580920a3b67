"""``mmocap mask``: a scene's masks, made once and judged."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from mmocap_warp.cli.command_help import documented_by
from mmocap_warp.cli.console import (
    CHECK_FAILED,
    OK,
    Console,
    Identity,
    Output,
    SceneFile,
    SceneFrames,
    Switch,
    next_step,
)

if TYPE_CHECKING:
    from mmocap_warp.masks.mask_check import MaskReport


@documented_by("mask:mask")
def mask(
    scene: SceneFile,
    /,
    *,
    output: Annotated[Path, Output],
    scale: float = 1.0,
    frames: SceneFrames = None,
    from_body: Path | None = None,
    identity: Identity = None,
    force: Switch = False,
    console: Console | None = None,
) -> int:
    from mmocap_warp.commands.mask import mask

    console = console or Console()
    masks = mask(
        scene,
        output,
        scale=scale,
        frames=frames,
        from_body=from_body,
        identity=identity,
        force=force,
        reporter=console,
    )
    report = masks.report
    step = next_step("track", masks.scene, "-o", masks.source.parent / "result.usdc")
    values = {
        "scene": masks.scene,
        "overlay": masks.overlay,
        "frames": masks.frames,
        "views": {
            name: {
                "area_px": view.area,
                "empty_frames": int((view.area == 0).sum()),
                "explained": view.explained,
                "covered": view.covered,
            }
            for name, view in report.views.items()
        },
        "hull_litres": 1000 * report.volume,
        "masks_ok": masks.remedy is None,
        "faults": list(report.faults),
        "next": step if masks.remedy is None else None,
    }
    lines = [f"{masks.scene}: {masks.frames} frames, {len(report.views)} cameras", *_table(report)]
    if masks.remedy is not None:
        lines += [f"check failed: {fault}" for fault in report.faults] + [masks.remedy]
    else:
        lines.append(f"next: {step}")
    console.result(values, "\n".join(lines))
    return OK if masks.remedy is None else CHECK_FAILED


def _table(report: MaskReport) -> list[str]:
    """Each view's areas, how many frames are empty, and how well it agrees with the others."""
    import numpy as np

    lines = [f"{'camera':<12} {'median':>8} {'least':>8} {'most':>8} {'empty':>8} {'explained':>10} {'covered':>8}"]
    lines += [f"{'':<12} {'px':>8} {'px':>8} {'px':>8} {'frames':>8} {'%':>10} {'%':>8}"]
    for name, view in report.views.items():
        seen = view.area[view.area > 0]
        areas = (np.median(seen), seen.min(), seen.max()) if len(seen) else (0, 0, 0)
        shares = f"{_percent(view.explained):>10} {_percent(view.covered):>8}"
        columns = " ".join(f"{area:8.0f}" for area in areas)
        lines.append(f"{name:<12} {columns} {(view.area == 0).sum():8d} {shares}")
    return lines


def _percent(share: float) -> str:
    return f"{100 * share:.0f}" if share == share else "-"
