"""Cameras that were turned so far that silhouettes meet nowhere are brought back by two points of each."""

from __future__ import annotations

import numpy as np
from moving_person import FPS, RIG, masks_at

from mmocap_warp.calibration.adjust.camera_changes import KINDS, ROTATION, Deviations, changed, difference
from mmocap_warp.calibration.adjust.silhouette_agreement import LandmarkProblem, coherence, landmarks
from mmocap_warp.masks.observation import Observation, unpack_masks

FRAMES = np.arange(0, 60, 2)
SEEN = masks_at(RIG, FRAMES, np.zeros(len(RIG)))


def turned() -> np.ndarray:
    """Changes that turn all cameras but one by ten degrees."""
    rng = np.random.default_rng(5)
    change = np.zeros((len(RIG), len(KINDS)))
    axis = rng.normal(0, 1, (len(RIG) - 1, 3))
    change[1:, ROTATION] = np.radians(10) * axis / np.linalg.norm(axis, axis=1, keepdims=True)
    return change


def test_ten_degrees_are_brought_to_three_and_silhouettes_agree():
    wrong = changed(RIG, turned())
    assert coherence(wrong, SEEN[:4]).max() < 0.2
    sigma = np.zeros((len(RIG), len(KINDS)))
    sigma[1:, ROTATION] = np.radians(15)
    problem = LandmarkProblem(wrong, landmarks(wrong, SEEN), FPS, sigma)
    change = problem.solve()
    left = difference(RIG, changed(wrong, change))
    assert np.degrees(np.linalg.norm(left[:, ROTATION], axis=1)).max() < 3.0
    assert coherence(changed(wrong, change), SEEN[:4]).min() > 0.9
    assert not change[0].any()
    before, after = (np.sqrt(np.nanmean(problem.errors(each) ** 2)) for each in (0 * change, change))
    assert before > 0.2
    assert after < 0.05


def test_a_camera_that_is_late_is_found_by_points_alone():
    late = np.array([0.0, 3.0, 0.0, 0.0])
    consecutive = masks_at(RIG, np.arange(8, 56), late)
    sigma = np.zeros((len(RIG), len(KINDS)))
    sigma[1, -1] = Deviations(offset=0.1).offset
    change = LandmarkProblem(RIG, landmarks(RIG, consecutive), FPS, sigma).solve()
    assert abs(change[1, -1] * FPS - 3.0) < 1.0


def test_silhouettes_cut_by_an_edge_or_too_small_have_no_points():
    masks = unpack_masks(SEEN[0].words, RIG.size)
    masks[1][:, :] = False
    masks[1][:40, :40] = True  # reaches the corner
    masks[2][:, :] = False
    masks[2][50:55, 50:55] = True
    points = landmarks(RIG, [Observation.from_masks(masks)])[0]
    assert np.isfinite(points[[0, 3]]).all()
    assert np.isnan(points[[1, 2]]).all()


def test_silhouettes_of_a_sound_rig_are_covered_by_the_hull_of_the_others():
    assert coherence(RIG, SEEN[::8]).min() > 0.97
    two = [Observation(seen.words, seen.foreground * [1, 1, 0, 0]) for seen in SEEN[:2]]
    assert np.isnan(coherence(RIG, two)).all()
