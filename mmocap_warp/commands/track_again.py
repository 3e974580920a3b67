"""Some frames of a result solved anew: ``mmocap track --again``."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mmocap_warp.commands import inputs
from mmocap_warp.commands.caller import Reporter, effective, start_warp
from mmocap_warp.display.result_video import check_same_recording
from mmocap_warp.errors import InputError, UsageError
from mmocap_warp.formats.usd.usd_result import write_result
from mmocap_warp.result.result import Result
from mmocap_warp.scene.recording import Scene
from mmocap_warp.tracking import mending
from mmocap_warp.tracking.pins import Pins, read_pins
from mmocap_warp.tracking.track_config import TrackConfig
from mmocap_warp.whole_file import write_whole


def solved_again(
    loaded: Scene,
    again: Result | str | Path,
    pins: str | Path | list[dict[str, Any]] | None,
    config: TrackConfig | None,
    file: Path | None,
    reporter: Reporter,
    settings: dict[str, Any],
) -> Result:
    """A result of which some frames were solved anew: around pins, or those that the scene is ``loaded`` with."""
    result, path = inputs.result_from(again)
    check_same_recording(result, loaded)
    if (identity := result.config.get("identity", 0)) != loaded.foreground.identity:
        raise InputError(path or "result", f"is of the identity {identity} in the masks", "give the same --identity")
    if (person := result.config.get("person", "")) != loaded.person:
        own, asked = (name or "somebody without a name" for name in (person, loaded.person))
        raise InputError(path or "result", f"is of {own}, not of {asked}", "give its own scene and --person")
    numbers = result.frame_numbers.tolist()
    chosen = [position for position, number in enumerate(numbers) if number in loaded.frames]
    span = range(chosen[0], chosen[-1] + 1) if pins is None and 0 < len(chosen) < len(numbers) else None
    if span is None and pins is None:
        some = f"some but not all of the result's {inputs.span(numbers)}"
        raise UsageError(f"--again needs --pins, or --frames first:end, {some}, to say which are solved anew")

    # The run's settings are those of the result; where it is done may be another place.
    usual = TrackConfig()
    fields = set(vars(usual)) - {"device", "threads"}
    own = TrackConfig(**{name: result.config[name] for name in fields if name in result.config})
    stated = () if config is None else ((name, getattr(config, name)) for name in fields)
    changed = {name for name, value in stated if value not in (getattr(usual, name), getattr(own, name))}
    if other := set(settings) - {"device", "threads"} | changed:
        raise UsageError(f"--{min(other).replace('_', '-')} cannot be given with --again, which has the result's own")
    place = effective(TrackConfig, loaded.settings("track"), settings, config)
    own = replace(own, device=place.device, threads=place.threads)
    start_warp(own.device)

    # Cameras that were refined lie beside the result; all must be those that it was tracked with.
    if (refined := result.config.get("refined_cameras")) is not None:
        if path is None or not (kept := path.with_name(refined)).exists():
            remedy = "give its file, beside which they were written" if path is None else "copy them there"
            raise InputError(path or "result", f"its refined cameras ({refined}) are not beside it", remedy)
        loaded = inputs.with_refined(loaded, kept)
    of_scene, of_result = ((rig.K, rig.R, rig.t) for rig in (loaded.rig(own.scale), result.cameras))
    if not all(np.allclose(*each, atol=1e-4) for each in zip(of_scene, of_result, strict=True)):
        raise InputError(loaded.path, "its cameras are not those of the result", "give the calibration of then")
    clicked = Pins.none() if pins is None else read_pins(pins, result, loaded.calibrated)
    with reporter.stage("mend", None):
        mended = mending.mended(loaded, result, own, clicked, span)
    changed = mended.config.get("mended", [])[len(result.config.get("mended", [])) :]
    spans = ", ".join(f"{first} to {last}" for first, last in (each["frames"] for each in changed))
    reporter.note(f"again: frames {spans} are new" if spans else "again: nothing better was found")
    mended = replace(mended, config=mended.config | inputs.scene_reference(loaded, file))
    if file is not None and path is not None and refined is not None:  # they lie beside the new result, too
        mended.config["refined_cameras"] = f"{file.stem}.calibration.toml"
        write_whole(file.with_name(mended.config["refined_cameras"]), path.with_name(refined).read_bytes())
    if file is not None:
        write_result(file, mended)
    return mended
