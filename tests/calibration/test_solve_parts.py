"""What cameras are solved from: sticks, floors, tangents, heads and feet, each where the answer is known exactly."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from mmocap_warp.body.rotations import turn
from mmocap_warp.calibration.solve import UnsolvableError
from mmocap_warp.calibration.solve.floor_views import (
    FEWEST_FRAMES,
    StandingView,
    _head_errors,
    place_on_floor,
    rigid_motion,
    standing_view,
)
from mmocap_warp.calibration.solve.level import _fit_two_planes, level_world
from mmocap_warp.calibration.solve.person_axis import CORNERS, PersonInViews, person_in_views
from mmocap_warp.calibration.solve.tangents import (
    Pinholes,
    Tangents,
    _cost,
    _normal_equations,
    _prior,
    find_tangents,
    residuals,
    solve_tangents,
)
from mmocap_warp.cameras.rig import CameraRig, project
from mmocap_warp.masks.observation import Observation
from mmocap_warp.synthesis.footage.made_recording import placed_camera

SIZE = (640, 480)
STATURE = 1.7
PLACES = (
    (10.0, 4.2, 1.5, 0.9, 0.5),
    (80.0, 4.0, 2.1, 0.9, -1.0),
    (170.0, 4.5, 1.2, 0.9, 2.0),
    (250.0, 4.1, 1.8, 0.9, 0.0),
)


def made_rig() -> CameraRig:
    placed = [placed_camera(*place, 650.0, (0.0, 0.0), SIZE) for place in PLACES]
    K, R, t = (np.array(each) for each in zip(*placed, strict=True))
    count = len(PLACES)
    return CameraRig(tuple("abcd"), K, R, t, np.tile(SIZE, (count, 1)), np.zeros((count, 5)), "+z")


RIG = made_rig()


def way(frames: int = 40) -> np.ndarray:
    """(frame, 3), most of a circle on the floor."""
    angle = np.linspace(0, 5.0, frames)
    return np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)


def polytopes(places: np.ndarray) -> np.ndarray:
    """(frame, corner, 3), bodies with a pointed head and two feet flat on the floor, turned in each frame."""
    corners = np.array(
        [
            [0.0, 0.0, STATURE], [0.25, 0.0, 1.3], [-0.25, 0.0, 1.3], [0.0, 0.15, 1.2], [0.0, -0.15, 1.2],
            [0.1, 0.1, 0.0], [0.1, -0.1, 0.0], [-0.1, 0.1, 0.0], [-0.1, -0.1, 0.0],
        ]
    )  # fmt: skip
    return np.stack([corners @ turn("z", 0.7 * frame).T + place for frame, place in enumerate(places)])


def person_before(rig: CameraRig, bodies: np.ndarray) -> PersonInViews:
    """The hulls of the bodies' corners, exactly, and their axes."""
    hull = np.full((len(rig), len(bodies), CORNERS, 2), np.nan)
    for k in range(len(rig)):
        camera = rig.select((rig.names[k],))
        for frame, body in enumerate(bodies):
            corners = cv2.convexHull(project(camera, body)[0].astype(np.float32))[:, 0]
            hull[k, frame] = np.concatenate([corners, np.repeat(corners[-1:], CORNERS - len(corners), axis=0)])
    return PersonInViews(project(rig, bodies[:, 0]), project(rig, bodies[:, 0] * [1.0, 1.0, 0.0]), hull)


def pinholes(rig: CameraRig) -> Pinholes:
    return Pinholes(rig.R, rig.centres, rig.K[:, [0, 1], [0, 1]], rig.K[:, :2, 2])


def figure(*more: tuple[slice, slice]) -> np.ndarray:
    mask = np.zeros((200, 160), bool)
    mask[40:60, 75:86] = True  # head
    mask[60:180, 65:96] = True
    for piece in more:
        mask[piece] = True
    return mask


def seen_in(*masks: np.ndarray) -> PersonInViews:
    return person_in_views([Observation.from_masks([mask]) for mask in masks], np.array([[160, 200]]))


