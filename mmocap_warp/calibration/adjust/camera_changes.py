"""The parameters by which cameras may differ from their calibration, so that they can be solved for, and the settings.

A camera that turns by a small rotation a about its centre C, or moves by d, sees what it would see if the body moved
the opposite way. With a point x, its gradient g in an image, and the root joint's origin o,

    - a . ((x - C) x g)  =  - a . ((x - o) x g)  -  g . (a x (o - C))        and        - d . g

are combinations of what the root's three angles and its translation do. So the cameras' columns of the Jacobian follow
from the body's, and need no kernels.
"""

from dataclasses import dataclass, replace

import numpy as np

from mmocap_warp.body.model import Subject
from mmocap_warp.body.rotations import transposed
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.formats.toml_table import check_kinds, describes_settings, setting

KINDS: tuple[str, ...] = (
    "tilt", "pan", "roll", "right", "down", "ahead", "focal", "centre_x", "centre_y", "radial", "offset",
)  # fmt: skip
"""Parameters of a camera: rotations about its own x, y and z axis [rad], shifts along them [m], the logarithm of its
focal lengths, its principal point [px], its radial distortion k1, and its delay beyond the stated one [s]."""
ROTATION, POSITION, LENS = slice(0, 3), slice(3, 6), slice(6, 10)
FOCAL, CENTRE, RADIAL, OFFSET = 6, slice(7, 9), 9, 10
RESPECT = np.repeat(np.arange(6), (3, 3, 1, 2, 1, 1))
"""(parameter,) the same number for parameters that belong together: rotation, position, focal length, principal point,
distortion, time."""


def groups_of(cameras: int) -> np.ndarray:
    """(camera, parameter) the same number for parameters of a camera that belong together."""
    return RESPECT + (RESPECT.max() + 1) * np.arange(cameras)[:, None]


@describes_settings
@dataclass(frozen=True)
class Deviations:
    """How far a camera may be from its calibration, as standard deviations; 0 holds a parameter."""

    rotation: float = setting(5.0, "Deviation of a camera's rotation about each of its axes, in degrees; 0 holds it.")
    position: float = setting(0.2, "Deviation of its position along each of its axes, in metres; 0 holds it.")
    focal: float = setting(0.02, "Deviation of its focal length, as a share of it; 0 holds it.")
    centre: float = setting(0.01, "Deviation of its principal point as a share of the image's larger side; 0 holds it.")
    offset: float = setting(0.05, "Deviation of its time offset, in seconds; 0 holds it.")

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not 0.0 <= value < np.inf:
                raise ValueError(f"{name} must be finite and not negative, got {value}")

    def of(self, rig: CameraRig) -> np.ndarray:
        """(camera, parameter) these deviations in the parameters' units, for a rig's images; distortion is held."""
        sigma = np.zeros((len(rig), len(KINDS)))
        sigma[:, ROTATION], sigma[:, POSITION] = np.radians(self.rotation), self.position
        sigma[:, FOCAL], sigma[:, CENTRE] = self.focal, self.centre * rig.size.max(axis=1)[:, None]
        sigma[:, OFFSET] = self.offset
        return sigma


@describes_settings
@dataclass(frozen=True)
class AdjustConfig:
    """Settings of an adjustment of cameras."""

    deviations: Deviations = setting(
        Deviations(), "How far cameras may be from their calibration.", "those of Deviations", flag=False
    )
    fixed: str | None = setting(
        None, "The camera that stands still.", "the one relative to which others move least", flag=False
    )
    height: float | None = setting(None, "How tall the person is, where that is known [m].", flag=False)
    distance: tuple[str, str, float] | None = setting(
        None, "Two cameras and the metres between their centres, where they are known.", flag=False
    )
    frames: int = setting(20, "How many frames the cameras are solved from.", flag=False)
    judges: int = setting(10, "How many further frames judge the cameras.", flag=False)
    scale: float | None = setting(None, "What scales the views, up to 1.", "images 640 pixels long")
    seed: int = setting(0, "Where random numbers begin.")
    device: str = setting("auto", "auto, cpu or a CUDA device such as cuda:0.")
    threads: int | None = setting(None, "How many CPU threads work.", "all that this process may use")
    subject: Subject | None = setting(
        None, "The person in the pose of the first frame, where that is known.", "a body is fitted", flag=False
    )

    def __post_init__(self) -> None:
        check_kinds(self)
        for name, least in (("frames", 2), ("judges", 2), ("threads", 1)):
            if (value := getattr(self, name)) is not None and value < least:
                raise ValueError(f"{name} must be at least {least}, got {value}")
        if not 0 <= self.seed < 2**31:
            raise ValueError(f"seed must be in 0 .. 2^31 - 1, got {self.seed}")
        if self.scale is not None and not 0.0 < self.scale <= 1.0:
            raise ValueError(f"scale must be in (0, 1], got {self.scale}")
        for name, metres, most in (("height", self.height, 3), ("distance", self.distance and self.distance[2], 100)):
            if metres is not None and not 0.0 < metres < most:
                raise ValueError(f"{name} must be in (0, {most}) m, got {metres}")
        if self.distance and self.distance[0] == self.distance[1]:
            raise ValueError(f"distance must be of two cameras, got {self.distance[0]} twice")

    def check_names(self, cameras: tuple[str, ...]) -> None:
        """Raise a ValueError unless the named cameras are among those of the scene."""
        for name, camera in (("fixed", self.fixed), *(("distance", each) for each in (self.distance or ())[:2])):
            if camera is not None and camera not in cameras:
                raise ValueError(f"{name} must name one of {', '.join(cameras)}, got {camera}")


