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
    from mmocap_warp.calibration.camera_check import CameraCheck
    from mmocap_warp.calibration.refine.refinement import Refinement
    from mmocap_warp.calibration.solve import UnsolvableError
    from mmocap_warp.calibration.solve.solution import SolvedCameras
    from mmocap_warp.calibration.sync.synchronise import Synchronisation
    from mmocap_warp.cameras.rig import CameraRig
    from mmocap_warp.commands.bodies import export_body, import_body, learn_body, show_body
    from mmocap_warp.commands.calibrate import (
        check_cameras,
        convert_cameras,
        refine_cameras,
        show_cameras,
        solve_cameras,
        sync,
    )
    from mmocap_warp.commands.caller import Reporter
    from mmocap_warp.commands.clips import ablate, make_sequences
    from mmocap_warp.commands.demo import demo
    from mmocap_warp.commands.evaluate import evaluate, measure
    from mmocap_warp.commands.mask import mask
    from mmocap_warp.commands.new_scenes import import_humaneva, init, synthesize
    from mmocap_warp.commands.show import export, show, view
    from mmocap_warp.commands.studies import benchmark, report_study, run_study, write_benchmark_pages
    from mmocap_warp.commands.track import fit, track
    from mmocap_warp.display.result_video import overlay
    from mmocap_warp.errors import InputError, UsageError
    from mmocap_warp.fitting.fit_config import FitConfig
    from mmocap_warp.formats.truth_file import load_truth
    from mmocap_warp.formats.usd.usd_check import faults as validate_usd
    from mmocap_warp.formats.usd.usd_result import read_result as load_result
    from mmocap_warp.formats.usd.usd_result import write_result
    from mmocap_warp.optimizers.minimize import minimize
    from mmocap_warp.result.result import Result
    from mmocap_warp.rigging.shipped import load_body
    from mmocap_warp.scene.recording import Scene
    from mmocap_warp.scene.scene_toml import load_scene
    from mmocap_warp.study.store import read_results as study_results
    from mmocap_warp.tracking.live import LiveFrame, track_live
    from mmocap_warp.tracking.track_config import TrackConfig

_HOMES = {
    "BodyModel": "body.model:BodyModel",
    "CameraCheck": "calibration.camera_check:CameraCheck",
    "CameraRig": "cameras.rig:CameraRig",
    "FitConfig": "fitting.fit_config:FitConfig",
    "InputError": "errors:InputError",
    "LiveFrame": "tracking.live:LiveFrame",
    "Refinement": "calibration.refine.refinement:Refinement",
    "Reporter": "commands.caller:Reporter",
    "Result": "result.result:Result",
    "Scene": "scene.recording:Scene",
    "SolvedCameras": "calibration.solve.solution:SolvedCameras",
    "Subject": "body.model:Subject",
    "Synchronisation": "calibration.sync.synchronise:Synchronisation",
    "TrackConfig": "tracking.track_config:TrackConfig",
    "UnsolvableError": "calibration.solve:UnsolvableError",
    "UsageError": "errors:UsageError",
    "ablate": "commands.clips:ablate",
    "benchmark": "commands.studies:benchmark",
    "check_cameras": "commands.calibrate:check_cameras",
    "convert_cameras": "commands.calibrate:convert_cameras",
    "demo": "commands.demo:demo",
    "evaluate": "commands.evaluate:evaluate",
    "export": "commands.show:export",
    "export_body": "commands.bodies:export_body",
    "fit": "commands.track:fit",
    "import_body": "commands.bodies:import_body",
    "import_humaneva": "commands.new_scenes:import_humaneva",
    "init": "commands.new_scenes:init",
    "learn_body": "commands.bodies:learn_body",
    "load_body": "rigging.shipped:load_body",
    "load_result": "formats.usd.usd_result:read_result",
    "load_scene": "scene.scene_toml:load_scene",
    "load_truth": "formats.truth_file:load_truth",
    "make_sequences": "commands.clips:make_sequences",
    "mask": "commands.mask:mask",
    "measure": "commands.evaluate:measure",
    "minimize": "optimizers.minimize:minimize",
    "overlay": "display.result_video:overlay",
    "refine_cameras": "commands.calibrate:refine_cameras",
    "report_study": "commands.studies:report_study",
    "run_study": "commands.studies:run_study",
    "show": "commands.show:show",
    "show_body": "commands.bodies:show_body",
    "show_cameras": "commands.calibrate:show_cameras",
    "solve_cameras": "commands.calibrate:solve_cameras",
    "study_results": "study.store:read_results",
    "sync": "commands.calibrate:sync",
    "synthesize": "commands.new_scenes:synthesize",
    "track": "commands.track:track",
    "track_live": "tracking.live:track_live",
    "validate_usd": "formats.usd.usd_check:faults",
    "view": "commands.show:view",
    "write_benchmark_pages": "commands.studies:write_benchmark_pages",
    "write_result": "formats.usd.usd_result:write_result",
}
"""Where each name is defined: ``module:name``."""

__all__ = [
    "BodyModel", "CameraCheck", "CameraRig", "FitConfig", "InputError", "LiveFrame", "Refinement", "Reporter",
    "Result", "Scene", "SolvedCameras", "Subject", "Synchronisation", "TrackConfig", "UnsolvableError",
    "UsageError", "__version__", "ablate", "benchmark", "check_cameras", "convert_cameras", "demo", "evaluate",
    "export", "export_body", "fit", "import_body", "import_humaneva", "init", "learn_body", "load_body",
    "load_result", "load_scene", "load_truth", "make_sequences", "mask", "measure", "minimize",
    "overlay", "refine_cameras", "report_study", "run_study", "show", "show_body", "show_cameras", "solve_cameras",
    "study_results", "sync", "synthesize", "track", "track_live", "validate_usd", "view", "write_benchmark_pages",
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
