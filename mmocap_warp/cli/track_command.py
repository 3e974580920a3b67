"""``mmocap track``, ``fit`` and ``demo``: from a scene to a subject and a result."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from mmocap_warp.cli.command_help import documented_by
from mmocap_warp.cli.console import (
    CHECK_FAILED,
    OK,
    Console,
    Identity,
    Output,
    SceneFile,
    SceneFrames,
    Switch,
    flags_of,
    given,
    next_step,
)
from mmocap_warp.errors import InputError
from mmocap_warp.fitting.fit_config import FitConfig
from mmocap_warp.tracking.track_config import TrackConfig

if TYPE_CHECKING:
    TrackFlags: TypeAlias = TrackConfig
    FitFlags: TypeAlias = FitConfig
else:
    TrackFlags, FitFlags = flags_of(TrackConfig), flags_of(FitConfig)


@documented_by("track:track")
def track(
    scene: SceneFile,
    /,
    *,
    output: Annotated[Path, Output],
    subject: Path | None = None,
    body: str | None = None,
    rigid: bool | None = None,
    frames: SceneFrames = None,
    identity: Identity = None,
    flags: TrackFlags | None = None,
    resume: Switch = False,
    accept_changed_code: Switch = False,
    trust_cameras: Switch = False,
    force: Switch = False,
    console: Console | None = None,
) -> None:
    from mmocap_warp.cli.result_report import summary
    from mmocap_warp.commands.evaluate import evaluate_in_scene
    from mmocap_warp.commands.inputs import scene_from
    from mmocap_warp.commands.track import track

    console, flags = console or Console(), flags or TrackFlags()
    loaded = scene_from(scene, frames, identity)
    tracked = track(
        loaded,
        subject,
        output=output,
        body=body,
        rigid=rigid,
        resume=resume,
        accept_changed_code=accept_changed_code,
        trust_cameras=trust_cameras,
        force=force,
        reporter=console,
        **given(flags),
    )
    try:
        report, warning = evaluate_in_scene(tracked, loaded)
    except InputError:
        console.warn(f"{output} is written, but cannot be compared with the scene's truth:")
        raise
    step = next_step("show", output)
    values = {"result": output, **report, "config": tracked.config, "next": step}
    console.result(values, f"{output}\n{summary(report)}\nnext: {step}")
    if warning:
        console.warn(warning)


@documented_by("fit:fit", start_pose="start_poses")
def fit(
    scene: SceneFile,
    /,
    *,
    output: Annotated[Path, Output] = Path("subject.usdc"),
    body: str | None = None,
    start_pose: list[str] | None = None,
    frames: SceneFrames = None,
    identity: Identity = None,
    flags: FitFlags | None = None,
    trust_cameras: Switch = False,
    force: Switch = False,
    console: Console | None = None,
) -> None:
    from mmocap_warp.commands.fit import fit

    console, flags = console or Console(), flags or FitFlags()
    subject = fit(
        scene,
        body,
        output=output,
        start_poses=start_pose,
        frames=frames,
        identity=identity,
        trust_cameras=trust_cameras,
        force=force,
        reporter=console,
        **given(flags),
    )
    known, name = subject.provenance, subject.body.name
    values = {"file": output, "body": name, "height_m": known["body.height"], **known}
    console.result(values, f"{output}: {name}, {_measures(known)}")


def _measures(provenance: dict[str, str | float | int]) -> str:
    """How large the body is, and its bones, with their standard deviations, for people."""
    measure, adjective = ("length", "long") if "body.length" in provenance else ("height", "tall")
    size, frames = f"{float(provenance[f'body.{measure}']):.2f} m {adjective}", provenance["fit.frames"]
    of_size = 1000 * float(provenance[f"body.{measure}.sigma"])
    if of_size == 0:
        return f"{size}, as given; seen in {frames} frames"
    sigma = [1000 * float(value) for name, value in provenance.items() if re.fullmatch(r"body\.bone\..*\.sigma", name)]
    bones = f", bones to {min(sigma):.0f} to {max(sigma):.0f} mm" if sigma else ""
    return f"{size}, known to {of_size:.0f} mm{bones} from {frames} frames"


@documented_by("demo:demo")
def demo(
    example: Literal["walk", "fox", "hand", "quadruped", "arm"] = "walk",
    /,
    *,
    output: Annotated[Path, Output] = Path("mmocap-out"),
    paper: Switch = False,
    console: Console | None = None,
) -> int:
    from mmocap_warp.cli.result_report import beside, summary
    from mmocap_warp.commands.demo import EXAMPLES, MOST_ERROR_MM, MOST_SHARE, PAPERS, demo

    console = console or Console()
    shown = demo(example, output, paper=paper, reporter=console)
    values = {**shown.report, **shown.files}
    files, lines = list(shown.files.items()), [summary(shown.report)]
    if shown.paper is not None:
        report, its_files = shown.paper
        values["paper"] = {**report, **its_files}
        files += its_files.items()
        lines += ["", beside({TrackConfig().algorithm: shown.report, PAPERS: report}), ""]
    failure = f"Eq. 20 from own answer is over {MOST_ERROR_MM:.0f} mm"
    if example != "walk":
        values |= {"size_m": shown.size, "mpjpe_share": shown.share}
        lines += [f"MPJPE is {100 * shown.share:.2f} % of the {EXAMPLES[example].body}'s {shown.size:.2f} m", ""]
        failure = f"joints are off by over {100 * MOST_SHARE:.0f} % of its size"
    lines += [f"{name:<8} {path}" for name, path in files]
    if not shown.good:
        lines.append(f"check failed: {failure}")
    console.result({**values, "error_ok": shown.good}, "\n".join(lines))
    return OK if shown.good else CHECK_FAILED
