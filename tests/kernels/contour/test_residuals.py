"""Residuals are how far a mask's contour lies from the outline, along its normal outward."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from contours import MATCHING, Contours, poisoned_outline, poisoned_residuals
from random_scenes import perfect_masks
from synthetic import ring_rig, synthetic_body, synthetic_poses, synthetic_subject

from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.contour.frame.fields import DistanceFields
from mmocap_warp.kernels.block import batch_of
from mmocap_warp.kernels.contour.outline import BANDS
from mmocap_warp.kernels.contour.residuals import Matching, find_residuals
from mmocap_warp.kernels.structs import filled
from mmocap_warp.kernels.views.projection import Views
from mmocap_warp.masks.observation import Observation, make_views

SIZE = (320, 240)
SCALE = 160.0  # px of a metre, where planted outlines are
CENTRE = (150.3, 120.2)  # where no pixel is
EXACT = 0.02  # [px]
RECOVERED = 0.1  # [px]


def flat_rig(cameras: int = 1) -> CameraRig:
    """Cameras that see what is a metre away at so many pixels a metre."""
    K = np.tile(np.diag([SCALE, SCALE, 1.0]), (cameras, 1, 1))
    names = tuple(f"flat{k}" for k in range(cameras))
    eye = np.tile(np.eye(3), (cameras, 1, 1))
    return CameraRig(names, K, eye, np.zeros((cameras, 3)), np.tile(SIZE, (cameras, 1)), np.zeros((cameras, 5)), "-y")


def disc(radius: float, centre: tuple[float, float] = CENTRE) -> np.ndarray:
    """The mask of a disc."""
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    return (x - centre[0]) ** 2 + (y - centre[1]) ** 2 < radius**2


def block(left: int, top: int, right: int, bottom: int) -> np.ndarray:
    """The mask of a rectangle of whole pixels."""
    mask = np.zeros(SIZE[::-1], bool)
    mask[top:bottom, left:right] = True
    return mask


def circle(radius: float, n: int = 90, centre: tuple[float, float] = CENTRE) -> np.ndarray:
    """A polygon around a circle of the same area, its inside on the left as one sees it."""
    angle = -2 * np.pi * (np.arange(n) + 0.3) / n
    outer = radius / np.sqrt(np.sin(2 * np.pi / n) * n / (2 * np.pi))
    return np.array(centre) + outer * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def rectangle(left: float, top: float, right: float, bottom: float, pieces: int = 9) -> np.ndarray:
    """A polygon around a rectangle, its inside on the left."""
    corners = np.array([(left, top), (left, bottom), (right, bottom), (right, top)])
    share = np.arange(pieces)[:, None] / pieces
    return np.concatenate([a + share * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)])


class Planted:
    """Residuals of polygons, one a candidate, a metre from the camera, against masks, one a frame."""

    def __init__(
        self, polygons: list[np.ndarray], masks: list[np.ndarray], device: str, frames=None, hidden=None, **matching
    ):
        n, size = len(polygons), max(map(len, polygons))
        rig = flat_rig()
        self.outline = poisoned_outline(n, 1, size, (size, 1, size), device, bands=1.0)
        self.outline.band.assign(np.tile(np.arange(BANDS + 1)[::-1], (n, 1, 1)).astype(np.int32))  # not sorted
        image, ends, line = (
            np.full((n, 1, size, 3), np.nan),
            np.zeros((n, 1, size, 2), int),
            np.full((n, 4, size), np.nan),
        )
        for c, polygon in enumerate(polygons):
            m = len(polygon)
            following = np.roll(polygon, -1, axis=0)
            image[c, 0, :m, :2], image[c, 0, :m, 2] = polygon, 1.0
            ends[c, 0, :m] = np.stack([np.arange(m), (np.arange(m) + 1) % m], axis=1)
            rise = following[:, 1] - polygon[:, 1]
            slope = np.divide(following[:, 0] - polygon[:, 0], rise, out=np.zeros(m), where=rise != 0)
            line[c, :, :m] = polygon[:, 0], polygon[:, 1], following[:, 1], slope
        self.outline.image.assign(image.astype(np.float32))
        self.outline.ends.assign(ends.astype(np.int32))
        self.outline.line.assign(line.astype(np.float32).ravel())
        self.outline.count.assign(np.array([[len(polygon)] for polygon in polygons], np.int32))
        self.residuals = poisoned_residuals(n, 1, size, device)
        fields = DistanceFields(rig, len(masks), device)
        for place, mask in enumerate(masks):
            in_front = None if hidden is None or hidden[place] is None else [hidden[place]]
            fields.observe([Observation.from_masks([mask], None, in_front)], place)
        judged = wp.array(np.array(frames if frames is not None else np.zeros(n)), dtype=wp.int32, device=device)
        views: Views = make_views(rig, device)
        settings = filled(Matching, **(MATCHING | matching))
        batch = batch_of(0, n, n, device)
        find_residuals(self.outline, fields.judging(judged), views, settings, batch, self.residuals)
        self.counts = [len(polygon) for polygon in polygons]

    def residual(self, c: int = 0) -> np.ndarray:
        return self.residuals.weighted.numpy()[c, 0, : self.counts[c], 0]

    def weight(self, c: int = 0) -> np.ndarray:
        return self.residuals.weighted.numpy()[c, 0, : self.counts[c], 1]

    def tally(self, c: int = 0) -> np.ndarray:
        return self.residuals.tally.numpy()[c, 0, : self.counts[c]]


def test_many_edges_are_matched_as_few_are(device):
    """A CPU looks at 512 of them at a time."""
    many = Planted([circle(40.0, n=1300)], [disc(43.3)], device, huber=1.0)
    assert (many.weight() > 0).all()
    assert many.residual().mean() == pytest.approx(3.3, abs=RECOVERED)


@pytest.mark.parametrize("offset", [-9.0, -2.5, -0.4, 0.0, 0.4, 3.3, 8.0])
def test_a_circle_is_as_far_away_as_it_was_planted(device, offset):
    planted = Planted([circle(40.0)], [disc(40.0 + offset)], device, huber=1.0)
    assert (planted.weight() > 0).all()
    assert planted.residual().mean() == pytest.approx(offset, abs=RECOVERED)
    assert np.abs(planted.residual() - offset).max() < 0.6  # pixels have corners


@pytest.mark.parametrize("offset", [-6, -1, 0, 2, 7])
def test_a_rectangle_of_pixels_is_exactly_where_its_borders_are(device, offset):
    """A border lies half a pixel beyond the centres of a mask's outermost pixels."""
    polygon = rectangle(99.5, 79.5, 179.5, 139.5)
    mask = block(100 - offset, 80 - offset, 180 + offset, 140 + offset)
    residual = Planted([polygon], [mask], device, huber=1.0).residual()
    inner = np.arange(len(polygon)) % 9 != 8  # of a side; corners of pixels are rounded off
    inner &= np.arange(len(polygon)) % 9 != 0
    np.testing.assert_allclose(residual[inner], offset, atol=EXACT)


