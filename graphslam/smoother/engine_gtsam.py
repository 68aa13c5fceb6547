"""The reference engine: custom factors in a GTSAM graph, eliminated by GTSAM."""

from __future__ import annotations

from dataclasses import dataclass

import gtsam
import numpy as np

from graphslam.config import SmootherConfig
from graphslam.geometry import Array, rotate_covariance, rotation, wrap
from graphslam.landmarks import padded
from graphslam.measurements import IntArray
from graphslam.smoother.factors import landmark_key, pose_key
from graphslam.smoother.graph import graph_of
from graphslam.smoother.optimise import Solution, optimise, solve, translated_errors
from graphslam.smoother.problem import Problem


def minimise(problem: Problem, config: SmootherConfig) -> GtsamMinimum:
    """Returns the minimum near the problem's start.

    Raises:
        UnderConstrained: the linear system is singular.
    """
    built = graph_of(problem)
    solution = optimise(built.graph, built.values, config)
    return GtsamMinimum(problem, solution, *_read(problem, solution.values))


def at_start(problem: Problem) -> GtsamMinimum:
    """Returns the problem's start itself, linearised: what its covariances would be there.

    Raises:
        UnderConstrained: the linear system is singular.
    """
    built = graph_of(problem)
    linear, cost = built.graph.linearize(built.values), float(built.graph.error(built.values))
    solution = Solution(built.values, linear, cost, 0, True)
    return GtsamMinimum(problem, solution, problem.pose, problem.params)


def solve_linear(problem: Problem) -> GtsamMinimum:
    """Returns one linear solve at the problem's start, every model linearised there.

    Poses move additively in the floor frame, as the filter's do.

    Raises:
        UnderConstrained: the linear system is singular.
    """
    built = graph_of(problem)
    linear = built.graph.linearize(built.values)
    delta = solve(linear, built.values)
    step = np.array([delta.at(pose_key(node)) for node in range(len(problem.pose))])
    step[:, :2] = (rotation(problem.pose[:, 2]) @ step[:, :2, None])[..., 0]
    pose, params = problem.pose + step, problem.params.copy()
    pose[:, 2] = wrap(pose[:, 2])
    for landmark in np.flatnonzero(~problem.fixed).tolist():
        change = delta.at(landmark_key(landmark))
        params[landmark, : len(change)] += change
    solution = Solution(built.values, linear, float(linear.error(delta)), 1, True)
    return GtsamMinimum(problem, solution, pose, params)


