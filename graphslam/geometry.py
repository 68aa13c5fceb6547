"""SE(2) and line algebra: the only place that wraps an angle or moves a line between frames.

A pose is ``(x, y, theta)``; as a transform it is ``floor_T_robot``. A line is ``(rho, alpha)`` with
``rho = x cos(alpha) + y sin(alpha)`` for its points (SantanaSLAM eq. (18)); the position of a point
along it is ``s = -x sin(alpha) + y cos(alpha)``. ``(rho, alpha)`` and its *twin*
``(-rho, alpha + pi)`` are the same line.

All functions broadcast over leading dimensions; metres and radians throughout.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, vectorize
from numpy.typing import NDArray

from graphslam.compiled import guvectorize

Array = NDArray[np.float64]

TAU = 2.0 * math.pi


@vectorize(["float64(float64)"], cache=True)
def wrap(angle):  # type: ignore[no-untyped-def]
    """Returns ``angle`` in (-pi, pi], elementwise; usable from compiled code too."""
    wrapped = angle - TAU * np.ceil((angle - math.pi) / TAU)
    if wrapped <= -math.pi or wrapped > math.pi:  # rounding next to an odd multiple of pi
        wrapped = math.pi
    return wrapped


def rotation(theta: Array | float) -> Array:
    """Returns the rotation matrices (..., 2, 2) that turn by ``theta`` rad counter-clockwise."""
    c, s = np.cos(theta), np.sin(theta)
    return np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], -2)


def compose(a: Array, b: Array) -> Array:
    """Returns the pose (..., 3) of ``b``, given in the frame of ``a``, in the parent frame of a.

    Args:
        a: (..., 3) poses, for example ``floor_T_robot``.
        b: (..., 3) poses in the frame of ``a``, for example an odometry increment.
    """
    a, b = np.asarray(a, float), np.asarray(b, float)
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    x = a[..., 0] + c * b[..., 0] - s * b[..., 1]
    y = a[..., 1] + s * b[..., 0] + c * b[..., 1]
    return np.stack([x, y, wrap(a[..., 2] + b[..., 2])], -1)


def inverse(a: Array) -> Array:
    """Returns the inverse transforms (..., 3) of the poses ``a`` (..., 3)."""
    a = np.asarray(a, float)
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    x, y = a[..., 0], a[..., 1]
    return np.stack([-c * x - s * y, s * x - c * y, wrap(-a[..., 2])], -1)


def between(a: Array, b: Array) -> Array:
    """Returns the pose (..., 3) of ``b`` in the frame of ``a``: ``inverse(a)`` then ``b``."""
    return compose(inverse(a), b)


def twist_motion(twist: Array) -> Array:
    """Returns the rigid motions (..., 3) that constant twists (..., 3) lead to in unit time.

    A twist is the velocity ``(x, y)`` of the origin, m, and a rate of turn, rad. It turns
    everything about one fixed point, or shifts it where the rate is 0; not wrapped.
    """
    twist = np.asarray(twist, float)
    half = 0.5 * twist[..., 2]
    sinc = np.sinc(half / math.pi)
    c, s = sinc * np.cos(half), sinc * np.sin(half)
    x = c * twist[..., 0] - s * twist[..., 1]
    y = s * twist[..., 0] + c * twist[..., 1]
    return np.stack([x, y, twist[..., 2]], -1)


def compose_jacobians(a: Array, b: Array) -> tuple[Array, Array, Array]:
    """Returns ``compose(a, b)`` and its Jacobians (..., 3, 3) with respect to a and b, additive."""
    a, b = np.asarray(a, float), np.asarray(b, float)
    out = compose(a, b)
    J_a = np.zeros((*out.shape, 3))
    J_a[..., 0, 0] = J_a[..., 1, 1] = J_a[..., 2, 2] = 1.0
    J_a[..., 0, 2] = -(out[..., 1] - a[..., 1])
    J_a[..., 1, 2] = out[..., 0] - a[..., 0]
    J_b = np.zeros_like(J_a)
    J_b[..., :2, :2] = np.broadcast_to(rotation(a[..., 2]), J_b[..., :2, :2].shape)
    J_b[..., 2, 2] = 1.0
    return out, J_a, J_b


def transform_points(pose: Array, points: Array) -> Array:
    """Returns ``points`` (..., 2), given in the frame of ``pose`` (..., 3), in its parent frame."""
    pose, points = np.asarray(pose, float), np.asarray(points, float)
    c, s = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    x = pose[..., 0] + c * points[..., 0] - s * points[..., 1]
    y = pose[..., 1] + s * points[..., 0] + c * points[..., 1]
    return np.stack([x, y], -1)


def interpolate_poses(t: Array, t_known: Array, poses: Array) -> Array:
    """Returns poses (N, 3) at times ``t`` (N,), linear in position and along the shorter turn.

    Times outside ``t_known`` (K,) are held at the first or last of ``poses`` (K, 3).
    """
    theta = np.unwrap(poses[:, 2])
    columns = [np.interp(t, t_known, column) for column in (poses[:, 0], poses[:, 1], theta)]
    columns[2] = wrap(columns[2])
    return np.stack(columns, -1)


# ---- covariances between frames ---------------------------------------------------------------


def rotate_covariance(cov: Array, theta: Array | float) -> Array:
    """Returns pose covariances (..., 3, 3) turned by ``theta`` rad: robot frame to floor frame.

    Only the position turns; heading variance is the same in both frames.
    """
    turn = np.zeros((*np.shape(theta), 3, 3))
    turn[..., :2, :2] = rotation(theta)
    turn[..., 2, 2] = 1.0
    return np.asarray(turn @ cov @ np.swapaxes(turn, -1, -2))


# ---- lines ------------------------------------------------------------------------------------


@njit(cache=True)
def predict_line(x, y, theta, rho, alpha):  # type: ignore[no-untyped-def]
    """Returns ``(rho, alpha)`` of a floor line in the robot frame, alpha not wrapped.

    Source: SantanaSLAM eq. (25) in the robot frame (``alpha_M = alpha_robot + pi/2``); its twin is
    eq. (26).
    """
    return rho - x * math.cos(alpha) - y * math.sin(alpha), alpha - theta


@guvectorize(["void(f8[:], f8[:], f8[:])"], "(l),(p)->(l)")
def _line_to_robot(line_floor, pose, out):  # type: ignore[no-untyped-def]
    out[0], alpha = predict_line(pose[0], pose[1], pose[2], line_floor[0], line_floor[1])
    out[1] = wrap(alpha)


def line_to_robot(line_floor: Array, pose: Array) -> Array:
    """Returns floor lines (..., 2) in the frame of ``pose``; alpha wrapped, rho signed.

    Source: SantanaSLAM eqs. (22)-(24), which give (25).
    """
    return np.asarray(_line_to_robot(line_floor, pose))


def line_to_floor(line_robot: Array, pose: Array) -> Array:
    """Returns robot-frame lines (..., 2) in the floor frame; the inverse of `line_to_robot`.

    Source: SantanaSLAM eqs. (22)-(24).
    """
    line_robot, pose = np.asarray(line_robot), np.asarray(pose)
    alpha = wrap(line_robot[..., 1] + pose[..., 2])
    rho = line_robot[..., 0] + pose[..., 0] * np.cos(alpha) + pose[..., 1] * np.sin(alpha)
    return np.stack([rho, alpha], -1)


def twin(line: Array) -> Array:
    """Returns the other name ``(-rho, alpha + pi)`` of lines (..., 2), alpha wrapped."""
    line = np.asarray(line)
    return np.stack([-line[..., 0], wrap(line[..., 1] + math.pi)], -1)


def is_canonical(line: Array) -> NDArray[np.bool_]:
    """Returns whether lines (..., 2) have rho >= 0; at rho = 0, alpha in (-pi/2, pi/2] decides."""
    line = np.asarray(line)
    rho, alpha = line[..., 0], wrap(line[..., 1])
    upper = (alpha > -math.pi / 2) & (alpha <= math.pi / 2)
    return np.asarray((rho > 0) | ((rho == 0) & upper))


def nearest_twin(line: Array, reference: Array) -> Array:
    """Returns for lines (..., 2) the twin whose alpha is within a quarter turn of ``reference``."""
    line, reference = np.asarray(line, float), np.asarray(reference, float)
    near = np.abs(wrap(line[..., 1] - reference[..., 1])) <= math.pi / 2
    return np.where(near[..., None], line, twin(line))


def points_on_line(line: Array, s: Array) -> Array:
    """Returns the points (..., 2) at positions ``s`` (...) metres along lines (..., 2)."""
    rho, alpha = np.asarray(line)[..., 0], np.asarray(line)[..., 1]
    c, sn = np.cos(alpha), np.sin(alpha)
    return np.stack([rho * c - s * sn, rho * sn + s * c], -1)


def position_along(line: Array, points: Array) -> Array:
    """Returns ``s = -x sin(alpha) + y cos(alpha)`` (...) of points (..., 2) on lines (..., 2)."""
    alpha = np.asarray(line)[..., 1]
    points = np.asarray(points)
    return np.asarray(-points[..., 0] * np.sin(alpha) + points[..., 1] * np.cos(alpha))


def line_through(p: Array, q: Array) -> Array:
    """Returns the canonical lines (..., 2) through distinct points ``p`` and ``q`` (..., 2)."""
    p, q = np.asarray(p, float), np.asarray(q, float)
    d = q - p
    alpha = np.arctan2(d[..., 0], -d[..., 1])
    rho = p[..., 0] * np.cos(alpha) + p[..., 1] * np.sin(alpha)
    line = np.stack([rho, wrap(alpha)], -1)
    return np.where(is_canonical(line)[..., None], line, twin(line))


def offset_error(d_line: Array, s: Array) -> Array:
    """Returns how far (...) a line lies off, across itself, at the position ``s`` along it.

    Args:
        d_line: (..., 2) small differences ``(d_rho, d_alpha)`` of a line.
        s: (...) positions along the line, metres.
    """
    d_line = np.asarray(d_line)
    return np.asarray(d_line[..., 0] - s * d_line[..., 1])


def distance_from_line(line: Array, points: Array) -> Array:
    """Returns ``x cos(alpha) + y sin(alpha) - rho`` (...) of points (..., 2), signed, metres."""
    line, points = np.asarray(line), np.asarray(points)
    c, s = np.cos(line[..., 1]), np.sin(line[..., 1])
    return np.asarray(points[..., 0] * c + points[..., 1] * s - line[..., 0])
