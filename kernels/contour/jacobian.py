"""How an outline moves along its normals when a joint turns, the root moves or the rest body changes.

A point x of the skin is a blend, ``x = sum_j w_j x_j``, of where each joint would carry it. A turn of joint k about a
unit axis a moves the part of the blend that hangs below k, as ``a x sum_j w_j (x_j - o_k)``, and a residual whose
gradient is g (by the point's place in the world) changes by

    a . ( sum_j w_j (x_j - o_k)  x  g )                                   j: the joint k and those below it

which holds for any tree of joints; a shift along a moves that part by its weight, ``a . sum_j w_j g``. A change of the
rest body moves point and joints in the bind pose, and the joints' origins with the bones above them.

In a view that is late a pose counts with what it says of the motion too: ``1 + late own`` times. Within a clip velocity
and bend are taken as they are, though the neighbours' poses, which make them, move too.

A camera that turns or moves does to its view what the opposite motion of the whole body would, so it needs no columns
beside the root's. Its lens does: a principal point moves all points alike, a focal length and a radial distortion
each away from there. So do its masks, which may be larger all around than what they show.
"""

import warp as wp

from mmocap_warp.kernels.block import CPU_FLAGS, VIEW_LANES, Batch, blocks_of, lanes_of
from mmocap_warp.kernels.body.kinematics import Body, Joints, rotation_of, translation_of
from mmocap_warp.kernels.contour.outline import Outline
from mmocap_warp.kernels.contour.residuals import Residuals
from mmocap_warp.kernels.launching import launch
from mmocap_warp.kernels.views.projection import Pinhole, Views, into_camera, pinhole

wp.set_module_options({"enable_backward": False, "cpu_compiler_flags": CPU_FLAGS})

LENS = 4
"""Columns of a lens: the logarithm of both focal lengths, the principal point [px], and the radial distortion k1."""
OWN = LENS + 1
"""Columns of a view's own: its lens, and by how much its masks are larger than what they show [px]."""

_BLOCK = 64  # threads of a block: few, so that a few views fill a whole GPU too
_Parts = wp.types.matrix(shape=(8, 4), dtype=wp.float32)  # of the joints that move an edge: four at each of its ends
_Numbers = wp.types.vector(length=8, dtype=wp.int32)


@wp.struct
class Posed:
    """Posed candidates: what they were posed from, their joints, the axes that these turn about, and the skin."""

    body: Body
    joints: Joints
    axes: wp.array2d[wp.mat33]  # (candidate, joint) in the columns: of the x, y and z angle or shift, in the world
    vertex: wp.array2d[wp.vec3]  # (candidate, vertex) [m]


@wp.struct
class Tree:
    """Which joints hang below which, as ranges: joint j below k, or k, where ``rank[k] <= rank[j] <= last[k]``."""

    rank: wp.array[wp.int32]  # (joint,)
    last: wp.array[wp.int32]  # (joint,)
    column: wp.array[wp.int32]  # (coordinate,) in a row of the Jacobian; -1 for what is held


@wp.struct
class RestChange:
    """By how much the rest body changes with each of its parameters, at its present shape."""

    vertex: wp.array2d[wp.vec3]  # (parameter, vertex) [m]
    joint: wp.array2d[wp.vec3]  # (parameter, joint) [m]
    origin: wp.array3d[wp.vec3]  # (candidate, parameter, joint) of the joints' posed origins [m]


@wp.struct
class Rows:
    """Of each contour edge: the Jacobian by what is searched, the parameters and the view's own, and the residual."""

    value: wp.array[wp.float32]  # (candidate, camera, contour edge, column) flat
    width: int  # columns
    own: int  # of these, by what is the row's view's own: OWN or none


@wp.struct
class _Influences:
    """The parts of a point's blend: what each joint carries of it, weighted, and how much that is."""

    count: int
    part: _Parts  # (influence, 4): sum of w x_j, w
    joint: _Numbers
    rank: _Numbers  # of the joint
    vertex: _Numbers


@wp.kernel
def _turn_axes(
    pose: wp.array2d[wp.float32],  # (candidate, coordinate)
    batch: Batch,
    # out
    posed: Posed,
) -> None:
    own, j = wp.tid()
    c = batch.first + own
    cx, sx = wp.cos(pose[c, 3 + 3 * j]), wp.sin(pose[c, 3 + 3 * j])
    cy, sy = wp.cos(pose[c, 4 + 3 * j]), wp.sin(pose[c, 4 + 3 * j])
    # A joint turns by Rz Ry Rx: the last of its axes by none of these, the one before by Rz, the first by Rz Ry.
    turned = rotation_of(posed.joints.transform[c, j])
    undone = wp.mat33(1.0, 0.0, -sy, 0.0, cx, sx * cy, 0.0, -sx, cx * cy)
    if posed.body.slides[j] > 0:
        undone = wp.identity(n=3, dtype=float)
    posed.axes[c, j] = turned * undone


