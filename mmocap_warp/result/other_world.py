"""Truth that is right, but in another world than the result: other axes, another origin or other units."""

import re
from itertools import product
from typing import Any

import numpy as np

_FAR = 0.5  # metres: joints of a body that is tracked well in its own world are nearer than this to the truth
_ELSEWHERE = 0.3  # metres: a body in another world is farther off as a whole; one that is back to front is not
_NEAR = 0.15  # metres: a change of the world explains an error that it brings below this; nothing explains a lost body


def other_world(tracked: np.ndarray, known: np.ndarray) -> dict[str, Any] | None:
    """How a truth must be turned, shifted and scaled to fit a result from which it is far off; None where it is not.

    Args:
        tracked: (frame, joint, 3) [m].
        known: likewise, the truth; NaN where it is unknown.

    Returns:
        ``axes``, which of the truth's axes are the world's x, y and z, such as ``zxy`` (None where axes alone do not
        explain the error); ``mpjpe_mm``, the mean distance once the truth is changed; ``scale`` in times, ``turn_deg``
        and ``shift_m``, of the best similarity transform of all frames together.
    """
    seen = np.isfinite(known).all(axis=2)
    if seen.sum() < 3:
        return None
    x, y = tracked[seen], known[seen]
    far = _mean_distance(x, y)
    if far < _FAR or np.linalg.norm(x.mean(axis=0) - y.mean(axis=0)) < _ELSEWHERE:
        return None
    error, axes = min((_mean_distance(x, y @ axes_turn(axes).T), axes) for axes in _AXES)
    scale, turn, shift = _similarity(y, x)
    fitted = _mean_distance(x, scale * y @ turn.T + shift)
    by_axes = error <= _NEAR
    if not by_axes and fitted > _NEAR:
        return None
    return {
        "axes": axes if by_axes else None,
        "mpjpe_mm": 1000 * (error if by_axes else fitted),
        "scale": scale,
        "turn_deg": np.degrees(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1))),
        "shift_m": np.linalg.norm(shift),
    }


def axes_turn(axes: str) -> np.ndarray:
    """(3, 3) whose product with a point is the point whose x, y and z are these axes of it, such as ``x-zy``."""
    turn = np.zeros((3, 3))
    for row, letter in zip(turn, re.findall("-?[xyz]", axes), strict=True):
        row["xyz".index(letter[-1])] = -1.0 if letter[0] == "-" else 1.0
    return turn


def axes_after(axes: str, others: str) -> str:
    """The axes that have the effect of taking ``others`` first, and then ``axes`` of the outcome."""
    turn = axes_turn(axes) @ axes_turn(others)
    return "".join(("-" if row.min() < 0 else "") + "xyz"[int(np.abs(row).argmax())] for row in turn)


_TRIPLES = map("".join, product(("x", "y", "z", "-x", "-y", "-z"), repeat=3))
_AXES = [axes for axes in _TRIPLES if np.linalg.det(axes_turn(axes)) > 0]  # right-handed, no axis twice


def _mean_distance(x: np.ndarray, y: np.ndarray) -> float:
    return float(np.linalg.norm(x - y, axis=-1).mean())


def _similarity(points: np.ndarray, target: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Scale, rotation (3, 3) and shift (3,) that bring ``points`` (n, 3) closest to ``target``."""
    centre, middle = points.mean(axis=0), target.mean(axis=0)
    u, s, vt = np.linalg.svd((target - middle).T @ (points - centre))
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])  # a rotation, not a mirror
    turn = (u * sign) @ vt
    scale = float((s * sign).sum() / max(((points - centre) ** 2).sum(), np.finfo(float).tiny))
    return scale, turn, middle - scale * turn @ centre
