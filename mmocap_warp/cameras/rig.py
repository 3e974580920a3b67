"""Calibrated pinhole cameras in OpenCV's convention."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple, Self

import numpy as np

from mmocap_warp.cameras.fisheye import distort_fisheye, folds_over, pinhole_of
from mmocap_warp.errors import InputError
from mmocap_warp.whole_file import file_name

UP_AXES: tuple[str, ...] = ("+x", "-x", "+y", "-y", "+z", "-z")
METRES = {"m": 1.0, "mm": 0.001, "cm": 0.01, "in": 0.0254, "ft": 0.3048}
"""Metres per unit of length."""

_USUAL_REACH = (1.0, 30.0)  # metres between cameras, or from the origin, in a room
_MAX_NUMBER = 1e9  # in a calibration; its square and cube are still finite
_MAX_CAMERAS = 1000
_MAX_SKEW = 0.005  # share of the focal length; MATLAB's calibrations have up to 0.0035
_MAX_GROWTH = 4  # by which undistortion may enlarge or shrink a fisheye's image; real ones grow up to 1.7


@dataclass(frozen=True)
class CameraRig:
    """Static calibrated cameras: ``x_cam = R @ X + t``, x right, y down, z forward, pixel centres at integers."""

    names: tuple[str, ...]  #: one per camera
    K: np.ndarray  #: (camera, 3, 3) float64, intrinsics [px]; their skew is undone with the lens
    R: np.ndarray  #: (camera, 3, 3) float64, rotation, world to camera
    t: np.ndarray  #: (camera, 3) float64, translation, world to camera [m]
    size: np.ndarray  #: (camera, 2) int, width and height [px]
    #: (camera, 5) float64, OpenCV's k1 k2 p1 p2 k3, of a fisheye k1 k2 k3 k4 0; zero once images are undistorted
    distortion: np.ndarray
    up: str = "+z"  #: the world's up axis: ``+x``, ``-x``, ``+y``, ``-y``, ``+z`` or ``-z``
    fisheye: tuple[str, ...] = ()  #: cameras whose lens is a fisheye (:mod:`mmocap_warp.cameras.fisheye`)

    def __len__(self) -> int:
        return len(self.names)

    def __repr__(self) -> str:
        rows = [
            f"{name}  {width}x{height} px  focal {K[0, 0]:.0f} px  at ({x:.2f}, {y:.2f}, {z:.2f}) m"
            for name, (width, height), K, (x, y, z) in zip(self.names, self.size, self.K, self.centres, strict=True)
        ]
        return "\n".join([f"CameraRig: {len(self)} cameras, {self.up} up", *rows])

    @property
    def centres(self) -> np.ndarray:
        """(camera, 3), optical centres in the world [m]."""
        return -np.einsum("kji,kj->ki", self.R, self.t)

    @property
    def placed(self) -> bool:
        """Whether it is known where the cameras stand; all are at the world's origin where it is not."""
        return bool(self.t.any())

    @property
    def up_vector(self) -> np.ndarray:
        """(3,), unit vector of the world's up axis."""
        vector = np.zeros(3)
        vector["xyz".index(self.up[1])] = -1.0 if self.up[0] == "-" else 1.0
        return vector

    def pinhole(self, k: int) -> tuple[np.ndarray, np.ndarray]:
        """Intrinsics and (width, height) [px] of what camera ``k``'s images are undistorted to, at full size.

        They are the camera's own without its skew, except for a fisheye: see
        :func:`mmocap_warp.cameras.fisheye.pinhole_of`.
        """
        K = self.K[k].copy()
        K[0, 1] = 0.0
        if self.names[k] in self.fisheye:
            return pinhole_of(K, self.size[k], self.distortion[k])
        return K, self.size[k]

    def undistorted(self, scale: float = 1.0) -> Self:
        """The pinholes of undistorted images resampled to ``scale`` times the size.

        A pixel centre keeps its place in the image plane, so a principal point moves as ``(c + 0.5) * scale - 0.5``.

        Raises:
            ValueError: a scale that is not positive, or that leaves an image without pixels.
        """
        K, full = (np.stack(arrays) for arrays in zip(*map(self.pinhole, range(len(self))), strict=True))
        size = np.rint(full * scale).astype(int)
        if not scale > 0 or size.min() < 1:
            raise ValueError(f"scale must be positive and leave at least a pixel, got {scale}")
        K[:, :2, :2] *= scale
        K[:, :2, 2] = (K[:, :2, 2] + 0.5) * scale - 0.5
        return replace(self, K=K, size=size, distortion=np.zeros_like(self.distortion), fisheye=())

    def in_unit(self, unit: float) -> Self:
        """The cameras of a world whose lengths are in a unit [m]."""
        return replace(self, t=self.t / unit)

    def select(self, names: tuple[str, ...]) -> Self:
        """The named cameras, in the given order.

        Raises:
            ValueError: a name that the rig does not have.
        """
        k = [self.names.index(name) for name in names]
        fisheye = tuple(name for name in names if name in self.fisheye)
        return type(self)(names, self.K[k], self.R[k], self.t[k], self.size[k], self.distortion[k], self.up, fisheye)


