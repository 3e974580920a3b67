"""Pinhole projection onto a fixed sub-pixel grid, so that every edge test downstream is exact."""

import warp as wp

wp.set_module_options({"enable_backward": False})

SUBPIXEL = 16
"""Grid steps per pixel. A sixteenth keeps the edge functions of triangles up to 2,000 px wide within 32 bits."""

NEAR = 0.05
"""Points closer than this to the camera's plane [m], or behind it, do not project."""

BEHIND = -(2**30)
"""Image coordinate of a point that does not project."""

_LIMIT = float(2**20)


@wp.kernel
def _project(
    posed: wp.array2d[wp.vec3],  # (candidate, vertex) [m]
    rotation: wp.array[wp.mat33],  # (camera,)
    translation: wp.array[wp.vec3],  # (camera,) [m]
    intrinsics: wp.array[wp.vec4],  # (camera,) fx fy cx cy [px]
    # out
    image: wp.array3d[wp.vec2i],  # (candidate, camera, vertex) [px / SUBPIXEL]
):
    c, k, v = wp.tid()
    p = rotation[k] * posed[c, v] + translation[k]
    if p[2] < NEAR:
        image[c, k, v] = wp.vec2i(BEHIND, BEHIND)
        return
    lens = intrinsics[k]
    x = float(SUBPIXEL) * (lens[0] * p[0] / p[2] + lens[2])
    y = float(SUBPIXEL) * (lens[1] * p[1] / p[2] + lens[3])
    image[c, k, v] = wp.vec2i(int(wp.rint(wp.clamp(x, -_LIMIT, _LIMIT))), int(wp.rint(wp.clamp(y, -_LIMIT, _LIMIT))))


def project(posed, rotation, translation, intrinsics, image):
    """Project: ``image = round(SUBPIXEL * (K (R posed + t))_xy)``, in sixteenths of a pixel; see ``BEHIND``."""
    wp.launch(
        _project,
        dim=(posed.shape[0], rotation.shape[0], posed.shape[1]),
        inputs=[posed, rotation, translation, intrinsics],
        outputs=[image],
        device=posed.device,
    )
