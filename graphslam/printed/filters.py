"""Filters with one equation as printed, each a subclass that changes just that."""

from __future__ import annotations

import math

import numpy as np

from graphslam.association import NEW
from graphslam.config import EkfConfig
from graphslam.ekf import Filter
from graphslam.estimate import Estimate
from graphslam.geometry import Array, compose, line_to_floor, nearest_twin, twin, wrap
from graphslam.measurements import IntArray, Measurements, Sightings
from graphslam.models import Model
from graphslam.models.line import LINE

STRAIGHT = 1e-6
"""Turns below this count as none, where the printed model changes to its limit, rad."""


class PlusInY(Filter):
    """The robot's y moves the wrong way in every curve. Source: SantanaLoc eqs. (9), (12)."""

    def motion(
        self, here: Array, there: Array, increment: Array, cov: Array
    ) -> tuple[Array, Array, Array]:
        """Returns the motion with ``+ L/T [cos(theta + T) - cos(theta)]`` in y."""
        F, Q, offset = super().motion(here, there, increment, cov)
        if abs(increment[2]) > STRAIGHT:
            offset = offset - [0.0, 2.0 * (there[1] - here[1]), 0.0]
        return F, Q, offset


class TurnForLength(Filter):
    """A robot that drives straight does not move. Source: SantanaLoc eq. (14)."""

    def motion(
        self, here: Array, there: Array, increment: Array, cov: Array
    ) -> tuple[Array, Array, Array]:
        """Returns the motion with the turn, which is none, in place of the length."""
        F, Q, offset = super().motion(here, there, increment, cov)
        if abs(increment[2]) <= STRAIGHT:
            printed = compose(here, np.array([increment[2], 0.0, increment[2]]))
            offset = offset + (printed - there) * [1.0, 1.0, 0.0]
        return F, Q, offset


class PoseTwice(Filter):
    """The last mean is added to a prediction that contains it. Source: SantanaLoc eq. (16)."""

    def motion(
        self, here: Array, there: Array, increment: Array, cov: Array
    ) -> tuple[Array, Array, Array]:
        """Returns the motion with ``mu + p(u, mu, 0)`` as the predicted mean."""
        F, Q, offset = super().motion(here, there, increment, cov)
        return F, Q, offset + here


class HeadingInRho(Filter):
    """Distances to lines depend on the heading. Source: SantanaLoc eqs. (29), (30)."""

    def residual(
        self, model: Model, pose: Array, params: Array, z: Array
    ) -> tuple[Array, Array, Array]:
        """Returns the residual with ``-/+ (x sin(alpha) - y cos(alpha))`` in H's first row."""
        e, J_pose, J_landmark = super().residual(model, pose, params, z)
        if model.kind == LINE.kind:
            x, y = pose[..., 0], pose[..., 1]
            J_pose[..., 0, 2] = x * J_pose[..., 0, 1] - y * J_pose[..., 0, 0]
        return e, J_pose, J_landmark


class LandmarkBlock(Filter):
    """Landmarks are corrected as if their angle acted backwards and had no lever arm.

    Source: SantanaSLAM eq. (27), which gives one H for both models (25) and (26); the pose's part
    is taken with the sign of the model in use, as SantanaLoc (29), (30) print it.
    """

    def residual(
        self, model: Model, pose: Array, params: Array, z: Array
    ) -> tuple[Array, Array, Array]:
        """Returns the residual with ``[[1, 0], [0, -1]]`` as the landmark's part of H."""
        e, J_pose, J_landmark = super().residual(model, pose, params, z)
        if model.kind == LINE.kind:
            J_landmark[:] = np.diag([1.0, -1.0])
        return e, J_pose, J_landmark


class LastMean(Filter):
    """The sensor is linearised at the pose before the motion. Source: SantanaSLAM eq. (6)."""

    before: Array | None = None

    def predict(self, i: int) -> None:
        """Moves the state, and keeps the mean it had."""
        self.before = self.state.mean[:3].copy()
        super().predict(i)

    def residual(
        self, model: Model, pose: Array, params: Array, z: Array
    ) -> tuple[Array, Array, Array]:
        """Returns the residual at the predicted mean with Jacobians at the last one."""
        e, *jacobians = super().residual(model, pose, params, z)
        if self.before is not None:
            _, *jacobians = super().residual(model, self.before, params, z)
        return e, jacobians[0], jacobians[1]


class NamesAsTheyAre(Filter):
    """Lines are told by (rho, alpha) as they are, though every line has two names.

    The measured angle's sign picks the model; what it predicts is compared with the landmarks'
    values as they stand, within the thresholds of `MatchingConfig`. The rest is as simple as in the
    paper: what matches nothing is a new landmark at once.

    Source: SantanaSLAM section 3.3.
    """

    def __init__(self, measurements: Measurements, config: EkfConfig, at: Estimate | None) -> None:
        super().__init__(measurements, config, at)
        self.first_name: dict[int, Array] = {}

    @property
    def recognises(self) -> bool:
        """Says no: what this project adds to the papers' matching stays off."""
        return False

    def find(
        self, node: int, model: Model, table: Sightings, rows: IntArray, first: int
    ) -> IntArray:
        """Returns the landmark (k,) of each sighting, or `NEW`."""
        landmarks = self.candidates(node, table.kind)
        if model.kind != LINE.kind or self.at is not None or not len(landmarks):
            return super().find(node, model, table, rows, first)
        limits = self.config.matching
        named = self.names(self.look_up(model, landmarks)[1], landmarks)
        found = np.full(len(rows), NEW)
        for i, row in enumerate(rows):
            off = np.abs(printed_name(self.state.mean[:3], table.z[row]) - named)
            off[:, 1] = np.abs(wrap(off[:, 1]))
            score = np.max(
                off / [limits.nearest_distance_m, math.radians(limits.nearest_angle_deg)], axis=1
            )
            if score.min() <= 1.0:
                found[i] = landmarks[np.argmin(score)]
        return found

    def start_landmark(
        self, node: int, model: Model, table: Sightings, row: int, first: int
    ) -> int | None:
        """Adds a landmark, and keeps by which of its names the paper stores it."""
        started = super().start_landmark(node, model, table, row, first)
        if started is not None and model.kind == LINE.kind:
            self.first_name[started] = printed_name(self.state.mean[:3], table.z[row])
        return started

    def names(self, params: Array, landmarks: IntArray) -> Array:
        """Returns landmarks (M, 2) by the names under which the paper stores them."""
        first = [self.first_name.get(int(row), p) for row, p in zip(landmarks, params, strict=True)]
        return nearest_twin(params, np.array(first))


def printed_name(pose: Array, z: Array) -> Array:
    """Returns the floor line (2,) that one sighting predicts by the printed choice of model.

    Model (25) where the angle in frame M, ``alpha_robot + pi/2``, is not negative, else (26), whose
    line is the twin.

    Source: SantanaSLAM section 3.3.
    """
    line = line_to_floor(z, pose)
    return line if wrap(z[1] + math.pi / 2) >= 0 else twin(line)
