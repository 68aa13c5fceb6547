"""The motion model: how two poses contradict an increment, and where one leads."""

from __future__ import annotations

import math

import numpy as np

from graphslam.compiled import guvectorize
from graphslam.geometry import Array, wrap


@guvectorize(
    ["void(f8[:], f8[:], f8[:], f8[:], f8[:,:], f8[:,:])"],
    "(p),(p),(p)->(p),(p,p),(p,p)",
)
def odometry_residual(pose_i, pose_j, increment, e, J_e_i, J_e_j):  # type: ignore[no-untyped-def]
    """Returns ``between(pose_i, pose_j) - increment`` and its Jacobians, frame of node i.

    Args:
        pose_i: (..., 3) floor frame.
        pose_j: (..., 3) floor frame.
        increment: (..., 3) measured motion, frame of node i.

    Returns:
        ``e`` (..., 3), m and rad, angle wrapped; ``J_e_i`` and ``J_e_j`` (..., 3, 3) for additive
        changes of the floor-frame poses.

    Source: SantanaSLAM eq. (8) solved for the motion; eq. (15) is ``-inv(J_e_j) J_e_i``.
    """
    c, s = math.cos(pose_i[2]), math.sin(pose_i[2])
    dx, dy = pose_j[0] - pose_i[0], pose_j[1] - pose_i[1]
    x, y = c * dx + s * dy, -s * dx + c * dy
    e[0], e[1] = x - increment[0], y - increment[1]
    e[2] = wrap(pose_j[2] - pose_i[2] - increment[2])
    for row in range(3):
        for col in range(3):
            J_e_i[row, col] = 0.0
            J_e_j[row, col] = 0.0
    J_e_j[0, 0], J_e_j[0, 1], J_e_j[1, 0], J_e_j[1, 1], J_e_j[2, 2] = c, s, -s, c, 1.0
    J_e_i[0, 0], J_e_i[0, 1], J_e_i[0, 2] = -c, -s, y
    J_e_i[1, 0], J_e_i[1, 1], J_e_i[1, 2] = s, -c, -x
    J_e_i[2, 2] = -1.0


def transition(
    pose_i: Array, pose_j: Array, increment: Array, cov: Array
) -> tuple[Array, Array, Array]:
    """Returns the linear motion model at two given poses: ``F``, ``Q`` and the offset.

    With deviations ``d`` from the given poses, ``d_j = F d_i + offset + noise``, noise of
    covariance ``Q``. It is the linearised `odometry_residual` solved for pose j, so that whoever
    predicts with it and whoever smooths with the residual use one and the same line.

    Args:
        pose_i: (..., 3) floor frame.
        pose_j: (..., 3) floor frame; where it is ``compose(pose_i, increment)`` the offset is 0.
        increment: (..., 3) measured motion, frame of node i.
        cov: (..., 3, 3) its covariance, frame of node i.

    Returns:
        ``F`` (..., 3, 3), ``Q`` (..., 3, 3) and offset (..., 3), all in the floor frame.

    Source: SantanaSLAM eqs. (2), (15).
    """
    e, J_e_i, J_e_j = odometry_residual(pose_i, pose_j, increment)
    inverse = np.linalg.inv(J_e_j)
    F = -inverse @ J_e_i
    Q = inverse @ cov @ np.swapaxes(inverse, -1, -2)
    return F, Q, -(inverse @ e[..., None])[..., 0]


def process_covariance(dt: Array, rate: float) -> Array:
    """Returns covariances (N, 3, 3) of increments that say nothing of wheels, only of time.

    The same along x and y, so that robot and floor frame agree on it.

    Args:
        dt: (N,) seconds that each increment lasts.
        rate: standard deviation gathered in a second, m/s along x and y, rad/s of the heading.

    Source: Atali section 4, Q = diag(n_p^2, n_p^2, n_p^2) with n_p = 2 dt (m/s).
    """
    return np.square(rate * np.asarray(dt, float))[:, None, None] * np.eye(3)
