"""A scene's masks, made once and judged: ``mmocap mask``."""

import shutil
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from mmocap_warp.body.posing import Poser
from mmocap_warp.cameras.silhouette import silhouettes
from mmocap_warp.commands.caller import Reporter, effective, start_warp
from mmocap_warp.commands.inputs import Frames, as_tracked, one_person, result_from, scene_from, span
from mmocap_warp.commands.outputs import new_folder, releases_locks
from mmocap_warp.display.result_video import check_same_recording
from mmocap_warp.errors import InputError, UsageError
from mmocap_warp.formats.usd.usd_body import read_subject
from mmocap_warp.formats.usd.usd_result import holds_result
from mmocap_warp.masks.consistency import Consistency
from mmocap_warp.masks.mask_check import MaskJudge, MaskReport
from mmocap_warp.masks.mask_program import find_program
from mmocap_warp.masks.mask_settings import BACKGROUNDS
from mmocap_warp.masks.subtraction import mask_around_body
from mmocap_warp.result.result import Result
from mmocap_warp.rigging.shipped import DEFAULT_BODY, load_body
from mmocap_warp.scene.drafting import mask_scale
from mmocap_warp.scene.mask_writing import Refine, write_masks
from mmocap_warp.scene.program_masks import UNFINISHED, images_for_program, masks_by_program, with_people
from mmocap_warp.scene.recording import Scene
from mmocap_warp.tracking.frame_loop import check_start
from mmocap_warp.tracking.telling_apart import told_apart
from mmocap_warp.tracking.track_config import TrackConfig


@dataclass(frozen=True)
class WrittenMasks:
    """Masks that were written, as a scene of their own."""

    source: Path  # the file of the scene that they were made of
    scene: Path  # their own scene's file
    overlay: Path  # the video of the masks over the images
    frames: int  # how many frames have masks
    report: MaskReport  # what the masks show, and what is wrong with them
    remedy: str | None  # what to do where something is wrong; None where nothing is
    consistency: Consistency | None  # what was changed so that the views agree; None where nothing was to be


