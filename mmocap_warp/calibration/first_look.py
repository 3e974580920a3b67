"""A look at a recording before the first frame: can its masks and its calibration be of one body?

A second or two on a few small frames. Refused is what fits no body: views that agree again after a trial repair, which
names the mistake; views that agree on nothing; and a subject of a wrong size. What hides a limb is at most a doubt.
"""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mmocap_warp.body.model import BodyModel, Subject
from mmocap_warp.body.posing import Poser
from mmocap_warp.calibration.gross_mistake import Agreement, Mistake, Silhouettes, agreement, find_mistake
from mmocap_warp.cameras.rig import METRES, CameraRig
from mmocap_warp.cameras.silhouette import silhouettes
from mmocap_warp.masks.cleanup import rivals
from mmocap_warp.masks.frames import VideoFile
from mmocap_warp.scene.recording import Scene

_FRAMES = 6  # frames that are looked at
_SIDE = 320  # pixels of the longest side of an image
_DIAMETER = 80.0  # pixels of the circle about a subject: where it has fewer, larger images are read
_MIN_DIAMETER = 40.0  # pixels: smaller silhouettes tell too little
_READ_SECONDS = 1.0  # of a recording that must be read in order, as a video; others are looked at from end to end
_FULL = 0.7  # share of an image that nobody fills: black and white are exchanged
_TWO_PEOPLE = 0.65  # share of the views that show two blobs. Somebody who walks by makes .57
_MIN_SHARE = 0.35  # of the masks that the others explain. Sound views with half a body hidden in two reach .6
_DOUBTFUL = 0.85  # share below which views are in doubt
_STRANGER, _WITHOUT = 0.3, 0.9  # explained share of a view that shows something else; of the others without it
_LEFT = 0.35  # share of the disagreement that is left without a view that disagrees
_SOUND = 0.96  # share of views of which none is in doubt
_SMALL, _LARGE = 0.3, 1.75  # extent over the body's. People have .4 to 1.1, a calibration in feet makes that 2 and more
_UNIT_NAMES = {"m": "metres", "mm": "millimetres", "cm": "centimetres", "in": "inches", "ft": "feet"}
_UNITS = {
    (unit, read): METRES[read] / METRES[unit] for read in ("m", "mm") for unit in METRES if unit != read
}  # by how much too large it makes the subject to read a unit as another
_UNIT_RATIO = 1.8  # by which a unit may miss the sizes' ratio
_STAYS = 'source = "recording" takes for background what stays; name a clean_plate; '  # where nobody is seen, or parts
_STANDING = 0.8  # extent of somebody who stands over that of the body at rest, whose arms are spread


@dataclass(frozen=True)
class FirstLook:
    """What a look showed."""

    problem: str | None = None  # why no body can be tracked; None where nothing speaks against it
    remedy: str = ""  # what to do about the problem
    doubts: tuple[str, ...] = ()  # what may be wrong, a sentence each


