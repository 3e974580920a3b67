"""CMU Panoptic Studio: its 31 HD cameras, and the 19 joints of one of its people.

Sources: README.md, scripts/ and python/panutils.py of github.com/CMU-Perceptual-Computing-Lab/panoptic-toolbox. They
say that a sequence's folder holds

- ``calibration_NAME.json``: of each camera its type (``hd``, ``vga``, ``kinect``), name (``00_07``), resolution, K,
  distCoef (OpenCV's k1 k2 p1 p2 k3), and R and t from the world to the camera, in centimetres; the world's y is down;
- ``hdVideos/hd_00_07.mp4``: 29.97 frames a second, in step;
- ``hdPose3d_stage1_coco19/body3DScene_00000123.json``, by HD frames from 0: of each body an id and ``joints19``, four
  numbers a joint: x, y, z [cm] and a confidence, of which the toolbox trusts what is over 0.1.
"""

from pathlib import Path
from typing import Any

import numpy as np

from mmocap_warp.cameras.rig import Camera, CameraRig, rig_of
from mmocap_warp.errors import InputError
from mmocap_warp.formats.datasets import dataset_scene
from mmocap_warp.formats.datasets.dataset_scene import REMEDY, CameraFiles, DatasetScene
from mmocap_warp.result.truth import Truth
from mmocap_warp.whole_file import file_name, read_json

_CENTIMETRE = 0.01
_JOINTS = (
    *("Neck", "Nose", "Root", "LShoulder", "LElbow", "LWrist", "LHip", "LKnee", "LAnkle"),
    *("RShoulder", "RElbow", "RWrist", "RHip", "RKnee", "RAnkle", "LEye", "LEar", "REye", "REar"),
)
_MIN_CONFIDENCE = 0.1
_MAX_CALIBRATION, _MAX_POSES = 1 << 24, 1 << 20  # bytes of a file


def read_panoptic(root: Path, person: str = "") -> DatasetScene:
    """Read the sequence in the folder ``root``, with the joints of the ``person`` of that id.

    Without an id it is the person who is seen in most frames.
    """
    calibration = dataset_scene.find_files(root, "calibration_*.json", "the sequence's calibration")[0]
    videos = dataset_scene.find_files(root / "hdVideos", "hd_*.mp4", "the HD videos")
    rig, used = _read_rig(calibration, {video.stem.removeprefix("hd_"): video for video in videos})
    _, fps, frames = dataset_scene.open_videos(used)
    poses = root / "hdPose3d_stage1_coco19"
    truth, notes = None, [f"no truth: there is no folder {poses.name}; unpack {poses.name}.tar in {root}"]
    if poses.is_dir():
        truth, notes = _read_truth(poses, person, fps, frames)
    about = (f"CMU Panoptic, {root.resolve().name}, written by mmocap dataset.",)
    files = tuple(map(CameraFiles, used))
    return DatasetScene(about, root.resolve().name, rig, fps, frames, files, truth, tuple(notes))


def _read_rig(path: Path, videos: dict[str, Path]) -> tuple[CameraRig, list[Path]]:
    """The HD cameras that have a video, and these videos."""
    content = read_json(path, REMEDY, _MAX_CALIBRATION).get("cameras")
    cameras: list[Camera] = []
    for number, values in enumerate(content if isinstance(content, list) else []):
        where = f"{path}: cameras[{number}]"
        if not isinstance(values, dict):
            raise InputError(where, "is not a JSON object", REMEDY)
        name = values.get("name")
        if values.get("type") != "hd" or name not in videos:
            continue
        cameras.append(_read_camera(values, file_name(str(name), where), where))
    if not cameras:
        problem = f"has no camera of type hd of which there is a video ({', '.join(videos)})"
        raise InputError(path, problem, "take calibration and videos of the same sequence")
    return rig_of(cameras, "-y", path), [videos[camera.name] for camera in cameras]


def _read_camera(values: dict[str, Any], name: str, where: str) -> Camera:
    def numbers(key: str, *shape: int) -> np.ndarray:
        return dataset_scene.finite(values.get(key), shape, where, key)

    width, height = numbers("resolution", 2).astype(int).tolist()
    t = numbers("t", 3) * _CENTIMETRE
    return Camera(name, numbers("K", 3, 3), numbers("R", 3, 3), t, (width, height), numbers("distCoef", 5))


def _read_truth(folder: Path, person: str, fps: float, frames: int) -> tuple[Truth, list[str]]:
    """The joints of one person, and what there is to say about it."""
    bodies: dict[str, dict[int, np.ndarray]] = {}
    for file in dataset_scene.find_files(folder, "body3DScene_*.json", "a file of joints for each frame"):
        digits = file.stem.rpartition("_")[2]
        if not digits.isdecimal() or int(digits) >= frames:
            continue
        people = read_json(file, REMEDY, _MAX_POSES).get("bodies")
        for number, body in enumerate(people if isinstance(people, list) else []):
            where = f"{file}: bodies[{number}]"
            if not isinstance(body, dict):
                raise InputError(where, "is not a JSON object", REMEDY)
            joints = dataset_scene.finite(body.get("joints19"), (len(_JOINTS), 4), where, "joints19")
            bodies.setdefault(str(body.get("id")), {})[int(digits)] = joints
    if not bodies:
        raise InputError(folder, "shows nobody in the frames of the videos", REMEDY)
    seen = ", ".join(f"{name} in {len(poses)} frames" for name, poses in bodies.items())
    if person and person not in bodies:
        raise InputError(folder, f"has no person of id {person}", f"give one of these: {seen}")
    chosen = person or max(bodies, key=lambda name: len(bodies[name]))
    numbers = np.array(sorted(bodies[chosen]))
    values = np.stack([bodies[chosen][number] for number in numbers.tolist()])
    joints = np.where(values[..., 3:] > _MIN_CONFIDENCE, values[..., :3] * _CENTIMETRE, np.nan)
    notes = [f"the truth is person {chosen}; there are {seen}"] if len(bodies) > 1 else []
    return Truth(fps, numbers, (), np.zeros((len(numbers), 0, 3)), _JOINTS, joints), notes
