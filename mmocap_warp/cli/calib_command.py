"""``mmocap calib``: calibrations, found from a walking person or a board, or converted; and its commands."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import App, Parameter

from mmocap_warp.cli import COMMANDS
from mmocap_warp.cli.command import ANY_NUMBER, BY_FLAG, BY_PLACE, Answer, Given, attributes, command
from mmocap_warp.cli.console import CHECK_FAILED, next_step, table
from mmocap_warp.formats.toml_table import quoted_path

if TYPE_CHECKING:
    from mmocap_warp.calibration.solve.solution import SolvedCameras
    from mmocap_warp.scene.recording import Scene

app = App(name="calib", help="Calibrations: convert, check, refine and solve them.", version_flags=[])
_COLUMNS = (
    "camera", "frames", "agree", "x [m]", "y [m]", "z [m]", "+-", "over the floor [m]", "looks down [deg]", "+-",
    "view [deg]", "focal",
)  # fmt: skip
_BOARD_COLUMNS = (
    "camera", "lens frames", "place frames", "covered", "residual [px]", "focal [px]", "+-", "x [m]", "y [m]", "z [m]",
)  # fmt: skip
app.command("mmocap_warp.cli.calib_adjust:check", name="check", help=COMMANDS["calib check"]["help"], sort_key=1)
app.command("mmocap_warp.cli.calib_adjust:refine", name="refine", help=COMMANDS["calib refine"]["help"], sort_key=2)


@app.command(help=COMMANDS["calib solve"]["help"], sort_key=3)
@command(
    "calibrate:solve_cameras",
    calibrated=False,
    order="height output",
    scene=Path,
    height=Given(float, kind=BY_FLAG),
    output=Given(Path, Path("calibration.toml")),
)
def solve(call: Any, loaded: Scene, height: float, output: Path, picture: Path | None) -> Answer:
    from mmocap_warp.calibration.solve import UnsolvableError

    try:
        cameras = call()
    except UnsolvableError as error:
        return _unsolvable(error)
    values = _values(loaded, cameras, output, picture)
    return Answer(values, _lines(loaded, cameras, values, height))


def _unsolvable(error: Exception) -> Answer:
    return Answer({"solved": False, "reason": str(error)}, [f"check failed: {error}"], CHECK_FAILED)


def _values(scene: Scene, cameras: SolvedCameras, output: Path, picture: Path | None) -> dict[str, Any]:
    import numpy as np

    from mmocap_warp.cameras.rig import describe_rig

    rig = cameras.rig
    return {
        "solved": True,
        "calibration": output,
        "picture": picture,
        "up": rig.up,
        "intrinsics": "guessed" if scene.calibration is None else scene.calibration,
        "cameras": [
            {
                "name": row.name,
                "centre_m": row.centre,
                "centre_sigma_m": cameras.centre_sigma[k],
                "height_m": row.height,
                "tilt_deg": np.degrees(np.arcsin(-rig.R[k, 2] @ rig.up_vector)),
                "tilt_sigma_deg": np.degrees(cameras.tilt_sigma[k]),
                "field_of_view_deg": row.field_of_view,
                "focal_px": rig.K[k, 0, 0],
            }
            | attributes(cameras, "focal_sigma", "focal", "agreed", at=k, whole_frames="whole")
            for k, row in enumerate(describe_rig(rig))
        ],
        "frames": [cameras.frames.start, cameras.frames.stop, cameras.frames.step],
        "disagreement_px": cameras.missed / cameras.scale,
    }


def _lines(scene: Scene, cameras: SolvedCameras, values: dict[str, Any], height: float) -> list[str]:
    import numpy as np

    output, picture = values["calibration"], values["picture"]
    rows: list[tuple[str, ...]] = [_COLUMNS]
    for row in values["cameras"]:
        focal = f"{row['focal_px']:.0f} px, {row['focal']}"
        if row["focal"] == "found":
            focal += f" +- {100 * row['focal_sigma']:.1f} %"
        place = (f"{value:.2f}" for value in (*row["centre_m"], row["centre_sigma_m"], row["height_m"]))
        tilt = f"{row['tilt_deg']:.1f}", f"{row['tilt_sigma_deg']:.1f}"
        view = "{:.0f}x{:.0f}".format(*row["field_of_view_deg"])
        frames, agreed = str(row["whole_frames"]), f"{100 * row['agreed']:.0f} %"
        rows.append((row["name"], frames, agreed, *place, *tilt, view, focal))
    # Where the lenses are from, and how well the views agree.
    if scene.calibration is None:
        lenses = "no calibration is named: lenses without distortion, focal lengths guessed from the images' sizes"
        if "guessed" in cameras.focal:
            lenses += "; the walk does not determine those marked 'guessed', so they stay"
    else:
        lenses = f"intrinsics as given in {scene.calibration}"
        lenses += "; the places in it were not looked at" if scene.calibrated.placed else ", which has no places"
    extent = np.sort(np.ptp(cameras.heads[np.isfinite(cameras.heads[:, 0])], axis=0))[:0:-1]
    lines = [
        table(rows),
        lenses,
        f"{len(cameras.frames)} frames of a walk over {extent[0]:.1f} x {extent[1]:.1f} m; the outlines' tangents "
        f"differ between views by {cameras.missed / cameras.scale:.1f} px in the median",
        "agree: the share of tangents that differ by at most 3 px in images of at most 960 px",
        "+-: the standard deviation between parts of the recording, without errors that all frames share, such as "
        "shadows at the feet or a camera that lags; run mmocap sync first if no trigger starts the cameras together",
        f'{output}: metres, the floor at zero, up = "{cameras.rig.up}"',
    ]
    # What was written, and what to do next.
    if picture is not None:
        lines.append(f"{picture}: floor, way and body's axis in {len(cameras.rig)} views")
    named = quoted_path(output, scene.path.resolve().parent)
    refined = output.with_stem(f"{output.stem}-refined")
    step = next_step("calib", "refine", scene.path, "--height", f"{height:g}", "-o", refined)
    lines.append(f"next: set calibration = {named} under [cameras], then {step}")
    return lines


@app.command(help=COMMANDS["calib convert"]["help"], sort_key=0)
@command("calibrate:convert_cameras", up=Annotated[str, Parameter(allow_leading_hyphen=True)])
def convert(call: Any, output: Path) -> Answer:
    from mmocap_warp.commands.calibrate import calibration_files
    from mmocap_warp.formats.table import CALIBRATION_EXPORTS, format_of

    rig, kind = call(), format_of(CALIBRATION_EXPORTS, output).name
    rows = [
        {"name": name, "size": rig.size[k], "fisheye": name in rig.fisheye, "centre_m": rig.centres[k]}
        for k, name in enumerate(rig.names)
    ]
    values = {"file": output, "files": calibration_files(output), "format": kind, "cameras": rows}
    return Answer(values, [f"{output}: {', '.join(rig.names)} as {kind}"])


@app.command(help=COMMANDS["calib board"]["help"], sort_key=4)
@command(
    "boards:calibrate_board",
    order="board output",
    videos=Given(Path, kind=ANY_NUMBER),
    board=Given(str, kind=BY_FLAG),
    output=Given(Path, Path("calibration.toml")),
)
def board(call: Any, videos: tuple[Path, ...], output: Path, picture: Path | None, person: Path | None) -> Answer:
    from mmocap_warp.calibration.solve import UnsolvableError

    try:
        found = call()
    except UnsolvableError as error:
        return _unsolvable(error)
    rig = found.rig
    rows: list[tuple[str, ...]] = [_BOARD_COLUMNS]
    cameras = []
    for k, name in enumerate(rig.names):
        centre = rig.centres[k] + 0.0  # no negative zeros
        focal, used = rig.K[k, 0, 0], "given" if not found.lens_frames[k] else str(found.lens_frames[k])
        share = f"{100 * found.focal_sigma[k]:.2f} %"
        numbers = f"{found.rms[k]:.2f}", f"{focal:.1f}", share, *(f"{value:.3f}" for value in centre)
        rows.append((name, used, str(found.place_frames[k]), f"{100 * found.coverage[k]:.0f} %", *numbers))
        camera = {"name": name} | attributes(found, "lens_frames", "place_frames", "coverage", at=k, residual_px="rms")
        cameras.append(camera | {"focal_px": focal, "focal_sigma": found.focal_sigma[k], "centre_m": centre})
    origin = "the board on the floor" if person is None else "the person's floor"
    if rig.up != "+z":
        origin = "the first camera; name a --floor frame, or a --person, for a level one"
    lines = [table(rows, 1), f'{output}: metres, up = "{rig.up}", the world is that of {origin}']
    if picture is not None:
        lines.append(f"{picture}: corners, and residuals 50 times longer, in {len(rig)} views")
    scene = videos[0] if len(videos) == 1 else Path("scene.toml")
    lines.append(f"next: set calibration under [cameras] of the person's scene, then {next_step('cameras', scene)}")
    return Answer({"calibration": output, "picture": picture, "up": rig.up, "cameras": cameras}, lines)


@app.command(help=COMMANDS["calib print-board"]["help"], sort_key=5)
@command("boards:print_board", board=Given(str, kind=BY_PLACE), output=Given(Path, Path("board.svg")))
def print_board(call: Any) -> Answer:
    file = call()
    return Answer({"file": file}, [f"{file}: print at 100 %, see that its ruler is right, and glue it on a flat plate"])
