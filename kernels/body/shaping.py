"""Shape sliders: a rest body and a heading for every candidate, read from its coordinates."""

import warp as wp

from mmocap_warp.kernels.block import Batch

wp.set_module_options({"enable_backward": False})


@wp.struct
class Sliders:
    """Points, and how far they go at a slider's ends; from column ``first`` on, coordinates hold sliders and scale."""

    first: int
    base: wp.array[wp.vec3]  # (point,) [m]
    increase: wp.array2d[wp.vec3]  # (slider, point) [m]
    decrease: wp.array2d[wp.vec3]  # (slider, point) [m]


@wp.kernel
def _shape(
    sliders: Sliders,
    coordinate: wp.array2d[wp.float32],  # (candidate, coordinate)
    batch: Batch,
    # out
    shaped: wp.array2d[wp.vec3],  # (candidate, point)
) -> None:
    own, v = wp.tid()
    c = batch.first + own
    point = sliders.base[v]
    last = sliders.increase.shape[0]
    for s in range(last):
        w = coordinate[c, sliders.first + s]
        if w > 0.0:
            point += w * sliders.increase[s, v]
        elif w < 0.0:
            point -= w * sliders.decrease[s, v]
    shaped[c, v] = wp.exp(coordinate[c, sliders.first + last]) * point


def shape(sliders: Sliders, coordinate: wp.array[wp.float32], batch: Batch, shaped: wp.array[wp.vec3]) -> None:
    """Shape candidates: ``scale * (base + sum_s max(w_s, 0) increase[s] + max(-w_s, 0) decrease[s])`` [m].

    ``coordinate`` (candidate, coordinate) holds the sliders ``w`` and then the logarithm of the scale; ``shaped`` is
    (candidate, point).
    """
    wp.launch(_shape, (batch.size, shaped.shape[1]), [sliders, coordinate, batch], [shaped], device=shaped.device)


@wp.kernel
def _turn(
    coordinate: wp.array2d[wp.float32],  # (candidate, coordinate)
    column: int,
    upright: wp.mat33,
    batch: Batch,
    # out
    root_base: wp.array[wp.mat33],  # (candidate,)
) -> None:
    c = batch.first + wp.tid()
    cos, sin = wp.cos(coordinate[c, column]), wp.sin(coordinate[c, column])
    root_base[c] = upright * wp.mat33(cos, 0.0, sin, 0.0, 1.0, 0.0, -sin, 0.0, cos)


def turn(
    coordinate: wp.array[wp.float32], column: int, upright: wp.mat33, batch: Batch, root_base: wp.array[wp.mat33]
) -> None:
    """Head candidates: ``root_base[c] = upright @ Ry(coordinate[c, column])``, about the body's own up axis."""
    wp.launch(_turn, batch.size, [coordinate, column, upright, batch], [root_base], device=root_base.device)
