"""Forward kinematics: full pose vectors to joint transforms and skinning matrices."""

import warp as wp

wp.set_module_options({"enable_backward": False})

Affine = wp.types.matrix(shape=(3, 4), dtype=wp.float32)
"""A rigid transform ``[R | t]`` for column vectors: ``y = R @ x + t``."""


@wp.struct
class Body:
    """A skinned body: its joints, and a mesh that they carry; ``copy`` is one for all candidates, or one each.

    The weights of a vertex are sorted, the largest first.
    """

    parent: wp.array[wp.int32]  # (joint,) -1 for the root
    depth: wp.array[wp.int32]  # (joint,) joints above it
    slides: wp.array[wp.int32]  # (joint,) 1 where its coordinates shift it along its axes instead of turning it
    levels: int  # one more than the largest depth
    joint_frame: wp.array[wp.mat33]  # (joint,)
    joint_rest: wp.array2d[wp.vec3]  # (copy, joint) [m]
    root_base: wp.array[wp.mat33]  # (run,) the world from the body's axes
    rest: wp.array2d[wp.vec3]  # (copy, vertex) [m]
    joint: wp.array[wp.vec4i]  # (vertex,)
    weight: wp.array[wp.vec4]  # (vertex,)


@wp.struct
class Joints:
    """Where the joints of candidates are."""

    transform: wp.array2d[Affine]  # (candidate, joint) frames in the world
    skin_matrix: wp.array2d[Affine]  # (candidate, joint) carry rest points along with them


@wp.func
def affine(rotation: wp.mat33, translation: wp.vec3) -> Affine:
    """``[rotation | translation]``."""
    return Affine(
        rotation[0, 0], rotation[0, 1], rotation[0, 2], translation[0],
        rotation[1, 0], rotation[1, 1], rotation[1, 2], translation[1],
        rotation[2, 0], rotation[2, 1], rotation[2, 2], translation[2],
    )  # fmt: skip


@wp.func
def rotation_of(transform: Affine) -> wp.mat33:
    """The rotation of ``[R | t]``."""
    return wp.mat33(
        transform[0, 0], transform[0, 1], transform[0, 2],
        transform[1, 0], transform[1, 1], transform[1, 2],
        transform[2, 0], transform[2, 1], transform[2, 2],
    )  # fmt: skip


@wp.func
def translation_of(transform: Affine) -> wp.vec3:
    """The translation of ``[R | t]``."""
    return wp.vec3(transform[0, 3], transform[1, 3], transform[2, 3])


@wp.func
def rotation_zyx(x: float, y: float, z: float) -> wp.mat33:
    """``Rz(z) @ Ry(y) @ Rx(x)``: on a column vector the x rotation acts first."""
    cx, sx = wp.cos(x), wp.sin(x)
    cy, sy = wp.cos(y), wp.sin(y)
    cz, sz = wp.cos(z), wp.sin(z)
    return wp.mat33(
        cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx,
        sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx,
        -sy, cy * sx, cy * cx,
    )  # fmt: skip


@wp.func
def turn_joint(body: Body, pose: wp.array2d[wp.float32], c: int, run: int, j: int) -> Affine:
    """A joint's frame in its parent's, or the root's in the world, of a run's candidate."""
    copy = wp.min(c, body.joint_rest.shape[0] - 1)
    rotation = rotation_zyx(pose[c, 3 + 3 * j], pose[c, 4 + 3 * j], pose[c, 5 + 3 * j])
    p = body.parent[j]
    if p < 0:
        at = wp.vec3(pose[c, 0], pose[c, 1], pose[c, 2])
        return affine(body.root_base[run] * body.joint_frame[j] * rotation, at)
    into_parent = wp.transpose(body.joint_frame[p])
    bone = body.joint_rest[copy, j] - body.joint_rest[copy, p]
    if body.slides[j] > 0:
        shift = body.joint_frame[j] * wp.vec3(pose[c, 3 + 3 * j], pose[c, 4 + 3 * j], pose[c, 5 + 3 * j])
        return affine(into_parent * body.joint_frame[j], into_parent * (bone + shift))
    return affine(into_parent * body.joint_frame[j] * rotation, into_parent * bone)


@wp.func
def chain_joint(local: Affine, body: Body, c: int, j: int, joints: Joints) -> None:
    """Hang a joint on its parent, which has been hung."""
    world = rotation_of(local)
    origin = translation_of(local)
    if body.parent[j] >= 0:
        above = joints.transform[c, body.parent[j]]
        origin = translation_of(above) + rotation_of(above) * origin
        world = rotation_of(above) * world
    joints.transform[c, j] = affine(world, origin)
    from_rest = world * wp.transpose(body.joint_frame[j])
    rest = body.joint_rest[wp.min(c, body.joint_rest.shape[0] - 1), j]
    joints.skin_matrix[c, j] = affine(from_rest, origin - from_rest * rest)
