"""Which lines of two maps are the same, under a given rigid motion between them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.optimize

from graphslam.arrays import frozen
from graphslam.geometry import Array, inverse, offset_error, points_on_line
from graphslam.line_maps.config import AlignmentConfig
from graphslam.line_maps.line_map import LineMap
from graphslam.measurements import IntArray
from graphslam.models.line import LINE

SIGMAS = 3.0
"""Uncertain lines agree within so many standard deviations of their difference."""
WIDEST_DEG = 10.0
"""Lines never agree beyond this angle, however uncertain they are."""


@dataclass(frozen=True, slots=True)
class Side:
    """One map, prepared: what matching needs of it many times over.

    Attributes:
        lines: (M, 2).
        cov: (M, 2, 2) covariance of each line.
        stretch: (M, 2) stretches, known or assumed, m.
        length: (M,) their lengths, m.
        middle: (M, 2) their middles, points in the map's frame, m.
        ends: (M, 2, 2) their ends, likewise.
    """

    lines: Array
    cov: Array
    stretch: Array
    length: Array
    middle: Array
    ends: Array

    @staticmethod
    def of(line_map: LineMap) -> Side:
        """Returns a map prepared."""
        stretch = line_map.stretches()
        return Side(
            lines=line_map.lines,
            cov=line_map.blocks(),
            stretch=stretch,
            length=stretch[:, 1] - stretch[:, 0],
            middle=points_on_line(line_map.lines, stretch.mean(axis=1)),
            ends=points_on_line(line_map.lines[:, None], stretch),
        )


@dataclass(frozen=True, slots=True)
class Pairs:
    """Pairs of lines under a motion ``a_T_b``; differences are a minus b, in b's frame.

    Attributes:
        i: (K,) rows of the first map.
        j: (K,) rows of the second.
        e: (K, 2) difference of (rho, alpha), twins settled, by the name that b's line has.
        J_motion: (K, 2, 3) Jacobian of ``e`` by additive changes of the motion.
        J_a: (K, 2, 2) Jacobian of ``e`` by the first map's line; by the second's it is minus one.
        common: (K, 2) stretch that both have, along b's line, m; reversed where there is a gap.
        tolerance: (K, 2) differences at the middle of it up to which the lines agree, m and rad.
    """

    i: IntArray
    j: IntArray
    e: Array
    J_motion: Array
    J_a: Array
    common: Array
    tolerance: Array

    @property
    def overlap(self) -> Array:
        """(K,) length of the common stretch, m; 0 where there is none."""
        return np.maximum(self.common[:, 1] - self.common[:, 0], 0.0)

    @property
    def middle(self) -> Array:
        """(K,) middle of the common stretch, or of the gap, along b's line, m."""
        return np.asarray(self.common.mean(axis=1))

    @property
    def at_middle(self) -> Array:
        """(K, 2) difference across the line at `middle`, m, and in angle, rad."""
        return np.asarray(np.column_stack([offset_error(self.e, self.middle), self.e[:, 1]]))

    def take(self, rows: IntArray | Array) -> Pairs:
        """Returns the pairs that ``rows`` (mask or indices) names."""
        return Pairs(
            self.i[rows], self.j[rows], self.e[rows], self.J_motion[rows], self.J_a[rows],
            self.common[rows], self.tolerance[rows],
        )  # fmt: skip


def middle_jacobian(s: Array) -> Array:
    """Returns (K, 2, 2) the Jacobians of (offset at ``s``, angle) by (rho, alpha)."""
    out = np.zeros((len(s), 2, 2))
    out[:, 0] = offset_error(np.eye(2), s[:, None])
    out[:, 1, 1] = 1.0
    return out


def pairs_at(
    motion: Array, a: Side, b: Side, i: IntArray, j: IntArray, config: AlignmentConfig
) -> Pairs:
    """Returns lines ``i`` of the first map beside lines ``j`` of the second.

    The second map's origin is taken for a robot at ``motion`` (3,) that sees the first map's lines;
    the second map's lines are its sightings, so that twins and Jacobians are the line model's.
    """
    at = np.broadcast_to(motion, (len(i), 3))
    e, J_motion, J_a = LINE.residual(at, a.lines[i], b.lines[j])
    back = np.broadcast_to(inverse(motion), (len(i), 3))
    laid = LINE.extent_on_landmark(back, b.lines[j], a.lines[i], a.stretch[i])
    low = np.maximum(laid[:, 0], b.stretch[j, 0])
    high = np.minimum(laid[:, 1], b.stretch[j, 1])
    common = np.column_stack([low, high])
    J = middle_jacobian(common.mean(axis=1))
    cov = J @ (J_a @ a.cov[i] @ np.swapaxes(J_a, 1, 2) + b.cov[j]) @ np.swapaxes(J, 1, 2)
    sigma = np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
    least = np.array([config.offset_m, math.radians(config.angle_deg)])
    most = np.array([config.far_m, math.radians(max(WIDEST_DEG, config.angle_deg))])
    return Pairs(i, j, e, J_motion, J_a, common, np.clip(SIGMAS * sigma, least, most))


