"""What somebody is told whose recording has a fault, and how far off an answer is that is given all the same.

    python instruments/planted_faults.py FOLDER [--sound] [--only NAME...] [--jobs N] [--program PROGRAM...]

Without ``--sound``, each fault is planted in a walk, in a made person's gestures and in a fox, as files, and tracked by
the command line as anybody would. ``--sound`` tracks recordings without a fault, none of which may be refused. PROGRAM
is what is run, such as ``env PYTHONPATH=OLD python -m mmocap_warp`` for another commit; by default it is this one.
Files are written once, so that several programs see the same ones. It takes about 30 seconds of a core a recording.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np

from mmocap_warp.body.model import BodyMotion
from mmocap_warp.calibration.first_look import look
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.formats.calibration.toml_rig import write_toml_rig
from mmocap_warp.formats.truth_file import load_truth
from mmocap_warp.formats.usd.usd_body import read_body, read_motions
from mmocap_warp.masks.mask_files import MaskImages
from mmocap_warp.rigging.shipped import body_file, load_body
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.scenes import ROOT
from mmocap_warp.study.degradations import write_sequence
from mmocap_warp.study.sequences import CLIP_PLANS, CLIPS
from mmocap_warp.synthesis.any_body import recorded, write_recorded

_COUNT = 40  # frames that each camera has
_DROPPED = 4
_ONE, _OTHER = 1, 3  # the cameras that a fault is planted in
_SOUND_FRAMES = 24


@dataclass(frozen=True, eq=False)
class Recorded:
    """A recording in memory. Its scene file names neither body pose nor fit, so that ``track`` begins with a fit."""

    rig: CameraRig  # as the calibration says
    frames: tuple[list[np.ndarray], ...]  # per camera its masks (height, width) uint8
    text: str  # of scene.toml
    beside: tuple[Path, ...]  # files that the scene file names
    aside: np.ndarray  # (camera, 2) by how much something lies aside in the images that lies 1.5 m aside [px]

    def with_rig(self, **changes: np.ndarray) -> Recorded:
        """Another calibration."""
        return replace(self, rig=replace(self.rig, **changes))

    def with_masks(self, change: Callable[[np.ndarray], np.ndarray], *which: int) -> Recorded:
        """Other images of some cameras, of all where none is named."""
        return self.with_frames(lambda masks: [np.ascontiguousarray(change(mask)) for mask in masks], *which)

    def with_frames(self, order: Callable[[list[np.ndarray]], list[np.ndarray]], *which: int) -> Recorded:
        """Other frames of some cameras, of all where none is named."""
        some = which or range(len(self.rig))
        return replace(self, frames=tuple(order(masks) if k in some else masks for k, masks in enumerate(self.frames)))

    def write(self, folder: Path) -> Path:
        """Write it; the path of its scene.toml."""
        for name, masks in zip(self.rig.names, self.frames, strict=True):
            (folder / "masks" / name).mkdir(parents=True)
            for number, mask in enumerate(masks[:_COUNT]):
                cv2.imwrite(str(folder / "masks" / name / f"{number:04d}.png"), mask)
        write_toml_rig(folder / "calibration.toml", self.rig)
        for file in self.beside:
            shutil.copy(file, folder)
        (folder / "scene.toml").write_text(self.text)
        return folder / "scene.toml"


def opened(scene: Path) -> Recorded:
    """A scene with mask images and a truth, without its subject."""
    read = load_scene(scene)
    frames = []
    for source in read.cameras:
        assert isinstance(source.masks, MaskImages)
        frames.append(
            [np.asarray(mask) for _, mask in zip(range(_COUNT + _DROPPED), source.masks.read(), strict=False)]
        )
    lines = [line for line in scene.read_text().splitlines() if not line.startswith("subject")]
    beside = [scene.parent / name for name in ("truth.usdc", "body.usdc") if (scene.parent / name).exists()]
    rig = read.calibrated
    place = np.nanmean(load_truth(scene.parent / "truth.usdc").joints[0], axis=0)
    aside = [_pinhole(rig, k, place + np.array([1.5, 0.0, 0.0])) - _pinhole(rig, k, place) for k in range(len(rig))]
    return Recorded(rig, tuple(frames), "\n".join(lines) + "\n", tuple(beside), np.array(aside))


def _pinhole(rig: CameraRig, k: int, point: np.ndarray) -> np.ndarray:
    x, y, z = rig.K[k] @ (rig.R[k] @ point + rig.t[k])
    return np.array([x / z, y / z])


def _inverted(clip: Recorded) -> Recorded:
    R = clip.rig.R.transpose(0, 2, 1)
    return clip.with_rig(R=R, t=-np.einsum("kij,kj->ki", R, clip.rig.t))


def _swapped(clip: Recorded) -> Recorded:
    frames = list(clip.frames)
    frames[_ONE], frames[_OTHER] = frames[_OTHER], frames[_ONE]
    return replace(clip, frames=tuple(frames))


def _pixels_off(clip: Recorded) -> Recorded:
    K = clip.rig.K.copy()
    K[_ONE, :2, 2] += (8.0, 6.0)
    return clip.with_rig(K=K)


def _degrees_off(degrees: float) -> Fault:
    def fault(clip: Recorded) -> Recorded:
        R, t = clip.rig.R.copy(), clip.rig.t.copy()
        turn = cv2.Rodrigues(np.array([0.0, np.radians(degrees), 0.0]))[0]
        R[_ONE], t[_ONE] = turn @ R[_ONE], turn @ t[_ONE]
        return clip.with_rig(R=R, t=t)

    return fault


def _scaled(factor: float) -> Fault:
    return lambda clip: clip.with_rig(t=factor * clip.rig.t)


def _one_view(clip: Recorded) -> Recorded:
    """The scene file names one camera; the calibration has all."""
    head, *_ = clip.text.partition(f"[cameras.{clip.rig.names[1]}]")
    return replace(clip, text=head + "[foreground]" + clip.text.partition("[foreground]")[2])


def _no_clean_plate(clip: Recorded) -> Recorded:
    """Images in place of masks, and a background that is to be learnt from them."""
    random = np.random.default_rng(0)

    def images(masks: list[np.ndarray]) -> list[np.ndarray]:
        height, width = masks[0].shape
        room = cv2.resize(
            random.integers(40, 200, (12, 16, 3), np.uint8), (width, height), interpolation=cv2.INTER_CUBIC
        )
        clothes = np.array([60, 40, 220])
        seen = (np.where(mask[..., None] > 0, clothes, room) + random.normal(0, 2, room.shape) for mask in masks)
        return [np.clip(image, 0, 255).astype(np.uint8) for image in seen]

    text = clip.text.partition("[foreground]")[0].replace("masks = ", "video = ")
    return replace(clip, frames=tuple(map(images, clip.frames)), text=text + '[foreground]\nsource = "recording"\n')


def _several_people(clip: Recorded) -> Recorded:
    """The same person stands 1.5 m away once more."""
    frames = []
    for masks, (x, y) in zip(clip.frames, clip.aside, strict=True):
        shift = np.array([[1.0, 0.0, x], [0.0, 1.0, y]])
        frames.append([mask | cv2.warpAffine(mask, shift, mask.shape[::-1], flags=cv2.INTER_NEAREST) for mask in masks])
    return replace(clip, frames=tuple(frames))


def _half(mask: np.ndarray) -> np.ndarray:
    return mask[::2, ::2]


Fault = Callable[[Recorded], Recorded]
FAULTS: dict[str, Fault] = {
    "extrinsics inverted": _inverted,
    "masks of two cameras exchanged": _swapped,
    "one camera upside down": lambda clip: clip.with_masks(lambda mask: np.rot90(mask, 2), _ONE),
    "all masks mirrored": lambda clip: clip.with_masks(np.fliplr),
    "one camera 10 px off": _pixels_off,
    "one camera 1 degree off": _degrees_off(1.0),
    "one camera 2 degrees off": _degrees_off(2.0),
    "calibration in feet": _scaled(3.281),
    "calibration in centimetres": _scaled(100.0),
    "calibration in inches": _scaled(39.37),
    "one view": _one_view,
    "no clean plate": _no_clean_plate,
    "masks empty": lambda clip: clip.with_masks(np.zeros_like),
    "masks full": lambda clip: clip.with_masks(lambda mask: np.full_like(mask, 255)),
    "masks of two people": _several_people,
    "images of half the size": lambda clip: clip.with_masks(_half),
    "one camera turned by 90 degrees": lambda clip: clip.with_masks(np.rot90, _ONE),
    "all cameras turned by 180 degrees": lambda clip: clip.with_masks(lambda mask: np.rot90(mask, 2)),
    "four frames dropped midway": lambda clip: clip.with_frames(
        lambda masks: masks[: _COUNT // 2] + masks[_COUNT // 2 + _DROPPED :], _ONE
    ),
    "each frame twice": lambda clip: clip.with_frames(lambda masks: [masks[k - k % 2] for k in range(len(masks))]),
    "a camera that froze": lambda clip: clip.with_frames(
        lambda masks: masks[: _COUNT // 2] + masks[_COUNT // 2 :][:1] * len(masks[_COUNT // 2 :]), _ONE
    ),
}


def _walk(folder: Path) -> Path:
    return ROOT / "walk" / "scene.toml"


def sequence_scene(folder: Path, name: str, degradation: str = "none") -> Path:
    """The scene of a made clip, which is written if it is not there yet."""
    file = folder / f"{name}-{degradation}".replace("/", "-") / "scene.toml"
    return file if file.exists() else write_sequence(file.parent, CLIPS[name], degradation=degradation)


def moving_scene(folder: Path, name: str, body: str, cameras: int, motion: str | dict[str, float]) -> Path:
    """The scene of a shipped body in a motion of its own or near a pose, which is written if it is not there yet."""
    file = folder / name / "scene.toml"
    if file.exists():
        return file
    path = body_file(body)
    moving = read_motions(path)[motion] if isinstance(motion, str) else near_pose(motion)
    return write_recorded(file.parent, recorded(read_body(path), moving, cameras), True, file=path)


def near_pose(angles: dict[str, float]) -> BodyMotion:
    """Somebody who comes slowly into a pose, given by coordinates' names [rad]."""
    skeleton = load_body("adult_man").skeleton
    pose = np.zeros(skeleton.coordinates)
    for name, angle in angles.items():
        pose[skeleton.coordinate_names.index(name)] = angle
    return BodyMotion(60.0, np.outer(np.linspace(0.8, 1.0, _COUNT), pose))


