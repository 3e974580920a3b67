"""A small data set in exactly HumanEva-I's layout, made up: the figure of ``synthetic`` moving among seven cameras.

Everything in it follows from one law, the pose at a time of the motion capture, so that a reader can be checked against
the law and not against another reader. The colour cameras stand where HumanEva's stand; images are small.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import cv2
import ezc3d
import numpy as np
from person_skeleton import JOINTS
from synthetic import synthetic_body, synthetic_subject

from mmocap_warp.body.model import Subject
from mmocap_warp.body.posing import Poser
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.synthesis.footage.faults import draw_silhouettes

SIZE = (160, 120)
CAMERAS = ("C1", "C2", "C3", "BW1", "BW2", "BW3", "BW4")
VIDEO_FRAMES = 28
MOCAP_FRAMES = 54
LAST = 20
"""The last frame of the sequence that all streams still have."""

OFFSETS = {
    "C1": (12.0, 32.4, 2.001),
    "C2": (11.0, 32.4, 2.001),
    "C3": (12.0, 33.1, 2.003),
    "BW1": (15.0, 34.4, 1.999),
    "BW2": (20.0, 43.2, 2.001),
    "BW3": (8.0, 26.0, 2.001),
    "BW4": (9.0, 28.5, 2.001),
}
"""What each ``.ofs`` says: a video frame, where it is in the motion capture, and how many of those pass in one."""

MEASURES = {"LShoulderOffset": 40.0, "RShoulderOffset": 44.0, "LKneeWidth": 105.0, "HeadOffset": 0.0}
LOST = {"LFHD": [27], "RTOE": [36, 37]}
"""Frames of the motion capture, counted from 1, in which a marker is not seen."""

# Not in the order that the reader has them in.
_ONE = ("C7", "T10", "CLAV", "STRN", "RBAK")
_TWO = ("FHD", "BHD", "SHO", "UPA", "ELB", "FRM", "WRA", "WRB", "FIN")
_TWO_MORE = ("ASI", "PSI", "THI", "KNE", "TIB", "ANK", "HEE", "TOE")
_MARKERS = (
    *(f"R{name}" for name in _TWO),
    *_ONE,
    *(f"L{name}" for name in _TWO + _TWO_MORE),
    *(f"R{name}" for name in _TWO_MORE),
)

# Focal lengths, principal point, distortion [640x480], and world to camera [mm], of HumanEva's C1 to C3 for S1.
_LENS = ((765.8, 765.3), (299.8, 232.3), (-0.2894, 0.1060, -0.00136, 0.00113, 0.0))
_COLOUR = (
    ((-0.143362, 0.989627, 0.009217, 0.167173, 0.033395, -0.985362, -0.975449, -0.139723, -0.170226), (-88, 805, 4315)),
    ((0.96536, 0.260047, -0.02135, 0.015062, -0.137226, -0.990425, -0.260487, 0.955795, -0.136389), (206, 956, 4062)),
    (
        (-0.981626, -0.190691, -0.006908, -0.014161, 0.108902, -0.993952, 0.19029, -0.975591, -0.109601),
        (-26, 987, 4130),
    ),
)
_CORNERS = (45.0, 135.0, 225.0, 315.0)  # bearings of the gray cameras, which are made up [degrees]


def hall_rig() -> CameraRig:
    """The seven cameras in metres, z up."""
    views = [(np.reshape(R, (3, 3)), np.array(t) / 1000) for R, t in _COLOUR] + [_corner(angle) for angle in _CORNERS]
    scale = SIZE[0] / 640
    (fx, fy), (cx, cy), distortion = _LENS
    K = [[[fx * scale, 0, (cx + 0.5) * scale - 0.5], [0, fy * scale, (cy + 0.5) * scale - 0.5], [0, 0, 1]]]
    R, t = (np.array(values) for values in zip(*views, strict=True))
    return CameraRig(CAMERAS, np.repeat(K, 7, 0), R, t, np.tile(SIZE, (7, 1)), np.tile(distortion, (7, 1)), "+z")


def _corner(bearing: float) -> tuple[np.ndarray, np.ndarray]:
    angle = np.radians(bearing)
    forward = -np.array([np.cos(angle), np.sin(angle), 0.2])
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward])
    return R, -R @ (np.array([0, 0, 0.95]) - 4.6 * forward)


def poses_at(position: np.ndarray) -> np.ndarray:
    """The law: (n, 51) poses at indices (n,) of the motion capture, which count from 1 and have fractions.

    The figure walks at 1.2 m/s and swings every joint.
    """
    position = np.atleast_1d(position)[:, None]
    swing = np.random.default_rng(4).uniform(-0.35, 0.35, 51)
    swing[:3] = 0.0
    poses = subject().pose + swing * np.sin(0.05 * position)
    poses[:, 0] += 0.010 * (position[:, 0] - 32)
    return poses


def subject() -> Subject:
    """The figure, standing on z = 0."""
    return synthetic_subject("+z")


def mocap_index(camera: str, frame: np.ndarray | int) -> np.ndarray:
    """When a camera's video frame, counted from 1, was taken."""
    image, mocap, scale = OFFSETS[camera]
    return mocap + (np.asarray(frame) - image) * scale


