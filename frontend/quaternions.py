"""Orientations in space, as other programs write them, seen from above."""

from __future__ import annotations

import numpy as np

from graphslam.geometry import Array


def yaw(q: Array) -> Array:
    """Returns the headings (..., ), rad, of quaternions (..., 4) in the order x, y, z, w."""
    qx, qy, qz, qw = np.moveaxis(np.asarray(q, float), -1, 0)
    return np.asarray(np.arctan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy**2 + qz**2)))


def rotation(q: Array) -> Array:
    """Returns the rotation matrix (3, 3) of a quaternion (4,), x, y, z, w, of any length but 0."""
    x, y, z, w = np.asarray(q, float) / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
