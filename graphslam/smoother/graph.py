"""Measurements and matches as a GTSAM factor graph."""

from __future__ import annotations

from typing import NamedTuple

import gtsam
import numpy as np

from graphslam.baseline import propagate
from graphslam.errors import BadMeasurements, UnderConstrained
from graphslam.estimate import Estimate
from graphslam.geometry import Array
from graphslam.measurements import IntArray, Measurements
from graphslam.models import MODELS
from graphslam.smoother.factors import (
    landmark_key,
    odometry_factor,
    pose_key,
    sighting_factor,
    start_factor,
)


class Problem(NamedTuple):
    """A factor graph and where to start it.

    Attributes:
        graph: start, odometry and sighting factors, in this order.
        values: initial poses (`factors.pose_key`) and landmarks (`factors.landmark_key`).
        kinds: kind of each landmark, by its number in ``matches``.
    """

    graph: gtsam.NonlinearFactorGraph
    values: gtsam.Values
    kinds: tuple[str, ...]


def build_graph(
    measurements: Measurements, matches: IntArray, initial: Estimate | None = None
) -> Problem:
    """Returns the factor graph of measurements, ready for any GTSAM optimiser.

    Args:
        measurements: nodes, odometry, sightings.
        matches: (K,) landmark of each sighting over all tables in order, numbered from 0 without
            gaps; -1 leaves a sighting out (sightings of kinds without landmarks always count).
        initial: path and map to start from, its map in the numbering of ``matches``; without it,
            dead reckoning and each landmark's first sighting.

    Raises:
        BadMeasurements: ``matches`` or ``initial`` do not belong to the measurements.
        UnderConstrained: a landmark cannot be started from its sightings.
    """
    matches = np.asarray(matches)
    kinds = _kinds(measurements, matches)
    if initial is None:
        pose, _ = propagate(measurements)
        params = _first_guess(measurements, matches, pose, len(kinds))
    else:
        if len(initial.pose) != len(measurements.t) or initial.map.kind != kinds:
            raise BadMeasurements("initial is an estimate of another path or another map")
        pose = initial.pose
        rows = zip(initial.map.params, kinds, strict=True)
        params = [row[: MODELS[kind].dim_landmark] for row, kind in rows]
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for node, (x, y, theta) in enumerate(pose.tolist()):
        values.insert(pose_key(node), gtsam.Pose2(x, y, theta))
    for landmark, start in enumerate(params):
        values.insert(landmark_key(landmark), np.array(start))
    graph.push_back(start_factor(measurements.start_pose, measurements.start_cov))
    odometry = measurements.odometry
    for node in range(len(odometry.increment)):
        graph.push_back(odometry_factor(node, odometry.increment[node], odometry.cov[node]))
    for first, table in measurements.tables():
        model = MODELS[table.kind]
        for row, node in enumerate(table.node.tolist()):
            landmark = int(matches[first + row])
            if landmark >= 0 or not model.dim_landmark:
                z, cov = table.z[row], table.cov[row]
                graph.push_back(sighting_factor(model, z, cov, node, landmark))
    return Problem(graph, values, kinds)


def _kinds(measurements: Measurements, matches: IntArray) -> tuple[str, ...]:
    if matches.shape != (measurements.sighting_count,):
        raise BadMeasurements(
            f"matches has shape {matches.shape}; there are {measurements.sighting_count} sightings"
        )
    count = int(matches.max(initial=-1)) + 1
    kinds = [""] * count
    for first, table in measurements.tables():
        for landmark in np.unique(matches[first : first + len(table)]):
            if landmark >= 0:
                if kinds[landmark]:
                    raise BadMeasurements(f"landmark {landmark} is matched by two kinds")
                kinds[landmark] = table.kind
    if "" in kinds:
        raise BadMeasurements(f"no sighting is matched to landmark {kinds.index('')}")
    return tuple(kinds)


def _first_guess(
    measurements: Measurements, matches: IntArray, pose: Array, count: int
) -> list[Array]:
    params: list[Array | None] = [None] * count
    for first, table in measurements.tables():
        model = MODELS[table.kind]
        for row, node in enumerate(table.node.tolist()):
            landmark = int(matches[first + row])
            if landmark >= 0 and params[landmark] is None:
                started = model.initialise(pose[node], table.z[row], table.cov[row])
                params[landmark] = None if started is None else started[0]
    found = [p for p in params if p is not None]
    if len(found) < count:
        raise UnderConstrained(
            f"{count - len(found)} of {count} landmarks cannot be started from their sightings; "
            "give an initial estimate or leave their matches out"
        )
    return found
