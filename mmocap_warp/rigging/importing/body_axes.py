"""A rigged mesh turned and scaled into a body's axes: +Y up, +Z the way it faces, +X its left, in metres."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mmocap_warp.body.rotations import axis_vector
from mmocap_warp.formats.rigged.rigged_mesh import JointAxis, RiggedMesh, RiggedMotion

AXES: tuple[str, ...] = ("+x", "-x", "+y", "-y", "+z", "-z")


def body_from_file(up: str, facing: str) -> np.ndarray:
    """(3, 3) rotation from a file's axes into a body's.

    Raises:
        ValueError: an axis that is none of ``AXES``, or both along the same one.
    """
    for name, axis in (("up", up), ("facing", facing)):
        if axis not in AXES:
            raise ValueError(f"{name} must be one of {', '.join(AXES)}, got {axis!r}")
    if up[1] == facing[1]:
        raise ValueError(f"facing must be across up, got facing {facing} and up {up}")
    upward, ahead = axis_vector(up) + 0.0, axis_vector(facing) + 0.0  # 0.0 makes zeros of negative zeros
    return np.stack([np.cross(upward, ahead), upward, ahead])


def in_body_axes(mesh: RiggedMesh, up: str, facing: str, scale: float) -> RiggedMesh:
    """The mesh in metres times ``scale``, +Y up and facing +Z; bind transforms and motions lose their own scale.

    Args:
        mesh: as the file has it.
        up, facing: the file's axes, instead of its format's.
        scale: what lengths are multiplied by, besides the file's unit.

    Raises:
        ValueError: axes that cannot be, or a scale that is not positive.
    """
    if not (np.isfinite(scale) and scale > 0):
        raise ValueError(f"scale must be positive, got {scale}")
    turn, size = body_from_file(up, facing), scale * mesh.metres

    def moved(transform: np.ndarray) -> np.ndarray:
        result = np.zeros_like(transform)
        result[..., :3, :3] = turn @ nearest_rotation(transform[..., :3, :3])
        result[..., :3, 3] = size * transform[..., :3, 3] @ turn.T
        result[..., 3, 3] = 1.0
        return result

    return replace(
        mesh,
        bind=moved(mesh.bind),
        vertex=size * mesh.vertex @ turn.T,
        axes={joint: _moved_axis(how, turn, size) for joint, how in mesh.axes.items()},
        motions={name: RiggedMotion(motion.fps, moved(motion.world)) for name, motion in mesh.motions.items()},
        up="+y",
        facing="+z",
        metres=1.0,
    )


def _moved_axis(how: JointAxis, turn: np.ndarray, size: float) -> JointAxis:
    longer = size if how.slides else 1.0
    return replace(how, axis=turn @ how.axis, lower=longer * how.lower, upper=longer * how.upper)


def nearest_rotation(matrix: np.ndarray) -> np.ndarray:
    """(..., 3, 3) the rotations nearest to some matrices, which may be scaled or mirrored."""
    u, _, vt = np.linalg.svd(matrix)
    u[..., :, 2] *= np.linalg.det(u @ vt)[..., None]
    return u @ vt
