"""Places of joints that a person clicked in images: read, checked, and what they say about poses."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np

from mmocap_warp.cameras.rig import CameraRig, through_lens, to_pixels
from mmocap_warp.contour.clip.motion_points import POINTS_A_JOINT, MotionPoints
from mmocap_warp.contour.frame.normal_equations import NormalEquations
from mmocap_warp.contour.frame.rooted import RootedPoses
from mmocap_warp.errors import InputError
from mmocap_warp.formats.toml_table import Table, load_toml
from mmocap_warp.result.result import Result

SIGMA = 0.01  # standard deviation of a click, as a length at a body as large as a person [m]
MAX_DISAGREEMENT = 0.06  # how far a click may lie beside where all views agree, at a body as large as a person [m]
_LENS_STEPS = 50  # of undoing a lens; each divides the error by ten in usual ones


@dataclass(frozen=True, eq=False)
class Pins:
    """Rays that joints lie on."""

    frame: np.ndarray  # (ray,) positions of the frames in the result
    joint: np.ndarray  # (ray,) the joints' numbers
    across: np.ndarray  # (ray, 2, 3) and
    beside: np.ndarray  # (ray, 2): ``across @ place + beside`` is by how much a place lies beside the ray [m]
    sigma: float  # standard deviation of that [m]
    listed: list[dict[str, Any]]  # the pins as they were given, to be recorded

    def of(self, frames: np.ndarray, rooted: RootedPoses, points: MotionPoints) -> NormalEquations:
        """What the pins say about frames by their positions, around poses; nothing where none are."""
        place, derivative = (each[:, ::POINTS_A_JOINT] for each in points.linearised(rooted))
        dof = derivative.shape[-1]
        equations = NormalEquations(*(np.zeros((len(frames), *shape)) for shape in ((dof, dof), (dof,), ())))
        for row, frame in enumerate(frames.tolist()):
            rays = np.flatnonzero(self.frame == frame)
            if not len(rays):
                continue
            joints = self.joint[rays]
            error = np.einsum("rij,rj->ri", self.across[rays], place[row, joints]) + self.beside[rays]
            slope = (self.across[rays] @ derivative[row, joints] / self.sigma).reshape(-1, dof)
            error = error.reshape(-1) / self.sigma
            equations.matrix[row], equations.gradient[row] = slope.T @ slope, -slope.T @ error
            equations.cost[row] = 0.5 * error @ error
        return equations

    @classmethod
    def none(cls) -> Self:
        """No pins at all."""
        return cls(np.zeros(0, int), np.zeros(0, int), np.zeros((0, 2, 3)), np.zeros((0, 2)), SIGMA, [])

    def moved(self, frames: int, unit: float) -> Self:
        """The same for a part of the result that begins so many ``frames`` later, with lengths in a unit [m]."""
        return replace(self, frame=self.frame - frames, beside=self.beside / unit, sigma=self.sigma / unit)


def read_pins(pins: str | Path | list[dict[str, Any]], result: Result, recorded: CameraRig) -> Pins:
    """Pins from a file, or from a list of its tables.

    Args:
        pins: the file, or dictionaries such as ``{"frame": 155, "joint": "LWrist", "cam1": [x, y], ...}``.
        result: whose frames, joints and cameras they name.
        recorded: the cameras with their lenses, at full size, in whose images the pixels are.

    Raises:
        InputError: what is not known, outside an image, in one view only, or contradicts another view.
    """
    source = str(pins) if isinstance(pins, str | Path) else "pins"
    tables = load_toml(pins).take_rest() if isinstance(pins, str | Path) else {"pin": _as_toml(pins)}
    listed = tables.pop("pin", None)
    if tables or not isinstance(listed, list) or not listed or not all(isinstance(each, dict) for each in listed):
        remedy = 'write [[pin]], then frame = 155, joint = "LWrist", and a pixel [x, y] of two cameras or more'
        raise InputError(source, "must hold [[pin]] tables, one at least, and nothing else", remedy)
    rays = [ray for i, each in enumerate(listed, 1) for ray in _rays(Table(each, source, f"pin {i}"), result, recorded)]
    frame, joint, across, beside = (np.array(column) for column in zip(*rays, strict=True))
    return Pins(frame, joint, across, beside, SIGMA * result.subject.body.relative_size, listed)


def _as_toml(pins: Any) -> Any:
    """A list's tables with numbers and lists as a file has them: arrays, tuples and NumPy's numbers are as good."""
    if not isinstance(pins, list) or not all(isinstance(each, dict) for each in pins):
        return pins
    return [{k: v if isinstance(v, str) else np.asarray(v).tolist() for k, v in each.items()} for each in pins]


def _rays(table: Table, result: Result, recorded: CameraRig) -> list[tuple[int, int, np.ndarray, np.ndarray]]:
    """A pin's rays: position of the frame, number of the joint, and the two equations of each ray."""
    # Which joint, and when.
    joints, numbers = result.subject.body.skeleton.joints, result.frame_numbers
    number, name = table.take("frame", int), table.take("joint", str)
    if number not in numbers:
        remedy = f"give one of the result's frames, {numbers[0]} to {numbers[-1]}"
        raise table.error(f"frame = {number} is not in the result", remedy)
    if name not in joints:
        raise table.error(f"joint = {name!r} is not known", f"give one of {', '.join(joints)}")

    # Its pixels.
    known = {camera: table.take_numbers(camera, (2,)) for camera in recorded.names if table.has(camera)}
    for other in table.take_rest():
        raise table.error(f"'{other}' is no camera", f"give pixels of {', '.join(recorded.names)}")
    if len(known) < 2:
        raise table.error(f"names {len(known) or 'no'} camera", "click the joint in two cameras or more")
    rig, across, beside = result.cameras, [], []
    for camera, pixel in known.items():
        k = recorded.names.index(camera)
        width, height = recorded.size[k]
        if not (-0.5 <= pixel[0] <= width - 0.5 and -0.5 <= pixel[1] <= height - 0.5):
            raise table.error(f"{camera} = {pixel} is outside the image", f"its pixels go to {width - 1}, {height - 1}")
        x, y = _without_lens(recorded, k, np.array(pixel))
        R, t = rig.R[rig.names.index(camera)], rig.t[rig.names.index(camera)]
        across.append(R[:2] - np.outer((x, y), R[2]))
        beside.append(t[:2] - np.array((x, y)) * t[2])

    # The views must agree about a place in front of them.
    place = np.linalg.lstsq(np.concatenate(across), -np.concatenate(beside), rcond=None)[0]
    off = [float(np.linalg.norm(a @ place + b)) for a, b in zip(across, beside, strict=True)]
    if max(off) > MAX_DISAGREEMENT * result.subject.body.relative_size:
        worst = list(known)[int(np.argmax(off))]
        problem = f"{name} in frame {number}: the pixels of {', '.join(known)} contradict each other by "
        raise table.error(f"{problem}{1000 * max(off):.0f} mm, most in {worst}", "click that joint again there")
    frame, joint = int(np.flatnonzero(numbers == number)[0]), joints.index(name)
    return [(frame, joint, a, b) for a, b in zip(across, beside, strict=True)]


def _without_lens(rig: CameraRig, k: int, pixel: np.ndarray) -> np.ndarray:
    """Where a pixel (2,) of camera ``k`` lies on the ideal image plane at focal length 1."""
    focal, plane = rig.K[k, [0, 1], [0, 1]], np.zeros(2)
    for _ in range(_LENS_STEPS):
        plane = plane + (pixel - to_pixels(rig, k, through_lens(rig, k, plane))) / focal
    return plane
