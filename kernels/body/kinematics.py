"""Forward kinematics: full pose vectors to joint transforms and skinning matrices."""

import warp as wp

wp.set_module_options({"enable_backward": False})

Affine = wp.types.matrix(shape=(3, 4), dtype=wp.float32)
"""A rigid transform ``[R | t]`` for column vectors: ``y = R @ x + t``."""


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
def turn_joint(
    pose: wp.array2d[wp.float32],
    parent: wp.array[wp.int32],
    joint_frame: wp.array[wp.mat33],
    joint_rest: wp.array2d[wp.vec3],
    root_base: wp.array[wp.mat33],
    c: int,
    base: int,
    j: int,
) -> Affine:
    """A joint's frame in its parent's, or the root's in the world; ``base`` is the number of its root base."""
    body = wp.min(c, joint_rest.shape[0] - 1)
    rotation = rotation_zyx(pose[c, 3 + 3 * j], pose[c, 4 + 3 * j], pose[c, 5 + 3 * j])
    p = parent[j]
    if p < 0:
        return affine(root_base[base] * joint_frame[j] * rotation, wp.vec3(pose[c, 0], pose[c, 1], pose[c, 2]))
    into_parent = wp.transpose(joint_frame[p])
    bone = joint_rest[body, j] - joint_rest[body, p]
    return affine(into_parent * joint_frame[j] * rotation, into_parent * bone)


@wp.func
def chain_joint(
    local: Affine,
    parent: wp.array[wp.int32],
    joint_frame: wp.array[wp.mat33],
    joint_rest: wp.array2d[wp.vec3],
    c: int,
    j: int,
    joint_transform: wp.array2d[Affine],
    skin_matrix: wp.array2d[Affine],
):
    """Hang a joint on its parent, which has been hung."""
    world = rotation_of(local)
    origin = translation_of(local)
    if parent[j] >= 0:
        above = joint_transform[c, parent[j]]
        origin = translation_of(above) + rotation_of(above) * origin
        world = rotation_of(above) * world
    joint_transform[c, j] = affine(world, origin)
    from_rest = world * wp.transpose(joint_frame[j])
    skin_matrix[c, j] = affine(from_rest, origin - from_rest * joint_rest[wp.min(c, joint_rest.shape[0] - 1), j])


@wp.kernel
def _pose_joints(
    pose: wp.array2d[wp.float32],  # (candidate, 3 + 3 joint)
    parent: wp.array[wp.int32],  # (joint,)
    joint_frame: wp.array[wp.mat33],  # (joint,)
    joint_rest: wp.array2d[wp.vec3],  # (body, joint)
    root_base: wp.array[wp.mat33],  # (body,)
    # out
    joint_transform: wp.array2d[Affine],  # (candidate, joint)
    skin_matrix: wp.array2d[Affine],  # (candidate, joint)
):
    c = wp.tid()
    base = wp.min(c, root_base.shape[0] - 1)
    for j in range(parent.shape[0]):
        local = turn_joint(pose, parent, joint_frame, joint_rest, root_base, c, base, j)
        chain_joint(local, parent, joint_frame, joint_rest, c, j, joint_transform, skin_matrix)


def pose_joints(pose, parent, joint_frame, joint_rest, root_base, joint_transform, skin_matrix):
    """Joint frames in the world, and the matrices that carry rest points along with them.

    ``joint_transform[j] = joint_transform[parent] @ rest_local[j] @ (Rz Ry Rx)`` and
    ``skin_matrix[j] = joint_transform[j] @ inverse(bind[j])``; the root sits at ``pose[:, :3]`` [m] and turns in
    ``root_base``. ``body`` is one for all candidates, or one each.
    """
    wp.launch(
        _pose_joints,
        dim=pose.shape[0],
        inputs=[pose, parent, joint_frame, joint_rest, root_base],
        outputs=[joint_transform, skin_matrix],
        device=pose.device,
    )
