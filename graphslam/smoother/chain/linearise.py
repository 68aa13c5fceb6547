"""All residuals and Jacobians of a problem at one point, whitened, one scalar residual a row.

Unknowns are *relative to the first pose*: its own change ``g`` carries the whole floor along, and
every other unknown is the change beyond that. Between poses and landmarks nothing depends on where
the floor lies, so their rows do not know ``g``; only what is tied to the floor itself does: the
start, sightings without landmarks, and those of fixed landmarks. A start known to a micrometre, or
to a kilometre, therefore costs the others no digits.
"""

# mypy: disallow-untyped-decorators=False, disallow-untyped-calls=False

from __future__ import annotations

import numpy as np
from numba import njit

from graphslam.geometry import Array
from graphslam.models.odometry import odometry_residual
from graphslam.models.pose_fix import POSE_FIX
from graphslam.smoother.chain.chunks import POSE, Linear
from graphslam.smoother.chain.residuals import FIRST_POSE, Residuals

BLOCK = 4096
"""Sightings linearised at a time, so that what is passed on stays in the processor's cache."""


def linearise(residuals: Residuals, pose: Array, params: Array, out: Linear) -> tuple[Array, float]:
    """Fills ``out`` at a path and a map.

    Returns:
        The start's rows as information of ``g`` (4, 4), right-hand side first; and the cost.
    """
    measurements = residuals.problem.measurements
    for batch in residuals.batches:
        for begin in range(0, len(batch.node), BLOCK):
            part = slice(begin, begin + BLOCK)
            node, landmark = batch.node[part], batch.landmark[part]
            here = _rows_of(pose, node, POSE)
            own = np.zeros((len(node), 0))
            if batch.model.dim_landmark:
                own = _rows_of(params, landmark, batch.model.dim_landmark)
            e, J_pose, J_other = batch.model.residual(here, own, batch.z[part])
            if not batch.free:
                J_other = J_pose @ carried_poses(here, pose[0])
            _whiten(batch.whitener[part], e, J_pose, J_other, batch.row[part], out.rows)
    increment = measurements.odometry.increment
    for begin in range(0, len(increment), BLOCK):
        part = slice(begin, min(begin + BLOCK, len(increment)))
        after = pose[begin + 1 : part.stop + 1]
        e, J_i, J_j = odometry_residual(pose[part], after, increment[part])
        _whiten_motion(residuals.motion[part], e, J_i, J_j, out.motion[part])
    e, J, _ = POSE_FIX.residual(pose[0], np.zeros(0), measurements.start_pose)
    rows = residuals.start @ np.column_stack([e, J])
    prior = rows.T @ rows
    total = squares(out.rows[:, 0]) + squares(out.motion[:, :, 0].ravel()) + prior[0, 0]
    return prior, 0.5 * float(total)


@njit(cache=True)
def _rows_of(values, row, wide):  # type: ignore[no-untyped-def]
    """Returns the first columns of some rows, in less than half the time that NumPy takes."""
    out = np.empty((len(row), wide))
    for k in range(len(row)):
        for a in range(wide):
            out[k, a] = values[row[k], a]
    return out


@njit(cache=True)
def _whiten(W, e, J_pose, J_other, row, rows):  # type: ignore[no-untyped-def]
    d, wide = J_other.shape[1], J_other.shape[2]
    for k in range(len(row)):
        for a in range(d):
            out = rows[row[k] + a]
            out[:] = 0.0
            for b in range(a + 1):
                w = W[k, a, b]
                out[0] += w * e[k, b]
                for c in range(POSE):
                    out[1 + c] += w * J_pose[k, b, c]
                for c in range(wide):
                    out[1 + POSE + c] += w * J_other[k, b, c]


@njit(cache=True)
def _whiten_motion(W, e, J_i, J_j, motion):  # type: ignore[no-untyped-def]
    for k in range(len(e)):
        for a in range(POSE):
            out = motion[k, a]
            out[:] = 0.0
            for b in range(a + 1):
                w = W[k, a, b]
                out[0] += w * e[k, b]
                for c in range(POSE):
                    out[1 + c] += w * J_i[k, b, c]
                    out[1 + POSE + c] += w * J_j[k, b, c]


@njit(cache=True)
def squares(values):  # type: ignore[no-untyped-def]
    """Returns the sum of squares, compensated: its error does not grow with their number.

    Compiled, because NumPy hands long arrays to several threads of BLAS, and these wait for each
    other: on a busy machine longer than a whole iteration takes.
    """
    total, lost = 0.0, 0.0
    for value in values:
        term = value * value - lost
        new = total + term
        lost = (new - total) - term
        total = new
    return total


def carried_poses(pose: Array, first: Array) -> Array:
    """Returns how poses move (k, 3, 3) when the first pose's change carries the floor along.

    Args:
        pose: (k, 3) floor frame.
        first: (3,) the first pose.
    """
    out = np.zeros((len(pose), POSE, POSE))
    out[:, 0, 0] = out[:, 1, 1] = out[:, 2, 2] = 1.0
    out[:, 0, 2] = first[1] - pose[:, 1]
    out[:, 1, 2] = pose[:, 0] - first[0]
    return out


@njit(cache=True)
def carry(pose, change, step):  # type: ignore[no-untyped-def]
    """Adds to ``step`` (N, 3) the poses' share of a ``change`` (3,) of the first one."""
    for i in range(len(pose)):
        step[i, 0] += change[0] - (pose[i, 1] - pose[0, 1]) * change[2]
        step[i, 1] += change[1] + (pose[i, 0] - pose[0, 0]) * change[2]
        step[i, 2] += change[2]


@njit(cache=True)
def carried_variables(rows, row_start, row_var, pose, count):  # type: ignore[no-untyped-def]
    """Returns what tells how landmarks move when the floor is carried along with the first pose.

    A row between a pose and a landmark does not change then: ``J_pose G_pose + J_landmark G = 0``.
    Returned are the normal equations' ``A`` (n, l, l) and ``b`` (n, l, 3) of each variable:
    ``G = A^-1 b``.
    """
    wide = rows.shape[1] - 1 - POSE
    A, b = np.zeros((count, wide, wide)), np.zeros((count, wide, POSE))
    for i in range(len(row_start) - 1):
        dx, dy = pose[i, 0] - pose[0, 0], pose[i, 1] - pose[0, 1]
        for r in range(row_start[i], row_start[i + 1]):
            v = row_var[r]
            if v == FIRST_POSE:
                continue
            x, y = rows[r, 1], rows[r, 2]
            turn = rows[r, 3] + y * dx - x * dy
            for q in range(wide):
                value = rows[r, 4 + q]
                b[v, q, 0] -= value * x
                b[v, q, 1] -= value * y
                b[v, q, 2] -= value * turn
                for p in range(wide):
                    A[v, q, p] += value * rows[r, 4 + p]
    return A, b
