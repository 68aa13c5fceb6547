"""How well a path and a map explain each measurement."""

from __future__ import annotations

import numpy as np

from graphslam.association import mahalanobis
from graphslam.geometry import Array
from graphslam.landmarks import used_sightings
from graphslam.measurements import IntArray, Measurements
from graphslam.models.odometry import odometry_residual


def sighting_fit(
    measurements: Measurements, pose: Array, params: Array, match: IntArray
) -> tuple[Array, IntArray]:
    """Returns squared residuals (K,) over the sightings' own covariances and dimensions (K,).

    NaN and 0 where a sighting is not used.

    Args:
        measurements: the sightings.
        pose: (N, 3) path, floor frame.
        params: (M, l) landmarks, floor frame, padded with NaN.
        match: (K,) landmark of each sighting, -1 where it has none.
    """
    squared, dim = np.full(len(match), np.nan), np.zeros(len(match), np.int64)
    for used in used_sightings(measurements, match, params):
        table, rows = used.table, used.rows
        e, _, _ = used.model.residual(pose[table.node[rows]], used.params, table.z[rows])
        squared[used.index] = mahalanobis(e, table.cov[rows])
        dim[used.index] = used.model.dim_z
    return squared, dim


def odometry_fit(measurements: Measurements, pose: Array) -> Array:
    """Returns squared residuals (N-1,) of the increments over their covariances."""
    odometry = measurements.odometry
    e, _, _ = odometry_residual(pose[:-1], pose[1:], odometry.increment)
    return mahalanobis(e, odometry.cov)
