"""Whether anything says that odometry slipped, so that looking for slips is worth its time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from graphslam.association import gate_for
from graphslam.config import RematchConfig
from graphslam.geometry import Array, line_to_robot, nearest_twin, position_along
from graphslam.landmarks import stretches_seen
from graphslam.measurements import IntArray
from graphslam.models.line import LINE
from graphslam.rematch.adrift import MOST
from graphslam.rematch.fitted import UNMATCHED, nodes_of, of_landmark_kinds
from graphslam.rematch.found import travelled
from graphslam.rematch.objective import slip_price
from graphslam.rematch.starts import parted
from graphslam.rematch.torn import (
    LEAST_MATCHES,
    MOST_SHIFT_M,
    MOST_TURN_DEG,
    gaps,
    lifetimes,
)
from graphslam.smoother.fit import odometry_fit
from graphslam.smoother.problem import Problem
from graphslam.smoother.robust import ODOMETRY_DIM


def may_have_slipped(problem: Problem, config: RematchConfig) -> bool:
    """Returns whether odometry seems to have slipped anywhere.

    Either matches before and behind a place bend the path there against odometry, so far that a
    slip would be the cheaper. Or nothing was matched across a place, and lines that begin behind it
    lie where a slip there would have put copies of those that end before it.

    Args:
        problem: path, map and matches at their minimum.
        config: the gate, and how far from such a place lines are compared.
    """
    return _bent(problem, config) or _copied(problem, config)


def slipped(problem: Problem) -> int:
    """Returns at how many places increments are switched off.

    Those before and behind one stretch of nodes adrift are one place.
    """
    off = np.flatnonzero(problem.odometry_weight < 0.5)
    return int(np.sum(np.diff(off, prepend=-np.inf) > MOST))


def _bent(problem: Problem, config: RematchConfig) -> bool:
    """Returns whether increments that fit worse than a right one may cost more than a slip does.

    Those within `MOST` nodes count together, and so do the sightings that were left out there: a
    path that is bent over several increments fits neither well.
    """
    squared = odometry_fit(problem.measurements, problem.pose)
    far = squared > gate_for(config.gate, ODOMETRY_DIM)
    out = of_landmark_kinds(problem) & (problem.match == UNMATCHED)
    lost = config.gate * np.bincount(nodes_of(problem)[out], minlength=len(problem.pose))
    total = np.concatenate([[0.0], np.cumsum(np.where(far, squared, 0.0) + lost[1:])])
    at = np.flatnonzero(far)
    begin, end = np.maximum(at - MOST // 2, 0), np.minimum(at + MOST // 2, len(squared))
    return bool(np.any(total[end] - total[begin] > slip_price(config)))


def _copied(problem: Problem, config: RematchConfig) -> bool:
    """Returns whether lines lie behind any gap as if they were copies of those before it."""
    recent = parted(problem, config.window_m)
    begun, ended = lifetimes(recent)
    way = travelled(problem.pose)
    lines = recent.of_kind(LINE.kind)
    by_end, by_begin = (lines[np.argsort(of[lines], kind="stable")] for of in (ended, begun))
    seen = stretches_seen(recent.measurements, recent.pose, recent.params, recent.match)
    for first, last in gaps(recent):
        near = way[first] - config.window_m, way[last] + config.window_m
        early, late = np.searchsorted(way, near[0]), np.searchsorted(way, near[1], side="right")
        before = by_end[slice(*np.searchsorted(ended[by_end], [early, first + 1]))]
        behind = by_begin[slice(*np.searchsorted(begun[by_begin], [last, late]))]
        if min(len(before), len(behind)) >= LEAST_MATCHES:
            alike = _alike(recent, seen, before, behind, recent.pose[last])
            if min(alike.any(axis=0).sum(), alike.any(axis=1).sum()) >= LEAST_MATCHES:
                return True
    return False


def _alike(
    problem: Problem, seen: Array, before: IntArray, behind: IntArray, place: Array
) -> NDArray[np.bool_]:
    """Returns (b, c) whether lines behind a place may be those before it after a slip there.

    A turn about the place changes neither how far from it a line lies nor where along it the foot
    of that distance is; a slide changes both by its length at most.
    """
    lines = [
        line_to_robot(problem.params[of, : LINE.dim_landmark], place) for of in (before, behind)
    ]
    one, other = lines[0][:, None], nearest_twin(lines[1][None, :], lines[0][:, None])
    off = other - one
    low, high = (_from_foot(problem, seen, of, place) for of in (before, behind))
    flipped = np.abs(other[..., 1] - lines[1][None, :, 1]) > 1.0
    stretch = np.where(flipped[..., None], -high[None, :, ::-1], high[None, :])
    gap = np.fmax(stretch[..., 0], low[:, None, 0]) - np.fmin(stretch[..., 1], low[:, None, 1])
    turned = np.abs(np.angle(np.exp(1j * off[..., 1]))) <= np.radians(MOST_TURN_DEG)
    return np.asarray(turned & (np.abs(off[..., 0]) <= MOST_SHIFT_M) & ~(gap > MOST_SHIFT_M))


def _from_foot(problem: Problem, seen: Array, lines: IntArray, place: Array) -> Array:
    """Returns the stretches (k, 2) of lines, m, from the foot of their distance from a place."""
    return np.asarray(seen[lines] - position_along(problem.params[lines, :2], place[:2])[:, None])
