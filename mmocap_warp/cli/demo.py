"""``mmocap demo``: the built-in scene, tracked and compared with its truth."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from mmocap_warp.cli.console import Console, Switch
from mmocap_warp.cli.exit_codes import CHECK_FAILED, OK

if TYPE_CHECKING:
    from mmocap_warp.cli.track import Start
    from mmocap_warp.scene.recording import Scene
    from mmocap_warp.tracking.config import TrackConfig

MOST_ERROR_MM = 30.0
"""Mean of Eq. 20 from each run's own first answer that an installation which works stays under."""
PAPERS = "h-cmaes"
"""The tracker that the paper found best."""


def demo(
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])] = Path("mmocap-out"),
    paper: Switch = False,
    console: Console | None = None,
) -> int:
    """Track the built-in scene and compare with its truth.

    Parameters
    ----------
    output
        Folder to write, made if it does not exist.
    paper
        Track it with the paper's best tracker too, from the same fit, and put both beside each other.
    """
    from mmocap_warp.cli.judging import beside, summary
    from mmocap_warp.cli.outputs import new_folder
    from mmocap_warp.cli.settings import effective
    from mmocap_warp.cli.track import Start, TrackFlags
    from mmocap_warp.scene.scene_toml import load_scene
    from mmocap_warp.scenes import ROOT
    from mmocap_warp.tracking.config import TrackConfig

    console = console or Console()
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


def _tracked(
    scene: Scene, config: TrackConfig, folder: Path, name: str, start: Start, console: Console
) -> tuple[dict[str, Any], dict[str, Path]]:
    """Track, judge and draw: the report and the files."""
    from mmocap_warp.cli.judging import draw_result, truth_of
    from mmocap_warp.cli.track import track_scene
    from mmocap_warp.drawing.plot import plot_report
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
