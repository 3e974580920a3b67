"""Where cameras' parameters would end alone, from where all of them ended together."""

from __future__ import annotations

import numpy as np
from camera_bias import Bias, cells

from mmocap_warp.calibration.adjust.camera_changes import KINDS, POSITION, RADIAL, ROTATION
from mmocap_warp.calibration.refine.refinement import STATED

CAMERAS = 3


def made(seed: int = 0) -> Bias:
    rng = np.random.default_rng(seed)
    free = np.ones((CAMERAS, len(KINDS)), bool)
    free[0, :6] = False
    free[:, RADIAL] = False  # the instrument holds distortion, as the adjustment's deviations do
    root = rng.standard_normal((free.sum(), 3 * free.sum()))
    change = np.where(free, rng.normal(0, 0.01, free.shape), 0.0)
    return Bias(change, free, root @ root.T)


def test_all_together_end_where_they_did():
    bias = made()
    off, sigma = bias.alone(bias.free)
    np.testing.assert_allclose(off, bias.change[bias.free], rtol=1e-9)
    np.testing.assert_allclose(sigma, STATED * np.sqrt(np.diag(np.linalg.inv(bias.information))), rtol=1e-9)


def test_alone_they_end_where_the_cost_is_least_with_the_others_at_the_truth():
    bias = made(1)
    wanted = np.zeros(bias.free.shape, bool)
    wanted[2, POSITION] = True
    off, _ = bias.alone(wanted)
    there = np.zeros(bias.free.shape)
    there[wanted] = off
    downhill = bias.information @ (there - bias.change)[bias.free]
    assert np.abs(downhill[wanted[bias.free]]).max() < 1e-9
    assert np.abs(downhill[~wanted[bias.free]]).max() > 1e-3


def test_the_worst_camera_is_told_in_each_kinds_unit():
    bias = made(2)
    told, ratio = cells(bias)
    assert len(told) == 5
    assert len(ratio) == 2 * 2 * (len(KINDS) - 1)  # of two cameras, alone and together, without distortion
    alone = np.zeros(bias.free.shape, bool)
    worst = 0.0
    for k in (1, 2):
        alone[:] = False
        alone[k, ROTATION] = True
        worst = max(worst, np.degrees(np.linalg.norm(bias.alone(alone)[0])))
    assert told[0].split(",")[0] == f"{worst:.3f}"
