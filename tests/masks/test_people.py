"""Labels of views become people: whatever a view calls them, whether or not it tells them apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from boxed_figure import FIGURE, rig_of, seen

from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.masks.people import UNDECIDED, People

VIEWS = 4
ALL = [True] * VIEWS


@pytest.fixture(scope="module")
def rig() -> CameraRig:
    return rig_of(VIEWS)


def labelled(rig: CameraRig, *people: tuple[float, list[int]]) -> list[np.ndarray]:
    """Label images of figures that stand at a place along x, and have a label in each view; the last is in front."""
    images = [np.zeros((height, width), np.uint8) for width, height in rig.size]
    for along, labels in people:
        for image, mask, label in zip(images, seen(rig, FIGURE, along), labels, strict=True):
            image[mask] = label
    return images


def same(made: list[np.ndarray], wanted: list[np.ndarray]) -> list[bool]:
    return [np.array_equal(a, b) for a, b in zip(made, wanted, strict=True)]


def test_labels_that_differ_from_view_to_view_and_swap_become_one(rig: CameraRig) -> None:
    people = People(rig)
    wanted = labelled(rig, (-0.8, [1] * VIEWS), (0.8, [2] * VIEWS))
    first = people(labelled(rig, (-0.8, [1, 2, 1, 7]), (0.8, [2, 1, 2, 3])))
    if first[0].max() == 2 and (first[0] == wanted[0]).mean() < 1:  # who is first is a matter of chance
        wanted = [np.where(image > 0, 3 - image, 0) for image in wanted]
    assert same(first, wanted) == ALL
    assert same(people(labelled(rig, (-0.8, [1, 1, 1, 7]), (0.8, [2, 2, 2, 3]))), wanted) == ALL
    assert people.views == {1: 2 * VIEWS, 2: 2 * VIEWS}
    assert people.swaps == 2  # of both people, in one view


def test_who_comes_nearer_keeps_the_number(rig: CameraRig) -> None:
    people = People(rig)
    people(labelled(rig, (0.6, [1] * VIEWS)))
    for frame, place in enumerate(np.linspace(-1.2, -0.1, 6)):
        made = people(labelled(rig, (0.6, [1 + frame % 2] * VIEWS), (place, [2 - frame % 2] * VIEWS)))
        assert same(made, labelled(rig, (0.6, [1] * VIEWS), (place, [2] * VIEWS))) == ALL
    assert people.views == {1: 7 * VIEWS, 2: 6 * VIEWS}


def test_where_a_view_does_not_tell_two_apart_its_pixels_are_undecided() -> None:
    rig = rig_of(5)  # none of them opposite to another, which would hide the same
    apart = labelled(rig, (-0.3, [1] * 5), (0.3, [2] * 5))
    both = [a & b for a, b in zip(seen(rig, FIGURE, -0.3), seen(rig, FIGURE, 0.3), strict=True)]
    k = min((k for k in range(5) if both[k].any()), key=lambda k: int(both[k].sum()))
    made = People(rig)([np.minimum(image, 1) if j == k else image for j, image in enumerate(apart)])
    assert (made[k] == UNDECIDED)[both[k]].mean() > 0.9
    assert (made[k] == UNDECIDED).sum() < 0.9 * (apart[k] > 0).sum()
    assert (made[k] > 0)[apart[k] > 0].all()


def test_who_has_no_hull_keeps_the_labels_where_they_were(rig: CameraRig) -> None:
    people, whole = People(rig), labelled(rig, (0.0, [1] * VIEWS))
    people(whole)
    halves = [
        np.where(np.arange(len(image))[:, None] // 40 % 2 == k % 2, 4 * image, 0) for k, image in enumerate(whole)
    ]
    assert same(people(halves), [image // 4 for image in halves]) == ALL


def test_a_label_of_one_view_alone_is_nobody(rig: CameraRig) -> None:
    images, people = labelled(rig, (0.0, [3] * VIEWS)), People(rig)
    wanted = [image // 3 for image in images]
    images[1][:20, :20] = 5
    assert same(people(images), wanted) == ALL
    assert people.views == {1: VIEWS}


def test_who_is_partly_beyond_an_image_is_whole_in_the_others(rig: CameraRig) -> None:
    images = labelled(rig, (0.0, [1] * VIEWS))
    height, width = images[0].shape
    low = rig.size.copy()
    low[0] = width, height // 2
    people = People(replace(rig, size=low))
    images[0] = images[0][: height // 2]
    assert same(people(images), images) == ALL


def test_empty_images_show_nobody(rig: CameraRig) -> None:
    people = People(rig)
    assert not any(image.any() for image in people(labelled(rig)))
    assert not people.views
