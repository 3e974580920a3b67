"""NumPy's ``.npz``: all that is needed to pose the skin again, in arrays without pickles.

A vertex is at ``sum(weight * world[frame, joint] @ inverse(bind[joint]) @ rest)``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mmocap_warp.formats.exports.point_tracks import tracks_of
from mmocap_warp.result.result import Result
from mmocap_warp.whole_file import whole_file


def write_npz(result: Result, path: Path) -> None:
    """Write a result; ``np.load`` reads it, and docs/formats.md names its arrays.

    Raises:
        InputError: a folder that cannot be written to.
    """
    tracks = tracks_of(result)
    body = tracks.subject.body
    names, points = tracks.points()
    joints = len(body.skeleton.joints)
    with whole_file(path) as unfinished:
        np.savez_compressed(
            unfinished,
            frame=tracks.number,
            time=tracks.time,
            rate=np.array(tracks.rate),
            up=np.array(result.cameras.up),
            status=np.array(tracks.status),
            joint_names=np.array(names[:joints]),
            parent=np.array(body.skeleton.parent),
            joints=points[:, :joints],
            marker_names=np.array(names[joints:], str),
            markers=points[:, joints:],
            coordinate_names=np.array(body.skeleton.coordinate_names),
            pose=tracks.pose,
            root_base=tracks.subject.root_base,
            world=tracks.world,
            bind=tracks.bind,
            rest=body.skin.rest,
            face=body.skin.face,
            skin_joint=body.skin.joint,
            skin_weight=body.skin.weight,
            attribution=np.array(body.attribution),
        )
