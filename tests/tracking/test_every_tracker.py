"""All trackers follow a motion, and every part of a hierarchy does its share."""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from body_parts import hierarchical
from random_scenes import perfect_masks
from synthetic import SKELETON, synthetic_subject
from tracked_motion import FPS, FRAMES, RIG, TRACKED, marker_errors, motion

from mmocap_warp.body.model import Subject
from mmocap_warp.body.posing import Poser
from mmocap_warp.masks.observation import Observation
from mmocap_warp.tracking.algorithms import ALGORITHMS
from mmocap_warp.tracking.frame_loop import track_observations
from mmocap_warp.tracking.track_config import TrackConfig

HIERARCHICAL = [name for name, algorithm in ALGORITHMS.items() if algorithm.hierarchical]
PARTS = {part.name: part.index for part in hierarchical(SKELETON, 39)}
STEP = 0.04  # [rad] a frame


IN_TESTS_OF_THEIR_OWN = ("apf", "de", "h-de", "h-pso", "psapf", "pso")
"""Algorithms whose tests in ``tests/optimizers`` track the same motion."""


@pytest.mark.parametrize(
    "algorithm",
    [pytest.param(name, marks=pytest.mark.nightly if name in IN_TESTS_OF_THEIR_OWN else ()) for name in ALGORITHMS],
)
def test_a_motion_is_tracked(device, algorithm):
    """At its end, with a third of the error of a tracker that stands still; a pixel is 25 mm wide."""
    truth, seen = motion(device)
    result = track_observations(synthetic_subject(), RIG, seen, FPS, TrackConfig(algorithm, device=device))
    end = slice(FRAMES - 5, FRAMES)
    still = marker_errors(np.tile(truth[0], (5, 1)), truth[end]).mean()
    assert marker_errors(result.pose[0, end], truth[end]).mean() < TRACKED * still


def able_to_move(part: str) -> Subject:
    """The subject with limits that hold all joints but the part's where they are."""
    subject = synthetic_subject()
    limits = np.zeros_like(subject.body.skeleton.limits)
    limits[(PARTS[part][PARTS[part] >= 3] - 3) // 3] = -np.pi, np.pi
    skeleton = replace(subject.body.skeleton, limits=limits)
    return replace(subject, body=replace(subject.body, skeleton=skeleton))


@cache
def motion_of(part: str, device: str) -> tuple[np.ndarray, list[Observation]]:
    """Poses (frame, 51) in which the coordinates of one part grow, and what is seen of them."""
    subject, index = synthetic_subject(), PARTS[part]
    truth = np.tile(subject.pose, (8, 1))
    truth[:, index] += np.where(index < 3, STEP / 2, STEP) * np.arange(8)[:, None]
    return truth, [Observation.from_masks(perfect_masks(subject, RIG, pose, device)) for pose in truth]


PAIRS = list(itertools.product(HIERARCHICAL, PARTS))
SAMPLE = set(itertools.islice(zip(itertools.cycle(HIERARCHICAL), itertools.cycle(PARTS)), len(PARTS)))
"""Every hierarchical algorithm and every part at least once."""


@pytest.mark.parametrize(
    ("algorithm", "part"),
    [pytest.param(*pair, marks=() if pair in SAMPLE else pytest.mark.nightly) for pair in PAIRS],
)
def test_every_part_of_a_hierarchy_moves(device, algorithm, part):
    """One part moves, and no other is able to make up for it: if its search did nothing, the body would stand still."""
    subject, (truth, seen) = able_to_move(part), motion_of(part, device)
    result = track_observations(subject, RIG, seen, FPS, TrackConfig(algorithm, evaluations=1200, device=device))
    poser = Poser(subject.body, subject.root_base)
    start, end, found = poser.vertices(np.stack([truth[0], truth[-1], result.pose[0, -1]]))
    still = np.linalg.norm(start - end, axis=-1)
    moved = still > 0.3 * still.max()
    assert np.linalg.norm(found - end, axis=-1)[moved].mean() < TRACKED * still[moved].mean()
