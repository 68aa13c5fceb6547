"""Robust kernels by a loop over weights: each round is a plain weighted minimum.

GTSAM's own robust optimiser cannot be used with custom factors (it clones them), and a loop over
weights works with every engine.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from graphslam.association import gate_for
from graphslam.config import Robust, SmootherConfig
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
SHARP = 1e2
"""Control parameter at which the kernel is as good as truncated least squares."""
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
    rough = replace(config, tolerance=max(config.tolerance, ROUGH))
    weigher = _Weigher(problem, config)
    problem = _annealed(problem, rough, minimise, weigher)
    if config.robust_odometry:
        weigher.take_odometry()
        problem = _annealed(problem, rough, minimise, weigher)
    return problem, minimise(problem, config)


def _annealed(
    problem: Problem, config: SmootherConfig, minimise: Minimise, weigher: _Weigher
) -> Problem:
    """Returns the problem at the weights at which the loop comes to rest."""
    for _ in range(MOST_ROUNDS):
        minimum = minimise(problem, config)
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
    return problem


class _Kernel:
    """Weights of one kind of residuals, sharper every round where it is annealed."""

    def __init__(self, robust: Robust) -> None:
        self.robust = robust
        self.control: float | None = None
        self.settled = robust != "gnc"

    def __call__(self, ratio: Array) -> Array:
        """Returns weights of squared residuals over the largest that an inlier has."""
        if self.robust == "huber":
            return np.asarray(1.0 / np.sqrt(np.maximum(ratio, 1.0)))
        if self.robust == "cauchy":
            return np.asarray(1.0 / (1.0 + ratio))
        if self.control is None:
            self.control = 1.0 / max(2.0 * float(np.max(ratio, initial=0.0)) - 1.0, 1e-3)
        elif not self.settled:
            self.control *= ANNEALING
        mu = self.control
        self.settled = mu > SHARP
        between = np.sqrt(mu * (mu + 1.0) / np.maximum(ratio, 1e-300)) - mu
        return np.asarray(np.clip(between, 0.0, 1.0))


class _Weigher:
    """The weights of sightings, and once those have settled of increments, round after round.

    Matches may be wrong and wheels may slip at once. Odometry, which is nearly always right, first
    tells the wrong matches; what remains then tells the slips.
    """

    def __init__(self, problem: Problem, config: SmootherConfig) -> None:
        self.problem, self.gate = problem, config.robust_gate
        self.sightings, self.increments = _Kernel(config.robust), _Kernel(config.robust)
        self.odometry = False

    @property
    def settled(self) -> bool:
        """Whether the kernels get no sharper any more."""
        return self.sightings.settled and (self.increments.settled or not self.odometry)

    def take_odometry(self) -> None:
        """Lets increments have weights, too."""
        self.odometry = True

    def weights(self, minimum: Minimum) -> tuple[Array, Array]:
        """Returns weights of all sightings (K,) and increments (N-1,) for the next round."""
        problem = self.problem
        squared, dim = sighting_fit(
            problem.measurements, minimum.pose, minimum.params, problem.match
        )
        used = np.isfinite(squared)
        ratio = np.zeros(len(squared))  # squared residual over the largest an inlier has
        for d in np.unique(dim[used]):
            ratio[dim == d] = squared[dim == d] / gate_for(self.gate, int(d))
        weight = self._keep_one_each(np.where(used, self.sightings(ratio), 1.0), ratio)
        if not self.odometry:
            return weight, problem.odometry_weight
        step = odometry_fit(problem.measurements, minimum.pose) / gate_for(self.gate, ODOMETRY_DIM)
        return weight, np.maximum(self.increments(step), SMALLEST_WEIGHT)

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
