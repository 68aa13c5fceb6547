"""The method `fixes`: at each node the pose that its sightings read directly, without memory."""

from __future__ import annotations

from collections import Counter

import numpy as np

from graphslam.baseline import path_alone
from graphslam.errors import BadMeasurements
from graphslam.estimate import Estimate
from graphslam.geometry import Array, wrap
from graphslam.measurements import Measurements
from graphslam.memoryless import onward
from graphslam.models import MODELS, Model

WITHOUT = "node without a fix: odometry goes on from the last"
SOLVES = 3
"""Gauss-Newton steps; the residual is nearly linear, so that the second is rounding."""


def follow_fixes(measurements: Measurements) -> Estimate:
    """Returns the path that sensors without landmarks, such as a camera overhead, tell alone.

    Several fixes of one node are weighted by their covariances. At a node without any, odometry
    goes on from the node before, with its covariance, and the node is counted.

    Args:
        measurements: nodes, odometry and fixes.

    Raises:
        BadMeasurements: there are no fixes.

    Source: Atali's 'imaging'.
    """
    tables = [e for e in measurements.tables() if not MODELS[e[1].kind].dim_landmark and len(e[1])]
    if not tables:
        raise BadMeasurements(
            "fixes needs poses read directly (tags.csv, or images of an overhead camera); add "
            "them, or leave the method out"
        )
    nodes = len(measurements.t)
    starts = [(first, table, table.starts(nodes)) for first, table in tables]
    used = np.zeros(measurements.sighting_count, bool)
    pose, cov = np.empty((nodes, 3)), np.empty((nodes, 3, 3))
    last, spread = measurements.start_pose, measurements.start_cov
    counts: Counter[str] = Counter()
    for node in range(nodes):
        if node:
            last, spread = onward(measurements, node - 1, last, spread)
        here = [
            (first, table, np.arange(*start[node : node + 2])) for first, table, start in starts
        ]
        here = [entry for entry in here if len(entry[2])]
        if here:
            last, spread = _fused(last, [(MODELS[t.kind], t.z[r], t.cov[r]) for _, t, r in here])
            for first, _, rows in here:
                used[first + rows] = True
        else:
            counts[WITHOUT] += 1
        pose[node], cov[node] = last, 0.5 * (spread + spread.T)
    return path_alone("fixes", measurements, pose, cov, used=used, counts=counts)


def _fused(pose: Array, readings: list[tuple[Model, Array, Array]]) -> tuple[Array, Array]:
    """Returns the pose that readings of one node say together, started from a guess."""
    information = np.zeros((3, 3))
    for _ in range(SOLVES):
        information, gradient = np.zeros((3, 3)), np.zeros(3)
        for model, z, cov in readings:
            e, J, _ = model.residual(pose, np.zeros((len(z), 0)), z)
            weighted = np.swapaxes(J, 1, 2) @ np.linalg.inv(cov)
            information = information + np.sum(weighted @ J, axis=0)
            gradient = gradient + np.sum(weighted @ e[..., None], axis=0)[:, 0]
        pose = pose - np.linalg.solve(information, gradient)
    cov = np.asarray(np.linalg.inv(information), np.float64)
    return np.append(pose[:2], wrap(pose[2])), cov
