"""Moving stretches of the path, one by one, while that makes the measurements more probable."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice

import numpy as np

from graphslam.config import RematchConfig, SmootherConfig
from graphslam.rematch.fitted import Fitted, partition, renumbered
from graphslam.rematch.moving import matched, moved, near_lines, promise
from graphslam.rematch.rounds import LEAST_GAIN, Minimise, Rematched, rounds
from graphslam.rematch.slips import moves
from graphslam.smoother.problem import Problem

SHIFTED = "stretches of the path shifted by rematching"

ALLOWED = -15.0
"""Gain, in units of the cost, that odometry must at least promise of a move: a path that was bent
in odometry's favour costs something to straighten."""
LEAST_PROMISE = -20.0
"""What a move must promise at least to be tried."""
MOST_MOVES, MOST_TRIALS = 48, 256
"""Moves that are tried in vain before the search ends, and in all."""

DOZEN = 12
FAR_ABOVE = 40.0
"""How far above the objective so far a round of a trial may end for another to be tried."""


def straightened(best: Rematched, config: SmootherConfig, minimise: Minimise) -> Rematched:
    """Returns the matches after all moves of the path, one by one, that lower the objective.

    Where there are any, the first move that lowers it and the one of a dozen that lowers it most
    may lead to different ends, of which the lower is returned.
    """
    vain: set[bytes] = set()
    first = _moved_on(best, config, minimise, 1, vain)
    if first is best:
        return best
    other = _moved_on(best, config, minimise, DOZEN, vain)
    return first if first.objective <= other.objective else other


def _moved_on(
    best: Rematched, config: SmootherConfig, minimise: Minimise, among: int, vain: set[bytes]
) -> Rematched:
    """Returns the matches after moves, each the best of the first ``among`` that promise most.

    Args:
        best: where to begin.
        config: rules.
        minimise: finds minima.
        among: how many moves are tried before the best of them is taken.
        vain: where trials have begun that led nowhere; those of this search are added.
    """
    left = MOST_TRIALS
    while left > 0:
        better: list[Rematched] = []
        known, most = best.fitted.problem.match, best.objective + FAR_ABOVE
        candidates = _candidates(best.fitted, config.rematching)
        for number, problem in enumerate(islice(candidates, min(left, MOST_MOVES))):
            if better and number >= among:
                break
            left -= 1
            begin = known.tobytes() + partition(problem.match).tobytes()
            if begin in vain:
                continue
            tried = rounds(problem, config, minimise, known, most)
            if tried.objective < best.objective - LEAST_GAIN:
                better.append(tried)
            else:
                vain.add(begin)
        if not better:
            break
        found = min(better, key=lambda tried: tried.objective)
        counts = Counter(best.counts) + Counter(found.counts) + Counter({SHIFTED: 1})
        best = replace(found, counts=dict(counts))
    return best


def _candidates(fitted: Fitted, rules: RematchConfig) -> Iterator[Problem]:
    """Yields the problem after each move worth a trial, most promising first.

    What puts the same sightings together as they are, or as another move has them, is no trial.
    """
    found, tried = [], moves(fitted, ALLOWED)
    reach = max((float(np.hypot(*m.motion[:2])) for m in tried if not m.motion[2]), default=0.0)
    near = near_lines(fitted, reach, rules)
    for move in tried:
        value = promise(moved(fitted, move, near, rules), fitted, move, rules)
        if value > LEAST_PROMISE:
            found.append((value, move))
    found.sort(key=lambda pair: (-pair[0], pair[1].first, pair[1].last))
    seen = {partition(fitted.problem.match).tobytes()}
    for _, move in found:
        problem = matched(moved(fitted, move, near, rules), fitted, rules)
        name = partition(problem.match).tobytes()
        if name not in seen:
            seen.add(name)
            yield renumbered(problem, problem.match)
