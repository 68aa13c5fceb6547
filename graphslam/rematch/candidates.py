"""Which sightings and landmarks may belong together: bounds that need no correlations."""

# mypy: disallow-untyped-decorators=False

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from graphslam.association import gate_for, labels_agree
from graphslam.config import RematchConfig
from graphslam.geometry import Array
from graphslam.measurements import IntArray, Sightings
from graphslam.models import Model
from graphslam.rematch.fitted import Fitted, table_of
from graphslam.rematch.reach import close_pairs
from graphslam.rematch.spread import Spread

CHUNK = 200_000
"""Pairs of sighting and landmark that are looked at in one go."""


def within_reach(
    fitted: Fitted, model: Model, table: Sightings, landmarks: IntArray, config: RematchConfig
) -> tuple[IntArray, IntArray]:
    """Returns rows of the table and landmarks that could lie within the wide gate, labels alike.

    Two bounds of a residual's covariance need no correlations, which are dear, and so lose no pair:
    the covariance of a sum is at most twice the sum of the covariances; and it is at most what
    odometry alone makes of the nearest sighting of the landmark.
    """
    gate, dim = gate_for(config.gate_new, model.dim_z), model.dim_landmark
    row, column = close_pairs(fitted, model, table, landmarks, config)
    cov_map = np.zeros((len(fitted.problem.kinds), dim, dim))
    cov_map[landmarks] = fitted.landmark_cov(landmarks, landmarks, dim)
    seen = _Seen.of(fitted, model, table)
    kept = [np.zeros(0, np.int64)]
    for begin in range(0, len(row), CHUNK):
        part = slice(begin, begin + CHUNK)
        of, node = landmarks[column[part]], table.node[row[part]]
        params = fitted.problem.params[of, :dim]
        e, J_p, J_l = model.residual(fitted.problem.pose[node], params, table.z[row[part]])
        near = _near(
            (row[part], node, of),
            (e, J_p, J_l, table.cov),
            (fitted.cov_pose, cov_map),
            (seen.start, seen.node, seen.back, seen.total, fitted.problem.pose),
            gate,
        )
        kept.append(begin + np.flatnonzero(near))
    pairs = np.concatenate(kept)
    row, landmark = row[pairs], landmarks[column[pairs]]
    alike = labels_agree(table.label[row], fitted.label[landmark])
    row, landmark = row[alike], landmark[alike]
    order = np.lexsort((landmark, row))
    return row[order], landmark[order]


@dataclass(frozen=True, slots=True)
class _Seen:
    """The sightings of each landmark, in order, and what each would start.

    Attributes:
        start: (M + 1,) where each landmark's begin.
        node: (k,) their nodes.
        back: (k, l, l) covariances of what each sighting alone makes of its landmark, the pose
            being exact.
        total: (N, 3, 3) as in `Spread`.
    """

    start: IntArray
    node: IntArray
    back: Array
    total: Array

    @staticmethod
    def of(fitted: Fitted, model: Model, table: Sightings) -> _Seen:
        """Returns what a table's sightings say; nothing where no single one starts a landmark."""
        problem, dim = fitted.problem, model.dim_landmark
        odometry = problem.measurements.odometry
        weighted = odometry.cov / problem.odometry_weight[:, None, None]
        total = Spread(problem.pose, replace(odometry, cov=weighted)).total
        first, _ = table_of(problem, model.kind)
        match = problem.match[first : first + len(table)]
        weight = problem.weight[first : first + len(table)]
        rows = np.flatnonzero((match >= 0) & (weight > 0.0) & (model.dim_z == dim))
        rows = rows[np.lexsort((table.node[rows], match[rows]))]
        node, landmark = table.node[rows], match[rows]
        start = np.searchsorted(landmark, np.arange(len(problem.kinds) + 1)).astype(np.int64)
        if not len(rows):
            return _Seen(start, node, np.zeros((0, dim, dim)), total)
        _, _, J = model.residual(problem.pose[node], problem.params[landmark, :dim], table.z[rows])
        back = np.linalg.inv(J)
        cov = back @ (table.cov[rows] / weight[rows, None, None]) @ np.swapaxes(back, 1, 2)
        return _Seen(start, node, cov, total)


