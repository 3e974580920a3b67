"""How far a result is to be trusted, by its own word: statuses, views that lie beside the body, unsure parts.

What hides limbs, or people who walk by, spoil the overlap but hardly move a whole outline. So the overlap decides
nothing; a camera disagrees where the whole outline in its masks lies beside the body.
"""

import shlex
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from mmocap_warp.result.pose_errors import nanmedian
from mmocap_warp.result.result import STATUS, Result

PARTS_IN_DOUBT = "parts_in_doubt"  # where a configuration has frames of parts, of a tracker without deviations
_MAX_SHIFT = 0.015  # metres by which a view may lie beside a person. Sound recordings have up to .007
_WRONG_SHIFT = 0.035  # metres from which nothing is trusted: a camera that is off by 1 degree has .05
_FEW_VIEWS = 3  # up to which any disagreement is too much: the body gives way to a camera that is far off
_HOLDING_SHARE = 0.5  # of the cameras that must agree with the body: where fewer do, none of them holds it
_STRETCH = 1.0  # seconds over which a view that lies beside the body was moved, and is not hidden for a moment
_MOVED_SHIFT, _BESIDE = 0.02, 0.01  # metres by which it does then, and at least. Sound recordings have up to .010
_NAMED_SHARE = 0.6  # of the largest shift: a camera with so much may be the one that is wrong
_MAX_SIGMA = 0.1  # metres: a joint with a larger standard deviation is in doubt
_MOST_IN_DOUBT = 0.5  # of the body's parts: a frame with more of them in doubt is not trusted, whatever its status
_MIN_VIEWS = 2  # views that must see somebody in a frame
MAX_DEPARTURE = 3.5  # standard deviations from its kind: a sound body had at most 3.0, those in a skirt 4 to 8
_SHOWN_RANGES = 4  # ranges of frames that are listed