def look(
    scene: Scene,
    body: BodyModel | None,
    *,
    start: Subject | None = None,
    to_be_mended: bool = False,
    views: "FewViews | None" = None,
) -> FirstLook:
    """Look at a few frames of a scene, which has a calibration.

    ``body`` is who is to be tracked, for the size; None where the size does not count. Masks with ``keep = "nearest"``
    are those near the first pose of ``start``. Cameras and times ``to_be_mended`` may be off; ``views`` may be known.
    Raises an InputError for images that cannot be read.
    """
    views = views or few_views(scene, start)
    rig, compared = views.rig, views.compared
    if len(rig) < 2:
        return FirstLook(f"has one view, {rig.names[0]}, and two or more are needed", "add a camera")
    problem, remedy = _mask_fault(scene, rig, views.frames)
    if problem is not None:
        return FirstLook(problem, remedy)
    seen = {k for frame in compared for k in frame.seeing}
    doubts = [f"{name} shows nobody in {len(compared)} frames" for k, name in enumerate(rig.names) if k not in seen]
    if not views.large_enough:
        return FirstLook(doubts=tuple(doubts))
    # The calibration, by all views together.
    check = f"check with: mmocap calib check {shlex.quote(str(scene.path))}"
    check = _STAYS * (scene.foreground.source == "recording") + check
    # Where something may be in front, views differ for that, and hundreds of repairs would be tried in vain.
    now, mistake = (agreement(rig, compared), None) if scene.has_others else views.mistake()
    if mistake is not None:
        found = f"{100 * now.share:.0f} % of the masks lie in the other views' hull, and nearly all after a repair"
        return FirstLook(f"{mistake} ({found})", check)
    if now.share < _DOUBTFUL and scene.foreground.keep == "largest":  # in each view it may be somebody else
        everybody = replace(scene, foreground=replace(scene.foreground, keep="all"))
        problem, remedy = _mask_fault(everybody, *few_masks(everybody))
        if problem is not None:
            return FirstLook(problem, remedy)
    if body is not None and (wrong_size := _wrong_size(scene, body, now.extent)) is not None:
        return wrong_size
    # One view, and what none of them explains.
    stranger, without = _worst_view(rig, compared, now)
    if stranger is not None and without >= _WITHOUT and now.explained[stranger] < _STRANGER:
        problem = f"{rig.names[stranger]} shows something else than the others, or its calibration is wrong: they agree"
        problem += f" on {100 * without:.0f} % without it, and on {100 * now.explained[stranger]:.0f} % of its masks"
    elif now.share < _MIN_SHARE:
        problem = f"the views have no common hull: the others explain {100 * now.share:.0f} % of a mask"
        check = f"are masks and calibration of one recording, of one person, and in step? {check}"
    if problem is not None and not to_be_mended:
        return FirstLook(problem, check, tuple(doubts))
    if problem is None and stranger is not None:
        problem = f"{rig.names[stranger]} disagrees with the other views, or something hides the subject there"
    elif problem is None and now.share < _DOUBTFUL:
        problem = f"the views disagree: the others explain {100 * now.share:.0f} % of a mask"
    return FirstLook(doubts=(*doubts, *([f"{problem}; {check}"] if problem is not None else [])))


class FewViews:
    """A few frames of a scene, in images that are large enough to compare the views where the recording has such."""

    def __init__(self, rig: CameraRig, frames: Sequence[list[np.ndarray]]) -> None:
        self.rig = rig  # the cameras at the masks' size
        self.frames = frames  # per frame and camera (height, width) bool
        self.compared = [Silhouettes.of(masks) for masks in frames]  # what is compared of each frame

    @property
    def diameter(self) -> float:
        """The median of the circles about the masks [px]; NaN where nobody is seen."""
        diameters = np.concatenate([frame.diameters for frame in self.compared])
        return float(np.median(diameters[np.isfinite(diameters)])) if np.isfinite(diameters).any() else float("nan")

    @property
    def large_enough(self) -> bool:
        """Whether the subject is so large that its silhouettes tell of the cameras."""
        return self.diameter >= _MIN_DIAMETER

    def mistake(self) -> tuple[Agreement, Mistake | None]:
        """How well the views agree, and the gross mistake after whose repair they do, if there is one."""
        now = agreement(self.rig, self.compared)
        return now, find_mistake(self.rig, self.compared, now)


def few_views(scene: Scene, start: Subject | None = None) -> FewViews:
    """A few frames of a scene; ``start`` is the subject, where it is known."""
    views = FewViews(*few_masks(scene, _SIDE, start))
    if views.diameter < _DIAMETER < int(scene.calibrated.size.max()):
        views = FewViews(*few_masks(scene, round(_SIDE * min(4.0, _DIAMETER / views.diameter)), start))
    return views


