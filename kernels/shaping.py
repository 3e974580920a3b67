"""Shape targets: rest bodies from shape weights, one body per candidate."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _shape(
    base: wp.array[wp.vec3],  # (point,)
    target: wp.array2d[wp.vec3],  # (shape, point)
    weight: wp.array2d[wp.float32],  # (body, shape)
    scale: wp.array[wp.float32],  # (body,)
    # out
    shaped: wp.array2d[wp.vec3],  # (body, point)
):
    b, v = wp.tid()
    point = base[v]
    for s in range(target.shape[0]):
        w = weight[b, s]
        if w != 0.0:
            point += w * target[s, v]
    shaped[b, v] = scale[b] * point


def shape(base, target, weight, scale, shaped):
    """Shape every body: ``shaped[b, v] = scale[b] * (base[v] + sum_s weight[b, s] * target[s, v])`` [m]."""
    wp.launch(_shape, dim=shaped.shape, inputs=[base, target, weight, scale], outputs=[shaped], device=shaped.device)
