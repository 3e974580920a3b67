"""Scenes that are written: of a folder of videos, of a body that moves, of published data sets.

``mmocap init``, ``mmocap synth`` and ``mmocap dataset``.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mmocap_warp.body.model import motion_named
from mmocap_warp.commands.caller import Reporter
from mmocap_warp.commands.outputs import new_file, new_folder, releases_locks
from mmocap_warp.errors import InputError, UsageError
from mmocap_warp.formats.datasets.dataset_scene import DatasetScene
from mmocap_warp.formats.table import read_dataset
from mmocap_warp.formats.usd.usd_body import read_body, read_motions
from mmocap_warp.rigging.shipped import body_file
from mmocap_warp.scene.drafting import Draft, draft_scene
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.synthesis.any_body import recorded, write_recorded
from mmocap_warp.synthesis.footage.made_recording import Recording
from mmocap_warp.whole_file import write_whole


@dataclass(frozen=True, repr=False)
class MadeScene:
    """A made recording that was written as a scene."""

    scene: Path  # its file
    recording: Recording  # the body, its poses and the cameras
    motion: str  # the name of its motion

    def __repr__(self) -> str:
        made = self.recording
        return f"{self.scene}: {len(made)} frames of {self.motion} at {made.fps:g} a second, {len(made.rig)} cameras"


@releases_locks
def init(folder: str | Path, *, force: bool = False) -> Draft:
    """Write a scene.toml for the videos, images, masks and calibration in a folder.

    Args:
        folder: where the videos lie, at any depth; projects of Pose2Sim, EasyMocap, Caliscope and OpenCap are known.
        force: replace a scene.toml that exists.

    Returns:
        What was found, and what is missing before the scene can be tracked.

    Raises:
        InputError: no such folder, or no videos in it.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(folder, "no such folder", "give the folder that the videos lie in")
    scene = new_file(folder / "scene.toml", ".toml", force=force)
    draft = draft_scene(folder)
    write_whole(scene, draft.text.encode())
    # What reading the scene finds wrong is missing too.
    if not draft.missing:
        try:
            load_scene(scene, masks=False)
        except InputError as error:
            draft.missing.append(str(error))
    return draft


@releases_locks
def synthesize(
    body: str | Path,
    output: str | Path,
    *,
    motion: str | None = None,
    cameras: int = 6,
    size: tuple[int, int] = (640, 480),
    perfect: bool = False,
    seed: int = 0,
    force: bool = False,
    reporter: Reporter | None = None,
) -> MadeScene:
    """Write a scene of a body in one of its own motions, with made masks and known truth.

    Args:
        body: a body's USD file with motions, such as 'mmocap body import' writes, or a shipped one's name, such as fox.
        output: the scene's folder.
        motion: which of its motions. [default: the first]
        cameras: how many; they stand evenly around the body and see all of it.
        size: width and height of their images, in pixels.
        perfect: masks without faults; by default they have ragged contours, holes and specks.
        seed: of the faults.
        force: write into a folder that holds files.
        reporter: receives progress.

    Raises:
        UsageError: no camera, images of no size, or a negative seed.
        InputError: a body without such a motion, or a folder that cannot be written to.
    """
    file = body_file(str(body))
    read, motions = read_body(file), read_motions(file)
    if not motions:
        raise InputError(file, "has no motions", "import a file with animations, or name another body")
    name = motion or next(iter(motions))
    chosen = motion_named(name, motions, file)
    if cameras < 1 or min(size) < 1:
        raise UsageError(f"--cameras and --size must be at least 1, got {cameras} and {size[0]} {size[1]}")
    if seed < 0:
        raise UsageError(f"--seed must be at least 0, got {seed}")
    folder = new_folder(output, force=force)
    recording = recorded(read, chosen, cameras, size=size, faulty=not perfect, seed=seed)
    with (reporter or Reporter()).stage("synth") as progress:
        scene = write_recorded(folder, recording, not perfect, file=file, progress=progress)
    return MadeScene(scene, recording, name)


@releases_locks
def import_dataset(
    name: str,
    root: str | Path,
    parts: Sequence[str],
    output: str | Path,
    *,
    force: bool = False,
    reporter: Reporter | None = None,
) -> DatasetScene:
    """Write a recording of your own copy of a published data set as a scene.

    Args:
        name: of the data set, such as panoptic.
        root: the folder that holds your copy.
        parts: which recording, such as S1 Seq1; see the docs on sequences.
        output: the folder to write; the scene's file is scene.toml there.
        force: write into a folder that holds files.
        reporter: receives warnings.

    Raises:
        UsageError: an unknown data set, or too few or too many parts.
        InputError: data that are missing or cannot be read.
    """
    scene = read_dataset(name, Path(root), parts)
    scene.write(new_folder(output, force=force))
    for note in scene.notes:
        (reporter or Reporter()).warn(note)
    return scene