def verdict(result: Result, scene: Path | None = None) -> dict[str, Any]:
    """How far a result's best run is to be trusted.

    ``frames`` counts those that show anything new, and ``trusted`` those of them that are ``tracked`` or ``rescued``,
    or ``partial`` with no part of the body in doubt, in two views or more, with at most half of the body in doubt. None
    is trusted where a camera is over 35 mm off (15 with three cameras or fewer, or if most are off), where the fit left
    it ``undecided`` how the body stands, or where masks and calibration fit no body, which is the ``problem``.
    ``holds`` says whether most are trusted, ``unlike`` whether the fit made the body very unlike its kind. ``parts``
    has the numbers of the frames in which a part's joints may be over 100 mm off, by part; ``cameras`` by how much each
    camera that disagrees with the others does [mm]; ``repeated`` how many frames repeat the one before. ``frozen``
    lists, by camera, the frames in which it repeats its image while the others go on; ``moved`` lists those in which it
    disagrees though it agrees in most; with enough others it was left out there. ``lines`` say all that in words.
    ``next`` is the command that may mend the result, where one is needed and the ``scene`` is known.
    """
    best, numbers = result.best_run, result.frame_numbers
    skeleton, size = result.subject.body.skeleton, result.subject.body.relative_size
    status = np.array(STATUS)[result.status[best]]
    # Parts of the body whose joints are unsure.
    doubt = np.zeros((len(status), len(skeleton.parts)), bool)
    if result.joint_sigma is not None:
        unsure = np.linalg.norm(result.joint_sigma[best], axis=-1) > _MAX_SIGMA * size
        doubt = np.stack([unsure[:, np.equal(skeleton.part, i)].any(axis=1) for i in range(doubt.shape[1])], axis=1)
    doubt |= frames_marked(result, PARTS_IN_DOUBT, skeleton.parts)
    good = np.isin(status, ("tracked", "rescued")) | ((status == "partial") & ~doubt.any(axis=1))
    good &= doubt.mean(axis=1) <= _MOST_IN_DOUBT
    good &= np.isfinite(result.iou[best]).sum(axis=1) >= _MIN_VIEWS
    moved = views_beside(result)
    good &= ~moved.any(axis=1)
    # Cameras, in the middle of these frames. Where all of the body is in doubt, a camera may be why.
    cameras: dict[str, float] = {}
    held = len(result.cameras) > _FEW_VIEWS
    asked = good if good.any() else np.isin(status, ("tracked", "rescued", "partial"))
    if result.view_shift is not None and asked.any():
        middle = np.nan_to_num(nanmedian(result.view_shift[best][asked]))
        if middle.max() > _MAX_SHIFT * size:
            worst = [k for k in np.argsort(-middle) if middle[k] > _NAMED_SHARE * middle.max()]
            cameras = {result.cameras.names[k]: 1000 * float(middle[k]) for k in worst}
            held &= bool(np.mean(middle[middle > 0] <= _MAX_SHIFT * size) >= _HOLDING_SHARE)
    off = max(cameras.values(), default=0.0) > 1000 * (_WRONG_SHIFT if held else _MAX_SHIFT) * size
    frozen, left_out = (frames_by_name(result, frames_marked(result, why)) for why in ("frozen_views", "moved_views"))
    fitted = result.subject.provenance
    undecided = fitted.get("fit.alternative") if fitted.get("fit.decided") == "no" else None
    problem, repeated = result.config.get("trusted_cameras"), int((status == "repeated").sum())
    values: dict[str, Any] = {
        "frames": len(status) - repeated,
        "trusted": 0 if off or problem or undecided else int(good.sum()),
        "parts": frames_by_name(result, doubt, skeleton.parts),
        "cameras": cameras,
        "moved": frames_by_name(result, moved) | left_out,
        "repeated": repeated,
        "frozen": frozen,
        "problem": problem,
        "undecided": undecided,
        "unlike": float(fitted.get("fit.departure", 0.0)) > MAX_DEPARTURE,
    }
    holds = 2 * values["trusted"] >= values["frames"]
    said = {"holds": holds, "lines": _lines(values, left_out, result.stride)}
    return values | said | {"next": _next_step(bool(cameras), numbers[moved.any(axis=1)].tolist(), holds, scene)}


