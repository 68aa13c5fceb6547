"""Gauss-Newton with Levenberg-Marquardt damping on the chain's own solver."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from graphslam.config import SmootherConfig
from graphslam.geometry import Array, wrap
from graphslam.measurements import IntArray
from graphslam.smoother.chain.covariance import all_poses, last_and_map, log_det, pairs
from graphslam.smoother.chain.system import System, build, factor, relinearise, solution
from graphslam.smoother.problem import Problem

FIRST_DAMPING = 1e-4
LARGEST_DAMPING = 1e10
DAMPING_FACTOR = 10.0


@dataclass(frozen=True, slots=True)
class ChainMinimum:
    """A `graphslam.smoother.problem.Minimum` found by the chain solver.

    Attributes:
        system: linearised at the minimum.
        prior: rows of the start there.
        pose: (N, 3) poses, floor frame.
        params: (M, l) landmarks, floor frame, padded with NaN.
        cost: half the weighted sum of squared normalised residuals.
        iterations: linear systems solved.
        converged: whether the tolerance was met.
    """

    system: System
    prior: Array
    pose: Array
    params: Array
    cost: float
    iterations: int
    converged: bool

    def covariances(self) -> tuple[Array, Array]:
        """Returns those of all poses (N, 3, 3) and of last pose and map, floor frame."""
        factor(self.system, self.prior, 0.0)
        cov, _ = all_poses(self.system, self.pose)
        return cov, last_and_map(self.system, self.pose)

    def pair_covariances(self, node: IntArray, landmark: IntArray) -> Array:
        """Returns joint covariances (k, 3 + l, 3 + l) of poses and landmarks, floor frame."""
        factor(self.system, self.prior, 0.0)
        return pairs(self.system, self.pose, node, landmark)

    def map_log_det(self) -> float:
        """Returns the logarithm of the determinant of the free landmarks' joint covariance.

        It is the path's, were the landmarks known, against everything's: by two factorisations and
        without any covariance. 0 without free landmarks.
        """
        problem = self.system.residuals.problem
        known = build(replace(problem, fixed=np.ones_like(problem.fixed)))
        prior, _ = relinearise(known, self.pose, self.params)
        factor(known, prior, 0.0)
        factor(self.system, self.prior, 0.0)
        return log_det(self.system) - log_det(known)


def at_start(problem: Problem) -> ChainMinimum:
    """Returns the problem's start itself, linearised: what its covariances would be there."""
    system = build(problem)
    pose, params = problem.pose.copy(), problem.params.copy()
    prior, cost = relinearise(system, pose, params)
    return ChainMinimum(system, prior, pose, params, cost, 0, True)


def minimise(problem: Problem, config: SmootherConfig) -> ChainMinimum:
    """Returns the minimum near the problem's start.

    Steps and their acceptance are those of `graphslam.smoother.optimise`; what damping holds small
    are the system's own unknowns, motions beyond the first pose's.

    Raises:
        UnderConstrained: the linear system is singular.
    """
    system = build(problem)
    pose, params = problem.pose.copy(), problem.params.copy()
    prior, cost = relinearise(system, pose, params)
    damping, iterations = 0.0, 0
    while iterations < config.max_iterations:
        iterations += 1
        least = factor(system, prior, damping)
        predicted = cost - 0.5 * least
        if damping == 0.0 and predicted <= config.tolerance * max(cost, 1.0):
            return ChainMinimum(system, prior, pose, params, cost, iterations, True)
        step, change, length = solution(system, pose)
        predicted += 0.5 * damping * length
        if predicted <= config.tolerance * max(cost, 1.0):
            damping = 0.0  # the damping alone made the step small: look without it
            continue
        new_pose = pose + step
        new_pose[:, 2] = wrap(new_pose[:, 2])
        new_params = params + change
        new_prior, new_cost = relinearise(system, new_pose, new_params)
        if np.isfinite(new_cost) and new_cost <= cost:
            pose, params, prior, cost = new_pose, new_params, new_prior, new_cost
            damping = damping / DAMPING_FACTOR
            damping = 0.0 if damping < FIRST_DAMPING else damping
            continue
        relinearise(system, pose, params)
        if damping > LARGEST_DAMPING:
            break
        damping = max(FIRST_DAMPING, DAMPING_FACTOR * damping)
    return ChainMinimum(system, prior, pose, params, cost, iterations, False)
