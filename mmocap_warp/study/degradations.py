"""What makes a recording harder: fewer cameras, fewer frames, a wrong calibration, bystanders, parts cut away.

Each takes a clip as a tracker is given it and gives it back made worse; the masks are changed as they are asked for.
They are named as in ``views=3``; several are joined by ``+``. With ``labelled``, who or what gets in the way has a
label of its own, as in label images: it is no foreground, but may hide the subject.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import combinations, islice
from pathlib import Path
from typing import Any

import numpy as np

from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.formats.truth_file import write_truth
from mmocap_warp.formats.usd.usd_body import write_subject
from mmocap_warp.masks.observation import Observation, unpack_masks
from mmocap_warp.study.sequences import StudySequence
from mmocap_warp.study.source import OpenClip, open_sequence
from mmocap_warp.synthesis.bystanders import PasserBy, furniture
from mmocap_warp.synthesis.footage.together import Together, places, shifted_truth
from mmocap_warp.synthesis.writing import Progress, write_made_scene

NONE = "none"
"""The recording as it is."""

LABELLED = "labelled"
"""Whatever hides the person has a label: what else the degradations put there, and garments."""

Masks = list[np.ndarray]
"""Per camera (height, width) bool."""

_APART = 0.8  # distance of bystanders from the path of the person who is tracked [m]
_CUT_SECONDS = 0.5
_CUT_SHARE = 0.5  # width and height of the block that is cut out, as a share of the person's height


def fewer_views(clip: OpenClip, count: int) -> OpenClip:
    """The ``count`` cameras whose directions of view differ most; opposite directions count as alike."""
    rig = clip.rig
    chosen = most_different_views(rig, count)

    def of_chosen(seen: Observation) -> Observation:
        masks, hidden = unpack_masks(seen.words, rig.size), seen.unpacked_hidden(rig.size)
        late = None if seen.late is None else seen.late[list(chosen)]
        in_front = None if hidden is None else [hidden[k] for k in chosen]
        return Observation.from_masks([masks[k] for k in chosen], late, in_front)

    observations = map(of_chosen, clip.observations)
    return replace(clip, rig=rig.select(tuple(rig.names[k] for k in chosen)), observations=observations)


def most_different_views(rig: CameraRig, count: int) -> tuple[int, ...]:
    """Positions, ascending, of ``count`` cameras, the two most alike of which differ as much as can be.

    Opposite views count as alike: their silhouettes are mirror images. Raises a ValueError for fewer cameras.
    """
    if not 1 <= count <= len(rig):
        raise ValueError(f"views must be 1 to {len(rig)}, got {count}")
    ahead = rig.R[:, 2]
    alike = np.abs(ahead @ ahead.T).round(9) - 2 * np.eye(len(rig))
    return min(combinations(range(len(rig)), count), key=lambda chosen: float(alike[np.ix_(chosen, chosen)].max()))


def fewer_frames(clip: OpenClip, fps: float) -> OpenClip:
    """Every second, third, ... frame, numbered anew; a ValueError if the rate does not divide the clip's."""
    step, truth = round(min(clip.fps / fps, 1e6)), clip.truth
    if step < 1 or abs(clip.fps - step * fps) > 1e-6 * clip.fps:
        raise ValueError(f"fps must divide the clip's {clip.fps:g}, got {fps:g}")
    if truth is not None:
        truth = truth.at_frames(truth.frame_numbers % step == 0)
        truth = replace(truth, fps=fps, frame_numbers=truth.frame_numbers // step)
    seen = islice(clip.observations, 0, None, step)
    return replace(clip, fps=fps, frames=-(-clip.frames // step), truth=truth, observations=seen)


def wrong_calibration(clip: OpenClip, pixels: float, seed: int) -> OpenClip:
    """Each camera's principal point off by so many pixels, in a direction of its own: to first order a turned camera.

    Masks stay as they are; pixels are at the scale of the clip.
    """
    angle = np.random.default_rng([seed, 6]).uniform(0, 2 * np.pi, len(clip.rig))
    K = clip.rig.K.copy()
    K[:, :2, 2] += pixels * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return replace(clip, rig=replace(clip.rig, K=K))


def passed_by(clip: OpenClip, labelled: bool = False) -> OpenClip:
    """Another person walks by, nearest in the middle of the clip, and is taken for foreground."""
    other = PasserBy(clip.rig, *_clear_circle(clip))
    times = (np.arange(clip.frames) - clip.frames / 2) / clip.fps
    return _with_others(clip, lambda frame: other.silhouettes(times[frame]), lambda f: other.place(times[f]), labelled)


def furnished(clip: OpenClip, labelled: bool = False) -> OpenClip:
    """A chest stands there that the background was taken without: it is foreground in every frame."""
    chest, place = furniture(clip.rig, *_clear_circle(clip))
    return _with_others(clip, lambda _: chest, lambda _: place, labelled)


def cut_out(clip: OpenClip, views: int, labelled: bool = False) -> OpenClip:
    """For half a second in the middle, a block about the person's middle is missing in the first ``views`` views.

    It stays where it is, and is half as wide and as high as the person stands when it begins.
    """
    half, blocks = round(_CUT_SECONDS / 2 * clip.fps), {}

    def cut(frame: int, masks: Masks) -> tuple[Masks, Masks | None]:
        hidden = [np.zeros_like(mask) for mask in masks] if labelled else None
        for k, mask in enumerate(masks[:views] if -half <= frame - clip.frames // 2 < half else ()):
            if k not in blocks and mask.any():
                rows, columns = np.nonzero(mask)
                reach = round(_CUT_SHARE / 2 * (rows.max() + 1 - rows.min()))
                row, column = round(rows.mean()), round(columns.mean())
                blocks[k] = np.s_[max(row - reach, 0) : row + reach, max(column - reach, 0) : column + reach]
            if k in blocks:
                mask[blocks[k]] = False
                if hidden is not None:
                    hidden[k][blocks[k]] = True
        return masks, hidden

    return _with_masks(clip, cut)


# From a clip, an amount, a seed, and whether what is in the way is labelled.
_Step = Callable[[OpenClip, float, int, bool], OpenClip]
_STEPS: dict[str, tuple[_Step, str]] = {  # in the order in which they are done, with what stands for the amount
    "passer-by": (lambda clip, amount, seed, labelled: passed_by(clip, labelled), ""),
    "furniture": (lambda clip, amount, seed, labelled: furnished(clip, labelled), ""),
    "fps": (lambda clip, amount, seed, labelled: fewer_frames(clip, amount), "RATE"),
    "views": (lambda clip, amount, seed, labelled: fewer_views(clip, round(amount)), "COUNT"),
    "cut": (lambda clip, amount, seed, labelled: cut_out(clip, round(min(amount, 1e6)), labelled), "VIEWS"),
    "calibration": (lambda clip, amount, seed, labelled: wrong_calibration(clip, amount, seed), "PIXELS"),
    LABELLED: (lambda clip, amount, seed, labelled: clip, ""),
}
# How degradations are written.
_FORMS = tuple(f"{name}={amount}" if amount else name for name, (_, amount) in _STEPS.items())


def parse(text: str) -> dict[str, float]:
    """Amounts by the names in ``_FORMS``, infinite for ``all``; a ValueError for what is not as in these."""
    if text == NONE:
        return {}
    amounts: dict[str, float] = {}
    for step in text.split("+"):
        name, given, amount = step.partition("=")
        if name not in _STEPS or bool(given) != bool(_STEPS[name][1]) or name in amounts:
            raise ValueError(f"degradation must be {NONE} or {', '.join(_FORMS)}, or some joined by +, got {text!r}")
        try:
            amounts[name] = float("inf") if amount == "all" and name == "cut" else float(amount or 0)
        except ValueError:
            raise ValueError(f"degradation {name} takes a number, got {amount!r}") from None
        if given and amount != "all" and not 0 < amounts[name] < float("inf"):
            raise ValueError(f"degradation {name} must be above zero and finite, got {amount}")
    return amounts


def degraded(clip: OpenClip, text: str, seed: int) -> OpenClip:
    """A clip made worse, as ``text`` says.

    The clip's masks are used up. Bystanders come first and the calibration last, however it is written. Raises a
    ValueError for a text that means nothing, or nothing to this clip.
    """
    amounts = parse(text)
    for name, (step, _) in _STEPS.items():
        if name in amounts:
            clip = step(clip, amounts[name], seed, LABELLED in amounts)
    return clip


def _with_masks(clip: OpenClip, change: Callable[[int, Masks], tuple[Masks, Masks | None]]) -> OpenClip:
    """The clip whose masks are changed, frame by frame; what is changed may be the masks given.

    ``change`` gives masks, and what else may be in front of the person.
    """

    def changed(observations: Iterator[Observation]) -> Iterator[Observation]:
        for frame, seen in enumerate(observations):
            masks, added = change(frame, unpack_masks(seen.words, clip.rig.size))
            hidden = seen.unpacked_hidden(clip.rig.size)
            if added is not None and hidden is not None:
                added = [one | other for one, other in zip(added, hidden, strict=True)]
            yield Observation.from_masks(masks, seen.late, hidden if added is None else added)

    return replace(clip, observations=changed(clip.observations))


def _with_others(
    clip: OpenClip, others: Callable[[int], Masks], place: Callable[[int], np.ndarray], labelled: bool
) -> OpenClip:
    """The clip in whose frames others, who are in a place (3,) [m], are foreground, too, or labelled as things."""
    root, ahead = _roots(clip), clip.rig.R[:, 2]

    def joined(frame: int, masks: Masks) -> tuple[Masks, Masks | None]:
        theirs = others(frame)
        if not labelled:
            return [mask | other for mask, other in zip(masks, theirs, strict=True)], None
        # A pixel that shows both has the label of who is nearer.
        nearer = ahead @ (place(frame) - root[min(frame, len(root) - 1)]) < 0
        views = zip(masks, theirs, nearer, strict=True)
        return [mask & ~(other & in_front) for mask, other, in_front in views], theirs

    return _with_masks(clip, joined)


def _roots(clip: OpenClip) -> np.ndarray:
    """(frame, 3) where the person is [m], of the first frame alone where no more is known."""
    joint = clip.subject.body.skeleton.joints[0]
    if clip.truth is not None and joint in clip.truth.joint_names:
        return clip.truth.joints[:, clip.truth.joint_names.index(joint)]
    return clip.subject.pose[None, :3]


def _clear_circle(clip: OpenClip) -> tuple[np.ndarray, float]:
    """The middle (3,) of the floor that is walked over, and the radius that bystanders keep from it [m]."""
    root, up = _roots(clip), clip.rig.up_vector
    floor = root - np.outer(root @ up, up)
    middle = (np.nanmin(floor, axis=0) + np.nanmax(floor, axis=0)) / 2
    return middle, float(np.nanmax(np.linalg.norm(floor - middle, axis=1))) + _APART


# ---- Writing a shipped sequence as an ordinary scene, whole or made worse, to look at or to track on its own.

_FOREGROUND = """\
# The study tracks these masks as they are, with all their faults.
[foreground]
source = "masks"
keep = "all"
"""

_LABELS = """
[labels]
person = 1
{hider} = 2
"""
_HIDER = 2


def write_sequence(
    folder: str | Path,
    sequence: StudySequence,
    progress: Progress | None = None,
    *,
    degradation: str = NONE,
    seed: int = 0,
) -> Path:
    """Write a sequence as a scene whose observations are the sequence's own, bit for bit, or these made worse.

    The folder gets ``masks/<camera>/<frame>.png`` (1 bit), ``calibration.toml``, ``truth.usdc`` (true markers with
    their noise, joints and poses), ``subject.usdc`` (where tracking starts) and last ``scene.toml``, whose path is
    returned. Files of the same names are replaced. ``progress`` is called after each frame.

    Raises:
        InputError: a folder that cannot be written to.
        ValueError: a degradation that means nothing to this sequence.
    """
    labelled = LABELLED in parse(degradation)
    worse = degraded(open_sequence(sequence, labelled), degradation, seed)
    about = f"{sequence.name} of the study's shipped sequences, made up with known truth."
    if degradation != NONE:
        about += f" Made worse: {degradation}, seed {seed}."
    footage, truth = _Streamed(worse, labelled), worse.truth or sequence.truth
    hider = "thing" if sequence.recording.worn is None else "garment"
    foreground = _FOREGROUND + (_LABELS.format(hider=hider) if labelled else "")
    given: dict[str, Any] = {"name": sequence.name, "subject": sequence.subject, "progress": progress}
    return write_made_scene(Path(folder), footage, truth, about=about, foreground=foreground, **given)


def write_people(folder: Path, clips: Sequence[StudySequence], apart: float, progress: Progress | None = None) -> Path:
    """Write sequences of one length and of different people as one scene, whose masks are label images.

    People are named as in the sequences' names, and come as near to each other as ``apart`` [m]. Each has a subject,
    which tracking starts from, and a truth. The path is that of ``scene.toml``. Raises an InputError for a folder that
    cannot be written to.
    """
    shifts = places([sequence.recording.poses[:, :2] for sequence in clips], apart)
    foreground = _FOREGROUND
    folder.mkdir(parents=True, exist_ok=True)
    for label, (sequence, shift) in enumerate(zip(clips, shifts, strict=True), 1):
        name, pose = sequence.name.split("/")[0], sequence.subject.pose.copy()
        pose[:2] += shift
        write_subject(folder / f"{name}.subject.usdc", replace(sequence.subject, pose=pose))
        write_truth(folder / f"{name}.truth.usdc", shifted_truth(sequence.truth, shift), sequence.rig.up)
        files = f'subject = "{name}.subject.usdc"\ntruth = "{name}.truth.usdc"'
        foreground += f"\n[people.{name}]\nlabel = {label}\n{files}\n"
    names = " and ".join(sequence.name for sequence in clips)
    about = f"{names} of the study's shipped sequences in one room, made up with known truth."
    together = Together([sequence.recording for sequence in clips], shifts)
    return write_made_scene(folder, together, None, name=names, about=about, foreground=foreground, progress=progress)


class _Streamed:
    """A clip as footage."""

    def __init__(self, clip: OpenClip, labelled: bool) -> None:
        self._clip, self._labelled = clip, labelled
        self.fps, self.rig = clip.fps, clip.rig

    def __len__(self) -> int:
        return self._clip.frames

    def masks(self, frame: int) -> list[np.ndarray]:
        """Per camera (height, width) bool, of the next frame; labels where something may be in front."""
        seen = next(self._clip.observations)
        masks, hidden = unpack_masks(seen.words, self.rig.size), seen.unpacked_hidden(self.rig.size)
        if not self._labelled:
            return masks
        hidden = hidden or [np.zeros_like(mask) for mask in masks]
        return [mask + np.uint8(_HIDER) * other for mask, other in zip(masks, hidden, strict=True)]
