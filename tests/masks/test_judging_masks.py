"""Masks are judged without truth: what is whole passes, and each fault is named with the view that has it."""

from __future__ import annotations

import numpy as np
import pytest
from boxed_figure import FIGURE, LEG, VOLUME, rig_of, seen

from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.masks import mask_check
from mmocap_warp.masks.mask_check import MaskJudge, MaskReport

FRAMES = 15


@pytest.fixture(autouse=True, params=["few", pytest.param("usual", marks=pytest.mark.nightly)])
def compared_frames(request, monkeypatch) -> str:
    """Two frames, or as many as usual: in these frames the figure is the same."""
    if request.param == "few":
        monkeypatch.setattr(mask_check, "_COMPARED_FRAMES", 2)
    return str(request.param)


def judged(rig: CameraRig, frames: list[list[np.ndarray]]) -> MaskReport:
    judge = MaskJudge(rig, len(frames), VOLUME)
    for masks in frames:
        judge.add(masks)
    return judge.report()


def walking(rig: CameraRig, boxes: tuple[np.ndarray, ...] = FIGURE) -> list[list[np.ndarray]]:
    return [seen(rig, boxes, 0.02 * frame) for frame in range(FRAMES)]


@pytest.mark.parametrize("cameras", [2, 3, pytest.param(4, marks=pytest.mark.nightly), 6])
def test_a_whole_figure_passes(cameras: int) -> None:
    rig = rig_of(cameras)
    report = judged(rig, walking(rig))
    assert report.faults == ()
    assert report.volume > 0.9 * VOLUME
    for view in report.views.values():
        assert (view.area > 0).all()
        assert cameras == 2 or view.explained > 0.95


@pytest.mark.parametrize("cameras", [3, pytest.param(4, marks=pytest.mark.nightly), 6])
def test_only_a_moving_leg_was_segmented(cameras: int) -> None:
    rig = rig_of(cameras)
    (fault,) = judged(rig, walking(rig, (LEG,))).faults
    assert "only a part of it was segmented, such as a moving leg" in fault


@pytest.mark.parametrize("size", [0.02, 0.1])
def test_a_small_animal_is_looked_at_in_its_own_measure(size: float) -> None:
    """The same figure before cameras that are as much nearer."""
    rig, large = rig_of(4), judged(rig_of(4), walking(rig_of(4)))
    judge = MaskJudge(rig.in_unit(1 / size), FRAMES, size**3 * VOLUME)
    for masks in walking(rig):
        judge.add(masks)
    small = judge.report()
    assert small.faults == ()
    assert small.volume / size**3 == pytest.approx(large.volume, rel=0.1)
    for name, view in small.views.items():
        assert view.explained == pytest.approx(large.views[name].explained, abs=0.03)


@pytest.mark.parametrize(
    ("size", "supposed", "fault"),
    [
        (0.1, True, None),  # a mouse, and nobody said so
        (0.1, False, "holds {} litres, a body like the subject's 67: only a part of it was segmented"),
        (0.28, True, "litres, a body like the subject's 67: only a part of it was segmented, such as a moving leg, or"),
    ],
)
def test_what_is_small_is_no_part_of_a_supposed_person(size, supposed, fault, compared_frames) -> None:
    judge = MaskJudge(rig_of(4).in_unit(1 / size), FRAMES, 0.067, supposed=supposed)
    for masks in walking(rig_of(4)):
        judge.add(masks)
    faults = judge.report().faults
    assert len(faults) == (fault is not None)
    assert fault is None or fault.format({"few": "0.23", "usual": "0.24"}[compared_frames]) in faults[0]


@pytest.mark.parametrize("cameras", [3, pytest.param(4, marks=pytest.mark.nightly), 6])
def test_a_view_that_shows_a_leg_alone_is_named(cameras: int) -> None:
    rig = rig_of(cameras)
    frames = walking(rig)
    for masks, legs in zip(frames, walking(rig, (LEG,)), strict=True):
        masks[1] = legs[1]
    (fault,) = judged(rig, frames).faults
    assert fault.startswith(f"{rig.names[1]} shows ")
    assert "most of the subject is missing there" in fault


def test_a_view_that_shows_something_else_as_well_is_named() -> None:
    rig = rig_of(4)
    frames = walking(rig)
    for masks in frames:
        masks[2][:, :60] = True
    (fault,) = judged(rig, frames).faults
    assert f"of what {rig.names[2]} shows is seen by no other view" in fault


def test_views_that_are_empty_are_counted() -> None:
    rig = rig_of(4)
    frames = walking(rig)
    for masks in frames[:6]:
        masks[3][:] = False
    assert judged(rig, frames).faults == (f"{rig.names[3]} shows nothing in 6 of {FRAMES} frames",)
    assert judged(rig, walking(rig)[:3] + frames[:1] + walking(rig)[:4]).faults == ()


def test_nothing_at_all() -> None:
    rig = rig_of(3)
    faults = judged(rig, [[np.zeros_like(mask) for mask in masks] for masks in walking(rig)]).faults
    assert len(faults) == 4


def test_what_leaves_the_image_is_not_missing() -> None:
    """Two cameras see no more than the upper half."""
    rig = rig_of(4)
    K = rig.K.copy()
    K[2:, 1, 2] += 0.35 * rig.size[0, 1]
    cut = CameraRig(rig.names, K, rig.R, rig.t, rig.size, rig.distortion, rig.up)
    frames = walking(cut)
    assert all(mask[-1].any() for mask in frames[0][2:])
    assert judged(cut, frames).faults == ()
