"""Landmarks that are two: taken apart again where that makes the measurements more probable.

A join may have looked right when it was made, and no longer once a loop is closed: what is known of
the path by then tells lines apart that chance had put nearly on one line.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from graphslam.config import SmootherConfig
from graphslam.measurements import IntArray
from graphslam.rematch.decide import APART
from graphslam.rematch.fitted import Fitted
from graphslam.rematch.objective import objective, without_landmarks
from graphslam.rematch.rounds import LEAST_GAIN, Minimise, Rematched, rounds
from graphslam.rematch.starts import in_pieces, taken_apart
from graphslam.smoother.problem import Problem

SPLIT = "landmarks taken apart by rematching"


def split_at_gaps(best: Rematched, config: SmootherConfig, minimise: Minimise) -> Rematched:
    """Returns the matches after taking apart what has gaps; what is one joins again.

    Kept only where it lowers the objective.
    """
    problem = best.fitted.problem
    pieces = in_pieces(problem, APART * config.rematching.gap_m)
    if len(pieces.kinds) == len(problem.kinds):
        return best
    tried = rounds(pieces, config, minimise, problem.match)
    if tried.objective >= best.objective - LEAST_GAIN:
        return best
    more = max(1, len(tried.fitted.problem.kinds) - len(problem.kinds))
    return replace(tried, counts=dict(Counter(best.counts) + Counter({SPLIT: more})))


def split_joins(
    best: Rematched, joins: Sequence[IntArray], config: SmootherConfig, minimise: Minimise
) -> Rematched:
    """Returns the matches after undoing, one by one, joins of landmarks that do not fit.

    While the others hold the path, a join costs what the difference of its two landmarks is worth
    by their joint covariance; where that is more than chance makes of two lines so near to each
    other, the landmarks are two.

    Args:
        best: matches in which landmarks were joined.
        joins: sightings of one of the two landmarks of each join.
        config: rules.
        minimise: finds minima.
    """
    fitted, least, undone = best.fitted, best.objective, 0
    for sightings in joins:
        part = _part(fitted.problem, sightings)
        tried = _without(fitted, part, config, minimise) if len(part) else None
        if tried is not None:
            cost = objective(tried, config.rematching)
            if cost < least - LEAST_GAIN:
                fitted, least, undone = tried, cost, undone + 1
    if not undone:
        return best
    counts = dict(Counter(best.counts) + Counter({SPLIT: undone}))
    again = rounds(fitted.problem, config, minimise)
    if again.objective <= least:
        return replace(again, counts=counts)
    return Rematched(fitted, least, best.settled, counts)


def _without(
    fitted: Fitted, part: IntArray, config: SmootherConfig, minimise: Minimise
) -> Fitted | None:
    """Returns the minimum with a part of a landmark's sightings apart; None where it is no gain.

    One landmark more is never for nothing: what saves nothing before its price is paid is not worth
    the covariances by which that is known.
    """
    rules, apart = config.rematching, taken_apart(fitted.problem, [part])
    minimum = minimise(apart, config)
    moved = replace(apart, pose=minimum.pose, params=minimum.params)
    now = without_landmarks(fitted.problem, fitted.minimum.cost, rules)
    if without_landmarks(moved, minimum.cost, rules) >= now - LEAST_GAIN:
        return None
    return Fitted.of(apart, minimum)


def _part(problem: Problem, sightings: IntArray) -> IntArray:
    """Returns the sightings that still are of one landmark, which others see, too; else none."""
    match = problem.match[sightings]
    if not np.any(match >= 0):
        return sightings[:0]
    landmark = int(np.bincount(match[match >= 0]).argmax())
    part = sightings[match == landmark]
    others = int(np.sum(problem.match == landmark)) > len(part)
    return part if others and not problem.fixed[landmark] else sightings[:0]
