"""What commands are given: a scene, a result, a body or a subject, each as an object or as the path of its file."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

import numpy as np

from mmocap_warp.body.model import BodyModel, Subject
from mmocap_warp.calibration.first_look import look
from mmocap_warp.commands.reporter import Reporter
from mmocap_warp.commands.settings import arguments_checked
from mmocap_warp.errors import InputError, UsageError
from mmocap_warp.formats.truth_file import load_truth
from mmocap_warp.formats.usd.usd_body import read_subject
from mmocap_warp.formats.usd.usd_result import read_result
from mmocap_warp.masks.cleanup import clean_mask, rivals
from mmocap_warp.masks.mask_image import Labels, decode_mask
from mmocap_warp.result.result import Result
from mmocap_warp.result.truth import Truth
from mmocap_warp.rigging.shipped import DEFAULT_BODY, load_body
from mmocap_warp.scene.frame_choice import FrameChoice
from mmocap_warp.scene.recording import CameraSource, Scene
from mmocap_warp.scene.scene_toml import load_scene

Frames: TypeAlias = str | int | range | None
"""Which frames: ``"first:end"``, ``"first:end:stride"`` or a range by the recording's numbers, or a count."""

_SAMPLES = 5
"""Mask images of a camera that are searched for a second person."""


def scene_from(
    scene: Scene | str | Path, frames: Frames = None, identity: int | None = None, *, calibrated: bool = True
) -> Scene:
    """A scene by its file or folder, or as it is; of it the frames and the person that are asked for.

    Args:
        scene: the scene.
        frames: which of its frames; None for those that it names.
        identity: of the person, where masks show several.
        calibrated: whether there must be a calibration.

    Raises:
        InputError: the scene is wrong.
        UsageError: it does not have these frames, or no identities.
        TypeError: it is neither.
    """
    if isinstance(scene, str | Path):
        with arguments_checked():
            return load_scene(scene, _frames_text(frames), identity, calibrated=calibrated)
    if not isinstance(scene, Scene):
        raise TypeError(f"scene must be a Scene or the path of one, not a {type(scene).__name__}")
    if identity is not None:
        if scene.foreground.source != "masks":
            raise UsageError("--identity chooses among given masks; this scene's are subtracted")
        scene = replace(scene, foreground=replace(scene.foreground, identity=identity))
    if (text := _frames_text(frames)) is None:
        return scene
    with arguments_checked():
        return scene.of_frames(FrameChoice.parse(text).of(scene.frames, scene.recorded_frames))


def _frames_text(frames: Frames) -> str | None:
    """A choice of frames as :class:`FrameChoice` reads it."""
    if isinstance(frames, range):
        return f"{frames.start}:{frames.stop}:{frames.step}"
    return None if frames is None else str(frames)


def result_from(result: Result | str | Path) -> tuple[Result, Path | None]:
    """A result and the file that it lies in, if it is given as a file.

    Raises:
        InputError: the file holds no result.
        TypeError: it is neither.
    """
    if isinstance(result, Result):
        return result, None
    if not isinstance(result, str | Path):
        raise TypeError(f"result must be a Result or the path of one, not a {type(result).__name__}")
    return read_result(result), Path(result)


def body_from(body: BodyModel | str | Path | None, scene: Scene) -> BodyModel:
    """A body, by the name of a shipped one or its file; the scene's, or else the default, where none is named.

    Raises:
        InputError: there is no such body.
        TypeError: it is something else.
    """
    if isinstance(body, BodyModel):
        return body
    if not isinstance(body, str | Path | None):
        raise TypeError(f"body must be a BodyModel, the name of one or its path, not a {type(body).__name__}")
    return load_body(body or scene.body or DEFAULT_BODY, "--body" if body else scene.path)


def subject_from(subject: Subject | str | Path) -> Subject:
    """A subject, perhaps by its file.

    Raises:
        InputError: the file holds no subject.
    """
    return subject if isinstance(subject, Subject) else read_subject(subject)


def positions_of(result: Result, frames: Frames) -> list[int]:
    """Positions in a result of the frames that are asked for; all of them where none are.

    Raises:
        UsageError: it has none of these frames.
    """
    numbers, text = result.frame_numbers.tolist(), _frames_text(frames)
    if text is None:
        return list(range(len(numbers)))
    with arguments_checked():
        choice = FrameChoice.parse(text)
        if choice.count is not None:
            return list(choice.of(range(len(numbers)), len(numbers)))
        chosen = choice.of(range(0), max(numbers[-1] + 1, choice.end or 0))
    positions = [position for position, number in enumerate(numbers) if number in chosen]
    if not positions:
        raise UsageError(f"--frames = {text} holds none of the result's frames, {numbers[0]} to {numbers[-1]}")
    return positions


def scene_reference(scene: Path, file: Path | None) -> str:
    """How a result or a subject names its scene: relative to its own file, so that both can move together."""
    scene = scene.resolve()
    return scene.as_posix() if file is None else Path(os.path.relpath(scene, file.resolve().parent)).as_posix()


