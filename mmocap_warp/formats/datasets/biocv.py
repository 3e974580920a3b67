"""BioCV of the University of Bath: nine cameras of 200 frames a second, and optical motion capture.

Sources: the note of researchdata.bath.ac.uk/1258; README.md of github.com/camera-mc-dev/mc_base; bioCV_to_opencap.py of
Pose2Sim; humancalib/evaluation/biocv.py, which reports the scale in L. They say that a participant's folder holds

- ``00.mp4-mocAligned.calib`` to ``08``, text: width, height, K by rows, L by rows (4x4, world to camera, millimetres),
  and k0 to k4, OpenCV's k1 k2 p1 p2 k3. The world is the motion capture's, z up. The turn in L is scaled, by about
  0.998: [s R | t] and [R | t / s] project alike. ``calibrationUpdate/P03/`` may hold better ones, ``mocAligned2``;
- ``P03_WALK_01/``, a trial: ``00.mp4`` to ``08.mp4``, and ``markers.c3d`` of the same frames. Its markers stand beside
  the joints' centres, such as LEFT_KNEE.
"""

from pathlib import Path

import numpy as np

from mmocap_warp.cameras.rig import Camera, rig_of
from mmocap_warp.errors import InputError
from mmocap_warp.formats.datasets import dataset_scene
from mmocap_warp.formats.datasets.dataset_scene import REMEDY, CameraFiles, DatasetScene, read_numbers
from mmocap_warp.formats.motion.captured_points import read_c3d
from mmocap_warp.result.truth import Truth
from mmocap_warp.whole_file import file_name

_PARTS = {"SHO": "Shoulder"} | {part.upper(): part for part in ("Elbow", "Wrist", "Hip", "Knee", "Ankle")}
_JOINTS = {f"{side}_{part}": side[0] + _PARTS[part] for side in ("LEFT", "RIGHT") for part in _PARTS}
_COUNT = 2 + 9 + 16 + 5
_MAX_SHEAR = 1e-3  # by which L may differ from a scaled turn
_RATE_TOLERANCE = 0.005


def read_biocv(root: Path, trial: str) -> DatasetScene:
    """Read a trial, such as ``P03_WALK_01``. Archives unpack to ``P03`` or to ``P03/P03``, and both are known."""
    person = file_name(trial, "TRIAL").partition("_")[0]
    known = [root / person / trial, root / person / person / trial, root / trial]
    folder = next((place for place in known if place.is_dir()), known[0])
    videos = dataset_scene.find_files(folder, "[0-9][0-9].mp4", "the trial's videos")
    places = [root / "calibrationUpdate" / person, folder.parent]
    calibrations = next((place for place in places if place.is_dir() and any(place.glob("*.calib"))), folder.parent)
    files = [dataset_scene.find_files(calibrations, f"{video.name}*.calib", "its calibration")[0] for video in videos]
    cameras = [_read_camera(file, video.stem) for file, video in zip(files, videos, strict=True)]
    _, fps, frames = dataset_scene.open_videos(videos)
    path = folder / "markers.c3d"
    truth, notes = None, [f"no truth: there is no {path.name} in {folder}"]
    if path.is_file():
        tracks, notes = read_c3d(path), []
        if abs(tracks.rate / fps - 1) > _RATE_TOLERANCE:
            problem = f"has {tracks.rate:g} frames a second and the videos {fps:g}"
            raise InputError(path, problem, "take both of the same trial")
        count = min(frames, len(tracks.positions))
        is_joint = np.array([name in _JOINTS for name in tracks.names])
        joints = tuple(_JOINTS[name] for name in tracks.names if name in _JOINTS)
        markers = tuple(name for name in tracks.names if name not in _JOINTS)
        points = tracks.positions[:count]
        truth = Truth(fps, np.arange(count), markers, points[:, ~is_joint], joints, points[:, is_joint])
    rig = rig_of(cameras, "+z", calibrations)
    about = (f"BioCV, {trial}, written by mmocap dataset.",)
    return DatasetScene(about, trial, rig, fps, frames, tuple(map(CameraFiles, videos)), truth, tuple(notes))


def _read_camera(path: Path, name: str) -> Camera:
    numbers = dataset_scene.finite(read_numbers(path), (-1,), str(path), "it")
    if len(numbers) != _COUNT:
        raise InputError(path, f"holds {len(numbers)} numbers, not {_COUNT}: size, K, L, k0 to k4", REMEDY)
    (width, height), K, L, distortion = np.split(numbers, np.cumsum([2, 9, 16]))
    scaled_turn, t = L.reshape(4, 4)[:3, :3], L.reshape(4, 4)[:3, 3]
    u, stretch, vt = np.linalg.svd(scaled_turn)
    scale = float(stretch.mean())
    if not 0.5 < scale < 2 or np.ptp(stretch) > _MAX_SHEAR * scale:
        raise InputError(path, f"L stretches lengths by {stretch.min():.4g} to {stretch.max():.4g}", REMEDY)
    size, place = (int(width), int(height)), t / scale * dataset_scene.MILLIMETRE
    return Camera(name, K.reshape(3, 3), u @ vt, place, size, distortion)
