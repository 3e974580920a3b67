"""Clips that are made: ``mmocap study make``."""

from collections.abc import Sequence
from pathlib import Path

from mmocap_warp.commands.caller import Reporter
from mmocap_warp.commands.outputs import new_folder, releases_locks
from mmocap_warp.errors import UsageError
from mmocap_warp.study.degradations import NONE, degraded, write_people, write_sequence
from mmocap_warp.study.sequences import CLIPS, SEQUENCES, clip_sequence
from mmocap_warp.study.source import open_sequence


@releases_locks
def make_sequences(
    folder: str | Path,
    sequences: str | Sequence[str] = (),
    *,
    frames: int | None = None,
    degrade: str = "none",
    seed: int = 0,
    clip: str | Path | None = None,
    together: bool = False,
    apart: float | None = None,
    force: bool = False,
    reporter: Reporter | None = None,
) -> dict[str, Path]:
    """Write shipped sequences as scenes, to look at or to track on their own.

    Args:
        folder: the folder to write; each sequence gets its own in it, such as S1/Walking.
        sequences: which: S1, S2 or S3 with /Walking, /Gestures or /Box, S1 or S2 with /Spin, /Handshake or /Fight,
            or Uneven, Skirt, Swing, Coat or Child with /Walking. [default: the nine of S1 to S3]
        frames: at most so many of each. [default: all]
        degrade: what makes them worse: passer-by, furniture, fps=15, views=3, cut=2 (or all), calibration=10 (pixels),
            or several joined by +; with +labelled, what gets in the way has a label, and so have loose clothes.
        seed: of what is random in that.
        clip: a .bvh file whose motion takes the place of the one sequence's own.
        together: the people of the sequences, two or more, are in one scene of label images and pass each other.
        apart: how near to each other they come [m]; 0.4 is a hold, 0.82 for /Handshake, 0.9 for /Fight.
            [default: 0.7, a hand between shoulders that pass]
        force: write among files that are there.
        reporter: receives progress.

    Returns:
        The scenes' files, by the sequences' names.

    Raises:
        UsageError: arguments that cannot be, or that contradict each other.
        InputError: a clip that cannot be read, or a folder that cannot be written to.
    """
    sequences = [sequences] if isinstance(sequences, str) else sequences
    if unknown := [name for name in sequences if name not in CLIPS]:
        raise UsageError(f"--sequence {unknown[0]} is not one of {', '.join(CLIPS)}")
    if frames is not None and frames < 1:
        raise UsageError(f"--frames must be at least 1, got {frames}")
    if clip is not None and len(sequences) != 1:
        raise UsageError("--clip needs one --sequence, whose person and cameras it takes")
    if clip is not None and sequences[0] not in SEQUENCES:
        raise UsageError(f"--clip needs a --sequence of {', '.join(SEQUENCES)}, got {sequences[0]}")
    if seed < 0:
        raise UsageError(f"--seed must be at least 0, got {seed}")
    if seed and degrade == NONE:
        raise UsageError("--seed is of what --degrade does at random: give both")
    given = CLIPS if clip is None else {sequences[0]: clip_sequence(sequences[0], clip)}
    chosen = {name: given[name].first(frames) for name in sequences or tuple(SEQUENCES)}
    try:
        for made in chosen.values() if degrade != NONE else ():  # refused before anything is written
            degraded(open_sequence(made), degrade, seed)
    except ValueError as error:
        raise UsageError(f"--degrade: {error}") from None
    people = {name.split("/")[0] for name in sequences}
    if together and (len(people) < 2 or len(people) < len(sequences) or degrade != NONE or clip is not None):
        raise UsageError("--together needs two or more --sequence of different people, without --clip and --degrade")
    if apart is not None and not together:
        raise UsageError("--apart is of people in one recording: give --together too")
    apart = 0.7 if apart is None else apart
    if not 0 < apart < 10:
        raise UsageError(f"--apart must be above 0 and below 10, got {apart:g}")
    folder = new_folder(folder, force=force)
    if together:
        shortest = min(CLIPS[name].frame_count for name in sequences)
        of_people = [CLIPS[name].first(min(frames or shortest, shortest)) for name in sequences]
        with (reporter or Reporter()).stage("make people") as progress:
            return {" and ".join(sequences): write_people(folder, of_people, apart, progress)}
    scenes = {}
    for name, made in chosen.items():
        with (reporter or Reporter()).stage(f"make {name}") as progress:
            scenes[name] = write_sequence(folder / name, made, progress, degradation=degrade, seed=seed)
    return scenes
