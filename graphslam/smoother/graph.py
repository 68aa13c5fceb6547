"""Measurements and matches as a GTSAM factor graph."""

from __future__ import annotations

from typing import NamedTuple

import gtsam
import numpy as np

from graphslam.estimate import Estimate
from graphslam.measurements import IntArray, Measurements
from graphslam.models import MODELS
from graphslam.smoother.factors import (
    fixed_sighting_factor,
    landmark_key,
    odometry_factor,
    pose_key,
    sighting_factor,
    start_factor,
)
from graphslam.smoother.problem import Problem, state_problem


class FactorGraph(NamedTuple):
    """A factor graph and where to start it.

    Attributes:
        graph: start, odometry and sighting factors, in this order.
        values: initial poses (`factors.pose_key`) and landmarks (`factors.landmark_key`); known
            landmarks are no variables.
        kinds: kind of each landmark, by its number in ``matches``.
    """

    graph: gtsam.NonlinearFactorGraph
    values: gtsam.Values
    kinds: tuple[str, ...]


def build_graph(
    measurements: Measurements, matches: IntArray, initial: Estimate | None = None
) -> FactorGraph:
    """Returns the factor graph of measurements, ready for any GTSAM optimiser.

    Args:
        measurements: nodes, odometry, sightings; the rows of ``known`` are the first landmarks.
        matches: (K,) landmark of each sighting over all tables in order, numbered from 0 without
            gaps; -1 leaves a sighting out (sightings of kinds without landmarks always count).
        initial: path and map to start from, its map in the numbering of ``matches``; without it,
            dead reckoning and each landmark's first sighting.

    Raises:
        BadMeasurements: ``matches`` or ``initial`` do not belong to the measurements.
        UnderConstrained: a landmark cannot be started from its sightings.
    """
    return graph_of(state_problem(measurements, matches, initial))


def graph_of(problem: Problem) -> FactorGraph:
    """Returns a problem as a factor graph; a weight divides its factor's covariance."""
    measurements, odometry = problem.measurements, problem.measurements.odometry
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for node, (x, y, theta) in enumerate(problem.pose.tolist()):
        values.insert(pose_key(node), gtsam.Pose2(x, y, theta))
    rows = zip(problem.params, problem.dims(), problem.fixed, strict=True)
    for landmark, (params, dim, fixed) in enumerate(rows):
        if not fixed:
            values.insert(landmark_key(landmark), np.array(params[:dim]))
    graph.push_back(start_factor(measurements.start_pose, measurements.start_cov))
    cov = odometry.cov / problem.odometry_weight[:, None, None]
    for node in range(len(odometry.increment)):
        graph.push_back(odometry_factor(node, odometry.increment[node], cov[node]))
    for first, table in measurements.tables():
        model = MODELS[table.kind]
        for row, node in enumerate(table.node.tolist()):
            landmark, weight = int(problem.match[first + row]), problem.weight[first + row]
            if weight == 0.0 or (landmark < 0 and model.dim_landmark):
                continue
            z, noise = table.z[row], table.cov[row] / weight
            if model.dim_landmark and problem.fixed[landmark]:
                params = problem.params[landmark, : model.dim_landmark]
                graph.push_back(fixed_sighting_factor(model, z, noise, node, params))
            else:
                graph.push_back(sighting_factor(model, z, noise, node, landmark))
    return FactorGraph(graph, values, problem.kinds)
