"""Rotations outside the kernel: quaternions (w, x, y, z) and matrices, numpy arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def quaternion_of(matrix: Array) -> Array:
    """Unit quaternion (w, x, y, z) of a proper rotation matrix, shape (3, 3); w or the largest component positive."""
    m = np.asarray(matrix)
    # Bar-Itzhack: the quaternion is the dominant eigenvector of K, whatever the rotation
    k = np.array(
        [
            [m[0, 0] + m[1, 1] + m[2, 2], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]],
            [0.0, m[0, 0] - m[1, 1] - m[2, 2], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0]],
            [0.0, 0.0, m[1, 1] - m[0, 0] - m[2, 2], m[1, 2] + m[2, 1]],
            [0.0, 0.0, 0.0, m[2, 2] - m[0, 0] - m[1, 1]],
        ]
    )
    q = np.linalg.eigh(k + np.triu(k, 1).T)[1][:, -1]
    return q * (1.0 if q[np.argmax(np.abs(q))] > 0 else -1.0)


def matrix_of(quaternion: Array) -> Array:
    """Rotation matrices of unit quaternions, (..., 4) -> (..., 3, 3)."""
    w, x, y, z = np.moveaxis(np.asarray(quaternion), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def turn_onto(source: Array, target: Array) -> Array:
    """The smallest rotation matrix that carries unit vector `source` onto unit vector `target`."""
    v, c = np.cross(source, target), float(np.dot(source, target))
    if c < -1.0 + 1e-12:  # opposite: half a turn about any axis across
        axis = np.cross(source, np.eye(3)[np.argmin(np.abs(source))])
        axis /= np.linalg.norm(axis)
        return 2.0 * np.outer(axis, axis) - np.eye(3)
    cross = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    return np.eye(3) + cross + cross @ cross / (1.0 + c)


def best_fit(body: Array, world: Array) -> Array:
    """The proper rotation R that best carries centred `body` points onto centred `world` points, both (n, 3) (Kabsch)."""
    u, _, vt = np.linalg.svd((world - world.mean(axis=0)).T @ (body - body.mean(axis=0)))
    return u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt


def about_z(angle_rad: float) -> Array:
    """Rotation matrix about the vertical."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
