"""What the absence of sightings says: landmarks that were in view and were not seen."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from scipy.spatial import ConvexHull, QhullError, cKDTree

from graphslam.geometry import Array, wrap
from graphslam.landmarks import used_sightings
from graphslam.measurements import IntArray
from graphslam.models.line import LINE
from graphslam.smoother.problem import Problem

MOST_SURE = 0.8
"""Probability with which a landmark in view is seen, at most: misses come in runs, as light and
wear do, and are no independent draws."""
WELL = 0.5
"""Part of the length that sightings usually have from which on a stretch is well in view."""
FEWEST = 30
"""Sightings without which nothing is known of the view."""


def miss_price(problem: Problem) -> float:
    """Returns how improbable it is that lines in view were seen as often as they were.

    A node has a line well in view where enough of what other nodes saw of it lies within the field
    of view; that is the convex hull of all that was ever seen, in the robot's frame. How probable a
    line in view is to be seen is estimated from how often it was. So where the robot should see the
    edge of a map and does not, it is elsewhere; lines that exist twice, one of which is seen at a
    time, are improbable, too.

    Returns:
        minus the logarithm of the probability, in units of the cost; 0 where little was seen.
    """
    seen = used_sightings(problem.measurements, problem.match, problem.params)
    lines = [used for used in seen if used.model is LINE]
    if not lines or len(lines[0].rows) < FEWEST:
        return 0.0
    table = lines[0].table
    ends = LINE.ends(table.z, table.extent)
    ends = ends[np.isfinite(ends).all(axis=(1, 2))]
    view = _view(ends.reshape(-1, 2)) if len(ends) >= FEWEST else None
    if view is None:
        return 0.0
    enough = WELL * float(np.median(np.hypot(*(ends[:, 1] - ends[:, 0]).T)))
    rows, landmark = lines[0].rows, problem.match[lines[0].index]
    stretch = LINE.extent_on_landmark(
        problem.pose[table.node[rows]], lines[0].params, table.z[rows], table.extent[rows]
    )
    tree = cKDTree(problem.pose[:, :2])
    reach = float(np.hypot(*ends.reshape(-1, 2).T).max())
    expected = hits = 0
    order = np.argsort(landmark, kind="stable")
    first = np.searchsorted(landmark[order], np.arange(len(problem.kinds) + 1))
    for number, (begin, end) in enumerate(pairwise(first.tolist())):
        own = order[begin:end]
        known = _joined(stretch[own][np.isfinite(stretch[own]).all(axis=1)])
        if not len(known):
            continue
        line = problem.params[number, : LINE.dim_landmark]
        near = _nodes_about(tree, line, known, reach)
        length = _in_view(problem.pose[near], line, known, view)
        due = near[length >= enough]
        expected += len(due)
        hits += int(np.isin(due, table.node[rows[own]]).sum())
    if not expected:
        return 0.0
    p = min(max(hits / expected, 1.0 - MOST_SURE), MOST_SURE)
    return -hits * math.log(p) - (expected - hits) * math.log1p(-p)


def _view(points: Array) -> Array | None:
    """Returns the half planes (h, 3) ``a x + b y + c <= 0`` about points (k, 2), robot frame."""
    try:
        return np.unique(np.asarray(ConvexHull(points).equations), axis=0)
    except QhullError:  # all on one line
        return None


def _joined(stretch: Array) -> Array:
    """Returns the union of stretches (k, 2) as disjoint ones (u, 2), in order."""
    if not len(stretch):
        return stretch
    stretch = stretch[np.argsort(stretch[:, 0], kind="stable")]
    reached = np.maximum.accumulate(stretch[:, 1])
    new = np.flatnonzero(stretch[1:, 0] > reached[:-1]) + 1
    return np.column_stack([stretch[np.r_[0, new], 0], reached[np.r_[new - 1, len(stretch) - 1]]])


def _nodes_about(tree: cKDTree, line: Array, known: Array, reach: float) -> IntArray:
    """Returns the nodes within reach of a line's known part, in order, with some beyond."""
    low, high = known[0, 0], known[-1, 1]
    s = np.linspace(low, high, 2 + int((high - low) / reach))
    near = tree.query_ball_point(
        np.column_stack(
            [
                line[0] * math.cos(line[1]) - s * math.sin(line[1]),
                line[0] * math.sin(line[1]) + s * math.cos(line[1]),
            ]
        ),
        1.2 * reach,
    )
    return np.unique(np.concatenate([np.array(part, np.int64) for part in near]))


def _in_view(pose: Array, line: Array, known: Array, view: Array) -> Array:
    """Returns the length (n,), m, of the known parts of a line that lies in view from poses."""
    x, y, theta = pose.T
    alpha = wrap(line[1] - theta)
    rho = line[0] - x * math.cos(line[1]) - y * math.sin(line[1])
    foot = rho[:, None] * np.column_stack([np.cos(alpha), np.sin(alpha)])
    along = np.column_stack([-np.sin(alpha), np.cos(alpha)])
    origin = -x * math.sin(line[1]) + y * math.cos(line[1])  # of positions along the line
    inside = foot @ view[:, :2].T + view[:, 2]
    slope = along @ view[:, :2].T
    with np.errstate(divide="ignore", invalid="ignore"):
        cut = -inside / slope
    low = np.where(slope < 0.0, cut, -np.inf).max(axis=1, initial=-np.inf)
    high = np.where(slope > 0.0, cut, np.inf).min(axis=1, initial=np.inf)
    low, high = low + origin, high + origin
    overlap = np.minimum(high[:, None], known[:, 1]) - np.maximum(low[:, None], known[:, 0])
    return np.asarray(np.maximum(overlap, 0.0).sum(axis=1))
