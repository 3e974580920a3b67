"""Silhouettes by one ray a pixel: slow and plain, the reference that faster renderers are compared with.

It shares nothing with them: no grid of sub-pixels, no facing triangles, no BVH in image space.
"""

import warp as wp

from mmocap_warp.kernels.views.projection import NEAR, Views

wp.set_module_options({"enable_backward": False})

_REACH = wp.constant(1.0e4)  # [m]


@wp.kernel
def _cast_pixels(
    mesh: wp.array[wp.uint64],  # (candidate,)
    views: Views,
    # out
    silhouette: wp.array4d[wp.uint32],  # (candidate, camera, row, word)
) -> None:
    c, k, row, word = wp.tid()
    lens = views.lens[k]
    size = views.size[k]
    into_world = wp.transpose(views.rotation[k])
    centre = -(into_world * views.translation[k])
    bits = wp.uint32(0)
    if row < size[1]:
        for i in range(wp.min(32, size[0] - word * 32)):
            x = (float(word * 32 + i) - lens[2]) / lens[0]
            y = (float(row) - lens[3]) / lens[1]
            ray = into_world * wp.vec3(x, y, 1.0)  # its parameter is the depth
            if wp.mesh_query_ray_anyhit(mesh[c], centre + NEAR * ray, ray, _REACH):
                bits = bits | (wp.uint32(1) << wp.uint32(i))
    silhouette[c, k, row, word] = bits


def cast_pixels(
    posed: wp.array[wp.vec3], triangle: wp.array[wp.vec3i], views: Views, silhouette: wp.array[wp.uint32]
) -> None:
    """Draw every candidate: bit ``x % 32`` of ``silhouette[c, k, y, x // 32]`` is set where pixel (x, y)'s ray hits.

    ``posed`` (candidate, vertex) vec3 [m] and ``triangle`` (triangle,) vec3i make a mesh a candidate, built here one
    after the other: Warp's meshes must not be made by several threads at a time.
    """
    corners = triangle.view(dtype=wp.int32).flatten()
    meshes = [wp.Mesh(points=posed[c].contiguous(), indices=corners) for c in range(posed.shape[0])]
    numbers = wp.array([mesh.id for mesh in meshes], dtype=wp.uint64, device=posed.device)
    wp.launch(
        _cast_pixels,
        dim=silhouette.shape,
        inputs=[numbers, views],
        outputs=[silhouette],
        device=posed.device,
    )
    wp.synchronize_device(posed.device)  # the meshes must outlive the launch
