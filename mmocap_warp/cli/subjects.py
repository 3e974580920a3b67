"""Fitting a subject to a scene's first frame, with a line of progress."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mmocap_warp.cli.console import Console
from mmocap_warp.cli.progress import Progress

if TYPE_CHECKING:
    from mmocap_warp.body.model import BodyModel, Subject
    from mmocap_warp.scene.recording import Scene
    from mmocap_warp.tracking.fit import FitConfig


def fit_subject(scene: Scene, body: BodyModel, config: FitConfig, console: Console) -> Subject:
    """Fit a body to the scene's first frame, showing progress.

    Raises:
        InputError: the first frame's masks do not show one subject.
    """
    from mmocap_warp.tracking.fit import fit

    with Progress("fit", None, quiet=console.quiet) as progress:
        return fit(scene, body, config, lambda stage, done, cost: progress(round(100 * done), 100))