def marker_vertices() -> dict[str, int]:
    """Where each marker sits on the figure's skin: those that the figure has where it has them, others anywhere."""
    body = synthetic_body()
    vertices = np.linspace(0, len(body.skin.rest) - 1, len(_MARKERS)).round().astype(int)
    own = dict(zip(body.marker_names, body.marker_vertex.tolist(), strict=True))
    anywhere = zip(_MARKERS, vertices.tolist(), strict=True)
    return {name: own.get(name, vertex) for name, vertex in anywhere}


def write_humaneva(root: Path) -> None:
    """Write ``S1`` with ``Walking_1``, and ``Background``."""
    folders = [root / "S1" / name for name in ("Calibration_Data", "Image_Data", "Mocap_Data", "Sync_Data")]
    calibration, images, mocap, sync = folders
    background = root / "Background"
    for folder in (*folders, background):
        folder.mkdir(parents=True)
    rig = hall_rig()
    for k, camera in enumerate(CAMERAS):
        write_cal(calibration / f"{camera}.cal", rig, k)
        (sync / f"Walking_1_({camera}).ofs").write_text("".join(f"{number}\r\n" for number in OFFSETS[camera]))
        room = _Room(k)
        write_avi(images / f"Walking_1_({camera}).avi", _filmed(room, rig, k))
        for clip in (1, 2, 3):
            write_avi(background / f"Background_{clip}_({camera}).avi", [room.empty(clip)] * 6)
    (mocap / "S1.mp").write_text("".join(f"${name} = {value}\n" for name, value in MEASURES.items()))
    write_c3d(mocap / "Walking_1.c3d", captured_points(np.arange(1, MOCAP_FRAMES + 1)), LOST)
    write_c3d(mocap / "Static.c3d", captured_points(np.full(4, 30.0)), {"LSHO": [2]})


def copied(root: Path, parent: Path) -> Path:
    """A copy of a data set, to change."""
    return Path(shutil.copytree(root, parent / root.name))


def write_cal(path: Path, rig: CameraRig, k: int) -> None:
    """One number a line, millimetres, and the rotation again at the end, as some of HumanEva's files have it."""
    K = rig.K[k]
    rows = [K[[0, 1], [0, 1]], K[:2, 2], [0.0], rig.distortion[k], rig.R[k].ravel(), 1000 * rig.t[k]]
    numbers = np.concatenate([*rows, cv2.Rodrigues(rig.R[k])[0].ravel()])
    path.write_text("".join(f"{number:.9f}\r\n" for number in numbers))


