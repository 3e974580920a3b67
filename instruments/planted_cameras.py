"""What refining leaves of faults that are planted in the calibration of a sound scene, and whether that is as it says.

``python instruments/planted_cameras.py SCENE FRAMES BODY [FAULT...]`` plants each fault in the third camera, then
in all but the first, each in a direction of its own; all of ``FAULTS`` where none is named. The first camera stands
still, and where all others are moved, its distance to the farthest gives the scale: what is left needs no alignment.
The person is followed from the scene's subject or, to save time, from a fit with the sound cameras.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mmocap_warp.body.model import BodyModel, Subject
from mmocap_warp.calibration.adjust.adjustment import AdjustConfig, Adjustment
from mmocap_warp.calibration.adjust.camera_changes import (
    CENTRE,
    FOCAL,
    KINDS,
    OFFSET,
    POSITION,
    ROTATION,
    changed,
    difference,
)
from mmocap_warp.calibration.refine.refinement import Refinement, refine
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.formats.usd.usd_body import read_subject
from mmocap_warp.rigging.shipped import load_body
from mmocap_warp.scene.recording import Scene
from mmocap_warp.scene.scene_toml import load_scene

FAULTS: dict[str, tuple[slice, float]] = {
    "rotation": (ROTATION, float(np.radians(10.0))),
    "position": (POSITION, 0.3),
    "focal": (slice(FOCAL, FOCAL + 1), 0.03),
    "time": (slice(OFFSET, OFFSET + 1), 5.0),
}
"""Parameters, and how far these are off altogether [rad, m, logarithm, frames]."""

_ONE = 2  # the camera that is wrong alone


@dataclass(frozen=True, eq=False)
class Planted:
    """A scene with faults.

    Attributes:
        name: what was planted where.
        scene: the scene.
        config: how it is refined.
        change: (camera, parameter) what was done to the cameras; times in seconds.
    """

    name: str
    scene: Scene
    config: AdjustConfig
    change: np.ndarray


def planted(sound: Scene, fault: str, wrong: Sequence[int], config: AdjustConfig) -> Planted:
    """A scene of which some cameras have a fault, each in a direction of its own.

    Args:
        sound: the scene.
        fault: one of ``FAULTS``.
        wrong: numbers of the cameras; the first camera is told to stand still.
        config: how it is to be refined otherwise.
    """
    columns, size = FAULTS[fault]
    rig, rng = sound.calibrated, np.random.default_rng(1)
    change, later = np.zeros((len(rig), len(KINDS))), np.zeros(len(rig), int)
    for k in wrong:
        direction = rng.standard_normal(columns.stop - columns.start)
        change[k, columns] = size * direction / np.linalg.norm(direction)
    if fault == "time":
        later = change[:, OFFSET].round().astype(int)
        change[:, OFFSET] /= sound.fps
    cameras = tuple(
        replace(source, frame_offset=source.frame_offset + int(frames))
        for source, frames in zip(sound.cameras, later, strict=True)
    )
    distance = None
    if fault == "position" and len(wrong) > 1:
        far = np.linalg.norm(rig.centres - rig.centres[0], axis=1)
        distance = rig.names[0], rig.names[int(far.argmax())], float(far.max())
    where = "all but one" if len(wrong) > 1 else "one camera"
    wrong_rig = changed(rig, np.where(np.arange(len(KINDS)) == OFFSET, 0.0, change))
    return Planted(
        f"{fault}, {where}",
        replace(sound, calibrated=wrong_rig, cameras=cameras),
        replace(config, fixed=rig.names[0], distance=distance),
        change,
    )


def left_over(true: CameraRig, planted: np.ndarray, found: Refinement) -> np.ndarray:
    """(camera, parameter) what is still wrong, in the units of ``camera_changes.KINDS``."""
    left = difference(true, found.rig)
    left[:, OFFSET] = planted[:, OFFSET] + found.change[:, OFFSET]
    return left


def line(case: Planted, left: np.ndarray, found: Refinement) -> str:
    """A row of the table: the worst camera in each respect, how many parameters are within 2 sigma, and the judges."""
    degrees = np.degrees(np.linalg.norm(left[:, ROTATION], axis=1)).max()
    metres = np.linalg.norm(left[:, POSITION], axis=1).max()
    pixels = np.linalg.norm(left[:, CENTRE], axis=1).max()
    frames = np.abs(left[:, OFFSET]).max() * case.scene.fps
    moved = np.abs(left[found.moved]) <= 2 * found.sigma[found.moved]
    judged = ", ".join(
        f"{np.nanmean(getattr(found.before, how)):.3f} to {np.nanmean(getattr(found.after, how)):.3f}"
        for how in ("together", "apart")
    )
    cells = (
        case.name, f"{degrees:.3f}", f"{1000 * metres:.1f}", f"{100 * np.abs(left[:, FOCAL]).max():.2f}",
        f"{pixels:.2f}", f"{frames:.2f}", f"{moved.sum()} of {moved.size}", judged,
    )  # fmt: skip
    return f"| {' | '.join(cells)} |"


def _subject(sound: Scene, body: BodyModel, config: AdjustConfig) -> Subject:
    if sound.subject is not None:
        return read_subject(sound.subject)
    adjustment = Adjustment(sound, body, config)
    return adjustment.fit_body(np.zeros(adjustment.sigma.shape))


def _cases(sound: Scene, faults: Sequence[str], config: AdjustConfig) -> Iterator[Planted]:
    for fault in faults:
        for wrong in ((_ONE,), range(1, len(sound.calibrated))):
            yield planted(sound, fault, wrong, config)


def _main(path: str, frames: str, body_name: str, faults: Sequence[str]) -> None:
    sound, body = load_scene(path, frames), load_body(body_name)
    config = AdjustConfig()
    config = replace(config, subject=_subject(sound, body, config))
    print("| planted | rotation [°] | position [mm] | focal [%] | centre [px] | time [frames] | in 2 sigma | IoU |")
    print("|---|---|---|---|---|---|---|---|")
    for case in _cases(sound, faults, config):
        found = refine(case.scene, body, case.config)
        print(line(case, left_over(sound.calibrated, case.change, found), found), flush=True)


if __name__ == "__main__":
    if len(sys.argv) < 4 or not set(sys.argv[4:]) <= set(FAULTS):
        raise SystemExit("usage: python instruments/planted_cameras.py SCENE FRAMES BODY [FAULT...]")
    _main(sys.argv[1], sys.argv[2], sys.argv[3], sys.argv[4:] or list(FAULTS))
