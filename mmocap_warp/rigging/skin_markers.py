"""Virtual markers: named skin vertices at the sites of the Plug-in Gait marker set, found from the joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mmocap_warp.body.model import SkinMesh
from mmocap_warp.rigging.human import JOINTS

_OFF_RAY_PENALTY = 4.0  # how many times worse a vertex is for lying off the ray than for lying further in along it


@dataclass(frozen=True)
class _Site:
    """Where a ray from inside the body leaves the skin.

    The ray starts on the way from joint ``start`` to joint ``end``, moved by ``offset``, and only meets skin that
    follows one of ``parts``.
    """

    start: str
    end: str
    along: float
    offset: tuple[float, float, float]  # [body heights], in body axes
    direction: tuple[float, float, float]  # in the axes of joint `start`
    parts: tuple[str, ...]


_HEAD, _CHEST, _PELVIS = ("Neck",), ("UpperSpine", "Neck", "BottomSpine"), ("Root", "BottomSpine", "LHip", "RHip")

# Left and middle sites, by Plug-in Gait's names; a leading L has a mirror image on the right.
_SITES: dict[str, _Site] = {
    "LFHD": _Site("Neck", "Neck", 0.0, (0.0, 0.115, 0.015), (0.45, 0.0, 0.9), _HEAD),
    "LBHD": _Site("Neck", "Neck", 0.0, (0.0, 0.115, 0.015), (0.45, 0.0, -0.9), _HEAD),
    "C7": _Site("Neck", "Neck", 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), _CHEST),
    "T10": _Site("Root", "Neck", 0.67, (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), _CHEST),
    "CLAV": _Site("Root", "Neck", 0.91, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), _CHEST),
    "STRN": _Site("Root", "Neck", 0.71, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), _CHEST),
    "LSHO": _Site("LShoulder", "LShoulder", 0.0, (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), ("LShoulder", "UpperSpine")),
    "LUPA": _Site("LShoulder", "LElbow", 0.55, (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), ("LShoulder",)),
    "LELB": _Site("LElbow", "LElbow", 0.0, (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), ("LShoulder", "LElbow")),
    "LFRM": _Site("LElbow", "LWrist", 0.5, (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), ("LElbow",)),
    "LWRA": _Site("LWrist", "LWrist", 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), ("LElbow", "LWrist")),
    "LWRB": _Site("LWrist", "LWrist", 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), ("LElbow", "LWrist")),
    "LFIN": _Site("LElbow", "LWrist", 1.35, (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), ("LWrist",)),
    "LASI": _Site("LHip", "LHip", 0.0, (0.01, 0.045, 0.0), (0.0, 0.0, 1.0), _PELVIS),
    "LPSI": _Site("LHip", "Root", 0.55, (0.0, 0.055, 0.0), (0.0, 0.0, -1.0), _PELVIS),
    "LTHI": _Site("LHip", "LKnee", 0.55, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), ("LHip",)),
    "LKNE": _Site("LKnee", "LKnee", 0.0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), ("LHip", "LKnee")),
    "LTIB": _Site("LKnee", "LAnkle", 0.5, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), ("LKnee",)),
    "LANK": _Site("LAnkle", "LAnkle", 0.0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), ("LKnee", "LAnkle")),
    "LHEE": _Site("LAnkle", "LAnkle", 0.0, (0.0, -0.02, 0.0), (0.0, 0.0, -1.0), ("LAnkle",)),
    "LTOE": _Site("LAnkle", "LAnkle", 0.0, (0.005, -0.03, 0.07), (0.0, 1.0, 0.0), ("LAnkle",)),
}


def place_markers(
    skin: SkinMesh, joint_rest: np.ndarray, joint_frame: np.ndarray
) -> tuple[tuple[str, ...], np.ndarray]:
    """Names of the markers and their vertices (marker,) int32.

    Args:
        skin: the full mesh in its bind pose.
        joint_rest: (joint, 3), joint centres [m].
        joint_frame: (joint, 3, 3), joint axes in columns.
    """
    sites = dict(_SITES)
    sites |= {f"R{name[1:]}": _mirrored(site) for name, site in _SITES.items() if name.startswith("L")}
    vertex = [_ray_exit(site, skin, joint_rest, joint_frame) for site in sites.values()]
    return tuple(sites), np.array(vertex, np.int32)


def _mirrored(site: _Site) -> _Site:
    """The same site on the other side. A right joint's axes mirror the left one's, but for x, which is turned over."""

    def other(joint: str) -> str:
        return {"L": "R", "R": "L"}[joint[0]] + joint[1:] if joint[0] in "LR" and joint != "Root" else joint

    (ox, oy, oz), (dx, dy, dz) = site.offset, site.direction
    parts = tuple(other(part) for part in site.parts)
    return _Site(other(site.start), other(site.end), site.along, (-ox, oy, oz), (-dx, dy, dz), parts)


def _ray_exit(site: _Site, skin: SkinMesh, joint_rest: np.ndarray, joint_frame: np.ndarray) -> int:
    start, end = JOINTS.index(site.start), JOINTS.index(site.end)
    height = np.ptp(skin.rest[:, 1])
    origin = (1 - site.along) * joint_rest[start] + site.along * joint_rest[end] + height * np.array(site.offset)
    direction = joint_frame[start] @ np.array(site.direction)
    direction /= np.linalg.norm(direction)

    eligible = np.flatnonzero(np.isin(skin.heaviest_joint, [JOINTS.index(part) for part in site.parts]))
    away = skin.rest[eligible] - origin
    along = away @ direction
    off = np.linalg.norm(away - along[:, None] * direction, axis=1)
    return int(eligible[np.argmax(along - _OFF_RAY_PENALTY * off)])
