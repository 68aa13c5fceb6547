"""EKF-SLAM that corrects what the robot sees: in those coordinates every sighting is linear.

The state is the filter's own, in the floor frame; what differs is what a correction moves. With
``d`` the additive errors of the filter, the errors here are

- of a landmark, that of its predicted sighting: ``J_pose d_pose + J_landmark d_landmark``;
- of the pose, the motion of the whole floor that carries it along: ``(dx + y dtheta,
  dy - x dtheta, dtheta)``, applied as one rigid motion of constant twist.

A sighting measures the first kind directly: its Jacobian is the identity wherever the state stands,
so corrections are exact, and moving path and map together is the same direction at all times, about
which no sequence of corrections can learn. Between corrections the state does not jump, so the
covariance may be kept in the filter's coordinates: a correction from one point to another carries
it over by ``P <- R P R'``, ``R = inv(T(after)) T(before)``, T the change to the errors above.

Source: the landmarks' errors are those of robot-centred mapping (Castellanos, Martinez-Cantin,
Tardos and Neira, "Robocentric map joining", RAS 2007), the pose's that of the right-invariant
filter (Barrau and Bonnabel, "An EKF-SLAM algorithm with consistency properties", 2015).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from graphslam.config import EkfConfig
from graphslam.ekf import Filter
from graphslam.errors import BadMeasurements
from graphslam.estimate import Estimate
from graphslam.geometry import Array, compose, twist_motion
from graphslam.measurements import IntArray, Measurements, Sightings
from graphslam.models import MODELS, Model

SETTLED = 1e-11
"""A landmark is found again when its predicted sighting is this near the wanted one, m and rad."""
MOST_STEPS = 10
"""Newton steps for that; a line needs two."""


def run_robot_centred(measurements: Measurements, config: EkfConfig | None = None) -> Estimate:
    """Returns what `graphslam.ekf.run_ekf` does, with corrections in the robot's own coordinates.

    Args:
        measurements: nodes, odometry, sightings.
        config: as of the filter.

    Raises:
        BadMeasurements: a kind of sighting does not fix its landmark by itself.
    """
    return RobotCentred(measurements, config or EkfConfig(), None).run()


@dataclass(frozen=True, slots=True)
class _Seen:
    """The landmarks of one kind that are in the state, as the robot would see them.

    Attributes:
        model: of the kind.
        columns: (M, l) places in the state.
        params: (M, l) parameters, floor frame.
        z_hat: (M, d) predicted sightings.
        J_pose: (M, d, 3) Jacobians of the predictions.
        J_landmark: (M, d, l) the same by the landmarks; d = l.
    """

    model: Model
    columns: IntArray
    params: Array
    z_hat: Array
    J_pose: Array
    J_landmark: Array


class RobotCentred(Filter):
    """The filter, corrected in the coordinates of what the robot sees."""

    name = "ekf-robot"

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
        if not len(rows):
            return
        before = self.state.mean[:3].copy()
        seen = [self._see(kind) for kind in self._kinds()]
        super().update(node, model, table, rows, landmarks, first)
        self._carry_over(before, seen)

    def _kinds(self) -> list[str]:
        return list(dict.fromkeys(self.roster.kinds[row] for row in self.roster.free()))

    def _see(self, kind: str) -> _Seen:
        """Returns the landmarks of a kind as the robot would see them from where it is."""
        model = MODELS[kind]
        if model.dim_z != model.dim_landmark:
            raise BadMeasurements(
                f"ekf-robot: one {kind} sighting does not fix its landmark; use ekf or ekf-fej"
            )
        rows = self.roster.free()
        rows = rows[np.array([self.roster.kinds[row] == kind for row in rows])]
        columns, params, _ = self.look_up(model, rows)
        nothing = np.zeros((len(rows), model.dim_z))
        z_hat, J_pose, J_landmark = self.residual(model, self.state.mean[:3], params, nothing)
        return _Seen(model, columns, params, z_hat, J_pose, J_landmark)

    def _carry_over(self, before: Array, seen: list[_Seen]) -> None:
        """Applies a correction that was computed at ``before`` as what it is of what is seen."""
        mean, P = self.state.mean, self.state.P
        step = self.state.deviation(before)
        turn = step[2]
        twist = np.array([step[0] + before[1] * turn, step[1] - before[0] * turn, turn])
        after = compose(twist_motion(twist), before)
        R_pose = np.eye(3)
        R_pose[:2, 2] = before[1] - after[1], after[0] - before[0]
        mean[:3] = after
        carried = []
        for group in seen:
            moved = (group.J_landmark @ (mean[group.columns] - group.params)[..., None])[..., 0]
            target = group.z_hat + group.J_pose @ step + moved
            found, J_pose, J_landmark = self._landmarks_seen_as(group, after, target)
            mean[group.columns] = found
            inverse = np.linalg.inv(J_landmark)
            A = inverse @ (group.J_pose - J_pose @ R_pose)
            carried.append((group.columns, A, inverse @ group.J_landmark))
        _carry_rows(P, R_pose, carried)
        _carry_rows(P.T, R_pose, carried)

    def _landmarks_seen_as(
        self, group: _Seen, pose: Array, target: Array
    ) -> tuple[Array, Array, Array]:
        """Returns the landmarks (M, l) that a pose sees as ``target`` (M, d), and Jacobians there.

        Raises:
            BadMeasurements: Newton's method does not find them.
        """
        params = self.state.mean[group.columns]
        for _ in range(MOST_STEPS):
            e, J_pose, J_landmark = self.residual(group.model, pose, params, target)
            if np.abs(e).max(initial=0.0) < SETTLED:
                return params, J_pose, J_landmark
            params = params - np.linalg.solve(J_landmark, e[..., None])[..., 0]
        raise BadMeasurements(
            f"ekf-robot: a correction moves a {group.model.kind} to where none is seen so; the "
            "filter has diverged: check the noise that the log states"
        )


def _carry_rows(P: Array, R_pose: Array, carried: list[tuple[IntArray, Array, Array]]) -> None:
    """Multiplies P (n, n) by R from the left, in place.

    Args:
        P: covariance, or its transpose.
        R_pose: (3, 3) the pose's block of R.
        carried: for each kind the landmarks' places (M, l) and their blocks of R (M, l, 3) by the
            pose and (M, l, l) by themselves.
    """
    pose = P[:3].copy()
    P[:3] = R_pose @ pose
    for columns, A, B in carried:
        P[columns] = A @ pose + B @ P[columns]
