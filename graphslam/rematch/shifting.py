"""Shifting stretches of the path, one by one, while that makes the measurements more probable."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

from graphslam.config import SmootherConfig
from graphslam.rematch.fitted import renumbered
from graphslam.rematch.rounds import LEAST_GAIN, Minimise, Rematched, rounds
from graphslam.rematch.slips import shifted, shifts

SHIFTED = "stretches of the path shifted by rematching"

LEAST_PROMISE = 0.0
"""Gain, in units of the cost, that odometry must promise of a shift for it to be tried."""
MOST_SHIFTS, MOST_TRIALS = 16, 64
"""Shifts that are tried in vain before the search ends, and in all."""


def straightened(best: Rematched, config: SmootherConfig, minimise: Minimise) -> Rematched:
    """Returns the matches after all shifts of the path, one by one, that lower the objective."""
    left = MOST_TRIALS
    while left > 0:
        for shift in shifts(best.fitted, LEAST_PROMISE, min(left, MOST_SHIFTS)):
            left -= 1
            problem = shifted(best.fitted, shift, config.rematching)
            problem = renumbered(problem, problem.match)
            tried = rounds(problem, config, minimise, best.fitted.problem.match)
            if tried.objective < best.objective - LEAST_GAIN:
                counts = Counter(best.counts) + Counter(tried.counts) + Counter({SHIFTED: 1})
                best = replace(tried, counts=dict(counts))
                break
        else:
            break
    return best