def test_head_and_foot_are_the_ends_of_the_axis():
    person = seen_in(figure())
    np.testing.assert_allclose(person.head, [[[80.0, 39.5]]], atol=1e-9)
    np.testing.assert_allclose(person.foot, [[[80.0, 179.5]]], atol=1e-9)
    assert np.isfinite(person.hull).all()
    assert np.abs(person.hull[0, 0].min(axis=0) - [64.5, 39.5]).max() < 0.5


def test_specks_are_none_of_the_person():
    clean, specked = (seen_in(mask) for mask in (figure(), figure((slice(10, 14), slice(20, 24)))))
    for name in ("head", "foot", "hull"):
        np.testing.assert_array_equal(getattr(specked, name), getattr(clean, name))


def test_who_is_cut_off_missing_or_no_upright_figure_is_not_seen():
    cut, none, ball = figure((slice(0, 40), slice(78, 82))), np.zeros((200, 160), bool), np.zeros((200, 160), bool)
    cv2.circle(ball.view(np.uint8), (80, 100), 40, 1, -1)
    np.testing.assert_array_equal(seen_in(figure(), cut, none, ball).whole, [[True, False, False, False]])


@pytest.mark.parametrize("quarters", [1, -1], ids=["left", "right"])
def test_of_a_lying_figure_the_narrower_end_is_the_head(quarters: int) -> None:
    """However the figure leans; and of an upright one the upper end is, however wide."""
    masks = []
    for lean in (-8.0, -4.0, 4.0, 8.0):
        leaning = cv2.warpAffine(
            figure().astype(np.uint8), cv2.getRotationMatrix2D((80.0, 100.0), lean, 0.9), (160, 200)
        )
        masks.append(np.ascontiguousarray(np.rot90(leaning, quarters)).astype(bool))
    person = person_in_views([Observation.from_masks([mask]) for mask in masks], np.array([[200, 160]]))
    assert person.whole.all()
    assert (quarters * (person.foot - person.head)[0, :, 0] > 90).all()
    arms_up = figure((slice(30, 50), slice(55, 106)))
    assert seen_in(arms_up).head[0, 0, 1] < 40


def test_a_hull_of_many_corners_is_thinned_out_evenly() -> None:
    radius, size = 280.0, np.array([[640, 640]])
    disc = np.zeros((640, 640), np.uint8)
    cv2.ellipse(disc, (320, 320), (160, 300), 0, 0, 360, 1, -1)
    (hull,) = person_in_views([Observation.from_masks([disc.astype(bool)])], size).hull[0]
    from_middle = (hull - 320) / [160.5, 300.5]
    np.testing.assert_allclose(np.linalg.norm(from_middle, axis=1), 1.0, atol=0.01)
    steps = np.linalg.norm(np.diff(hull, axis=0), axis=1)
    assert steps.min() > 0
    assert steps.max() < radius / 4


def test_a_stick_that_walks_tells_how_its_camera_stands():
    feet = way()
    for k, (_, _, height, _, _) in enumerate(PLACES):
        camera = RIG.select((RIG.names[k],))
        head, foot = project(camera, feet + STATURE * np.eye(3)[2])[0], project(camera, feet)[0]
        view = standing_view("a", head, foot, RIG.K[k], STATURE)
        assert view.height == pytest.approx(height, abs=1e-5)
        np.testing.assert_allclose(view.R[:, 2], RIG.R[k] @ [0, 0, 1], atol=1e-6)
        distance = np.linalg.norm(feet[:, :2] - RIG.centres[k, :2], axis=1)
        np.testing.assert_allclose(np.linalg.norm(view.track, axis=1), distance, atol=1e-5)


