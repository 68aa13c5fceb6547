"""Robust kernels by a loop over weights: each round is a plain weighted minimum.

GTSAM's own robust optimiser cannot be used with custom factors (it clones them), and a loop over
weights works with every engine.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from graphslam.association import gate_for
from graphslam.config import SmootherConfig
from graphslam.geometry import Array
from graphslam.landmarks import known_count
from graphslam.smoother.fit import odometry_fit, sighting_fit
from graphslam.smoother.problem import Minimum, Problem

ODOMETRY_DIM = 3
SMALLEST_WEIGHT = 1e-6
"""Of an increment: without any, the chain of poses would break."""
ANNEALING = 1.4
"""Factor on the control parameter a round; Yang et al. (2020) use the same."""
SETTLED = 1e-3
"""Weights that change by less than this from round to round are final."""
MOST_ROUNDS = 100
ROUGH = 1e-4
"""Tolerance of the minima between: the weights change more than they do."""

Minimise = Callable[[Problem, SmootherConfig], Minimum]


def minimise_robustly(
    problem: Problem, config: SmootherConfig, minimise: Minimise
) -> tuple[Problem, Minimum]:
    """Returns the problem with its final weights, and its minimum.

    Args:
        problem: weights in it are where the loop starts.
        config: kernel, threshold, and whether increments are robust too.
        minimise: finds a plain weighted minimum.

    Raises:
        UnderConstrained: the measurements do not determine every pose and landmark.

    Source: graduated non-convexity with truncated least squares: Yang, Antonante, Tzoumas, Carlone,
    RA-L 2020, eqs. (12), (14); Huber's and Cauchy's weights as in any textbook.
    """
    weigher = _Weigher(problem, config)
    rough = replace(config, tolerance=max(config.tolerance, ROUGH))
    for _ in range(MOST_ROUNDS):
        minimum = minimise(problem, rough)
        weight, odometry_weight = weigher.weights(minimum)
        change = max(
            np.max(np.abs(weight - problem.weight), initial=0.0),
            np.max(np.abs(odometry_weight - problem.odometry_weight), initial=0.0),
        )
        problem = replace(
            problem,
            pose=minimum.pose,
            params=minimum.params,
            weight=weight,
            odometry_weight=odometry_weight,
        )
        if change < SETTLED and weigher.settled:
            break
    return problem, minimise(problem, config)


class _Weigher:
    """The kernel's weights round after round, sharper every time where it is annealed."""

    def __init__(self, problem: Problem, config: SmootherConfig) -> None:
        self.problem, self.config = problem, config
        self.limit = np.ones(problem.measurements.sighting_count)
        self.control: float | None = None
        self.settled = config.robust != "gnc"

    def weights(self, minimum: Minimum) -> tuple[Array, Array]:
        """Returns weights of all sightings (K,) and increments (N-1,) for the next round."""
        problem = self.problem
        squared, dim = sighting_fit(
            problem.measurements, minimum.pose, minimum.params, problem.match
        )
        used = np.isfinite(squared)
        ratio = np.zeros(len(squared))  # squared residual over the largest an inlier has
        for d in np.unique(dim[used]):
            ratio[dim == d] = squared[dim == d] / gate_for(self.config.robust_gate, int(d))
        step = np.zeros(0)
        if self.config.robust_odometry:
            step = odometry_fit(problem.measurements, minimum.pose)
            step = step / gate_for(self.config.robust_gate, ODOMETRY_DIM)
        self._anneal(max(np.max(ratio, initial=0.0), np.max(step, initial=0.0)))
        weight = self._keep_one_each(np.where(used, self._kernel(ratio), 1.0), ratio)
        if not self.config.robust_odometry:
            return weight, np.ones(len(problem.odometry_weight))
        return weight, np.maximum(self._kernel(step), SMALLEST_WEIGHT)

    def _anneal(self, worst: float) -> None:
        if self.config.robust != "gnc":
            return
        if self.control is None:
            self.control = 1.0 / max(2.0 * worst - 1.0, 1e-3)
        else:
            self.control *= ANNEALING
        self.settled = self.control > 1e2

    def _kernel(self, ratio: Array) -> Array:
        if self.config.robust == "huber":
            return np.asarray(1.0 / np.sqrt(np.maximum(ratio, 1.0)))
        if self.config.robust == "cauchy":
            return np.asarray(1.0 / (1.0 + ratio))
        assert self.control is not None
        mu = self.control
        between = np.sqrt(mu * (mu + 1.0) / np.maximum(ratio, 1e-300)) - mu
        return np.asarray(np.clip(between, 0.0, 1.0))

    def _keep_one_each(self, weight: Array, ratio: Array) -> Array:
        """Returns weights with one sighting of each landmark left in use.

        Without any a landmark would not be determined; alone, a sighting fits its landmark exactly.
        """
        match, known = self.problem.match, known_count(self.problem.measurements)
        free = match >= known
        left = np.bincount(match[free], weight[free], minlength=len(self.problem.kinds))
        for landmark in known + np.flatnonzero(left[known:] <= 0.0):
            own = np.flatnonzero(match == landmark)
            weight[own[np.argmin(ratio[own])]] = 1.0
        return weight