def turn_axes(pose: wp.array[wp.float32], batch: Batch, posed: Posed) -> None:
    """Find the axes that a batch's joints turn about or slide along; ``pose`` is (candidate, coordinate) [m, rad]."""
    launch(_turn_axes, (batch.size, posed.axes.shape[1]), [pose, batch], [posed], device=pose.device)


@wp.kernel
def _move_origins(
    change: RestChange,
    body: Body,
    joints: Joints,
    batch: Batch,
    # out
    origin: wp.array3d[wp.vec3],  # (candidate, parameter, joint)
) -> None:
    own, p = wp.tid()
    c = batch.first + own
    origin[c, p, 0] = wp.vec3()
    for j in range(1, body.parent.shape[0]):
        above = body.parent[j]
        bone = change.joint[p, j] - change.joint[p, above]
        origin[c, p, j] = origin[c, p, above] + rotation_of(joints.skin_matrix[c, above]) * bone


def move_origins(posed: Posed, change: RestChange, batch: Batch) -> None:
    """By how much the joints' origins move with the rest body's parameters, of a batch's candidates."""
    parameters = change.vertex.shape[0]
    if parameters:
        dim = (batch.size, parameters)
        launch(
            _move_origins, dim, [change, posed.body, posed.joints, batch], [change.origin], device=change.origin.device
        )


@wp.func
def _seen_place(image: wp.vec3, camera: Pinhole) -> wp.vec3:
    """Where in the world a view sees a vertex of which it has the place in its image and the depth [m]."""
    x = (image[0] - camera.lens[2]) * image[2] / camera.lens[0]
    y = (image[1] - camera.lens[3]) * image[2] / camera.lens[1]
    return wp.transpose(camera.rotation) * (wp.vec3(x, y, image[2]) - camera.translation)


@wp.func
def _gradient(point: wp.vec3, normal: wp.vec2, camera: Pinhole) -> wp.vec3:
    """By the point's place in the world, how far it moves along a normal in the image [px/m]."""
    p = into_camera(point, camera)
    x = normal[0] * camera.lens[0] / p[2]
    y = normal[1] * camera.lens[1] / p[2]
    return wp.transpose(camera.rotation) * wp.vec3(x, y, -(x * p[0] + y * p[1]) / p[2])


@wp.func
def _influences(body: Body, joints: Joints, tree: Tree, c: int, ends: wp.vec2i) -> _Influences:
    """What carries the middle of an edge."""
    found = _Influences()
    found.count = 0
    copy = wp.min(c, body.rest.shape[0] - 1)
    for i in range(2):
        v = ends[i]
        point = body.rest[copy, v]
        at = wp.vec4(point[0], point[1], point[2], 1.0)
        for n in range(4):
            share = 0.5 * body.weight[v][n]
            if share > 0.0:
                j = body.joint[v][n]
                carried = share * (joints.skin_matrix[c, j] * at)
                k = found.count
                found.part[k, 0] = carried[0]
                found.part[k, 1] = carried[1]
                found.part[k, 2] = carried[2]
                found.part[k, 3] = share
                found.joint[k] = j
                found.rank[k] = tree.rank[j]
                found.vertex[k] = v
                found.count = k + 1
    return found


@wp.func
def _write_pose(
    tree: Tree, posed: Posed, c: int, by: _Influences, gradient: wp.vec3, rows: Rows, row: int, share: int, shares: int
) -> None:
    """A share of the columns of the pose."""
    if share == 0:
        for i in range(3):
            if tree.column[i] >= 0:
                rows.value[row + tree.column[i]] = gradient[i]
    part = by.part  # out of the struct once: Warp copies all of it for each element that is read there
    rank = by.rank
    lowest = tree.rank.shape[0]
    highest = int(-1)
    for i in range(by.count):
        lowest = wp.min(lowest, rank[i])
        highest = wp.max(highest, rank[i])
    for k in range(share, tree.rank.shape[0], shares):
        first = tree.rank[k]
        last = tree.last[k]
        arm = wp.vec3()
        carried = float(0.0)
        if highest >= first and lowest <= last:  # most joints carry nothing of it
            for i in range(by.count):
                if rank[i] >= first and rank[i] <= last:
                    arm += wp.vec3(part[i, 0], part[i, 1], part[i, 2])
                    carried += part[i, 3]
        turned = wp.vec3()
        if carried > 0.0:
            moment = wp.cross(arm - carried * translation_of(posed.joints.transform[c, k]), gradient)
            if posed.body.slides[k] > 0:
                moment = carried * gradient
            turned = wp.transpose(posed.axes[c, k]) * moment
        for i in range(3):
            column = tree.column[3 + 3 * k + i]
            if column >= 0:
                rows.value[row + column] = turned[i]


