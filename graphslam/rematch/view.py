"""What the absence of sightings says: lines that were in view and were not seen, and their ends."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError, cKDTree

from graphslam.config import RematchConfig
from graphslam.geometry import Array, line_to_robot, points_on_line, position_along
from graphslam.landmarks import Used, used_sightings
from graphslam.measurements import IntArray
from graphslam.models.line import LINE
from graphslam.rematch.ends import UNKNOWN, Ends
from graphslam.smoother.problem import Problem

MOST_SURE = 0.8
"""Probability with which a landmark in view is seen, at most: misses come in runs, as light and
wear do, and are no independent draws."""
PARTS = (0.0, 0.25, 0.5, 0.75, 1.0, math.inf)
"""Parts of the length that sightings usually have, between which a line in view is seen equally
often: little of it may be too little for the detector."""
BEYOND = 0.25
"""Part of that length which must be in view beyond the end of a line for the end to be seen."""
FEWEST = 30
"""Sightings without which nothing is known of the view."""


@dataclass(frozen=True, slots=True)
class Watched:
    """How the lines of a map were seen.

    Attributes:
        price: how improbable it is that lines in view were seen as often as they were: minus the
            logarithm of the probability, in units of the cost.
        ends: where they end.
    """

    price: float
    ends: Ends


NOTHING = Watched(0.0, UNKNOWN)


def watched(problem: Problem, config: RematchConfig) -> Watched:
    """Returns what is known of the lines from where they were not seen; `NOTHING` for little.

    The field of view is the convex hull of all that was ever seen, in the robot's frame. A line
    ends where a node saw it end though there was more in view. A node has a line in view where what
    others saw of it lies within, or where it must go on, as far as lines are known to. How probable
    a line in view is to be seen is estimated from how often it was, apart for lines of which little
    is in view. So where the robot should see the edge of a map and does not, it is elsewhere; lines
    that exist twice, one of which is seen at a time, are improbable, too.

    Args:
        problem: path, map and matches.
        config: how often lines end before anything is known.
    """
    seen = used_sightings(problem.measurements, problem.match, problem.params)
    lines = [used for used in seen if used.model is LINE]
    seen_by = _seen(problem, lines[0]) if lines else None
    if seen_by is None or len(seen_by.node) < FEWEST:
        return NOTHING
    table = lines[0].table
    corners = LINE.ends(table.z, table.extent)
    corners = corners[np.isfinite(corners).all(axis=(1, 2))]
    view = _view(corners.reshape(-1, 2))
    if view is None:
        return NOTHING
    usual = float(np.median(np.hypot(*(corners[:, 1] - corners[:, 0]).T)))
    reach = float(np.hypot(*corners.reshape(-1, 2).T).max())
    ends = _ends(problem, seen_by, view, BEYOND * usual)
    further = ends.sure(config)
    known = joined(seen_by.landmark, seen_by.stretch + np.array([-further, further]))
    landmark, node = _pairs(problem, seen_by, known, reach)
    part = _length_in_view(problem, landmark, node, known, view) / usual
    hit = np.isin(_names(problem, landmark, node), _names(problem, seen_by.landmark, seen_by.node))
    return Watched(_price(part, hit), ends)


@dataclass(frozen=True, slots=True)
class _Seen:
    """Sightings of lines: (k,) landmark, (k,) node, and the stretch (k, 2) along the landmark."""

    landmark: IntArray
    node: IntArray
    stretch: Array


@dataclass(frozen=True, slots=True)
class Parts:
    """Disjoint parts of lines, ordered by landmark and place.

    Attributes:
        landmark: (u,) whose part it is.
        low: (u,) where it begins along the landmark, m.
        high: (u,) where it ends.
        of: (k,) part of each stretch that was joined.
    """

    landmark: IntArray
    low: Array
    high: Array
    of: IntArray


def _seen(problem: Problem, used: Used) -> _Seen:
    """Returns the sightings of lines whose stretch is known."""
    node = used.table.node[used.rows]
    stretch = LINE.extent_on_landmark(
        problem.pose[node], used.params, used.table.z[used.rows], used.table.extent[used.rows]
    )
    known = np.isfinite(stretch).all(axis=1)
    return _Seen(used.landmark[known], node[known], stretch[known])


def joined(landmark: IntArray, stretch: Array) -> Parts:
    """Returns the union of stretches (k, 2) of each landmark (k,) as disjoint parts."""
    if not len(landmark):
        return Parts(landmark, np.zeros(0), np.zeros(0), landmark)
    order = np.lexsort((stretch[:, 0], landmark))
    whose, low, high = landmark[order], stretch[order, 0], stretch[order, 1]
    # the farthest end so far of each landmark: shifted apart, one running maximum does for all
    apart = (1.0 + np.ptp(stretch)) * np.cumsum(np.diff(whose, prepend=whose[0]) != 0)
    reached = np.maximum.accumulate(high + apart) - apart
    new = np.append(True, (np.diff(whose) != 0) | (low[1:] > reached[:-1]))
    first = np.flatnonzero(new)
    of = np.empty(len(order), np.int64)
    of[order] = np.cumsum(new) - 1
    last = np.append(first[1:], len(order)) - 1
    return Parts(whose[first], low[first], reached[last], of)


def _ends(problem: Problem, seen: _Seen, view: Array, margin: float) -> Ends:
    """Returns the ends of lines that some sighting saw with ``margin``, m, in view beyond."""
    known = joined(seen.landmark, seen.stretch)
    low, high = _in_view(problem.pose[seen.node], problem.params[seen.landmark], view)
    count = 0
    for sign, view_end, seen_end, end in (
        (1.0, high, seen.stretch[:, 1], known.high),
        (-1.0, low, seen.stretch[:, 0], known.low),
    ):
        own = end[known.of]
        there = sign * (own - seen_end) <= margin
        count += len(np.unique(known.of[there & (sign * (view_end - own) >= margin)]))
    return Ends(count, float((known.high - known.low).sum()))


def _names(problem: Problem, landmark: IntArray, node: IntArray) -> IntArray:
    """Returns one number for each pair of a landmark and a node."""
    return landmark * len(problem.pose) + node


def _pairs(problem: Problem, seen: _Seen, known: Parts, reach: float) -> tuple[IntArray, IntArray]:
    """Returns landmarks (P,) and nodes (P,) near enough to see a known part, and some beyond."""
    count = 2 + ((known.high - known.low) / reach).astype(np.int64)
    part = np.repeat(np.arange(len(count)), count)
    step = (np.arange(len(part)) - (np.cumsum(count) - count)[part]) / (count - 1)[part]
    s = known.low[part] + step * (known.high - known.low)[part]
    whose = known.landmark[part]
    points = points_on_line(problem.params[whose, None, : LINE.dim_landmark], s[:, None])[:, 0]
    near = cKDTree(problem.pose[:, :2]).query_ball_point(points, 1.2 * reach)
    nodes = np.concatenate([np.array(some, np.int64) for some in near])
    found = _names(problem, np.repeat(whose, [len(some) for some in near]), nodes)
    names = np.union1d(found, _names(problem, seen.landmark, seen.node))
    return names // len(problem.pose), names % len(problem.pose)


def _length_in_view(
    problem: Problem, landmark: IntArray, node: IntArray, known: Parts, view: Array
) -> Array:
    """Returns how much (P,) of the known parts of landmarks (P,) nodes (P,) have in view, m."""
    low, high = _in_view(problem.pose[node], problem.params[landmark], view)
    first, last = (np.searchsorted(known.landmark, landmark, side) for side in ("left", "right"))
    count = last - first
    pair = np.repeat(np.arange(len(landmark)), count)
    part = np.arange(len(pair)) - np.repeat(np.cumsum(count) - count - first, count)
    overlap = np.minimum(high[pair], known.high[part]) - np.maximum(low[pair], known.low[part])
    return np.asarray(np.bincount(pair, np.maximum(overlap, 0.0), minlength=len(landmark)))


def _price(part: Array, hit: NDArray[np.bool_]) -> float:
    """Returns minus the logarithm of the probability of hits (P,), by the part (P,) in view."""
    price = 0.0
    for low, high in pairwise(PARTS):
        own = hit[(part > low) & (part <= high)]
        hits, misses = int(own.sum()), int((~own).sum())
        p = min(hits / max(len(own), 1), MOST_SURE)
        price -= hits * math.log(p) if hits else 0.0
        price -= misses * math.log1p(-p)
    return price


def _view(points: Array) -> Array | None:
    """Returns the half planes (h, 3) ``a x + b y + c <= 0`` about points (k, 2), robot frame."""
    try:
        return np.unique(np.asarray(ConvexHull(points).equations), axis=0)
    except QhullError:  # all on one line
        return None


def _in_view(pose: Array, line: Array, view: Array) -> tuple[Array, Array]:
    """Returns where along lines (n, 2) the view from poses (n, 3) begins (n,) and ends (n,), m."""
    seen = line_to_robot(line[:, : LINE.dim_landmark], pose)
    rho, alpha = seen.T
    foot = rho[:, None] * np.column_stack([np.cos(alpha), np.sin(alpha)])
    along = np.column_stack([-np.sin(alpha), np.cos(alpha)])
    origin = position_along(line[:, : LINE.dim_landmark], pose[:, :2])
    inside = foot @ view[:, :2].T + view[:, 2]
    slope = along @ view[:, :2].T
    with np.errstate(divide="ignore", invalid="ignore"):
        cut = -inside / slope
    low = np.where(slope < 0.0, cut, -np.inf).max(axis=1, initial=-np.inf)
    high = np.where(slope > 0.0, cut, np.inf).min(axis=1, initial=np.inf)
    return low + origin, high + origin
