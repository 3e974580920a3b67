"""Pinhole projection onto a fixed sub-pixel grid, so that every edge test downstream is exact."""

import warp as wp

wp.set_module_options({"enable_backward": False})

SUBPIXEL = 16
"""Cells of the grid per pixel."""

NEAR = 0.05
"""The near plane [m]: what is closer to the camera's plane than this, or behind it, is cut off."""

BEHIND = -(2**30)
"""Image coordinate of a point before the near plane."""

_LIMIT = float(2**20)


@wp.struct
class Pinhole:
    """A camera: where it stands and its lens."""

    rotation: wp.mat33
    translation: wp.vec3  # [m]
    lens: wp.vec4  # fx fy cx cy [px]


@wp.struct
class Views:
    """Pinhole cameras and what they see of the person."""

    rotation: wp.array[wp.mat33]  # (camera,)
    translation: wp.array[wp.vec3]  # (camera,) [m]
    lens: wp.array[wp.vec4]  # (camera,) fx fy cx cy [px]
    size: wp.array[wp.vec2i]  # (camera,) width height [px]
    observed: wp.array3d[wp.uint32]  # (camera, row, word) masks F
    foreground: wp.array[wp.int32]  # (camera,) |F|


@wp.func
def pinhole(views: Views, k: int) -> Pinhole:
    """One of the cameras."""
    camera = Pinhole()
    camera.rotation = views.rotation[k]
    camera.translation = views.translation[k]
    camera.lens = views.lens[k]
    return camera


@wp.func
def into_camera(point: wp.vec3, camera: Pinhole) -> wp.vec3:
    """Camera coordinates of a point in the world: x right, y down, z forward [m]."""
    return camera.rotation * point + camera.translation


@wp.func
def onto_grid(p: wp.vec3, lens: wp.vec4) -> wp.vec2i:
    """The cell ``floor(SUBPIXEL * (x, y))`` that a point in camera coordinates projects into.

    The point is then taken to lie **in the middle of its cell**. Pixel centres lie on corners of cells, so that no
    vertex ever shares a row or a column with one.
    """
    x = float(SUBPIXEL) * (lens[0] * p[0] / p[2] + lens[2])
    y = float(SUBPIXEL) * (lens[1] * p[1] / p[2] + lens[3])
    return wp.vec2i(int(wp.floor(wp.clamp(x, -_LIMIT, _LIMIT))), int(wp.floor(wp.clamp(y, -_LIMIT, _LIMIT))))


@wp.func
def project(point: wp.vec3, camera: Pinhole) -> wp.vec2i:
    """The cell of a point in the world, or ``BEHIND`` twice."""
    p = into_camera(point, camera)
    if p[2] < NEAR:
        return wp.vec2i(BEHIND, BEHIND)
    return onto_grid(p, camera.lens)


@wp.func
def is_behind(point: wp.vec2i) -> bool:
    """Whether a projected point lies before the near plane."""
    return point[0] == BEHIND
