"""Markerless motion capture from silhouettes, on NVIDIA Warp and OpenUSD: ``import mmocap_warp as mm``.

What stands here is the public face, with a function for each command; docs/python.md shows it at work. A name is
imported when it is first used, so that importing the package imports nothing else. Metres, radians and seconds
throughout; arrays are NumPy's. No room imports it.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from mmocap_warp.version import __version__

if TYPE_CHECKING:
    from mmocap_warp.body.model import BodyModel, Subject
    from mmocap_warp.cameras.rig import CameraRig
    from mmocap_warp.commands.demo import demo
    from mmocap_warp.commands.evaluate import evaluate
    from mmocap_warp.commands.export import export
    from mmocap_warp.commands.fit import fit
    from mmocap_warp.commands.mask import mask
    from mmocap_warp.commands.measure import measure
    from mmocap_warp.commands.reporter import Reporter
    from mmocap_warp.commands.show import show, view
    from mmocap_warp.commands.track import track
    from mmocap_warp.display.result_video import overlay
    from mmocap_warp.errors import InputError, UsageError
    from mmocap_warp.fitting.fit_config import FitConfig
    from mmocap_warp.formats.truth_file import load_truth
    from mmocap_warp.formats.usd.usd_result import read_result as load_result
    from mmocap_warp.formats.usd.usd_result import write_result
    from mmocap_warp.optimizers.minimize import minimize
    from mmocap_warp.result.result import Result
    from mmocap_warp.rigging.shipped import load_body
    from mmocap_warp.scene.recording import Scene
    from mmocap_warp.scene.scene_toml import load_scene
    from mmocap_warp.tracking.live import LiveFrame, track_live
    from mmocap_warp.tracking.track_config import TrackConfig

_HOMES = {
    "BodyModel": "body.model:BodyModel",
    "CameraRig": "cameras.rig:CameraRig",
    "FitConfig": "fitting.fit_config:FitConfig",
    "InputError": "errors:InputError",
    "LiveFrame": "tracking.live:LiveFrame",
    "Reporter": "commands.reporter:Reporter",
    "Result": "result.result:Result",
    "Scene": "scene.recording:Scene",
    "Subject": "body.model:Subject",
    "TrackConfig": "tracking.track_config:TrackConfig",
    "UsageError": "errors:UsageError",
    "demo": "commands.demo:demo",
    "evaluate": "commands.evaluate:evaluate",
    "export": "commands.export:export",
    "fit": "commands.fit:fit",
    "load_body": "rigging.shipped:load_body",
    "load_result": "formats.usd.usd_result:read_result",
    "load_scene": "scene.scene_toml:load_scene",
    "load_truth": "formats.truth_file:load_truth",
    "mask": "commands.mask:mask",
    "measure": "commands.measure:measure",
    "minimize": "optimizers.minimize:minimize",
    "overlay": "display.result_video:overlay",
    "show": "commands.show:show",
    "track": "commands.track:track",
    "track_live": "tracking.live:track_live",
    "view": "commands.show:view",
    "write_result": "formats.usd.usd_result:write_result",
}
"""Where each name is defined: ``module:name``."""

__all__ = [
    "BodyModel", "CameraRig", "FitConfig", "InputError", "LiveFrame", "Reporter", "Result", "Scene", "Subject",
    "TrackConfig", "UsageError", "__version__", "demo", "evaluate", "export", "fit", "load_body", "load_result",
    "load_scene", "load_truth", "mask", "measure", "minimize", "overlay", "show", "track", "track_live", "view",
    "write_result",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, _, own_name = _HOMES[name].partition(":")
    value = globals()[name] = getattr(import_module(f"{__name__}.{module}"), own_name)
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
