from dataclasses import replace

import numpy as np
import pytest
import reference
import warp as wp
from poisoned import poisoned, poisoned_joints
from random_scenes import posed_vertices, random_poses
from synthetic import synthetic_body, synthetic_subject

from mmocap_warp.body.posing import make_body_arrays
from mmocap_warp.kernels.block import batch_of
from mmocap_warp.kernels.body.skinning import pose_vertices

POSITION = 1e-5  # [m]


@pytest.mark.parametrize("up", ["+y", "+x"])
def test_vertices_are_where_the_twin_has_them(device, up):
    body, base = synthetic_body(), synthetic_subject(up).root_base
    poses = random_poses(10)
    posed = posed_vertices(body, base, poses, device).numpy()
    for found, pose in zip(posed, poses, strict=True):
        expected = reference.skin(body.tracking, body, reference.joint_transforms(body, base, pose))
        np.testing.assert_allclose(found, expected, rtol=0, atol=POSITION)


def test_vertices_that_are_wanted_are_posed_in_one_go(device):
    """With a body and a base for every candidate, and any weights; other vertices stay as they were."""
    rng = np.random.default_rng(2)
    body, base = synthetic_body(), synthetic_subject().root_base
    bodies = [body.shaped({"height_incr": w}, scale) for w, scale in ((0.0, 1.0), (0.8, 0.9), (-0.5, 1.2))]
    bases = [base @ reference.rotation(1, angle) for angle in (0.0, 1.0, -2.5)]
    poses = random_poses(3)
    arrays = make_body_arrays(body, base, body.tracking, device, copies=3)
    arrays.joint_rest.assign(np.stack([one.joint_rest for one in bodies]))
    arrays.rest.assign(np.stack([one.tracking.rest for one in bodies]))
    arrays.root_base.assign(np.stack(bases).astype(np.float32))
    weight = rng.dirichlet(np.full(4, 0.5), len(body.tracking.rest))
    weight[::2, 2:] = 0.0  # two influences only
    weight = -np.sort(-weight / weight.sum(1, keepdims=True), axis=1)
    joint = rng.integers(0, 16, weight.shape)
    arrays.joint.assign(joint.astype(np.int32))
    arrays.weight.assign(weight.astype(np.float32))
    wanted = rng.permutation(len(body.tracking.rest))[:50]
    posed = poisoned((3, len(body.tracking.rest)), wp.vec3, device)
    pose_vertices(
        arrays,
        wp.array(poses, dtype=wp.float32, device=device),
        wp.array(wanted, dtype=wp.int32, device=device),
        batch_of(0, 3, 3, device),
        poisoned_joints(3, 16, device),
        posed,
    )
    found = posed.numpy()
    for c, (one, own_base, pose) in enumerate(zip(bodies, bases, poses, strict=True)):
        skin = replace(one.tracking, joint=joint, weight=weight)
        expected = reference.skin(skin, one, reference.joint_transforms(one, own_base, pose))
        np.testing.assert_allclose(found[c, wanted], expected[wanted], rtol=0, atol=POSITION)
    assert np.isnan(np.delete(found, wanted, axis=1)).all()


def test_candidates_of_a_run_share_its_base(device):
    """Three runs of four candidates; the launch begins and ends in the middle of a run, as a thread's may."""
    body = synthetic_body()
    bases = [synthetic_subject().root_base @ reference.rotation(1, angle) for angle in (0.0, 1.0, -2.5)]
    first, end, poses = 2, 11, random_poses(12)
    arrays = make_body_arrays(body, bases[0], body.tracking, device, bases=3)
    arrays.root_base.assign(np.stack(bases).astype(np.float32))
    vertices = len(body.tracking.rest)
    posed = poisoned((12, vertices), wp.vec3, device)
    pose_vertices(
        arrays,
        wp.array(poses, dtype=wp.float32, device=device),
        wp.array(np.arange(vertices), dtype=wp.int32, device=device),
        batch_of(first, end, 12, device),
        poisoned_joints(12, 16, device),
        posed,
    )
    found = posed.numpy()
    for c in range(first, end):
        expected = reference.skin(body.tracking, body, reference.joint_transforms(body, bases[c // 4], poses[c]))
        np.testing.assert_allclose(found[c], expected, rtol=0, atol=POSITION)
    assert np.isnan(np.delete(found, np.arange(first, end), axis=0)).all()
