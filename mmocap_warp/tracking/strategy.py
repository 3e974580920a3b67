"""How a frame's search is divided: all degrees of freedom at once, or the body's parts one after the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mmocap_warp.body.model import DegreesOfFreedom

_HIERARCHY: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("root", ("Root",)),
    ("torso and head", ("BottomSpine", "UpperSpine", "Neck")),
    ("left arm", ("LShoulder", "LElbow", "LWrist")),
    ("right arm", ("RShoulder", "RElbow", "RWrist")),
    ("left leg", ("LHip", "LKnee", "LAnkle")),
    ("right leg", ("RHip", "RKnee", "RAnkle")),
)  # the paper's six steps; later ones never revise earlier ones


@dataclass(frozen=True)
class Part:
    """Degrees of freedom that are searched together while the rest is frozen at the best so far.

    Attributes:
        name: for people.
        index: (dof,) int32, positions in the full pose vector.
    """

    name: str
    index: np.ndarray


def holistic(dofs: DegreesOfFreedom) -> list[Part]:
    """One part with every degree of freedom."""
    return [Part("whole body", dofs.index)]


def hierarchical(dofs: DegreesOfFreedom) -> list[Part]:
    """The paper's six parts; the root's takes the translation too."""
    parts = []
    for name, joints in _HIERARCHY:
        chosen = dofs.of_joints(*joints)
        if name == "root":
            chosen = np.concatenate([np.flatnonzero(dofs.is_translation), chosen])
        parts.append(Part(name, dofs.index[chosen]))
    return parts


def share_budget(evaluations: int, parts: int) -> list[int]:
    """Split a budget evenly; what does not divide goes to the first parts."""
    return [evaluations // parts + (i < evaluations % parts) for i in range(parts)]
