"""Pinhole projection onto a fixed sub-pixel grid, so that every edge test downstream is exact; and the near plane.

Where the near plane cuts a body open, a ray may leave the body without having entered it: then the triangles that face
away count too. Such views are rare and pay for it; all others only ask whether a vertex is behind.
"""

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
    hidden: wp.array3d[wp.uint32]  # (camera, row, word) pixels that count nowhere; no cameras where all count


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


Quad = wp.types.matrix(shape=(4, 2), dtype=wp.int32)
"""Four image points in turn; a triangle's last two are the same."""


@wp.func
def corner(quad: Quad, i: int) -> wp.vec2i:
    """One of a quad's points."""
    return wp.vec2i(quad[i, 0], quad[i, 1])


@wp.func
def _quad(a: wp.vec2i, b: wp.vec2i, c: wp.vec2i, d: wp.vec2i) -> Quad:
    return Quad(a[0], a[1], b[0], b[1], c[0], c[1], d[0], d[1])


@wp.func
def _cut(seen: wp.vec3, behind: wp.vec3, lens: wp.vec4) -> wp.vec2i:
    """Where an edge meets the near plane; the same for both of its triangles, because it starts at the seen end."""
    share = (NEAR - seen[2]) / (behind[2] - seen[2])
    return onto_grid(
        wp.vec3(seen[0] + share * (behind[0] - seen[0]), seen[1] + share * (behind[1] - seen[1]), NEAR), lens
    )


@wp.func
def clip(v: wp.vec3i, points: wp.array[wp.vec2i], posed: wp.array[wp.vec3], camera: Pinhole) -> Quad:
    """What the near plane leaves of a triangle, given by its vertices' numbers: their image points, and ``posed`` [m].

    Where nothing is left, the points are ``BEHIND``.
    """
    a = points[v[0]]
    b = points[v[1]]
    c = points[v[2]]
    behind = int(is_behind(a)) + int(is_behind(b)) + int(is_behind(c))
    if behind == 0:
        return _quad(a, b, c, c)
    if behind == 3:
        gone = wp.vec2i(BEHIND, BEHIND)
        return _quad(gone, gone, gone, gone)
    x = into_camera(posed[v[0]], camera)
    y = into_camera(posed[v[1]], camera)
    z = into_camera(posed[v[2]], camera)
    lens = camera.lens
    if behind == 2:
        if not is_behind(a):
            end = _cut(x, z, lens)
            return _quad(a, _cut(x, y, lens), end, end)
        if not is_behind(b):
            end = _cut(y, x, lens)
            return _quad(b, _cut(y, z, lens), end, end)
        end = _cut(z, y, lens)
        return _quad(c, _cut(z, x, lens), end, end)
    if is_behind(a):
        return _quad(b, c, _cut(z, x, lens), _cut(y, x, lens))
    if is_behind(b):
        return _quad(c, a, _cut(x, y, lens), _cut(z, y, lens))
    return _quad(a, b, _cut(y, z, lens), _cut(x, z, lens))
