import numpy as np
import pytest
import reference
import warp as wp
from poisoned import poisoned_joints
from random_scenes import random_poses
from synthetic import synthetic_body, synthetic_subject, upright

from mmocap_warp.body.posing import make_body_arrays
from mmocap_warp.kernels.block import batch_of
from mmocap_warp.kernels.body.skinning import pose_vertices

POSITION = 1e-5  # [m]
ROTATION = 1e-5  # of a matrix entry


def posed_joints(bodies, bases, poses, device):
    """Joint transforms and skinning matrices (candidate, joint, 3, 4) of the kernel."""
    arrays = make_body_arrays(bodies[0], bases[0], bodies[0].tracking, device, copies=len(bodies))
    arrays.joint_rest.assign(np.stack([body.joint_rest for body in bodies]))
    arrays.root_base.assign(np.stack(bases).astype(np.float32))
    params, no_vertex = wp.array(poses, dtype=wp.float32, device=device), wp.zeros(0, dtype=wp.int32, device=device)
    joints, posed = poisoned_joints(len(poses), 16, device), wp.empty((len(poses), 0), dtype=wp.vec3, device=device)
    pose_vertices(arrays, params, no_vertex, batch_of(0, len(poses), len(poses), device), joints, posed)
    return joints.transform.numpy(), joints.skin_matrix.numpy()


def compare(found, expected):
    np.testing.assert_allclose(found[..., :3], expected[..., :3, :3], rtol=0, atol=ROTATION)
    np.testing.assert_allclose(found[..., 3], expected[..., :3, 3], rtol=0, atol=POSITION)


@pytest.mark.parametrize("up", ["+y", "-z"])
def test_joints_are_where_the_twin_has_them(device, up):
    body, base = synthetic_body(), synthetic_subject(up).root_base
    poses = random_poses(20)
    transforms, skin_matrices = posed_joints([body], [base], poses, device)
    expected = np.stack([reference.joint_transforms(body, base, pose) for pose in poses])
    compare(transforms, expected)
    bind = [reference.rigid(body.skeleton.frame[j].astype(float), body.joint_rest[j].astype(float)) for j in range(16)]
    compare(skin_matrices, expected @ np.linalg.inv(bind))


def test_every_candidate_may_have_its_own_body_and_base(device):
    body = synthetic_body()
    bodies = [body.shaped({"height_incr": w}, scale) for w, scale in ((0.0, 1.0), (0.8, 0.9), (-0.5, 1.2))]
    bases = [upright(up) @ reference.rotation(1, angle) for up, angle in (("+y", 0.3), ("+z", 2.0), ("-x", -1.0))]
    poses = random_poses(3)
    transforms, _ = posed_joints(bodies, bases, poses, device)
    compare(
        transforms, np.stack([reference.joint_transforms(*each) for each in zip(bodies, bases, poses, strict=True)])
    )


def test_the_zero_pose_is_the_bind_pose(device):
    body = synthetic_body()
    pose = np.zeros((1, 51))
    pose[0, :3] = body.joint_rest[0]
    transforms, skin_matrices = posed_joints([body], [np.eye(3)], pose, device)
    np.testing.assert_allclose(transforms[0, :, :, 3], body.joint_rest, rtol=0, atol=POSITION)
    np.testing.assert_allclose(transforms[0, :, :, :3], body.skeleton.frame, rtol=0, atol=ROTATION)
    np.testing.assert_allclose(skin_matrices[0], np.tile(np.eye(4)[:3], (16, 1, 1)), rtol=0, atol=ROTATION)
