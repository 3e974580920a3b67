"""What fits begin with: the shipped walk, and the body that is fitted to it."""

from __future__ import annotations

import pytest

from mmocap_warp.body.model import BodyModel
from mmocap_warp.formats.usd.usd_body import read_body
from mmocap_warp.scene.recording import Scene
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.scenes import ROOT


@pytest.fixture(scope="module")
def walk() -> Scene:
    return load_scene(ROOT / "walk")


@pytest.fixture(scope="module")
def man() -> BodyModel:
    return read_body(ROOT / "bodies" / "adult_man.usdc")
