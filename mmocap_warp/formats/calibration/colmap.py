"""COLMAP's sparse models as text: ``cameras.txt`` beside ``images.txt``, an image a camera.

COLMAP counts pixels from the image's corner, so that the middle of the first pixel is (0.5, 0.5); poses are world to
camera, quaternions with their real part first. A model has no unit of length until somebody gives it one.
"""

from collections import Counter
from pathlib import Path, PurePosixPath

import numpy as np

from mmocap_warp.cameras.rig import Camera, CameraRig, lens_of, rig_of
from mmocap_warp.errors import InputError
from mmocap_warp.formats.calibration.calibration_text import Sizes, numbers_of, read_short_text, stated_metres
from mmocap_warp.whole_file import write_whole

_MAX_BYTES = 2**26  # images.txt lists the points that each image shows, too
_KIND = "the folder of a COLMAP model that was exported as text, with cameras.txt and images.txt"
_REMEDY = "export the model as text again (colmap model_converter --output_type TXT)"
_CORNER = 0.5  # the middle of the first pixel

_MODELS = {  # where a model's parameters belong among fx fy cx cy k1 k2 p1 p2 k3, by name; f is both fx and fy
    "SIMPLE_PINHOLE": "f cx cy",
    "PINHOLE": "fx fy cx cy",
    "SIMPLE_RADIAL": "f cx cy k1",
    "RADIAL": "f cx cy k1 k2",
    "OPENCV": "fx fy cx cy k1 k2 p1 p2",
    "OPENCV_FISHEYE": "fx fy cx cy k1 k2 k3 k4",
    "FULL_OPENCV": "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6",
}


def read_colmap(path: str | Path, units: str | None = None, up: str = "+z", sizes: Sizes = None) -> CameraRig:
    """Read a model from its folder, or from the path of either file. ``sizes`` is not needed.

    A camera is named as its image: by the image's folder where every image has a folder of its own, else by the file's
    name without ending.
    """
    folder = Path(path) if Path(path).is_dir() else Path(path).parent
    lenses = _read_lenses(folder / "cameras.txt")
    file = folder / "images.txt"
    poses = _read_poses(file)
    names, metres = _camera_names(list(poses), file), stated_metres(units, file)
    cameras = []
    for (image, (lens, R, t)), name in zip(poses.items(), names, strict=True):
        if lens not in lenses:
            raise InputError(file, f"image '{image}' is of camera {lens}, which cameras.txt does not have", _REMEDY)
        cameras.append(lenses[lens]._replace(name=name, R=R, t=t * metres))
    return rig_of(cameras, up, file)


def _read_lenses(path: Path) -> dict[str, Camera]:
    """Cameras without a place, by their number."""
    lenses = {}
    for line in _lines(path):
        number, model, width, height, *parameters = [*line.split(), "", "", ""][: max(4, len(line.split()))]
        where = f"{path}: camera {number}"
        if model not in _MODELS:
            raise InputError(where, f"lens model '{model}' is not known", f"known are {', '.join(_MODELS)}")
        names, values = _MODELS[model].split(), numbers_of(parameters, where, _REMEDY)
        if len(values) != len(names):
            raise InputError(where, f"{model} has {len(values)} parameters, not {len(names)}", _REMEDY)
        across, down = map(int, numbers_of([width, height], where, _REMEDY))
        value, fisheye = dict(zip(names, values, strict=True)), model == "OPENCV_FISHEYE"
        if model == "FULL_OPENCV" and any(value[key] for key in ("k4", "k5", "k6")):
            raise InputError(where, "k4 to k6 of FULL_OPENCV are not zero", "use OPENCV or OPENCV_FISHEYE in COLMAP")
        fx, fy = (value.get(key, value.get("f", 0.0)) for key in ("fx", "fy"))
        K = np.array([[fx, 0.0, value["cx"] - _CORNER], [0.0, fy, value["cy"] - _CORNER], [0.0, 0.0, 1.0]])
        keys = ("k1", "k2", "k3", "k4") if fisheye else ("k1", "k2", "p1", "p2", "k3")
        lenses[number] = lens_of("", K, (across, down), [value.get(key, 0.0) for key in keys], fisheye)
    return lenses