@njit(cache=True)
def _near(pairs, residuals, covs, seen, gate):  # type: ignore[no-untyped-def]
    """Returns (P,) whether residuals lie within a gate under both bounds."""
    row, node, landmark = pairs
    e, J_p, J_l, cov = residuals
    cov_pose, cov_map = covs
    start, by, back, total, pose = seen
    d = e.shape[1]
    out, S = np.zeros(len(row), np.bool_), np.empty((d, d))
    C, J = np.empty((3, 3)), np.empty((d, 3))
    for k in range(len(row)):
        R, i, m = cov[row[k]], node[k], landmark[k]
        if not _fits(e[k], J_p[k], cov_pose[i], J_l[k], cov_map[m], 2.0, R, gate, S):
            continue
        out[k] = True
        first, last = start[m], start[m + 1]
        if first == last:
            continue
        at = first + np.searchsorted(by[first:last], i)
        if at == last or (at > first and i - by[at - 1] < by[at] - i):
            at -= 1
        early, late = min(i, by[at]), max(i, by[at])
        for a in range(3):
            for b in range(3):
                C[a, b] = total[late, a, b] - total[early, a, b]
        for a in range(d):  # by a small motion about the floor's origin, not about the pose
            J[a, 0], J[a, 1] = J_p[k, a, 0], J_p[k, a, 1]
            J[a, 2] = J_p[k, a, 2] - pose[i, 1] * J[a, 0] + pose[i, 0] * J[a, 1]
        out[k] = _fits(e[k], J, C, J_l[k], back[at], 1.0, R, gate, S)
    return out


@njit(cache=True)
def near_each_other(pairs, residuals, cov, gate):  # type: ignore[no-untyped-def]
    """Returns (P,) whether landmarks' differences lie within a gate, whatever their correlation.

    Args:
        pairs: numbers (P,) and (P,) of two landmarks each.
        residuals: their differences (P, d), and Jacobians (P, d, l) by the first and the second.
        cov: (m, l, l) of the landmarks.
        gate: squared Mahalanobis distance.
    """
    i, j = pairs
    e, J_i, J_j = residuals
    d = e.shape[1]
    out, S, R = np.zeros(len(i), np.bool_), np.empty((d, d)), np.zeros((d, d))
    for k in range(len(i)):
        out[k] = _fits(e[k], J_i[k], cov[i[k]], J_j[k], cov[j[k]], 2.0, R, gate, S)
    return out


@njit(cache=True)
def _fits(e, J, P, J_l, L, factor, R, gate, S):  # type: ignore[no-untyped-def]
    """Returns whether ``e' inv(S) e`` is within a gate, ``S = factor (J P J' + J_l L J_l') + R``.

    ``S`` is filled, its lower half only, as far as that takes.
    """
    d = len(e)
    for a in range(d):
        S[a, a] = R[a, a] + factor * (_product(J, P, a, a) + _product(J_l, L, a, a))
        if e[a] ** 2 > gate * S[a, a]:  # no entry is farther off, whatever the others are
            return False
    for a in range(d):
        for b in range(a):
            S[a, b] = R[a, b] + factor * (_product(J, P, a, b) + _product(J_l, L, a, b))
    return _squared(S, e) <= gate


@njit(cache=True)
def _product(J, P, a, b):  # type: ignore[no-untyped-def]
    """Returns one entry of ``J P J'``."""
    value = 0.0
    for i in range(len(P)):
        row = 0.0
        for j in range(len(P)):
            row += P[i, j] * J[b, j]
        value += J[a, i] * row
    return value


@njit(cache=True)
def _squared(S, e):  # type: ignore[no-untyped-def]
    """Returns ``e' inv(S) e``, or 0 where S is not definite; S is overwritten by its factor."""
    d, total = len(S), 0.0
    x = np.empty(d)
    for p in range(d):
        for q in range(p):
            for r in range(q):
                S[p, q] -= S[p, r] * S[q, r]
            S[p, q] /= S[q, q]
            S[p, p] -= S[p, q] ** 2
        if not S[p, p] > 0.0:
            return 0.0
        S[p, p] = np.sqrt(S[p, p])
        x[p] = e[p]
        for q in range(p):
            x[p] -= S[p, q] * x[q]
        x[p] /= S[p, p]
        total += x[p] ** 2
    return total
