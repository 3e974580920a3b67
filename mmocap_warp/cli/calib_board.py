"""``mmocap calib board`` and ``print-board``: cameras from a board that is moved about, and that board."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mmocap_warp.cli.command import ANY_NUMBER, BY_FLAG, BY_PLACE, Answer, Given, command
from mmocap_warp.cli.console import next_step, table

_COLUMNS = (
    "camera", "lens frames", "place frames", "covered", "residual [px]", "focal [px]", "+-", "x [m]", "y [m]", "z [m]",
)  # fmt: skip


@command(
    "boards:calibrate_board",
    order="board output",
    videos=Given(Path, kind=ANY_NUMBER),
    board=Given(str, kind=BY_FLAG),
    output=Given(Path, Path("calibration.toml")),
)
def board(call: Any, videos: tuple[Path, ...], output: Path, picture: Path | None) -> Answer:
    found = call()
    rig = found.rig
    rows: list[tuple[str, ...]] = [_COLUMNS]
    cameras = []
    for k, name in enumerate(rig.names):
        centre = rig.centres[k]
        focal = rig.K[k, 0, 0]
        used = "given" if not found.lens_frames[k] else str(found.lens_frames[k])
        share = f"{100 * found.focal_sigma[k]:.2f} %"
        numbers = f"{found.rms[k]:.2f}", f"{focal:.1f}", share, *(f"{value:.3f}" for value in centre)
        rows.append((name, used, str(found.place_frames[k]), f"{100 * found.coverage[k]:.0f} %", *numbers))
        cameras.append(
            {
                "name": name,
                "lens_frames": found.lens_frames[k],
                "place_frames": found.place_frames[k],
                "coverage": found.coverage[k],
                "residual_px": found.rms[k],
                "focal_px": focal,
                "focal_sigma": found.focal_sigma[k],
                "centre_m": centre,
            }
        )
    origin = "the board on the floor" if rig.up == "+z" else "the first camera; name a --floor frame for a level one"
    lines = [table(rows, 1), f'{output}: metres, up = "{rig.up}", the world is that of {origin}']
    if picture is not None:
        lines.append(f"{picture}: corners, and residuals 50 times longer, in {len(rig)} views")
    scene = videos[0] if len(videos) == 1 else Path("scene.toml")
    lines.append(f"next: set calibration under [cameras] of the person's scene, then {next_step('cameras', scene)}")
    values = {"calibration": output, "picture": picture, "up": rig.up, "cameras": cameras}
    return Answer(values, lines)


@command("boards:print_board", board=Given(str, kind=BY_PLACE), output=Given(Path, Path("board.svg")))
def print_board(call: Any) -> Answer:
    file = call()
    return Answer({"file": file}, [f"{file}: print at 100 %, see that its ruler is right, and glue it on a flat plate"])
