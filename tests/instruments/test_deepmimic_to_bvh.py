"""A motion of DeepMimic's as BVH: one made by hand, with places worked out on paper."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from deepmimic_to_bvh import bvh_of_deepmimic

from mmocap_warp.errors import InputError
from mmocap_warp.formats.motion.motion_clip import read_bvh


def row(knee: float) -> list[float]:
    """A frame that stands, with the right knee bent by so much."""
    none = [1.0, 0.0, 0.0, 0.0]
    legs_and_arms = [*none, knee, *none, *none, 0.0, *none, 0.0, *none, *none, 0.0]
    return [0.05, 1.0, 0.9, 2.0, *none, *none, *none, *legs_and_arms]


def test_joints_are_where_the_motion_has_them(tmp_path: Path) -> None:
    motion, bvh = tmp_path / "motion.txt", tmp_path / "motion.bvh"
    motion.write_text(json.dumps({"Loop": "none", "Frames": [row(0.0), row(-np.pi / 2)]}))
    bvh.write_text(bvh_of_deepmimic(motion))
    clip = read_bvh(bvh)
    assert clip.fps == pytest.approx(20.0)
    foot, hand = (clip.place[:, clip.joint_names.index(name)] for name in ("RightFoot", "LeftHand"))
    ankle = [1.0, 0.9 - 0.421546 - 0.40987, 2.084887]
    np.testing.assert_allclose(foot, [ankle, [1.0 - 0.40987, 0.9 - 0.421546, 2.084887]], atol=1e-6)
    hangs = [1.0 - 0.02405, 0.9 + 0.236151 + 0.2435 - 0.274788 - 0.258947, 2.0 - 0.18311]
    np.testing.assert_allclose(hand, [hangs, hangs], atol=1e-6)


@pytest.mark.parametrize("text", ["{}", '{"Frames": [[1, 2]]}', '{"Frames": "x"}', '{"Frames": [[1], [1, 2]]}'])
def test_another_file_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "motion.txt").write_text(text)
    with pytest.raises(InputError, match="its Frames are not rows of 44 numbers"):
        bvh_of_deepmimic(tmp_path / "motion.txt")
