"""Where a body's joints are in its bind pose, as transforms."""

from __future__ import annotations

import numpy as np

from mmocap_warp.body.model import BodyModel


def bind_transforms(body: BodyModel) -> np.ndarray:
    """(joint, 4, 4) float64: body space from joint in the bind pose, for column vectors."""
    bind = np.tile(np.eye(4), (len(body.joint_rest), 1, 1))
    bind[:, :3, :3] = body.skeleton.frame
    bind[:, :3, 3] = body.joint_rest
    return bind


def rest_transforms(body: BodyModel) -> np.ndarray:
    """(joint, 4, 4) float64: parent from joint in the bind pose; the root's is body space from root."""
    bind = bind_transforms(body)
    return np.stack(
        [m if p < 0 else np.linalg.inv(bind[p]) @ m for m, p in zip(bind, body.skeleton.parent, strict=True)]
    )
