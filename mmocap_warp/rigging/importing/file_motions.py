"""A file's animation as poses of the body that was made of it."""

from __future__ import annotations

import numpy as np

from mmocap_warp.body.model import BodyModel, BodyMotion
from mmocap_warp.body.rotations import applied, continuous_zyx_angles, transposed
from mmocap_warp.formats.rigged.rigged_mesh import RiggedMotion


def body_motion(body: BodyModel, bind: np.ndarray, motion: RiggedMotion) -> tuple[BodyMotion, float]:
    """Poses of a body whose joints turn and slide as a file's do, and how far joints are from the file's at most [m].

    All three coordinates of every joint are taken, whether they are searched or not. Bones keep their lengths but for
    joints that slide; a file's may change.

    Args:
        body: the body.
        bind: (joint, 4, 4), the body's space from the file's joints in the bind pose.
        motion: in the body's axes and metres.
    """
    skeleton = body.skeleton
    frame, rest = skeleton.frame.astype(np.float64), body.joint_rest.astype(np.float64)
    turned = motion.world[..., :3, :3] @ transposed(bind[:, :3, :3])  # from the bind pose, in the body's axes
    frames, free = len(turned), np.tile([-np.inf, np.inf], (3, 1))
    pose = np.zeros((frames, skeleton.coordinates))
    pose[:, :3] = motion.world[:, 0, :3, 3]
    place = np.zeros((frames, len(rest), 3))
    for joint, parent in enumerate(skeleton.parent):
        above = np.eye(3) if parent < 0 else turned[:, parent]
        coordinates = skeleton.angles(skeleton.joints[joint])
        place[:, joint] = pose[:, :3] if parent < 0 else place[:, parent] + above @ (rest[joint] - rest[parent])
        if skeleton.slides[joint]:
            held = above @ frame[joint]
            shift = motion.world[:, joint, :3, 3] - place[:, joint]
            pose[:, coordinates] = applied(transposed(held), shift)
            place[:, joint] += shift
            turned[:, joint] = above
            continue
        own = frame[joint].T @ np.swapaxes(above, -1, -2) @ turned[:, joint] @ frame[joint]
        pose[:, coordinates] = continuous_zyx_angles(own, free)
    apart = float(np.linalg.norm(place - motion.world[:, :, :3, 3], axis=2).max())
    return BodyMotion(motion.fps, pose), apart
