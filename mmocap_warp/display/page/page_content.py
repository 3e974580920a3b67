"""What a page shows of a result, pictures and curves too, as JSON-compatible values; docs/formats.md describes them."""

import base64
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import cv2
import numpy as np

from mmocap_warp.body.joint_sets import JointSet
from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.posing import Poser
from mmocap_warp.body.rotations import quaternions
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.display.chart import COLOURS
from mmocap_warp.display.overlay import ELLIPSE, Look
from mmocap_warp.formats.image_files import encode_png
from mmocap_warp.result.evaluation import evaluate
from mmocap_warp.result.pose_errors import nanmean
from mmocap_warp.result.result import STATUS, Result
from mmocap_warp.result.truth import Truth, at_rate

_MASK_SIDE, _IMAGE_SIDE = 240, 320  # longer side of a mask and of an image [px]
_JPEG_QUALITY = 60
_MASK_CHARACTERS = 1_600_000  # room for all masks, at about half a kilobyte each
_IMAGE_CHARACTERS = 2_000_000  # room for all images, at about six kilobytes each

Views = Iterable[Sequence[np.ndarray | None]]  # per frame, a picture for each camera


@dataclass(frozen=True)
class Pictures:
    """What the cameras saw in one of ``every`` so many of a page's frames, the first always among them."""

    of: list[list[str | None]]  # per camera, base64 of the pictures; None where there is none
    every: int

    @classmethod
    def within(cls, characters: int, of: list[list[str | None]]) -> Self:
        """Pictures of as many frames as have room."""
        total = sum(len(picture or "") for pictures in of for picture in pictures)
        every = max(1, -(-total // characters))
        return cls([pictures[::every] for pictures in of], every)


def small_masks(masks: Views, cameras: int) -> Pictures:
    """Masks of all frames, or of as many as have room, as PNGs of one bit a pixel."""
    return _within(
        _MASK_CHARACTERS, masks, cameras, lambda mask: encode_png(_small(mask.astype(np.uint8) * 255, _MASK_SIDE) > 127)
    )


def small_images(images: Views, cameras: int) -> Pictures:
    """Images of all frames, or of as many as have room, as JPEGs."""
    quality = (cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY)
    return _within(
        _IMAGE_CHARACTERS, images, cameras, lambda image: cv2.imencode(".jpg", _small(image, _IMAGE_SIDE), quality)[1]
    )


def _within(characters: int, views: Views, cameras: int, encoded: Callable[[np.ndarray], Any]) -> Pictures:
    """Encoded pictures of all frames, or of as many as have room."""
    columns: list[list[str | None]] = [[] for _ in range(cameras)]
    for seen in views:
        for column, picture in zip(columns, seen, strict=True):
            column.append(None if picture is None else base64.b64encode(encoded(picture)).decode())
    return Pictures.within(characters, columns)


def _small(picture: np.ndarray, longer_side: int) -> np.ndarray:
    height, width = picture.shape[:2]
    scale = min(1.0, longer_side / max(height, width))
    size = max(1, round(width * scale)), max(1, round(height * scale))
    return cv2.resize(picture, size, interpolation=cv2.INTER_AREA)


_POSE_BYTES = 2_400_000  # room for all poses before they are base64
_JOINT_BYTES = 14  # a joint's turn and place in one frame


def pose_step(result: Result, others: Sequence[Result] = ()) -> int:
    """The stride of the frames whose poses a page has room for, of the others those of their best runs."""
    runs, frames, _ = result.pose.shape
    moving = runs * (1 if result.raw_pose is None else 2) * len(result.subject.body.skeleton.joints)
    moving += sum(len(other.subject.body.skeleton.joints) for other in others)
    return max(1, -(-frames * moving * _JOINT_BYTES // _POSE_BYTES))


def sentence(rate: float, step: int, masks: Pictures | None, images: Pictures | None) -> str:
    """What a page says that it holds: one frame in ``step``, which are ``rate`` a second."""
    parts = [f"poses of {_frames(step)} ({rate:.3g} a second)"]
    for name, pictures in (("masks", masks), ("images", images)):
        parts += [] if pictures is None else [f"{name} of {_frames(step * pictures.every)}"]
    between = "" if step == 1 else " Between them, the body moves evenly."
    return f"This page holds {', '.join(parts)}.{between}"


def _frames(step: int) -> str:
    return "every frame" if step == 1 else f"one frame in {step}"


_UNKNOWN = 65535  # in the place of a coordinate that is not known
_MASKS_OF_PEOPLE = ("#8a9099", "#8a9099")  # the colour of no person
_ROTATION_STEPS = 32767  # steps of a quaternion's component from 0 to 1
Packed = dict[str, Any]  # what JSON can say

_ERRORS = (("mpjpe_mm", "Joint error, mean"), ("marker_error_mm", "Marker error, mean"))
"""Series of an evaluation, best first, and what they are called."""


@dataclass(frozen=True)
class Curve:
    """A measure of every frame: its name and unit for people, the unit empty for a share, and its values.

    They are (run, frame) float64 by track, NaN where there is none: ``final``, and ``raw`` where that has its own.
    """

    name: str
    unit: str
    values: dict[str, np.ndarray]


def tracks(result: Result) -> dict[str, np.ndarray]:
    """A result's poses (run, frame, coordinate): ``final``, and ``raw`` where it was smoothed."""
    return {"final": result.pose} | ({} if result.raw_pose is None else {"raw": result.raw_pose})


def curves(result: Result, truth: Truth | None) -> list[Curve]:
    """The curves that are known of a result; an InputError if the truth is of another recording."""
    known = [] if truth is None else [_error(result, truth)]
    known.append(Curve("IoU, mean over views", "", {"final": nanmean(result.iou, axis=-1)}))
    if result.joint_sigma is not None:
        sigma = 1000.0 * np.linalg.norm(result.joint_sigma, axis=-1)
        known.append(Curve("Uncertainty of a joint, mean", "mm", {"final": nanmean(sigma, axis=-1)}))
    return [curve for curve in known if any(np.isfinite(values).any() for values in curve.values.values())]


def _error(result: Result, truth: Truth) -> Curve:
    """The error of joints where the truth names them, else of markers, for each track."""
    series = {name: evaluate(replace(result, pose=pose), truth)["series"] for name, pose in tracks(result).items()}
    errors = [
        Curve(name, "mm", {track: np.array(each[key], float) for track, each in series.items()})  # None becomes NaN
        for key, name in _ERRORS
    ]
    return next((error for error in errors if np.isfinite(error.values["final"]).any()), errors[0])


def content(
    result: Result,
    truth: Truth | None = None,
    masks: Pictures | None = None,
    images: Pictures | None = None,
    joint_set: JointSet | None = None,
    recorded: CameraRig | None = None,
    people: Sequence[tuple[Look, Result]] = (),
) -> dict[str, Any]:
    """The page's data: all frames of a result, errors against a truth, masks and images where there are some.

    The points of a joint set are those of the track as it is, not of that before it was smoothed. ``recorded`` are the
    cameras with their lenses, at full size: joints can be pinned in their pixels. Where there are several ``people``,
    the result's own is the first, and the others are shown by their best runs. Raises an InputError for a truth of
    another recording.
    """
    return {
        "body": body_content(result.subject.body),
        "cameras": _cameras(result, masks, images, recorded),
        "up": result.cameras.up_vector.tolist(),
        "fps": result.fps,
        "frames": result.frame_numbers.tolist(),
        "every": {"masks": masks.every if masks else 1, "images": images.every if images else 1},
        "statuses": list(STATUS),
        "colours": COLOURS | ({"mask": _MASKS_OF_PEOPLE} if people else {}),
        "deviations": ELLIPSE,
        "truth": None if truth is None else _truth(result, truth),
        "best": result.best_run,
        "runs": _runs(result, truth),
        "person": look_content(people[0][0]) if people else None,
        "others": [
            look_content(look) | {"body": body_content(of.subject.body), "motion": _motion(of, of.pose[of.best_run])}
            for look, of in people[1:]
        ],
        **({} if joint_set is None else {"points": _points(result, joint_set)}),
    }


def look_content(look: Look) -> dict[str, Any]:
    """How a person is told from others: a name and a colour."""
    return {"name": look.name, "colour": "#" + bytes(reversed(look.colour)).hex()}


def body_content(body: BodyModel) -> dict[str, Any]:
    """The skin in its bind pose as triangles, and what moves it."""
    skeleton, skin = body.skeleton, body.skin
    corners = np.arange(1, skin.face.shape[1] - 1)
    # A face's triangles side by side: GPUs keep a few vertices at hand.
    fan = np.stack([skin.face[:, [0, corner, corner + 1]] for corner in corners], axis=1)
    return {
        "joints": list(skeleton.joints),
        "parent": [-1 if slides else parent for parent, slides in zip(skeleton.parent, skeleton.slides, strict=True)],
        "side": [skeleton.side(name) for name in skeleton.joints],
        "rest": packed_values(body.joint_rest),  # (joint, 3)
        "vertex": packed_values(skin.rest),  # (vertex, 3)
        "triangle": packed_numbers(fan.reshape(-1, 3)),
        "coarse": packed_numbers(body.tracking_vertex[body.tracking_face]),  # the tracking mesh's triangles
        "influence": packed(skin.joint.astype(np.uint16)),  # (vertex, 4)
        "weight": packed(np.rint(skin.weight * 65535).astype(np.uint16)),  # (vertex, 4), to be divided by their sum
    }


def _cameras(
    result: Result, masks: Pictures | None, images: Pictures | None, recorded: CameraRig | None
) -> list[dict[str, Any]]:
    rig = result.cameras
    return [
        {"name": name}
        | {what: getattr(rig, what)[k].tolist() for what in ("K", "R", "t", "size")}
        | {"lens": None if recorded is None else _lens(recorded, recorded.names.index(name))}
        | {"masks": masks.of[k] if masks else [], "images": images.of[k] if images else []}
        for k, name in enumerate(rig.names)
    ]


def _lens(rig: CameraRig, k: int) -> dict[str, Any]:
    known = {what: getattr(rig, what)[k].tolist() for what in ("K", "distortion", "size")}
    return known | {"fisheye": rig.names[k] in rig.fisheye}


def _runs(result: Result, truth: Truth | None) -> list[dict[str, Any]]:
    """Each run's motion, curves and statuses."""
    seed = result.config.get("seed")
    poses, known = tracks(result), curves(result, truth)
    return [
        {
            "name": f"run {run}" if seed is None else f"run {run}, seed {seed + run}",
            "tracks": {name: _motion(result, pose[run]) for name, pose in poses.items()},
            "status": result.status[run].tolist(),
            "iou": packed_values(result.iou[run]),  # (frame, camera)
            "sigma": None if result.joint_sigma is None else _sigma(result.joint_sigma[run]),
            "curves": [_curve(curve, run) for curve in known if np.isfinite(curve.values["final"][run]).any()],
        }
        for run in range(len(result.pose))
    ]


def _points(result: Result, joint_set: JointSet) -> list[dict[str, Any]]:
    """A set's names and places in each run."""
    places = joint_set.of_runs(result.subject, result.pose)
    return [{"names": list(joint_set.names), "bones": [], "points": packed_places(run)} for run in places]


def _sigma(sigma: np.ndarray) -> Packed:
    """Standard deviations (frame, joint, 3) of joints' places in tenths of a millimetre; zero where not known."""
    return packed(np.rint(np.nan_to_num(1e4 * sigma, posinf=0.0)).clip(0, 65535).astype(np.uint16))


def _truth(result: Result, truth: Truth) -> dict[str, Any] | None:
    """True places of joints, or of markers, at the page's frames, and the bones between; None where none is known."""
    truth = at_rate(truth, result.fps)
    names, places = (truth.joint_names, truth.joints) if truth.joint_names else (truth.marker_names, truth.markers)
    points = np.full((len(result.frame_numbers), len(names), 3), np.nan)
    _, mine, theirs = np.intersect1d(result.frame_numbers, truth.frame_numbers, return_indices=True)
    points[mine] = places[theirs]
    if not np.isfinite(points).any():
        return None
    # A bone joins a known joint to the nearest known joint above it.
    skeleton, bones = result.subject.body.skeleton, []
    for name in set(names) & set(skeleton.joints):
        above = skeleton.parent[skeleton.joints.index(name)]
        while above >= 0 and skeleton.joints[above] not in names:
            above = skeleton.parent[above]
        bones += [[names.index(name), names.index(skeleton.joints[above])]] if above >= 0 else []
    return {"names": list(names), "bones": sorted(bones), "points": packed_places(points)}


def _curve(curve: Curve, run: int) -> dict[str, Any]:
    values = {track: packed_values(each[run]) for track, each in curve.values.items()}
    return {"name": curve.name, "unit": curve.unit, "values": values}


def _motion(result: Result, pose: np.ndarray) -> dict[str, Any]:
    """How each joint takes the body's rest into the world: ``turn @ (rest - joint_rest) + place``, (frame, joint)."""
    subject = result.subject
    transforms = Poser(subject.body, subject.root_base).joint_transforms(pose)
    turns = transforms[..., :3, :3].astype(float) @ np.swapaxes(subject.body.skeleton.frame, 1, 2)
    steps = np.rint(quaternions(turns) * _ROTATION_STEPS).astype(np.int16)  # x, y, z, w in 8 bytes
    return {"turn": packed(steps), "place": packed_places(transforms[..., :3, 3].astype(float))}


def packed(array: np.ndarray) -> Packed:
    """An array of a plain kind: ``kind`` (such as ``f4``) and ``data``; its shape is for the reader to know."""
    little = np.ascontiguousarray(array, array.dtype.newbyteorder("<"))
    return {"kind": f"{array.dtype.kind}{array.dtype.itemsize}", "data": base64.b64encode(little.tobytes()).decode()}


def packed_numbers(numbers: np.ndarray) -> Packed:
    """Natural numbers, in 2 bytes each where that is enough, else in 4."""
    return packed(numbers.astype(np.uint16 if numbers.max(initial=0) < 1 << 16 else np.uint32))


def packed_values(values: np.ndarray) -> Packed:
    """Measured values, NaN among them, in 4 bytes each."""
    return packed(values.astype(np.float32))


def packed_places(places: np.ndarray) -> Packed:
    """Points (..., 3) [m] in 6 bytes each: ``low + step * values``, off by half a ``step`` at most along an axis.

    The values of a point that is not known (NaN) are ``_UNKNOWN``.
    """
    flat = places.reshape(-1, 3)
    low = np.nanmin(flat, axis=0)
    step = max(float(np.nanmax(flat - low)), 1e-3) / (_UNKNOWN - 1)
    values = np.rint((places - low) / step).clip(0, _UNKNOWN - 1)
    return {"low": low.tolist(), "step": step, "values": packed(np.nan_to_num(values, nan=_UNKNOWN).astype(np.uint16))}