@releases_locks
def mask(
    scene: Scene | str | Path,
    output: str | Path,
    *,
    scale: float = 1.0,
    frames: Frames = None,
    from_body: Result | str | Path | None = None,
    identity: int | None = None,
    with_: str | None = None,
    consistent: bool | None = None,
    device: str | None = None,
    threads: int | None = None,
    force: bool = False,
    reporter: Reporter | None = None,
) -> WrittenMasks:
    """Write a scene's foreground masks and an overlay of them, and judge whether they show one whole subject.

    Args:
        scene: the recording, or its file or folder.
        output: the folder to write.
        scale: of the masks relative to the recording, up to 1.
        frames: which of the recording's frames. [default: those that the scene names]
        from_body: a result of this scene: draw the masks anew around its body, by the images' colours (GrabCut).
        identity: of the person who is meant, where masks show several.
        with_: what makes the masks: 'subtraction' of a background, 'mediapipe', or a command, which is called with a
            folder of frames and one for masks (see the page on masks). [default: as the scene says]
        consistent: fill what only this view lacks, and cut what only this view shows; it takes four views.
            [default: if a program makes the masks]
        device: on which poses tell people apart: auto, cpu, cuda or cuda:1. [default: that of the scene's [track]]
        threads: of a CPU for that. [default: those of the scene's [track]]
        force: write into a folder that holds files.
        reporter: receives notes and progress.

    Raises:
        UsageError: a scale or frames that cannot be.
        InputError: anything wrong with the scene's images, or a result of another recording.
    """
    reporter = reporter or Reporter()
    if not 0 < scale <= 1:
        raise UsageError(f"--scale must be in (0, 1], got {scale:g}")
    # Masks are made of what the caller says.
    source = with_ if with_ in (None, "subtraction") else "program"
    if source == "program" and isinstance(scene, Scene):
        scene = replace(scene, foreground=replace(scene.foreground, source=source))
    if source == "subtraction" and isinstance(scene, Scene) and scene.foreground.source not in BACKGROUNDS:
        scene = scene_from(scene.path, scene.frames, source=source)
    loaded = scene_from(scene, frames, identity, reporter, source=source)
    by_program = loaded.foreground.source == "program"
    refine, loaded = (None, loaded) if from_body is None else _around_body(loaded, from_body, scale)
    program = find_program("mediapipe" if with_ is None else with_, reporter.note) if by_program else None
    apart = _told_apart(loaded, scale=scale, device=device, threads=threads) if loaded.of_several else None
    unfinished = Path(output) / UNFINISHED
    folder = new_folder(output, force=force or (by_program and unfinished.is_dir()))
    streams = (stream for source in loaded.cameras for stream in (source.masks, source.video) if stream)
    given = chain(*(stream.files for stream in streams))
    if folder.resolve() in map(Path.resolve, {loaded.path.parent, *chain(*(file.parents[:2] for file in given))}):
        raise InputError(output, "holds the scene, or masks or videos that are read", "name another folder")
    images = None
    if program is not None:
        with reporter.stage("program", "masks") as progress:
            loaded = masks_by_program(loaded, unfinished, program, scale, progress)
        if not (loaded.foreground.identity or refine):
            loaded = with_people(loaded, unfinished / "people", scale, reporter.note)
        images = images_for_program(loaded, unfinished)
    # The volume of the scene's subject, or else of the body that a fit would start from.
    named = loaded.subject and read_subject(loaded.subject).body
    body = named or load_body(loaded.body or DEFAULT_BODY, loaded.path)
    supposed = not (named or loaded.body)
    names = [f"{name}: " for name in loaded.people] or [""]
    judges = [MaskJudge(loaded.rig(scale), loaded.frame_count, body.volume, supposed=supposed) for _ in names]

    def look(people: list[list[np.ndarray]]) -> None:
        for judge, masks in zip(judges, people, strict=True):
            judge.add(masks)

    total, consistency = loaded.frame_count, list[Consistency]()
    if by_program if consistent is None else consistent:
        consistency = [Consistency(loaded.rig(scale)) for _ in loaded.people or [loaded]]
    with reporter.stage("mask") as progress:
        options: dict[str, Any] = {"refine": refine, "images": images, "apart": apart, "make_consistent": consistency}
        written = write_masks(loaded, folder, scale, lambda n: progress(n, total), look=look, **options)
    if program is not None:
        shutil.rmtree(unfinished, ignore_errors=True)
    # What is said of each person's views, and what was changed in them.
    reports = [*zip(names, (judge.report() for judge in judges), strict=True)]
    views = {f"{whose}{name}": view for whose, each in reports for name, view in each.views.items()}
    faults = tuple(f"{whose}{fault}" for whose, each in reports for fault in each.faults)
    report = MaskReport(views, sum(each.volume for _, each in reports), faults)
    remedy = _remedy(loaded, folder) if faults else None
    for other in consistency[1:]:
        consistency[0].add(other)
    made = next(iter(consistency), None)
    return WrittenMasks(loaded.path, written, folder / "overlay.webm", total, report, remedy, made)


def with_masks(scene: Scene, reporter: Reporter, config: TrackConfig) -> Scene:
    """The scene itself, or one beside it whose masks are made: by a program once, or by poses on a config's device."""
    if scene.foreground.source == "program":
        folder = _beside(scene, "masks")
        masks = folder / "scene.toml"
        if not masks.exists():
            for fault in mask(scene.path, folder, scale=mask_scale(scene), reporter=reporter).report.faults:
                reporter.warn(f"{folder}: {fault}")
        elif scene.path.stat().st_mtime > masks.stat().st_mtime:
            remedy = f"edit it too, or remove {folder} to have masks made anew"
            reporter.warn(f"{masks}: is tracked, and older than {scene.path}; {remedy}")
        files = [file for source in scene.cameras if source.video for file in source.video.files]
        if max((file.stat().st_mtime for file in files), default=0.0) > masks.stat().st_mtime:
            reporter.warn(f"{folder}: is older than the recording; remove it to have masks made anew")
    elif scene.of_several:
        folder = _beside(scene, "apart")
        if _is_older(folder / "scene.toml", scene):
            made = mask(scene.path, folder, device=config.device, threads=config.threads, force=True, reporter=reporter)
            reporter.note(f"people: told apart by their poses; look at {made.overlay}")
    else:
        return scene
    return scene_from(folder, scene.frames, person=scene.person or None)


