"""Local line maps along the path, each from its own little smoothing problem."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from graphslam.config import RematchConfig, SmootherConfig
from graphslam.errors import UnderConstrained
from graphslam.geometry import between, inverse, line_to_floor
from graphslam.landmarks import stretches_seen
from graphslam.line_maps.line_map import LineMap
from graphslam.measurements import IntArray, Measurements, Odometry, Sightings
from graphslam.models.line import LINE
from graphslam.rematch.fitted import Fitted, table_of
from graphslam.rematch.found import travelled
from graphslam.smoother.problem import Minimum, Problem

Minimise = Callable[[Problem, SmootherConfig], Minimum]

EXACT = 1e-6
"""Standard deviation of a submap's first pose, the origin of its frame, m and rad."""


@dataclass(frozen=True, slots=True)
class Submap:
    """The lines of a stretch of the path, in the frame of its first node.

    Attributes:
        first: first node.
        last: node after the last.
        landmark: (M,) landmark of each line.
        lines: the lines, with covariances relative to the first node.
    """

    first: int
    last: int
    landmark: IntArray
    lines: LineMap


def submaps(fitted: Fitted, config: SmootherConfig, minimise: Minimise) -> tuple[Submap, ...]:
    """Returns maps of stretches of the path, each overlapping half of the next.

    Args:
        fitted: path, map and matches.
        config: of the little problems; `RematchConfig.submap_m` is the length of a stretch.
        minimise: solves them.
    """
    length = config.rematching.submap_m
    way = travelled(fitted.problem.pose)
    made = []
    for begin in np.arange(0.0, max(way[-1] - 0.5 * length, 1e-9), 0.5 * length):
        first, last = np.searchsorted(way, [begin, begin + length]).tolist()
        local = local_map(fitted, first, last, config, minimise)
        if local is not None:
            made.append(local)
    return tuple(made)


def local_map(
    fitted: Fitted, first: int, last: int, config: SmootherConfig, minimise: Minimise
) -> Submap | None:
    """Returns the map of nodes ``first`` to ``last - 1`` from their measurements alone.

    None where they do not determine one.
    """
    problem, landmark = _local(fitted, first, last, config.rematching)
    if not len(landmark):
        return None
    try:
        return Submap(first, last, landmark, _lines(problem, minimise(problem, config)))
    except UnderConstrained:
        return None


def _local(fitted: Fitted, first: int, last: int, rules: RematchConfig) -> tuple[Problem, IntArray]:
    """Returns the problem of nodes ``first`` to ``last - 1`` alone, and its lines' landmarks."""
    problem = fitted.problem
    offset, table = table_of(problem, LINE.kind)
    rows = np.arange(*np.searchsorted(table.node, [first, last]))
    match = problem.match[offset + rows]
    count = np.bincount(match[match >= 0], minlength=len(problem.kinds))
    landmark = np.flatnonzero(count >= rules.min_sightings)
    number = np.full(len(problem.kinds) + 1, -1)
    number[landmark] = np.arange(len(landmark))
    whole = problem.measurements
    odometry = Odometry(
        whole.odometry.increment[first : last - 1], whole.odometry.cov[first : last - 1]
    )
    own = _part(table, rows, first)
    small = Measurements(
        whole.t[first:last], np.zeros(3), EXACT**2 * np.eye(3), odometry, {LINE.kind: own}
    )
    origin = problem.pose[first]
    return Problem(
        small,
        number[match],
        (LINE.kind,) * len(landmark),
        np.zeros(len(landmark), bool),
        between(origin, problem.pose[first:last]),
        line_to_floor(problem.params[landmark, : LINE.dim_landmark], inverse(origin)),
        np.ones(len(rows)),
        problem.odometry_weight[first : last - 1],
    ), landmark


def _part(table: Sightings, rows: IntArray, first: int) -> Sightings:
    own = table.select(rows)
    return replace(own, node=own.node - first)


def _lines(problem: Problem, minimum: Minimum) -> LineMap:
    _, joint = minimum.covariances()
    extent = stretches_seen(problem.measurements, minimum.pose, minimum.params, problem.match)
    return LineMap(minimum.params[:, : LINE.dim_landmark], joint[3:, 3:], extent)
