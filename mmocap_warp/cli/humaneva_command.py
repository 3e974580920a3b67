"""``mmocap humaneva``: a sequence of a user's own HumanEva-I as a scene."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from mmocap_warp.cli.console import Console, Switch

if TYPE_CHECKING:
    from mmocap_warp.formats.humaneva.sequence import HumanEvaSequence


def humaneva(
    root: Path,
    subject: str,
    action: str,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    first: int | None = None,
    last: int | None = None,
    force: Switch = False,
    console: Console | None = None,
) -> None:
    """Write a sequence of your own copy of HumanEva-I as a scene.

    Parameters
    ----------
    root
        The folder that holds S1, S2, S3 and Background.
    subject
        S1, S2 or S3.
    action
        Walking, Gestures or Box, the paper's; also Jog and ThrowCatch.
    output
        The folder to write.
    first
        First frame in HumanEva's own numbers, which count from 1. [default: 6, the first usable one]
    last
        Last frame, included. [default: the last of HumanEva's own list]
    force
        Write into a folder that holds files.
    """
    import numpy as np

    from mmocap_warp.commands.outputs import new_folder
    from mmocap_warp.formats.humaneva.scene_folder import write_scene
    from mmocap_warp.formats.humaneva.sequence import FIRST_FRAME, read_sequence

    console = console or Console()
    sequence = read_sequence(root, subject, action, FIRST_FRAME if first is None else first, last)
    written = write_scene(new_folder(output, force=force), sequence)
    for warning in _warnings(sequence):
        print(f"mmocap: warning: {warning}", file=sys.stderr)
    with_truth = int(np.isfinite(sequence.truth.markers).all(axis=(1, 2)).sum())
    values = {
        "scene": written,
        "frames": sequence.count,
        "truth_frames": with_truth,
        "first": sequence.first,
        "last": sequence.first + sequence.count - 1,
        "cameras": sequence.rig.names,
        "frame_offsets": sequence.frame_offsets,
        "starts_as_published": sequence.starts_as_published,
        "mocap_per_frame": sequence.sync.mocap_per_frame,
        "joints": sequence.truth.joint_names,
        "backgrounds": [background.path.name for background in sequence.backgrounds],
    }
    console.result(values, f"{written}: {sequence.count} frames, {with_truth} with truth, {len(sequence.rig)} cameras")


def _warnings(sequence: HumanEvaSequence) -> Iterator[str]:
    """What is odd in the data but may be so."""
    if not sequence.starts_as_published:
        starts = ", ".join(str(start) for start in sequence.sync.start[:3])
        yield (
            f"videos C1, C2, C3 start at their frames {starts}, others who use the data found other ones; "
            "has its Critical_Update_OFS_files been applied?"
        )
    if sequence.no_joints:
        yield f"the truth has markers but no joints: {sequence.no_joints}"
