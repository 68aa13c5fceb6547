"""Both engines on one problem: do they find one minimum, and know it equally well?"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from graphslam.config import Engine, SmootherConfig
from graphslam.errors import BadMeasurements
from graphslam.estimate import Estimate
from graphslam.geometry import Array
from graphslam.measurements import Measurements
from graphslam.smoother.batch import engine_for, finish, minimise
from graphslam.smoother.problem import Problem, state_problem

COST_AGREES = 1e-9
COV_AGREES = 1e-6


@dataclass(frozen=True, slots=True)
class EngineAgreement:
    """How far two engines agree on one problem, both started from its solution.

    Attributes:
        engine: the one that made the estimate.
        other: the one it is held against.
        cost: difference of their costs, as a share of the cost (of 1 for a smaller one).
        covariance: largest difference of their covariances of last pose and map, in units of the
            standard deviations.
    """

    engine: str
    other: str
    cost: float
    covariance: float

    @property
    def agree(self) -> bool:
        """Whether both differences are within 1e-9 and 1e-6."""
        return self.cost <= COST_AGREES and self.covariance <= COV_AGREES

    def __str__(self) -> str:
        how = "agree" if self.agree else "do NOT agree"
        return (
            f"The engines {self.engine} and {self.other} {how}: cost to {self.cost:.1g} of itself, "
            f"covariances of last pose and map to {self.covariance:.1g} of their sigmas (wanted "
            f"{COST_AGREES:.0e} and {COV_AGREES:.0e})."
        )


def engines_agree(
    measurements: Measurements, estimate: Estimate, config: SmootherConfig | None = None
) -> EngineAgreement:
    """Returns how far both engines agree on the problem that an estimate solved.

    Each minimises from the estimate on, with its matches and its robust weights on sightings held;
    weights on odometry are 1, as the estimate does not tell them.

    Args:
        measurements: those of the estimate.
        estimate: of the smoother.
        config: how it was made.

    Raises:
        BadMeasurements: the estimate is not of these measurements, or of no smoother.
        UnderConstrained: the measurements do not determine every pose and landmark.
    """
    config = config or SmootherConfig()
    if not estimate.engine:
        raise BadMeasurements(f"{estimate.method} has no engine that could be checked")
    weight = np.where(np.isfinite(estimate.weight), estimate.weight, 1.0)
    problem = state_problem(measurements, estimate.match, estimate, weight)
    own = engine_for(problem, config.engine)
    other: Engine = "chain" if own == "gtsam" else "gtsam"
    first, second = (
        _minimum(problem, replace(config, engine=engine, tolerance=1e-14))
        for engine in (own, other)
    )
    cost = abs(first.cost - second.cost) / max(1.0, abs(first.cost))
    return EngineAgreement(own, other, cost, _apart(first.cov_joint, second.cov_joint))


def _minimum(problem: Problem, config: SmootherConfig) -> Estimate:
    return finish(problem, minimise(problem, config))


def _apart(cov: Array, other: Array) -> float:
    sigma = np.sqrt(np.diagonal(cov))
    scale = np.where(sigma > 0, sigma, 1.0)  # known landmarks have none
    return float(np.max(np.abs(cov - other) / np.outer(scale, scale)))
