"""Fitting a subject to a scene, with a line of progress, and what is to be said of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from mmocap_warp.cli.console import Console

if TYPE_CHECKING:
    import numpy as np

    from mmocap_warp.body.model import BodyModel, Subject
    from mmocap_warp.fitting.subject_fit import FitConfig
    from mmocap_warp.scene.recording import Scene


def fit_subject(
    scene: Scene,
    body: BodyModel,
    config: FitConfig,
    output: Path,
    console: Console,
    start_poses: np.ndarray | None = None,
) -> Subject:
    """Fit a body to a scene and write it to ``output``, showing progress, with a line where masks do not decide.

    ``start_poses`` (pose, coordinate) are those in which the recording may start; None for the body's usual ones.

    Raises:
        InputError: the first frame's masks do not show one subject.
    """
    import numpy as np

    from mmocap_warp.commands.inputs import scene_reference
    from mmocap_warp.fitting.subject_fit import fit
    from mmocap_warp.formats.usd.usd_body import write_subject
    from mmocap_warp.rigging.attaching import carrying

    carried = carrying(body, scene.attached)
    for note in carried.notes:
        console.note(f"attach: {note}")
    poses = start_poses
    if poses is not None:  # what is attached begins as it is carried; its joints come last
        poses = np.pad(poses, ((0, 0), (0, carried.body.skeleton.coordinates - poses.shape[1])))
    with console.stage("fit", None) as progress:
        subject = fit(scene, carried.body, config, lambda stage, done, cost: progress(round(100 * done), 100), poses)
    if subject.provenance["fit.decided"] == "no":
        name = str(subject.provenance["fit.alternative"])
        console.note((_UNDECIDED if body.skeleton.stands else _UNDECIDED_LYING)[name])
    chosen = {"fit.identity": scene.foreground.identity} if scene.foreground.identity else {}
    reference = {"fit.scene": scene_reference(scene.path, output)}
    subject = replace(subject, provenance={**subject.provenance, **reference, **chosen})
    write_subject(output, subject)
    return subject


_UNDECIDED = {
    "turned": "fit: the masks do not tell which way the subject faces; it may be back to front",
    "swapped": "fit: the masks do not tell left limbs from right ones; they may be swapped",
}
_UNDECIDED_LYING = {
    "turned": "fit: the masks do not tell which way the subject lies; it may be turned far from it",
    "swapped": "fit: the masks do not tell limbs that are alike from one another; they may be exchanged",
}
