"""Nodes adrift: while a wheel slips, odometry says nothing of them, and all they see seems new.

Increments are switched off before and behind such nodes. What they see becomes a second copy of a
few lines, which floats beside the map and costs nothing. But they lie somewhere between where
odometry puts them from before and where it puts them from behind: they are looked for there, one by
one, by all lines that they see together.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from graphslam.association import labels_agree, mahalanobis
from graphslam.config import RematchConfig
from graphslam.geometry import Array, compose, inverse, wrap
from graphslam.measurements import IntArray, Sightings
from graphslam.models.line import LINE
from graphslam.rematch.fitted import UNMATCHED, Fitted, table_of
from graphslam.smoother.problem import Problem
from graphslam.smoother.robust import SMALLEST_WEIGHT

MOST = 20
"""Nodes adrift in a row, at most: beyond, the path is torn."""
PLACES = 13
"""Places from one end to the other at which a node is looked for."""
SLACK = np.diag([0.05, np.radians(4.0)]) ** 2
"""Covariance of what is seen from such a place, beyond the sighting's own, m and rad."""


def adrift(fitted: Fitted) -> Iterator[tuple[int, int]]:
    """Yields the last node before, and the first behind, each stretch of nodes adrift.

    Around increments that are switched off these are the nearest nodes that see a landmark which is
    seen far from there, too: increments may be switched off where the copy of a line ends, not
    where the wheel slipped.
    """
    off = np.flatnonzero(fitted.problem.odometry_weight < 0.5)
    match = fitted.problem.match
    for run in np.split(off, 1 + np.flatnonzero(np.diff(off) > MOST)):
        if not len(run):
            continue
        near = (fitted.node >= run[0] - MOST) & (fitted.node <= run[-1] + 1 + MOST)
        elsewhere = np.isin(match, match[~near & (match >= 0)])
        tied = np.unique(fitted.node[elsewhere | ((match >= 0) & ~near)])
        before, behind = tied[tied <= run[0]], tied[tied > run[-1]]
        if len(before) and len(behind) and behind[0] > before[-1] + 1:
            yield int(before[-1]), int(behind[0])


def moored(fitted: Fitted, first: int, last: int, config: RematchConfig) -> Problem:
    """Returns the problem with the nodes between two others at the place that fits them best.

    What odometry says of them is switched off; a robust minimum finds out where it was wrong.

    Args:
        fitted: path, map and matches.
        first: the last node before them.
        last: the first node behind them.
        config: the gate.
    """
    problem = fitted.problem
    begin, table = table_of(problem, LINE.kind)
    pose, match = problem.pose.copy(), problem.match.copy()
    ahead, back = _driven(problem, first, last)
    inside = (fitted.node > first) & (fitted.node < last)
    seen = np.bincount(match[~inside & (match >= 0)], minlength=len(problem.kinds)) > 0
    lines = fitted.of_kind(LINE.kind)
    lines = lines[seen[lines] | problem.fixed[lines]]
    for node in range(first + 1, last):
        rows = np.arange(*np.searchsorted(table.node, [node, node + 1]))
        ends = ahead[node - first], back[node - first]
        place, found = _best(fitted, table, rows, lines, *ends, config)
        pose[node] = place
        match[begin + rows] = found
    weight = problem.odometry_weight.copy()
    weight[first:last] = SMALLEST_WEIGHT
    return replace(problem, pose=pose, match=match, odometry_weight=weight)


def _driven(problem: Problem, first: int, last: int) -> tuple[Array, Array]:
    """Returns poses (n, 3) of nodes ``first`` to ``last`` driven on from before and from behind."""
    step = problem.measurements.odometry.increment
    ahead, back = [problem.pose[first]], [problem.pose[last]]
    for node in range(first, last):
        ahead.append(compose(ahead[-1], step[node]))
    for node in range(last - 1, first - 1, -1):
        back.append(compose(back[-1], inverse(step[node])))
    return np.array(ahead), np.array(back[::-1])


def _best(
    fitted: Fitted,
    table: Sightings,
    rows: IntArray,
    lines: IntArray,
    one: Array,
    other: Array,
    config: RematchConfig,
) -> tuple[Array, IntArray]:
    """Returns the pose between two at which most sightings lie on lines, and the lines (k,)."""
    change = other - one
    change[2] = wrap(change[2])
    best = (0, 0.0), one + 0.5 * change, np.full(len(rows), UNMATCHED)
    for part in np.linspace(0.0, 1.0, PLACES):
        place = one + part * change
        params = fitted.problem.params[lines, : LINE.dim_landmark]
        e, _, _ = LINE.residual(place, params, table.z[rows, None])
        distance = mahalanobis(e, (table.cov[rows] + SLACK)[:, None])
        alike = labels_agree(table.label[rows, None], fitted.label[lines])
        distance = np.where(alike & (distance <= config.gate), distance, np.inf)
        found, total = _one_each(distance)
        rank = int(np.sum(found >= 0)), -total
        if rank > best[0]:
            best = rank, place, np.append(lines, UNMATCHED)[found]
    return best[1], best[2]


def _one_each(distance: Array) -> tuple[IntArray, float]:
    """Returns the column (k,) of each row, nearest pair first, -1 for none, and the sum."""
    found, total = np.full(len(distance), UNMATCHED), 0.0
    left = distance.copy()
    while left.size and np.isfinite(left.min()):
        row, column = np.unravel_index(np.argmin(left), left.shape)
        found[row] = column
        total += float(left[row, column])
        left[row], left[:, column] = np.inf, np.inf
    return found, total
