# SPDX-License-Identifier: Apache-2.0
"""Vectors and rotations outside the kernel: quaternions (w, x, y, z) and matrices, numpy arrays.

What goes into a model or a robot's state is made of elementwise operations only (no BLAS, no vectorised sine), so that it has the
same bits on every processor: only then can a recorded session be replayed bit for bit elsewhere.
"""

import math

import numpy as np

from sim_core.structure.arrays import Array


def dot(a: Array, b: Array) -> Array:
    """Scalar products over the last axis (length 3)."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]


def norm(a: Array) -> Array:
    """Lengths over the last axis (length 3)."""
    return np.sqrt(dot(a, a))


def unit(a: Array) -> Array:
    """A vector's direction, (3,)."""
    return a / norm(a)


def rotated(matrix: Array, vector: Array) -> Array:
    """Matrix times vector, (..., 3, 3) and (..., 3), broadcast."""
    return np.stack([dot(matrix[..., row, :], vector) for row in range(3)], axis=-1)


def product(a: Array, b: Array) -> Array:
    """Product of two (3, 3) matrices."""
    return np.stack([rotated(a, b[:, column]) for column in range(3)], axis=-1)


def relative_quaternion(base: Array, quaternions: Array) -> Array:
    """Unit quaternions (..., 4) as seen from an orientation `base` (4,)."""
    w, x, y, z = base * [1.0, -1.0, -1.0, -1.0]
    left = np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])
    return np.asarray(quaternions @ left.T)


def quaternion_of(matrix: Array) -> Array:
    """Unit quaternion (w, x, y, z) of a rotation matrix, shape (3, 3); its largest component is positive (Shepperd's method)."""
    m = [[float(value) for value in row] for row in np.asarray(matrix)]
    trace = m[0][0] + m[1][1] + m[2][2]
    squares = [trace, m[0][0], m[1][1], m[2][2]]
    largest = squares.index(max(squares))
    if largest == 0:
        parts = [1.0 + trace, m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]]
    else:
        i = largest - 1
        j, k = (i + 1) % 3, (i + 2) % 3
        parts = [m[k][j] - m[j][k], 0.0, 0.0, 0.0]
        parts[1 + i] = 1.0 + m[i][i] - m[j][j] - m[k][k]
        parts[1 + j] = m[j][i] + m[i][j]
        parts[1 + k] = m[k][i] + m[i][k]
    length = math.sqrt(parts[0] * parts[0] + parts[1] * parts[1] + parts[2] * parts[2] + parts[3] * parts[3])
    return np.array([part / length for part in parts])


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
    v, c = np.cross(source, target), float(dot(source, target))
    if c < -1.0 + 1e-12:  # opposite: half a turn about any axis across
        axis = unit(np.cross(source, np.eye(3)[np.argmin(np.abs(source))]))
        return np.asarray(2.0 * axis[:, None] * axis - np.eye(3))
    cross = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    return np.asarray(np.eye(3) + cross + product(cross, cross) / (1.0 + c))


def best_fit(body: Array, world: Array) -> Array:
    """The proper rotation R that best carries centred `body` points onto centred `world` points, both (n, 3) (Kabsch)."""
    u, _, vt = np.linalg.svd((world - world.mean(axis=0)).T @ (body - body.mean(axis=0)))
    return np.asarray(u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt)


def about_z(angle_rad: float) -> Array:
    """Rotation matrix about the vertical."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def down_of(gravity: Array) -> Array:
    """Direction of gravity, (3,); straight down where there is none."""
    return unit(gravity) if np.any(gravity) else np.array([0.0, 0.0, -1.0])