def test_parts_of_a_pixel_are_found(device):
    """Outlines that lie a tenth of a pixel apart have residuals that do."""
    mask = block(100, 80, 180, 140)
    polygons = [rectangle(99.5 - d, 79.5 - d, 179.5 + d, 139.5 + d) for d in np.arange(-10, 11) / 10]
    planted = Planted(polygons, [mask], device, huber=1.0)
    for c, d in enumerate(np.arange(-10, 11) / 10):
        assert planted.residual(c)[4::9] == pytest.approx(-d, abs=EXACT)


def test_normals_point_outward(device):
    planted = Planted([circle(40.0)], [disc(42.0)], device)
    middle = circle(40.0) + (np.roll(circle(40.0), -1, axis=0) - circle(40.0)) / 2 - CENTRE
    outward = middle / np.linalg.norm(middle, axis=1)[:, None]
    np.testing.assert_allclose(planted.residuals.normal.numpy()[0, 0, : len(middle)], outward, atol=1e-5)


def test_weights_are_hubers_and_costs_are_in_millimetres_at_the_body(device):
    reach, huber, sigma, apart = 0.09, 0.012, 0.02, 4.0
    offsets = (0.5, 1.5, 3.0, 9.0)  # px; huber's corner is at 1.92
    polygon = rectangle(99.5, 79.5, 179.5, 139.5)
    for offset in offsets:
        mask = block(*(np.array([100, 80, 180, 140]) + np.round([-offset, -offset, offset, offset]).astype(int)))
        d = float(np.round(offset))
        planted = Planted([polygon], [mask], device, reach=reach, huber=huber, sigma=sigma, apart=apart)
        length = np.hypot(*(np.roll(polygon, -1, axis=0) - polygon).T)
        middle = slice(4, None, 9)
        share = length[middle] / (apart * (sigma * SCALE) ** 2)
        corner = huber * SCALE
        weight = share * min(1.0, corner / max(d, 1e-9))
        cost = share * (d**2 if d <= corner else corner * (2 * d - corner))
        np.testing.assert_allclose(planted.weight()[middle], weight, rtol=0.03)
        tally = planted.tally()[middle]
        np.testing.assert_allclose(tally[:, 0], cost, rtol=0.05, atol=1e-4)
        np.testing.assert_allclose(tally[:, 1], length[middle], rtol=1e-5)
        np.testing.assert_allclose(tally[:, 2], length[middle], rtol=1e-5)
        assert (tally[:, 3] == 0).all()  # no outline lies deep outside of its mask


