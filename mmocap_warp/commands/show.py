"""A result to look at, ``mmocap show`` and ``view``, and its animation for other programs, ``mmocap export``."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from mmocap_warp.body.joint_sets import RIG
from mmocap_warp.body.joint_sets import joint_set as set_named
from mmocap_warp.body.model import Subject
from mmocap_warp.commands.caller import Reporter, arguments_checked, start_warp
from mmocap_warp.commands.inputs import Frames, positions_of, result_from, scene_of, truth_of
from mmocap_warp.commands.outputs import new_file, releases_locks
from mmocap_warp.display import result_video
from mmocap_warp.display.overlay import Look
from mmocap_warp.display.page import viewer
from mmocap_warp.errors import InputError, UsageError
from mmocap_warp.formats import table
from mmocap_warp.formats.exports.rigs import with_rig
from mmocap_warp.formats.truth_file import load_truth
from mmocap_warp.formats.usd.usd_body import read_subject
from mmocap_warp.formats.usd.usd_file import stage_up
from mmocap_warp.formats.usd.usd_people import results_in
from mmocap_warp.formats.usd.usd_result import holds_result
from mmocap_warp.result.evaluation import iou_by_camera
from mmocap_warp.result.excerpt import at_rate, before_smoothing, evenly, of_run, stood_up
from mmocap_warp.result.result import Result
from mmocap_warp.result.truth import Truth
from mmocap_warp.result.verdict import verdict
from mmocap_warp.scene.mask_writing import TINTS
from mmocap_warp.scene.recording import Scene
from mmocap_warp.tracking.body_masks import images_of, tracked_masks

_DRAWN_LENGTH = 1600  # at most of a drawn image's longer side, unless the result was tracked in larger ones [px]


@dataclass(frozen=True)
class Drawing:
    """What was drawn."""

    video: Path | None  # all frames; None of a subject, which has one
    sheet: Path  # some frames of all cameras, or the subject
    # ``verdict`` and ``iou_by_camera`` as ``evaluate`` gives them, under ``people`` of several; empty of a subject
    report: dict[str, Any] = field(default_factory=dict)
    strip: Path | None = None  # the animated strip, where it was asked for


@releases_locks
def show(
    result: Result | Subject | str | Path,
    scene: Scene | str | Path | None = None,
    *,
    beside: Sequence[str | Path] | None = None,
    output: str | Path | None = None,
    frames: Frames = None,
    whole: bool = False,
    slow: float = 1.0,
    deviations: bool = False,
    strip: bool = False,
    force: bool = False,
    reporter: Reporter | None = None,
) -> Drawing:
    """Write an overlay video of all cameras, and a contact sheet beside it: mask against model, skin and skeleton.

    Of a subject it is a picture: the fit over the first frame, or the body alone where the scene is not known.

    Args:
        result: what was tracked or fitted, or its file, which may be of several people.
        scene: the scene, if it is no longer where the result says.
        beside: files of other people's results, of the same scene and frames, to be drawn too.
        output: the video's file, .webm. The sheet, and a subject's picture, have the ending .png. [default: beside the
            result and named after it]
        frames: which of the result's frames. [default: all]
        whole: show whole images, not only the part around the body.
        slow: how many times slower the video plays.
        deviations: draw ellipses of ten standard deviations at the joints.
        strip: also write a small animated picture for a README beside the video, .webp.
        force: replace files that exist.
        reporter: receives progress.

    Raises:
        UsageError: frames that the result does not have, no ``output`` for what has no file, a wrong ``slow``.
        InputError: the scene is another recording or not there, or a file cannot be written.
    """
    reporter = reporter or Reporter()
    named, (result, *beside) = result, _with_people(result, beside)
    if isinstance(result, Subject) or (isinstance(result, str | Path) and not holds_result(result)):
        if frames is not None or whole or slow != 1.0 or deviations or strip or beside:
            problem = "--beside, --frames, --whole, --slow, --deviations and --strip need a result"
            raise UsageError(f"{problem}; a subject is drawn over the frame of its fit: leave them out")
        return _show_subject(result, scene, new_file(_beside(result, output, ".png"), ".png", force=force))
    if not 0.0 < slow < float("inf"):
        raise UsageError(f"--slow must be above 0, got {slow:g}")
    video = new_file(_beside(named, output, ".webm"), ".webm", force=force)
    sheet = new_file(video.with_suffix(".png"), ".png", force=force)
    animated = new_file(video.with_suffix(".webp"), ".webp", force=force) if strip else None
    tracked, path = result_from(result)
    positions = positions_of(tracked, frames)
    start_warp()
    recorded, shown = scene_of(tracked, path, scene, reporter), tracked.at(positions)
    others = _others(beside, tracked, scene, reporter)
    settings = {"strip": animated, "slow": slow, "deviations": deviations}
    draw_result(tracked, recorded, video, sheet, reporter, positions, whole, others, **settings)
    report = _judged(shown, recorded)
    if others:
        each = [(look.name, result.at(positions), of) for look, result, of in _people([(tracked, recorded), *others])]
        report = {"people": {name: _judged(result, of) for name, result, of in each}}
    return Drawing(video, sheet, report, animated)


def _judged(result: Result, scene: Scene | None) -> dict[str, Any]:
    return {"iou_by_camera": iou_by_camera(result), "verdict": verdict(result, None if scene is None else scene.path)}


def _with_people(result: Any, beside: Sequence[str | Path] | None) -> list[Any]:
    """A result, or those that a file of several people names, and further ones."""
    people = results_in(result).values() if isinstance(result, str | Path) else ()
    return [*(people or [result]), *([beside] if isinstance(beside, str | Path) else beside or ())]


def _others(
    beside: Sequence[str | Path], result: Result, scene: Scene | str | Path | None, reporter: Reporter
) -> list[tuple[Result, Scene | None]]:
    """Results beside one of the same frames, each with the scene of its person."""
    others = [(other, scene_of(other, file, scene, reporter)) for other, file in map(result_from, beside)]
    seen = result.frame_numbers.tolist(), result.cameras.names
    if any((other.frame_numbers.tolist(), other.cameras.names) != seen for other, _ in others):
        raise UsageError("--beside needs results of the same frames and cameras")
    return others


def show_all(result: Path, reporter: Reporter, force: bool) -> dict[str, Path]:
    """The overlay video and the page beside a result, made where there are none or older ones, or by ``force``."""
    files = {"video": result.with_suffix(".webm"), "page": result.with_suffix(".html")}
    newest = max(file.stat().st_mtime for file in (result, *results_in(result).values()))
    makers: tuple[Callable[..., object], ...] = show, view
    for file, make in zip(files.values(), makers, strict=True):
        if force or not file.exists() or file.stat().st_mtime < newest:
            make(result, output=file, force=True, reporter=reporter)
    return files


def _beside(result: object, output: str | Path | None, suffix: str) -> Path:
    """Where to write: the output, or beside the result's file."""
    if output is not None:
        return Path(output)
    if isinstance(result, str | Path):
        return Path(result).with_suffix(suffix)
    raise UsageError("--output is missing: what is in memory has no file to write beside")


