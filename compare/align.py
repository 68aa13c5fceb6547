"""Rigid motions between an estimate's floor frame and the truth's, from points or from lines.

Every motion is a pose ``truth_T_estimate`` (3,): `geometry.transform_points` and
`geometry.line_to_floor` with it take points and lines of the estimate into the truth's frame. There
is no scale anywhere.
"""

from __future__ import annotations

import math

import numpy as np

from graphslam.geometry import (
    Array,
    compose,
    compose_jacobians,
    inverse,
    line_to_robot,
    points_on_line,
    position_along,
    rotation,
)
from graphslam.models.line import LINE

PARALLEL_DEG = 5.0
"""Lines fix no position along a direction that no normal leans towards by more than this."""
COINCIDENT = 1e-12
"""Points count as one where their spread is below this share of their distance from the origin."""
MAX_ITERATIONS = 50
STEP_TOLERANCE = 1e-12


def rigid_from_points(p: Array, q: Array, weights: Array | None = None) -> Array:
    """Returns the motion (3,) that takes points ``p`` nearest to ``q`` in least squares.

    Args:
        p: (N, 2) points, m, in the frame that moves.
        q: (N, 2) the same points in the frame that stays.
        weights: (N,) not negative; all 1 where None.

    Returns:
        ``q_T_p`` (3,), m and rad. Degenerate cases: without points (or weight) the identity; where
        all of ``p`` or all of ``q`` coincide, or every turn fits alike, no turn and the motion of
        the mean.

    Source: the closed form of Umeyama 1991, in the plane and without scale.
    """
    w = np.ones(len(p)) if weights is None else np.asarray(weights, float)
    total = w.sum()
    if total == 0.0:
        return np.zeros(3)
    mean_p, mean_q = w @ p / total, w @ q / total
    a, b = p - mean_p, q - mean_q
    dot = float(w @ (a * b).sum(axis=1))
    cross = float(w @ (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]))
    size = math.sqrt(float(w @ (p**2).sum(axis=1)) * float(w @ (q**2).sum(axis=1)))
    spread = math.sqrt(float(w @ (a**2).sum(axis=1)) * float(w @ (b**2).sum(axis=1)))
    turns = spread > COINCIDENT * size and math.hypot(cross, dot) > COINCIDENT * spread
    theta = math.atan2(cross, dot) if turns else 0.0
    return np.array([*(mean_q - rotation(theta) @ mean_p), theta])


def line_differences(
    frame: Array, lines: Array, s: Array, true_lines: Array
) -> tuple[Array, Array]:
    """Returns how lines differ from true ones at one of their points, and the Jacobian by `frame`.

    The line is taken as a sighting by a robot that stands on it, so that twins and wrapping are
    those of the line model and no lever arm enters.

    Args:
        frame: (..., 3) pose of the lines' frame in the true lines' frame.
        lines: (..., 2) lines, in their own frame.
        s: (...) positions along ``lines`` at which to compare, m.
        true_lines: (..., 2) lines to compare with, in the truth's frame.

    Returns:
        ``e`` (..., 2): line minus truth, offset across the line at ``s`` (m) and angle (rad);
        ``J_e_frame`` (..., 2, 3) for additive changes of ``frame``.
    """
    point = points_on_line(lines, s)
    here = np.concatenate([point, np.zeros_like(point[..., :1])], axis=-1)
    pose, J_pose_frame, _ = compose_jacobians(frame, here)
    residual, J_e_pose, _ = LINE.residual(pose, true_lines, line_to_robot(lines, here))
    return -residual, -J_e_pose @ J_pose_frame


def line_normals(lines: Array) -> Array:
    """Returns the unit normals (M, 2) of lines (M, 2), pointing to positive rho."""
    count = len(lines)
    return points_on_line(np.column_stack([np.ones(count), lines[:, 1]]), np.zeros(count))


def unobserved_direction(true_lines: Array) -> Array | None:
    """Returns the unit vector (2,) along which lines fix no position, or None where they fix both.

    Args:
        true_lines: (M, 2) with M >= 1; one line, or lines within `PARALLEL_DEG` of parallel.
    """
    normals = line_normals(true_lines)
    direction = np.linalg.eigh(normals.T @ normals)[1][:, 0]
    if np.abs(normals @ direction).max() >= math.sin(math.radians(PARALLEL_DEG)):
        return None
    return np.asarray(direction)


def rigid_from_lines(lines: Array, middle: Array, true_lines: Array, initial: Array) -> Array:
    """Returns the motion (3,) that takes estimated lines nearest to true ones in least squares.

    Minimised are the offsets at the middle of each seen stretch (m) and the differences in angle
    (rad), one radian counting as one metre, by Gauss-Newton. The motion turns about the mean of
    the middles: along a direction that the lines do not fix (see `unobserved_direction`) that
    point keeps the motion that ``initial`` gives it.

    Args:
        lines: (M, 2) estimated lines.
        middle: (M,) position of the middle of the seen stretch along each, m.
        true_lines: (M, 2) the true line of each; twins are equal.
        initial: (3,) ``truth_T_estimate`` to start from, turned by less than a quarter turn
            against the answer: the path's own motion.

    Returns:
        ``truth_T_estimate`` (3,), m and rad; ``initial`` where there are no lines.
    """
    if len(lines) == 0:
        return np.array(initial, float)
    centre = np.array([*points_on_line(lines, middle).mean(axis=0), 0.0])
    centred = line_to_robot(lines, centre)
    s = middle - position_along(lines, centre[:2])
    basis = np.eye(3)
    blind = unobserved_direction(true_lines)
    if blind is not None:
        basis = np.array([[-blind[1], 0.0], [blind[0], 0.0], [0.0, 1.0]])
    frame = compose(initial, centre)
    for _ in range(MAX_ITERATIONS):
        e, J = line_differences(frame, centred, s, true_lines)
        step = basis @ np.linalg.lstsq(J.reshape(-1, 3) @ basis, -e.ravel(), rcond=None)[0]
        frame = frame + step
        if np.abs(step).max() < STEP_TOLERANCE:
            break
    return compose(frame, inverse(centre))
