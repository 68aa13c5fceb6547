"""EKF-SLAM with first-estimates Jacobians: every quantity is linearised at one point only.

No sighting tells where the floor's frame lies: moving path and map together changes no residual. A
filter that linearises one pose or one landmark at two different points no longer knows that, and
gains information about the heading that nobody measured. Here the motion's Jacobians lie between
*first* (predicted) poses, a sighting's at the first pose of its node and at its landmark's first
estimate; what is predicted and compared is always the current mean.

Source: Huang, Mourikis and Roumeliotis, "Observability-based rules for designing consistent EKF
SLAM estimators", IJRR 2010.
"""

from __future__ import annotations

import numpy as np

from graphslam.association import mahalanobis
from graphslam.config import EkfConfig
from graphslam.ekf import Filter
from graphslam.estimate import Estimate
from graphslam.geometry import Array, compose
from graphslam.landmarks import padded
from graphslam.measurements import IntArray, Measurements, Sightings
from graphslam.models import Model
from graphslam.models.base import Delayed


def run_first_estimates(measurements: Measurements, config: EkfConfig | None = None) -> Estimate:
    """Returns what `graphslam.ekf.run_ekf` does, with first-estimates Jacobians.

    Args:
        measurements: nodes, odometry, sightings.
        config: as of the filter.
    """
    return FirstEstimates(measurements, config or EkfConfig(), None).run()


class FirstEstimates(Filter):
    """The filter, linearised at first estimates.

    Attributes:
        first_pose: (3,) the pose of this node before any sighting of it, floor frame.
        first_poses: (N, 3) the same of all nodes so far.
        first: parameters of each landmark as the sightings that start it give it from the first
            poses, by its row in the roster.
    """

    name = "ekf-fej"

    def __init__(self, measurements: Measurements, config: EkfConfig, at: Estimate | None) -> None:
        super().__init__(measurements, config, at)
        self.first_pose = np.array(measurements.start_pose)
        self.first_poses = np.tile(self.first_pose, (len(measurements.t), 1))
        self.first = [row[np.isfinite(row)] for row in self.known]

    def predict(self, i: int) -> None:
        """Moves the state from node i to i + 1; F lies between the nodes' first poses."""
        odometry, mean = self.measurements.odometry, self.state.mean[:3].copy()
        increment, cov = odometry.increment[i], odometry.cov[i]
        there = compose(mean, increment)
        F, _, _ = self.motion(self.first_pose, there, increment, cov)
        _, self.last_Q, _ = self.motion(mean, there, increment, cov)
        self.state.move(there, F, self.last_Q)
        self.first_pose = self.first_poses[i + 1] = there

    def innovations(
        self, model: Model, table: Sightings, rows: IntArray, landmarks: IntArray
    ) -> tuple[Array, Array]:
        """Returns residuals (k, M, d) and their covariances (k, M, d, d) for all pairs."""
        e, J_p, J_l, columns = self._measure(model, landmarks, table.z[rows, None])
        return e, self.state.innovation_covariance(J_p, J_l, columns, table.cov[rows])

    def update(
        self,
        node: int,
        model: Model,
        table: Sightings,
        rows: IntArray,
        landmarks: IntArray,
        first: int,
    ) -> None:
        """Updates the state with matched sightings of one node in one step."""
        if not model.dim_landmark:
            super().update(node, model, table, rows, landmarks, first)
            return
        if not len(rows):
            return
        e, J_p, J_l, columns = self._measure(model, landmarks, table.z[rows])
        own = self.state.correct(-e, J_p, J_l, columns, table.cov[rows])
        self.note_used(first + rows, landmarks, mahalanobis(e, own))

    def start_landmark(
        self, node: int, model: Model, table: Sightings, row: int, first: int
    ) -> int | None:
        """Adds a landmark whose covariance follows from the Jacobians at its first estimate."""
        z, cov = table.z[row], table.cov[row]
        started = model.initialise(self.state.mean[:3], z, cov)
        at_first = model.initialise(self.first_pose, z, cov)
        if started is None or at_first is None:
            return self._start_waiting(node, model, table, row, first)
        estimate, J_pose, J_z = at_first
        offset = self.state.add(started[0], J_pose, J_z @ cov @ J_z.T)
        self.first.append(estimate)
        return self.admit(table, row, first, offset)

    def _start_waiting(
        self, node: int, model: Model, table: Sightings, row: int, first: int
    ) -> int | None:
        """Starts a landmark with earlier sightings of it, if they suffice by now."""
        started = self.waiting.take(node, model, table, row, first)
        if started is not None:
            theirs = np.flatnonzero(self.match[first : first + len(table)] == started)
            estimate = self._first_of(model, table.node[theirs], table.z[theirs], table.cov[theirs])
            assert estimate is not None, "it has just been found"
            self.first.append(estimate)
        return started

    def _first_of(self, model: Model, nodes: IntArray, z: Array, cov: Array) -> Array | None:
        """Returns what waiting sightings (k,) start from the first poses of their nodes."""
        assert isinstance(model, Delayed), "its own sighting did not start it"
        return model.initialise_from(self.first_poses[nodes], None, z, cov)

    def measure_waiting(
        self, model: Model, nodes: IntArray, poses: Array, landmark: Array, z: Array, cov: Array
    ) -> tuple[Array, Array, Array] | None:
        """Returns residuals at the mean and Jacobians at first estimates; None: not yet."""
        estimate = self._first_of(model, nodes, z, cov)
        if estimate is None:
            return None
        e, _, _ = self.residual(model, poses, landmark, z)
        _, J_p, J_l = self.residual(model, self.first_poses[nodes], estimate, z)
        return e, J_p, J_l

    def _measure(
        self, model: Model, landmarks: IntArray, z: Array
    ) -> tuple[Array, Array, Array, IntArray]:
        """Returns residuals at the mean, their Jacobians at first estimates, and the columns."""
        columns, current, free = self.look_up(model, landmarks)
        e, _, _ = self.residual(model, self.state.mean[:3], current, z)
        first = padded([self.first[row] for row in landmarks])[:, : model.dim_landmark]
        _, J_p, J_l = self.residual(model, self.first_pose, first, z)
        return e, J_p, J_l * free, columns