def write_avi(path: Path, frames: list[np.ndarray]) -> None:
    """XVID, as HumanEva's."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"XVID"), 60, frames[0].shape[1::-1])
    for frame in frames:
        writer.write(frame)
    writer.release()


def write_c3d(path: Path, points: dict[str, np.ndarray], lost: dict[str, list[int]], units: str = "mm") -> None:
    """Points (frame, 3) [m] at 120 Hz by name; a lost one is at zero, as Vicon writes it."""
    file = ezc3d.c3d()
    about = file["parameters"]["POINT"]
    about["UNITS"]["value"], about["RATE"]["value"] = [units], [120.0]
    about["LABELS"]["value"] = [f"Sub1:{name}" for name in points]
    positions = np.stack(list(points.values())) * 1000  # (point, frame, 3)
    for name, frames in lost.items():
        positions[list(points).index(name), np.array(frames) - 1] = 0.0
    file["data"]["points"] = np.concatenate([positions.transpose(2, 0, 1), np.ones((1, *positions.shape[:2]))])
    file.write(str(path))


def captured_points(position: np.ndarray) -> dict[str, np.ndarray]:
    """Markers, and Vicon's four points of each segment, at indices of the motion capture: (n, 3) each [m]."""
    poses = poses_at(position)
    poser = Poser(subject().body, subject().root_base)
    vertices, transforms = poser.vertices(poses).astype(float), poser.joint_transforms(poses).astype(float)
    points = {name: vertices[:, vertex] for name, vertex in marker_vertices().items()}
    joint = {name: transforms[:, j, :3, 3] for j, name in enumerate(JOINTS)}
    turn = {name: transforms[:, j, :3, :3] for j, name in enumerate(JOINTS)}
    for segment, name in (("PEL", "Root"), ("TRX", "Neck"), ("HED", "Neck")):  # body axes: x left, y up, z forward
        left, up, forward = np.moveaxis(turn[name], -1, 0)
        points |= _segment(segment, joint[name], forward, left, joint[name] + 0.2 * up)
    for side in "LR":
        for segment, end, start in (
            ("FE", "Knee", "Hip"),
            ("TI", "Ankle", "Knee"),
            ("HU", "Elbow", "Shoulder"),
            ("RA", "Wrist", "Elbow"),
        ):
            roughly_forward = turn[f"{side}{start}"][..., 2]
            points |= _limb(side + segment, joint[f"{side}{end}"], joint[f"{side}{start}"], roughly_forward)
        shoulder, up = joint[f"{side}Shoulder"], turn["Neck"][..., 1]
        points |= _segment(f"{side}CL", shoulder, turn["Neck"][..., 2], turn["Neck"][..., 0], shoulder + 0.1 * up)
    return points


def _limb(name: str, origin: np.ndarray, proximal: np.ndarray, roughly_forward: np.ndarray) -> dict[str, np.ndarray]:
    along = (proximal - origin) / np.linalg.norm(proximal - origin, axis=1, keepdims=True)
    left = np.cross(along, roughly_forward)
    left /= np.linalg.norm(left, axis=1, keepdims=True)
    return _segment(name, origin, np.cross(left, along), left, proximal)


def _segment(
    name: str, origin: np.ndarray, forward: np.ndarray, left: np.ndarray, proximal: np.ndarray
) -> dict[str, np.ndarray]:
    ends = (origin, proximal, origin + 0.1 * forward, origin + 0.1 * left)
    return {name + letter: end for letter, end in zip("OPAL", ends, strict=True)}


@dataclass(frozen=True)
class _Room:
    """What a camera sees without the subject. Only the second background clip shows it as in the recording."""

    k: int

    def empty(self, clip: int = 2) -> np.ndarray:
        """(height, width, 3) BGR."""
        rng = np.random.default_rng(self.k)
        rough = rng.uniform(110, 170, (8, 10, 1 if CAMERAS[self.k].startswith("BW") else 3)).repeat(2, 0).repeat(2, 1)
        room = cv2.resize(np.broadcast_to(rough, (16, 20, 3)).copy(), SIZE, interpolation=cv2.INTER_CUBIC)
        if clip == 1:
            room[70:, 100:140] += 40  # something stood there
        if clip == 3:
            room *= 0.85
        return np.clip(room, 0, 255).astype(np.uint8)


def _filmed(room: _Room, rig: CameraRig, k: int) -> list[np.ndarray]:
    """The dark figure before the room, each frame at its own time of the motion capture."""
    poses = poses_at(mocap_index(CAMERAS[k], np.arange(1, VIDEO_FRAMES + 1)))
    vertices = Poser(subject().body, subject().root_base).vertices(poses)
    camera, empty = rig.select((CAMERAS[k],)), room.empty()
    frames = []
    for posed in vertices:
        image = empty.copy()
        image[draw_silhouettes(camera, posed, subject().body.skin.face)[0]] = 30
        frames.append(image)
    return frames
