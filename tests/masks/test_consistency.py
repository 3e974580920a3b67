"""Views that agree keep their masks to the bit; what all others contradict is filled, what none supports is cut."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from boxed_figure import FIGURE, rig_of, seen

from mmocap_warp.cameras.rig import CameraRig, project
from mmocap_warp.masks.consistency import Consistency

VIEWS = 5
ARM = np.array([[-0.07, 1.75, -0.07], [0.07, 2.2, 0.07]])  # raised


@pytest.fixture(scope="module")
def rig() -> CameraRig:
    return rig_of(VIEWS)


@pytest.fixture(scope="module")
def whole(rig: CameraRig) -> list[np.ndarray]:
    return seen(rig, (*FIGURE, ARM))


def iou(a: np.ndarray, b: np.ndarray) -> float:
    return (a & b).sum() / (a | b).sum()


def turned(rig: CameraRig, k: int, degrees: float) -> CameraRig:
    turn, _ = cv2.Rodrigues(np.array([0, np.deg2rad(degrees), 0]))
    R, t = rig.R.copy(), rig.t.copy()
    R[k], t[k] = turn @ R[k], turn @ t[k]
    return replace(rig, R=R, t=t)


def changed(masks: list[np.ndarray], k: int, new: np.ndarray) -> list[np.ndarray]:
    return [new if j == k else mask for j, mask in enumerate(masks)]


def test_sound_masks_stay_as_they_are(rig: CameraRig, whole: list[np.ndarray]) -> None:
    consistency = Consistency(rig)
    assert all(made is mask for made, mask in zip(consistency(whole), whole, strict=True))
    assert consistency.filled == consistency.cut == [[0] * VIEWS]
    assert consistency.untouched == 0


def test_a_raised_arm_that_one_view_lacks_is_filled(rig: CameraRig, whole: list[np.ndarray]) -> None:
    lacking = changed(whole, 0, seen(rig, FIGURE)[0])
    consistency = Consistency(rig)
    made = consistency(lacking)
    assert iou(lacking[0], whole[0]) < 0.92
    assert iou(made[0], whole[0]) > 0.96
    assert [made[k] is whole[k] for k in range(1, VIEWS)] == [True] * (VIEWS - 1)
    assert consistency.filled[0][0] == (made[0] & ~lacking[0]).sum() > 0
    assert consistency.cut == [[0] * VIEWS]


def test_a_hole_in_the_trunk_is_filled(rig: CameraRig) -> None:
    trunk = (np.array([[-0.25, 0.0, -0.25], [0.25, 1.75, 0.25]]),)
    masks = seen(rig, trunk)
    column, row = np.rint(project(rig, np.array([[0.0, 1.2, 0.0]]))[2, 0]).astype(int)
    hole = masks[2].astype(np.uint8)
    cv2.circle(hole, (int(column), int(row)), 5, 0, -1)
    made = Consistency(rig)(changed(masks, 2, hole > 0))
    np.testing.assert_array_equal(made[2], masks[2])


def test_a_piece_that_only_one_view_has_is_cut(rig: CameraRig, whole: list[np.ndarray]) -> None:
    more = whole[3].astype(np.uint8)
    row, column = np.nonzero(more)
    cv2.circle(more, (int(column.max()) + 6, int(row.min()) + 10), 12, 1, -1)
    consistency = Consistency(rig)
    made = consistency(changed(whole, 3, more > 0))
    assert iou(more > 0, whole[3]) < 0.95 < 0.97 < iou(made[3], whole[3])
    assert consistency.cut[0][3] > 0
    assert consistency.filled == [[0] * VIEWS]


def test_a_wrong_camera_changes_no_mask(rig: CameraRig, whole: list[np.ndarray]) -> None:
    consistency = Consistency(turned(rig, 0, 4.0))
    lacking = changed(whole, 0, seen(rig, FIGURE)[0])
    for masks in (whole, lacking):
        assert all(made is mask for made, mask in zip(consistency(masks), masks, strict=True))
    assert consistency.untouched == 2


@pytest.mark.parametrize("views", [(0, 1, 2), ()])
def test_fewer_than_four_views_are_left_alone(rig: CameraRig, whole: list[np.ndarray], views: tuple[int, ...]) -> None:
    masks = [mask if k in views else mask & False for k, mask in enumerate(changed(whole, 1, whole[1] & False))]
    assert all(made is mask for made, mask in zip(Consistency(rig)(masks), masks, strict=True))
