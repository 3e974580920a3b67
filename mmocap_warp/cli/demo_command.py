"""``mmocap demo``: the built-in scene, or one of another body, tracked and compared with its truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from mmocap_warp.cli.console import Console, Switch
from mmocap_warp.cli.exit_codes import CHECK_FAILED, OK

if TYPE_CHECKING:
    from mmocap_warp.cli.track_command import Start
    from mmocap_warp.scene.recording import Scene
    from mmocap_warp.tracking.track_config import TrackConfig

MOST_ERROR_MM = 30.0
"""Mean of Eq. 20 from each run's own first answer that an installation which works stays under."""
MOST_SHARE = 0.02
"""The same of other bodies: mean error of joints, as a share of the body's size."""
PAPERS = "h-cmaes"
"""The tracker that the paper found best."""


@dataclass(frozen=True)
class Example:
    """A scene that is made when it is asked for.

    Attributes:
        body: a shipped body's name.
        motion: of it.
        cameras: how many.
    """

    body: str
    motion: str
    cameras: int


EXAMPLES = {
    "fox": Example("fox", "Walk", 6),
    "hand": Example("hand", "Opening", 4),
    "quadruped": Example("anymal", "Trot", 6),
    "arm": Example("panda", "Pick", 4),
}


def demo(
    example: Literal["walk", "fox", "hand", "quadruped", "arm"] = "walk",
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])] = Path("mmocap-out"),
    paper: Switch = False,
    console: Console | None = None,
) -> int:
    """Track the built-in scene and compare with its truth.

    Parameters
    ----------
    example
        What to track: the built-in walk of a person, or a made scene of a fox, a hand, or a robot with four legs or
        an arm.
    output
        Folder to write, made if it does not exist.
    paper
        Track the walk with the paper's best tracker too, from the same fit, and put both beside each other.
    """
    from mmocap_warp.cli.exit_codes import UsageError

    console = console or Console()
    if example == "walk":
        return _walk(output, paper, console)
    if paper:
        raise UsageError("--paper is of the walk; leave it out")
    return _made_example(example, output, console)


def _walk(output: Path, paper: bool, console: Console) -> int:
    from mmocap_warp.cli.flag_settings import effective
    from mmocap_warp.cli.outputs import new_folder
    from mmocap_warp.cli.result_report import beside, summary
    from mmocap_warp.cli.track_command import Start, TrackFlags
    from mmocap_warp.scene.scene_toml import load_scene
    from mmocap_warp.scenes import ROOT
    from mmocap_warp.tracking.track_config import TrackConfig

    folder = new_folder(output, force=True)
    scene = load_scene(ROOT / "walk")
    config = effective(TrackConfig, scene.settings("track"), TrackFlags())
    report, files = _tracked(scene, config, folder, "walk", Start(force=True), console)
    values, written = {**report, **files}, list(files.items())
    lines = [summary(report)]
    if paper:
        flags = TrackFlags(algorithm=PAPERS)
        same = Start(subject=scene.subject or folder / "walk.subject.usdc", flags=flags, force=True)
        other = effective(TrackConfig, scene.settings("track"), flags)
        papers, its_files = _tracked(scene, other, folder, f"walk-{PAPERS}", same, console)
        values["paper"] = {**papers, **its_files}
        written += its_files.items()
        lines += ["", beside({config.algorithm: report, PAPERS: papers}), ""]
    good = report["marker_error_mm"] <= MOST_ERROR_MM
    lines += [f"{name:<8} {path}" for name, path in written]
    if not good:
        lines.append(f"check failed: Eq. 20 from own answer is over {MOST_ERROR_MM:.0f} mm")
    console.result({**values, "error_ok": good}, "\n".join(lines))
    return OK if good else CHECK_FAILED


def _made_example(name: str, output: Path, console: Console) -> int:
    """Make a scene of another body, and track it from its true first pose."""
    import numpy as np

    from mmocap_warp.cli.flag_settings import effective
    from mmocap_warp.cli.outputs import new_folder
    from mmocap_warp.cli.progress import Progress
    from mmocap_warp.cli.result_report import summary
    from mmocap_warp.cli.track_command import Start, TrackFlags
    from mmocap_warp.formats.usd.usd_body import read_body, read_motions
    from mmocap_warp.rigging.shipped import body_file
    from mmocap_warp.scene.scene_toml import load_scene
    from mmocap_warp.synthesis.any_body import recorded, write_recorded
    from mmocap_warp.tracking.track_config import TrackConfig

    example, folder = EXAMPLES[name], new_folder(output, force=True)
    file = body_file(example.body)
    body = read_body(file)
    recording = recorded(body, read_motions(file)[example.motion], example.cameras)
    with Progress("synth", quiet=console.quiet) as progress:
        made = write_recorded(folder / f"{name}-scene", recording, faulty=True, file=file, progress=progress)
    scene = load_scene(made)
    config = effective(TrackConfig, scene.settings("track"), TrackFlags())
    report, files = _tracked(scene, config, folder, name, Start(force=True), console)
    size = float(np.ptp(body.skin.rest[np.unique(body.skin.face)], axis=0).max())
    share = report["mpjpe_mm"] / 1000 / size
    good = share <= MOST_SHARE
    lines = [summary(report), f"MPJPE is {100 * share:.2f} % of the {example.body}'s {size:.2f} m", ""]
    lines += [f"{kind:<8} {path}" for kind, path in {"scene": scene.path, **files}.items()]
    if not good:
        lines.append(f"check failed: joints are off by over {100 * MOST_SHARE:.0f} % of its size")
    values = {**report, "scene": scene.path, **files, "size_m": size, "mpjpe_share": share, "error_ok": good}
    console.result(values, "\n".join(lines))
    return OK if good else CHECK_FAILED


def _tracked(
    scene: Scene, config: TrackConfig, folder: Path, name: str, start: Start, console: Console
) -> tuple[dict[str, Any], dict[str, Path]]:
    """Track, judge and draw: the report and the files."""
    from mmocap_warp.cli.result_report import draw_result, truth_of
    from mmocap_warp.cli.track_command import track_scene
    from mmocap_warp.display.result_plots import plot_report
    from mmocap_warp.result.evaluation import evaluate

    files = {
        "result": folder / f"{name}.usdc",
        "overlay": folder / f"{name}.webm",
        "sheet": folder / f"{name}.png",
        "plot": folder / f"{name}-error.svg",
    }
    result = track_scene(scene, config, files["result"], start, console)
    report = evaluate(result, truth_of(scene))
    draw_result(result, scene, files["overlay"], files["sheet"], console)
    plot_report(files["plot"], report)
    del report["series"]
    return report, files