def distort(points: np.ndarray, distortion: np.ndarray) -> np.ndarray:
    """Where the lens puts a point of the ideal image plane, both at focal length 1.

    Points are (..., 2), the distortion is (5,), OpenCV's k1 k2 p1 p2 k3.
    """
    if not distortion.any():
        return points
    k1, k2, p1, p2, k3 = distortion
    x, y = points[..., 0], points[..., 1]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    across = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    down = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return np.stack([across, down], axis=-1)


def through_lens(rig: CameraRig, k: int, points: np.ndarray) -> np.ndarray:
    """Where camera ``k``'s lens puts points (..., 2) of the ideal image plane, both at focal length 1."""
    lens = distort_fisheye if rig.names[k] in rig.fisheye else distort
    return lens(points, rig.distortion[k])


def to_pixels(rig: CameraRig, k: int, points: np.ndarray) -> np.ndarray:
    """Pixels of camera ``k`` of points (..., 2) that its lens put on the image plane at focal length 1."""
    pixels = points * rig.K[k, [0, 1], [0, 1]] + rig.K[k, :2, 2]
    if rig.K[k, 0, 1]:
        pixels[..., 0] += rig.K[k, 0, 1] * points[..., 1]
    return pixels


def project(rig: CameraRig, points: np.ndarray) -> np.ndarray:
    """Pixels of world points (n, 3) [m] in every camera, distortion included.

    Returns:
        (camera, n, 2) float64 [px]; NaN where a point does not lie in front of the camera.
    """
    seen = np.einsum("kij,nj->kni", rig.R, np.asarray(points, np.float64)) + rig.t[:, None]
    plane = seen[..., :2] / np.where(seen[..., 2:] > 0, seen[..., 2:], np.nan)
    return np.stack([to_pixels(rig, k, through_lens(rig, k, plane[k])) for k in range(len(rig))])


@dataclass(frozen=True)
class CameraSummary:
    """What a person can check against the room."""

    name: str  # the camera
    centre: np.ndarray  # (3,) optical centre [m]
    height: float  # of the centre above the world's zero along the up axis [m]
    nearest: float  # distance to the nearest other camera [m]; infinite for a lone camera
    field_of_view: tuple[float, float]  # horizontal and vertical [degrees]; of a fisheye that of its pinhole


def describe_rig(rig: CameraRig) -> list[CameraSummary]:
    """One row per camera: centre, height, distance to the nearest other camera, field of view."""
    centres = rig.centres
    distance = np.linalg.norm(centres[:, None] - centres[None], axis=-1)
    np.fill_diagonal(distance, np.inf)
    K, size = (np.stack(arrays) for arrays in zip(*map(rig.pinhole, range(len(rig))), strict=True))
    angle = np.degrees(2 * np.arctan(size / (2 * K[:, [0, 1], [0, 1]])))
    height = [float(centre @ rig.up_vector) for centre in centres]
    rows = zip(rig.names, centres, height, distance.min(axis=1).tolist(), map(tuple, angle.tolist()), strict=True)
    return [CameraSummary(*row) for row in rows]


def draw_world_axes(image: np.ndarray, rig: CameraRig, k: int) -> np.ndarray:
    """A copy of camera ``k``'s BGR image with the world's x, y, z axes in red, green, blue.

    Axes are drawn from the world's origin, half a metre long, in pieces, so that one that leaves the view or passes
    behind the camera is drawn as far as it is seen.
    """
    import cv2

    canvas = image.copy()
    for axis, colour in zip("xyz", ((0, 0, 255), (0, 200, 0), (255, 64, 0)), strict=True):
        line = np.linspace(0, 0.5, 33)[:, None] * np.eye(3)["xyz".index(axis)]
        pixels = project(rig.select((rig.names[k],)), line)[0]
        drawable = np.isfinite(pixels).all(-1) & (np.abs(pixels).max(-1) < 1e6)
        ends = np.round(pixels[drawable]).astype(int)
        for start, end in pairwise(ends):
            cv2.line(canvas, tuple(map(int, start)), tuple(map(int, end)), colour, 2, cv2.LINE_AA)
        if len(ends):
            cv2.putText(canvas, axis, tuple(map(int, ends[-1])), cv2.FONT_HERSHEY_SIMPLEX, 0.6, colour, 2)
    return canvas


class Camera(NamedTuple):
    """One camera as a file describes it; shapes and units as in :class:`CameraRig`."""

    name: str
    K: np.ndarray
    R: np.ndarray
    t: np.ndarray
    size: tuple[int, int]
    distortion: np.ndarray
    fisheye: bool = False


def lens_of(
    name: str, K: np.ndarray, size: tuple[int, int], coefficients: Sequence[float] | np.ndarray, fisheye: bool = False
) -> Camera:
    """A camera without a place; its 4 or 5 ``coefficients`` are OpenCV's, as in :class:`CameraRig`."""
    distortion = np.zeros(5)
    distortion[: len(coefficients)] = coefficients
    return Camera(name, K, np.eye(3), np.zeros(3), size, distortion, fisheye)


