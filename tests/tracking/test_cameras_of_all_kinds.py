"""Recordings of a camera with another frame rate, and of fisheyes, from the scene file to the result."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from ball_scene import edit
from made_walks import walking_around

from mmocap_warp.body.posing import Poser
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.formats.image_files import write_png
from mmocap_warp.formats.truth_file import read_truth
from mmocap_warp.formats.usd.usd_body import read_subject
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.study.sequences import SequencePlan, StudySequence, make_sequence
from mmocap_warp.synthesis.footage.made_recording import Recording
from mmocap_warp.synthesis.writing import write_made_scene
from mmocap_warp.tracking.frame_loop import track_observations
from mmocap_warp.tracking.track_config import TrackConfig

CAMERAS = ("C1", "C2", "BW1", "BW3")
SLOW, SLOW_RATE = "C2", 50.0
FRAMES = 9
LENS = np.array([0.05, 0.01, -0.003, 0.001, 0.0])
WIDER = 0.7  # times the pinholes' focal lengths are the fisheyes'


@pytest.fixture(scope="module")
def sequence() -> StudySequence:
    plan = SequencePlan("S1", FRAMES + 2, walking_around(1.10, 1.15, 112.0), 0.4, 11, CAMERAS)
    return make_sequence("walk", plan)


def write(folder: Path, footage: Recording | Bent, sequence: StudySequence) -> Path:
    """A scene whose tracking starts where the sequence's does."""
    keep = '[foreground]\nkeep = "all"\n'
    scene = write_made_scene(
        folder, footage, sequence.truth, name="walk", about="made", foreground=keep, subject=sequence.subject
    )
    edit(folder, "fps = 60", f"fps = 60\nframes = {FRAMES}")
    return scene


def write_at_its_own_rate(folder: Path, recording: Recording) -> None:
    """Another rate for one of the cameras: its masks are made again, of the body where it was then."""
    at = np.arange(0, len(recording) - 1, recording.fps / SLOW_RATE)
    frames = np.arange(len(recording))
    poses = np.stack([np.interp(at, frames, column) for column in recording.poses.T], axis=1)
    taken, k = replace(recording, poses=poses), recording.rig.names.index(SLOW)
    for file in (folder / "masks" / SLOW).glob("*.png"):
        file.unlink()
    for number in range(len(taken)):
        write_png(folder / "masks" / SLOW / f"{number:04d}.png", taken.masks(number)[k])


@dataclass(frozen=True)
class Bent:
    """What fisheyes see of what pinholes saw."""

    recording: Recording

    @property
    def fps(self) -> float:
        return self.recording.fps

    @property
    def rig(self) -> CameraRig:
        rig = self.recording.rig
        K = rig.K * [[WIDER, 1, 1], [1, WIDER, 1], [1, 1, 1]]
        return replace(rig, K=K, distortion=np.tile(LENS, (len(rig), 1)), fisheye=rig.names)

    def __len__(self) -> int:
        return len(self.recording)

    def masks(self, frame: int) -> list[np.ndarray]:
        seen = self.recording.masks(frame)
        return [self._bent(mask, k) for k, mask in enumerate(seen)]

    def _bent(self, mask: np.ndarray, k: int) -> np.ndarray:
        height, width = mask.shape
        pixels = np.stack(np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float)), axis=-1)
        bent, straight = self.rig.K[k], self.recording.rig.K[k]
        place = cv2.fisheye.undistortPoints(pixels.reshape(-1, 1, 2), bent, LENS[:4], P=straight)
        column, row = np.rint(place[:, 0]).astype(int).T
        inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        seen = mask[np.where(inside, row, 0), np.where(inside, column, 0)] & inside
        return seen.reshape(height, width)


def off(scene: Path) -> float:
    """Mean distance of the tracked joints from the true ones [m]."""
    loaded = load_scene(scene)
    subject = read_subject(scene.parent / "subject.usdc")
    seen = list(loaded.observations())
    found = track_observations(subject, loaded.rig(), seen, loaded.fps, TrackConfig("contour", device="cpu", threads=1))
    truth = read_truth(scene.parent / "truth.usdc")
    named = [truth.joint_names.index(name) for name in subject.body.skeleton.joints]
    joints = Poser(subject.body, subject.root_base).joint_transforms(found.pose[0])[:, :, :3, 3]
    return float(np.linalg.norm(joints - truth.joints[:FRAMES, named], axis=2).mean())


@pytest.fixture(scope="module")
def plain(sequence: StudySequence, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Pinholes that are all triggered together."""
    return write(tmp_path_factory.mktemp("plain"), sequence.recording, sequence)


@pytest.fixture(scope="module")
def in_step(plain: Path) -> float:
    return off(plain)


def test_a_camera_of_fifty_frames_a_second_among_those_of_sixty(
    sequence: StudySequence, in_step: float, tmp_path: Path
) -> None:
    scene = write(tmp_path, sequence.recording, sequence)
    write_at_its_own_rate(tmp_path, sequence.recording)
    edit(tmp_path, f'masks = "masks/{SLOW}"', f'masks = "masks/{SLOW}"\nfps = {SLOW_RATE}')
    assert off(scene) < 1.15 * in_step


def test_fisheyes_see_a_person_as_pinholes_do(sequence: StudySequence, in_step: float, tmp_path: Path) -> None:
    assert off(write(tmp_path, Bent(sequence.recording), sequence)) < 1.25 * in_step
