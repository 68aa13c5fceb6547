"""The whole way of a long log: odometry calibrates itself, a filter forgets, loops are closed.

odometry -> filter over a window -> drift -> filter -> robust fit -> loops -> matches again
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np

from graphslam.config import EkfConfig, LongConfig, Matching, SmootherConfig
from graphslam.estimate import LOOP_OPEN, Estimate
from graphslam.long.drift import NAMES, UNKNOWN, Drift, corrected, fit_drift
from graphslam.long.joining import Minimise
from graphslam.long.loops import Search
from graphslam.measurements import Measurements, Odometry
from graphslam.rematch.decide import decide
from graphslam.rematch.fitted import UNMATCHED, Fitted, renumbered
from graphslam.rematch.merge import merges
from graphslam.rematch.rounds import merged, without_small
from graphslam.rematch.window import sliding_window
from graphslam.smoother.batch import finish, minimise
from graphslam.smoother.problem import Problem, state_problem
from graphslam.smoother.robust import minimise_robustly

METHOD_WINDOW, METHOD_LOOPS = "ekf-window", "loops"
CLOSED = "loops closed"
MENDED = "loops closed where the path was torn, and had to be mended"
SWITCHED_OFF = "sighting switched off by the robust kernel before loops were closed"
REJECTED = "sighting of no landmark after all matches were decided again"


def run_window(
    measurements: Measurements, ekf: EkfConfig, config: LongConfig | None = None
) -> Estimate:
    """Returns a filter's estimate that matches only with what was seen a short way ago.

    Odometry calibrates itself before: the filter runs with noise that leaves room for odometry's
    drift, drift and noise are fitted to its path, and it runs again. Given the calibration, which
    is that of the whole log, the estimate is causal.

    Args:
        measurements: nodes, odometry, sightings.
        ekf: the filter; its way of matching, where it is the default, becomes the joint one.
        config: window and passes.
    """
    config = config or LongConfig()
    joint = replace(ekf, matching=replace(ekf.matching, method=_matching(ekf)))
    increment, drift = measurements.odometry.increment, None
    if config.calibrate and len(increment):
        drift = UNKNOWN
        for _ in range(config.passes):
            moved = with_drift(measurements, drift)
            found = sliding_window(moved, joint, config.window_m, anew=True)
            start = state_problem(moved, found.match, found)
            smoothed = _robust(start, SmootherConfig(engine="chain"), Counter())
            drift = fit_drift(increment, smoothed.pose)
        measurements = with_drift(measurements, drift)
    found = sliding_window(measurements, joint, config.window_m, anew=True)
    return replace(found, method=METHOD_WINDOW, quantities=_told(drift))


def close_all_loops(
    measurements: Measurements,
    window: Estimate,
    smoother: SmootherConfig,
    config: LongConfig | None = None,
) -> Estimate:
    """Returns the most likely path and map after closing every loop that is beyond doubt.

    Args:
        measurements: as they were given to `run_window`.
        window: what that found.
        smoother: gates and tolerances; the engine is the chain's, which alone is fast enough.
        config: whether loops are closed, and how often matches are decided again.

    Raises:
        UnderConstrained: the measurements do not determine every pose and landmark.
    """
    config = config or LongConfig()
    smoother = replace(smoother, engine="chain")
    given = measurements
    drift = drift_of(window)
    if drift is not None:
        measurements = with_drift(given, drift)
    counts: Counter[str] = Counter()
    problem = _robust(state_problem(measurements, window.match, window), smoother, counts)
    fitted = Fitted.of(problem, minimise(problem, smoother))
    if config.close:
        fitted = _closed(fitted, smoother, minimise, counts)
    for _ in range(config.rounds):
        if drift is not None:
            drift = _fitted_again(drift, given, fitted)
            fitted = _with_measurements(fitted, with_drift(given, drift))
        before, fitted = fitted.problem.match, _decided(fitted, smoother)
        if np.array_equal(before, fitted.problem.match):
            break
    problem = fitted.problem
    counts[REJECTED] = int(np.sum(problem.match == UNMATCHED))
    estimate = finish(problem, fitted.minimum)
    told = {**dict(estimate.counts), **{name: n for name, n in sorted(counts.items()) if n}}
    return replace(
        estimate, method=METHOD_LOOPS, engine="chain", counts=told, quantities=_told(drift)
    )


def with_drift(measurements: Measurements, drift: Drift) -> Measurements:
    """Returns measurements whose odometry is corrected."""
    odometry = Odometry(*corrected(measurements.odometry.increment, drift))
    return replace(measurements, odometry=odometry)


def drift_of(estimate: Estimate) -> Drift | None:
    """Returns the drift that an estimate's odometry was corrected by, or None."""
    told = estimate.quantities
    if NAMES[0] not in told:
        return None
    values, sigma = np.array([told[name] for name in NAMES]).T
    rates = np.array([[told[name][0] for name in row] for row in _RATES])
    return Drift(values, sigma, rates)


