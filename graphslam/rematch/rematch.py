"""Second thoughts: optimise, decide every match again, and so on until nothing changes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from graphslam.association import labels_agree
from graphslam.config import EkfConfig, RematchConfig, SmootherConfig
from graphslam.landmarks import labels_seen
from graphslam.measurements import IntArray
from graphslam.rematch.adrift import adrift, moored
from graphslam.rematch.closing import REFUSED, closures
from graphslam.rematch.decide import APART, decide
from graphslam.rematch.fitted import UNMATCHED, Fitted, of_landmark_kinds, renumbered
from graphslam.rematch.found import start_landmarks
from graphslam.rematch.merge import merges
from graphslam.rematch.objective import objective, slip_price
from graphslam.rematch.slips import shifted, shifts
from graphslam.rematch.starts import parted
from graphslam.rematch.submaps import submaps
from graphslam.rematch.torn import mend, tears
from graphslam.rematch.window import sliding_window
from graphslam.smoother.fit import odometry_fit
from graphslam.smoother.problem import Minimum, Problem, state_problem
from graphslam.smoother.robust import minimise_robustly

Minimise = Callable[[Problem, SmootherConfig], Minimum]

MERGED = "landmarks merged with another by rematching"
STARTED = "landmarks started by rematching"
DROPPED = "landmarks dropped for too few sightings by rematching"
REVIVED = "rejected sightings revived by rematching"
REJECTED = "sightings rejected by rematching"
SHIFTED = "stretches of the path shifted by rematching"
MOVED = "sightings moved to another landmark by rematching"

ROUNDS = "rounds of rematching that only moved sightings"
CLOSED = "loops closed by rematching"
MENDED = "places where odometry slipped mended by rematching"
MOORED = "stretches of nodes without odometry put in their place by rematching"
AFRESH = "rematching began anew from a pass of its own that forgets what it has left behind"
UNSETTLED = "rematching stopped before nothing changed any more"
DOUBTED = "loop closed by the first estimate, but in doubt: "
AGAIN = "rematching began anew without the loops that the first estimate closed"

HOPELESS = 0.1
"""Share of sightings without a landmark beyond which the matches given are not trusted at all."""
PATIENCE = 3
"""Rounds without a lower objective after which no more are tried."""
LEAST_PROMISE = 0.0
"""Gain, in units of the cost, that odometry must promise of a shift for it to be tried."""
LEAST_GAIN = 0.5
"""By how much a shift must lower the objective to be kept."""
MOST_SHIFTS, MOST_TRIALS = 16, 64
"""Shifts that are tried in vain before the search ends, and in all."""


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


def rematch(
    problem: Problem, config: SmootherConfig, minimise: Minimise
) -> tuple[Problem, dict[str, int]]:
    """Returns the problem with its matches decided again, at its minimum, and what was changed.

    Raises:
        UnderConstrained: the measurements do not determine every pose and landmark.
    """
    window_m = config.rematching.window_m
    best = settle(problem, config, minimise)
    apart = parted(problem, window_m, APART * config.rematching.gap_m)
    if len(apart.kinds) > len(problem.kinds):
        again = settle(apart, config, minimise)
        doubted = replace(best, counts={**best.counts, **_doubts(again)})
        best = _better(doubted, again, AGAIN)
    if max(_left_out(problem), _left_out(best.fitted.problem)) > HOPELESS:
        found = sliding_window(problem.measurements, EkfConfig(), window_m)
        afresh = state_problem(problem.measurements, found.match, found)
        best = _better(best, settle(afresh, config, minimise), AFRESH)
    best = _straightened(best, config, minimise)
    counts = Counter(best.counts) + compared(problem.match, best.fitted.problem.match)
    if not best.settled:
        counts[UNSETTLED] = 1
    return best.fitted.problem, dict(sorted(counts.items()))


def _better(best: Rematched, other: Rematched, name: str) -> Rematched:
    """Returns the one of lower objective; where that is the other, its counts say ``name``."""
    if other.objective < best.objective - LEAST_GAIN:
        return replace(other, counts={**other.counts, name: 1})
    return best


def _doubts(again: Rematched) -> dict[str, int]:
    """Returns in words which loops of a first estimate would not be closed without it."""
    named = {name: n for name, n in again.counts.items() if name.startswith(REFUSED)}
    return {DOUBTED + name.removeprefix(REFUSED): n for name, n in named.items()}


def _left_out(problem: Problem) -> float:
    """Returns the share of sightings that could have a landmark and have none."""
    matched = problem.match[of_landmark_kinds(problem)] != UNMATCHED
    return 1.0 - float(matched.mean()) if len(matched) else 0.0


def settle(problem: Problem, config: SmootherConfig, minimise: Minimise) -> Rematched:
    """Returns what deciding again makes of a problem's matches.

    The first minimum is found robustly, whatever kernel is configured: wrong matches must not bend
    the map by which they are judged.

    Raises:
        UnderConstrained: the measurements do not determine every pose and landmark.
    """
    problem = _robust(problem, config, minimise)
    best = _rounds(problem, config, minimise)
    best = _closed(best, config, minimise)
    if not config.robust_odometry:
        return best
    return _moored(_mended(best, config, minimise), config, minimise)


def _straightened(best: Rematched, config: SmootherConfig, minimise: Minimise) -> Rematched:
    """Returns the matches after all shifts of the path, one by one, that lower the objective."""
    left = MOST_TRIALS
    while left > 0:
        for shift in shifts(best.fitted, LEAST_PROMISE, min(left, MOST_SHIFTS)):
            left -= 1
            problem = shifted(best.fitted, shift, config.rematching)
            problem = renumbered(problem, problem.match)
            tried = _rounds(problem, config, minimise, best.fitted.problem.match)
            if tried.objective < best.objective - LEAST_GAIN:
                counts = Counter(best.counts) + Counter(tried.counts) + Counter({SHIFTED: 1})
                best = replace(tried, counts=dict(counts))
                break
        else:
            break
    return best


def _robust(problem: Problem, config: SmootherConfig, minimise: Minimise) -> Problem:
    """Returns the problem at a robust minimum, without what that switches off.

    Increments stay switched off only where they are far from fitting: one right increment in a
    thousand is not a slip.
    """
    kernel = config if config.robust != "none" else replace(config, robust="gnc")
    problem, minimum = minimise_robustly(problem, kernel, minimise)
    squared = odometry_fit(problem.measurements, minimum.pose)
    small = (problem.odometry_weight < 0.5) & (squared <= slip_price(config.rematching))
    weight = np.where(small, 1.0, problem.odometry_weight)
    problem = replace(problem, pose=minimum.pose, params=minimum.params, odometry_weight=weight)
    return renumbered(problem, np.where(problem.weight > 0.5, problem.match, UNMATCHED))


def _rounds(
    problem: Problem, config: SmootherConfig, minimise: Minimise, before: IntArray | None = None
) -> Rematched:
    """Returns the best of what deciding again, round after round, comes by.

    Args:
        problem: where to begin.
        config: rules, and the largest number of rounds.
        minimise: finds minima.
        before: (K,) matches that are known already, at which there is no need to go on.
    """
    rules = config.rematching
    fitted = Fitted.of(problem, minimise(problem, config))
    counts: Counter[str] = Counter()
    best, settled, since = fitted, False, 0
    seen = set() if before is None else {before.tobytes()}
    for _ in range(rules.rounds):
        changed, done = _one_round(fitted, rules)
        name = changed.match.tobytes()
        if not done or name in seen or since == PATIENCE:
            settled = True
            break
        seen.add(name)
        counts += done
        fitted = Fitted.of(changed, minimise(changed, config))
        since += 1
        if objective(fitted, rules) <= objective(best, rules):
            best, since = fitted, 0
    return Rematched(best, objective(best, rules), settled, dict(counts))


def _closed(best: Rematched, config: SmootherConfig, minimise: Minimise) -> Rematched:
    """Returns the matches after closing all loops that are beyond doubt and lower the objective."""
    rules = config.rematching
    maps = submaps(best.fitted, config, minimise)
    found = closures(best.fitted, maps, rules, config.robust_odometry)
    counts = Counter(best.counts) + Counter(found.refused)
    best = replace(best, counts=dict(counts))
    rows = best.fitted.problem.match
    for group in found.groups:
        problem = best.fitted.problem
        tried = _joined(problem, [_now(rows, problem.match, pair) for pair in group])
        tried = _robust(tried, config, minimise)
        closed = _rounds(tried, config, minimise)
        if closed.objective < best.objective - LEAST_GAIN:
            counts = Counter(best.counts) + Counter(closed.counts) + Counter({CLOSED: 1})
            best = replace(closed, counts=dict(counts))
    return best


def _mended(best: Rematched, config: SmootherConfig, minimise: Minimise) -> Rematched:
    """Returns the matches after mending the path where odometry must have been wrong."""
    for tear in tears(best.fitted, config, minimise):
        tried = mend(best.fitted.problem, tear)
        tried = _robust(_joined(tried, tear.pairs.tolist()), config, minimise)
        mended = _rounds(tried, config, minimise)
        if mended.objective < best.objective - LEAST_GAIN:
            counts = Counter(best.counts) + Counter(mended.counts) + Counter({MENDED: 1})
            mended = replace(mended, counts=dict(counts))
            return _mended(mended, config, minimise)
    return best


def _moored(best: Rematched, config: SmootherConfig, minimise: Minimise) -> Rematched:
    """Returns the matches after finding the place of nodes that odometry says nothing of."""
    for first, last in adrift(best.fitted):
        tried = moored(best.fitted, first, last, config.rematching)
        tried = _robust(renumbered(tried, tried.match), config, minimise)
        found = _rounds(tried, config, minimise)
        if found.objective < best.objective - LEAST_GAIN:
            counts = Counter(best.counts) + Counter(found.counts) + Counter({MOORED: 1})
            best = replace(found, counts=dict(counts))
    return best


def _now(before: IntArray, after: IntArray, pair: tuple[int, int]) -> tuple[int, int]:
    """Returns what two landmarks are called under other matches: as most of their sightings are."""
    a, b = (after[(before == landmark) & (after >= 0)] for landmark in pair)
    if not len(a) or not len(b):
        return UNMATCHED, UNMATCHED
    return int(np.bincount(a).argmax()), int(np.bincount(b).argmax())


def _joined(problem: Problem, pairs: list[tuple[int, int]]) -> Problem:
    """Returns the problem with pairs of landmarks joined, except known and differently labelled."""
    label = labels_seen(problem.measurements, problem.match, len(problem.kinds))
    name = np.arange(len(problem.kinds))
    for a, b in pairs:
        keep, other = sorted((int(name[a]), int(name[b])))  # known landmarks come first
        alike = bool(labels_agree(label[keep], label[other]))
        if min(a, b) >= 0 and alike and not problem.fixed[other]:
            name[name == other] = keep
            label[keep] = max(label[keep], label[other])
    match = np.where(problem.match >= 0, name[problem.match], UNMATCHED)
    return renumbered(problem, match)


def _one_round(fitted: Fitted, rules: RematchConfig) -> tuple[Problem, Counter[str]]:
    """Returns the problem with the matches decided again, and what was done."""
    done: Counter[str] = Counter()
    problem = fitted.problem
    decision = decide(fitted, rules)
    match = _merged(decision.match, merges(fitted, rules), done)
    match = _without_small(match, problem, rules.min_sightings, done)
    alone = np.flatnonzero(decision.alone & (match == UNMATCHED))
    before = len(problem.kinds)
    problem = start_landmarks(replace(problem, match=match), alone, rules)
    done[STARTED] += len(problem.kinds) - before
    changed = bool(np.any(problem.match != fitted.problem.match))
    done += Counter()  # drops what was not done
    if changed and not done:
        done[ROUNDS] += 1
    return renumbered(problem, problem.match), done


def _merged(match: IntArray, pairs: IntArray, done: Counter[str]) -> IntArray:
    for a, b in pairs:
        keep, other = min(a, b), max(a, b)  # known landmarks come first
        match = np.where(match == other, keep, match)
    done[MERGED] += len(pairs)
    return match


def _without_small(match: IntArray, problem: Problem, fewest: int, done: Counter[str]) -> IntArray:
    count = np.bincount(match[match >= 0], minlength=len(problem.kinds))
    small = (count < fewest) & ~problem.fixed
    done[DROPPED] += int(np.sum(small & (count > 0)))
    return np.where(np.append(small, False)[match], UNMATCHED, match)


def compared(before: IntArray, after: IntArray) -> Counter[str]:
    """Returns how many sightings were revived, rejected and moved to other landmarks."""
    out: Counter[str] = Counter()
    out[REVIVED] = int(np.sum((before < 0) & (after >= 0)))
    out[REJECTED] = int(np.sum((before >= 0) & (after < 0)))
    both = (before >= 0) & (after >= 0)
    heir: dict[int, int] = {}
    for landmark in np.unique(before[both]).tolist():
        heirs = np.bincount(after[both & (before == landmark)])
        heir[landmark] = int(np.argmax(heirs))
    moved = [heir[b] != a for b, a in zip(before[both].tolist(), after[both].tolist(), strict=True)]
    out[MOVED] = int(np.sum(moved))
    return +out
