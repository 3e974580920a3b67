"""A body and its cameras may have any size: what is found is the same, in their own measure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synthetic import synthetic_subject
from tracked_motion import FPS, RIG, motion

from mmocap_warp.fitting.fit_config import FitConfig
from mmocap_warp.fitting.subject_fit import fit_clip
from mmocap_warp.masks.observation import unpack_masks
from mmocap_warp.tracking.frame_loop import track_observations
from mmocap_warp.tracking.live import track_live
from mmocap_warp.tracking.track_config import TrackConfig

PERSON = 1.8  # extent of a body that keeps its metres, and that others are measured by [m]
FACTOR = 20.0
BEETLE = 0.01
FRAMES = 12
_UNIT = synthetic_subject().body.extent / PERSON
SUBJECT, CAMERAS = synthetic_subject().in_unit(_UNIT), RIG.in_unit(_UNIT)
LARGE, FAR = SUBJECT.in_unit(1 / FACTOR), CAMERAS.in_unit(1 / FACTOR)
SAME = 1e-4  # of a person, in metres and radians


def test_lengths_alone_change_with_the_unit():
    assert LARGE.body.extent == pytest.approx(FACTOR * PERSON)
    assert LARGE.body.unit == pytest.approx(FACTOR)
    assert SUBJECT.body.unit == 1.0
    assert LARGE.body.relative_size == pytest.approx(FACTOR)
    np.testing.assert_allclose(LARGE.pose[:3], FACTOR * SUBJECT.pose[:3])
    np.testing.assert_array_equal(LARGE.pose[3:], SUBJECT.pose[3:])
    measured = replace(SUBJECT, provenance={"body.height": 1.7, "shape.bone.LKnee": 0.1, "fit.cost": 0.2})
    large = measured.in_unit(1 / FACTOR)
    seen = replace(SUBJECT.body, motion_poses=SUBJECT.pose[None]).in_unit(1 / FACTOR)
    np.testing.assert_allclose(seen.motion_poses, LARGE.pose[None])
    assert large.provenance == {"body.height": 34.0, "shape.bone.LKnee": 2.0, "fit.cost": 0.2}


@pytest.mark.parametrize("factor", [FACTOR, BEETLE], ids=["giant", "beetle"])
def test_a_body_of_another_size_is_tracked_to_the_same_poses(factor):
    """The beetle's cameras are nearer to it than anything may be to a person's."""
    seen = motion("cpu")[1][:FRAMES]
    config = TrackConfig("search-contour", device="cpu", threads=1, smooth=2.0)
    person = track_observations(SUBJECT, CAMERAS, seen, FPS, config)
    subject, rig = SUBJECT.in_unit(1 / factor), CAMERAS.in_unit(1 / factor)
    other = track_observations(subject, rig, seen, FPS, replace(config, smooth=2.0 * factor))
    assert other.subject is subject
    assert other.cameras is rig
    assert other.config["smooth"] == pytest.approx(2.0 * factor)
    assert other.config["translation_radius"] == pytest.approx(factor * person.config["translation_radius"])
    back = other.in_unit(factor)
    np.testing.assert_array_equal(other.status, person.status)
    for name in ("pose", "raw_pose", "iou"):
        np.testing.assert_allclose(getattr(back, name), getattr(person, name), atol=SAME, err_msg=name)
    np.testing.assert_allclose(back.joint_sigma, person.joint_sigma, rtol=0.01)


def test_a_large_body_is_followed_live():
    seen = [unpack_masks(each.words, RIG.size) for each in motion("cpu")[1][:FRAMES]]
    config = TrackConfig("contour", device="cpu", threads=1)
    small, large = (
        list(track_live(subject, rig, seen, FPS, config)) for subject, rig in ((SUBJECT, CAMERAS), (LARGE, FAR))
    )
    for one, other in zip(small, large, strict=True):
        np.testing.assert_allclose(other.joints / FACTOR, one.joints, atol=SAME)
        np.testing.assert_allclose(other.pose[:, :3] / FACTOR, one.pose[:, :3], atol=SAME)
        np.testing.assert_allclose(other.raw_pose[:, 3:], one.raw_pose[:, 3:], atol=SAME)


@pytest.mark.nightly
def test_a_large_body_is_fitted_in_its_own_measure():
    seen = motion("cpu")[1][:1]
    config = FitConfig(headings=1, evaluations=100, finalists=1, frames=1, device="cpu", threads=1)
    small, large = (fit_clip(body.body, rig, FPS, seen, config) for body, rig in ((SUBJECT, CAMERAS), (LARGE, FAR)))
    np.testing.assert_allclose(large.in_unit(FACTOR).pose, small.pose, atol=SAME)
    assert large.body.extent / FACTOR == pytest.approx(small.body.extent, rel=SAME)
    assert large.provenance["body.height"] == pytest.approx(FACTOR * small.provenance["body.height"], rel=SAME)
