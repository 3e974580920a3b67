"""Rotations of many frames at a time; the body's convention is ``Rz @ Ry @ Rx`` on column vectors."""

import numpy as np

_PSI = 1.533751168755204288118041  # the real root of psi^4 = psi + 4
_PLANE = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}


def axis_vector(axis: str) -> np.ndarray:
    """(3,) unit vector of a signed axis, such as ``-x``."""
    return np.eye(3)["xyz".index(axis[1])] * (1.0 if axis[0] == "+" else -1.0)


def quarter_turn(up: str, new: str) -> np.ndarray:
    """(3, 3) rotation by quarter turns that takes one signed axis to another."""
    source, target = axis_vector(up), axis_vector(new)
    across = np.cross(source, target)
    if across.any():  # a quarter turn
        return np.outer(target, source) - np.outer(source, target) + np.outer(across, across)
    about = axis_vector("+z" if up[1] == "x" else "+x")
    return 2 * np.outer(about, about) - np.eye(3)


def turn(axis: str, angle: np.ndarray | float) -> np.ndarray:
    """(..., 3, 3) rotations about one axis by angles (...) [rad]."""
    a, b = _PLANE[axis]
    angle = np.asarray(angle, float)
    matrix = np.zeros((*angle.shape, 3, 3))
    matrix[...] = np.eye(3)
    matrix[..., a, a] = matrix[..., b, b] = np.cos(angle)
    matrix[..., b, a] = np.sin(angle)
    matrix[..., a, b] = -matrix[..., b, a]
    return matrix


def zyx_rotation(angles: np.ndarray) -> np.ndarray:
    """(..., 3, 3) rotations ``Rz @ Ry @ Rx`` of angles Rx, Ry, Rz (..., 3) [rad]."""
    return turn("z", angles[..., 2]) @ turn("y", angles[..., 1]) @ turn("x", angles[..., 0])


def zyx_angles(rotation: np.ndarray) -> np.ndarray:
    """(..., 3) angles Rx, Ry, Rz [rad] of rotations ``Rz @ Ry @ Rx``, (..., 3, 3); away from Ry = 90 degrees."""
    x = np.arctan2(rotation[..., 2, 1], rotation[..., 2, 2])
    y = -np.arcsin(np.clip(rotation[..., 2, 0], -1.0, 1.0))
    z = np.arctan2(rotation[..., 1, 0], rotation[..., 0, 0])
    return np.stack([x, y, z], axis=-1)


def spread_rotations(count: int) -> np.ndarray:
    """(count, 3, 3) rotations spread evenly over all there are: a super-Fibonacci spiral (Alexa 2022)."""
    number = np.arange(count) + 0.5
    share = number / count
    first, second = 2 * np.pi * number / np.sqrt(2), 2 * np.pi * number / _PSI
    x, y = np.sqrt(share) * np.sin(first), np.sqrt(share) * np.cos(first)
    z, w = np.sqrt(1 - share) * np.sin(second), np.sqrt(1 - share) * np.cos(second)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )
    return np.moveaxis(np.array(rows), -1, 0)


def transposed(rotation: np.ndarray) -> np.ndarray:
    """The inverse rotations."""
    return np.swapaxes(rotation, -1, -2)


def applied(rotation: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """``rotation @ vector`` for (..., 3, 3) and (..., 3)."""
    return np.einsum("...ij,...j->...i", rotation, vector)


def continuous_zyx_angles(rotation: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """(frame, 3) angles Rx, Ry, Rz [rad] of rotations (frame, 3, 3), each frame's as near to the last's as possible.

    A rotation has two such triples, and each angle may have whole turns added: of those within ``limits`` (3, 2)
    the nearest is taken, in the first frame to zero; where none is within, the nearest of all.
    """
    x, y, z = np.moveaxis(zyx_angles(rotation), -1, 0)
    triples = np.stack([np.stack([x, y, z], axis=-1), np.stack([x + np.pi, np.pi - y, z + np.pi], axis=-1)], axis=1)
    turns = 2 * np.pi * np.stack(np.meshgrid(*[(-1, 0, 1)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    chosen = np.zeros((len(rotation), 3))
    last = np.zeros(3)
    for frame, triple in enumerate(triples):
        candidates = (triple[:, None] + turns).reshape(-1, 3)
        allowed = ((candidates >= limits[:, 0]) & (candidates <= limits[:, 1])).all(axis=1)
        distance = np.abs(candidates - last).sum(axis=1)
        last = chosen[frame] = candidates[np.argmin(np.where(allowed | ~allowed.any(), distance, np.inf))]
    return chosen


def near_zyx_angles(rotation: np.ndarray, near: np.ndarray) -> np.ndarray:
    """(..., 3) angles Rx, Ry, Rz [rad] of rotations (..., 3, 3): of each one's triples the nearest to ``near``.

    They are right everywhere: where Ry is 90 degrees, and only the sum or difference of the others is known, Rx is
    what rounding makes of it, and Rz follows from it.
    """
    x, y, _ = np.moveaxis(zyx_angles(rotation), -1, 0)
    triples = []
    for x_way, y_way in ((x, y), (x + np.pi, np.pi - y)):
        about_z = rotation @ transposed(turn("y", y_way) @ turn("x", x_way))
        triple = np.stack([x_way, y_way, np.arctan2(about_z[..., 1, 0], about_z[..., 0, 0])], axis=-1)
        triples.append(triple + 2 * np.pi * np.round((near - triple) / (2 * np.pi)))
    one, other = triples
    nearer = np.abs(one - near).sum(axis=-1, keepdims=True) <= np.abs(other - near).sum(axis=-1, keepdims=True)
    return np.where(nearer, one, other)


def between(first: np.ndarray, second: np.ndarray, share: np.ndarray) -> np.ndarray:
    """(..., 3, 3) rotations on the shortest way from ``first`` to ``second``, at ``share`` (...) of it."""
    from scipy.spatial.transform import Rotation

    way = Rotation.from_matrix((transposed(first) @ second).reshape(-1, 3, 3)).as_rotvec()
    part = Rotation.from_rotvec(way * np.broadcast_to(share, first.shape[:-2]).reshape(-1, 1)).as_matrix()
    return first @ part.reshape(first.shape)


def quaternions(rotation: np.ndarray) -> np.ndarray:
    """(..., 4) unit quaternions x, y, z, w of rotations (..., 3, 3)."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(rotation.reshape(-1, 3, 3)).as_quat().reshape(*rotation.shape[:-2], 4)


def nearest_rotation(matrix: np.ndarray) -> np.ndarray:
    """(..., 3, 3) the rotations nearest to some matrices, which may be scaled; of a mirrored one, to its negative.

    To turn round all axes of a mirrored matrix is the one choice that does not change from frame to frame.
    """
    u, _, vt = np.linalg.svd(matrix)
    factor = u @ vt
    return factor * np.sign(np.linalg.det(factor))[..., None, None]
