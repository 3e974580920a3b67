"""What commands are given: a scene, a result, a body or a subject, each as an object or as the path of its file."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

import cv2
import numpy as np

from mmocap_warp.body.model import BodyModel, Subject
from mmocap_warp.commands.caller import Reporter, arguments_checked, effective
from mmocap_warp.errors import InputError, UsageError
from mmocap_warp.formats.table import read_calibration
from mmocap_warp.formats.toml_table import load_toml, relative_path
from mmocap_warp.masks.cleanup import clean_mask, rivals
from mmocap_warp.masks.mask_image import Labels, decode_mask
from mmocap_warp.result.result import Result
from mmocap_warp.result.truth import Truth
from mmocap_warp.scene.camera_source import CameraSource
from mmocap_warp.scene.drafting import LARGE_IMAGE, tracking_scale
from mmocap_warp.scene.frame_choice import FrameChoice
from mmocap_warp.scene.recording import Scene
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.tracking.track_config import TrackConfig

Frames: TypeAlias = str | int | range | None
"""Which frames: ``"first:end"``, ``"first:end:stride"`` or a range by the recording's numbers, or a count."""

_SAMPLES = 5  # mask images of a camera that are searched for a second person


def scene_from(
    scene: Scene | str | Path,
    frames: Frames = None,
    identity: int | None = None,
    reporter: Reporter | None = None,
    *,
    calibrated: bool = True,
    source: str | None = None,
    person: str | None = None,
) -> Scene:
    """A scene by its file or folder, or as it is; of it the frames and the person that are asked for.

    A scene of several people is that of the ``person`` of this name. Without ``calibrated`` there need not be a
    calibration; ``source`` is that of :func:`load_scene`, for a file. A reporter hears where given masks show more
    than one person, and how to choose: one person is tracked at a time.

    Raises:
        InputError: the scene is wrong.
        UsageError: it does not have these frames, no identities, or nobody of that name.
        TypeError: it is neither.
    """
    with arguments_checked():
        chosen = _open_scene(scene, _frames_text(frames), identity, calibrated, source)
    if person is not None:
        if person not in chosen.people:
            listed = f"one of {', '.join(chosen.people)}" if chosen.people else "in the scene, which names nobody"
            raise UsageError(f"--person {person} is not {listed}")
        chosen = chosen.of_person(person)
    is_heard = getattr(type(reporter), "note", None) is not Reporter.note
    is_clear = chosen.foreground.identity or chosen.labelled or chosen.people
    if reporter is not None and is_heard and chosen.foreground.source == "masks" and not is_clear:
        others = ((source.name, _others(chosen, source)) for source in chosen.cameras)
        if (seen := next((f"{name} {line}" for name, line in others if line is not None), None)) is not None:
            reporter.note(seen)  # the other cameras see the same people
    return chosen


def _open_scene(
    scene: Scene | str | Path, frames: str | None, identity: int | None, calibrated: bool, source: str | None
) -> Scene:
    if isinstance(scene, str | Path):
        return load_scene(scene, frames, identity, calibrated=calibrated, source=source)
    if not isinstance(scene, Scene):
        raise TypeError(f"scene must be a Scene or the path of one, not a {type(scene).__name__}")
    if identity is not None:
        are_given = scene.foreground.source == "masks"
        if not are_given or scene.labelled or scene.people:
            other = "have labels of people; --person chooses" if are_given else "are subtracted"
            raise UsageError(f"--identity chooses among given masks; this scene's {other}")
        scene = replace(scene, foreground=replace(scene.foreground, identity=identity))
    if frames is None:
        return scene
    return scene.of_frames(FrameChoice.parse(frames).of(scene.frames, scene.recorded_frames))


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
    refuse_live(result)
    from mmocap_warp.formats.usd.usd_result import read_result  # OpenUSD takes a quarter of a second

    return read_result(result), Path(result)


def refuse_live(file: str | Path) -> None:
    """See that no live session writes a result's file, or was killed while it did; else an InputError."""
    if Path(f"{file}.frames").exists():
        remedy = "end it, or start mmocap live with the same --record, which makes a result of its frames and stops"
        raise InputError(file, "is of a live session that goes on or was killed", remedy)


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
    from mmocap_warp.rigging.shipped import DEFAULT_BODY, load_body

    return load_body(body or scene.body or DEFAULT_BODY, "--body" if body else scene.path)


def positions_of(result: Result, frames: Frames) -> list[int]:
    """Positions in a result of the frames that are asked for, or of all; a UsageError if it has none of these."""
    numbers, text = result.frame_numbers.tolist(), _frames_text(frames)
    if text is None:
        return list(range(len(numbers)))
    with arguments_checked():
        choice = FrameChoice.parse(text)
        if choice.count is not None:
            return list(choice.of(range(len(numbers)), len(numbers)))
        chosen = choice.of(range(0), max(numbers[-1] + 1, choice.end or 0))
    if not (positions := [position for position, number in enumerate(numbers) if number in chosen]):
        raise UsageError(f"--frames = {text} holds none of the result's frames, {numbers[0]} to {numbers[-1]}")
    return positions


def scene_reference(scene: Scene, file: Path | None, prefix: str = "") -> dict[str, str | int]:
    """How a result or a subject names scene and person: relative to its own file, so that both can move together."""
    path, identity = scene.path.resolve(), scene.foreground.identity
    reference = path if file is None else relative_path(path, file.resolve().parent)
    known: dict[str, str | int] = {"identity": identity, "person": scene.person}
    return {f"{prefix}scene": reference.as_posix()} | {f"{prefix}{key}": of for key, of in known.items() if of}