def _beside(scene: Scene, name: str) -> Path:
    return scene.directory / (name if scene.path.stem == "scene" else f"{scene.path.stem}-{name}")


def _is_older(file: Path, scene: Scene) -> bool:
    """Whether a file is not there, or older than what people are told apart by in a scene."""
    masks = (each.masks.files for each in scene.cameras if each.masks)
    given = {scene.path, scene.calibration, *chain((person.subject for person in scene.people.values()), *masks)}
    return not file.exists() or max(each.stat().st_mtime for each in given if each) > file.stat().st_mtime


def _told_apart(scene: Scene, **given: Any) -> Iterator[tuple[list[list[np.ndarray]], list[np.ndarray]]]:
    """Each frame's masks of everybody, by their poses; settings that are None are the scene's."""
    settings = {name: value for name, value in given.items() if value is not None}
    config = effective(TrackConfig, scene.settings("track"), settings)
    start_warp(config.device)
    files = {name: person.subject for name, person in scene.people.items()}
    if lacks := [name for name, file in files.items() if file is None]:
        problem = f"labels that may be of several people need everybody's subject, and {lacks[0]} has none"
        raise InputError(scene.path, problem, f"fit one where they are apart, and name it in [people.{lacks[0]}]")
    subjects = [read_subject(file) for file in files.values() if file]
    for subject in subjects:
        check_start(scene, subject)
    return told_apart(scene, subjects, config)


def _remedy(scene: Scene, folder: Path) -> str:
    """What to do about masks that are not good enough."""
    look = f"look at {folder / 'overlay.webm'}; "
    if scene.foreground.source == "recording":
        return (
            look + 'source = "recording" takes for background what does not move for most of the recording. Where the'
            " subject never leaves its place, name an image without it (clean_plate), a recording without it"
            " (background), or masks made with a segmentation program (docs/masks.md). Masks that can just be tracked"
            " are refined with --from-body RESULT"
        )
    if scene.foreground.source == "masks":
        return look + "are they of all of the right subject, and in step? docs/masks.md says how to make better ones"
    return look + "docs/scene.md has the settings of [foreground], docs/masks.md other ways to make masks"


def _around_body(scene: Scene, result: Result | str | Path, scale: float) -> tuple[Refine, Scene]:
    """How masks are drawn around a result's body, frame after frame, from all videos; and the scene of that person."""
    if isinstance(result, str | Path) and not holds_result(result):
        raise InputError(result, "is not a result", "give the file that mmocap track wrote; a subject has one pose")
    tracked, path = result_from(result)
    person = tracked.config.get("person")
    scene = as_tracked(one_person(scene.of_person(person) if person in scene.people else scene), tracked, path)
    check_same_recording(tracked, scene)
    if tracked.frame_numbers.tolist() != list(scene.frames):
        problem = f"has frames {span(tracked.frame_numbers)}, not the {span(scene.frames)} of the scene"
        raise InputError(path or "result", problem, "track the same frames first, or name its frames with --frames")
    if any(source.video is None for source in scene.cameras):
        raise InputError(scene.path, "--from-body needs the video of every camera", "name them as video")
    start_warp()
    rig, subject, poses = scene.rig(scale), tracked.subject, iter(tracked.pose[tracked.best_run])
    poser, faces = Poser(subject.body, subject.root_base), subject.body.tracking_face

    def refine(masks: list[np.ndarray], images: list[np.ndarray | None]) -> list[np.ndarray]:
        (vertices,) = poser.tracking_vertices(next(poses))
        depth = (rig.R @ vertices.mean(axis=0) + rig.t)[:, 2].clip(min=0.1)
        body = silhouettes(rig, vertices, faces)
        return [  # a camera without an image keeps its mask
            mask if image is None else mask_around_body(image, body[k], float(rig.K[k, 0, 0] / depth[k]))
            for k, (mask, image) in enumerate(zip(masks, images, strict=True))
        ]

    alone = tuple(replace(source, in_front=()) for source in scene.cameras)
    return refine, replace(scene, people={}, person="", told_apart=False, cameras=alone)
