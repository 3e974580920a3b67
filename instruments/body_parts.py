"""A body's parts as the paper's hierarchical algorithms search them, and the whole body as holistic ones do."""

from dataclasses import dataclass

import numpy as np

from mmocap_warp.body.skeleton import Skeleton


@dataclass(frozen=True)
class Part:
    """Degrees of freedom that are searched together while the rest of the body stays as it is."""

    name: str  # for people
    index: np.ndarray  # (dof,) int32, coordinates of the pose


def holistic(skeleton: Skeleton, dof: int | None = None) -> list[Part]:
    """One part with every coordinate that a model searches."""
    return [Part("whole body", skeleton.searched(dof))]


def hierarchical(skeleton: Skeleton, dof: int | None = None) -> list[Part]:
    """The skeleton's parts, of a person the paper's six; later ones never revise earlier ones."""
    return [Part(name, index) for name, index in skeleton.searched_by_part(dof).items()]
