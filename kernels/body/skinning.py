"""Linear-blend skinning, of given skinning matrices or straight from the pose."""

import warp as wp

from mmocap_warp.kernels.block import lanes_of, sync, sync_warp
from mmocap_warp.kernels.body.kinematics import Affine, chain_joint, turn_joint

wp.set_module_options({"enable_backward": False})

_WARP = wp.constant(32)


@wp.func
def _skinned(
    rest: wp.array2d[wp.vec3],
    joint: wp.array[wp.vec4i],
    weight: wp.array[wp.vec4],
    skin_matrix: wp.array2d[Affine],
    c: int,
    v: int,
) -> wp.vec3:
    """A vertex of a candidate [m]. Weights are sorted, the largest first, so that the rest can be skipped at a zero."""
    point = rest[wp.min(c, rest.shape[0] - 1), v]
    at = wp.vec4(point[0], point[1], point[2], 1.0)
    influence = joint[v]
    share = weight[v]
    blended = share[0] * (skin_matrix[c, influence[0]] * at)
    for i in range(1, 4):
        if share[i] > 0.0:
            blended += share[i] * (skin_matrix[c, influence[i]] * at)
    return blended


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
    posed[c, v] = _skinned(rest, joint, weight, skin_matrix, c, v)


def skin(rest, joint, weight, skin_matrix, posed):
    """Pose every candidate: ``posed[c, v] = sum_i weight[v, i] * skin_matrix[c, joint[v, i]] @ rest[v]`` [m].

    Weights are sorted, the largest first; ``body`` is one for all candidates, or one each.
    """
    wp.launch(_skin, dim=posed.shape, inputs=[rest, joint, weight, skin_matrix], outputs=[posed], device=posed.device)


@wp.kernel
def _pose_vertices(
    pose: wp.array2d[wp.float32],  # (candidate, 3 + 3 joint)
    parent: wp.array[wp.int32],  # (joint,)
    depth: wp.array[wp.int32],  # (joint,) joints above it
    joint_frame: wp.array[wp.mat33],  # (joint,)
    joint_rest: wp.array2d[wp.vec3],  # (body, joint)
    root_base: wp.array[wp.mat33],  # (base,)
    rest: wp.array2d[wp.vec3],  # (body, vertex)
    joint: wp.array[wp.vec4i],  # (vertex,)
    weight: wp.array[wp.vec4],  # (vertex,)
    vertex: wp.array[wp.int32],  # (wanted vertex,)
    levels: int,
    first: int,
    share: int,
    lanes: int,
    # out
    joint_transform: wp.array2d[Affine],  # (candidate, joint)
    skin_matrix: wp.array2d[Affine],  # (candidate, joint)
    posed: wp.array2d[wp.vec3],  # (candidate, vertex)
):
    c, lane = wp.tid()
    base = wp.min((first + c) // share, root_base.shape[0] - 1)
    if lane < _WARP:  # a joint waits for its parent; the lanes of a warp need not wait for the whole block
        for j in range(lane, parent.shape[0], wp.min(lanes, _WARP)):
            skin_matrix[c, j] = turn_joint(pose, parent, joint_frame, joint_rest, root_base, c, base, j)
        sync_warp()
        for level in range(levels):
            for j in range(lane, parent.shape[0], wp.min(lanes, _WARP)):
                if depth[j] == level:
                    local = skin_matrix[c, j]
                    chain_joint(local, parent, joint_frame, joint_rest, c, j, joint_transform, skin_matrix)
            sync_warp()
    sync()
    for i in range(lane, vertex.shape[0], lanes):
        v = vertex[i]
        posed[c, v] = _skinned(rest, joint, weight, skin_matrix, c, v)


def pose_vertices(
    pose, parent, depth, joint_frame, joint_rest, root_base, rest, joint, weight, vertex, levels, first, share,
    joint_transform, skin_matrix, posed,
):  # fmt: skip
    """Pose the joints of every candidate and skin some of its vertices: a block of lanes each.

    See :func:`~mmocap_warp.kernels.body.kinematics.pose_joints` and :func:`skin`; ``levels`` is one more than the
    largest ``depth``. ``share`` candidates after one another have a ``root_base``; the launch begins at candidate
    ``first``.
    """
    lanes = lanes_of(posed.device)
    wp.launch(
        _pose_vertices,
        dim=(pose.shape[0], lanes),
        inputs=[
            pose,
            parent,
            depth,
            joint_frame,
            joint_rest,
            root_base,
            rest,
            joint,
            weight,
            vertex,
            levels,
            first,
            share,
            lanes,
        ],
        outputs=[joint_transform, skin_matrix, posed],
        block_dim=lanes,
        device=posed.device,
    )