def test_one_walk_places_all_views_on_one_floor():
    feet = way()
    person = person_before(RIG, polytopes(feet))
    seen = zip(RIG.names, person.head, person.foot, RIG.K, strict=True)
    views = [standing_view(*each, STATURE) for each in seen]
    R, t = place_on_floor(RIG.names, views)
    relative = R @ R[0].T, RIG.R @ RIG.R[0].T
    np.testing.assert_allclose(*relative, atol=1e-4)
    centres = [-np.einsum("kji,kj->ki", *pair) for pair in ((R, t), (RIG.R, RIG.t))]
    between = [np.linalg.norm(each[:, None] - each[None], axis=-1) for each in centres]
    np.testing.assert_allclose(*between, atol=1e-3)
    np.testing.assert_allclose(centres[0][:, 2], centres[1][:, 2], atol=1e-4)


def test_a_view_that_shares_no_frames_with_the_others_is_named():
    track = way()[:, :2]
    early, late = (
        np.where(np.arange(40)[:, None] < 20, track, np.nan),
        np.where(np.arange(40)[:, None] < 15, np.nan, track),
    )
    with pytest.raises(UnsolvableError, match="camera 'b' shows the whole person together with another in 5 frames"):
        place_on_floor(("a", "b"), [StandingView(np.eye(3), 1.0, each) for each in (late, early)])


def test_a_rigid_motion_is_found_in_spite_of_outliers():
    here = way()[:, :2]
    there = here @ turn("z", 2.5)[:2, :2].T + [3.0, -1.0]
    there[:4] += 2.0
    rotation, shift = rigid_motion(here, there)
    np.testing.assert_allclose(rotation, turn("z", 2.5)[:2, :2], atol=2e-3)
    np.testing.assert_allclose(shift, [3.0, -1.0], atol=5e-3)


def test_a_straight_walk_has_one_rigid_motion():
    here = np.stack([np.linspace(-1, 1, 20), np.zeros(20)], axis=1)
    rotation, _ = rigid_motion(here, here @ turn("z", -1.1)[:2, :2].T)
    np.testing.assert_allclose(rotation, turn("z", -1.1)[:2, :2], atol=1e-12)


def test_tangents_of_true_cameras_agree():
    seen = person_before(RIG, polytopes(way())).hull
    tangents = find_tangents(pinholes(RIG), seen)
    assert len(tangents.frame) + tangents.missing == 2 * 6 * 40
    assert np.abs(residuals(pinholes(RIG), tangents)).max() < 1e-3


def test_views_that_never_see_the_person_at_once_have_no_tangents() -> None:
    hulls = person_before(RIG, polytopes(way())).hull.copy()
    for k in range(len(hulls)):
        hulls[k, np.arange(hulls.shape[1]) % len(hulls) != k] = np.nan
    tangents = find_tangents(pinholes(RIG), hulls)
    assert (tangents.frame.size, tangents.missing) == (0, 0)
    assert residuals(pinholes(RIG), tangents).shape == (0,)


def test_residuals_are_pixels():
    """A view raised by two pixels misses another, as sharp and as far, by what both share of it."""
    cameras = pinholes(RIG)
    tangents = find_tangents(cameras, person_before(RIG, polytopes(way())).hull)
    raised = replace(tangents, pixel=tangents.pixel + np.array([0.0, 2.0])[:, None, None] * [0.0, 1.0])
    missed = np.abs(residuals(cameras, raised))
    assert 1.0 < np.median(missed) < 1.5  # 2 / sqrt(2), less where the person stands off the middle


@pytest.mark.parametrize("guessed", [False, True])
def test_cameras_are_adjusted_to_their_tangents(guessed):
    person = person_before(RIG, polytopes(way()))
    rng = np.random.default_rng(5)
    step = np.zeros((4, 7))
    step[:, :3], step[:, 3:6] = rng.normal(0, 0.03, (4, 3)), rng.normal(0, 0.1, (4, 3))
    step[:, 6] = rng.normal(0.06, 0.02, 4) if guessed else 0.0
    start = pinholes(RIG).moved(step)
    found = solve_tangents(start, person.hull, np.full(4, guessed))
    assert np.median(np.abs(residuals(start, find_tangents(start, person.hull)))) > 3.0
    assert np.abs(residuals(found, find_tangents(found, person.hull))).max() < (0.3 if guessed else 0.01)
    between = [each.R[1:] @ each.R[0].T for each in (found, pinholes(RIG))]
    np.testing.assert_allclose(*between, atol=0.01 if guessed else 1e-4)
    if guessed:
        np.testing.assert_allclose(found.focal[:, 0], 650.0, rtol=0.015)
    else:
        np.testing.assert_array_equal(found.focal, start.focal)


