"""A first guess for frames that show nothing: between those that do."""

from __future__ import annotations

import numpy as np

from mmocap_warp.contour.frame.rooted import RootedPoses


def filled(rooted: RootedPoses, known: np.ndarray) -> RootedPoses:
    """Poses with those that are not ``known`` (frame,) put evenly between the known ones around them.

    Before the first and after the last known frame its pose is repeated; where none is known nothing changes.
    """
    from scipy.spatial.transform import Rotation, Slerp

    at = np.flatnonzero(known)
    if len(at) in (0, len(known)):
        return rooted
    frames = np.clip(np.arange(len(known)), at[0], at[-1])
    pose = np.stack([np.interp(frames, at, values) for values in rooted.pose[at].T], axis=1)
    if len(at) == 1:
        return RootedPoses(np.repeat(rooted.base[at], len(known), axis=0), pose)
    base = Slerp(at, Rotation.from_matrix(rooted.base[at]))(frames).as_matrix()
    return RootedPoses(np.where(known[:, None, None], rooted.base, base), pose)
