"""``mmocap track``, ``fit`` and ``demo``: from a scene to a subject and a result."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from mmocap_warp.cli.command import BY_PLACE, REQUIRED, Answer, Given, command
from mmocap_warp.cli.console import CHECK_FAILED, OK, Console, SceneFrames, flags_of, next_step
from mmocap_warp.errors import InputError
from mmocap_warp.fitting.fit_config import FitConfig
from mmocap_warp.tracking.track_config import TrackConfig

if TYPE_CHECKING:
    from mmocap_warp.scene.recording import Scene

TrackFlags, FitFlags = flags_of(TrackConfig), flags_of(FitConfig)


@command("track:track", output=Given(Path, REQUIRED), frames=SceneFrames, settings=TrackFlags | None)
def track(call: Any, console: Console, loaded: Scene, output: Path) -> None:
    from mmocap_warp.cli.result_commands import summary
    from mmocap_warp.commands.evaluate import evaluate_in_scene

    tracked = call()
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


@command(
    "track:fit",
    order="output body",
    output=Given(Path, Path("subject.usdc")),
    start_poses=Annotated[list[str] | None, Parameter(name="--start-pose")],
    frames=SceneFrames,
    settings=FitFlags | None,
)
def fit(call: Any, output: Path) -> Answer:
    subject = call()
    known, name = subject.provenance, subject.body.name
    values = {"file": output, "body": name, "height_m": known["body.height"], **known}
    return Answer(values, [f"{output}: {name}, {_measures(known)}"])


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


@command("demo:demo", example=Given(Literal["walk", "fox", "hand", "quadruped", "arm"], kind=BY_PLACE))
def demo(call: Any, example: str) -> Answer:
    from mmocap_warp.cli.result_commands import beside, summary
    from mmocap_warp.commands.demo import EXAMPLES, MOST_ERROR_MM, MOST_SHARE, PAPERS

    shown = call()
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
    return Answer({**values, "error_ok": shown.good}, lines, OK if shown.good else CHECK_FAILED)
