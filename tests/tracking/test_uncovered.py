"""What masks show beside a body: limbs are told by part and place, and what is more than limbs is somebody else."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import pytest
from random_scenes import perfect_masks
from synthetic import ring_rig, synthetic_subject

from mmocap_warp.body.posing import Poser, joint_positions
from mmocap_warp.cameras.rig import project
from mmocap_warp.masks.observation import Observation
from mmocap_warp.tracking.uncovered import Uncovered, UncoveredArea, is_usual, look_interval, parts_in_doubt

RIG = ring_rig(cameras=4, size=(240, 180))
SUBJECT = synthetic_subject()
SKELETON = SUBJECT.body.skeleton


@cache
def area_finder() -> UncoveredArea:
    return UncoveredArea(SUBJECT, RIG)


def masks() -> list[np.ndarray]:
    return [mask.copy() for mask in perfect_masks(SUBJECT, RIG, SUBJECT.pose)]


def beside(seen: list[np.ndarray], *, shadows: bool = True) -> Uncovered:
    return area_finder().of(SUBJECT.pose[None], Observation.from_masks(seen), shadows=shadows)[0]


def with_cube(side: float, views: tuple[int, ...] = (0, 1, 2, 3)) -> tuple[list[np.ndarray], np.ndarray]:
    """The body's masks with a cube over its head in some views, and the cube's middle."""
    head = joint_positions(SUBJECT, SUBJECT.pose[None])[0, SKELETON.index("Neck")]
    middle = head + np.array([0.0, 0.45 + side / 2, 0.0])
    return with_box(middle, np.full(3, side), views), middle


def with_box(middle: np.ndarray, sides: np.ndarray, views: tuple[int, ...] = (0, 1, 2, 3)) -> list[np.ndarray]:
    corners = middle + sides * (np.stack(np.meshgrid(*[[-0.5, 0.5]] * 3), axis=-1).reshape(-1, 3))
    seen = masks()
    for k in views:
        drawn = seen[k].astype(np.uint8)
        cv2.fillConvexPoly(drawn, cv2.convexHull(project(RIG, corners)[k].round().astype(np.int32)), 1)
        seen[k] = drawn.astype(bool)
    return seen


def test_a_body_leaves_nothing_of_its_own_masks_uncovered() -> None:
    assert not beside(masks()).area.any()
    assert not len(beside(masks()).place)


def test_a_limb_elsewhere_is_uncovered_near_its_part() -> None:
    pose = SUBJECT.pose.copy()
    pose[SKELETON.angles("LShoulder")] += [0.0, 0.0, 1.2]
    found = beside(list(perfect_masks(SUBJECT, RIG, pose)))
    assert SKELETON.parts[found.area.argmax()] == "left arm"
    assert 0.02 < found.area.sum() < 0.06
    arm = joint_positions(SUBJECT, pose[None])[0, [SKELETON.index("LElbow"), SKELETON.index("LWrist")]]
    assert np.linalg.norm(found.place[:, None] - arm, axis=2).min(axis=1).mean() < 0.3


@pytest.mark.parametrize(("side", "counts"), [(0.25, True), (0.42, False)])
def test_a_view_that_shows_more_than_limbs_beside_the_body_shows_somebody_else(side: float, counts: bool) -> None:
    """From .12 m^2 on, which is more than both arms."""
    seen, middle = with_cube(side)
    found = beside(seen)
    assert found.area.any() == counts
    assert bool(len(found.place)) == counts
    if counts:
        assert np.linalg.norm(found.place - middle, axis=1).max() < side
        np.testing.assert_allclose(found.area.sum(), side**2 * 1.2, rtol=0.35)


def test_what_one_view_alone_shows_may_be_a_fault_of_its_mask() -> None:
    assert not beside(with_cube(0.25, views=(1,))[0]).area.any()


@pytest.mark.parametrize(("height", "is_shadow"), [(0.0, True), (0.15, False)])
def test_what_lies_flat_on_the_floor_may_be_a_shadow(height: float, is_shadow: bool) -> None:
    """The floor is where the body is lowest."""
    vertices = Poser(SUBJECT.body, SUBJECT.root_base).tracking_vertices(SUBJECT.pose)[0]
    place = np.array([vertices[:, 0].mean() + 0.35, vertices[:, 1].min() + height, vertices[:, 2].mean()])
    seen = with_box(place, np.array([0.2, 0.01, 0.2]))
    assert beside(seen).area.sum() > 0.003
    assert beside(seen, shadows=False).area.any() != is_shadow


def test_looks_beyond_those_that_marks_can_tell_apart_find_the_same(monkeypatch) -> None:
    monkeypatch.setattr("mmocap_warp.tracking.uncovered.MOST_LOOKS", 2)
    finder, seen = UncoveredArea(SUBJECT, RIG), Observation.from_masks(with_cube(0.25)[0])
    areas = [finder.of(SUBJECT.pose[None], seen)[0].area for _ in range(5)]
    assert areas[0].any()
    assert all((area == areas[0]).all() for area in areas)
    assert finder._look.number.numpy()[0] == 1


def test_ten_times_a_second_is_looked_and_three_times_as_often_at_final_poses() -> None:
    assert [look_interval(rate) for rate in (5.0, 60.0, 240.0)] == [1, 6, 24]
    assert [look_interval(rate, final=True) for rate in (5.0, 60.0, 240.0)] == [1, 2, 8]


def test_what_stands_out_in_nearly_all_of_many_looks_is_usual() -> None:
    assert [bool(is_usual(np.array(out), looks)) for out, looks in ((9, 12), (10, 12), (9, 9))] == [False, True, False]


def doubted(excess: list[float], part: int = 1) -> list[int]:
    """The looks, ten a second, in which a part is in doubt, beside a usual area of 2 cm^2 near each of three."""
    area = np.full((len(excess), 3), 0.0002)
    area[:, part] += excess
    doubt = parts_in_doubt(1.0, 10.0, np.arange(len(excess)), area, len(excess))
    assert not np.delete(doubt, part, axis=1).any()
    return np.flatnonzero(doubt[:, part]).tolist()


def test_plenty_at_once_or_little_for_a_while_is_a_lost_limb() -> None:
    none = [0.0] * 8
    assert doubted([*none, 0.0099, *none]) == []
    assert doubted([*none, 0.0101, *none]) == [7, 8, 9]
    assert doubted([*none, 0.0059, 0.0059, *none]) == []
    assert doubted([*none, 0.0061, 0.0061, *none]) == [7, 8, 9, 10]
    assert doubted([*none, 0.0031, 0.0031, 0.0031, *none]) == [7, 8, 9, 10, 11]
    assert doubted([*none, *[0.0029] * 5, *none]) == []
    assert doubted([0.01] * 14 + [0.0] * 4) == []  # nearly all the time: it is no limb
    assert doubted([0.02] * 7 + [0.0] * 2) != []  # so few looks do not say that


def test_frames_between_looks_are_in_doubt_as_the_looks_about_them() -> None:
    looked, area = np.arange(0, 60, 6), np.zeros((10, 2))
    area[5, 0] = 0.02
    doubt = parts_in_doubt(1.0, 60.0, looked, area, 62)
    assert np.flatnonzero(doubt[:, 0]).tolist() == list(range(19, 42))
    small = parts_in_doubt(0.4, 60.0, looked, 0.1 * area, 62)
    assert small[:, 0].any()
    assert not parts_in_doubt(1.0, 60.0, looked, 0.1 * area, 62).any()
