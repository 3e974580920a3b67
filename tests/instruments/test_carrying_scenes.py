"""What the made people carry is where a hand is, or falls to the floor."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from carrying_scenes import CARRIED, Mesh, case, racket

from mmocap_warp.body.mesh_pieces import is_closed
from mmocap_warp.rigging.importing.closing import outward
from mmocap_warp.synthesis.exact_posing import ExactPoser


@pytest.mark.parametrize("made", [racket(), case()], ids=["racket", "case"])
def test_meshes_are_closed_and_face_outward(made: Mesh) -> None:
    assert is_closed(made.face)
    np.testing.assert_array_equal(outward(made.vertex, made.face), made.face)


@pytest.mark.parametrize("name", [name for name in CARRIED if "racket" in name])
def test_a_racket_stays_in_the_hand(tmp_path: Path, name: str) -> None:
    recording, (thing,) = CARRIED[name](tmp_path)
    skeleton = recording.body.skeleton
    places = ExactPoser(recording.body, recording.root_base).joint_transforms(recording.poses)[:, :, :3, 3]
    apart = places[:, skeleton.index("Racket")] - places[:, skeleton.index("RWrist")]
    np.testing.assert_allclose(np.linalg.norm(apart, axis=1), np.linalg.norm(thing.position), atol=1e-6)
    assert len(recording) == 64
    assert all(mask.any() for mask in recording.masks(0))


def test_a_case_is_let_go_and_comes_to_rest_on_the_floor(tmp_path: Path) -> None:
    recording, (thing,) = CARRIED["walker-with-case"](tmp_path)
    skeleton = recording.body.skeleton
    places = ExactPoser(recording.body, recording.root_base).joint_transforms(recording.poses)[:, :, :3, 3]
    held = places[:, skeleton.index("Case")] - places[:, skeleton.index("RWrist")]
    np.testing.assert_allclose(np.linalg.norm(held[:28], axis=1), np.linalg.norm((-0.03, -0.07, 0.075)), atol=1e-6)
    assert np.linalg.norm(held[-1]) > 0.5
    vertex = np.flatnonzero(~recording.body.own_vertex)
    falling = np.diff(places[28:36, skeleton.index("Case")], n=2, axis=0) * recording.fps**2
    np.testing.assert_allclose(falling, np.tile([0.0, 0.0, -9.81], (len(falling), 1)), atol=0.02)
    low, lowest = (recording.vertices(frame)[vertex, 2].min() for frame in (55, 63))
    assert low == pytest.approx(lowest, abs=1e-5)
    assert -0.02 < lowest < 0.1
    np.testing.assert_allclose(recording.poses[0, skeleton.angles("Case_place")], 0, atol=0.005)
    assert thing.joint is None
