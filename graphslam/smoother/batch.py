"""Full smoothing: every pose and every landmark from all measurements at once."""

from __future__ import annotations

import gtsam
import numpy as np

from graphslam.association import mahalanobis
from graphslam.baseline import propagate
from graphslam.config import SmootherConfig
from graphslam.estimate import Estimate
from graphslam.geometry import Array, rotate_covariance, rotation, wrap
from graphslam.information import position_information, unobserved_directions
from graphslam.landmarks import finish_map, padded, used_sightings
from graphslam.measurements import IntArray, Measurements
from graphslam.smoother.factors import landmark_key, pose_key
from graphslam.smoother.graph import build_graph
from graphslam.smoother.optimise import Solution, optimise, solve, translated_errors


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
    problem = build_graph(measurements, initial.match, linearise_at or initial)
    if linearise_at is None:
        solution = optimise(problem.graph, problem.values, config or SmootherConfig())
        pose, params = _read(solution.values, problem.kinds)
    else:
        solution, pose, params = _linear_solution(problem.graph, problem.values, problem.kinds)
    at_pose = gtsam.utilities.extractPose2(solution.values)
    cov, joint = _covariances(solution, at_pose[:, 2], len(problem.kinds))
    landmarks, joint = finish_map(
        measurements, pose, problem.kinds, padded(params), initial.match, joint
    )
    information = position_information(measurements, pose, landmarks, initial.match)
    _, cov_odometry = propagate(measurements)
    nis = _fit(measurements, pose, landmarks.params, initial.match)
    return Estimate(
        method="smoother",
        causal=False,
        t=measurements.t,
        pose=pose,
        cov_floor=cov,
        map=landmarks,
        cov_joint=joint,
        match=initial.match,
        used=np.isfinite(nis),
        nis=nis,
        weight=np.ones(len(nis)),
        cost=solution.cost,
        iterations=solution.iterations,
        converged=solution.converged,
        unobserved=unobserved_directions(information, joint[:3, :3], cov_odometry[-1]),
    )


def _read(values: gtsam.Values, kinds: tuple[str, ...]) -> tuple[Array, list[Array]]:
    pose = np.array(gtsam.utilities.extractPose2(values))
    pose[:, 2] = wrap(pose[:, 2])
    return pose, [np.array(values.atVector(landmark_key(n))) for n in range(len(kinds))]


def _linear_solution(
    graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, kinds: tuple[str, ...]
) -> tuple[Solution, Array, list[Array]]:
    """Returns one linear solve; poses move additively in the floor frame, as the filter's do."""
    linear = graph.linearize(values)
    delta = solve(linear, values)
    pose, params = _read(values, kinds)
    step = np.array([delta.at(pose_key(node)) for node in range(len(pose))])
    step[:, :2] = (rotation(pose[:, 2]) @ step[:, :2, None])[..., 0]
    pose = pose + step
    pose[:, 2] = wrap(pose[:, 2])
    params = [p + delta.at(landmark_key(n)) for n, p in enumerate(params)]
    return Solution(values, linear, float(linear.error(delta)), 1, True), pose, params


def _covariances(solution: Solution, theta: Array, landmarks: int) -> tuple[Array, Array]:
    """Returns covariances of all poses (N, 3, 3) and of last pose and map, floor frame.

    GTSAM's marginals are in each pose's own frame; they are turned here and nowhere else.
    """
    linear, nodes = solution.linear, len(theta)
    last_and_map = gtsam.Ordering()
    for key in [pose_key(nodes - 1), *(landmark_key(n) for n in range(landmarks))]:
        last_and_map.push_back(key)
    with translated_errors():
        best = gtsam.Ordering.ColamdGaussianFactorGraph(linear)
        tree = linear.eliminateMultifrontal(best, gtsam.EliminateQR)
        cov = np.array([tree.marginalCovariance(pose_key(node)) for node in range(nodes)])
        root, _ = linear.marginalMultifrontalBayesNet(last_and_map, gtsam.EliminateQR).matrix()
    cov = rotate_covariance(cov, theta)
    inverse = np.linalg.inv(root)
    joint = inverse @ inverse.T
    turn = np.eye(len(joint))
    turn[:2, :2] = rotation(theta[-1])
    return 0.5 * (cov + np.swapaxes(cov, 1, 2)), turn @ joint @ turn.T


def _fit(measurements: Measurements, pose: Array, params: Array, match: IntArray) -> Array:
    """Returns squared residuals (K,) over the sightings' own covariances; NaN where not used."""
    nis = np.full(len(match), np.nan)
    for used in used_sightings(measurements, match, params):
        table, rows = used.table, used.rows
        e, _, _ = used.model.residual(pose[table.node[rows]], used.params, table.z[rows])
        nis[used.index] = mahalanobis(e, table.cov[rows])
    return nis
