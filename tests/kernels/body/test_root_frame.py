"""The root's frame follows the body and comes back, through gimbal lock and round whole circles."""

import numpy as np
import pytest
import reference
import warp as wp

from mmocap_warp.kernels.body.root_frame import enter, leave

FLOAT32 = 1e-6


def zyx(x, y, z):
    return reference.rotation(2, z) @ reference.rotation(1, y) @ reference.rotation(0, x)


def frames():
    """A home and a root joint's frame without any symmetry."""
    return zyx(0.3, -1.1, 2.0), zyx(-0.7, 0.4, 0.9)


def arrays(angles, device):
    pose = np.zeros((len(angles), 51), np.float32)
    pose[:, 3:6] = angles
    return (
        wp.array(pose, dtype=wp.float32, device=device),
        wp.zeros(len(angles), dtype=wp.vec3, device=device),
        wp.zeros(len(angles), dtype=wp.mat33, device=device),
    )


@pytest.mark.parametrize("heading", [0.0, 1.2, np.pi / 2, np.pi / 2 + 1e-4, 2.5, -np.pi / 2, 7.0])
def test_a_turn_is_added_in_the_new_frame_and_read_in_the_old(heading, device):
    home, frame = frames()
    rng = np.random.default_rng(0)
    angles = np.array([[0.2, heading, -0.1], [0.0, heading, 0.0], [-1.0, heading, 2.0]])
    turns = rng.uniform(-0.3, 0.3, angles.shape)
    pose, kept, base = arrays(angles, device)
    constants = wp.mat33(home.astype(np.float32)), wp.mat33(frame.astype(np.float32))

    enter(*constants, pose, kept, base)
    assert not pose.numpy()[:, 3:6].any()
    for found, start in zip(base.numpy(), angles, strict=True):
        np.testing.assert_allclose(found @ frame, home @ frame @ zyx(*start), atol=FLOAT32)

    moved = pose.numpy()
    moved[:, 3:6] = turns
    pose.assign(moved)
    leave(*constants, kept, pose, base)
    np.testing.assert_array_equal(base.numpy(), np.repeat(home.astype(np.float32)[None], 3, axis=0))
    for found, start, turn in zip(pose.numpy()[:, 3:6], angles, turns, strict=True):
        np.testing.assert_allclose(zyx(*found.astype(float)), zyx(*start) @ zyx(*turn), atol=2 * FLOAT32)


def test_angles_go_on_where_they_were(device):
    """Walking round two circles, the heading grows past 90, 180 and 360 degrees without a jump."""
    home, frame = frames()
    constants = wp.mat33(home.astype(np.float32)), wp.mat33(frame.astype(np.float32))
    pose, kept, base = arrays(np.zeros((1, 3)), device)
    headings = []
    for _ in range(130):
        enter(*constants, pose, kept, base)
        step = pose.numpy()
        step[0, 4] = 0.1
        pose.assign(step)
        leave(*constants, kept, pose, base)
        headings.append(pose.numpy()[0, 4])
    np.testing.assert_allclose(headings, 0.1 * np.arange(1, 131), atol=1e-3)