def views_beside(result: Result) -> np.ndarray:
    """(frame, camera) bool: where a view lies beside the best run's body for a second or longer: it was moved.

    Not where as many views do, for then the pose is wrong, nor a view that hardly ever fits.
    """
    best, size = result.best_run, result.subject.body.relative_size
    if result.view_shift is None:
        return np.zeros(result.iou[best].shape, bool)
    # Medians over a second around each frame: a view that is hidden, or shows somebody else, is not for so long.
    shift, half = result.view_shift[best], max(2, round(_STRETCH * result.rate / 2))
    around = sliding_window_view(np.pad(shift, ((half, half), (0, 0)), constant_values=np.nan), 2 * half + 1, axis=0)
    medians = [nanmedian(around[:, k].T) for k in range(shift.shape[1])]  # one by one: a long clip's windows are large
    lasting = np.where(np.isfinite(around).sum(axis=-1) >= half, np.stack(medians, axis=1), np.nan)
    held = (lasting <= _MAX_SHIFT * size).sum(axis=1) > _HOLDING_SHARE * np.isfinite(lasting).sum(axis=1)
    usual = np.sort(shift, axis=0)[np.isfinite(shift).sum(axis=0) // 4, np.arange(shift.shape[1])]
    moved = (lasting > _MOVED_SHIFT * size) & held[:, None] & (usual <= _BESIDE * size)
    # What is beside it by less, before and after, is so for the same reason, though the body may give way to it there.
    beside = lasting > _BESIDE * size
    for k in np.flatnonzero(moved.any(axis=0)):
        for stretch in np.split(np.arange(len(moved)), np.flatnonzero(np.diff(beside[:, k])) + 1):
            moved[stretch, k] = beside[stretch[0], k] & moved[stretch, k].any()
    return moved & np.isfinite(shift)


def frames_by_name(result: Result, where: np.ndarray, names: Sequence[str] | None = None) -> dict[str, list[int]]:
    """Numbers of the frames in which a camera, or another of ``names``, is marked, (frame, name) bool, by name."""
    names = result.cameras.names if names is None else names
    marked = {name: result.frame_numbers[where[:, k]].tolist() for k, name in enumerate(names)}
    return {name: numbers for name, numbers in marked.items() if numbers}


def frames_marked(result: Result, why: str, names: Sequence[str] | None = None) -> np.ndarray:
    """(frame, name) bool: the frames that its configuration has for a reason, by camera or others of ``names``."""
    frames, names = result.config.get(why, {}), result.cameras.names if names is None else names
    return np.stack([np.isin(result.frame_numbers, frames.get(name, [])) for name in names], axis=1)


def _next_step(cameras_disagree: bool, beside: list[int], holds: bool, scene: Path | None) -> str | None:
    """The command that may mend a result of a scene, in some frames of which a view lies ``beside`` the body."""
    if scene is None or (holds and not cameras_disagree and not beside):
        return None
    part = ["--frames", f"{beside[0]}:{beside[-1] + 1}"] if beside and not cameras_disagree else []
    refined = ["refine", str(scene), "-o", str(scene.parent / "calibration-refined.toml"), *part]
    return shlex.join(["mmocap", "calib", *(refined if cameras_disagree or beside else ["check", str(scene)])])


def _lines(values: dict[str, Any], left_out: Collection[str], stride: int) -> list[str]:
    """The verdict in words; ``stride`` is between the numbers of frames, and moved views may be ``left_out``."""
    lines = [f"{values['trusted']} of {values['frames']} frames trusted"]
    if values["problem"]:
        return [*lines, f"masks and calibration fit no body: {values['problem']}"]
    if values["undecided"]:
        otherwise = {"turned": "turned round", "swapped": "with limbs in each other's place"}[values["undecided"]]
        lines.append(f"the body may be {otherwise}: that explains the first seconds as well; look at the overlay")
    if values["unlike"]:
        lines.append("the body had to be made unlike its kind: loose clothes, or limbs in each other's place?")
    if values["cameras"]:
        off = [f"{name} by {shift:.0f} mm" for name, shift in values["cameras"].items()]
        lines.append(f"cameras that disagree with the others: {', '.join(off)} at the body")
    for name, frames in values["moved"].items():
        where = _ranges(frames, stride) + (", and is left out there" if name in left_out else "")
        lines.append(f"{name} lies beside the body in {where}: was it moved, or did it drop frames?")
    if values["repeated"]:
        lines.append(f"{values['repeated']} more frames repeat the one before, and count as not seen")
    for name, frames in values["frozen"].items():
        lines.append(f"{name} is frozen in {_ranges(frames, stride)}, and left out there")
    parts_of = dict[str, list[str]]()
    for part, frames in values["parts"].items():
        parts_of.setdefault(_ranges(frames, stride), []).append(part)
    return lines + [f"in doubt: {', '.join(parts)} in {ranges}" for ranges, parts in parts_of.items()]


def _ranges(frames: Sequence[int], stride: int) -> str:
    """Frame numbers for people, as ``frames 3 to 9, 12 (8 in all)``."""
    runs = np.split(frames, np.flatnonzero(np.diff(frames) > stride) + 1)
    words = [f"{run[0]}" if len(run) == 1 else f"{run[0]} to {run[-1]}" for run in runs]
    if len(frames) == 1:
        return f"frame {words[0]}"
    more = [f"{len(words) - _SHOWN_RANGES} more ranges"] if len(words) > _SHOWN_RANGES else []
    return f"frames {', '.join(words[:_SHOWN_RANGES] + more)} ({len(frames)} in all)"
