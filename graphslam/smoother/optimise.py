"""Gauss-Newton with Levenberg-Marquardt damping, driven from Python.

GTSAM's own optimisers copy all values into every call of a Python factor, which makes them
quadratic in the length of a log; ``graph.linearize(values)`` with values that Python owns does not.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import gtsam
import numpy as np

from graphslam.config import SmootherConfig
from graphslam.errors import UnderConstrained
from graphslam.smoother.problem import NOT_DETERMINED

FIRST_DAMPING = 1e-4
LARGEST_DAMPING = 1e10
DAMPING_FACTOR = 10.0


@dataclass(frozen=True, slots=True)
class Solution:
    """The end of an optimisation.

    Attributes:
        values: the variables.
        linear: the graph linearised at them.
        cost: half the sum of squared normalised residuals.
        iterations: linear systems solved.
        converged: whether the tolerance was met.
    """

    values: gtsam.Values
    linear: gtsam.GaussianFactorGraph
    cost: float
    iterations: int
    converged: bool


def optimise(
    graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, config: SmootherConfig
) -> Solution:
    """Returns the minimum of a factor graph near ``values``.

    Steps are plain Gauss-Newton while they lower the cost; a step that does not is tried again with
    ever larger damping. Converged when the decrease that the undamped linear model still predicts
    is below ``config.tolerance`` of the cost (or of 1, for a cost near zero).

    Raises:
        UnderConstrained: the linear system is singular.
    """
    cost = float(graph.error(values))
    linear = graph.linearize(values)
    damping = 0.0
    for iteration in range(1, config.max_iterations + 1):
        delta = solve(linear, values, damping)
        predicted = linear.error(values.zeroVectors()) - linear.error(delta)
        if predicted <= config.tolerance * max(cost, 1.0):
            if damping == 0.0:
                return Solution(values, linear, cost, iteration, True)
            damping = 0.0  # the damping alone made the step small: look without it
            continue
        moved = values.retract(delta)
        new_cost = float(graph.error(moved))
        if np.isfinite(new_cost) and new_cost <= cost:
            values, cost, damping = moved, new_cost, damping / DAMPING_FACTOR
            damping = 0.0 if damping < FIRST_DAMPING else damping
            linear = graph.linearize(values)
        elif damping > LARGEST_DAMPING:
            return Solution(values, linear, cost, iteration, False)
        else:
            damping = max(FIRST_DAMPING, DAMPING_FACTOR * damping)
    return Solution(values, linear, cost, config.max_iterations, False)


def solve(
    linear: gtsam.GaussianFactorGraph, values: gtsam.Values, damping: float = 0.0
) -> gtsam.VectorValues:
    """Returns the minimum of a linear graph over the variables in ``values``, damped.

    Raises:
        UnderConstrained: the system is singular, with the variable that GTSAM names.
    """
    if damping > 0.0:
        damped = gtsam.GaussianFactorGraph()
        damped.push_back(linear)
        zero = values.zeroVectors()
        for key in list(values.keys()):
            nothing = zero.at(key)
            dim = len(nothing)
            weight, unit = np.sqrt(damping) * np.eye(dim), gtsam.noiseModel.Unit.Create(dim)
            damped.push_back(gtsam.JacobianFactor(key, weight, nothing, unit))
        linear = damped
    with translated_errors():
        return linear.optimize(gtsam.EliminateQR)


@contextmanager
def translated_errors() -> Iterator[None]:
    """Turns GTSAM's report of a singular system into ours, with the variable that it names.

    Elimination is by QR throughout: GTSAM's Cholesky refuses well-determined systems whose only
    anchor is a weak prior.
    """
    try:
        yield
    except RuntimeError as error:
        told = " ".join(str(error).strip().splitlines()[:2])
        raise UnderConstrained(NOT_DETERMINED + told) from error
