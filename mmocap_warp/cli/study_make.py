"""``mmocap study make``: shipped sequences as scenes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from mmocap_warp.cli.console import Console, Switch
from mmocap_warp.errors import UsageError


def make(
    folder: Path,
    /,
    *,
    sequence: Annotated[tuple[str, ...], Parameter(negative="", show_default=False)] = (),
    frames: int | None = None,
    degrade: str = "none",
    seed: int = 0,
    clip: Path | None = None,
    skeleton: Path | None = None,
    markers: Path | None = None,
    force: Switch = False,
    console: Console | None = None,
) -> None:
    """Write shipped sequences as scenes, to look at or to track on their own.

    Parameters
    ----------
    folder
        The folder to write; each sequence gets its own in it, such as S1/Walking.
    sequence
        Which: S1, S2 or S3 with /Walking, /Gestures or /Box, or one of the further clips: S1/Spin, S2/Spin,
        Uneven/Walking, Skirt/Walking, Child/Walking; may be given several times. [default: the nine of S1 to S3]
    frames
        At most so many of each. [default: all]
    degrade
        What makes them worse: passer-by, furniture, fps=15, views=3, cut=2 (or all), calibration=10 (pixels), or
        several joined by +.
    seed
        Of what is random in that.
    clip
        A .bvh or .amc file whose motion takes the place of the one sequence's own.
    skeleton
        The .asf of an .amc. [default: beside it, named as the .amc up to '_']
    markers
        The .c3d of the same take as an .amc; its marker paths become the truth.
    force
        Write among files that are there.
    """
    from mmocap_warp.commands.outputs import new_folder
    from mmocap_warp.study.degradations import parse
    from mmocap_warp.study.further_clips import CLIPS
    from mmocap_warp.study.sequence_scene import write_sequence
    from mmocap_warp.study.sequences import SEQUENCES, clip_sequence

    console = console or Console()
    if unknown := [name for name in sequence if name not in CLIPS]:
        raise UsageError(f"--sequence {unknown[0]} is not one of {', '.join(CLIPS)}")
    if frames is not None and frames < 1:
        raise UsageError(f"--frames must be at least 1, got {frames}")
    if clip is not None and len(sequence) != 1:
        raise UsageError("--clip needs one --sequence, whose person and cameras it takes")
    if clip is not None and sequence[0] not in SEQUENCES:
        raise UsageError(f"--clip goes with one of {', '.join(SEQUENCES)}, not with {sequence[0]}")
    if clip is None and (skeleton or markers):
        raise UsageError(f"--{'skeleton' if skeleton else 'markers'} belongs to a --clip")
    try:
        parse(degrade)
    except ValueError as error:
        raise UsageError(f"--degrade: {error}") from None
    new_folder(folder, force=force)
    written = {}
    for name in sequence or tuple(SEQUENCES):
        made = CLIPS[name] if clip is None else clip_sequence(name, clip, skeleton, markers)
        made = made.first(min(frames or made.frame_count, made.frame_count))
        with console.stage(f"make {name}") as progress:
            try:
                written[name] = write_sequence(folder / name, made, progress, degradation=degrade, seed=seed)
            except ValueError as error:
                raise UsageError(f"--degrade: {error}") from None
    console.result(written, "\n".join(str(path) for path in written.values()))
