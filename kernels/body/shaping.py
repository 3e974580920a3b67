"""Shape sliders: a rest body and a heading for every candidate, read from its coordinates."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _shape(
    coordinate: wp.array2d[wp.float32],  # (candidate, coordinate)
    first: int,
    base: wp.array[wp.vec3],  # (point,)
    increase: wp.array2d[wp.vec3],  # (slider, point)
    decrease: wp.array2d[wp.vec3],  # (slider, point)
    # out
    shaped: wp.array2d[wp.vec3],  # (candidate, point)
):
    c, v = wp.tid()
    point = base[v]
    sliders = increase.shape[0]
    for s in range(sliders):
        w = coordinate[c, first + s]
        if w > 0.0:
            point += w * increase[s, v]
        elif w < 0.0:
            point -= w * decrease[s, v]
    shaped[c, v] = wp.exp(coordinate[c, first + sliders]) * point


def shape(coordinate, first, base, increase, decrease, shaped):
    """Shape every candidate: ``scale * (base + sum_s max(w_s, 0) increase[s] + max(-w_s, 0) decrease[s])`` [m].

    From column ``first`` on, ``coordinate`` holds the sliders ``w`` and then the logarithm of the scale.
    """
    wp.launch(
        _shape,
        dim=shaped.shape,
        inputs=[coordinate, first, base, increase, decrease],
        outputs=[shaped],
        device=shaped.device,
    )


@wp.kernel
def _turn(
    coordinate: wp.array2d[wp.float32],  # (candidate, coordinate)
    column: int,
    upright: wp.mat33,
    # out
    root_base: wp.array[wp.mat33],  # (candidate,)
):
    c = wp.tid()
    cos, sin = wp.cos(coordinate[c, column]), wp.sin(coordinate[c, column])
    root_base[c] = upright * wp.mat33(cos, 0.0, sin, 0.0, 1.0, 0.0, -sin, 0.0, cos)


def turn(coordinate, column, upright, root_base):
    """Head every candidate: ``root_base[c] = upright @ Ry(coordinate[c, column])``, about the body's own up axis."""
    wp.launch(
        _turn,
        dim=root_base.shape[0],
        inputs=[coordinate, column, upright],
        outputs=[root_base],
        device=root_base.device,
    )
