"""Triangles that the near plane cuts.

Where it cuts a body open, a ray may leave the body without having entered it: then the triangles that face away
count too. Such views are rare and pay for it; all others only ask whether a vertex is behind.
"""

import warp as wp

from mmocap_warp.kernels.views.projection import BEHIND, NEAR, Pinhole, into_camera, is_behind, onto_grid

wp.set_module_options({"enable_backward": False})

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