def knees_up(folder: Path) -> Path:
    """The walk, where two images end at somebody's knees."""
    clip = opened(_walk(folder))
    size = clip.rig.size.copy()
    size[[0, 2], 1] = [int(np.quantile(np.nonzero(clip.frames[k][_COUNT // 2])[0], 0.75)) for k in (0, 2)]
    frames = tuple([mask[:end] for mask in masks] for masks, end in zip(clip.frames, size[:, 1], strict=True))
    file = folder / "knees up" / "scene.toml"
    return file if file.exists() else replace(clip, rig=replace(clip.rig, size=size), frames=frames).write(file.parent)


_FAULTY: dict[str, Callable[[Path], Path]] = {
    "walk": _walk,
    "gestures": lambda folder: sequence_scene(folder, "S2/Gestures"),
    "fox": lambda folder: moving_scene(folder, "fox", "fox", 5, "Run"),
}
"""The scenes that faults are planted in."""


def _of_clip(*what: str) -> Callable[[Path], Path]:
    return lambda folder: sequence_scene(folder, *what)


def _of_body(body: str, cameras: int, motion: str | dict[str, float], name: str) -> Callable[[Path], Path]:
    return lambda folder: moving_scene(folder, name, body, cameras, motion)


_CROUCHED = {f"{side}{joint}.Rx": angle for side in "LR" for joint, angle in {"Hip": -1.6, "Knee": 2.0}.items()}
SOUND: dict[str, Callable[[Path], Path]] = {
    "walk": _walk,
    "balancing": lambda folder: ROOT / "balancing" / "scene.toml",
    "balancing as shipped": lambda folder: ROOT / "balancing" / "as_shipped.toml",
    **{name: _of_clip(name) for name in CLIP_PLANS},
    **{f"{name}, {way}": _of_clip(name, way) for name, way in (
        ("S1/Walking", "views=2"), ("S2/Box", "views=2"), ("S3/Gestures", "views=3"), ("S1/Walking", "passer-by"),
        ("S2/Walking", "furniture"), ("S3/Walking", "fps=15"),
    )},
    "fox looks about": _of_body("fox", 4, "Survey", "survey"),
    "fox runs, three views": _of_body("fox", 3, "Run", "run"),
    "hand": _of_body("hand", 4, "Opening", "hand"),
    "anymal": _of_body("anymal", 4, "Trot", "anymal"),
    "panda": _of_body("panda", 4, "Pick", "panda"),
    "panda, two views": _of_body("panda", 2, "Pick", "panda2"),
    "crouching": _of_body("adult_man", 4, _CROUCHED, "crouching"),
    "lying": _of_body("adult_man", 4, {"Root.Rx": np.pi / 2}, "lying"),
    "handstand": _of_body("adult_man", 4, {"Root.Rz": np.pi}, "handstand"),
    "knees out of two images": knees_up,
}  # fmt: skip
"""Recordings without a fault."""


@dataclass(frozen=True)
class Outcome:
    """What a program made of a recording."""

    exit: int
    said: str  # what it refused and why; or notes and verdict
    statuses: dict[str, int]  # frames by status, where there is an answer
    wrong: float | None  # frames called ``tracked`` or ``rescued`` with a limb's end or the root over 200 mm off
    error: float | None  # MPJPE [mm]
    look: float  # of the look before the first frame, by this commit: seconds of a processor

    def row(self, name: str) -> str:
        """A line of the table."""
        several = ", ".join(f"{count} {status}" for status, count in self.statuses.items() if count)
        off = "" if self.error is None else f"{self.error:.1f}"
        wrong = "" if self.wrong is None else f"{self.wrong:.0f}"
        return f"| {name} | {self.exit} | {self.said} | {several} | {wrong} | {off} | {self.look:.2f} |"


def tracked(scene: Path, program: Sequence[str], frames: int) -> Outcome:
    """Track a scene by a program, as anybody would."""
    with TemporaryDirectory() as folder:
        command = [*program, "track", str(scene), "-o", f"{folder}/result.usdc", "--json", "--device", "cpu"]
        command += ["--frames", str(frames), "--threads", "1"]
        # Where it runs there is no other package of that name, which ``python -m`` would prefer.
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    noted = [
        line for line in done.stderr.splitlines() if not line.startswith(("fit:", "track:", "track again:", "smooth:"))
    ]
    report: dict[str, Any] = json.loads(done.stdout) if done.stdout.startswith("{") else {}
    noted += report.get("verdict", {}).get("lines", [])
    statuses = {name: report.get(name, 0) for name in ("lost", "partial", "rescued", "interpolated", "repeated")}
    said = "; ".join(noted).replace(str(scene.parent), "").replace("|", "/")
    return Outcome(
        done.returncode, said, statuses, report.get("wrongly_tracked"), report.get("mpjpe_mm"), _seconds_of_look(scene)
    )


def _seconds_of_look(scene: Path) -> float:
    try:
        read = load_scene(scene)
        body = load_body("adult_man") if read.body is None else read_body(read.body)
        started = time.thread_time()
        look(read, body)
    except (ValueError, OSError):  # a scene that cannot be read is refused before
        return 0.0
    return time.thread_time() - started


def _cases(folder: Path, sound: bool, only: Sequence[str]) -> Iterator[tuple[str, Path]]:
    """Names of recordings and their scene files."""
    if sound:
        for name, made in SOUND.items():
            if not only or name in only:
                yield name, made(folder)
        return
    for scene, made in _FAULTY.items():
        clip = opened(made(folder))
        for fault, plant in {"sound": lambda clip: clip, **FAULTS}.items():
            if not only or {scene, fault} & set(only):
                file = folder / f"{scene}, {fault}" / "scene.toml"
                yield f"{fault}, {scene}", file if file.exists() else plant(clip).write(file.parent)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="where recordings are written")
    parser.add_argument("--sound", action="store_true", help="recordings without a fault")
    parser.add_argument("--only", nargs="*", default=[], help="names of faults, scenes or recordings")
    parser.add_argument("--jobs", type=int, default=1, help="how many are tracked at once")
    parser.add_argument("--program", nargs=argparse.REMAINDER, default=[], help="what is run; the last option")
    given = parser.parse_args(arguments)
    program = given.program or [sys.executable, "-m", "mmocap_warp"]
    print("| recording | exit | said | frames | wrong | MPJPE [mm] | look [s] |\n|---|---|---|---|---|---|---|")
    frames = _SOUND_FRAMES if given.sound else _COUNT
    with ThreadPoolExecutor(given.jobs) as pool:
        cases = list(_cases(given.folder.resolve(), given.sound, given.only))
        outcomes = pool.map(lambda case: tracked(case[1], program, frames), cases)
        for (name, _), outcome in zip(cases, outcomes, strict=True):
            print(outcome.row(name), flush=True)


if __name__ == "__main__":
    main()