def test_a_contour_out_of_reach_costs_what_the_farthest_would(device):
    reach = 0.05  # 8 px
    near, far = (
        Planted([circle(40.0)], [disc(radius)], device, reach=reach, huber=0.01) for radius in (40.0 + 7.8, 40.0 + 20.0)
    )
    assert (near.weight() > 0).mean() > 0.8
    assert (far.weight() == 0).all()
    assert (far.residual() == 0).all()
    tally = far.tally()
    length = np.hypot(*(np.roll(circle(40.0), -1, axis=0) - circle(40.0)).T)
    corner = 0.01 * SCALE
    farthest = length / (4.0 * (0.012 * SCALE) ** 2) * corner * (2 * reach * SCALE - corner)
    np.testing.assert_allclose(tally[:, 0], farthest, rtol=1e-4)
    np.testing.assert_allclose(tally[:, 1], length, rtol=1e-5)
    assert (tally[:, 2:] == 0).all()


def test_outline_deep_outside_of_the_mask_is_exposed(device):
    length = np.hypot(*(np.roll(circle(40.0), -1, axis=0) - circle(40.0)).T)
    for radius, exposed in ((40.0, 0.0), (36.0, 0.0), (30.0, 1.0), (10.0, 1.0), (60.0, 0.0)):
        planted = Planted([circle(40.0)], [disc(radius)], device, reach=0.01, deep=7.0 / SCALE)
        np.testing.assert_allclose(planted.tally()[:, 3], exposed * length / SCALE, rtol=1e-5)


@pytest.mark.parametrize("deep", [3.0, 7.0, 9.0, 12.0, 16.0, 25.0])
def test_exposed_is_what_is_farther_than_a_length_that_fields_do_not_reach(device, deep):
    """Within a pixel or two of it, wherever around the outline the mask is."""
    for angle in np.linspace(0, 2 * np.pi, 7):
        beside = CENTRE + 100.0 * np.array([np.cos(angle), np.sin(angle)])
        near, far = (
            Planted([circle(6.0, n=12)], [disc(94.0 - gap, tuple(beside))], device, reach=0.01, deep=deep / SCALE)
            for gap in (deep - 1.5, deep + 1.5)
        )
        length = np.hypot(*(np.roll(circle(6.0, n=12), -1, axis=0) - circle(6.0, n=12)).T)
        middle = circle(6.0, n=12) + (np.roll(circle(6.0, n=12), -1, axis=0) - circle(6.0, n=12)) / 2
        for planted, gap in ((near, deep - 1.5), (far, deep + 1.5)):
            away = np.linalg.norm(middle - beside, axis=1) - (94.0 - gap)
            exposed = planted.tally()[:, 3] > 0
            np.testing.assert_allclose(planted.tally()[exposed, 3], length[exposed] / SCALE, rtol=1e-5)
            sure = np.abs(away - deep) > 1.2
            assert (exposed == (away > deep))[sure].all()


