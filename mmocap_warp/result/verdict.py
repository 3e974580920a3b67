"""How far a result is to be trusted, by its own word: statuses, views that lie beside the body, parts in doubt.

A view's masks lie beside the body where its camera disagrees with the others, since the body is a compromise of all.
What hides limbs, or people who walk by, spoil the overlap but hardly move a whole outline: the overlap decides nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mmocap_warp.result.result import STATUS, Result

_MAX_SHIFT = 0.015  # metres by which a view may lie beside a person. Sound recordings have up to .008
_NAMED_SHARE = 0.5  # of the largest shift: a camera with so much may be the one that is wrong
_MAX_SIGMA = 0.1  # metres: a joint with a larger standard deviation is in doubt
_MIN_VIEWS = 2  # views that must see somebody in a frame
_SHOWN_RANGES = 4  # ranges of frames that are listed of a part in doubt


@dataclass(frozen=True)
class Verdict:
    """How far the best run of a result is to be trusted.

    Attributes:
        frames: how many were judged: all that show anything new.
        trusted: of these: ``tracked`` or ``rescued``, or ``partial`` in two views or more, with no part of the body
            that the views contradict, and none at all where a camera disagrees.
        parts: numbers of the frames in which a part of the body is in doubt, by part: the views contradict it, or its
            joints may be over 100 mm off.
        cameras: by how much each camera that disagrees with the others does [mm at the body].
        repeated: how many frames repeat the one before.
        frozen: numbers of the frames in which a camera repeats its last image while the others go on, by camera.
        problem: why masks and calibration fit no body, where they were trusted all the same.
    """

    frames: int
    trusted: int
    parts: dict[str, list[int]]
    cameras: dict[str, float]
    repeated: int
    frozen: dict[str, list[int]]
    problem: str | None = None

    @property
    def holds(self) -> bool:
        """Whether most of the clip is trusted."""
        return 2 * self.trusted >= self.frames

    def lines(self, scene: Path | None = None) -> list[str]:
        """The verdict in words, with what to do next about the cameras of a ``scene``."""
        lines = [f"{self.trusted} of {self.frames} frames trusted"]
        if self.problem is not None:
            lines.append(f"masks and calibration fit no body: {self.problem}")
        if self.cameras:
            names, lengths = " and ".join(self.cameras), " and ".join(f"{mm:.0f}" for mm in self.cameras.values())
            remedy = f"; mend it with: mmocap calib refine {scene}" if scene and not self.problem else ""
            verb = "disagrees" if len(self.cameras) == 1 else "disagree"
            lines.append(f"{names} {verb} with the others by {lengths} mm at the body{remedy}")
        if self.repeated:
            lines.append(f"{self.repeated} more frames repeat the one before, and count as not seen")
        lines += [f"{name} is frozen in {_ranges(frames)}, and left out there" for name, frames in self.frozen.items()]
        return lines + [f"in doubt: {part} in {_ranges(frames)}" for part, frames in self.parts.items()]


def verdict(result: Result) -> Verdict:
    """How far a result is to be trusted; what was not looked at, as in results of earlier versions, speaks for it."""
    best, body, size = result.best_run, result.subject.body, result.subject.body.relative_size
    seen = np.isfinite(result.iou[best]).sum(axis=1) >= _MIN_VIEWS
    status = result.status[best]
    trusted = np.isin(status, [STATUS.index(name) for name in ("tracked", "partial", "rescued")]) & seen
    # Cameras: in the middle of the frames in which the body was found.
    cameras = {}
    if result.view_shift is not None and trusted.any():
        shift = result.view_shift[best][trusted]
        known = [k for k in range(shift.shape[1]) if np.isfinite(shift[:, k]).any()]
        middle = {result.cameras.names[k]: float(np.nanmedian(shift[:, k])) for k in known}
        most = max(middle.values())
        if most > _MAX_SHIFT * size:
            off = sorted(
                (name for name in middle if middle[name] > _NAMED_SHARE * most), key=lambda name: -middle[name]
            )
            cameras = {name: 1000 * middle[name] for name in off if middle[name] > _NAMED_SHARE * most}
    # Parts of the body.
    doubt = np.zeros((len(status), len(body.skeleton.parts)), bool)
    if result.part_doubt is not None:
        doubt = result.part_doubt[best] > 0
        trusted &= ~doubt.any(axis=1)
    if result.joint_sigma is not None:
        vague = np.linalg.norm(result.joint_sigma[best], axis=-1) > _MAX_SIGMA * size
        for joint, part in enumerate(body.skeleton.part):
            doubt[:, part] |= vague[:, joint]
    parts = {
        name: result.frame_numbers[doubt[:, i]].tolist()
        for i, name in enumerate(body.skeleton.parts)
        if doubt[:, i].any()
    }
    frozen = {
        name: [frame for frame in frames if frame in result.frame_numbers]
        for name, frames in result.config.get("frozen_views", {}).items()
    }
    repeated = status == STATUS.index("repeated")
    problem = result.config.get("trusted_cameras")
    count = 0 if cameras or problem else int(trusted.sum())
    return Verdict(int((~repeated).sum()), count, parts, cameras, int(repeated.sum()), frozen, problem)


def _ranges(frames: Sequence[int]) -> str:
    """Frame numbers for people, as ``3 to 9 and 12``."""
    runs = np.split(frames, np.flatnonzero(np.diff(frames) > 1) + 1)
    words = [f"{run[0]}" if len(run) == 1 else f"{run[0]} to {run[-1]}" for run in runs]
    more = [f"{len(words) - _SHOWN_RANGES} more ranges"] if len(words) > _SHOWN_RANGES else []
    return f"frames {', '.join(words[:_SHOWN_RANGES] + more)} ({len(frames)} in all)"