def changed(rig: CameraRig, change: np.ndarray) -> CameraRig:
    """The cameras after a change (camera, parameter), as pinholes: their distortion stays."""
    from scipy.spatial.transform import Rotation

    R = Rotation.from_rotvec(-change[:, ROTATION]).as_matrix() @ rig.R
    centres = rig.centres + np.einsum("kji,kj->ki", rig.R, change[:, POSITION])
    K = rig.K.copy()
    K[:, [0, 1], [0, 1]] *= np.exp(change[:, FOCAL])[:, None]
    K[:, :2, 2] += change[:, CENTRE]
    return replace(rig, K=K, R=R, t=-np.einsum("kij,kj->ki", R, centres))


def difference(rig: CameraRig, other: CameraRig) -> np.ndarray:
    """(camera, parameter) such that :func:`changed` makes ``other`` of ``rig``, offsets aside."""
    from scipy.spatial.transform import Rotation

    change = np.zeros((len(rig), len(KINDS)))
    change[:, ROTATION] = -Rotation.from_matrix(other.R @ transposed(rig.R)).as_rotvec()
    change[:, POSITION] = np.einsum("kij,kj->ki", rig.R, other.centres - rig.centres)
    change[:, FOCAL] = np.log(other.K[:, 0, 0] / rig.K[:, 0, 0])
    change[:, CENTRE] = other.K[:, :2, 2] - rig.K[:, :2, 2]
    return change


def camera_jacobian(
    rig: CameraRig,
    change: np.ndarray,
    axes: np.ndarray,
    origin: np.ndarray,
    velocity: np.ndarray,
    root: tuple[int, int],
) -> np.ndarray:
    """What each camera's parameters do to its view, expressed as steps of the body and of the camera's lens.

    Args:
        rig: the cameras before they are changed.
        change: (camera, parameter).
        axes: (frame, camera, 3, 3) that the root's angles turn about, see
            :class:`~mmocap_warp.contour.frame.normal_equations.ViewEquations`.
        origin: (frame, camera, 3) the root joint [m].
        velocity: (frame, dof) of the searched coordinates [m/s, rad/s].
        root: where the translation and the root's angles begin in the searched coordinates.

    Returns:
        (frame, camera, dof + 4, parameter) derivatives of the searched coordinates, then of the lens.
    """
    dof, now = velocity.shape[1], changed(rig, change)
    # Columns of `turn` are the axes in the world that the rotation parameters turn about at this change.
    turn = transposed(now.R) @ _left_jacobian(-change[:, ROTATION])
    arm = origin[:, :, :, None] - now.centres[:, :, None]  # (frame, camera, 3, 1)
    step = np.zeros((*axes.shape[:2], dof + 4, len(KINDS)))
    shift, angle = (slice(first, first + 3) for first in root)
    # A rotation about the camera's centre turns the body, and shifts it because the root is elsewhere.
    step[:, :, shift, ROTATION] = -np.cross(np.broadcast_to(turn, axes.shape), arm, axis=2)
    step[:, :, angle, ROTATION] = -np.linalg.solve(axes, np.broadcast_to(turn, axes.shape))
    # Position, lens and time act on their own.
    step[:, :, shift, POSITION], step[:, :, dof:, LENS] = -transposed(rig.R), np.eye(4)
    step[:, :, :dof, OFFSET] = -velocity[:, None]
    return step


def _left_jacobian(vector: np.ndarray) -> np.ndarray:
    """(..., 3, 3) the left Jacobian of a rotation vector: its small changes as rotations about fixed axes."""
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    cross = np.cross(np.eye(3), vector[..., None, :])  # the matrix that gives the vector's cross product with another
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    first = np.where(small, 0.5, (1 - np.cos(safe)) / safe**2)
    second = np.where(small, 1 / 6, (safe - np.sin(safe)) / safe**3)
    return np.eye(3) + first * cross + second * (cross @ cross)