def test_the_prior_of_focal_lengths_counts_their_mean_and_how_unlike_they_are() -> None:
    """A share of .25 of all, or of .04 between them, weighs as much as ten residuals that begin to count less."""
    np.testing.assert_allclose(_prior(np.array([0.25, 0.25]), 1.5), [0.0, 0.0, 1.5 * np.sqrt(10)])
    np.testing.assert_allclose(_prior(np.array([0.04, -0.04]), 2.0), 2.0 * np.sqrt(10) * np.array([1.0, -1.0, 0.0]))


def test_tangents_weigh_less_the_more_they_miss() -> None:
    """The normal equations' gradient is the derivative of the robust cost, with outliers and guessed focal lengths."""
    seen = person_before(RIG, polytopes(way(6))).hull
    step = np.random.default_rng(2).normal(0, 0.02, (4, 7))
    cameras, free = pinholes(RIG).moved(step), np.array([True, True, False, True])
    tangents, guess = find_tangents(cameras, seen), np.log(np.full(4, 640.0))
    assert np.abs(residuals(cameras, tangents)).max() > 2.0
    _, gradient = _normal_equations(cameras, tangents, 1.5, guess, free)
    for k, column in [(0, 0), (1, 2), (2, 4), (3, 6), (1, 6)]:
        step = np.zeros((4, 7))
        step[k, column] = 1e-5
        up, down = (_cost(cameras.moved(way), tangents, 1.5, guess) for way in (step, -step))
        assert gradient[7 * k + column] == pytest.approx((up - down) / 2e-5, rel=1e-3)
    assert gradient[7 * 2 + 6] == 0.0


def test_a_missing_tangent_costs_as_much_as_one_that_misses_by_fifty_pixels() -> None:
    seen = person_before(RIG, polytopes(way(6))).hull
    cameras = pinholes(RIG)
    tangents, guess = find_tangents(cameras, seen), np.log(cameras.focal[:, 0])
    missing = Tangents(tangents.camera, tangents.frame, tangents.pixel, tangents.missing + 2)
    costs = [_cost(cameras, each, 5.0, guess) for each in (tangents, missing)]
    assert costs[1] - costs[0] == pytest.approx(2 * 0.5 * 25 * np.log1p(100.0))


def test_heads_and_feet_give_metres_and_the_floor():
    person = person_before(RIG, polytopes(way()))
    tilted = turn("x", 0.03) @ turn("y", -0.02)
    elsewhere = replace(pinholes(RIG), R=RIG.R @ tilted.T, centre=0.9 * (RIG.centres @ tilted.T + [1.0, 2.0, 0.3]))
    found = level_world(elsewhere, person, STATURE)
    np.testing.assert_allclose(found.R[:, :, 2], RIG.R[:, :, 2], atol=5e-3)
    np.testing.assert_allclose(found.centre[:, 2], RIG.centres[:, 2], atol=0.03)  # feet are taken for round soles
    between = [np.linalg.norm(each[:, None] - each[None], axis=-1) for each in (found.centre, RIG.centres)]
    np.testing.assert_allclose(*between, rtol=0.01)


def test_heads_and_feet_weigh_alike_in_the_planes_tilt_and_outliers_little() -> None:
    """The heads' plane leans one way and the feet's the other; of the heads there are many more, some of them wrong."""
    x, y = (each.ravel() for each in np.meshgrid(np.linspace(-1, 1, 20), np.linspace(-1, 1, 20)))
    lean, few = 0.004, slice(0, 400, 8)
    heads = np.stack([x, y, 1.7 + lean * x], axis=1)
    feet = np.stack([x[few], y[few], -lean * x[few]], axis=1)
    heads[::9, 2] += 0.3
    elsewhere = np.array([4.0, -3.0, -3.0])
    turn_, floor, top = _fit_two_planes(heads + elsewhere, feet + elsewhere, np.array([0.0, 0.0, 1.7]))
    np.testing.assert_allclose(turn_, np.eye(3), atol=0.0006)
    np.testing.assert_allclose([floor, top], [-3.0, -1.3], atol=0.005)


