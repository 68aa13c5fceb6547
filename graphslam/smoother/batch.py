"""Full smoothing: every pose and every landmark from all measurements at once."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module

import numpy as np

from graphslam.config import Engine, SmootherConfig
from graphslam.ending import end
from graphslam.errors import UnderConstrained
from graphslam.estimate import Estimate
from graphslam.measurements import Measurements
from graphslam.smoother.fit import sighting_fit
from graphslam.smoother.problem import Minimum, Problem, state_problem
from graphslam.smoother.robust import minimise_robustly

ENGINES = {"gtsam": "graphslam.smoother.engine_gtsam", "chain": "graphslam.smoother.chain"}
CHAIN_FROM = 5_000
"""Nodes from which ``auto`` takes the chain engine: GTSAM then needs seconds, as compiling does."""
HOPELESS = 3.0
"""Misfit from which on a minimum counts as a wrong one, its start as too far off."""
SWITCHED_OFF = "sighting switched off by the robust kernel"
SLIPPED = "increment of odometry switched off as a slip"


def smooth(
    measurements: Measurements,
    initial: Estimate,
    config: SmootherConfig | None = None,
    linearise_at: Estimate | None = None,
) -> Estimate:
    """Returns the most likely path and map given all measurements, with marginal covariances.

    Args:
        measurements: the same as the filter's.
        initial: the filter's estimate: the start of the optimisation, and the matches; where the
            configuration says so, they are decided again (see `graphslam.rematch`).
        config: tolerance and largest number of iterations.
        linearise_at: where given, one linear solve at this path and map instead of an optimisation;
            it must have the numbering of ``initial``'s map.

    Raises:
        BadMeasurements: an estimate does not belong to these measurements.
        UnderConstrained: the measurements do not determine every pose and landmark.
    """
    problem = state_problem(measurements, initial.match, linearise_at or initial)
    if linearise_at is not None:
        from graphslam.smoother.engine_gtsam import solve_linear

        return finish(problem, solve_linear(problem))
    config = config or SmootherConfig()
    if not config.rematch:
        return solve(problem, config)
    from graphslam.rematch import rematch  # it imports this module

    if config.engine == "auto":
        config = replace(config, engine="chain")  # for hundreds of minima compiling pays
    found, counts = rematch(problem, config, minimise)
    estimate = solve(found, config)
    return replace(estimate, counts={**estimate.counts, **counts})


def solve(problem: Problem, config: SmootherConfig) -> Estimate:
    """Returns the minimum under the configured kernel as an estimate.

    Raises:
        UnderConstrained: the measurements do not determine every pose and landmark.
    """
    if config.robust == "none":
        minimum, iterations = _minimise_from_afar(problem, config)
        estimate = replace(finish(problem, minimum), iterations=iterations)
    else:
        estimate = finish(*minimise_robustly(problem, config, minimise))
    return replace(estimate, engine=engine_for(problem, config.engine))


def minimise(problem: Problem, config: SmootherConfig) -> Minimum:
    """Returns the minimum of a problem near its start, found by the configured engine.

    Raises:
        UnderConstrained: the measurements do not determine every pose and landmark.
    """
    engine = import_module(ENGINES[engine_for(problem, config.engine)])
    minimum: Minimum = engine.minimise(problem, config)
    return minimum


def misfit(problem: Problem, minimum: Minimum) -> float:
    """Returns the mean squared normalised residual at a minimum: about 1 where all is right."""
    sizes = [np.full(len(table), table.z.shape[1]) for _, table in problem.measurements.tables()]
    used = (problem.match >= 0) & (problem.weight > 0.0)
    counted = np.concatenate([np.zeros(0), *sizes])[used].sum()
    return float(2.0 * minimum.cost / (counted + 3.0 * len(problem.pose)))


def _minimise_from_afar(problem: Problem, config: SmootherConfig) -> tuple[Minimum, int]:
    """Returns the minimum from the problem's start or, where that is hopeless, a better one's.

    Where it leaves residuals far beyond their noise, the path is started anew, stretch by stretch
    (`graphslam.smoother.chain.start`), and the lower minimum counts. Also returns how many linear
    systems of the whole were solved.
    """
    minimum = minimise(problem, config)
    if misfit(problem, minimum) <= HOPELESS:
        return minimum, minimum.iterations
    from graphslam.smoother.chain import started_along

    try:
        other = minimise(started_along(problem, config), config)
    except UnderConstrained:
        return minimum, minimum.iterations
    best = other if other.cost < minimum.cost else minimum
    return best, minimum.iterations + other.iterations


def engine_for(problem: Problem, engine: Engine) -> Engine:
    """Returns the engine that ``engine`` stands for on this problem: "gtsam" or "chain"."""
    if engine != "auto":
        return engine
    return "chain" if len(problem.pose) >= CHAIN_FROM else "gtsam"


def at_start(problem: Problem, engine: Engine) -> Minimum:
    """Returns the problem's start itself, for its covariances; nothing is minimised."""
    point: Minimum = import_module(ENGINES[engine_for(problem, engine)]).at_start(problem)
    return point


def finish(problem: Problem, minimum: Minimum) -> Estimate:
    """Returns a minimum as an estimate; landmarks get their one name only here.

    Raises:
        UnderConstrained: the measurements do not determine every pose and landmark.
    """
    measurements, match, pose = problem.measurements, problem.match, minimum.pose
    cov, joint = minimum.covariances()
    nis, _ = sighting_fit(measurements, pose, minimum.params, match)
    off = problem.weight == 0.0
    nis[off] = np.nan
    used = np.isfinite(nis)
    ending = end(measurements, pose, cov, problem.kinds, minimum.params, match, used, joint)
    slipped = problem.odometry_weight < 0.5
    counts = {SWITCHED_OFF: int(off.sum()), SLIPPED: int(slipped.sum())}
    return Estimate(
        method="smoother",
        causal=False,
        t=measurements.t,
        pose=pose,
        cov_floor=cov,
        map=ending.map,
        cov_joint=ending.cov_joint,
        match=match,
        used=used,
        nis=nis,
        weight=problem.weight,
        cost=minimum.cost,
        iterations=minimum.iterations,
        converged=minimum.converged,
        unobserved=ending.unobserved,
        counts={reason: number for reason, number in counts.items() if number},
    )
