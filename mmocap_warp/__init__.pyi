"""The public names and where they are defined: read by type checkers, and by the package when a name is first used."""

from mmocap_warp.body.model import BodyModel, Subject
from mmocap_warp.calibration.board.board_cameras import BoardCalibration
from mmocap_warp.calibration.camera_check import CameraCheck
from mmocap_warp.calibration.refine.refinement import Refinement
from mmocap_warp.calibration.solve import UnsolvableError
from mmocap_warp.calibration.solve.solution import SolvedCameras
from mmocap_warp.calibration.sync.synchronise import Synchronisation
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.commands.batch import batch
from mmocap_warp.commands.boards import calibrate_board, print_board
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
from mmocap_warp.commands.clips import make_sequences
from mmocap_warp.commands.demo import demo
from mmocap_warp.commands.evaluate import evaluate, measure
from mmocap_warp.commands.live_session import LiveReport, live
from mmocap_warp.commands.mask import mask
from mmocap_warp.commands.new_scenes import import_dataset, init, synthesize
from mmocap_warp.commands.show import export, show, view
from mmocap_warp.commands.studies import benchmark, report_study, run_study
from mmocap_warp.commands.track import fit, track
from mmocap_warp.commands.track_people import track_people
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
from mmocap_warp.tracking.live import LiveTracker, track_live
from mmocap_warp.tracking.live_smoothing import LiveFrame
from mmocap_warp.tracking.track_config import TrackConfig
from mmocap_warp.version import __version__ as __version__

__all__ = [
    "BoardCalibration", "BodyModel", "CameraCheck", "CameraRig", "FitConfig", "InputError", "LiveFrame", "LiveReport",
    "LiveTracker", "Refinement", "Reporter", "Result", "Scene", "SolvedCameras", "Subject", "Synchronisation",
    "TrackConfig", "UnsolvableError", "UsageError", "__version__", "batch", "benchmark", "calibrate_board",
    "check_cameras", "convert_cameras", "demo", "evaluate", "export", "export_body", "fit", "import_body",
    "import_dataset", "init", "learn_body", "live", "load_body", "load_result", "load_scene",
    "load_truth", "make_sequences", "mask", "measure", "minimize", "overlay", "print_board", "refine_cameras",
    "report_study", "run_study", "show", "show_body", "show_cameras", "solve_cameras", "study_results", "sync",
    "synthesize", "track", "track_live", "track_people", "validate_usd", "view", "write_result",
]  # fmt: skip
