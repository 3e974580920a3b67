"""From a scene to a result, ``mmocap track``, ``fit`` and ``demo``, and what is done with one.

``mmocap eval``, ``show``, ``view``, ``export`` and ``measure``.
"""

from __future__ import annotations

import math
import re
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from mmocap_warp.cli.command import BY_PLACE, Answer, Given, answer_of_each, command, several
from mmocap_warp.cli.console import Console, ResultFrames, SceneFrames, checked, flags_of, given, next_step, table
from mmocap_warp.errors import InputError, UsageError
from mmocap_warp.fitting.fit_config import FitConfig
from mmocap_warp.formats.table import EXPORT_SUFFIXES
from mmocap_warp.formats.toml_table import listed
from mmocap_warp.tracking.track_config import AS_GIVEN, REFINE, TrackConfig

if TYPE_CHECKING:
    from mmocap_warp.result.result import Result
    from mmocap_warp.scene.recording import Scene

TrackFlags, FitFlags = flags_of(TrackConfig), flags_of(FitConfig)
_Beside = Annotated[list[Path] | None, Parameter()]


@command("track:track", output=Given(Path | None), frames=SceneFrames, settings=TrackFlags | None)
def track(
    call: Any,
    console: Console,
    loaded: Scene,
    output: Path | None,
    person: str | None,
    subject: Path | None,
    again: Path | None,
    resume: bool,
    force: bool,
    settings: Any,
) -> Answer:
    from mmocap_warp.commands.caller import effective
    from mmocap_warp.commands.mask import with_masks
    from mmocap_warp.commands.show import show_all
    from mmocap_warp.commands.track_people import everybody, file_of, track_each

    if again and output is None:
        raise UsageError("--again needs --output, the file of the new result")
    # Without an output all is made beside the scene, and what exists is not made again.
    whole, output = output is None, output or loaded.directory / "result.usdc"
    loaded = with_masks(loaded, console, effective(TrackConfig, loaded.settings("track"), given(settings)))
    track_one = partial(_track, call, console, whole=whole, force=force, settings=settings)
    if people := everybody(loaded, person, subject=subject, again=again):
        tracked, problems = track_each(loaded, output, track_one, console, resume or (whole and not force), force)
        # What is said of each is said of the result that was written last.
        reports = {
            name: partial(_report, console, loaded.of_person(name), file_of(output, name), result)
            for name, result in tracked.items()
        }
        answer = answer_of_each(console, reports, problems)
        if not tracked:
            return answer
    else:
        scene = loaded.of_person(person) if person in loaded.people else loaded
        answer = _report(console, scene, output, track_one(scene, output))
    files = {"result": output, **(show_all(output, console, force) if whole else {})}
    step = next_step("show", output) if people else answer.values["next"]
    if whole and step == next_step("show", output):  # that is done
        step = next_step("export", output, "-o", output.with_suffix(".glb"))
    values = {**answer.values, **files, "next": step}
    return Answer(values, [*files.values(), *answer.lines, f"next: {step}"], answer.code)


def _track(call: Any, console: Console, scene: Scene, output: Path, whole: bool, force: bool, settings: Any) -> Result:
    """Track one person, a second time with refined cameras where these disagree."""
    from mmocap_warp.result.verdict import verdict

    changes: dict[str, Any] = {"person": None} if scene.person else {}  # the scene is of that person already
    resumed: dict[str, Any] = {"resume": True} if whole and not force else {}
    # Cameras that have been refined since the first run ended are those of a second run, which was interrupted.
    refined, begun = output.with_suffix(".calibration.toml"), output.with_name(f"{output.name}.checkpoint")
    if resumed and all(map(Path.exists, (output, refined, begun))) and refined.stat().st_mtime > output.stat().st_mtime:
        resumed["cameras"] = REFINE
    tracked: Result = call(scene=scene, output=output, **changes, **resumed)
    # Cameras that disagree are refined, unless something else is asked for.
    asked = (settings and settings.cameras) or "cameras" in scene.track or "mended" in tracked.config
    if whole and not asked and tracked.config.get("cameras") != REFINE and verdict(tracked)["cameras"]:
        console.note(f"track: cameras disagree; they are refined for a second run (--cameras '{AS_GIVEN}' leaves them)")
        try:
            tracked = call(
                **changes | {"scene": scene, "output": output, "force": True, "resume": False, "cameras": REFINE}
            )
        except InputError as error:  # nobody has asked for them
            console.warn(f"cameras stay as they are: {error}")
    return tracked


