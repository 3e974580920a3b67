"""NumPy float64 twins of the kernels, written from the definitions and sharing no code with them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from person_skeleton import PARENT

from mmocap_warp.body.model import BodyModel, SkinMesh


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
    bind = [rigid(body.skeleton.frame[j].astype(float), body.joint_rest[j].astype(float)) for j in range(16)]
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
    bind = [rigid(body.skeleton.frame[j].astype(float), body.joint_rest[j].astype(float)) for j in range(16)]
    carry = np.stack([transforms[j] @ np.linalg.inv(bind[j]) for j in range(16)])
    rest = np.c_[mesh.rest.astype(float), np.ones(len(mesh.rest))]
    blended = np.einsum("vi,viab->vab", mesh.weight.astype(float), carry[mesh.joint])
    return np.einsum("vab,vb->va", blended, rest)[:, :3]


def project(points: np.ndarray, rotation_: np.ndarray, translation: np.ndarray, lens: np.ndarray) -> np.ndarray:
    """Pinhole image points (n, 2) of world points, ``lens`` is fx fy cx cy."""
    p = points @ rotation_.T + translation
    return lens[:2] * p[:, :2] / p[:, 2:] + lens[2:]


def covered(image: np.ndarray, faces: np.ndarray, width: int, height: int) -> np.ndarray:
    """Pixels (height, width) in a facing triangle, by exact integer edge tests a hair to the right of their centres.

    ``image`` is (vertex, 2) int, cells of a sixteenth of a pixel in whose middle the vertices lie.
    """
    hit = np.zeros((height, width), bool)
    corners = 2 * image.astype(np.int64)[faces] + 1  # (face, corner, 2) in half cells
    to_b, to_c = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    facing = corners[to_b[:, 0] * to_c[:, 1] < to_b[:, 1] * to_c[:, 0]]
    # Pixels outside of a triangle's bounding box are outside of the triangle: they are left out to save time.
    first = np.maximum(facing.min(axis=1) // 32, 0)
    end = np.minimum(facing.max(axis=1) // 32 + 1, (width, height))
    in_view = (first < end).all(axis=1)
    for p, (left, top), (right, bottom) in zip(facing[in_view], first[in_view], end[in_view], strict=True):
        x = 32 * np.arange(left, right)[None, :]
        y = 32 * np.arange(top, bottom)[:, None]
        inside = np.ones((bottom - top, right - left), bool)
        for (sx, sy), (ex, ey) in ((p[0], p[1]), (p[1], p[2]), (p[2], p[0])):
            side = (ex - sx) * (y - sy) - (ey - sy) * (x - sx)
            inside &= (side < 0) | ((side == 0) & (ey > sy))
        hit[top:bottom, left:right] |= inside
    return hit


def paper_cost(model: Sequence[np.ndarray], foreground: Sequence[np.ndarray]) -> float:
    """Eq. 4 and 5 of boolean images, one (height, width) a camera; infinite without any view."""

    def of_view(m: np.ndarray, f: np.ndarray) -> float:
        return (m & ~f).sum() / (2 * m.sum()) + (f & ~m).sum() / (2 * f.sum()) if m.any() else 1.0

    return _mean_over_views(of_view, model, foreground)


def xor_cost(model: Sequence[np.ndarray], foreground: Sequence[np.ndarray]) -> float:
    """Share of the pixels that differ."""
    return _mean_over_views(lambda m, f: (m ^ f).sum() / f.size, model, foreground)


def iou_cost(model: Sequence[np.ndarray], foreground: Sequence[np.ndarray]) -> float:
    """One less intersection over union."""
    return _mean_over_views(lambda m, f: 1 - (m & f).sum() / (m | f).sum(), model, foreground)


def _mean_over_views(
    of_view: Callable[[np.ndarray, np.ndarray], float], model: Sequence[np.ndarray], foreground: Sequence[np.ndarray]
) -> float:
    """Mean over the views that have foreground."""
    views = [of_view(m, f) for m, f in zip(model, foreground, strict=True) if f.any()]
    return float(np.mean(views)) if views else np.inf


@dataclass
class CmaEs:
    """The paper's CMA-ES (Table 2, Eq. 10-14) for one run, told what another sampled.

    ``x = mean + sigma * scale * y``; ``constants`` has Table 2's names. The factor for flat costs is left out.
    """

    mean: np.ndarray
    sigma: float
    scale: np.ndarray
    weights: np.ndarray
    constants: Mapping[str, float]

    def __post_init__(self) -> None:
        self.p_sigma, self.p_c = np.zeros_like(self.mean), np.zeros_like(self.mean)
        self.C = np.eye(len(self.mean))
        self.generation = 0
        self.stalls = 0

    def tell(self, x: np.ndarray, cost: np.ndarray) -> None:
        """Learn from offspring (particle, dof) and their costs (particle,)."""
        k, dofs = self.constants, len(self.mean)
        self.generation += 1
        parents = (x[np.argsort(cost, kind="stable")[: len(self.weights)]] - self.mean) / (self.sigma * self.scale)
        step = self.weights @ parents
        eigenvalues, B = np.linalg.eigh(self.C)
        whitened = B @ ((B.T @ step) / np.sqrt(eigenvalues))
        c_s, c_c, mu_eff, c_cov, share = k["c_sigma"], k["c_c"], k["mu_eff"], k["c_cov"], 1 / k["mu_cov"]
        self.mean = self.mean + self.sigma * self.scale * step
        self.p_sigma = (1 - c_s) * self.p_sigma + np.sqrt(c_s * (2 - c_s) * mu_eff) * whitened
        chi_n = np.sqrt(dofs) * (1 - 1 / (4 * dofs) + 1 / (21 * dofs**2))
        length = np.linalg.norm(self.p_sigma) / chi_n
        h = length / np.sqrt(1 - (1 - c_s) ** (2 * self.generation)) < 1.4 + 2 / (dofs + 1)
        self.stalls += not h
        self.p_c = (1 - c_c) * self.p_c + h * np.sqrt(c_c * (2 - c_c) * mu_eff) * step
        rank_one = np.outer(self.p_c, self.p_c) + (1 - h) * c_c * (2 - c_c) * self.C
        rank_mu = (self.weights[:, None] * parents).T @ parents
        self.C = (1 - c_cov) * self.C + c_cov * (share * rank_one + (1 - share) * rank_mu)
        self.sigma *= np.exp(c_s / k["d_sigma"] * (length - 1))
