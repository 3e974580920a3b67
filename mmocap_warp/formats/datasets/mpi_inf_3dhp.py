"""MPI-INF-3DHP's training set: 14 cameras before a green screen, its masks, and joints of markerless motion capture.

Sources: the data set's README and mpii_get_joint_set.m; mpii_create_muco_3dhp_composites.m, which says what the masks
mean; SPIN's and PosePile's readers. They say that ``S1/Seq1`` holds

- ``camera.calibration``, text: of each camera lines such as ``name 0``, ``size 2048 2048``, ``intrinsic`` and
  ``extrinsic`` (4x4 by rows; world to camera, millimetres), ``radial 0`` for no distortion; the world's y is up;
- ``imageSequence/video_0.avi`` and ``FGmasks/video_0.avi``: 25 or 50 frames a second. A mask's red channel is white
  where the green screen is not seen; green and blue are masks of clothes, white outside them;
- ``annot.mat``: ``annot3``, a cell for each camera with 28 joints a row [mm] in that camera's axes, and ``frames``.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from mmocap_warp.cameras.rig import Camera, CameraRig, rig_of
from mmocap_warp.errors import InputError
from mmocap_warp.formats.calibration.calibration_text import read_short_text
from mmocap_warp.formats.datasets import dataset_scene
from mmocap_warp.formats.datasets.dataset_scene import REMEDY, CameraFiles, DatasetScene
from mmocap_warp.result.truth import Truth
from mmocap_warp.whole_file import file_name

_SIDE = ("Clavicle", "Shoulder", "Elbow", "Wrist", "Hand")
_LEG = ("Hip", "Knee", "Ankle", "Foot", "Toe")
_JOINTS = (
    *("Spine3", "Spine4", "Spine2", "Spine", "Root", "Neck", "Head", "HeadTop"),
    *(side + part for side in "LR" for part in _SIDE),
    *(side + part for side in "LR" for part in _LEG),
)
_MASKS = """
# The masks show all that is not the green screen: chairs too, in the sequences that have one.
[foreground]
source = "masks"
"""


def read_3dhp(root: Path, subject: str, sequence: str) -> DatasetScene:
    """Read a sequence such as ``S1`` ``Seq1``, by the cameras whose videos are there."""
    folder = root / file_name(subject, "SUBJECT") / file_name(sequence, "SEQUENCE")
    found = dataset_scene.find_files(folder / "imageSequence", "video_*.avi", "the videos")
    videos = {video.stem: video for video in found}
    rig = _read_rig(folder / "camera.calibration", videos)
    _, fps, frames = dataset_scene.open_videos([videos[name] for name in rig.names])
    masks = [folder / "FGmasks" / videos[name].name for name in rig.names]
    files, notes, masked = [CameraFiles(videos[name]) for name in rig.names], [], all(map(Path.is_file, masks))
    if masked:
        files = [replace(file, masks=mask, mask_channel="red") for file, mask in zip(files, masks, strict=True)]
    else:
        notes.append(f"masks of some cameras are missing in {folder / 'FGmasks'}, so that they must be made")
    truth, annotations = None, folder / "annot.mat"
    if annotations.is_file():
        truth = _read_truth(annotations, rig, fps, frames)
    else:
        notes.append(f"no truth: there is no {annotations.name} in {folder}")
    about = (f"MPI-INF-3DHP, {subject} {sequence}, written by mmocap dataset.",)
    name, foreground = f"{subject} {sequence}", _MASKS if masked else dataset_scene.FROM_RECORDING
    return DatasetScene(about, name, rig, fps, frames, tuple(files), truth, tuple(notes), foreground)


def _read_rig(path: Path, videos: dict[str, Path]) -> CameraRig:
    """The cameras of which there is a video, named as it is."""
    cameras: list[dict[str, list[str]]] = []
    for line in read_short_text(path, "a sequence's camera.calibration").splitlines()[1:]:
        key, *words = line.split() or [""]
        if key == "name":
            cameras.append({})
        if key and cameras:
            cameras[-1][key] = words
    by_name = {"video_" + "".join(values["name"]): values for values in cameras}
    read = [_read_camera(values, name, f"{path}: camera {name}") for name, values in by_name.items() if name in videos]
    if not read:
        raise InputError(path, f"has none of the cameras {', '.join(videos)}", REMEDY)
    return rig_of(read, "+y", path)


def _read_camera(values: dict[str, list[str]], name: str, where: str) -> Camera:
    def numbers(key: str, *shape: int) -> np.ndarray:
        return dataset_scene.finite(values.get(key), shape, where, key)

    if numbers("radial", -1).any():
        raise InputError(where, "has a radial distortion, whose formula is not published", "undistort the videos")
    (width, height), extrinsic = numbers("size", 2).astype(int).tolist(), numbers("extrinsic", 4, 4)
    K, t = numbers("intrinsic", 4, 4)[:3, :3], extrinsic[:3, 3] * dataset_scene.MILLIMETRE
    return Camera(name, K, extrinsic[:3, :3], t, (width, height), np.zeros(5))


def _read_truth(path: Path, rig: CameraRig, fps: float, frames: int) -> Truth:
    """The joints as the first camera has them, in the world; others have the same within a few millimetres."""
    cells = dataset_scene.read_mat(path).get("annot3")
    number = rig.names[0].rpartition("_")[2]
    if not (number.isdecimal() and isinstance(cells, (list, np.ndarray)) and int(number) < len(cells)):
        raise InputError(path, f"has no annot3 of camera {number}", REMEDY)
    joints = dataset_scene.finite(cells[int(number)], (-1, len(_JOINTS), 3), str(path), f"annot3[{number}]")[:frames]
    world = (joints * dataset_scene.MILLIMETRE - rig.t[0]) @ rig.R[0]
    return Truth(fps, np.arange(len(world)), (), np.zeros((len(world), 0, 3)), _JOINTS, world)