def _report(console: Console, scene: Scene, output: Path, tracked: Result) -> Answer:
    """What is said of one person's track."""
    from mmocap_warp.commands.evaluate import evaluate_in_scene

    try:
        report, warning = evaluate_in_scene(tracked, scene)
    except InputError:
        console.warn(f"{output} is written; its comparison with the scene's truth failed:")
        raise
    if warning:
        console.warn(warning)
    step = report["verdict"]["next"] or next_step("show", output)
    values = {"result": output, **report, "config": tracked.config, "next": step}
    return Answer(values, [summary(report)], checked(report["verdict"]["holds"]))


@command(
    "live_session:live",
    order="subject source to record",
    source=several("--source"),
    to=several("--to"),
    frames=SceneFrames,
    settings=TrackFlags | None,
)
def live(call: Any) -> Answer:
    report = call()
    median, late, most = (f"{each:.1f}" for each in report.delay_ms)
    lines = [f"{report.frames} frames, {report.dropped} dropped, {report.lost} lost"]
    if report.frames:
        lines.append(f"from masks to packets: median {median} ms, 99 of 100 within {late} ms, most {most} ms")
    return Answer(vars(report), lines)


@command(
    "track:fit",
    order="output body",
    output=Given(Path, Path("subject.usdc")),
    start_poses=Annotated[list[str] | None, Parameter(name="--start-pose")],
    frames=SceneFrames,
    settings=FitFlags | None,
)
def fit(call: Any, console: Console, scene: Path, output: Path, identity: int | None, person: str | None) -> Answer:
    from mmocap_warp.commands.track_people import everybody, file_of
    from mmocap_warp.scene.scene_toml import load_scene

    # Who is in it alone is asked: the fit sees whether cameras agree on where they end.
    if not (people := everybody(load_scene(scene, identity=identity, calibrated=False), person)):
        return _fitted(call, output)
    work = {name: partial(_fitted, partial(call, person=name), file_of(output, name)) for name in people}
    return answer_of_each(console, work)


def _fitted(call: Any, output: Path) -> Answer:
    subject = call(output=output)
    known, name = subject.provenance, subject.body.name
    step = next_step("show", output)
    values = {"file": output, "body": name, "height_m": known["body.height"], **known, "next": step}
    return Answer(values, [f"{output}: {name}, {_measures(known)}", f"next: {step}"])


def _measures(provenance: dict[str, str | float | int]) -> str:
    """How large the body is, and its bones, with their standard deviations, for people."""
    measure, adjective = ("length", "long") if "body.length" in provenance else ("height", "tall")
    size, frames = f"{float(provenance[f'body.{measure}']):.2f} m {adjective}", provenance["fit.frames"]
    of_size = 1000 * float(provenance[f"body.{measure}.sigma"])
    if of_size == 0:
        return f"{size}, as given; seen in {frames} frames"
    sigma = [1000 * float(value) for name, value in provenance.items() if re.fullmatch(r"body\.bone\..*\.sigma", name)]
    bones = f", its bones to {min(sigma):.0f}-{max(sigma):.0f} mm" if sigma else ""
    worn = str(provenance.get("fit.loose", "")).replace("+", ", ")
    loose = f"; without loose clothes about {worn}" if worn else ""
    return f"{size}, known to {of_size:.0f} mm{bones}, from {frames} frames{loose}"