def _show_subject(given: Subject | str | Path, scene: Scene | str | Path | None, picture: Path) -> Drawing:
    """Draw a subject over the frame of its scene that it was fitted to, or alone where there is no scene."""
    subject, path = (given, None) if isinstance(given, Subject) else (read_subject(given), Path(given))
    start_warp()
    if (recorded := scene_of(subject, path, scene)) is None:
        result_video.show_subject(subject, picture)
        return Drawing(None, picture)
    scale = min(1.0, _DRAWN_LENGTH / int(recorded.calibrated.size.max()))
    number = int(subject.provenance.get("fit.first_frame", 0))
    fitted = recorded.of_frames(range(number, number + 1))
    images, masks = next(fitted.images(scale)), next(fitted.masks(scale))
    result_video.show_subject(subject, picture, recorded.rig(scale), images, masks)
    return Drawing(None, picture)


def draw_result(
    result: Result,
    scene: Scene | None,
    video: Path,
    sheet: Path,
    reporter: Reporter,
    positions: list[int] | None = None,
    whole: bool = False,
    others: Sequence[tuple[Result, Scene | None]] = (),
    **settings: Any,
) -> None:
    """Write the overlay video and the contact sheet, over the scene's images and masks where there is a scene.

    They show all frames, or those at ``positions`` in the result. Masks are those that were tracked; images are as
    large as they are shown, so that a result of small masks can still be judged. ``others`` are results of the same
    frames that are drawn too, each with the scene of its person. ``settings`` are further ones of
    :func:`mmocap_warp.display.result_video.show`.
    """
    positions = list(range(len(result.frame_numbers))) if positions is None else positions
    shown, count, images, masks = result.at(positions), len(positions), None, None
    layout = result_video.video_layout(shown, whole, [other.at(positions) for other, _ in others])
    if scene is not None:
        tracked = float(result.config.get("scale", 1.0))
        most = _DRAWN_LENGTH / int(scene.calibrated.size.max())
        scale = min(1.0, max(tracked, min(layout.scale, most)))
        result_video.check_same_recording(result, scene)
        images = images_of(scene, shown.frame_numbers.tolist(), scale)
        masks = tracked_masks(scene, result, positions)
    people = [
        (look, each.at(positions), None if of is None else tracked_masks(of, each, positions))
        for look, each, of in _people([(result, scene), *others])
    ]
    with reporter.stage("show") as progress:
        settings |= {"layout": layout, "progress": lambda done: progress(done, count)}
        result_video.show(shown, images, masks, people=people, video=video, sheet=sheet, **settings)