@dataclass(frozen=True, slots=True)
class GtsamMinimum:
    """A `graphslam.smoother.problem.Minimum` whose covariances are GTSAM's marginals.

    Attributes:
        problem: what was minimised.
        solution: GTSAM's variables and the graph linearised at them.
        pose: (N, 3) poses, floor frame.
        params: (M, l) landmarks, floor frame, padded with NaN.
    """

    problem: Problem
    solution: Solution
    pose: Array
    params: Array

    @property
    def cost(self) -> float:
        """Half the weighted sum of squared normalised residuals."""
        return self.solution.cost

    @property
    def iterations(self) -> int:
        """Linear systems solved."""
        return self.solution.iterations

    @property
    def converged(self) -> bool:
        """Whether the tolerance was met."""
        return self.solution.converged

    def covariances(self) -> tuple[Array, Array]:
        """Returns those of all poses (N, 3, 3) and of last pose and map, floor frame.

        GTSAM's marginals are in each pose's own frame; they are turned in `_turned`.
        """
        nodes = len(self.pose)
        with translated_errors():
            tree = self._tree()
            cov = np.array([tree.marginalCovariance(pose_key(node)) for node in range(nodes)])
        cov = rotate_covariance(cov, self._theta())
        return 0.5 * (cov + np.swapaxes(cov, 1, 2)), self._joint()

    def pair_covariances(self, node: IntArray, landmark: IntArray) -> Array:
        """Returns joint covariances (k, 3 + l, 3 + l) of poses and landmarks, floor frame."""
        dims = self.problem.dims()
        width = 3 + max((dims[m] for m in landmark), default=0)
        out, theta = np.zeros((len(node), width, width)), self._theta()
        tree = self._tree()
        for row, (i, m) in enumerate(zip(node.tolist(), landmark.tolist(), strict=True)):
            with translated_errors():
                if self.problem.fixed[m]:
                    own = tree.marginalCovariance(pose_key(i))
                else:
                    pair = [pose_key(i), landmark_key(m)]
                    root, _ = tree.jointBayesNet(pair, gtsam.EliminateQR).matrix()
                    own = _from_root(root)
            out[row, : len(own), : len(own)] = _turned(own, theta[i])
        return out

    def map_log_det(self) -> float:
        """Returns the logarithm of the determinant of the free landmarks' joint covariance."""
        free = np.repeat(~self.problem.fixed, self.problem.dims())
        cov = self._joint()[3:, 3:][np.ix_(free, free)]
        sigma = np.sqrt(np.diagonal(cov))
        _, alike = np.linalg.slogdet(cov / sigma[:, None] / sigma[None, :])
        return float(alike + 2.0 * np.log(sigma).sum())

    def _joint(self) -> Array:
        """Returns the covariance of last pose and map, floor frame."""
        free, last = np.flatnonzero(~self.problem.fixed).tolist(), len(self.pose) - 1
        theta = float(self._theta()[last])
        return last_and_map_covariance(self.problem, self.solution.linear, free, last, theta)

    def _tree(self) -> gtsam.GaussianBayesTree:
        linear = self.solution.linear
        with translated_errors():
            best = gtsam.Ordering.ColamdGaussianFactorGraph(linear)
            return linear.eliminateMultifrontal(best, gtsam.EliminateQR)

    def _theta(self) -> Array:
        return np.array(gtsam.utilities.extractPose2(self.solution.values))[:, 2]


def last_and_map_covariance(
    problem: Problem, linear: gtsam.GaussianFactorGraph, free: list[int], last: int, theta: float
) -> Array:
    """Returns the joint covariance (3 + L, 3 + L) of last pose and map, floor frame.

    Landmarks are in the problem's order; the rows and columns of fixed ones are 0.

    Args:
        problem: its landmarks; those that are not fixed are variables.
        linear: all factors, linearised.
        free: by what number the factors know each landmark that is not fixed.
        last: node of the last pose.
        theta: its heading, rad.

    Raises:
        UnderConstrained: the system is singular.
    """
    ordering = gtsam.Ordering()
    for key in [pose_key(last), *map(landmark_key, free)]:
        ordering.push_back(key)
    with translated_errors():
        root, _ = linear.marginalMultifrontalBayesNet(ordering, gtsam.EliminateQR).matrix()
    joint = _turned(_from_root(root), theta)
    ends = 3 + np.cumsum([0, *problem.dims()])
    places = [
        np.arange(3),
        *(np.arange(ends[m], ends[m + 1]) for m in np.flatnonzero(~problem.fixed)),
    ]
    at = np.concatenate(places).astype(np.int64)
    out = np.zeros((ends[-1], ends[-1]))
    out[np.ix_(at, at)] = joint
    return out


def _from_root(root: Array) -> Array:
    """Returns the covariance whose information has the upper-triangular root ``root``."""
    inverse = np.linalg.inv(root)
    return np.asarray(inverse @ inverse.T)


def _turned(joint: Array, theta: float) -> Array:
    """Returns a covariance whose first three are a pose in its own frame, in the floor frame."""
    turn = np.eye(len(joint))
    turn[:2, :2] = rotation(theta)
    return np.asarray(turn @ joint @ turn.T)


def _read(problem: Problem, values: gtsam.Values) -> tuple[Array, Array]:
    pose = np.array(gtsam.utilities.extractPose2(values))
    pose[:, 2] = wrap(pose[:, 2])
    params = [
        problem.params[m, :dim] if problem.fixed[m] else np.array(values.atVector(landmark_key(m)))
        for m, dim in enumerate(problem.dims())
    ]
    return pose, padded(params)