def _read_poses(path: Path) -> dict[str, tuple[str, np.ndarray, np.ndarray]]:
    """By image: its camera's number, rotation and translation."""
    from scipy.spatial.transform import Rotation

    poses = {}
    lines = iter(_lines(path, points=True))
    for line in lines:
        next(lines, None)  # the points that the image shows; the line may be empty
        fields = line.split(maxsplit=9)
        where = f"{path}: image {fields[0]}"
        if len(fields) != 10:
            raise InputError(where, f"the line has {len(fields)} values, not 10", _REMEDY)
        pose = np.array(numbers_of(fields[1:8], where, _REMEDY))
        with np.errstate(over="ignore"):
            length = np.linalg.norm(pose[:4])
        if not 0.999 < length < 1.001:
            raise InputError(where, f"the quaternion has length {length:.6g}, not 1", _REMEDY)
        image = fields[9].strip()
        if image in poses:
            raise InputError(where, f"'{image}' is there twice", _REMEDY)
        poses[image] = (fields[8], Rotation.from_quat(np.roll(pose[:4], -1)).as_matrix(), pose[4:])
    return poses


def _lines(path: Path, points: bool = False) -> list[str]:
    """Lines that are no comment. Of images, every second one lists points, and may be empty."""
    kept: list[str] = []
    for line in read_short_text(path, _KIND, _MAX_BYTES).splitlines():
        if (points and len(kept) % 2 == 1) or (line.strip() and not line.lstrip().startswith("#")):
            kept.append(line)
    return kept


def _camera_names(images: list[str], source: Path) -> list[str]:
    """A name for the camera of each image."""
    paths = [PurePosixPath(image) for image in images]
    folders = [path.parent.as_posix() for path in paths]
    if "." not in folders and len(set(folders)) == len(folders):
        short = [path.parent.name for path in paths]  # of rig1/cam1 the camera's own folder
        return short if len(set(short)) == len(short) else folders
    names = [path.stem for path in paths]
    (name, count), *_ = Counter(names).most_common(1) or [("", 0)]
    if count > 1:
        raise InputError(source, f"{count} images are named '{name}'", "keep one image of each camera in the model")
    return names


def write_colmap(path: str | Path, rig: CameraRig) -> None:
    """Write ``cameras.txt`` at ``path``, with ``images.txt`` and an empty ``points3D.txt`` beside it, in metres.

    Raises:
        InputError: a camera's name that cannot be a file's, or files that cannot be written.
    """
    from scipy.spatial.transform import Rotation

    cameras, images = [], []
    for k, name in enumerate(rig.names):
        if set(name) & set(" \t\r\n/\\") or not name:
            raise InputError(path, f"COLMAP allows no camera name '{name}'", "name it without blanks and slashes")
        model, parameters = _parameters(rig, k)
        width, height = rig.size[k]
        cameras.append(f"{k + 1} {model} {width} {height} {_words(parameters)}\n")
        pose = [*np.roll(Rotation.from_matrix(rig.R[k]).as_quat(), 1), *rig.t[k]]  # SciPy has the real part last
        images.append(f"{k + 1} {_words(pose)} {k + 1} {name}.png\n\n")
    place = Path(path)
    write_whole(place.with_name("points3D.txt"), b"# no points\n")
    write_whole(place.with_name("images.txt"), "".join(["# an image a camera, without points\n", *images]).encode())
    write_whole(place, "".join(["# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n", *cameras]).encode())


def _parameters(rig: CameraRig, k: int) -> tuple[str, list[float]]:
    """The simplest model that holds a camera's lens, and its parameters."""
    lens = [*rig.K[k, [0, 1], [0, 1]], *(rig.K[k, :2, 2] + _CORNER)]
    k1, k2, p1, p2, k3 = distortion = rig.distortion[k].tolist()
    if rig.names[k] in rig.fisheye:
        return "OPENCV_FISHEYE", [*lens, *distortion[:4]]
    if not any(distortion):
        return "PINHOLE", lens
    return ("FULL_OPENCV", [*lens, k1, k2, p1, p2, k3, 0, 0, 0]) if k3 else ("OPENCV", [*lens, k1, k2, p1, p2])


def _words(values: list[float]) -> str:
    return " ".join(repr(float(value)) for value in values)