def _people(results: Sequence[tuple[Result, Scene | None]]) -> list[tuple[Look, Result, Scene | None]]:
    """How several people are told apart: by names and places in the scene, or places in the list; none if one alone."""
    people: list[tuple[Look, Result, Scene | None]] = []
    for place, (result, scene) in enumerate(results if len(results) > 1 else ()):
        name, names = str(result.config.get("person", "")), [] if scene is None else [*scene.people]
        name = "" if any(name == look.name for look, *_ in people) else name  # two results of one person
        colour = TINTS[(names.index(name) if name in names else place) % len(TINTS)]
        people.append((Look(name or f"person{place + 1}", colour), result, scene))
    return people


@releases_locks
def view(
    result: Result | str | Path,
    scene: Scene | str | Path | None = None,
    *,
    beside: Sequence[str | Path] | None = None,
    truth: Truth | str | Path | None = None,
    images: bool = False,
    joint_set: str | Path = "rig",
    name: str | None = None,
    output: str | Path | None = None,
    force: bool = False,
    reporter: Reporter | None = None,
) -> viewer.Page:
    """A page that shows a result in any browser, without a network: body, cameras, masks, curves, all runs.

    A notebook shows it below its cell.

    Args:
        result: what was tracked, or its file, which may be of several people.
        scene: the scene, if it is no longer where the result says.
        beside: files of other people's results, of the same scene and frames, that the page shows too.
        truth: what errors are measured from. [default: the scene's own]
        images: show the recording's images too, not its masks alone.
        joint_set: also show the points of a set, as eval takes it, with the skeleton.
        name: the page's title. [default: the scene's name]
        output: the page's file, .html. The command writes it beside the result unless it is named.
        force: replace files that exist.
        reporter: receives progress.

    Raises:
        InputError: the scene or the truth is of another recording, an image cannot be read, or a file not written.
    """
    reporter = reporter or Reporter()
    page = None if output is None else new_file(output, ".html", force=force)
    result, *beside = _with_people(result, beside)
    tracked, path = result_from(result)
    recorded = scene_of(tracked, path, scene, reporter)
    known = truth if isinstance(truth, Truth) else truth_of(recorded) if truth is None else load_truth(truth)
    points = None if joint_set == RIG else set_named(joint_set, tracked.subject.body)
    people = _people([(tracked, recorded), *_others(beside, tracked, scene, reporter)])
    start_warp()
    if name is None:
        name = recorded.name if recorded is not None else "Tracked motion" if path is None else path.stem
    about: dict[str, Any] = {"images": images, "joint_set": points, "name": name, "people": people}
    with reporter.stage("view") as progress:
        try:
            shown = viewer.view(tracked, recorded, truth=known, progress=progress, **about)
        except InputError as error:
            file = truth if isinstance(truth, str | Path) else truth is None and recorded and recorded.truth
            named = file if file and error.source == "truth" else error.source
            raise InputError(named, error.problem, error.remedy) from None
    if page is not None:
        shown.write(page)
    return shown


@dataclass(frozen=True)
class Export:
    """What was exported."""

    files: tuple[Path, ...]  # those that were written, one for each run or person
    frames: int  # how many each has
    fps: float  # frames per second
    up: str  # the vertical of its world