def scene_of(
    made: Result | Subject, path: Path | None, named: Scene | str | Path | None, reporter: Reporter | None = None
) -> Scene | None:
    """The scene that a result or a subject was made from: the one named now, or the one that it names; None if neither.

    It names its scene from its file at ``path``; of what is in memory alone, an absolute path counts.

    Raises:
        InputError: the scene is wrong, or is no longer where the reference says.
    """
    is_result = isinstance(made, Result)
    known: Mapping[str, Any] = made.config if isinstance(made, Result) else made.provenance
    names = ("scene", "identity", "person")
    reference, identity, person = (known.get(name if is_result else f"fit.{name}") for name in names)
    identity = None if identity is None else int(identity)
    if named is None:
        if reference is None:
            return None
        if path is None and not Path(reference).is_absolute():
            if is_result:
                remedy = "and that file's place is not known: give the scene, or the result as a file"
                (reporter or Reporter()).warn(f"the scene {reference} is named from the result's file, {remedy}")
            return None
        named = Path(reference) if path is None else path.parent / reference
        if not named.exists():
            problem = f"was made from {named}, which is not there"
            raise InputError(path or "result", problem, "name the scene with --scene")
    numbers = made.frame_numbers if isinstance(made, Result) else [int(known.get("fit.first_frame", 0))]
    frames = f"{numbers[0]}:{numbers[-1] + 1}"
    if isinstance(named, Scene):
        found = named
    else:
        try:  # those of its frames that it was made from: cameras need not have all others
            found = load_scene(named, frames, identity=identity)
        except ValueError:  # it has not these
            found = load_scene(named, identity=identity)
    found = found.of_person(person) if person in found.people else found
    if not isinstance(made, Result) or path is None or found.calibrated.names != made.cameras.names:
        return found
    return as_tracked(found, made, path)


def as_tracked(scene: Scene, result: Result, path: Path | None) -> Scene:
    """The scene with the cameras that a result, whose file is at ``path``, was tracked with."""
    refined = result.config.get("refined_cameras")
    return with_refined(scene, kept) if path and refined and (kept := path.with_name(refined)).exists() else scene


def with_refined(scene: Scene, file: Path) -> Scene:
    """The scene with the cameras and times that a calibration beside a result has refined."""
    rig = read_calibration(file, None, scene.calibrated.up, None).select(scene.calibrated.names)
    refined = scene.with_cameras(rig, load_toml(file).take_table("metadata").take("offsets", dict))
    return replace(refined, calibration=file)


def one_person(scene: Scene) -> Scene:
    """The scene, which is of one person; a UsageError where it has several, of whom none is chosen."""
    if scene.people and not scene.person:
        raise UsageError(f"--person is missing: the scene has {', '.join(scene.people)}")
    return scene


def truth_of(scene: Scene | None) -> Truth | None:
    """The truth that the scene names."""
    if scene is None or scene.truth is None:
        return None
    from mmocap_warp.formats.truth_file import load_truth

    return load_truth(scene.truth, scene.truth_axes, scene.truth_first_frame)


def keep_named(output: Path | None, scene: Scene, *names: str) -> None:
    """See that an output is no file that its scene names, as truth, subject or calibration; else an InputError."""
    for name, file in ((name, getattr(scene, name)) for name in names):
        if output is not None and file is not None and os.path.realpath(output) == os.path.realpath(file):
            raise InputError(output, f"is the {name} that the scene names", "write elsewhere")


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
        f" {remedy}, make masks of one person (docs/masks.md), or name their label under [labels] as several"
    )


def track_settings(
    scene: Scene, given: Mapping[str, Any], base: TrackConfig | None, *, seen: bool = True
) -> TrackConfig:
    """The settings to track a scene with, as :func:`~mmocap_warp.commands.caller.effective`.

    Large images are scaled by how long the subject is in the first frame, unless a setting or ``base`` says how. Where
    no frame can be ``seen`` yet, that is guessed.
    """
    chosen, size = effective(TrackConfig, scene.settings("track"), given, base), scene.calibrated.size
    if base is not None or "scale" in {*given, *scene.track} or size.max() < LARGE_IMAGE:
        return chosen
    lengths = []
    if seen:
        from mmocap_warp.calibration.first_look import few_masks

        rig, [masks] = few_masks(scene.of_frames(scene.frames[:1]))
        by = size.max() / rig.size.max()
        lengths = [by * max(cv2.boundingRect(mask.view(np.uint8))[2:]) for mask in masks if mask.any()]
    return replace(chosen, scale=tracking_scale(size, float(np.median(lengths)) if lengths else None))


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
        reporter: receives doubts.
        trust: go on even if they cannot.
        start: the subject, where it is known.
        to_be_mended: small errors of cameras and times are about to be put right.

    Returns:
        What a result or a subject says of a problem that was not heeded, by the name of its entry.

    Raises:
        InputError: they fit no body.
    """
    from mmocap_warp.calibration.first_look import look

    looked = look(scene, body, start=start, to_be_mended=to_be_mended)
    if looked.problem is not None and not (trust or scene.has_others):  # then views may differ in what they show
        raise InputError(scene.path, looked.problem, f"{looked.remedy}; or go on with --trust-cameras")
    despite = "is trusted" if trust else "what is in front of the subject may be why"
    for doubt in (*looked.doubts, *([f"{looked.problem}, and {despite}"] if looked.problem else [])):
        reporter.note(f"cameras: {doubt}")
    return {"trusted_cameras": looked.problem} if looked.problem and trust else {}


def span(frames: Sequence[int] | np.ndarray) -> str:
    """Frame numbers for people: the first, the last and how many there are."""
    return f"{frames[0]} to {frames[-1]} ({len(frames)})"
