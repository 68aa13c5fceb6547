"""What all second thoughts lower: how improbable measurements are under the matches as a whole."""

from __future__ import annotations

import math

import numpy as np

from graphslam.association import gate_for
from graphslam.config import RematchConfig
from graphslam.geometry import Array
from graphslam.rematch.crowd import DENSITY
from graphslam.rematch.fitted import UNMATCHED, Fitted, of_landmark_kinds, stretches_by_sighting
from graphslam.rematch.laid import laid_odds
from graphslam.rematch.reach import gap_price
from graphslam.rematch.view import joined, watched
from graphslam.smoother.problem import Problem
from graphslam.smoother.robust import ODOMETRY_DIM, SMALLEST_WEIGHT


def objective(fitted: Fitted, config: RematchConfig) -> float:
    """Returns the penalised cost that all decisions lower.

    It is the negative logarithm of the measurements' probability, by Laplace's approximation about
    the minimum, but for what all matches share: the cost of the minimum; half the gate for each
    sighting left out, so that a sighting is worth matching exactly while it costs less; the odds
    against each gap in a landmark; how improbable it is that landmarks in view were seen as often
    as they were (`view.watched`); for all landmarks together what they might be against how closely
    they are known, and how much more probable lines are where others lead one to expect them
    (`laid.laid_odds`). So two landmarks are worth merging while chance would not explain as well
    that they lie so near to each other (`crowd.most_surprise`). An increment that is switched off
    costs half of `slip_price`.
    """
    priced = without_landmarks(fitted.problem, fitted.minimum.cost, config)
    return priced + _landmarks(fitted) - laid_odds(fitted)


def without_landmarks(problem: Problem, cost: float, config: RematchConfig) -> float:
    """Returns `objective` without what landmarks cost by their places, which needs covariances.

    Args:
        problem: path, map and matches at the minimum.
        cost: of the minimum.
        config: the gate.
    """
    out = float(np.sum(of_landmark_kinds(problem) & (problem.match == UNMATCHED)))
    slipped = float(np.sum(problem.odometry_weight < 0.5)) * slip_price(config)
    lines = watched(problem, config)
    gaps = float(gap_price(_gaps_within(problem), config, lines.ends).sum())
    return cost + 0.5 * (config.gate * out + slipped + gaps) + lines.price


def slip_price(config: RematchConfig) -> float:
    """Returns the squared residual of an increment from which it is better switched off.

    A slip is rare, which is the gate, and may then be anything, which is the weight that is left.
    """
    return gate_for(config.gate, ODOMETRY_DIM) - ODOMETRY_DIM * math.log(SMALLEST_WEIGHT)


def _landmarks(fitted: Fitted) -> float:
    """Returns the price of all landmarks that are not known, together."""
    free = ~fitted.problem.fixed
    if not free.any():
        return 0.0
    size, count = int(np.array(fitted.problem.dims())[free].sum()), int(free.sum())
    log_det = fitted.minimum.map_log_det()
    return float(-0.5 * (log_det + size * math.log(2.0 * math.pi)) - count * math.log(DENSITY))


def _gaps_within(problem: Problem) -> Array:
    """Returns the gaps (g,), m, between the stretches that were seen of each landmark."""
    seen = stretches_by_sighting(problem)
    known = np.isfinite(seen).all(axis=1)
    parts = joined(problem.match[known], seen[known])
    gap = parts.low[1:] - parts.high[:-1]
    return np.asarray(gap[np.diff(parts.landmark) == 0])
