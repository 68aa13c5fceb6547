"""Deciding all matches again, round after round, until nothing changes."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from graphslam.config import RematchConfig, SmootherConfig
from graphslam.measurements import IntArray
from graphslam.rematch.decide import decide
from graphslam.rematch.fitted import UNMATCHED, Fitted, renumbered
from graphslam.rematch.found import start_landmarks
from graphslam.rematch.merge import merges
from graphslam.rematch.objective import objective
from graphslam.smoother.problem import Minimum, Problem

Minimise = Callable[[Problem, SmootherConfig], Minimum]

MERGED = "landmarks merged with another by rematching"
STARTED = "landmarks started by rematching"
DROPPED = "landmarks dropped for too few sightings by rematching"
ROUNDS = "rounds of rematching that only moved sightings"

PATIENCE = 3
"""Rounds without a lower objective after which no more are tried."""
LEAST_GAIN = 0.5
"""By how much a change of many matches must lower the objective to be kept."""


@dataclass(frozen=True, slots=True)
class Rematched:
    """Where deciding again has ended.

    Attributes:
        fitted: the matches that last, at their minimum.
        objective: what was lowered; see `graphslam.rematch.objective`.
        settled: whether nothing changed any more, within the rounds allowed.
        counts: what was changed, by name.
    """

    fitted: Fitted
    objective: float
    settled: bool
    counts: dict[str, int]


def rounds(
    problem: Problem,
    config: SmootherConfig,
    minimise: Minimise,
    before: IntArray | None = None,
    most: float = math.inf,
) -> Rematched:
    """Returns the best of what deciding again, round after round, comes by.

    Args:
        problem: where to begin.
        config: rules, and the largest number of rounds.
        minimise: finds minima.
        before: (K,) matches that are known already, at which there is no need to go on.
        most: objective above which there is no need to go on, either.
    """
    rules = config.rematching
    fitted = Fitted.of(problem, minimise(problem, config))
    counts: Counter[str] = Counter()
    best, least, settled, since = fitted, objective(fitted, rules), False, 0
    seen = set() if before is None else {before.tobytes()}
    for _ in range(rules.rounds if least <= most else 0):
        changed, done = _one_round(fitted, rules)
        name = changed.match.tobytes()
        if not done or name in seen or since == PATIENCE:
            settled = True
            break
        seen.add(name)
        counts += done
        fitted = Fitted.of(changed, minimise(changed, config))
        since, value = since + 1, objective(fitted, rules)
        if value <= least:
            best, least, since = fitted, value, 0
        if value > most:
            break
    return Rematched(best, least, settled, dict(counts))


def _one_round(fitted: Fitted, rules: RematchConfig) -> tuple[Problem, Counter[str]]:
    """Returns the problem with the matches decided again, and what was done."""
    done: Counter[str] = Counter()
    problem = fitted.problem
    decision = decide(fitted, rules)
    pairs = merges(fitted, rules)
    match = merged(decision.match, pairs)
    match, dropped = without_small(match, problem, rules.min_sightings)
    done[MERGED], done[DROPPED] = len(pairs), dropped
    alone = np.flatnonzero(decision.alone & (match == UNMATCHED))
    before = len(problem.kinds)
    problem = start_landmarks(replace(problem, match=match), alone, rules)
    done[STARTED] += len(problem.kinds) - before
    changed = bool(np.any(problem.match != fitted.problem.match))
    done += Counter()  # drops what was not done
    if changed and not done:
        done[ROUNDS] += 1
    return renumbered(problem, problem.match), done


def merged(match: IntArray, pairs: IntArray) -> IntArray:
    """Returns matches (K,) with pairs (p, 2) of landmarks made one, by the name of the first."""
    for a, b in pairs:
        keep, other = min(a, b), max(a, b)  # known landmarks come first
        match = np.where(match == other, keep, match)
    return match


def without_small(match: IntArray, problem: Problem, fewest: int) -> tuple[IntArray, int]:
    """Returns matches (K,) without landmarks that have too few, and how many those were.

    Known landmarks stay, however few.
    """
    count = np.bincount(match[match >= 0], minlength=len(problem.kinds))
    small = (count < fewest) & ~problem.fixed
    dropped = int(np.sum(small & (count > 0)))
    return np.where(np.append(small, False)[match], UNMATCHED, match), dropped
