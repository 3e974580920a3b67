"""What a page shows of a result, as JSON-compatible values; docs/formats.md describes them."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np

from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.posing import Poser
from mmocap_warp.display.page.curves import Curve, curves, tracks
from mmocap_warp.display.page.pictures import Pictures
from mmocap_warp.result.result import STATUS, Result
from mmocap_warp.result.truth import Truth


def content(
    result: Result,
    truth: Truth | None = None,
    masks: Pictures | None = None,
    images: Pictures | None = None,
) -> dict[str, Any]:
    """The page's data.

    Args:
        result: what is shown, all frames of it.
        truth: what errors are measured from; None for no error.
        masks: of its frames; None for none.
        images: likewise.

    Raises:
        InputError: the truth is of another recording.
    """
    return {
        "body": _body(result.subject.body),
        "cameras": _cameras(result, masks, images),
        "up": result.cameras.up_vector.tolist(),
        "fps": result.fps,
        "frames": result.frame_numbers.tolist(),
        "every": {"masks": masks.every if masks else 1, "images": images.every if images else 1},
        "statuses": list(STATUS),
        "best": result.best_run,
        "runs": _runs(result, truth),
    }


def _body(body: BodyModel) -> dict[str, Any]:
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


def _cameras(result: Result, masks: Pictures | None, images: Pictures | None) -> list[dict[str, Any]]:
    rig = result.cameras
    return [
        {
            "name": name,
            "K": rig.K[k].tolist(),
            "R": rig.R[k].tolist(),
            "t": rig.t[k].tolist(),
            "size": rig.size[k].tolist(),
            "masks": masks.of[k] if masks else [],
            "images": images.of[k] if images else [],
        }
        for k, name in enumerate(rig.names)
    ]


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
            "curves": [_curve(curve, run) for curve in known if np.isfinite(curve.values["final"][run]).any()],
        }
        for run in range(len(result.pose))
    ]


def _curve(curve: Curve, run: int) -> dict[str, Any]:
    values = {track: packed_values(each[run]) for track, each in curve.values.items()}
    return {"name": curve.name, "unit": curve.unit, "values": values}


def _motion(result: Result, pose: np.ndarray) -> dict[str, Any]:
    """How each joint takes the body's rest into the world: ``turn @ (rest - joint_rest) + place``, (frame, joint)."""
    subject = result.subject
    transforms = Poser(subject.body, subject.root_base).joint_transforms(pose)
    turns = transforms[..., :3, :3].astype(float) @ np.swapaxes(subject.body.skeleton.frame, 1, 2)
    return {"turn": packed_rotations(turns), "place": packed_places(transforms[..., :3, 3].astype(float))}


Packed = dict[str, Any]
"""What JSON can say."""

_ROTATION_STEPS = 32767  # steps of a quaternion's component from 0 to 1


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
    """Points (..., 3) [m] in 6 bytes each: ``low + step * values``, off by half a ``step`` at most along an axis."""
    flat = places.reshape(-1, 3)
    low = flat.min(axis=0)
    step = max(float((flat.max(axis=0) - low).max()), 1e-3) / 65535
    values = np.rint((places - low) / step).clip(0, 65535).astype(np.uint16)
    return {"low": low.tolist(), "step": step, "values": packed(values)}


def packed_rotations(rotations: np.ndarray) -> Packed:
    """Rotations (..., 3, 3) as quaternions x, y, z, w in 8 bytes each, in steps of 1/32767."""
    from scipy.spatial.transform import Rotation

    quaternion = Rotation.from_matrix(rotations.reshape(-1, 3, 3)).as_quat()
    return packed(np.rint(quaternion * _ROTATION_STEPS).astype(np.int16))
