"""Where to begin: matches without the loops that an estimate has closed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from graphslam.rematch.fitted import nodes_of
from graphslam.rematch.found import travelled
from graphslam.smoother.problem import Problem


def parted(problem: Problem, window_m: float) -> Problem:
    """Returns the problem with every landmark parted where it was left behind.

    What was seen before a way of ``window_m`` without the landmark, and what was seen after, become
    two landmarks: no loop is closed any more, rightly or wrongly. Known landmarks stay whole.

    Args:
        problem: path, map and matches.
        window_m: way, m, after which a landmark that was not seen is left behind.
    """
    way = travelled(problem.pose)[nodes_of(problem)]
    match, source = problem.match.copy(), list(range(len(problem.kinds)))
    for landmark in np.flatnonzero(~problem.fixed).tolist():
        own = np.flatnonzero(match == landmark)
        own = own[np.argsort(way[own], kind="stable")]
        visits = np.split(own, 1 + np.flatnonzero(np.diff(way[own]) > window_m))
        for visit in visits[1:]:
            match[visit] = len(source)
            source.append(landmark)
    return replace(
        problem,
        match=match,
        kinds=tuple(problem.kinds[m] for m in source),
        fixed=problem.fixed[source],
        params=problem.params[source],
    )