@wp.func
def _write_rest(
    change: RestChange,
    joints: Joints,
    c: int,
    by: _Influences,
    gradient: wp.vec3,
    rows: Rows,
    first: int,
    share: int,
    shares: int,
) -> None:
    """A share of the columns of the rest body's parameters."""
    part = by.part
    joint = by.joint
    vertex = by.vertex
    for p in range(share, change.vertex.shape[0], shares):
        value = float(0.0)
        for i in range(by.count):
            j = joint[i]
            from_rest = rotation_of(joints.skin_matrix[c, j])
            moved = from_rest * (change.vertex[p, vertex[i]] - change.joint[p, j]) + change.origin[c, p, j]
            value += part[i, 3] * wp.dot(gradient, moved)
        rows.value[first + p] = value


@wp.func
def _write_own(middle: wp.vec3, normal: wp.vec2, camera: Pinhole, rows: Rows, first: int) -> None:
    """The columns of the view's own."""
    p = into_camera(middle, camera)
    x = normal[0] * camera.lens[0] * p[0] / p[2]
    y = normal[1] * camera.lens[1] * p[1] / p[2]
    rows.value[first] = x + y
    rows.value[first + 1] = normal[0]
    rows.value[first + 2] = normal[1]
    rows.value[first + 3] = (x + y) * (p[0] * p[0] + p[1] * p[1]) / (p[2] * p[2])
    rows.value[first + 4] = 1.0


@wp.kernel
def _differentiate(
    posed: Posed,
    tree: Tree,
    change: RestChange,
    views: Views,
    outline: Outline,
    residuals: Residuals,
    batch: Batch,
    lanes: int,
    shares: int,
    # out
    rows: Rows,
) -> None:
    own, k, lane = wp.tid()
    c = batch.first + own
    camera = pinhole(views, k)
    late = outline.late[c, k]
    parameters = change.vertex.shape[0]
    searched = rows.width - 1 - rows.own - parameters
    for i in range(lane, outline.count[c, k] * shares, lanes):
        s = i // shares
        share = i - s * shares
        weighted = residuals.weighted[c, k, s]
        if weighted[1] > 0.0:
            ends = outline.ends[c, k, s]
            middle = 0.5 * (posed.vertex[c, ends[0]] + posed.vertex[c, ends[1]])
            if late != 0.0:
                start = _seen_place(outline.image[c, k, ends[0]], camera)
                middle = 0.5 * (start + _seen_place(outline.image[c, k, ends[1]], camera))
            gradient = _gradient(middle, residuals.normal[c, k, s], camera)
            if late != 0.0:
                gradient = late * gradient
            by = _influences(posed.body, posed.joints, tree, c, ends)
            row = ((c * outline.count.shape[1] + k) * outline.size + s) * rows.width
            _write_pose(tree, posed, c, by, gradient, rows, row, share, shares)
            _write_rest(change, posed.joints, c, by, gradient, rows, row + searched, share, shares)
            if share == 0:
                if rows.own > 0:
                    _write_own(middle, residuals.normal[c, k, s], camera, rows, row + searched + parameters)
                rows.value[row + rows.width - 1] = weighted[0]


def differentiate(
    posed: Posed,
    tree: Tree,
    change: RestChange,
    views: Views,
    outline: Outline,
    residuals: Residuals,
    batch: Batch,
    rows: Rows,
) -> None:
    """Fill the rows of a batch's residuals that count, with these behind.

    A row is the change of the outline's place along its normal [px] by every searched coordinate, then by every
    parameter of the rest body, then by the view's own where ``rows`` has columns for it. Rows of other contour edges
    keep what they hold. Where views are few, a GPU's threads share each row.
    """
    device = outline.image.device
    cameras = outline.count.shape[1]
    shares = blocks_of(device, batch.size * cameras)
    lanes = lanes_of(device, shares * VIEW_LANES)
    dim = (batch.size, cameras, lanes)
    inputs = [posed, tree, change, views, outline, residuals, batch, lanes, shares]
    launch(_differentiate, dim, inputs, [rows], block_dim=_BLOCK, device=device)
