"""Makes the tracker that settings ask for, unless it clearly could not finish.

A machine that runs out of memory kills the program or slows to a crawl. So the need is estimated before anything is
made, and what is too large is refused. The estimate counts what grows with the mesh, the images, the candidates and the
runs; it may be a third off.
"""

import bisect
from dataclasses import replace
from typing import Any

from mmocap_warp.body.mesh_pieces import is_closed
from mmocap_warp.body.model import Subject
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.contour.clip.backward_pass import STARTS
from mmocap_warp.contour.frame.fields import MOST_WHOLE, whole_image_bytes
from mmocap_warp.contour.frame.fitter_arrays import contour_room
from mmocap_warp.device.resolve import free_memory, resolve_device
from mmocap_warp.errors import InputError
from mmocap_warp.tracking.contour_tracker import ContourTracker, starts_per_run
from mmocap_warp.tracking.evidence import FRAMES_TOGETHER
from mmocap_warp.tracking.limb_pairs import limb_pairs
from mmocap_warp.tracking.pose_search import search_size
from mmocap_warp.tracking.smoothing import CANDIDATES, RECALLED, frames_held
from mmocap_warp.tracking.track_config import TrackConfig
from mmocap_warp.tracking.tracker import Tracker

_SHARE = 0.9  # share of the free memory that may be taken: kernels, graphs and other programs need some too
_BODY_SHARE = 0.15  # share of an image that the box around a body is taken to fill
_GB = 1e9


def make_tracker(subject: Subject, rig: CameraRig, config: TrackConfig, fps: float) -> Tracker | ContourTracker:
    """A tracker by its settings.

    Raises:
        InputError: too many runs, or too large a budget, for the device's memory; says how many runs, or what budget,
            would fit. Or a tracking mesh that is not closed: a body's contours wind around it.
    """
    if not is_closed(subject.body.tracking_face):
        raise InputError(subject.body.name, "its tracking mesh is not closed", "close the mesh")
    _check_memory(subject, rig, config, fps)
    return (ContourTracker if config.fits_contours else Tracker)(subject, rig, config, fps)


def _check_memory(subject: Subject, rig: CameraRig, config: TrackConfig, fps: float) -> None:
    """Refuse what would not fit, and say what does."""
    device = resolve_device(config.device)
    free, need = free_memory(device), memory_need(subject, rig, config, fps)
    if free is None or need <= _SHARE * free:
        return

    def need_with(**changed: Any) -> float:
        return memory_need(subject, rig, replace(config, **changed), fps)

    def most(name: str, highest: int) -> int:
        """The highest value of a setting that fits; 0 where none does."""
        return bisect.bisect_right(range(1, highest + 1), _SHARE * free, key=lambda value: need_with(**{name: value}))

    fitting = {"runs": most("runs", config.runs), "evaluations": most("evaluations", config.budget)}
    smaller = " or ".join(f"{name} = {value}" for name, value in fitting.items() if value)
    asked = f"{config.algorithm} with runs = {config.runs} and evaluations = {config.budget}"
    problem = f"{asked} takes about {need / _GB:,.1f} GB of memory, {free / _GB:,.1f} GB are free"
    fits = f"the most that fits is {smaller}"
    raise InputError(device, problem, fits if smaller else "choose fewer runs, a smaller budget and a smaller scale")


def memory_need(subject: Subject, rig: CameraRig, config: TrackConfig, fps: float) -> float:
    """About how many bytes tracking takes, and smoothing beside it."""
    mesh, cameras, dof = subject.body.tracking, len(rig), len(subject.body.skeleton.searched(config.dof))
    on_cpu = resolve_device(config.device) == "cpu"
    vertices, faces, pixels = len(mesh.rest), len(mesh.face), float(rig.size.prod(axis=1).sum())

    # A candidate whose silhouettes are drawn: its skin, and in each view its corners, triangles and their boxes.
    boxes = 0 if config.fits_contours or config.renderer == "raster" else 3.3 if on_cpu else 17
    drawn = 12 * vertices + 128 * len(subject.body.joint_rest) + cameras * (8 * vertices + (1 + boxes) * faces)
    # A candidate whose contours are fitted: in each view the room for contour edges, most of it rows of a Jacobian.
    room = contour_room(3 * faces // 2)
    fitted = 36 * vertices + cameras * (room * (76 + 4 * dof) + 12 * vertices + 7 * faces)

    # A run of a search has its candidates, and the bits of what rests while a part of the body moves.
    candidates, optimizers = search_size(subject.body.skeleton, config)
    tracking = candidates * (drawn + 48 * dof) + (optimizers - 1) * pixels / 8 if candidates else 0.0
    if config.fits_contours:
        tracking += starts_per_run(config) * (drawn + fitted)
    if not config.acceleration:
        return config.runs * tracking
    # Smoothing holds distances to the masks' contours for a window of frames. A GPU takes whole images where they are
    # small.
    frames = frames_held(fps)
    whole = whole_image_bytes(rig, frames)
    is_whole = not on_cpu and whole <= MOST_WHOLE
    fields = whole if is_whole else 4 * frames * pixels * _BODY_SHARE
    # Poses of the frames that are held, recalled ones, one of the body's changes, one for each pair of limbs, and those
    # whose views are asked.
    poses = max(STARTS, min(CANDIDATES, frames)) + (RECALLED if on_cpu else 0) + 1 + FRAMES_TOGETHER
    poses += len(limb_pairs(subject.body.skeleton))
    # On a GPU, of each frame, derivatives of its points and its rows of the clip's band, factored and inverted.
    band = 0 if on_cpu else 8 * frames * dof * (12 * len(subject.body.joint_rest) + 19 * dof)
    marks = 8 * pixels  # of what the body leaves uncovered, in the tracker and beside it
    return config.runs * tracking + poses * fitted + fields + band + max(config.runs, poses) * drawn + marks