@command("demo:demo", example=Given(Literal["walk", "fox", "hand", "quadruped", "arm"], kind=BY_PLACE))
def demo(call: Any, example: str) -> Answer:
    from mmocap_warp.commands.demo import EXAMPLES, MOST_ERROR_MM, MOST_SHARE, PAPERS

    shown = call()
    values = {**shown.report, **shown.files}
    files, lines = list(shown.files.items()), [summary(shown.report)]
    if shown.paper is not None:
        report, its_files = shown.paper
        values["paper"] = {**report, **its_files}
        files += its_files.items()
        lines += ["", beside({TrackConfig().algorithm: shown.report, PAPERS: report}), ""]
    failure = f"the mean marker error (Eq. 20) is over {MOST_ERROR_MM:.0f} mm"
    if example != "walk":
        values |= {"size_m": shown.size, "mpjpe_share": shown.share}
        lines += [f"MPJPE is {100 * shown.share:.2f} % of the {EXAMPLES[example].body}'s {shown.size:.2f} m", ""]
        failure = f"joints are off by over {100 * MOST_SHARE:.0f} % of its size"
    lines += [f"{name:<8} {path}" for name, path in files]
    if not shown.good:
        lines.append(f"check failed: {failure}")
    return Answer({**values, "error_ok": shown.good}, lines, checked(shown.good))


@command("evaluate:evaluate", frames=ResultFrames, joint_set=Given(str, "rig"))
def evaluate(call: Any, console: Console, result: Path, truth: Path | None, joint_set: str) -> Answer:
    from mmocap_warp.formats.usd.usd_people import results_in

    def evaluate_one(file: Path) -> Answer:
        report = call(result=file)
        good = report["verdict"]["holds"] and report.get("other_world") is None
        step = report["verdict"]["next"]
        by_joint = [] if joint_set == "rig" or "by_joint" not in report else [_by_joint(report["by_joint"])]
        return Answer(report, [summary(report), *by_joint, *([f"next: {step}"] if step else [])], checked(good))

    people = {name: partial(evaluate_one, file) for name, file in results_in(result).items()}
    if people and truth:
        raise UsageError(f"--truth is one person's: give it with that person's result, of {', '.join(people)}")
    return answer_of_each(console, people) if people else evaluate_one(result)


def _by_joint(errors: dict[str, dict[str, float | None]]) -> str:
    """A row for each joint: its median error, its constant offset, and what is left without that."""
    keys = ("median_mm", "offset_mm", "left_mm")
    rows = [(name, *(_number(of[key], ".1f") for key in keys)) for name, of in errors.items()]
    return table([("joint", "median [mm]", "offset [mm]", "left [mm]"), *rows])


@command(
    "show:show",
    order="output beside scene whole slow deviations strip",
    result=Path,
    beside=_Beside,
    frames=ResultFrames,
)
def show(call: Any, result: Path) -> Answer:
    drawn = call()
    known = {"video": drawn.video, "sheet": drawn.sheet, "strip": drawn.strip}
    files = {kind: file for kind, file in known.items() if file is not None}
    lines, values = [*files.values(), *_judgement(drawn.report)], {**files, **drawn.report}
    for name, report in drawn.report.get("people", {}).items():
        lines += [f"{name}:", *_judgement(report)]
    if drawn.report:
        export = next_step("export", result, "-o", result.with_suffix(".glb"))
        values["next"] = drawn.report.get("verdict", {}).get("next") or export
        lines.append(f"next: {values['next']}")
    return Answer(values, lines)


@command(
    "show:view", order="output beside images scene", beside=_Beside, truth=None, name=None, joint_set=Given(str, "rig")
)
def view(call: Any, result: Path, output: Path | None) -> Answer:
    page = output or result.with_suffix(".html")
    shown = call(output=page)
    size = page.stat().st_size
    line = f"{page}: {shown.frames} frames, {size / 1e6:.1f} MB"
    return Answer({"file": page, "frames": shown.frames, "bytes": size}, [line])


