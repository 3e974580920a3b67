"""Where tracking starts: the subject a scene names, or one that is fitted to its first frame."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from mmocap_warp.cli.console import Console
from mmocap_warp.cli.progress import Progress
from mmocap_warp.errors import InputError

if TYPE_CHECKING:
    from mmocap_warp.body.model import BodyModel, Subject
    from mmocap_warp.scene.recording import Scene
    from mmocap_warp.tracking.fit import FitConfig

DEFAULT_BODY = "adult_man"
"""Where a fit starts if neither a flag nor the scene says."""


def body_named(name: str | Path, source: object) -> BodyModel:
    """A body by the path of its USD file or by the name of a shipped one.

    Raises:
        InputError: neither; ``source`` is where the name stands.
    """
    from mmocap_warp.formats.usd.body import read_body
    from mmocap_warp.scenes import ROOT

    if Path(name).suffix:
        return read_body(name)
    shipped = ROOT / "bodies" / f"{name}.usdc"
    if not shipped.is_file():
        known = ", ".join(sorted(file.stem for file in shipped.parent.glob("*.usdc")))
        raise InputError(source, f"there is no body '{name}'", f"name a USD file, or one of {known}")
    return read_body(shipped)


def fit_subject(scene: Scene, body: BodyModel, config: FitConfig, console: Console) -> Subject:
    """Fit a body to the scene's first frame, showing progress.

    Raises:
        InputError: the first frame's masks do not show one subject.
    """
    from mmocap_warp.tracking.fit import fit

    with Progress("fit", None, quiet=console.quiet) as progress:
        return fit(scene, body, config, lambda stage, done, cost: progress(round(100 * done), 100))
