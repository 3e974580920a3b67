"""``mmocap calib solve``: cameras from nothing but a person who walks before them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from mmocap_warp.cli.console import CHECK_FAILED, OK, Console, Identity, Switch, table
from mmocap_warp.errors import UsageError

if TYPE_CHECKING:
    from mmocap_warp.calibration.solve.solution import SolvedCameras
    from mmocap_warp.scene.recording import Scene


def solve(
    scene: Path,
    /,
    *,
    height: float,
    output: Annotated[Path, Parameter(name=["--output", "-o"])] = Path("calibration.toml"),
    picture: Path | None = None,
    frames: str | None = None,
    identity: Identity = None,
    force: Switch = False,
    console: Console | None = None,
) -> int:
    """Find cameras from the silhouettes of one person who walks about, in metres, with the floor at zero.

    Parameters
    ----------
    scene
        The scene file, or its folder. Of a calibration that it names only the intrinsics are taken; without one, focal
        lengths are guessed from the images' sizes and found if the walk tells them.
    height
        Of the person, standing, in shoes, in metres.
    output
        The calibration's file: .toml.
    picture
        A .png of the views with the floor, the person's way and the body's axis.
    frames
        Which of the recording's frames: first:end or first:end:stride, such as 120:480:2, which leaves out the end; or
        a count of those that the scene names. [default: those that the scene names]
    force
        Replace a file that exists.
    """
    from mmocap_warp.calibration.solve import UnsolvableError
    from mmocap_warp.calibration.solve.solution import solve_cameras
    from mmocap_warp.commands.outputs import new_file
    from mmocap_warp.errors import InputError
    from mmocap_warp.formats.calibration.toml_rig import write_toml_rig
    from mmocap_warp.scene.scene_toml import load_scene

    console = console or Console()
    try:
        loaded = load_scene(scene, frames, identity, calibrated=False)
        new_file(output, ".toml", force=force)
        if picture is not None:
            new_file(picture, ".png", force=force)
        found = solve_cameras(loaded, height)
    except InputError:
        raise
    except UnsolvableError as error:
        console.result({"solved": False, "reason": str(error)}, f"check failed: {error}")
        return CHECK_FAILED
    except ValueError as error:
        raise UsageError.of_setting(error) from None
    write_toml_rig(output, found.rig)
    if picture is not None:
        _write_picture(picture, loaded, found)
    console.result(_values(loaded, found, output, picture), _text(loaded, found, height, output, picture))
    return OK


def _values(scene: Scene, found: SolvedCameras, output: Path, picture: Path | None) -> dict[str, Any]:
    import numpy as np

    from mmocap_warp.cameras.rig import describe_rig

    rig = found.rig
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
                "centre_sigma_m": found.centre_sigma[k],
                "height_m": row.height,
                "tilt_deg": _tilt(found, k),
                "tilt_sigma_deg": np.degrees(found.tilt_sigma[k]),
                "field_of_view_deg": row.field_of_view,
                "focal_px": rig.K[k, 0, 0],
                "focal_sigma": found.focal_sigma[k],
                "focal": found.focal[k],
                "whole_frames": found.whole[k],
                "agreed": found.agreed[k],
            }
            for k, row in enumerate(describe_rig(rig))
        ],
        "frames": [found.frames.start, found.frames.stop, found.frames.step],
        "disagreement_px": found.missed / found.scale,
    }


def _text(scene: Scene, found: SolvedCameras, height: float, output: Path, picture: Path | None) -> str:
    import numpy as np

    from mmocap_warp.cameras.rig import describe_rig
    from mmocap_warp.cli.console import next_step
    from mmocap_warp.formats.toml_table import quoted_path

    rows: list[tuple[str, ...]] = [
        (
            "camera",
            "frames",
            "agree",
            "x [m]",
            "y [m]",
            "z [m]",
            "+-",
            "over the floor [m]",
            "looks down [deg]",
            "+-",
            "view [deg]",
            "focal",
        )
    ]
    for k, row in enumerate(describe_rig(found.rig)):
        focal = f"{found.rig.K[k, 0, 0]:.0f} px, {found.focal[k]}"
        if found.focal[k] == "found":
            focal += f" +- {100 * found.focal_sigma[k]:.1f} %"
        place = (*(f"{value:.2f}" for value in row.centre), f"{found.centre_sigma[k]:.2f}", f"{row.height:.2f}")
        tilt = f"{_tilt(found, k):.1f}", f"{np.degrees(found.tilt_sigma[k]):.1f}"
        view = "{:.0f}x{:.0f}".format(*row.field_of_view)
        rows.append((row.name, str(found.whole[k]), f"{100 * found.agreed[k]:.0f} %", *place, *tilt, view, focal))
    way = found.heads[np.isfinite(found.heads[:, 0])]
    extent = np.sort(np.ptp(way, axis=0))[:0:-1]
    if scene.calibration is None:
        lenses = "no calibration is named: lenses without distortion, focal lengths guessed from the images' sizes"
        if "guessed" in found.focal:
            lenses += "; the walk does not determine those marked 'guessed', so they stay"
    else:
        lenses = f"intrinsics as given in {scene.calibration}"
        lenses += "; the places in it were not looked at" if scene.calibrated.placed else ", which has no places"
    lines = [
        table(rows),
        lenses,
        f"{len(found.frames)} frames of a walk over {extent[0]:.1f} x {extent[1]:.1f} m; the outlines' "
        f"tangents agree between views to {found.missed / found.scale:.1f} px in the median ('agree': share within "
        "3 px of images at most 960 long)",
        "+- are standard deviations over parts of the recording; they do not see what all frames have in common, such "
        "as shadows at the feet, or a camera that lags: run mmocap sync first where cameras are not triggered together",
        f'{output}: metres, the floor at zero, up = "{found.rig.up}"',
    ]
    named = quoted_path(output, scene.path.resolve().parent)
    refined = output.with_stem(f"{output.stem}-refined")
    if picture is not None:
        lines.append(f"{picture}: floor, way and body's axis in {len(found.rig)} views")
    lines.append(
        f"next: set calibration = {named} under [cameras], then "
        f"{next_step('calib', 'refine', scene.path, '--height', f'{height:g}', '-o', refined)}"
    )
    return "\n".join(lines)


def _tilt(found: SolvedCameras, k: int) -> float:
    import numpy as np

    return float(np.degrees(np.arcsin(-found.rig.R[k, 2] @ found.rig.up_vector)))


def _write_picture(path: Path, scene: Scene, found: SolvedCameras) -> None:
    from dataclasses import replace

    import numpy as np

    from mmocap_warp.display.floor_picture import floor_picture
    from mmocap_warp.formats.png import write_png

    known = np.flatnonzero(np.isfinite(found.heads[:, 0]))
    frame = int(known[len(known) // 2])
    there = scene.frames.index(found.frames[frame])
    solved = replace(scene, calibrated=found.rig, foreground=replace(scene.foreground, repair=False))
    images = next(solved.images(found.scale, there, 1))
    masks = next(solved.masks(found.scale, there, 1))
    drawn = [
        np.where(mask[..., None], _SEEN, _UNSEEN).astype(np.uint8).repeat(3, axis=2) if image is None else image
        for image, mask in zip(images, masks, strict=True)
    ]
    title = f"floor in squares of 0.5 m, the person's way, and the body's axis; frame {found.frames[frame]}"
    write_png(path, floor_picture(drawn, solved.rig(found.scale), found.heads, frame, title))


_SEEN, _UNSEEN = 128, 64
"""Gray of foreground and background where a camera has no image."""