@command(
    "show:export",
    output=Annotated[Path, Parameter(help=f"The animation's file: {listed(EXPORT_SUFFIXES)}.")],
    run=Annotated[str | None, Parameter(show_default=False)],
    frames=ResultFrames,
    up=Annotated[Literal["y", "z"] | None, Parameter(show_choices=False)],
    rig=Annotated[Literal["mixamo", "unity", "unreal", "vrm", "soma"] | None, Parameter(show_choices=False)],
    joint_set=Given(str, "rig"),
)
def export(call: Any, output: Path) -> Answer:
    written = call()
    values = {"file": output if output in written.files else None, **vars(written)}
    frames = f"{written.frames} frames, {written.fps:g} a second, {written.up} up"
    return Answer(values, [f"{file}: {frames}" for file in written.files])


@command("evaluate:measure", order="output run raw frames", frames=ResultFrames, joint_set=Given(str, "rig"))
def measure(call: Any, output: Path | None) -> Answer:
    from mmocap_warp.biomechanics.measure_tables import report

    measures = call()
    values = report(measures)
    if output is not None:
        values["files"] = [str(file) for file in measures.files]
    return Answer(values, [_measures_text(values)])


def _measures_text(values: dict[str, Any]) -> str:
    """The answer for people."""
    shown = next(run for run in values["per_run"] if run["run"] == values["shown_run"])
    parts = [f"run {values['shown_run']}, {values['frames']} frames, {values['track']}"]
    for key, title in (("angles_deg", "angle [°]"), ("shifts_mm", "shift [mm]")):
        rows = [
            (joint, name.replace("_", " "), *(f"{spread[end]:.1f}" for end in ("min", "mean", "max")))
            for joint, names in shown.get(key, {}).items()
            for name, spread in names.items()
        ]
        if rows:
            parts.append(table([("joint", title, "least", "mean", "most"), *rows]))
    if shown["on_floor_share"]:
        parts.append(_gait(shown))
    if (height := shown["centre_of_mass_height_m"]) is not None:
        spread = ", ".join(f"{word} {height[key]:.3f}" for word, key in (("least", "min"), ("most", "max")))
        parts.append(f"centre of mass [m]: mean height {height['mean']:.3f}, {spread} ({values['shares_of_mass']})")
    bones = values["lengths_mm"].items()
    lengths = [(bone, f"{of['length']:.0f}", _number(of["sigma"], ".0f")) for bone, of in bones]
    parts.append(table([("bone", "length [mm]", "sigma [mm]"), *lengths]))
    if values["left_out"]:
        parts.append(f"left out, because the body lacks their joints: {', '.join(values['left_out'])}")
    if values["not_searched"]:
        names = ", ".join(values["not_searched"]).replace("_", " ")
        parts.append(f"left out, because the model does not search them: {names}")
    if "files" in values:
        parts.append("\n".join(values["files"]))
    return "\n\n".join(parts)


def _gait(shown: dict[str, Any]) -> str:
    """A row for each foot, then the cadence."""
    rows: list[tuple[str, ...]] = [("foot", "heel strikes", "toe offs", "step [m]", "stride [m]", "stance", "on floor")]
    forms = {"step_length_m": ".3f", "stride_length_m": ".3f", "stance_share": ".0%"}
    for side in shown["on_floor_share"]:
        events = (_frames(shown[key][side]) for key in ("strike_frames", "off_frames"))
        means = (_number(shown[key][side], form) for key, form in forms.items())
        rows.append((side, *events, *means, f"{shown['on_floor_share'][side]:.0%}"))
    return f"{table(rows)}\ncadence: {_number(shown['cadence_per_minute'], '.1f')} steps a minute"


def _frames(numbers: list[int]) -> str:
    """Frame numbers; of many the first and how many there are."""
    first = " ".join(map(str, numbers[:6])) or "-"
    return first + (f" ... ({len(numbers)})" if len(numbers) > 6 else "")


