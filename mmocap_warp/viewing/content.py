"""What a page shows of a result, as JSON-compatible values; docs/viewer.md describes them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.posing import Poser
from mmocap_warp.result.evaluation import evaluate
from mmocap_warp.result.positions import POSES_AT_ONCE, blocks
from mmocap_warp.result.result import STATUS, Result
from mmocap_warp.result.truth import Truth
from mmocap_warp.viewing.packing import packed, packed_numbers, packed_places, packed_rotations, packed_values
from mmocap_warp.viewing.thinning import Pictures

_ERRORS = (("mpjpe_mm", "Joint error, mean"), ("marker_error_mm", "Marker error, mean"))
"""Series of an evaluation, best first, and what the page calls them."""


def content(
    result: Result,
    step: int,
    truth: Truth | None = None,
    masks: Pictures | None = None,
    images: Pictures | None = None,
) -> dict[str, Any]:
    """The page's data.

    Args:
        result: what is shown.
        step: every so manieth frame is kept, with the first.
        truth: what errors are measured from; None for no error.
        masks: of the frames that are kept; None for none.
        images: likewise.

    Raises:
        InputError: the truth is of another recording.
    """
    kept = np.arange(0, len(result.frame_numbers), step)
    return {
        "body": _body(result.subject.body),
        "cameras": _cameras(result, masks, images),
        "up": result.cameras.up_vector.tolist(),
        "fps": result.fps,
        "frames": result.frame_numbers[kept].tolist(),
        "every": {"masks": masks.every if masks else 1, "images": images.every if images else 1},
        "statuses": list(STATUS),
        "best": result.best_run,
        "runs": _runs(result, kept, truth),
    }


def _body(body: BodyModel) -> dict[str, Any]:
    """The skin in its bind pose as triangles, and what moves it."""
    skeleton, skin = body.skeleton, body.skin
    corners = np.arange(1, skin.face.shape[1] - 1)
    # A face's triangles side by side: GPUs keep a few vertices at hand.
    fan = np.stack([skin.face[:, [0, corner, corner + 1]] for corner in corners], axis=1)
    return {
        "joints": list(skeleton.joints),
        "parent": list(skeleton.parent),
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


def _runs(result: Result, kept: np.ndarray, truth: Truth | None) -> list[dict[str, Any]]:
    """Each run's motion, curves and statuses."""
    tracks = {"final": result.pose} | ({} if result.raw_pose is None else {"raw": result.raw_pose})
    errors = {name: _errors(result, pose, truth) for name, pose in tracks.items()} if truth is not None else {}
    seed = result.config.get("seed")
    return [
        {
            "name": f"run {run}" if seed is None else f"run {run}, seed {seed + run}",
            "tracks": {name: _motion(result, pose[run, kept]) for name, pose in tracks.items()},
            "status": result.status[run, kept].tolist(),
            "iou": packed_values(result.iou[run, kept]),  # (frame, camera)
            "curves": _curves(result, run, kept, errors),
        }
        for run in range(len(result.pose))
    ]


def _motion(result: Result, pose: np.ndarray) -> dict[str, Any]:
    """How each joint takes the body's rest into the world: ``turn @ (rest - joint_rest) + place``, (frame, joint)."""
    subject = result.subject
    poser = Poser(subject.body, subject.root_base)
    transforms = np.concatenate([poser.joint_transforms(pose[block]) for block in blocks(len(pose), POSES_AT_ONCE)])
    turns = transforms[..., :3, :3].astype(float) @ np.swapaxes(subject.body.skeleton.frame, 1, 2)
    return {"turn": packed_rotations(turns), "place": packed_places(transforms[..., :3, 3].astype(float))}


def _curves(
    result: Result, run: int, kept: np.ndarray, errors: dict[str, tuple[str, np.ndarray]]
) -> list[dict[str, Any]]:
    """What is drawn against frame: name, unit, and values of each track that has its own."""
    curves = []
    if errors:
        curves.append(_curve(errors["final"][0], "mm", {name: of[run, kept] for name, (_, of) in errors.items()}))
    iou = result.iou[run, kept]
    seen = np.isfinite(iou)
    mean = np.divide(np.where(seen, iou, 0.0).sum(axis=1), seen.sum(axis=1), where=seen.any(axis=1), out=_nan(len(iou)))
    curves.append(_curve("IoU, mean over views", "", {"final": mean}))
    if result.joint_sigma is not None:
        sigma = np.linalg.norm(result.joint_sigma[run, kept], axis=-1)
        curves.append(_curve("Uncertainty of a joint, mean", "mm", {"final": 1000.0 * sigma.mean(axis=1)}))
    return [curve for curve in curves if curve is not None]


def _curve(name: str, unit: str, values: dict[str, np.ndarray]) -> dict[str, Any] | None:
    if not any(np.isfinite(each).any() for each in values.values()):
        return None
    return {"name": name, "unit": unit, "values": {track: packed_values(each) for track, each in values.items()}}


def _errors(result: Result, pose: np.ndarray, truth: Truth) -> tuple[str, np.ndarray]:
    """What the error is called, and its values (run, frame) [mm] for one of the result's tracks."""
    series = evaluate(replace(result, pose=pose), truth)["series"]
    for key, name in _ERRORS:
        values = np.array(series.get(key, np.nan), float)  # None becomes NaN
        if np.isfinite(values).any():
            return name, values
    return _ERRORS[0][1], np.full(result.cost.shape, np.nan)


def _nan(count: int) -> np.ndarray:
    return np.full(count, np.nan)