def few_masks(
    scene: Scene, side: int = _SIDE, start: Subject | None = None
) -> tuple[CameraRig, list[list[np.ndarray]]]:
    """Cameras whose images' longest side is ``side`` [px], and masks of a few frames."""
    given, follows = scene.foreground.source == "masks", scene.foreground.keep == "nearest"
    sources = [camera.masks if given else camera.video for camera in scene.cameras]
    last = scene.frame_count - 1
    if follows or any(isinstance(source, VideoFile) for source in sources):
        last = min(last, round(_READ_SECONDS * scene.rate))
    count = min(_FRAMES, last + 1)
    step = last // max(1, count - 1) or 1
    few = scene.of_frames(scene.frames[: (count - 1) * step + 1 : step])
    few = replace(few, foreground=replace(scene.foreground, repair=False))
    scale = min(1.0, side / int(scene.calibrated.size.max()))
    rig = few.rig(scale)
    if not follows or start is None:
        return rig, list(few.masks(scale))
    # The subject is followed from its first pose on.
    vertices = Poser(start.body, start.root_base).tracking_vertices(start.pose)[0]
    frames = [silhouettes(rig, vertices, start.body.tracking_face)]
    for masks in few.masks(scale, body=lambda: frames[-1]):
        frames.append(masks)
    return rig, frames[1:]


def _mask_fault(scene: Scene, rig: CameraRig, frames: Sequence[list[np.ndarray]]) -> tuple[str | None, str]:
    """What is wrong with the masks by themselves, and what to do; None where nothing is."""
    remedy = "docs/masks.md says how to make masks; look at them with: mmocap mask"
    shares = np.array([[mask.mean() for mask in masks] for masks in frames])
    for name, share in zip(rig.names, np.median(shares, axis=0), strict=True):
        if share > _FULL:
            problem = f"{name}'s masks are {100 * share:.0f} % foreground: are black and white exchanged?"
            return problem, f"foreground must be white; {remedy}"
    if ((shares > 0).sum(axis=1) < 2).all():
        empty = ", ".join(name for name, share in zip(rig.names, shares.T, strict=True) if not share.any())
        problem = f"no two views show anybody in {len(frames)} frames{f'; {empty} show nobody at all' * bool(empty)}"
        return problem, _STAYS * (scene.foreground.source == "recording") + remedy
    # Two blobs of about equal size, in most views most of the time, are two people.
    scale = float(rig.size.max() / scene.calibrated.size.max())
    seen = filter(None, ([mask for mask in masks if mask.any()] for masks in frames))
    several = [np.mean([rivals(mask, scene.foreground.join * scale) is not None for mask in masks]) for masks in seen]
    if np.median(several) > _TWO_PEOPLE:
        remedy = 'choose one (--identity), follow one ([foreground] keep = "nearest"), or track both ([labels] several)'
        return "the masks show two people (or two parts) of about equal size in most views", remedy
    return None, ""


def _worst_view(rig: CameraRig, frames: list[Silhouettes], now: Agreement) -> tuple[int | None, float]:
    """The view without which the others agree, and their share then; None where there is none, or too few are left."""
    if now.share >= _SOUND or len(rig) < 4:
        return None, now.share
    others = ([replace(frame, seeing=[j for j in frame.seeing if j != k]) for frame in frames] for k in range(len(rig)))
    shares = [agreement(rig, each).share for each in others]
    worst = int(np.argmax(shares))
    return (worst, shares[worst]) if 1 - shares[worst] <= _LEFT * (1 - now.share) else (None, now.share)


def _wrong_size(scene: Scene, body: BodyModel, extent: float) -> FirstLook | None:
    """What to say where the subject's size is not the body's; None where it may be."""
    size = np.ptp(body.skin.rest[body.own_vertex], axis=0)
    ratio = extent / float(np.linalg.norm(size))
    if not np.isfinite(extent) or _SMALL < ratio < _LARGE:
        return None
    off = {each: abs(np.log(ratio / _STANDING / by)) for each, by in _UNITS.items()}
    unit, read = min(off, key=lambda each: off[each])
    known = off[unit, read] < np.log(_UNIT_RATIO)
    why = f", as if {_UNIT_NAMES[unit]} had been read as {_UNIT_NAMES[read]}" if known else ""
    return FirstLook(
        f"the subject is {_length(extent)} large, and the body {body.name} {_length(float(size.max()))}: its unit of"
        f" length is wrong{why}",
        f"give {scene.calibration or 'the calibration'} in metres, or say its unit: [cameras] units = "
        f'"{unit if known else "mm"}"; or name a body of that size',
    )


def _length(metres: float) -> str:
    return f"{metres:.3g} m" if metres >= 0.1 else f"{1000 * metres:.3g} mm"