def quality(pairs: Pairs, widened: float = 1.0) -> Array:
    """Returns (K,) how well pairs agree: 1 for exactly, 0 where they do not.

    Args:
        pairs: candidates.
        widened: factor on the tolerances.
    """
    scaled = np.abs(pairs.at_middle) / (widened * pairs.tolerance)
    inside = np.all(scaled <= 1.0, axis=1)
    return np.where(inside, 1.0 - 0.5 * np.sum(scaled**2, axis=1), 0.0)


def long_enough(pairs: Pairs, a: Side, b: Side, config: AlignmentConfig) -> Array:
    """Returns (K,) whether the common stretch is long enough to count."""
    shorter = np.minimum(a.length[pairs.i], b.length[pairs.j])
    return np.asarray(pairs.overlap >= np.minimum(config.overlap_m, 0.5 * shorter))


def one_to_one(pairs: Pairs, weight: Array) -> IntArray:
    """Returns the rows of pairs that give the largest sum of ``weight`` with each line used once.

    Pairs without positive weight are never taken; rows come sorted by the first map's lines.
    """
    good = np.flatnonzero(weight > 0)
    if not len(good):
        return good
    rows, i = np.unique(pairs.i[good], return_inverse=True)
    columns, j = np.unique(pairs.j[good], return_inverse=True)
    table = np.zeros((len(rows), len(columns)))
    table[i, j] = weight[good]
    place = np.full(table.shape, -1)
    place[i, j] = good
    taken = place[scipy.optimize.linear_sum_assignment(table, maximize=True)]
    return np.asarray(taken[taken >= 0])


@dataclass(frozen=True, slots=True)
class Agreement:
    """What two maps have in agreement under a motion.

    Attributes:
        matched: the one-to-one pairs.
        parts: (S, 2) further pairs that agree, of lines that are matched already: one line in one
            map stands for several in the other.
        agree_m: length in agreement, weighted by how good it is, m.
        conflict_m: length over which unmatched lines lie beside a line of the other map, nearly
            parallel and near, and yet beyond the tolerance, m.
    """

    matched: Pairs
    parts: IntArray
    agree_m: float
    conflict_m: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "parts", frozen("parts", self.parts, (None, 2), int))

    @property
    def rows(self) -> IntArray:
        """(K, 2) the one-to-one pairs: rows of the first map and of the second."""
        return np.column_stack([self.matched.i, self.matched.j])

    @property
    def score_m(self) -> float:
        """Length in agreement less length in conflict, m."""
        return self.agree_m - self.conflict_m


def agreement(pairs: Pairs, a: Side, b: Side, config: AlignmentConfig) -> Agreement:
    """Returns what candidate pairs have in agreement at the motion they were made for."""
    enough = long_enough(pairs, a, b, config)
    good = np.where(enough, quality(pairs), 0.0)
    length = good * pairs.overlap
    taken = one_to_one(pairs, length)
    used_a, used_b = pairs.i[taken], pairs.j[taken]
    rest = np.flatnonzero(good > 0)
    rest = rest[~np.isin(rest, taken)]
    # a part lies along one matched line only, and has no match of its own
    again = np.isin(pairs.i[rest], used_a) ^ np.isin(pairs.j[rest], used_b)
    parts = rest[again]
    explained_a = np.union1d(used_a, pairs.i[parts])
    explained_b = np.union1d(used_b, pairs.j[parts])
    near = enough & (good == 0) & (quality(pairs, 2.0) > 0)
    near &= ~np.isin(pairs.i, explained_a) | ~np.isin(pairs.j, explained_b)
    return Agreement(
        pairs.take(taken),
        np.column_stack([pairs.i[parts], pairs.j[parts]]),
        float(length[taken].sum() + length[parts].sum()),
        float(pairs.overlap[near].sum()),
    )
