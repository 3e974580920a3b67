"""How a frame's search is divided: all degrees of freedom at once, or the body's parts one after the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mmocap_warp.body.skeleton import Skeleton


@dataclass(frozen=True)
class Part:
    """Degrees of freedom that are searched together while the rest is left as it is.

    Attributes:
        name: for people.
        index: (dof,) int32, coordinates of the pose.
    """

    name: str
    index: np.ndarray


def holistic(skeleton: Skeleton, dof: int | None = None) -> list[Part]:
    """One part with every coordinate that a model searches."""
    return [Part("whole body", skeleton.searched(dof))]


def hierarchical(skeleton: Skeleton, dof: int | None = None) -> list[Part]:
    """The skeleton's parts, of a person the paper's six; later ones never revise earlier ones."""
    return [Part(name, index) for name, index in skeleton.searched_by_part(dof).items()]
