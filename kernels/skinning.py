"""Linear-blend skinning."""

import warp as wp

from mmocap_warp.kernels.kinematics import Affine

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _skin(
    rest: wp.array2d[wp.vec3],  # (body, vertex)
    joint: wp.array[wp.vec4i],  # (vertex,)
    weight: wp.array[wp.vec4],  # (vertex,)
    skin_matrix: wp.array2d[Affine],  # (candidate, joint)
    # out
    posed: wp.array2d[wp.vec3],  # (candidate, vertex)
):
    c, v = wp.tid()
    body = wp.min(c, rest.shape[0] - 1)
    point = rest[body, v]
    at = wp.vec4(point[0], point[1], point[2], 1.0)
    influence = joint[v]
    share = weight[v]
    blended = share[0] * (skin_matrix[c, influence[0]] * at)
    for i in range(1, 4):
        if share[i] > 0.0:
            blended += share[i] * (skin_matrix[c, influence[i]] * at)
    posed[c, v] = blended


def skin(rest, joint, weight, skin_matrix, posed):
    """Pose every candidate: ``posed[c, v] = sum_i weight[v, i] * skin_matrix[c, joint[v, i]] @ rest[v]`` [m].

    Weights are sorted, the largest first; ``body`` is one for all candidates, or one each.
    """
    wp.launch(_skin, dim=posed.shape, inputs=[rest, joint, weight, skin_matrix], outputs=[posed], device=posed.device)
