"""A result in a world whose vertical is another axis, as programs ask for that know only Y or Z up."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mmocap_warp.cameras.rig import UP_AXES
from mmocap_warp.result.result import Result


def stood_up(result: Result, up: str) -> Result:
    """The same motion before the same cameras, in a world whose up axis is ``up``, such as ``"+y"``.

    The world is turned about the axis that is neither its vertical nor the new one, or about x (z where x is the
    vertical) where it is to stand on its head: from +z to +y, (x, y, z) becomes (x, z, -y). Heights stay; the joints'
    standard deviations, which are along the axes of the world as it was, are dropped.

    Raises:
        ValueError: no such axis.
    """
    if up not in UP_AXES:
        raise ValueError(f"up must be one of {UP_AXES}, got {up!r}")
    if up == result.cameras.up:
        return result
    turn = _turn(result.cameras.up, up)

    def turned(pose: np.ndarray) -> np.ndarray:
        """Poses (..., coordinate): the root's place is in the world's axes, its angles are in the body's."""
        return np.concatenate([pose[..., :3] @ turn.T, pose[..., 3:]], axis=-1)

    subject, cameras = result.subject, result.cameras
    return replace(
        result,
        subject=replace(subject, root_base=turn @ subject.root_base, pose=turned(subject.pose)),
        cameras=replace(cameras, R=cameras.R @ turn.T, up=up),
        pose=turned(result.pose),
        raw_pose=None if result.raw_pose is None else turned(result.raw_pose),
        joint_sigma=None,
    )


def _turn(up: str, new: str) -> np.ndarray:
    """(3, 3) rotation by quarter turns that takes one signed axis to another."""
    source, target = _unit(up), _unit(new)
    across = np.cross(source, target)
    if across.any():  # a quarter turn
        return np.outer(target, source) - np.outer(source, target) + np.outer(across, across)
    about = _unit("+z" if up[1] == "x" else "+x")
    return 2 * np.outer(about, about) - np.eye(3)


def _unit(axis: str) -> np.ndarray:
    return np.eye(3)["xyz".index(axis[1])] * (1 if axis[0] == "+" else -1)
