"""Which frames a page holds, so that it stays small: poses of some, masks and images perhaps of fewer."""

from __future__ import annotations

from dataclasses import dataclass

from mmocap_warp.result.result import Result

_POSE_BYTES = 2_400_000  # of all poses, base64 left out; a joint takes 14
_JOINT_BYTES = 14


@dataclass(frozen=True)
class Pictures:
    """What the cameras saw in some of a page's frames.

    Attributes:
        of: per camera, base64 of the pictures; None where there is none.
        every: in how many of the page's frames there is one, the first always among them.
    """

    of: list[list[str | None]]
    every: int

    @classmethod
    def within(cls, characters: int, of: list[list[str | None]]) -> Pictures:
        """As many of a picture for each frame as have room."""
        total = sum(len(picture or "") for pictures in of for picture in pictures)
        every = max(1, -(-total // characters))
        return cls([pictures[::every] for pictures in of], every)


def pose_step(result: Result) -> int:
    """A page has room for the poses of every so manieth frame."""
    runs, frames, _ = result.pose.shape
    tracks = runs * (1 if result.raw_pose is None else 2)
    return max(1, -(-frames * tracks * len(result.subject.body.skeleton.joints) * _JOINT_BYTES // _POSE_BYTES))


def sentence(rate: float, step: int, masks: Pictures | None, images: Pictures | None) -> str:
    """What a page says that it holds: every so manieth frame, ``rate`` a second."""
    parts = [f"poses of {_frames(step)} ({rate:.3g} a second)"]
    if masks is not None:
        parts.append(f"masks of {_frames(step * masks.every)}")
    if images is not None:
        parts.append(f"images of {_frames(step * images.every)}")
    between = "" if step == 1 else " Between them, the body moves evenly."
    return f"This page holds {', '.join(parts)}.{between}"


def _frames(step: int) -> str:
    return "every frame" if step == 1 else f"one frame in {step}"