def summary(report: dict[str, Any]) -> str:
    """The headline numbers of :func:`mmocap_warp.result.evaluation.evaluate` for people."""
    statuses = [f"{report['lost']} lost", f"{report['partial']} with a view lost"]
    statuses += [f"{report[name]} {name}" for name in ("rescued", "interpolated", "repeated") if report[name]]
    rows: list[tuple[str, ...]] = [
        ("frames", f"{report['frames']} ({', '.join(statuses)})"),
        ("runs", str(report["runs"])),
        ("evaluations", _number(report["evaluations"], ",d")),
        ("evaluations/s", _number(report["evaluations_per_second"], ",.0f")),
        ("mean IoU", _number(report["mean_iou"], ".3f")),
        ("worst IoU", f"{_number(report['worst_iou'], '.3f')} (frame {report['worst_iou_frame']})"),
        ("shake", f"{_number(report['shake_mm'], '.1f')} mm"),
    ]
    if report.get("truth_frames", report["frames"]) < report["frames"]:
        rows.append(("with truth", f"{report['truth_frames']} frames"))
    errors = (
        ("MPJPE", "mpjpe_mm"),
        ("PA-MPJPE", "pa_mpjpe_mm"),
        ("median joint error", "median_joint_mm"),
        ("  offsets removed", "median_joint_offsets_removed_mm"),
        ("Eq. 20 as printed", "eq20_as_printed_mm"),
        ("Eq. 20 from own answer", "marker_error_mm"),
    )
    rows += [(name, _error(report, key)) for name, key in errors if report.get(key) is not None]
    rows += [(name, f"{_number(error, '.1f')} mm") for name, error in report.get("median_mm_by_attached", {}).items()]
    if report.get("median_angle_deg") is not None and report.get("marker_error_mm") is None:  # of a robot or a hand
        rows.append(("median angle error", f"{report['median_angle_deg']:.2f} degrees"))
    rows += [(name, f"{_number(error, '.1f')} mm") for name, error in report.get("median_mm_by_shift", {}).items()]
    if report.get("growth") is not None:
        rows.append(("growth of MPJPE", f"{report['growth']:.2f} (last third over first)"))
    if report.get("limb_lost_frames"):
        rows.append(("limb lost in", f"{len(report['limb_lost_frames'])} frames"))
    if report.get("wrongly_tracked"):
        rows.append(("wrongly tracked", f"{report['wrongly_tracked']} frames"))
    return "\n".join([table(rows), *_judgement(report)])


def _judgement(report: dict[str, Any]) -> list[str]:
    """Overlap by camera, and the verdict in words, where there is one."""
    overlap = [f"{name} {_number(iou, '.3f')}" for name, iou in report.get("iou_by_camera", {}).items()]
    return [f"IoU by camera: {', '.join(overlap)}", *report["verdict"]["lines"]] if "verdict" in report else []


def beside(reports: dict[str, dict[str, Any]]) -> str:
    """Trackers by name, a row each, with the numbers that tell them apart."""
    rows: list[tuple[str, ...]] = [("", "Eq. 20", "MPJPE", "shake", "mean IoU", "worst IoU", "time")]
    for name, report in reports.items():
        lengths = (f"{_number(report.get(key), '.1f')} mm" for key in ("marker_error_mm", "mpjpe_mm", "shake_mm"))
        overlaps = (_number(report[key], ".3f") for key in ("mean_iou", "worst_iou"))
        rows.append((name, *lengths, *overlaps, f"{report['seconds']:.1f} s"))
    return table(rows)


def _error(report: dict[str, Any], key: str) -> str:
    """An error, its floor where it has one, and the markers that it leaves out."""
    floor, left_out = (report.get(key.replace("_mm", ending)) for ending in ("_floor_mm", "_left_out"))
    notes = [f"floor {floor:.1f}"] if floor is not None else []
    notes += [f"markers left out: {left_out}"] if left_out else []
    return f"{report[key]:.1f} mm" + (f" ({', '.join(notes)})" if notes else "")


def _number(value: float | None, form: str) -> str:
    return "-" if value is None or math.isnan(value) else format(value, form)