_RATES = tuple(
    (f"noise of {axis} {unit}/sqrt(m)", f"noise of {axis} {unit}/sqrt(rad)")
    for axis, unit in (("x,", "m"), ("y,", "m"), ("heading,", "rad"))
)


def _told(drift: Drift | None) -> dict[str, tuple[float, float]]:
    """Returns a drift as quantities of an estimate, each with its standard deviation."""
    if drift is None:
        return {}
    pairs = zip(drift.values.tolist(), drift.sigma.tolist(), strict=True)
    values = dict(zip(NAMES, pairs, strict=True))
    names = [name for row in _RATES for name in row]
    rates = {name: (r, 0.0) for name, r in zip(names, drift.rates.ravel().tolist(), strict=True)}
    return {**values, **rates}


def _matching(ekf: EkfConfig) -> Matching:
    """Returns how the filter matches; instead of the default, jointly: walls are parallel."""
    return "jcbb" if ekf.matching.method == "gated" else ekf.matching.method


def _robust(problem: Problem, config: SmootherConfig, counts: Counter[str]) -> Problem:
    """Returns the problem at a robust minimum, without what that switches off."""
    kernel = config if config.robust != "none" else replace(config, robust="gnc")
    weighed, minimum = minimise_robustly(problem, kernel, minimise)
    off = (weighed.weight <= 0.5) & (weighed.match >= 0)
    counts[SWITCHED_OFF] += int(off.sum())
    found = replace(weighed, pose=minimum.pose, params=minimum.params)
    return renumbered(found, np.where(off, UNMATCHED, found.match))


def _closed(
    fitted: Fitted, config: SmootherConfig, minimise: Minimise, counts: Counter[str]
) -> Fitted:
    """Returns the matches after closing loops, where they are expected and where they are not."""
    search = Search(fitted, config, minimise)
    search.close()
    for _ in range(3):
        if not search.mend():
            break
        search.close()
    search.close()
    counts[CLOSED], counts[MENDED] = search.closed, search.mended
    for reason, number in search.open_places().items():
        counts[LOOP_OPEN + reason] += number
    return search.fitted


def _fitted_again(drift: Drift, given: Measurements, fitted: Fitted) -> Drift:
    """Returns the drift by a better path; the noise stays, as a smoothed path hides it."""
    found = fit_drift(given.odometry.increment, fitted.problem.pose)
    return replace(found, rates=drift.rates)


def _with_measurements(fitted: Fitted, measurements: Measurements) -> Fitted:
    return replace(fitted, problem=replace(fitted.problem, measurements=measurements))


def _decided(fitted: Fitted, config: SmootherConfig) -> Fitted:
    """Returns the minimum after deciding every match again, and merging what is one."""
    rules = config.rematching
    match = merged(decide(fitted, rules).match, merges(fitted, rules))
    match, _ = without_small(match, fitted.problem, rules.min_sightings)
    problem = renumbered(fitted.problem, match)
    return Fitted.of(problem, minimise(problem, config))
