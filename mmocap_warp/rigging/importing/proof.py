"""An import proves itself: the body's outline beside the file's own skin, and its joints beside the file's motions."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mmocap_warp.body.model import BodyModel, BodyMotion, Subject
from mmocap_warp.body.posing import skin_positions
from mmocap_warp.cameras.silhouette import intersection_over_union, silhouette
from mmocap_warp.device.resolve import start_quietly
from mmocap_warp.formats.rigged.rigged_mesh import RiggedMesh, skinned

SAME_OUTLINE = 0.97
"""Overlap (intersection over union) of tracking mesh and file's skin in a view, below which a user is told."""
FEW_STRAY, MANY_STRAY = 0.01, 0.05
"""How far joints may be from the file's own, as a share of the body's length: beyond, it is said, or a check fails."""

_VIEWS = {"the front": (0, 1), "the left": (2, 1), "above": (0, 2)}  # which axes of the body the picture has
_SIDE, _MARGIN = 640, 16  # of a picture, along the body's longest side, and around it [px]
_MOST_MOTIONS = 4  # motions whose middle frame is drawn, besides the bind pose


@dataclass(frozen=True)
class Outline:
    """Where the tracking mesh and the file's skin look least alike."""

    overlap: float  # intersection over union
    view: str  # what was drawn, and from where
    picture: np.ndarray  # BGR: what both cover is grey, the skin alone red, the tracking mesh alone blue


def worst_outline(body: BodyModel, mesh: RiggedMesh, motions: Mapping[str, BodyMotion]) -> Outline:
    """The view in which the tracking mesh differs most from the skin that the file's own joints move.

    Both are drawn from three sides in the bind pose and in the middle of up to four motions. The mesh is in the body's
    axes, with the body's joints.
    """
    frames = [("in the bind pose", mesh.bind, _bind_pose(body))]
    names = list(motions)
    for name in names[:: max(1, -(-len(names) // _MOST_MOTIONS))]:
        middle = len(motions[name].pose) // 2
        frames.append((f"in motion {name}", mesh.motions[name].world[middle], motions[name].pose[middle]))
    start_quietly()
    subject = Subject(body, np.eye(3), _bind_pose(body), {})
    tracked = skin_positions(subject, np.stack([pose for *_, pose in frames]), body.tracking_vertex)
    views = []
    for (when, world, _), posed in zip(frames, tracked, strict=True):
        skin = skinned(mesh, world)
        for view, axes in _VIEWS.items():
            low, high = (end([skin.min(axis=0), skin.max(axis=0)], axis=0) for end in (np.min, np.max))
            scale = _SIDE / max(float(np.max(high - low)), 1e-9)
            width, height = (np.ceil(scale * (high - low)[list(axes)]).astype(int) + 2 * _MARGIN).tolist()
            own, other = (
                silhouette((points - low)[:, list(axes)] * scale + _MARGIN, face, (width, height)) > 0
                for points, face in ((skin, mesh.face), (posed, body.tracking_face))
            )
            views.append(Outline(intersection_over_union(own, other), f"{when} from {view}", _compared(own, other)))
    return min(views, key=lambda outline: outline.overlap)


def _bind_pose(body: BodyModel) -> np.ndarray:
    pose = np.zeros(body.skeleton.coordinates)
    pose[:3] = body.joint_rest[0]
    return pose


def _compared(own: np.ndarray, other: np.ndarray) -> np.ndarray:
    picture = np.full((*own.shape, 3), 255, np.uint8)
    picture[own & other], picture[own & ~other], picture[other & ~own] = (170, 170, 170), (40, 40, 220), (220, 120, 40)
    return picture[::-1]


def strays(body: BodyModel, mesh: RiggedMesh, motions: Mapping[str, np.ndarray]) -> tuple[list[str], str]:
    """What is said of joints' distances (frame, joint) [m] from the file's in each motion, and the failed check if any.

    Bones of a body keep their lengths; an animator's may stretch for some frames, which is said. A body fails where the
    root mean square of its worst joint is large in most motions.
    """
    size = float(np.ptp(mesh.vertex, axis=0).max())
    shares = {name: float(apart.max()) / size for name, apart in motions.items()}
    lines = []
    for name, share in shares.items():
        far = f"; {_farthest(body, motions[name])} is {share:.1%} of its length off" if share > FEW_STRAY else ""
        within = f"joints within {1000 * size * share:.1f} mm of the file's"
        lines.append(f"motion {name}: {len(motions[name])} frames, {within}{far}")
    typical = [float(np.sqrt((apart**2).mean(axis=0)).max()) / size for apart in motions.values()]
    middle = float(np.median(typical)) if typical else 0.0
    if middle <= MANY_STRAY:
        return lines, ""
    worst = list(motions)[int(np.argmax(typical))]
    return lines, (
        f"joints are {middle:.0%} of its length from where the file's own motions have them, "
        f"most of all {_farthest(body, motions[worst])} in {worst}: "
        "bones of a body keep their lengths, the file's do not"
    )


def _farthest(body: BodyModel, apart: np.ndarray) -> str:
    return body.skeleton.joints[int(apart.max(axis=0).argmax())]