@releases_locks
def export(
    result: Result | str | Path,
    output: str | Path,
    *,
    run: int | str | None = None,
    raw: bool = False,
    frames: Frames = None,
    fps: float | None = None,
    up: Literal["y", "z"] | None = None,
    rig: str | None = None,
    joint_set: str | Path = "rig",
    bake: bool = False,
    force: bool = False,
) -> Export:
    """Write a result's animation alone, in the format of the file's ending.

    The world is the result's, which is the calibration's. A format with a vertical of its own has it turned. Of several
    people one .glb or USD file holds all; of other formats there is a file a person, such as walk.anna.bvh.

    Args:
        result: what was tracked, or its file, which may be of several people.
        output: the animation's file, known by its ending.
        run: which run: its number from 0, or "all" for a file a run, such as walk-run0.bvh. [default: the best]
        raw: the track as it was before it was smoothed.
        frames: which of the result's frames. [default: all]
        fps: frames per second, resampled by time. [default: the result's own]
        up: turn the world so that y or z is up: (x, y, z) becomes (x, z, -y) from z up to y up, and (x, -z, y) back.
            [default: the result's own, or the format's]
        rig: name and bind joints as this rig does: mixamo, unity, unreal, vrm or soma. [default: vrm in a .vrma]
        joint_set: tables only: whose joints they go by, as eval takes it.
        bake: USD only: the skin's points at every frame instead of a skeleton that moves it.
        force: replace files that exist.

    Raises:
        UsageError: what the result or the format does not have.
        InputError: a file that cannot be written, or is no result.
    """
    output = Path(output)
    new_file(output, *table.EXPORT_SUFFIXES, force=True)
    format = table.format_of(table.EXPORTS, output)
    # Another vertical than the format's, or points in a format without.
    if up not in (None, "y", "z"):
        raise UsageError(f"--up must be y or z, got {up}")
    if up is not None and format.up not in (None, f"+{up}"):
        raise UsageError(f"--up {up} cannot be: {format} is always {format.up[1:]} up; leave --up out")
    is_usd = any(cache.matches(output) for cache in table.POINT_CACHES)
    if bake and not is_usd:
        fitting = " or ".join(map(str, table.POINT_CACHES))
        raise UsageError(f"--bake cannot write {output.suffix}; end the output in {fitting}")
    if output.suffix.lower() == ".vrma":
        if rig not in (None, "vrm"):
            raise UsageError(f"--rig {rig} cannot be in a .vrma; leave it out, or end the output in .glb")
        rig = "vrm"
    if joint_set != RIG and not format.takes_joint_set:
        fitting = ", ".join(ending for each in table.EXPORTS if each.takes_joint_set for ending in each.suffixes)
        raise UsageError(f"--joint-set cannot be in {output.suffix}; end the output in one of {fitting}")
    if joint_set != RIG and rig is not None:
        raise UsageError("--joint-set goes by the body's own joints and skin: leave it or --rig out")
    people: dict[str, Any] = {**results_in(result)} if isinstance(result, str | Path) else {}
    together = bool(people) and run is None and not bake and output.suffix.lower() in format.people
    parts: dict[Path, dict[str, tuple[Result, int]]] = {}  # of each file, its people and their runs
    for name, each in (people or {"": result}).items():
        tracked, _ = result_from(each)
        own = output if together or not name else output.with_name(f"{output.stem}.{name}{output.suffix}")
        for file, number in _files(own, run, len(tracked.pose), tracked.best_run).items():
            parts.setdefault(file, {})[name] = tracked, number
    for file in parts:
        if isinstance(result, str | Path) and file.resolve() in map(Path.resolve, (Path(result), *people.values())):
            raise InputError(file, "is the result, of which an animation keeps less", "write elsewhere")
        new_file(file, *table.EXPORT_SUFFIXES, force=force)
    start_warp()
    for file, part in parts.items():
        of_file = {name: _chosen(of_run(each, run), raw, frames, fps, rig, up) for name, (each, run) in part.items()}
        chosen, (tracked, _) = next(iter(of_file.values())), next(iter(part.values()))
        points = None if joint_set == RIG else set_named(joint_set, tracked.subject.body)
        table.export(of_file if together else chosen, file, table.POINT_CACHES if bake else table.EXPORTS, points)
    # USD alone keeps uneven frames, and turns the world upright.
    frame_count = len((chosen if is_usd else evenly(chosen)).frame_numbers)
    own_up = stage_up(chosen.cameras.up) if is_usd else chosen.cameras.up
    return Export(tuple(parts), frame_count, chosen.rate, format.up or own_up)


def _files(output: Path, run: int | str | None, runs: int, best: int) -> dict[Path, int]:
    """The run that each file holds."""
    if run == "all":
        return {output.with_name(f"{output.stem}-run{number}{output.suffix}"): number for number in range(runs)}
    if run is None:
        return {output: best}
    if not str(run).isdecimal() or int(run) >= runs:
        raise UsageError(f'--run = {run} is neither "all" nor a run of this result, 0 to {runs - 1}')
    return {output: int(run)}


def _chosen(result: Result, raw: bool, frames: Frames, fps: float | None, rig: str | None, up: str | None) -> Result:
    """The part of a result that is asked for."""
    if raw and result.raw_pose is None:
        raise UsageError("--raw needs a result that was smoothed; this one was not: leave --raw out")
    result = before_smoothing(result) if raw else result
    result = result.at(positions_of(result, frames))
    with arguments_checked():
        result = result if fps is None else at_rate(result, fps)
    result = result if rig is None else with_rig(result, rig)
    return result if up is None else stood_up(result, f"+{up}")
