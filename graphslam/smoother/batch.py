"""Full smoothing: every pose and every landmark from all measurements at once."""

from __future__ import annotations

from importlib import import_module

import numpy as np

from graphslam.association import mahalanobis
from graphslam.baseline import propagate
from graphslam.config import SmootherConfig
from graphslam.estimate import Estimate
from graphslam.geometry import Array
from graphslam.information import position_information, unobserved_directions
from graphslam.landmarks import finish_map, used_sightings
from graphslam.measurements import IntArray, Measurements
from graphslam.smoother.problem import Minimum, Problem, state_problem

ENGINES = {"gtsam": "graphslam.smoother.engine_gtsam", "chain": "graphslam.smoother.chain"}


def smooth(
    measurements: Measurements,
    initial: Estimate,
    config: SmootherConfig | None = None,
    linearise_at: Estimate | None = None,
) -> Estimate:
    """Returns the most likely path and map given all measurements, with marginal covariances.

    Args:
        measurements: the same as the filter's.
        initial: the filter's estimate: the start of the optimisation, and the matches.
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
    return finish(problem, minimise(problem, config or SmootherConfig()))


def minimise(problem: Problem, config: SmootherConfig) -> Minimum:
    """Returns the minimum of a problem near its start, found by the configured engine.

    Raises:
        UnderConstrained: the measurements do not determine every pose and landmark.
    """
    engine = import_module(ENGINES[config.engine])
    minimum: Minimum = engine.minimise(problem, config)
    return minimum


def finish(problem: Problem, minimum: Minimum) -> Estimate:
    """Returns a minimum as an estimate; landmarks get their one name only here.

    Raises:
        UnderConstrained: the measurements do not determine every pose and landmark.
    """
    measurements, match, pose = problem.measurements, problem.match, minimum.pose
    cov, joint = minimum.covariances()
    landmarks, joint = finish_map(measurements, pose, problem.kinds, minimum.params, match, joint)
    information = position_information(measurements, pose, landmarks, match)
    _, cov_odometry = propagate(measurements)
    nis = _fit(measurements, pose, landmarks.params, match)
    return Estimate(
        method="smoother",
        causal=False,
        t=measurements.t,
        pose=pose,
        cov_floor=cov,
        map=landmarks,
        cov_joint=joint,
        match=match,
        used=np.isfinite(nis),
        nis=nis,
        weight=problem.weight,
        cost=minimum.cost,
        iterations=minimum.iterations,
        converged=minimum.converged,
        unobserved=unobserved_directions(information, joint[:3, :3], cov_odometry[-1]),
    )


def _fit(measurements: Measurements, pose: Array, params: Array, match: IntArray) -> Array:
    """Returns squared residuals (K,) over the sightings' own covariances; NaN where not used."""
    nis = np.full(len(match), np.nan)
    for used in used_sightings(measurements, match, params):
        table, rows = used.table, used.rows
        e, _, _ = used.model.residual(pose[table.node[rows]], used.params, table.z[rows])
        nis[used.index] = mahalanobis(e, table.cov[rows])
    return nis
