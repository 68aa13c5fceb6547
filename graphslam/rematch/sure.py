"""What odometry alone is sure of: that what was left behind and what is met later are one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from graphslam.association import gate_for, labels_agree, mahalanobis
from graphslam.baseline import propagate
from graphslam.config import RematchConfig
from graphslam.geometry import Array, compose
from graphslam.landmarks import labels_seen
from graphslam.measurements import IntArray, Sightings
from graphslam.models import MODELS, Model
from graphslam.rematch.crowd import by_chance, density_of, most_surprise
from graphslam.rematch.spread import Spread
from graphslam.smoother.problem import Problem

CROWDED = 0.1
"""Landmarks within the gate by chance beyond which odometry is not sure of any."""


class Surety:
    """Which sightings odometry alone leads back to the landmark that is matched with both.

    Attributes:
        problem: path, map and matches.
    """

    def __init__(self, problem: Problem, config: RematchConfig) -> None:
        self.problem, self._config = problem, config
        path, _ = propagate(problem.measurements)
        self._spread = Spread(path, problem.measurements.odometry)
        self._label = labels_seen(problem.measurements, problem.match, len(problem.kinds))

    def of(self, before: IntArray, after: IntArray) -> NDArray[np.bool_]:
        """Returns whether pairs of sightings (k,) of one landmark are of one beyond doubt.

        A later sighting must fit what odometry makes of the earlier one, where chance would put
        nothing, and no other landmark may come near it.

        Args:
            before: (k,) earlier sightings, numbered over all tables.
            after: (k,) later sightings of the same landmarks.
        """
        out = np.zeros(len(before), bool)
        for first, table in self.problem.measurements.tables():
            own = np.flatnonzero((before >= first) & (before < first + len(table)))
            model = MODELS[table.kind]
            if model.dim_landmark and len(own):
                rows = before[own] - first, after[own] - first
                out[own] = self._lead_back(model, table, first, *rows)
        return out

    def _lead_back(
        self, model: Model, table: Sightings, first: int, before: IntArray, after: IntArray
    ) -> NDArray[np.bool_]:
        """Returns whether rows ``after`` (k,) are of what rows ``before`` (k,) would start."""
        e, S = np.zeros((len(after), model.dim_z)), np.empty((len(after), model.dim_z, model.dim_z))
        motion, started = np.zeros((len(after), 3)), np.zeros(len(after), bool)
        S[:] = np.eye(model.dim_z)
        for k, (i, j) in enumerate(zip(before.tolist(), after.tolist(), strict=True)):
            start = model.initialise(np.zeros(3), table.z[i], table.cov[i])
            if start is not None:
                landmark, _, J_z = start
                motion[k], cov = self._spread.relative(int(table.node[i]), int(table.node[j]))
                e[k], J_pose, J_landmark = model.residual(motion[k], landmark, table.z[j])
                J = J_landmark @ J_z
                S[k] = J_pose @ cov @ J_pose.T + J @ table.cov[i] @ J.T + table.cov[j]
                started[k] = True
        gate = np.minimum(gate_for(self._config.gate, model.dim_z), most_surprise(S))
        sure = started & (mahalanobis(e, S) <= gate)
        sure &= by_chance(density_of(self.problem, model), S, self._config) <= CROWDED
        for k in np.flatnonzero(sure).tolist():
            expected = compose(self.problem.pose[table.node[before[k]]], motion[k])
            sure[k] = not self._has_rival(model, table, first, int(after[k]), expected, S[k])
        return sure

    def _has_rival(
        self, model: Model, table: Sightings, first: int, row: int, pose: Array, S: Array
    ) -> bool:
        """Returns whether from an expected pose another landmark is near what a row saw."""
        problem = self.problem
        others = problem.of_kind(model.kind)
        others = others[others != problem.match[first + row]]
        params = problem.params[others, : model.dim_landmark]
        e, _, _ = model.residual(pose, params, table.z[row])
        near = mahalanobis(e, S) <= gate_for(self._config.gate_new, model.dim_z)
        near &= labels_agree(self._label[others], table.label[row])
        return bool(near.any())