def test_the_nearer_one_of_two_contours_counts(device):
    """A ring: its inner contour is no end of the mask on the way out, and its outer one is."""
    ring = disc(60.0) & ~disc(48.0)
    residual = Planted([circle(52.0)], [ring], device, huber=1.0).residual()
    assert residual.mean() == pytest.approx(8.0, abs=RECOVERED)
    two = disc(40.0) | (disc(60.0) & ~disc(50.0))
    residual = Planted([circle(44.0), circle(56.5)], [two], device, huber=1.0)
    assert residual.residual(0).mean() == pytest.approx(-4.0, abs=RECOVERED)
    assert residual.residual(1).mean() == pytest.approx(3.5, abs=RECOVERED)


def test_outline_at_an_images_border_says_nothing(device):
    polygon = rectangle(-20.0, 60.0, 60.0, 140.0)
    planted = Planted([polygon], [block(0, 60, 60, 140)], device)
    middle = (polygon + np.roll(polygon, -1, axis=0)) / 2
    outside = middle[:, 0] <= 1.0
    assert outside.sum() > 9
    assert (planted.tally()[outside] == 0).all()
    assert (planted.weight()[outside] == 0).all()
    assert (planted.weight()[~outside] > 0).all()
    assert np.abs(planted.residual()[~outside]).max() < 1.0


@pytest.mark.parametrize("side", range(4))
@pytest.mark.parametrize(("away", "counts"), [(0.9, False), (1.1, True)])
def test_the_outermost_pixel_on_each_side_says_nothing(device, side, away, counts):
    """Outline up to the centres of the second pixels from an image's edge is a rim, in which a mask may be cut."""
    last = np.array(SIZE, float) - 1
    low, high = np.array([40.0, 40.0]), last - 40.0
    axis = side % 2
    end = away if side < 2 else last[axis] - away
    (low if side < 2 else high)[axis] = end
    polygon = rectangle(*low, *high)
    mask = block(*(low + 0.5).astype(int), *(high + 0.5).astype(int))
    middle = (polygon + np.roll(polygon, -1, axis=0)) / 2
    there = np.abs(middle[:, axis] - end) < 1e-6
    assert there.sum() == 9
    planted = Planted([polygon], [mask], device)
    assert ((planted.tally()[there, 1] > 0) == counts).all()
    assert (planted.tally()[~there, 1] > 0).all()


@pytest.mark.parametrize(("right", "residual"), [(97.2, 7.3), (96.8, -7.3)])
def test_of_two_ends_between_the_same_pixels_the_nearer_one_counts(device, right, residual):
    """An outline in a stripe, with another one inward of it: 7.3 px away in one way, and 7.7 in the other."""
    mask = block(40, 60, 90, 160) | block(95, 60, 105, 160)
    polygon = rectangle(50.0, 79.5, right, 139.5)
    middle = (polygon + np.roll(polygon, -1, axis=0)) / 2
    planted = Planted([polygon], [mask], device, huber=1.0)
    there = np.abs(middle[:, 0] - right) < 1e-6
    np.testing.assert_allclose(planted.residual()[there], residual, atol=0.1)


def test_a_mask_cut_by_the_border_does_not_end_there(device):
    """What is seen of a body goes on beyond the image."""
    cut = rectangle(2.0, 60.0, 60.0, 140.0)
    planted = Planted([cut], [block(0, 40, 60, 160)], device, reach=0.05)
    assert (planted.weight()[:9] == 0).all()


def test_a_view_without_foreground_says_nothing(device):
    planted = Planted([circle(40.0)] * 2, [disc(40.0), np.zeros(SIZE[::-1], bool)], device, frames=[1, 0])
    assert (planted.tally(0) == 0).all()
    assert (planted.weight(0) == 0).all()
    assert (planted.weight(1) > 0).all()


def test_each_candidate_is_judged_against_its_own_frame(device):
    radii = (36.0, 44.0, 40.0)
    planted = Planted([circle(40.0)] * 4, [disc(r) for r in radii], device, frames=[2, 0, 1, 0], huber=1.0)
    found = [planted.residual(c).mean() for c in range(4)]
    np.testing.assert_allclose(found, (0.0, -4.0, 4.0, -4.0), atol=RECOVERED)


