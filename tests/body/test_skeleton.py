from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synthetic import NAMES, SKELETON

from mmocap_warp.body.skeleton import Skeleton


def chain(**changes) -> Skeleton:
    """Three joints in a row: a free root, a hinge about y, a hinge about x."""
    given = {
        "joints": ("base", "upper", "lower"),
        "parent": (-1, 0, 1),
        "frame": np.tile(np.eye(3, dtype=np.float32), (3, 1, 1)),
        "limits": np.tile(np.array([-1.0, 1.0], np.float32), (3, 3, 1)),
        "spread": np.full(3, 0.2),
        "models": {8: np.array([0, 1, 2, 3, 4, 5, 7, 9]), 2: np.array([7, 9])},
        "parts": ("place", "reach"),
        "part": (0, 1, 1),
    }
    return Skeleton(**given | changes)


@pytest.mark.parametrize("model", [51, 39, 28])
def test_table_1_counts(model: int) -> None:
    index = SKELETON.searched(model)
    assert len(index) == len(set(index.tolist())) == model
    assert index[:3].tolist() == [0, 1, 2]


def test_people_are_searched_in_39_dimensions_by_default() -> None:
    np.testing.assert_array_equal(SKELETON.searched(), SKELETON.searched(39))


def test_table_1_part_sizes() -> None:
    sizes = {model: [len(index) for index in SKELETON.searched_by_part(model).values()] for model in (39, 28)}
    assert sizes == {39: [6, 9, 6, 6, 6, 6], 28: [6, 6, 4, 4, 4, 4]}  # the root's three translations included


def test_table_1_hinges() -> None:
    for model in (39, 28):
        names = [NAMES[i] for i in SKELETON.searched(model)]
        assert [n for n in names if "Elbow" in n] == ["LElbow.Ry", "RElbow.Ry"]
        assert [n for n in names if "Knee" in n] == ["LKnee.Rx", "RKnee.Rx"]


def test_unknown_model() -> None:
    with pytest.raises(ValueError, match=r"dof must be one of \[39, 28, 51\], got 40"):
        SKELETON.searched(40)


def test_sides_and_ends() -> None:
    assert [SKELETON.side(joint) for joint in ("LKnee", "RHip", "Root", "Neck")] == [
        "left",
        "right",
        "middle",
        "middle",
    ]
    assert SKELETON.ends == ("LWrist", "RWrist", "LAnkle", "RAnkle")
    assert SKELETON.evaluation_groups["wrists"] == ("LWrist", "RWrist")


def test_without_pairs_every_joint_is_judged() -> None:
    skeleton = chain()
    assert skeleton.evaluation_groups == {"base": ("base",), "upper": ("upper",), "lower": ("lower",)}
    assert skeleton.ends == ("lower",)


def test_a_part_of_which_nothing_is_searched_is_left_out() -> None:
    parts = {name: index.tolist() for name, index in chain().searched_by_part(2).items()}
    assert parts == {"reach": [7, 9]}


def test_the_root_moves_all_and_a_hinge_what_hangs_on_it() -> None:
    skeleton = chain()
    assert skeleton.moved_by(np.array([1])).tolist() == [True] * 3
    assert skeleton.moved_by(np.array([4])).tolist() == [True] * 3
    assert skeleton.moved_by(np.array([7])).tolist() == [False, True, True]
    assert skeleton.moved_by(np.array([9])).tolist() == [False, False, True]


def test_limits_of_coordinates_leave_the_translation_free() -> None:
    limits = chain().coordinate_limits
    assert np.isinf(limits[:3]).all()
    assert np.array_equal(limits[3:], np.tile([-1.0, 1.0], (9, 1)))


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"joints": ("a", "b", "a")}, "joints must be named, each differently"),
        ({"parent": (-1, 2, 0)}, "parent must start with -1"),
        ({"parent": (0, 0, 1)}, "parent must start with -1"),
        ({"parent": (-1, 0)}, "parent must start with -1"),
        ({"frame": np.zeros((2, 3, 3))}, r"frame must be \(3, 3, 3\)"),
        ({"spread": np.array([0.1, 0.0, 0.1])}, "spread must be positive"),
        ({"limits": np.tile([1.0, -1.0], (3, 3, 1))}, "lower limit above the upper"),
        ({"models": {}}, "models must name"),
        ({"models": {3: np.array([7, 9])}}, "models: 3 must be"),
        ({"models": {2: np.array([9, 7])}}, "ascending"),
        ({"models": {1: np.array([12])}}, r"of 0 \.\. 11"),
        ({"part": (0, 1)}, "part must give each joint"),
        ({"part": (0, 0, 0)}, "part must give each joint"),
        ({"pairs": (("arms", "upper", "wing"),)}, "pairs must be of different joints"),
        ({"pairs": (("arms", "upper", "upper"),)}, "pairs must be of different joints"),
    ],
)
def test_what_does_not_fit_together_is_refused(change: dict, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        chain(**change)
    with pytest.raises(ValueError, match=complaint):
        replace(chain(), **change)


def test_unknown_joint() -> None:
    with pytest.raises(ValueError, match=r"joint must be one of .*, got 'LFoot'"):
        SKELETON.index("LFoot")


def test_a_root_that_stands_still_can_be_freed_to_be_found() -> None:
    arm = chain(models={2: np.array([7, 9])})
    assert arm.root_is_fixed
    assert not chain().root_is_fixed
    freed = arm.with_free_root()
    np.testing.assert_array_equal(freed.searched(), [0, 1, 2, 3, 4, 5, 7, 9])
    assert np.isinf(freed.limits[0]).all()
    np.testing.assert_array_equal(freed.limits[1:], arm.limits[1:])
