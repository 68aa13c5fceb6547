"""Where to begin: matches without the loops and the bridged gaps of an estimate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from graphslam.geometry import Array
from graphslam.measurements import IntArray
from graphslam.rematch.fitted import nodes_of, sightings_of, stretches_by_sighting
from graphslam.rematch.found import travelled
from graphslam.rematch.sure import Surety
from graphslam.smoother.problem import Problem


def parted(
    problem: Problem, window_m: float, gap_m: float = np.inf, surety: Surety | None = None
) -> Problem:
    """Returns the problem with every landmark parted where it was left behind.

    What was seen before a way of ``window_m`` without the landmark, and what was seen after, become
    two landmarks: no loop is closed any more, rightly or wrongly. So do stretches of it with a gap
    of ``gap_m`` between them, seen one after the other: short lines in a row may be on one line by
    chance. Known landmarks stay whole, and so do those to which odometry alone leads back.

    Args:
        problem: path, map and matches.
        window_m: way, m, after which a landmark that was not seen is left behind.
        gap_m: gap between what was seen of a landmark and what is seen next, m.
        surety: says to which landmarks odometry leads back; None for none.
    """
    way = travelled(problem.pose)[nodes_of(problem)]
    seen = stretches_by_sighting(problem)
    parts = []
    for own in _sightings_of_each(problem):
        own = own[np.argsort(way[own], kind="stable")]
        left = np.flatnonzero(np.diff(way[own]) > window_m)
        if surety is not None:
            left = left[~surety.of(own[left], own[left + 1])]
        cuts = _gaps(seen[own]) > gap_m
        cuts[left] = True
        parts += np.split(own, 1 + np.flatnonzero(cuts))[1:]
    return taken_apart(problem, parts)


def in_pieces(problem: Problem, gap_m: float) -> Problem:
    """Returns the problem with every landmark parted at the gaps in what was seen of it.

    Whenever that was: what was seen of one piece, early or late, stays together. Known landmarks
    stay whole.

    Args:
        problem: path, map and matches.
        gap_m: smallest gap along a landmark, m.
    """
    seen = stretches_by_sighting(problem)
    parts = []
    for own in _sightings_of_each(problem):
        own = own[np.argsort(seen[own, 0], kind="stable")]  # unknown ones last
        reached = np.fmax.accumulate(seen[own, 1])
        cuts = seen[own[1:], 0] - reached[:-1] > gap_m
        parts += np.split(own, 1 + np.flatnonzero(cuts))[1:]
    return taken_apart(problem, parts)


def taken_apart(problem: Problem, parts: Sequence[IntArray]) -> Problem:
    """Returns the problem with sets of sightings, each of one landmark, made landmarks of it."""
    match, count = problem.match.copy(), len(problem.kinds)
    source = [*range(count), *(int(problem.match[own[0]]) for own in parts)]
    for number, own in enumerate(parts):
        match[own] = count + number
    return replace(
        problem,
        match=match,
        kinds=tuple(problem.kinds[m] for m in source),
        fixed=problem.fixed[source],
        params=problem.params[source],
    )


def _sightings_of_each(problem: Problem) -> list[IntArray]:
    """Returns the sightings of each landmark that is not known, in order."""
    of = sightings_of(problem.match, len(problem.kinds))
    return [of[m] for m in np.flatnonzero(~problem.fixed).tolist()]


def _gaps(seen: Array) -> Array:
    """Returns the gaps (k-1,), m, between stretches (k, 2) and what was seen before; 0 if none."""
    low, high = np.fmin.accumulate(seen[:, 0]), np.fmax.accumulate(seen[:, 1])
    gap = np.fmax(seen[1:, 0] - high[:-1], low[:-1] - seen[1:, 1])
    return np.asarray(np.nan_to_num(gap))