def test_a_body_against_its_own_picture_is_nowhere_off(device):
    """And it is outline wherever the picture ends: the matched length is the picture's circumference."""
    subject, rig = synthetic_subject(), ring_rig(3)
    pose = synthetic_poses(5)[3]
    masks = perfect_masks(subject, rig, pose)
    case = Contours(synthetic_body(), rig, pose[None], subject.root_base[None], device).matched(masks)
    for k, mask in enumerate(masks):
        count = case.outline.count.numpy()[0, k]
        residual, weight = case.residuals.weighted.numpy()[0, k, :count].T
        tally = case.residuals.tally.numpy()[0, k, :count].sum(axis=0)
        assert np.average(residual, weights=weight) == pytest.approx(0.0, abs=0.15)
        assert np.median(np.abs(residual[weight > 0])) < 0.3
        assert tally[2] > 0.97 * tally[1]
        outside = np.pad(~mask, 1)
        sides = sum((np.roll(outside, s, a)[1:-1, 1:-1] & mask).sum() for s in (1, -1) for a in (0, 1))
        assert 0.7 < tally[1] / sides < 1.05  # stairs of pixels are longer than what they stand for


def behind_twin(middle: np.ndarray, normal: np.ndarray, hidden: np.ndarray, way: float) -> bool:
    """Whether a pixel of what is in front lies on the way outward, with a gap of two pixels, in float64."""
    for step in np.arange(0.0, way + 2.0 + 1e-9):
        column, row = np.rint(middle + step * normal).astype(int)
        if 0 <= column < SIZE[0] and 0 <= row < SIZE[1] and hidden[row, column]:
            return True
    return False


@pytest.mark.parametrize("offset", [-6.0, -1.3, 0.6, 5.0])
def test_an_outline_behind_something_counts_only_beyond_it(device, offset):
    """A disc whose right side is behind a block: there an outline is held by where the block ends, from outside."""
    whole, hidden = disc(40.0), block(170, 40, 195, 200)
    polygon = circle(40.0 - offset)
    planted = Planted([polygon], [whole & ~hidden], device, hidden=[hidden], huber=1.0, reach=0.1)
    free = Planted([polygon], [whole | hidden], device, huber=1.0, reach=0.1)
    following = np.roll(polygon, -1, axis=0)
    middle, along = (polygon + following) / 2, following - polygon
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.hypot(*along.T)[:, None]
    reach = 0.1 * SCALE
    end = np.where(free.weight() > 0, free.residual(), reach)
    behind = [e >= 0 and behind_twin(m, n, hidden, e) for m, n, e in zip(middle, normal, end, strict=True)]
    assert 5 < np.sum(behind) < 60
    assert (planted.weight()[behind] == 0).all()
    assert (planted.tally()[behind] == 0).all()
    counts = ~np.array(behind)
    np.testing.assert_array_equal(planted.residual()[counts], free.residual()[counts])
    np.testing.assert_array_equal(planted.tally()[counts], free.tally()[counts])
    away = middle[:, 0] < 160
    assert planted.residual()[away].mean() == pytest.approx(offset, abs=0.15)


def test_an_outline_beyond_both_is_pulled_back_to_what_is_in_front(device):
    hidden = block(150, 60, 180, 160)
    polygon = rectangle(100.0, 79.5, 186.5, 139.5)
    planted = Planted([polygon], [block(100, 80, 150, 140)], device, hidden=[hidden], huber=1.0, reach=0.1)
    right = np.abs((polygon + np.roll(polygon, -1, axis=0))[:, 0] / 2 - 186.5) < 1e-6
    np.testing.assert_allclose(planted.residual()[right], 179.5 - 186.5, atol=EXACT)


def test_what_is_in_front_in_one_frame_is_not_in_another(device):
    hidden = block(170, 40, 195, 200)
    masks = [disc(40.0), disc(40.0) & ~hidden, disc(40.0)]
    alone = Planted([circle(38.0)] * 3, masks[:1] * 3, device, frames=[0, 1, 2])
    planted = Planted([circle(38.0)] * 3, masks, device, frames=[0, 1, 2], hidden=[None, hidden, None])
    for c in (0, 2):
        np.testing.assert_array_equal(planted.tally(c), alone.tally(c))
        np.testing.assert_array_equal(planted.residual(c), alone.residual(c))
    assert (planted.weight(1) == 0).sum() > 5
