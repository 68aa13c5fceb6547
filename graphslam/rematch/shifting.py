"""Moving stretches of the path, one by one, while that makes the measurements more probable."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice

from graphslam.config import RematchConfig, SmootherConfig
from graphslam.rematch.fitted import Fitted, renumbered
from graphslam.rematch.moving import matched, moved, near_lines, promise
from graphslam.rematch.rounds import LEAST_GAIN, Minimise, Rematched, rounds
from graphslam.rematch.slips import moves
from graphslam.smoother.problem import Problem

SHIFTED = "stretches of the path shifted by rematching"

ALLOWED = -15.0
"""Gain, in units of the cost, that odometry must at least promise of a move: a path that was bent
in odometry's favour costs something to straighten."""
LEAST_PROMISE = -12.0
"""What a move must promise at least to be tried."""
MOST_MOVES, MOST_TRIALS = 24, 96
"""Moves that are tried in vain before the search ends, and in all."""

FAR_ABOVE = 120.0
"""How far above the objective so far a round of a trial may end for another to be tried."""


def straightened(best: Rematched, config: SmootherConfig, minimise: Minimise) -> Rematched:
    """Returns the matches after all moves of the path, one by one, that lower the objective."""
    left = MOST_TRIALS
    while left > 0:
        for problem in islice(_candidates(best.fitted, config.rematching), min(left, MOST_MOVES)):
            left -= 1
            known = best.fitted.problem.match
            tried = rounds(problem, config, minimise, known, best.objective + FAR_ABOVE)
            if tried.objective < best.objective - LEAST_GAIN:
                counts = Counter(best.counts) + Counter(tried.counts) + Counter({SHIFTED: 1})
                best = replace(tried, counts=dict(counts))
                break
        else:
            break
    return best


def _candidates(fitted: Fitted, rules: RematchConfig) -> Iterator[Problem]:
    """Yields the problem after each move worth a trial, most promising first."""
    near, found = near_lines(fitted, rules), []
    for move in moves(fitted, ALLOWED):
        value = promise(moved(fitted, move, near, rules), fitted, move, rules)
        if value > LEAST_PROMISE:
            found.append((value, move))
    found.sort(key=lambda pair: (-pair[0], pair[1].first, pair[1].last))
    for _, move in found:
        problem = matched(moved(fitted, move, near, rules), fitted, rules)
        yield renumbered(problem, problem.match)
