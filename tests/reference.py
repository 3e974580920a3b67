"""NumPy float64 twins of the kernels, written from the definitions and sharing no code with them."""

from __future__ import annotations

import numpy as np

from mmocap_warp.body import PARENT, BodyModel, SkinMesh


def rotation(axis: int, angle: float) -> np.ndarray:
    """The (3, 3) rotation about a coordinate axis."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turned = np.eye(3)
    turned[[i, j], [i, j]] = np.cos(angle)
    turned[i, j], turned[j, i] = -np.sin(angle), np.sin(angle)
    return turned


def rigid(turn: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """The (4, 4) transform ``[turn | origin]``."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turn, origin
    return matrix


def joint_transforms(body: BodyModel, root_base: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """World transforms (joint, 4, 4) of one full pose (51,)."""
    bind = [rigid(body.joint_frame[j].astype(float), body.joint_rest[j].astype(float)) for j in range(16)]
    world: list[np.ndarray] = []
    for j, parent in enumerate(PARENT):
        x, y, z = pose[3 + 3 * j : 6 + 3 * j]
        turn = rigid(rotation(2, z) @ rotation(1, y) @ rotation(0, x), np.zeros(3))
        if parent < 0:
            start = rigid(np.asarray(root_base, float) @ bind[0][:3, :3], pose[:3])
            world.append(start @ turn)
        else:
            world.append(world[parent] @ np.linalg.inv(bind[parent]) @ bind[j] @ turn)
    return np.stack(world)


def skin(mesh: SkinMesh, body: BodyModel, transforms: np.ndarray) -> np.ndarray:
    """Linear-blend skinned vertices (vertex, 3)."""
    bind = [rigid(body.joint_frame[j].astype(float), body.joint_rest[j].astype(float)) for j in range(16)]
    carry = np.stack([transforms[j] @ np.linalg.inv(bind[j]) for j in range(16)])
    rest = np.c_[mesh.rest.astype(float), np.ones(len(mesh.rest))]
    blended = np.einsum("vi,viab->vab", mesh.weight.astype(float), carry[mesh.joint])
    return np.einsum("vab,vb->va", blended, rest)[:, :3]


def project(points: np.ndarray, rotation_: np.ndarray, translation: np.ndarray, lens: np.ndarray) -> np.ndarray:
    """Pinhole image points (n, 2) of world points, ``lens`` is fx fy cx cy."""
    p = points @ rotation_.T + translation
    return lens[:2] * p[:, :2] / p[:, 2:] + lens[2:]


def covered(image: np.ndarray, faces: np.ndarray, width: int, height: int) -> np.ndarray:
    """Pixels (height, width) whose centre lies in or on the edge of a facing triangle, by exact integer edge tests.

    ``image`` is (vertex, 2) int in grid steps of a sixteenth of a pixel.
    """
    hit = np.zeros((height, width), bool)
    x = 16 * np.arange(width, dtype=np.int64)[None, :]
    y = 16 * np.arange(height, dtype=np.int64)[:, None]
    points = image.astype(np.int64)
    for corners in faces:
        p = points[corners]
        if np.any(p <= -(2**29)):
            continue
        (ax, ay), (bx, by), (cx, cy) = p
        if (bx - ax) * (cy - ay) - (by - ay) * (cx - ax) >= 0:
            continue
        inside = np.ones((height, width), bool)
        for (sx, sy), (ex, ey) in ((p[0], p[1]), (p[1], p[2]), (p[2], p[0])):
            inside &= (ex - sx) * (y - sy) - (ey - sy) * (x - sx) <= 0
        hit |= inside
    return hit


def paper_cost(model: np.ndarray, foreground: np.ndarray) -> float:
    """Eq. 4 and 5 of boolean images (camera, height, width)."""
    views = []
    for m, f in zip(model, foreground, strict=True):
        if not f.any():
            continue
        if not m.any():
            views.append(1.0)
            continue
        views.append((m & ~f).sum() / (2 * m.sum()) + (f & ~m).sum() / (2 * f.sum()))
    return float(np.mean(views))
