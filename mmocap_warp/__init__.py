"""Markerless motion capture from silhouettes, on NVIDIA Warp and OpenUSD: ``import mmocap_warp as mm``.

What stands here is the public face; docs/python.md shows it at work. A name is imported when it is first used, so that
importing the package imports nothing else. Metres, radians and seconds throughout; arrays are NumPy's. The face may
name parts of every room but the command line, the benchmarks and the study; no room imports it.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from mmocap_warp.version import __version__

if TYPE_CHECKING:
    from mmocap_warp.body.model import BodyModel, Subject
    from mmocap_warp.commands.evaluate import evaluate
    from mmocap_warp.commands.reporter import Reporter
    from mmocap_warp.display.page.viewer import view
    from mmocap_warp.display.result_video import overlay
    from mmocap_warp.errors import InputError, UsageError
    from mmocap_warp.fitting.subject_fit import FitConfig, fit
    from mmocap_warp.formats.truth_file import load_truth
    from mmocap_warp.formats.usd.usd_result import read_result as load_result
    from mmocap_warp.formats.usd.usd_result import write_result
    from mmocap_warp.optimizers.minimize import minimize
    from mmocap_warp.result.result import Result
    from mmocap_warp.rigging.shipped import load_body
    from mmocap_warp.scene.recording import Scene
    from mmocap_warp.scene.scene_toml import load_scene
    from mmocap_warp.tracking.frame_loop import track
    from mmocap_warp.tracking.live import LiveFrame, track_live
    from mmocap_warp.tracking.track_config import TrackConfig

_HOME = {
    "BodyModel": ("body.model", "BodyModel"),
    "FitConfig": ("fitting.subject_fit", "FitConfig"),
    "InputError": ("errors", "InputError"),
    "LiveFrame": ("tracking.live", "LiveFrame"),
    "Reporter": ("commands.reporter", "Reporter"),
    "Result": ("result.result", "Result"),
    "Scene": ("scene.recording", "Scene"),
    "Subject": ("body.model", "Subject"),
    "TrackConfig": ("tracking.track_config", "TrackConfig"),
    "UsageError": ("errors", "UsageError"),
    "evaluate": ("commands.evaluate", "evaluate"),
    "fit": ("fitting.subject_fit", "fit"),
    "load_body": ("rigging.shipped", "load_body"),
    "load_result": ("formats.usd.usd_result", "read_result"),
    "load_scene": ("scene.scene_toml", "load_scene"),
    "load_truth": ("formats.truth_file", "load_truth"),
    "minimize": ("optimizers.minimize", "minimize"),
    "overlay": ("display.result_video", "overlay"),
    "track": ("tracking.frame_loop", "track"),
    "track_live": ("tracking.live", "track_live"),
    "view": ("display.page.viewer", "view"),
    "write_result": ("formats.usd.usd_result", "write_result"),
}

__all__ = [
    "BodyModel",
    "FitConfig",
    "InputError",
    "LiveFrame",
    "Reporter",
    "Result",
    "Scene",
    "Subject",
    "TrackConfig",
    "UsageError",
    "__version__",
    "evaluate",
    "fit",
    "load_body",
    "load_result",
    "load_scene",
    "load_truth",
    "minimize",
    "overlay",
    "track",
    "track_live",
    "view",
    "write_result",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, there = _HOME[name]
    value = globals()[name] = getattr(import_module(f"{__name__}.{module}"), there)
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
