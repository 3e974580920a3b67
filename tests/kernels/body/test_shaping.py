from dataclasses import replace

import numpy as np
import reference
import warp as wp
from poisoned import poisoned
from synthetic import synthetic_body, upright

from mmocap_warp.kernels.block import batch_of
from mmocap_warp.kernels.body.shaping import Sliders, shape, turn
from mmocap_warp.kernels.structs import filled

POSITION = 1e-5  # [m]
ROTATION = 1e-6


def body_with_a_pair():
    """The test body with a third target that is the other side of the first."""
    body = synthetic_body()
    shorter = -0.7 * body.shape_vertex[:1] + 0.01, -0.7 * body.shape_joint[:1]
    return replace(
        body,
        shape_names=(*body.shape_names, "height_decr"),
        shape_vertex=np.concatenate([body.shape_vertex, shorter[0]]),
        shape_joint=np.concatenate([body.shape_joint, shorter[1]]),
    )


def test_sliders_and_scale_are_the_shaped_body(device):
    """Sliders height (up and down) and weight (up only); the coordinates before and after them are not read."""
    body = body_with_a_pair()
    sliders = [(0.0, 0.0, 1.0), (0.6, 0.25, 1.1), (-0.8, 1.0, 0.7), (-0.3, 0.0, 1.6)]
    coordinates = np.full((len(sliders), 6), np.nan)
    coordinates[:, 2:5] = [(height, weight, np.log(scale)) for height, weight, scale in sliders]
    expected = [
        body.shaped({"height_incr": max(h, 0), "height_decr": max(-h, 0), "weight_incr": w}, s) for h, w, s in sliders
    ]
    for rest, targets, twins in (
        (body.skin.rest, body.shape_vertex, [twin.skin.rest for twin in expected]),
        (body.joint_rest, body.shape_joint, [twin.joint_rest for twin in expected]),
    ):
        increase, decrease = targets[:2], np.stack([targets[2], np.zeros_like(targets[2])])
        shaped = poisoned((len(sliders), len(rest)), wp.vec3, device)
        pairs = filled(
            Sliders,
            first=2,
            base=wp.array(rest, dtype=wp.vec3, device=device),
            increase=wp.array(increase, dtype=wp.vec3, device=device),
            decrease=wp.array(decrease, dtype=wp.vec3, device=device),
        )
        batch = batch_of(0, len(sliders), len(sliders), device)
        shape(pairs, wp.array(coordinates, dtype=wp.float32, device=device), batch, shaped)
        np.testing.assert_allclose(shaped.numpy(), np.stack(twins), rtol=0, atol=POSITION)


def test_headings_turn_about_the_bodys_own_up(device):
    headings = np.array([0.0, 0.5, -2.0, 3.0])
    coordinates = np.full((4, 3), np.nan)
    coordinates[:, 1] = headings
    root_base = poisoned(4, wp.mat33, device)
    base = wp.mat33(upright("-z").astype(np.float32))
    turn(wp.array(coordinates, dtype=wp.float32, device=device), 1, base, batch_of(0, 4, 4, device), root_base)
    expected = [upright("-z") @ reference.rotation(1, heading) for heading in headings]
    np.testing.assert_allclose(root_base.numpy(), expected, rtol=0, atol=ROTATION)
