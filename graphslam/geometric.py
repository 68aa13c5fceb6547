"""Geometric correction on a known map: the pose from the lines by trigonometry (SantanaLoc)."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from graphslam.association import mahalanobis
from graphslam.config import EkfConfig
from graphslam.ekf import Filter
from graphslam.errors import BadMeasurements
from graphslam.estimate import Estimate
from graphslam.geometry import Array, wrap
from graphslam.measurements import IntArray, Measurements, Sightings
from graphslam.models import Model
from graphslam.models.line import LINE

SAME_DIRECTION = math.radians(15.0)
"""Lines whose directions differ by less are taken for parallel: they fix no second coordinate."""


def geometric_correction(measurements: Measurements, config: EkfConfig | None = None) -> Estimate:
    """Returns the path whose pose is put, at every node, where the lines in view say it is.

    Two lines of different direction fix the pose; one line, or several of one direction, fix the
    heading and the distance across them; without a line the pose is odometry's. Nothing is weighed
    against odometry. The covariances are those of exactly this procedure, to first order: noise of
    odometry where it was kept, noise of the sightings where they replaced it. Lines in the map
    count as known exactly.

    Args:
        measurements: nodes, odometry, sightings of lines, and a known map.
        config: matching, as of the filter; the map is never extended.

    Raises:
        BadMeasurements: there is no known line.

    Source: SantanaLoc section 5, 'geometric correction'; it gives neither equations nor covariance.
    """
    known = measurements.known
    if known is None or not len(known.of_kind(LINE.kind)[0]):
        raise BadMeasurements(
            "geometric correction needs known lines, and the measurements have none; give them a "
            "known map"
        )
    config = replace(config or EkfConfig(), extend_map=False)
    return GeometricFilter(measurements, config, None).run()


class GeometricFilter(Filter):
    """The filter's prediction and matching, with trigonometry in place of the Kalman gain."""

    def update(
        self,
        node: int,
        model: Model,
        table: Sightings,
        rows: IntArray,
        landmarks: IntArray,
        first: int,
    ) -> None:
        """Puts the pose where one node's matched lines say it is."""
        if model.kind != LINE.kind:
            self.counts["sighting that geometric correction does not use"] += len(rows)
            return
        if not len(rows):
            return
        state, cov = self.state, table.cov[rows]
        params = self.look_up(model, landmarks)[1]
        e, J, _ = self.residual(model, state.mean[:3], params, table.z[rows])
        own = J @ state.P @ np.swapaxes(J, 1, 2) + cov
        gain = correction_gain(J, cov)
        state.mean[:3] -= gain @ e.ravel()
        state.mean[2] = wrap(state.mean[2])
        kept = np.eye(3) - gain @ J.reshape(-1, 3)
        each = gain.reshape(3, len(rows), 2).transpose(1, 0, 2)
        noise = np.sum(each @ cov @ np.swapaxes(each, 1, 2), axis=0)
        state.P[:] = kept @ state.P @ kept.T + noise
        self.note_used(first + rows, landmarks, mahalanobis(e, own))

    def finish(self, pose: Array, cov: Array) -> Estimate:
        """Returns the filter's estimate under the name of this method."""
        return replace(super().finish(pose, cov), method="geometric")


def correction_gain(J: Array, cov: Array) -> Array:
    """Returns the matrix (3, 2 k) that turns k line residuals into the pose's error.

    The heading's is the weighted mean of all angle residuals. The position's is the shortest that
    explains the offsets: all of it where two directions are in view, the part across the lines
    where they are parallel up to `SAME_DIRECTION`.

    Args:
        J: (k, 2, 3) Jacobians of the residuals (rho, alpha) by the pose, k >= 1.
        cov: (k, 2, 2) covariances of the sightings; their diagonals weigh several lines.
    """
    gain = np.zeros((3, len(J), 2))
    normal = J[:, 0, :2]
    weighted = normal / cov[:, 0, 0, None]
    strength, axes = np.linalg.eigh(weighted.T @ normal)
    fixed = axes[:, strength > math.tan(0.5 * SAME_DIRECTION) ** 2 * strength[1]]
    gain[:2, :, 0] = (
        fixed @ np.linalg.solve(fixed.T @ weighted.T @ normal @ fixed, fixed.T) @ (weighted.T)
    )
    weight = 1.0 / cov[:, 1, 1]
    gain[2, :, 1] = weight / (J[:, 1, 2] * weight.sum())
    return gain.reshape(3, -1)