def rig_of(cameras: list[Camera], up: str, source: object, placed: bool = True) -> CameraRig:
    """The rig of these cameras, checked; see :func:`check_rig`."""
    if not cameras:
        raise InputError(source, "no camera found", "check that this is a calibration file")
    if len(cameras) > _MAX_CAMERAS:
        raise InputError(source, f"holds {len(cameras)} cameras", f"give at most {_MAX_CAMERAS}")
    names, *columns, bends = zip(*cameras, strict=True)
    K, R, t, size, distortion = map(np.array, columns)
    fisheye = tuple(name for name, bend in zip(names, bends, strict=True) if bend)
    return check_rig(CameraRig(names, K, R, t, size, distortion, up, fisheye), source, placed)


def check_rig(rig: CameraRig, source: object, placed: bool = True) -> CameraRig:
    """Return ``rig`` if it can be a real calibration in metres; ``source`` is named in errors.

    If it is not ``placed``, the cameras are lenses that are all at the origin.

    Raises:
        InputError: a name twice or one that no file can have, values that are not finite, a matrix that is no rotation
            (mirrored ones are named), focal lengths that are not pixels, or positions that are not metres.
    """
    repeated = sorted({name for name in rig.names if rig.names.count(name) > 1})
    if repeated:
        raise InputError(source, f"camera name '{repeated[0]}' is used twice", "give every camera its own name")
    for k, name in enumerate(rig.names):
        file_name(name, f"{source}: camera")
        _check_camera(rig, k, f"{source}: camera '{name}'")
    if placed:
        _check_metres(rig, source)
    return rig


def _check_camera(rig: CameraRig, k: int, where: str) -> None:
    for what in ("K", "R", "t", "distortion"):
        value = getattr(rig, what)[k]
        if not np.isfinite(value).all():
            raise InputError(where, f"{what} holds a value that is not finite", "calibrate again or export again")
        if np.abs(value).max() > _MAX_NUMBER:
            raise InputError(where, f"{what} holds {np.abs(value).max():.3g}", "calibrate again or export again")
    K, (width, height) = rig.K[k], rig.size[k]
    if width < 1 or height < 1:
        raise InputError(where, f"size is {width}x{height}", "give the width and height in pixels")
    (fx, fy), (cx, cy) = K[[0, 1], [0, 1]], K[:2, 2]
    if not (0.2 < fx / max(width, height) < 50 and 0.2 < fy / max(width, height) < 50):
        problem = f"focal lengths {fx:.6g}, {fy:.6g} do not suit a {width}x{height} image"
        raise InputError(where, problem, "give them in pixels")
    if abs(K[0, 1]) > _MAX_SKEW * fx:
        raise InputError(where, f"skew is {K[0, 1]:.6g} px", "calibrate with zero skew")
    if not (-0.5 * width < cx < 1.5 * width and -0.5 * height < cy < 1.5 * height):
        problem = f"principal point ({cx:.6g}, {cy:.6g}) is far outside {width}x{height}"
        raise InputError(where, problem, "give it in pixels")
    if (K[[1, 2, 2, 2], [0, 0, 1, 2]] != [0, 0, 0, 1]).any():
        raise InputError(where, "K is not [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]", "give the intrinsics in that order")
    if rig.names[k] in rig.fisheye:
        remedy = "see that these are k1 k2 k3 k4 of OpenCV's fisheye model"
        if folds_over(K, rig.size[k], rig.distortion[k]):
            raise InputError(where, "the fisheye distortion folds the image over itself", remedy)
        _, size = rig.pinhole(k)
        if (size > _MAX_GROWTH * rig.size[k]).any() or (size * _MAX_GROWTH < rig.size[k]).any():
            raise InputError(where, f"undistorted, this fisheye's image has {size[0]}x{size[1]} pixels", remedy)
    error = np.abs(rig.R[k] @ rig.R[k].T - np.eye(3)).max()
    if error > 1e-4:
        raise InputError(where, f"R is not orthonormal (off by {error:.2g})", "give a 3x3 rotation, world to camera")
    if np.linalg.det(rig.R[k]) < 0:
        raise InputError(where, "R is mirrored (determinant -1)", "use a right-handed world and camera frame")


def _check_metres(rig: CameraRig, source: object) -> None:
    centres = rig.centres
    span = float(np.linalg.norm(centres[:, None] - centres[None], axis=-1).max())
    reach = float(np.abs(centres).max())
    if max(span, reach) > 200:
        problem = f"cameras lie up to {max(span, reach):.6g} m from each other or from the origin"
        units = [unit for unit in METRES if _USUAL_REACH[0] < METRES[unit] * max(span, reach) < _USUAL_REACH[1]]
        likely = " or ".join(f'units = "{unit}"' for unit in units or ["mm"])
        raise InputError(source, problem, f"if the file is not in metres, set [cameras] {likely} in the scene")
    if len(rig) > 1 and span < 0.05:
        remedy = f"check the translations, and [cameras] units ({', '.join(METRES)})"
        raise InputError(source, f"all cameras lie within {1000 * span:.3g} mm of each other", remedy)
