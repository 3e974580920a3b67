"""Linear-blend skinning straight from the pose."""

import warp as wp

from mmocap_warp.kernels.block import Batch, lanes_of, run_of, sync, sync_warp
from mmocap_warp.kernels.body.kinematics import Affine, Body, Joints, chain_joint, turn_joint
from mmocap_warp.kernels.launching import launch

wp.set_module_options({"enable_backward": False})

_WARP = wp.constant(32)


@wp.func
def _skinned(body: Body, skin_matrix: wp.array2d[Affine], c: int, v: int) -> wp.vec3:
    """A vertex of a candidate [m]. Weights are sorted, the largest first, so that the rest can be skipped at a zero."""
    point = body.rest[wp.min(c, body.rest.shape[0] - 1), v]
    at = wp.vec4(point[0], point[1], point[2], 1.0)
    influence = body.joint[v]
    share = body.weight[v]
    blended = share[0] * (skin_matrix[c, influence[0]] * at)
    for i in range(1, 4):
        if share[i] > 0.0:
            blended += share[i] * (skin_matrix[c, influence[i]] * at)
    return blended


@wp.kernel
def _pose_vertices(
    body: Body,
    pose: wp.array2d[wp.float32],  # (candidate, 3 + 3 joint)
    vertex: wp.array[wp.int32],  # (wanted vertex,)
    batch: Batch,
    lanes: int,
    # out
    joints: Joints,
    posed: wp.array2d[wp.vec3],  # (candidate, vertex)
) -> None:
    own, lane = wp.tid()
    c = batch.first + own
    run = run_of(c, batch, body.root_base.shape[0])
    if lane < _WARP:  # a joint waits for its parent; the lanes of a warp need not wait for the whole block
        for j in range(lane, body.parent.shape[0], wp.min(lanes, _WARP)):
            joints.skin_matrix[c, j] = turn_joint(body, pose, c, run, j)
        sync_warp()
        for level in range(body.levels):
            for j in range(lane, body.parent.shape[0], wp.min(lanes, _WARP)):
                if body.depth[j] == level:
                    chain_joint(joints.skin_matrix[c, j], body, c, j, joints)
            sync_warp()
    sync()
    for i in range(lane, vertex.shape[0], lanes):
        v = vertex[i]
        posed[c, v] = _skinned(body, joints.skin_matrix, c, v)


def pose_vertices(
    body: Body,
    pose: wp.array[wp.float32],
    vertex: wp.array[wp.int32],
    batch: Batch,
    joints: Joints,
    posed: wp.array[wp.vec3],
) -> None:
    """Pose the joints of a batch's candidates and skin some of its vertices: a block of lanes each.

    ``transform[j] = transform[parent] @ rest_local[j] @ (Rz Ry Rx)``, of a sliding joint
    ``transform[parent] @ rest_local[j] @ shift``, and ``skin_matrix[j] = transform[j] @ inverse(bind[j])``; the root
    sits at ``pose[:, :3]`` [m] and turns in ``root_base``. Then
    ``posed[c, v] = sum_i weight[v, i] * skin_matrix[c, joint[v, i]] @ rest[v]`` [m].

    ``pose`` is (candidate, 3 + 3 joint) [m, rad], ``vertex`` has the numbers of the wanted ones, ``posed`` is
    (candidate, vertex) [m]; candidates are shared evenly by as many runs as there are root bases.
    """
    lanes = lanes_of(posed.device)
    dim = (batch.size, lanes)
    launch(
        _pose_vertices, dim, [body, pose, vertex, batch, lanes], [joints, posed], block_dim=lanes, device=posed.device
    )
