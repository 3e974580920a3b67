"""The built-in scene, or one of another body, tracked and compared with its truth: ``mmocap demo``."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from mmocap_warp.commands.caller import Reporter
from mmocap_warp.commands.inputs import truth_of
from mmocap_warp.commands.new_scenes import synthesize
from mmocap_warp.commands.outputs import new_folder, releases_locks
from mmocap_warp.commands.show import draw_result
from mmocap_warp.commands.track import track
from mmocap_warp.display.result_plots import plot_report
from mmocap_warp.errors import UsageError
from mmocap_warp.result.evaluation import evaluate
from mmocap_warp.scene.recording import Scene
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.scenes import ROOT

MOST_ERROR_MM = 30.0  # mean of Eq. 20 from each run's own first answer that an installation which works stays under
MOST_SHARE = 0.02  # the same of other bodies: mean error of joints, as a share of the body's size
PAPERS = "h-cmaes"  # the tracker that the paper found best


class Example(NamedTuple):
    """A scene that is made when it is asked for: a shipped body, one of its motions, and how many cameras there are."""

    body: str
    motion: str
    cameras: int


EXAMPLES = {
    "fox": Example("fox", "Walk", 6),
    "hand": Example("hand", "Opening", 4),
    "quadruped": Example("anymal", "Trot", 6),
    "arm": Example("panda", "Pick", 4),
}


@dataclass(frozen=True)
class Demo:
    """How well an example was tracked."""

    report: dict[str, Any]  # of :func:`mmocap_warp.result.evaluation.evaluate`, without its series
    files: dict[str, Path]  # what was written, by kind
    good: bool  # whether the error is what it is where all works
    # the report and the files of the paper's best tracker, where that was asked for
    paper: tuple[dict[str, Any], dict[str, Path]] | None = None
    size: float = float("nan")  # of a body that is no person [m]; NaN of the walk

    @property
    def share(self) -> float:
        """The mean error of joints, as a share of the size."""
        return self.report["mpjpe_mm"] / 1000 / self.size


@releases_locks
def demo(
    example: Literal["walk", "fox", "hand", "quadruped", "arm"] = "walk",
    output: str | Path = "mmocap-out",
    *,
    paper: bool = False,
    reporter: Reporter | None = None,
) -> Demo:
    """Track the built-in walk of a person, or a made scene of another body, and compare it with its truth.

    Result, subject, overlay video, contact sheet and a plot of error against frame replace those of an earlier demo.

    Args:
        example: what to track: the built-in walk, or a made scene of a fox, a hand, a robot with four legs or an arm.
        output: the folder to write, made if it does not exist.
        paper: track the walk with the paper's best tracker too, from the same fit, and put both beside each other.
        reporter: receives notes and progress.

    Raises:
        UsageError: no such example, or ``paper`` of another one than the walk.
        InputError: the folder cannot be written.
    """
    reporter = reporter or Reporter()
    if example != "walk" and example not in EXAMPLES:
        raise UsageError(f"--example must be one of {['walk', *EXAMPLES]}, got {example!r}")
    if paper and example != "walk":
        raise UsageError("--paper works with the walk only; leave it out")
    folder = new_folder(output, force=True)
    return _walk(folder, paper, reporter) if example == "walk" else _made_example(example, folder, reporter)


def _walk(folder: Path, paper: bool, reporter: Reporter) -> Demo:
    """Track the built-in scene."""
    scene = load_scene(ROOT / "walk")
    report, files = _tracked(scene, folder, "walk", reporter)
    papers = None
    if paper:
        subject = scene.subject or folder / "walk.subject.usdc"
        papers = _tracked(scene, folder, f"walk-{PAPERS}", reporter, subject=subject, algorithm=PAPERS)
    return Demo(report, files, report["marker_error_mm"] <= MOST_ERROR_MM, papers)


def _made_example(name: str, folder: Path, reporter: Reporter) -> Demo:
    """Make a scene of another body, and track it from its true first pose."""
    body, motion, cameras = EXAMPLES[name]
    made = synthesize(body, folder / f"{name}-scene", motion=motion, cameras=cameras, force=True, reporter=reporter)
    scene, skin = load_scene(made.scene), made.recording.body.skin
    report, files = _tracked(scene, folder, name, reporter)
    size = float(np.ptp(skin.rest[np.unique(skin.face)], axis=0).max())
    good = report["mpjpe_mm"] / 1000 / size <= MOST_SHARE
    return Demo(report, {"scene": scene.path, **files}, good, size=size)


def _tracked(
    scene: Scene, folder: Path, name: str, reporter: Reporter, **settings: Any
) -> tuple[dict[str, Any], dict[str, Path]]:
    """Track, judge and draw: the report and the files."""
    endings = {"result": ".usdc", "overlay": ".webm", "sheet": ".png", "plot": "-error.svg"}
    files = {kind: folder / f"{name}{ending}" for kind, ending in endings.items()}
    result = track(scene, output=files["result"], force=True, reporter=reporter, **settings)
    report = evaluate(result, truth_of(scene))
    draw_result(result, scene, files["overlay"], files["sheet"], reporter)
    plot_report(files["plot"], report)
    del report["series"]
    return report, files