def test_across_a_straight_walk_the_persons_axis_decides() -> None:
    along = np.linspace(-2, 2, 40)
    feet = np.stack([along, 0 * along, 0 * along], axis=1)
    upright = np.array([0.0, 0.1, 1.7])
    found, floor, top = _fit_two_planes(feet + upright, feet, upright)
    np.testing.assert_allclose(found @ upright, [0.0, 0.0, np.linalg.norm(upright)], atol=1e-6)
    assert top - floor == pytest.approx(np.linalg.norm(upright))


def test_too_few_whole_frames_are_told():
    person = person_before(RIG, polytopes(way())).without(np.arange(FEWEST_FRAMES - 1, 40))
    with pytest.raises(UnsolvableError, match=r"11 of 40 frames show the whole person.* at least 12 are needed"):
        standing_view("a", person.head[0], person.foot[0], RIG.K[0], STATURE)


@pytest.mark.parametrize(("tilt", "accepted"), [(59.5, True), (60.5, False)])
def test_a_view_may_look_sixty_degrees_down(tilt: float, accepted: bool) -> None:
    K, feet = np.array([[200.0, 0, 320], [0, 200, 240], [0, 0, 1]]), 0.6 * way()
    down = np.radians(tilt)
    R = np.array([[1, 0, 0], [0, -np.sin(down), -np.cos(down)], [0, np.cos(down), -np.sin(down)]])
    there = feet - [0.0, -4.0 / np.tan(down), 4.0]
    foot, head = ((at[:, :2] / at[:, 2:]) for at in ((there + up) @ R.T @ K.T for up in ([0, 0, 0], [0, 0, STATURE])))
    if accepted:
        assert standing_view("a", head, foot, K, STATURE).height == pytest.approx(4.0, abs=1e-4)
    else:
        with pytest.raises(UnsolvableError, match="less than 60 degrees down"):
            standing_view("a", head, foot, K, STATURE)


def test_heads_that_a_trial_puts_beside_the_image_err_by_a_bounded_number_of_pixels() -> None:
    """A foot's ray near the horizon would put the head anywhere."""
    K, head = np.diag([600.0, 600.0, 1.0]), np.array([[0.0, 0.0]])
    for side in (1.0, -1.0):
        errors = _head_errors(np.array([1.2, 0.0, 2.0]), K, head, np.array([[side * 500.0, -400.0, 1.0]]), STATURE)
        np.testing.assert_array_equal(np.abs(errors), 1e4)
        assert errors[0] == side * 1e4


def test_who_stands_still_is_told():
    person = person_before(RIG, polytopes(0.1 * way()))
    with pytest.raises(UnsolvableError, match="camera 'a': the person hardly moves"):
        standing_view("a", person.head[0], person.foot[0], RIG.K[0], STATURE)


def test_a_camera_that_looks_down_too_steeply_is_told():
    """By 70 degrees, below which a person is no stick: what explains it exactly is refused all the same."""
    high = placed_camera(10.0, 1.2, 3.6, 0.3, 0.0, 250.0, (0.0, 0.0), SIZE)
    K, R, t = (np.array(each)[None] for each in high)
    camera = CameraRig(("a",), K, R, t, np.array([SIZE]), np.zeros((1, 5)), "+z")
    assert np.degrees(np.arcsin(-R[0, 2, 2])) > 65
    feet = 0.6 * way()
    head, foot = project(camera, feet + STATURE * np.eye(3)[2])[0], project(camera, feet)[0]
    with pytest.raises(UnsolvableError, match="less than 60 degrees down"):
        standing_view("a", head, foot, K[0], STATURE)
