"""Places where a path may be torn: a wheel slipped or was lifted, and every line seemed new.

Where no line was seen both shortly before and shortly after, only odometry holds the path together.
If it was wrong there, the lines behind the place lie turned and shifted beside those before it. The
two local maps are laid on each other by a motion about the place, which odometry did not see.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from graphslam.config import SmootherConfig
from graphslam.geometry import Array, between, compose, inverse, line_to_floor
from graphslam.line_maps.alignment import Alignment, refine_alignment
from graphslam.measurements import IntArray
from graphslam.models.line import LINE
from graphslam.rematch.fitted import Fitted, nodes_of
from graphslam.rematch.found import travelled
from graphslam.rematch.starts import parted
from graphslam.rematch.submaps import Submap, local_map
from graphslam.smoother.problem import Minimum, Problem
from graphslam.smoother.robust import SMALLEST_WEIGHT

Minimise = Callable[[Problem, SmootherConfig], Minimum]

MOST_TURN_DEG, TURN_STEP_DEG = 45.0, 5.0
"""Turns that a slip may have made, to either side, and the steps in which they are tried."""
MOST_SHIFT_M = 0.3
"""Farthest that the robot slid while it slipped, m."""
LEAST_MATCHES = 3
CLEARLY = 2.0
"""How many times the score of any rival a mending must have."""
MARGIN = 2
"""Increments on either side of the place that may be wrong, too."""


@dataclass(frozen=True, slots=True)
class Tear:
    """A place where odometry may have been wrong, and how the path is mended there.

    Attributes:
        first: the last node before it that saw a line seen earlier.
        last: the first node behind it that saw a line seen later.
        motion: (3,) rigid motion of the floor behind it, floor frame.
        pairs: (P, 2) landmarks that are one then, the earlier seen first.
    """

    first: int
    last: int
    motion: Array
    pairs: IntArray


def tears(fitted: Fitted, config: SmootherConfig, minimise: Minimise) -> Iterator[Tear]:
    """Yields the places at which the path can be mended in one way only.

    Args:
        fitted: path, map and matches.
        config: `RematchConfig.submap_m` is the length of the path either side that is compared.
        minimise: solves the little problems of local maps.
    """
    way = travelled(fitted.problem.pose)
    reach = 2.0 * config.rematching.submap_m
    for first, last in gaps(parted(fitted.problem, config.rematching.window_m)):
        begin = int(np.searchsorted(way, way[first] - reach))
        end = int(np.searchsorted(way, way[last] + reach, side="right"))
        before = local_map(fitted, begin, first + 1, config, minimise)
        after = local_map(fitted, last, end, config, minimise)
        if before is not None and after is not None:
            mended = _mended(fitted, before, after)
            if mended is not None:
                yield Tear(first, last, *mended)


def mend(problem: Problem, tear: Tear) -> Problem:
    """Returns the problem with what lies behind a tear moved, and odometry switched off there."""
    pose, params, match = problem.pose.copy(), problem.params.copy(), problem.match
    pose[tear.last :] = compose(tear.motion, pose[tear.last :])
    node = nodes_of(problem)
    seen_before = np.unique(match[(match >= 0) & (node < tear.last)])
    moves = np.ones(len(problem.kinds), bool)
    moves[seen_before] = False
    moves &= ~problem.fixed & (np.array(problem.kinds, dtype=object) == LINE.kind)
    params[moves, :2] = line_to_floor(params[moves, :2], tear.motion)
    weight = problem.odometry_weight.copy()
    weight[max(0, tear.first - MARGIN) : tear.last + MARGIN] = SMALLEST_WEIGHT
    return replace(problem, pose=pose, params=params, odometry_weight=weight)


def gaps(recent: Problem) -> Iterator[tuple[int, int]]:
    """Yields nodes (before, behind) between which no line is seen on both sides.

    Args:
        recent: matches with every landmark parted where it was left behind.
    """
    match, node, nodes = recent.match, nodes_of(recent), len(recent.pose)
    first, last = lifetimes(recent)
    # how many landmarks were seen both at or before a node, and at or after the next one
    spanning = np.zeros(nodes + 1, np.int64)
    np.add.at(spanning, first[last >= 0], 1)
    np.add.at(spanning, last[last >= 0], -1)
    spanning = np.cumsum(spanning)[: nodes - 1]
    seen = np.zeros(nodes, bool)
    seen[node[match >= 0]] = True
    at = np.flatnonzero(seen)
    for before, behind in zip(at[:-1].tolist(), at[1:].tolist(), strict=True):
        if not spanning[before:behind].any():
            yield before, behind


def lifetimes(problem: Problem) -> tuple[IntArray, IntArray]:
    """Returns the first node (M,) that saw each landmark, and the last; N and -1 where none did."""
    count, node = len(problem.kinds), nodes_of(problem)
    used = np.flatnonzero(problem.match >= 0)
    first, last = np.full(count, len(problem.pose)), np.full(count, -1)
    np.minimum.at(first, problem.match[used], node[used])
    np.maximum.at(last, problem.match[used], node[used])
    return first, last


def _mended(fitted: Fitted, before: Submap, after: Submap) -> tuple[Array, IntArray] | None:
    """Returns the motion of the floor behind a tear and the landmarks that are one, or None."""
    pose = fitted.problem.pose
    origin, place = pose[before.first], pose[after.first]
    there = between(origin, place)
    found: list[Alignment] = []
    for turn in np.radians(np.arange(-MOST_TURN_DEG, MOST_TURN_DEG + 1.0, TURN_STEP_DEG)):
        tried = refine_alignment(before.lines, after.lines, there + np.array([0.0, 0.0, turn]))
        if tried is not None and _possible(tried, there) and not _known(tried, found):
            found.append(tried)
    if not found:
        return None
    found.sort(key=lambda a: -a.score_m)
    best = found[0]
    rival = found[1].score_m if len(found) > 1 else 0.0
    if len(best.matches) < LEAST_MATCHES or not best.fixed or best.score_m < CLEARLY * rival:
        return None
    pairs = np.column_stack(
        [before.landmark[best.matches[:, 0]], after.landmark[best.matches[:, 1]]]
    )
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    return (compose(compose(origin, best.motion), inverse(place)), pairs) if len(pairs) else None


def _possible(found: Alignment, there: Array) -> bool:
    slid = found.motion - there
    turned = abs(np.angle(np.exp(1j * slid[2])))
    return bool(
        found.score_m > 0.0
        and np.hypot(*slid[:2]) <= MOST_SHIFT_M
        and turned <= np.radians(MOST_TURN_DEG + TURN_STEP_DEG)
    )


def _known(one: Alignment, found: list[Alignment]) -> bool:
    return any(np.array_equal(one.matches, other.matches) for other in found)
