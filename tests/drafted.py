"""Folders of videos that scenes are drafted from."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from ball_scene import FRAMES, RIG, ball_mask, write_video

from mmocap_warp.scene.drafting import draft_scene
from mmocap_warp.scene.scene_toml import load_scene


@pytest.fixture
def videos(tmp_path: Path) -> Path:
    """Three cameras' videos of one moment, by the cameras' names."""
    folder = tmp_path / "source"
    folder.mkdir()
    for k, name in enumerate(RIG.names):
        frames = [np.where(ball_mask(k, f)[..., None], np.uint8([30, 60, 220]), np.uint8(100)) for f in range(FRAMES)]
        write_video(folder / f"{name}.mkv", frames)
    return folder


@pytest.fixture
def project(tmp_path: Path) -> Path:
    folder = tmp_path / "project"
    folder.mkdir()
    return folder


def lay_out(videos: Path, project: Path, place: str, **names: str) -> None:
    """Copy each camera's video to ``place``, in which {} stands for the camera or for another name of it."""
    for name in RIG.names:
        target = project / place.format(names.get(name, name))
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(videos / f"{name}.mkv", target)


def sources(folder: Path) -> dict[str, str]:
    """Where the drafted scene of a folder finds each camera's video."""
    draft = draft_scene(folder)
    (folder / "scene.toml").write_text(draft.text)
    scene = load_scene(folder, masks=False)
    assert scene.calibrated.up == "+y"
    assert scene.fps == 30
    return {source.name: source.video.path.relative_to(folder).as_posix() for source in scene.cameras if source.video}
