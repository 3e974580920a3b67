"""Where the first frame's fit starts: headings, kinds of starts, and what pulls them to the rest pose."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from one_frame import QUICK
from other_bodies import things

from mmocap_warp.body.shape_space import ShapeSpace
from mmocap_warp.fitting.standing_search import FirstFrame, _prior, _spread, search_headings, standing_start
from mmocap_warp.fitting.subject_fit import _headings, _Task
from mmocap_warp.rigging.attaching import carrying


def test_headings_are_spread_evenly(walk, man):
    """All of them start at one place, upright, in the rest pose: a single evaluation is of the start."""
    space, rig = ShapeSpace(man, "+z"), walk.rig(0.25)
    frame = FirstFrame(rig, next(iter(walk.observations(0.25, count=1))))
    found = search_headings(space, frame, standing_start(space, frame), headings=8, evaluations=1)
    np.testing.assert_allclose(found[:, space.heading_index], np.arange(8) * np.pi / 4, atol=1e-6)
    assert np.ptp(np.delete(found, space.heading_index, axis=1), axis=0).max() == 0
    assert not found[:, 3 : space.heading_index - 1].any()


def test_who_carries_something_is_begun_from_the_hulls_size_and_from_its_own(walk, man, monkeypatch):
    rig = walk.rig(0.25)
    frame = FirstFrame(rig, next(iter(walk.observations(0.25, count=1))))
    begun = []

    def search(space, frame, start, *options):
        begun.append(float(start[space.scale_index]))
        return start[None].astype(np.float32)

    monkeypatch.setattr("mmocap_warp.fitting.subject_fit.search_headings", search)
    with things() as (stick, *_):
        carrier = carrying(man, [replace(stick, joint="RWrist")])[0]
    for body in (man, carrier):
        _headings(_Task(body, rig, QUICK, lambda *_: None), frame)
    assert begun == [begun[0], begun[0], 0.0]
    assert begun[0] < -0.01


def test_who_may_begin_far_from_rest_is_also_searched_near_to_it(walk, man, monkeypatch):
    asked = []

    def search(space, frame, start, headings, evaluations):
        asked.append((float(space.body.skeleton.spread.max()), evaluations / QUICK.evaluations))
        return start[None].astype(np.float32)

    monkeypatch.setattr("mmocap_warp.fitting.subject_fit.search_headings", search)
    frame = FirstFrame(walk.rig(0.25), next(iter(walk.observations(0.25, count=1))))
    far = replace(man, skeleton=replace(man.skeleton, spread=2 * man.skeleton.spread))
    for body in (man, far):
        _headings(_Task(body, frame.rig, QUICK, lambda *_: None), frame)
    assert asked == [(0.4, 1), (0.8, 3), (0.2, 3)]


@pytest.mark.parametrize(
    ("changes", "stands", "begun", "kinds"),
    [
        ({}, True, [(2, 1, False)], 2),
        ({}, False, [(1, 2, True), (2, 1, False)], 2),  # twice as many starts
        ({"rigid": True}, True, [(49, 1, True)], 1),
        ({"motion_poses": None}, True, [], 1),
    ],
    ids=["standing", "lying", "rigid", "without"],
)
def test_a_body_whose_motions_lead_far_also_begins_in_their_poses(man, monkeypatch, changes, stands, begun, kinds):
    asked = []

    def screened(shapes, frame, hull, poses, most):
        asked.append((len(poses), most / QUICK.headings))
        return np.zeros((1, len(shapes)), np.float32)

    def search(shapes, frame, starts, evaluations, *, near_rest):
        asked[-1] += (near_rest,)
        return starts

    module = "mmocap_warp.fitting.subject_fit"
    monkeypatch.setattr(f"{module}.screened_starts", screened)
    monkeypatch.setattr(f"{module}.search_starts", search)
    monkeypatch.setattr(f"{module}.subject_hull", lambda *_: None)
    monkeypatch.setattr(f"{module}.standing_start", lambda space, *_, **__: np.zeros(len(space)))
    monkeypatch.setattr(f"{module}.search_headings", lambda space, _, start, *__: start[None])
    skeleton = replace(man.skeleton, spread=2 * man.skeleton.spread, stands=stands)
    poses = np.zeros((2, skeleton.coordinates))
    moved = replace(man, **{"motion_poses": poses, "skeleton": skeleton} | changes)
    assert len(_headings(_Task(moved, SimpleNamespace(up="+y"), QUICK, lambda *_: None), None)) == kinds
    assert asked == begun


@pytest.mark.parametrize(("poses", "near_rest"), [(None, True), ("given", False)])
def test_poses_that_are_given_are_not_pulled_to_the_rest_pose(man, monkeypatch, poses, near_rest):
    """A rigid body is begun from several ways to lie, which have no rest to be pulled to where they are given."""
    asked = []

    def search(shapes, frame, starts, evaluations, *, near_rest):
        asked.append(near_rest)
        return starts.astype(np.float32)

    monkeypatch.setattr("mmocap_warp.fitting.subject_fit.search_starts", search)
    monkeypatch.setattr("mmocap_warp.fitting.subject_fit.subject_hull", lambda *_: None)
    monkeypatch.setattr(
        "mmocap_warp.fitting.subject_fit.screened_starts", lambda shapes, *_: np.zeros((1, len(shapes)), np.float32)
    )
    given = None if poses is None else np.zeros((1, man.skeleton.coordinates))
    task = _Task(man, SimpleNamespace(up="+y"), replace(QUICK, rigid=True), lambda *_: None, given)
    _headings(task, None)
    assert asked == [near_rest]
    assert task.body.rigid
    assert not replace(task, config=QUICK).body.rigid
    assert replace(task, generic=replace(man, rigid=True), config=QUICK).body.rigid


def test_the_prior_pulls_to_the_rest_pose(man):
    """It tells a person seen from behind from one seen from the front: angles weigh by how far joints turn."""
    space = ShapeSpace(man, "+z")
    expected = np.zeros(len(space))
    expected[3 : man.skeleton.coordinates] = 0.001 / np.repeat(man.skeleton.spread, 3) ** 2
    expected[space.slider_index] = 0.003
    np.testing.assert_allclose(_prior(space, _spread(space)), expected)
