"""Second thoughts: optimise, decide every match again, and so on until nothing changes."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np

from graphslam.association import labels_agree
from graphslam.config import EkfConfig, SmootherConfig
from graphslam.estimate import LOOP_DOUBTED, LOOP_OPEN
from graphslam.landmarks import labels_seen
from graphslam.measurements import IntArray
from graphslam.rematch.adrift import adrift, moored
from graphslam.rematch.closing import closures
from graphslam.rematch.decide import APART
from graphslam.rematch.fitted import UNMATCHED, of_landmark_kinds, renumbered
from graphslam.rematch.objective import slip_price
from graphslam.rematch.rounds import LEAST_GAIN, Minimise, Rematched, rounds
from graphslam.rematch.shifting import straightened
from graphslam.rematch.slipping import may_have_slipped, slipped
from graphslam.rematch.split import split_at_gaps, split_joins
from graphslam.rematch.starts import parted
from graphslam.rematch.submaps import submaps
from graphslam.rematch.sure import Surety
from graphslam.rematch.torn import mend, tears
from graphslam.rematch.window import sliding_window
from graphslam.smoother.fit import odometry_fit
from graphslam.smoother.problem import Problem, state_problem
from graphslam.smoother.robust import SMALLEST_WEIGHT, minimise_robustly

REVIVED = "rejected sightings revived by rematching"
REJECTED = "sightings rejected by rematching"
MOVED = "sightings moved to another landmark by rematching"

CLOSED = "loops closed by rematching"
MENDED = "places where odometry slipped mended by rematching"
MOORED = "stretches of nodes without odometry put in their place by rematching"
AFRESH = "rematching began anew from a pass of its own that forgets what it has left behind"
UNSETTLED = "rematching stopped before nothing changed any more"
AGAIN = "rematching began anew without the loops that the first estimate closed"

HOPELESS = 0.1
"""Share of sightings without a landmark beyond which the matches given are not trusted at all."""


def rematch(
    problem: Problem, config: SmootherConfig, minimise: Minimise
) -> tuple[Problem, dict[str, int]]:
    """Returns the problem with its matches decided again, at its minimum, and what was changed.

    Slips are looked for where increments are robust and, whether they are or not, where something
    says that there was one: they are then priced, and kept where they are the more probable.

    Raises:
        UnderConstrained: the measurements do not determine every pose and landmark.
    """
    best = _searched(problem, config, minimise)
    if not config.robust_odometry and may_have_slipped(best.fitted.problem, config.rematching):
        best = _with_slips(best, problem, config, minimise)
    counts = Counter(best.counts) + compared(problem.match, best.fitted.problem.match)
    if not best.settled:
        counts[UNSETTLED] = 1
    return best.fitted.problem, dict(sorted(counts.items()))


def _searched(problem: Problem, config: SmootherConfig, minimise: Minimise) -> Rematched:
    """Returns the best of what deciding again makes of a problem, from all starts there are."""
    window_m = config.rematching.window_m
    best = settle(problem, config, minimise)
    surety = None if config.robust_odometry else Surety(problem, config.rematching)
    apart = parted(problem, window_m, APART * config.rematching.gap_m, surety)
    if len(apart.kinds) > len(problem.kinds):
        again = settle(apart, config, minimise)
        doubted = replace(best, counts={**best.counts, **_doubts(again)})
        best = _better(doubted, again, AGAIN)
    if max(_left_out(problem), _left_out(best.fitted.problem)) > HOPELESS:
        found = sliding_window(problem.measurements, EkfConfig(), window_m)
        afresh = state_problem(problem.measurements, found.match, found)
        best = _better(best, settle(afresh, config, minimise), AFRESH)
    return straightened(split_at_gaps(best, config, minimise), config, minimise)


def _with_slips(
    best: Rematched, problem: Problem, config: SmootherConfig, minimise: Minimise
) -> Rematched:
    """Returns the matches found with slips looked for, where there are any and it is the better."""
    config = replace(config, robust="gnc", robust_odometry=True)
    found = _searched(problem, config, minimise)
    places = slipped(found.fitted.problem)
    if not places or found.objective >= best.objective - LEAST_GAIN:
        return best
    return replace(found, counts={**found.counts, MENDED: places})


def _better(best: Rematched, other: Rematched, name: str) -> Rematched:
    """Returns the one of lower objective; where that is the other, its counts say ``name``."""
    if other.objective < best.objective - LEAST_GAIN:
        return replace(other, counts={**other.counts, name: 1})
    return best


def _doubts(again: Rematched) -> dict[str, int]:
    """Returns in words which loops of a first estimate would not be closed without it."""
    named = {name: n for name, n in again.counts.items() if name.startswith(LOOP_OPEN)}
    return {LOOP_DOUBTED + name.removeprefix(LOOP_OPEN): n for name, n in named.items()}


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
    best = rounds(problem, config, minimise)
    best = _closed(best, config, minimise)
    if not config.robust_odometry:
        return best
    return _moored(_mended(best, config, minimise), config, minimise)


def _robust(problem: Problem, config: SmootherConfig, minimise: Minimise) -> Problem:
    """Returns the problem at a robust minimum, without what that switches off.

    Increments are switched off only where they are far from fitting: one right increment in a
    thousand is not a slip. All others count in full.
    """
    kernel = config if config.robust != "none" else replace(config, robust="gnc")
    problem, minimum = minimise_robustly(problem, kernel, minimise)
    squared = odometry_fit(problem.measurements, minimum.pose)
    slip = (problem.odometry_weight < 0.5) & (squared > slip_price(config.rematching))
    weight = np.where(slip, SMALLEST_WEIGHT, 1.0)
    problem = replace(problem, pose=minimum.pose, params=minimum.params, odometry_weight=weight)
    return renumbered(problem, np.where(problem.weight > 0.5, problem.match, UNMATCHED))


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
        if np.array_equal(tried.match, problem.match):
            continue  # what was closed before has joined them already
        tried = _robust(tried, config, minimise)
        closed = rounds(tried, config, minimise)
        later = [np.flatnonzero(rows == b) for _, b in group]
        closed = split_joins(closed, later, config, minimise)
        if closed.objective < best.objective - LEAST_GAIN:
            counts = Counter(best.counts) + Counter(closed.counts) + Counter({CLOSED: 1})
            best = replace(closed, counts=dict(counts))
    return best


def _mended(best: Rematched, config: SmootherConfig, minimise: Minimise) -> Rematched:
    """Returns the matches after mending the path where odometry must have been wrong."""
    for tear in tears(best.fitted, config, minimise):
        tried = mend(best.fitted.problem, tear)
        tried = _robust(_joined(tried, tear.pairs.tolist()), config, minimise)
        mended = rounds(tried, config, minimise)
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
        found = rounds(tried, config, minimise)
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
