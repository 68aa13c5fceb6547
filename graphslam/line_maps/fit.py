"""The rigid motion between matched lines of two maps, by their joint covariances."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from graphslam.errors import BadMeasurements
from graphslam.geometry import Array, points_on_line, transform_points, wrap
from graphslam.line_maps.line_map import LineMap, block_diagonal
from graphslam.measurements import IntArray
from graphslam.models.line import LINE

PARALLEL_DEG = 5.0
"""Lines fix no shift along a direction that no normal leans towards by more than this."""
FLOOR = (1e-4, 1e-4)
"""Standard deviations, m and rad, that stand for 0 where both maps know a line exactly."""
MAX_STEPS = 30
TOLERANCE = 1e-11
"""Relative decrease of the cost below which Gauss-Newton has converged."""


@dataclass(frozen=True, slots=True)
class Fit:
    """The motion that fits matched lines best in the metric of both covariances.

    Attributes:
        motion: (3,) ``a_T_b``, m and rad.
        information: (3, 3) of ``motion``, a's frame; singular where it is not fixed.
        basis: (3, k) changes of the motion that the lines fix.
        chi2: squared normalised residual that is left.
        freedom: its degrees of freedom, 2 K less k.
        residual: (K, 2) a's line minus b's in b's frame, by the name that b's line has.
        J: (2 K, k) Jacobian of ``residual`` by ``basis``.
        cov_a: (2 K, 2 K) covariance of ``residual`` that the first map's lines give it.
        cov_b: (2 K, 2 K) the same of the second map's.
    """

    motion: Array
    information: Array
    basis: Array
    chi2: float
    freedom: int
    residual: Array
    J: Array
    cov_a: Array
    cov_b: Array


def slide_direction(alpha: Array) -> Array | None:
    """Returns the unit vector (2,) along which lines with normals ``alpha`` (K,) fix no shift.

    None where they fix both directions.
    """
    normals = np.column_stack([np.cos(alpha), np.sin(alpha)])
    direction = np.linalg.eigh(normals.T @ normals)[1][:, 0]
    if np.abs(normals @ direction).max() >= math.sin(math.radians(PARALLEL_DEG)):
        return None
    # of the two names of a direction the one with the larger coordinate positive
    return np.asarray(direction * np.sign(direction[np.argmax(np.abs(direction))]))


def motion_basis(motion: Array, centre: Array, slide: Array | None) -> Array:
    """Returns (3, k) the changes of a motion that turn about ``centre`` (2,) or shift.

    Args:
        motion: (3,) ``a_T_b``.
        centre: (2,) in a's frame; b's point there stays when the motion turns.
        slide: (2,) direction along which no shift is allowed, or None.
    """
    x, y = motion[:2] - centre
    turn = np.array([[-y], [x], [1.0]])
    if slide is None:
        return np.hstack([np.eye(3)[:, :2], turn])
    return np.hstack([np.array([[-slide[1]], [slide[0]], [0.0]]), turn])


def fit_motion(a: LineMap, b: LineMap, matches: IntArray, start: Array, s: Array) -> Fit:
    """Returns the motion of b's frame in a's that fits matched lines best.

    Both joint covariances count, and the covariance of one map's line goes with the motion. Along
    a direction that the lines do not fix the motion keeps what ``start`` gives to the middle of
    the matched stretches.

    Args:
        a: first map.
        b: second map, independent of the first.
        matches: (K, 2) rows of both, K >= 1.
        start: (3,) ``a_T_b`` to start from.
        s: (K,) positions on b's lines where they were matched, m.
    """
    a, b = a.select(matches[:, 0]), b.select(matches[:, 1])
    motion = np.array(start, float)
    centre = transform_points(motion, points_on_line(b.lines, s)).mean(axis=0)
    slide = slide_direction(a.lines[:, 1])
    cost = math.inf
    for _ in range(MAX_STEPS):
        e, J, cov_a = _residuals(motion, a, b)
        basis = motion_basis(motion, centre, slide)
        root = covariance_root(cov_a + b.cov)
        white_J = np.linalg.solve(root, J.reshape(-1, 3))
        white_e = np.linalg.solve(root, e.ravel())
        step = np.linalg.lstsq(white_J @ basis, -white_e, rcond=None)[0]
        left = white_e + white_J @ basis @ step
        cost_now = float(left @ left)
        motion = motion + basis @ step
        motion[2] = wrap(motion[2])
        if cost - cost_now <= TOLERANCE * (1.0 + cost_now):
            break
        cost = cost_now
    return Fit(
        motion=motion,
        information=white_J.T @ white_J,
        basis=motion_basis(motion, centre, slide),
        chi2=cost_now,
        freedom=e.size - basis.shape[1],
        residual=LINE.residual(np.broadcast_to(motion, (len(a), 3)), a.lines, b.lines)[0],
        J=J.reshape(-1, 3) @ basis,
        cov_a=cov_a,
        cov_b=b.cov,
    )


def chi_square(e: Array, J: Array, cov: Array) -> float:
    """Returns the least squared normalised residual over the motion.

    Args:
        e: (2 K,) residual.
        J: (2 K, k) its Jacobian by the motion.
        cov: (2 K, 2 K) its covariance.
    """
    root = covariance_root(cov)
    white_J, white_e = np.linalg.solve(root, J), np.linalg.solve(root, e)
    left = white_e - white_J @ np.linalg.lstsq(white_J, white_e, rcond=None)[0]
    return float(left @ left)


def left_over(J: Array, cov: Array, metric: Array) -> Array:
    """Returns the covariance (2 K, 2 K) of residuals once a fitted motion is taken out of them.

    Args:
        J: (2 K, k) Jacobian of the residuals by the motion.
        cov: (2 K, 2 K) their covariance for a given motion.
        metric: (2 K, 2 K) covariance by which the motion was fitted, which may be another.
    """
    white = np.linalg.solve(metric, J)
    left = np.eye(len(J)) - J @ np.linalg.solve(J.T @ white, white.T)
    return np.asarray(left @ cov @ left.T)


def _residuals(motion: Array, a: LineMap, b: LineMap) -> tuple[Array, Array, Array]:
    """Returns residuals (K, 2), Jacobian (K, 2, 3) by the motion, and a's covariance of them."""
    at = np.broadcast_to(motion, (len(a), 3))
    e, J_motion, J_a = LINE.residual(at, a.lines, b.lines)
    J = block_diagonal(J_a)
    return e, J_motion, J @ a.cov @ J.T


def covariance_root(cov: Array, floor: tuple[float, float] = FLOOR) -> Array:
    """Returns the lower root of a covariance of lines.

    Standard deviations of 0, lines that are known exactly, become ``floor``, m and rad.

    What rounding made indefinite is lifted by 1e-9 of its variances.

    Raises:
        BadMeasurements: it is not positive definite.
    """
    variance = np.diagonal(cov)
    lifted = np.where(variance == 0.0, np.square(np.resize(floor, len(cov))), 0.0)
    cov = cov + np.diag(lifted)
    try:
        return np.asarray(np.linalg.cholesky(cov))
    except np.linalg.LinAlgError:
        pass
    try:
        return np.asarray(np.linalg.cholesky(cov + 1e-9 * np.diag(variance)))
    except np.linalg.LinAlgError:
        raise BadMeasurements(
            "the covariance of a map is not positive definite; make the map again, or leave its "
            "covariance out"
        ) from None
