"""Loose clothes: mask beside the parts that wear them is hidden, and no body is made of a skirt."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
from walk_scene import walking

from mmocap_warp.body.model import Subject
from mmocap_warp.body.posing import Poser
from mmocap_warp.cameras.rig import CameraRig, project
from mmocap_warp.cameras.silhouette import silhouettes
from mmocap_warp.masks.observation import Observation, unpack_masks
from mmocap_warp.study.job import solved_subject
from mmocap_warp.study.sequences import CLIP_PLANS, make_sequence
from mmocap_warp.study.source import open_sequence
from mmocap_warp.tracking.loose_clothes import LOOSE, LooseClothes, with_hidden

WORN = ["LHip", "RHip"]


@pytest.fixture(scope="module")
def walker() -> tuple[Subject, CameraRig]:
    walk = walking()
    return Subject(walk.body, walk.root_base, walk.poses[0], {LOOSE: "+".join(WORN)}), walk.rig


def drawn(subject: Subject, rig: CameraRig) -> list[np.ndarray]:
    vertices = Poser(subject.body, subject.root_base).tracking_vertices(subject.pose[None])[0]
    return silhouettes(rig, vertices, subject.body.tracking_face)


def pixel_of(subject: Subject, rig: CameraRig, joint: str, k: int) -> tuple[int, int]:
    """Column and row of a joint in a view."""
    poser, index = Poser(subject.body, subject.root_base), subject.body.skeleton.index(joint)
    place = poser.joint_transforms(subject.pose[None])[0, index, :3, 3]
    return tuple(np.rint(project(rig, place[None])[k, 0]).astype(int).tolist())


def test_a_body_without_clothes_hides_nothing(walker):
    subject, rig = walker
    seen = Observation.from_masks(drawn(subject, rig))
    shown = LooseClothes(subject, rig, WORN).hidden_in(seen, subject.pose[None])
    np.testing.assert_array_equal(shown.words, seen.words)
    assert not shown.hidden.any()


def test_a_skirt_is_hidden_beside_the_legs_and_nothing_of_the_body_or_of_a_lost_arm(walker):
    subject, rig = walker
    masks = [mask.copy() for mask in drawn(subject, rig)]
    column, row = (sum(each) // 2 for each in zip(*(pixel_of(subject, rig, n, 0) for n in WORN), strict=True))
    height = np.ptp(np.flatnonzero(masks[0].any(axis=1)))
    skirt, arm = np.zeros_like(masks[0]), np.zeros_like(masks[0])
    half = round(0.14 * height)
    skirt[row : row + 2 * half, column - half : column + half] = True
    arm[: round(0.1 * height), : round(0.1 * height)] = True  # far from the legs, whatever it is
    masks[0] |= skirt | arm
    seen, pose = Observation.from_masks(masks), subject.pose[None]
    shown = LooseClothes(subject, rig, WORN, known=True).hidden_in(seen, pose)
    hidden, left = (unpack_masks(words, rig.size) for words in (shown.hidden, shown.words))
    body = drawn(subject, rig)[0]
    assert (hidden[0] & skirt).sum() > 0.5 * (skirt & ~body).sum()
    assert not (hidden[0] & body).any()
    assert not (hidden[0] & arm).any()
    assert not any(each.any() for each in hidden[1:])
    np.testing.assert_array_equal(left[0], masks[0] & ~hidden[0])
    assert shown.foreground[0] == left[0].sum()
    # Where a hand may be lost, less is cloth.
    surely = unpack_masks(LooseClothes(subject, rig, WORN).hidden_in(seen, pose).hidden, rig.size)[0]
    assert not (surely & ~hidden[0]).any()
    assert 0 < surely.sum() < hidden[0].sum()


def test_the_first_frame_is_looked_at_from_the_subject_s_own_pose_and_others_from_the_one_before(walker, monkeypatch):
    subject, rig = walker
    asked = []
    monkeypatch.setattr(LooseClothes, "hidden_in", lambda _, seen, poses: asked.append(poses[0, 0]) or seen)
    frames = [Observation.from_masks(drawn(subject, rig))] * 3
    seen = list(with_hidden(frames, subject, rig, 60.0, lambda place: np.full_like(subject.pose[None], place)))
    assert asked == [subject.pose[0], 1.0, 2.0]
    assert all(one is other for one, other in zip(seen, frames, strict=True))
    bare = replace(subject, provenance={})
    assert list(with_hidden(frames, bare, rig, 60.0, lambda _: pytest.fail("asked"))) == frames


def test_no_body_is_made_of_a_skirt():
    """Taken for skin, it makes thighs that are thicker, and hips that are lower, than anybody has: 6.9."""
    name = "Skirt/Walking"
    clip = open_sequence(make_sequence(name, CLIP_PLANS[name]))
    subject = solved_subject(clip, list(islice(clip.observations, 16)), 0, "cpu", 1)
    assert set(WORN) <= set(subject.provenance[LOOSE].split("+"))
    assert subject.provenance["fit.departure"] < 3.5
    names = list(subject.body.skeleton.joints)
    own = Poser(subject.body, subject.root_base).joint_transforms(subject.pose[None])[0, :, :3, 3]
    for joint in WORN:
        true = clip.truth.joints[0, list(clip.truth.joint_names).index(joint)]
        assert np.linalg.norm(own[names.index(joint)] - true) < 0.05
