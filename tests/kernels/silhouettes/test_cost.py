import numpy as np
import pytest
import reference
import warp as wp
from poisoned import poisoned

from mmocap_warp.kernels.block import batch_of
from mmocap_warp.kernels.silhouettes.cost import IOU, PAPER, XOR, cost_of_counts
from mmocap_warp.kernels.views.projection import Views

FLOAT32 = 1e-6
TWIN = {PAPER: reference.paper_cost, XOR: reference.xor_cost, IOU: reference.iou_cost}
SIZES = ((40, 30), (25, 17), (64, 8))


def blobs(rng, filled=0.4):
    """One random picture a camera (height, width)."""
    return [rng.random((height, width)) < filled for width, height in SIZES]


def views_of(sizes, foreground, device):
    """What a cost reads of views."""
    views = Views()
    views.size = wp.array(sizes, dtype=wp.vec2i, device=device)
    views.foreground = wp.array(foreground, dtype=wp.int32, device=device)
    return views


def cost_of(kind, models, masks, device, pose=None, prior=None):
    """Costs (candidate,) of the kernel for pictures of models, one list of them a candidate."""
    count = [[(m.sum(), (m & f).sum()) for m, f in zip(views, masks, strict=True)] for views in models]
    cost = poisoned(len(models), wp.float32, device)
    cost_of_counts(
        kind,
        views_of(SIZES, [int(mask.sum()) for mask in masks], device),
        wp.array(np.array(count), dtype=wp.vec2i, device=device),
        wp.array(np.zeros((len(models), 4)) if pose is None else pose, dtype=wp.float32, device=device),
        wp.array(np.zeros(4) if prior is None else prior, dtype=wp.float32, device=device),
        batch_of(0, len(models), len(models), device),
        cost,
    )
    return cost.numpy()


@pytest.mark.parametrize("kind", TWIN)
def test_costs_are_the_twins(device, kind):
    rng = np.random.default_rng(0)
    masks, models = blobs(rng), [blobs(rng, filled) for filled in (0.1, 0.4, 0.9)]
    models += [masks, [~mask for mask in masks]]
    expected = [TWIN[kind](views, masks) for views in models]
    np.testing.assert_allclose(cost_of(kind, models, masks, device), expected, rtol=0, atol=FLOAT32)


@pytest.mark.parametrize("kind", TWIN)
def test_a_perfect_model_of_any_size_costs_exactly_nothing(device, kind):
    """20,000 views of 1 to 20,000 pixels: not one may be a rounding off, to either side."""
    pixels = np.arange(1, 20_001)
    cost = poisoned(1, wp.float32, device)
    cost_of_counts(
        kind,
        views_of(np.full((20_000, 2), 200), pixels, device),
        wp.array(np.stack([pixels, pixels], axis=1)[None], dtype=wp.vec2i, device=device),
        wp.zeros((1, 4), dtype=wp.float32, device=device),
        wp.zeros(4, dtype=wp.float32, device=device),
        batch_of(0, 1, 1, device),
        cost,
    )
    assert cost.numpy()[0] == 0.0


@pytest.mark.parametrize(("kind", "worst"), [(PAPER, 1.0), (IOU, 1.0), (XOR, None)])
def test_a_model_that_is_not_seen_costs_the_most(device, kind, worst):
    masks = blobs(np.random.default_rng(2))
    nothing = [np.zeros_like(mask) for mask in masks]
    expected = worst if worst is not None else reference.xor_cost(nothing, masks)
    assert cost_of(kind, [nothing], masks, device)[0] == pytest.approx(expected, abs=FLOAT32)


@pytest.mark.parametrize("kind", TWIN)
def test_a_view_without_foreground_is_left_out(device, kind):
    rng = np.random.default_rng(3)
    masks, models = blobs(rng), [blobs(rng)]
    masks[1][:] = False
    expected = TWIN[kind](models[0], masks)
    assert cost_of(kind, models, masks, device)[0] == pytest.approx(expected, abs=FLOAT32)


@pytest.mark.parametrize("kind", TWIN)
def test_without_any_view_the_cost_is_infinite(device, kind):
    masks = [np.zeros_like(mask) for mask in blobs(np.random.default_rng(4))]
    models = [blobs(np.random.default_rng(5)), masks]
    assert cost_of(kind, models, masks, device, np.ones((2, 4)), np.ones(4)).tolist() == [np.inf, np.inf]


def test_the_prior_pulls_to_zero(device):
    rng = np.random.default_rng(6)
    masks, models = blobs(rng), [blobs(rng) for _ in range(3)]
    pose, prior = rng.normal(0, 1, (3, 4)), np.array([0.0, 0.3, 0.0, 0.002])
    expected = [reference.paper_cost(views, masks) for views in models] + pose**2 @ prior
    np.testing.assert_allclose(cost_of(PAPER, models, masks, device, pose, prior), expected, rtol=0, atol=FLOAT32)
