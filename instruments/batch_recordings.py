"""Recordings for ``mmocap batch``: ``python instruments/batch_recordings.py FOLDER [TRIALS [MOTIONS [CORES]]]``.

Ten people at random walk, gesture and box before five cameras, ``MOTIONS`` recordings of each (6). A trial is 1 to 3
seconds of one of them: a folder with a ``scene.toml`` that names these masks, and nobody's body. In one trial of fifty
something is wrong; ``faults.json`` has the trials' names and what. ``plan.toml`` says who is in which trial.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from made_people import made_person
from made_walks import walking_around
from sequence_motions import ACTIONS

from mmocap_warp.study.sequences import SequencePlan, make_sequence
from mmocap_warp.synthesis.writing import FAULTY_MASKS, write_made_scene

PEOPLE = 10
CAMERAS = ("C1", "C2", "C3", "BW2", "BW4")
_FRAMES = 210  # of a recording
_SHORTEST, _LONGEST = 60, 180  # frames of a trial
_ONE_IN = 50  # trials, something is wrong


def main(folder: Path, trials: int = 1000, motions: int = 6, cores: int = os.cpu_count() or 1) -> None:
    """Write all of them."""
    made = [(person, motion) for person in range(PEOPLE) for motion in range(motions)]
    with ProcessPoolExecutor(cores) as processes:
        list(processes.map(_record, [folder] * len(made), *zip(*made, strict=True)))
    rng, wrong = np.random.default_rng(7), {}
    for number in range(trials):
        person, motion = made[number % len(made)]
        place = folder / "trials" / f"p{person}" / f"t{number:04d}"
        frames = int(rng.integers(_SHORTEST, _LONGEST + 1))
        first = int(rng.integers(0, _FRAMES - frames + 1))
        _write_trial(place, Path("../../../recordings") / f"p{person}m{motion}", first, frames)
        if number % _ONE_IN == _ONE_IN // 2:
            spoil = FAULTS[(number // _ONE_IN) % len(FAULTS)]
            spoil(place, first)
            wrong[f"p{person}/t{number:04d}"] = str(spoil.__doc__)
    (folder / "faults.json").write_text(json.dumps(wrong, indent=1))
    persons = (f'[[scenes]]\nmatch = "p{person}/*"\nperson = "p{person}"\n' for person in range(PEOPLE))
    (folder / "plan.toml").write_text("".join(persons))


def _record(folder: Path, person: int, motion: int) -> None:
    """A person's motion, without a scene file."""
    who = made_person(person)
    rng = np.random.default_rng([person, motion, 79])
    actor = ("S1", "S2", "S3")[rng.integers(3)]
    walk = walking_around(rng.uniform(0.95, 1.2), rng.uniform(1, 1.25), rng.uniform(104, 118))
    acted = (walk, ACTIONS[f"{actor}/Gestures"], ACTIONS[f"{actor}/Box"])[motion % 3]
    seed = 2000 + 100 * person + motion
    sequence = make_sequence(
        who.name, SequencePlan(who.name, _FRAMES, acted, float(rng.uniform(-3, 3)), seed, CAMERAS), who
    )
    place = folder / "recordings" / f"p{person}m{motion}"
    write_made_scene(place, sequence.recording, sequence.truth, name="", about="", foreground=FAULTY_MASKS)
    (place / "scene.toml").unlink()


def _write_trial(place: Path, recording: Path, first: int, frames: int) -> None:
    cameras = "".join(f'[cameras.{name}]\nmasks = "{recording}/masks/{name}"\n' for name in CAMERAS)
    place.mkdir(parents=True, exist_ok=True)
    (place / "scene.toml").write_text(
        f'[scene]\nfps = 60\nup = "+z"\nframes = "{first}:{first + frames}"\n[truth]\nfile = "{recording}/truth.usdc"\n'
        f'[cameras]\ncalibration = "{recording}/calibration.toml"\n{cameras}{FAULTY_MASKS}'
    )


# ---- What is wrong with a trial.


def _replaced(place: Path, old: str, new: str) -> None:
    file = place / "scene.toml"
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))


def _own_masks(place: Path, camera: str) -> Path:
    """A copy of a camera's masks that the trial has for itself."""
    text = (place / "scene.toml").read_text()
    recording = text.split('calibration = "')[1].split("/calibration.toml")[0]
    shutil.copytree(place / recording / "masks" / camera, place / "masks" / camera)
    _replaced(place, f"{recording}/masks/{camera}", f"masks/{camera}")
    return place / "masks" / camera


def _no_calibration(place: Path, first: int) -> None:
    """The calibration is missing."""
    _replaced(place, "calibration.toml", "calibrated.toml")


def _no_masks(place: Path, first: int) -> None:
    """A camera's folder of masks is missing."""
    _replaced(place, "masks/C2", "masks/C4")


def _cut_short(place: Path, first: int) -> None:
    """A camera's masks end before the trial does."""
    for file in sorted(_own_masks(place, "C3").iterdir())[first + 20 :]:
        file.unlink()


def _damaged(place: Path, first: int) -> None:
    """An image is cut off in the middle."""
    file = sorted(_own_masks(place, "C1").iterdir())[first + 9]
    file.write_bytes(file.read_bytes()[:300])


def _empty(place: Path, first: int) -> None:
    """All cameras see nobody."""
    import cv2

    for camera in CAMERAS:
        for file in _own_masks(place, camera).iterdir():
            cv2.imwrite(str(file), np.zeros((480, 640), np.uint8))


def _misspelt(place: Path, first: int) -> None:
    """A key of the scene file is misspelt."""
    _replaced(place, "fps = 60", "fsp = 60")


def _swapped(place: Path, first: int) -> None:
    """Two cameras have each other's masks."""
    _replaced(place, "masks/C2", "masks/C9")
    _replaced(place, "masks/C3", "masks/C2")
    _replaced(place, "masks/C9", "masks/C3")


FAULTS: tuple[Callable[[Path, int], None], ...] = (
    *(_no_calibration, _no_masks, _cut_short, _damaged, _empty, _misspelt, _swapped),
)

if __name__ == "__main__":
    main(Path(sys.argv[1]), *map(int, sys.argv[2:]))