def scene_of(
    result: Result, path: Path | None, named: Scene | str | Path | None, reporter: Reporter | None = None
) -> Scene | None:
    """The scene that was tracked: the one named now, or else the one that the result names; None if neither is.

    Raises:
        InputError: the scene is wrong, or is no longer where the result says.
    """
    reference = result.config.get("scene")
    if named is None and reference is not None and path is None and not Path(reference).is_absolute():
        line = f"the scene {reference} is named from the result's file, which is not known: give scene, or that file"
        (reporter or Reporter()).warn(line)
        return None
    return recorded_scene(reference, path, named, result.config.get("identity"))


def recorded_scene(
    reference: str | None, path: Path | None, named: Scene | str | Path | None, identity: int | None = None
) -> Scene | None:
    """The scene that was recorded for what lies at ``path``: the one named now, or the one that it refers to.

    Args:
        reference: how it names its scene; None where it does not.
        path: its file; None for what is in memory alone, whose reference counts if it is an absolute path.
        named: the scene, or its path.
        identity: of the person, where one was chosen.

    Returns:
        None where no scene is known.

    Raises:
        InputError: the scene is wrong, or is no longer where the reference says.
    """
    if named is not None:
        return named if isinstance(named, Scene) else load_scene(named, identity=identity)
    if reference is None or (path is None and not Path(reference).is_absolute()):
        return None
    recorded = Path(reference) if path is None else path.parent / reference
    if not recorded.exists():
        problem = f"was made from {recorded}, which is not there"
        raise InputError(path or "result", problem, "name the scene with --scene")
    return load_scene(recorded, identity=identity)


def truth_of(scene: Scene | None) -> Truth | None:
    """The truth that the scene names."""
    if scene is None or scene.truth is None:
        return None
    return load_truth(scene.truth, scene.truth_axes)


def note_others(scene: Scene, reporter: Reporter) -> None:
    """Say where given masks show more than one person, and how to choose: one person is tracked at a time."""
    if scene.foreground.source != "masks" or scene.foreground.identity:
        return
    for source in scene.cameras:
        if (line := _others(scene, source)) is not None:
            reporter.note(f"{source.name} {line}")
            return  # the other cameras see the same people


def _others(scene: Scene, source: CameraSource) -> str | None:
    """What a camera's masks show besides one person."""
    if source.masks is None:
        return None
    images = list(source.masks.sample(_SAMPLES))
    labels = sorted({identity for image in images if isinstance(image, Labels) for identity in image.identities})
    if len(labels) > 1:
        listed = ", ".join(map(str, labels[:8]))
        return f"shows {len(labels)} objects ({listed}), which are taken for one person; choose one with --identity"
    # Two blobs of about equal size in most of the images are two people.
    scale = source.mask_mark.scale if source.mask_mark else source.recorded_scale
    whole = replace(scene.foreground, keep="all")
    masks = [clean_mask(decode_mask(image, soft=source.masks.soft), whole, scale) for image in images]
    pairs = [areas for mask in masks if (areas := rivals(mask, scene.foreground.join * scale)) is not None]
    if 2 * len(pairs) < len(images):
        return None
    remedy = {
        "all": 'set [foreground] keep = "nearest" to follow one',
        "largest": 'the larger one is kept in each frame: set [foreground] keep = "nearest" to follow one',
        "nearest": "the larger one in the first frame is followed",
    }[scene.foreground.keep]
    larger, smaller = pairs[0]
    return (
        f"shows two blobs of about equal size ({larger} and {smaller} px), and one person is tracked at a time:"
        f" {remedy}, or make masks of one person (docs/masks.md)"
    )


def look_first(
    scene: Scene,
    body: BodyModel | None,
    reporter: Reporter,
    trust: bool,
    *,
    start: Subject | None = None,
    to_be_mended: bool = False,
) -> dict[str, str]:
    """See whether masks and calibration can be of one body before anything is tracked; doubts are noted.

    Args:
        scene: the recording.
        body: who is to be tracked; None where the size does not count.
        reporter: who is told of doubts.
        trust: go on even if they cannot.
        start: the subject, where it is known.
        to_be_mended: small errors of cameras and times are about to be put right.

    Returns:
        What a result or a subject says of a problem that was not heeded, by the name of its entry.

    Raises:
        InputError: they fit no body.
    """
    looked = look(scene, body, start=start, to_be_mended=to_be_mended)
    if looked.problem is not None and not trust:
        remedy = f"{looked.remedy}; or go on with --trust-cameras"
        raise InputError(scene.path, looked.problem, remedy)
    for doubt in (*looked.doubts, *([f"{looked.problem}, and is trusted"] if looked.problem else [])):
        reporter.note(f"cameras: {doubt}")
    return {"trusted_cameras": looked.problem} if looked.problem else {}


def span(frames: Sequence[int] | np.ndarray) -> str:
    """Frame numbers for people: the first, the last and how many there are."""
    return f"{frames[0]} to {frames[-1]} ({len(frames)})"
